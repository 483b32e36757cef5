"""Process that exchanges the runs of a folder with the shared database while the user interface or a run uses it."""

import json
import logging
import math
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calstation.config import load_station
from calstation.database.state import Claim, ExchangeState, change_state, read_state
from calstation.errors import CalstationError, ConfigurationError
from calstation.messages import os_reason
from calstation.records import locked

if TYPE_CHECKING:
    from calstation.database.exchange import Exchange

#: Pause between two exchanges without errors, s.
PAUSE_S = 2.0

#: First and longest pause after failures of the exchange and of the archive, s.
RETRY_S, MAX_RETRY_S = 1.0, 60.0
ARCHIVE_RETRY_S, MAX_ARCHIVE_RETRY_S = 5.0, 600.0

#: Longest time to copy the logs of the last runs at the end, s.
_LAST_COPIES_S = 4.0

#: Largest fraction of a processor core that the exchange of a large folder may use.
_MAX_LOAD = 0.1

#: Longest time to wait for another process that exchanges the same folder, s.
_LOCK_TIMEOUT_S = 10.0

#: Time after which an exchange yields to other processes that use the same folder, and the duration of this pause, s.
_SLICE_S, _YIELD_S = 3.0, 0.2

#: Shortest interval between two readings of the state, s.
_MIN_READ_INTERVAL_S = 1.0

#: Longest time between two updates of the state if only its times change.
_MAX_UPDATE_INTERVAL = timedelta(seconds=30.0)

#: On Windows, Ctrl-C must only reach the process's owner.
_CREATION_FLAGS = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)

logger = logging.getLogger(__name__)


class ExchangeProcess(AbstractContextManager["ExchangeProcess"]):
    """A separate process that exchanges a folder's runs with the database; it ends after its owner and delays no run.

    Parameters
    ----------
    folder : runs folder of the station
    url, station : URL of the database, and name of the station
    claimed : operator of each unit to claim until the end, by serial number
    archive : folder or URL for copies of the logs; None for no copies
    """

    def __init__(
        self,
        folder: Path,
        url: str,
        station: str,
        claimed: Mapping[str, str | None] = {},
        archive: str | None = None,
    ) -> None:
        """Start the process."""
        self._folder, self._claimed = folder, claimed
        self._contact_before = read_state(folder).contact_utc
        self.process = subprocess.Popen(
            [sys.executable, "-m", "calstation.database"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            text=True,
            encoding="utf-8",
            start_new_session=True,  # Ctrl-C and the end of the terminal must only reach its owner
            creationflags=_CREATION_FLAGS,
        )
        self._send({"folder": str(folder), "url": url, "station": station, "archive": archive, "claimed": {**claimed}})
        self._returned, self._read_at = set[Claim](), 0.0

    def claim(self, claimed: Mapping[str, str | None]) -> None:
        """Claim these units for their operators, replacing the previous ones."""
        self._claimed = claimed
        self._send({**claimed})

    def _send(self, value: dict[str, Any]) -> None:
        with suppress(OSError):  # the process has already ended
            print(json.dumps(value), file=self.process.stdin, flush=True)

    def state(self) -> ExchangeState:
        """Return the state of the exchange, without outdated claims before the first contact of this process."""
        state = read_state(self._folder)
        return replace(state, claims=()) if state.contact_utc == self._contact_before else state

    def new_claims(self) -> list[Claim]:
        """Return other stations' claims that were not returned before; the state is read at most once per second."""
        now = time.monotonic()
        if now < self._read_at + _MIN_READ_INTERVAL_S:
            return []
        self._read_at = now
        claims = [claim for claim in self.state().claims if claim.serial in self._claimed]
        new = [claim for claim in claims if claim not in self._returned]
        self._returned.update(new)
        return new

    def end(self) -> None:
        """Request a last exchange and the end of the process; neither this call nor the owner's end waits for it."""
        if self.process.stdin is not None:
            with suppress(OSError):  # the process has already ended
                self.process.stdin.close()
        threading.Thread(target=self.process.wait, daemon=True).start()  # reaps the process when it ends

    def __exit__(self, *_: object) -> None:
        self.end()


def start_exchange(
    station: Path | None, folder: Path, claimed: Mapping[str, str | None] = {}
) -> ExchangeProcess | None:
    """Start the exchange process of a folder; return None if the station shares no records.

    Raises ConfigurationError.
    """
    _, config = load_station(station)
    if config.records.database is None:
        return None
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as exc:
        raise ConfigurationError("database.folder_unusable", folder=folder, reason=os_reason(exc)) from exc
    return ExchangeProcess(folder, config.records.database, config.name, claimed, config.records.archive)


def watch(
    folder: Path,
    url: str,
    station: str,
    wait: Callable[[float], bool],
    claimed: Callable[[], Mapping[str, str | None]] = dict,
    archive: str | None = None,
) -> None:
    """Exchange a folder's runs with the database repeatedly, and copy its logs to an archive in a background thread.

    Parameters
    ----------
    folder : runs folder of the station
    url, station : URL of the database, and name of the station
    wait : function that waits for a pause, s, and returns whether to end after a last exchange
    claimed : function that returns the operator of each unit to claim, by serial number
    archive : folder or URL for copies of the logs; None for no copies
    """
    pauses, ended, exchange = retry_pauses(RETRY_S, MAX_RETRY_S), False, None
    archiver, stop = None, threading.Event()
    if archive is None:
        with suppress(OSError):
            change_state(folder, logs_pending=0, archive_error=None)
    while True:
        try:
            if exchange is None:
                from calstation.database.exchange import Exchange

                exchange = Exchange(folder, url, station)
                if archive is not None and archiver is None:
                    archiver = threading.Thread(target=_copy_logs, args=(folder, archive, stop), daemon=True)
                    archiver.start()
            exchange.claimed = claimed()
            begin = time.thread_time()
            _exchange_part(exchange, folder)
        except Exception as exc:  # noqa: BLE001 - the next exchange may succeed
            error = _to_calstation_error(exc, folder)
            if exchange is not None and error is not exc:
                exchange.close()
                exchange = None
            if exchange is None:
                with suppress(OSError):
                    change_state(folder, attempt_utc=datetime.now(UTC), error=error.as_text)
            pause = next(pauses)
        else:
            pauses = retry_pauses(RETRY_S, MAX_RETRY_S)
            pause = _YIELD_S
            if exchange.complete:
                pause = min(max(PAUSE_S, (time.thread_time() - begin) / _MAX_LOAD), MAX_RETRY_S)
        if ended:
            break
        ended = wait(pause)
    stop.set()
    if exchange is not None:
        if archiver is not None:
            archiver.join(_LAST_COPIES_S)
            try:
                _exchange_part(exchange, folder)  # records the last copies
            except Exception as exc:  # noqa: BLE001 - the next start continues
                _to_calstation_error(exc, folder)
        exchange.close()


def retry_pauses(first: float, longest: float) -> Iterator[float]:
    """Yield the pauses, s, after consecutive failures, each twice as long as the previous one, up to the longest."""
    while True:
        yield first
        first = min(2.0 * first, longest)


def _to_calstation_error(exc: Exception, folder: Path) -> CalstationError:
    """Log an exception and return it; a programming error is converted to an error with a code."""
    if isinstance(exc, CalstationError):
        logger.warning("exchange of %s: %s", folder, exc)
        return exc
    logger.error("exchange of %s: a programming error", folder, exc_info=exc)
    return CalstationError("program.internal", detail=f"{type(exc).__name__}: {exc}")


def _copy_logs(folder: Path, archive: str, stop: threading.Event) -> None:
    """Copy the closed logs of a folder to an archive until `stop` is set, then once more for some seconds."""
    from calstation.database.archiver import LogArchiver

    archiver, pauses = None, retry_pauses(ARCHIVE_RETRY_S, MAX_ARCHIVE_RETRY_S)
    while True:
        pause, last = PAUSE_S, stop.is_set()
        end = time.monotonic() + _LAST_COPIES_S if last else math.inf
        try:
            archiver = archiver or LogArchiver(folder, archive)
            while archiver.copy_next() and stop.is_set() == last and time.monotonic() < end:
                pauses = retry_pauses(ARCHIVE_RETRY_S, MAX_ARCHIVE_RETRY_S)
        except Exception as exc:  # noqa: BLE001 - the next attempt may succeed
            with suppress(OSError):
                change_state(folder, archive_error=_to_calstation_error(exc, folder).as_text)
            pause = next(pauses)
        if last:
            return
        stop.wait(pause)


def exchange_once(exchange: "Exchange", folder: Path) -> ExchangeState:
    """Exchange a folder's runs, taking turns with other processes; write the state to its file and return it.

    Raises ConfigurationError if the exchange failed, or another process blocked it.
    """
    _exchange_part(exchange, folder)
    while not exchange.complete:
        time.sleep(_YIELD_S)
        _exchange_part(exchange, folder)
    return read_state(folder)


def _exchange_part(exchange: "Exchange", folder: Path) -> None:
    """Exchange a folder's runs for some seconds and write the state.

    Raises ConfigurationError if the exchange failed, or another process blocked it.
    """
    try:
        with locked(folder / ".exchange.lock", _LOCK_TIMEOUT_S):
            try:
                claims = exchange.exchange(_SLICE_S)
            except CalstationError as error:
                now, pending = datetime.now(UTC), exchange.outbox.pending
                change_state(folder, pending=pending, attempt_utc=now, error=error.as_text)
                raise
            _write_contact(exchange, folder, claims)
    except TimeoutError as exc:
        raise ConfigurationError("database.busy", folder=folder) from exc
    except OSError as exc:
        raise ConfigurationError("database.folder_unusable", folder=folder, reason=os_reason(exc)) from exc


def _write_contact(exchange: "Exchange", folder: Path, claims: list[Claim]) -> None:
    """Write the state after a successful exchange; if only its times have changed, at most twice a minute."""
    now, old, outbox = datetime.now(UTC), read_state(folder), exchange.outbox
    new = {"pending": outbox.pending, "claims": tuple(claims), "error": None, "refusal": outbox.refusal}
    recent = old.contact_utc is not None and old.contact_utc > max(exchange.created_utc, now - _MAX_UPDATE_INTERVAL)
    if not recent or any(getattr(old, name) != value for name, value in new.items()):
        change_state(folder, **new, attempt_utc=now, contact_utc=now)
