"""The process that exchanges the runs of a folder with the shared database while the window or a run uses it."""

import logging
import multiprocessing
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from calstation import applog
from calstation.config import load_station
from calstation.database.state import Claim, ExchangeState, change_state, read_state
from calstation.errors import CalstationError, ConfigurationError
from calstation.jobs import spawn_process
from calstation.messages import os_reason
from calstation.records import locked

if TYPE_CHECKING:
    from calstation.database.exchange import Exchange

#: Pauses between two exchanges, s: while all is well, and at least and at most after a failure.
PAUSE_S, FAILED_S, LONGEST_S = 2.0, 1.0, 60.0

#: Largest share of a core that exchanges of a large folder may take.
_DUTY = 0.1

#: Longest time to wait for another process that exchanges the same folder, s.
_LOCKED_S = 10.0

#: Time after which an exchange lets other processes exchange the same folder, and for how long, s.
_PART_S, _RELEASED_S = 3.0, 0.2

#: Shortest interval between two readings of the state, s.
_READ_S = 1.0

#: Time that the process has for a last exchange when its owner ends, and then to be killed, s.
_END_S, _KILL_S = 3.0, 1.0

#: Longest time for which the state is not written while only its time changes.
_UNCHANGED = timedelta(seconds=30.0)

logger = logging.getLogger(__name__)


class ExchangeProcess:
    """The exchange of a folder in a process of its own, which ends with its owner; it never delays a run."""

    def __init__(
        self,
        folder: Path,
        url: str,
        station: str,
        claimed: Mapping[str, str | None] = {},
        archive: str | None = None,
    ) -> None:
        """Start the process; `claimed` names the operator by serial number of the units to claim until the end."""
        self._folder, self._claimed = folder, claimed
        self._contact_before = read_state(folder).contact_utc
        context = multiprocessing.get_context("spawn")
        self._connection, there = context.Pipe()
        self.process = context.Process(target=_work, args=(there, folder, url, station, claimed, archive), daemon=True)
        spawn_process(self.process)
        there.close()
        self._shown, self._read_at = set[Claim](), 0.0

    def claim(self, claimed: Mapping[str, str | None]) -> None:
        """Hold the claims on these units, with their operators, in place of the previous ones."""
        self._claimed = claimed
        with suppress(OSError):  # the process has ended
            self._connection.send(claimed)

    def state(self) -> ExchangeState:
        """Return the state of the exchange; before the first contact of this process without claims, which are old."""
        state = read_state(self._folder)
        return replace(state, claims=()) if state.contact_utc == self._contact_before else state

    def new_claims(self) -> list[Claim]:
        """Return other stations' claims on these units not returned before; reads the state once a second at most."""
        now = time.monotonic()
        if now < self._read_at + _READ_S:
            return []
        self._read_at = now
        claims = [claim for claim in self.state().claims if claim.serial in self._claimed]
        new = [claim for claim in claims if claim not in self._shown]
        self._shown.update(new)
        return new

    def end(self) -> None:
        """Let the process end after a last exchange; does not wait."""
        self._connection.close()

    def close(self) -> None:
        """End the process after a last exchange, for which it has a few seconds at most."""
        close_exchanges([self])
        self._read_at = 0.0

    def __enter__(self) -> "ExchangeProcess":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self.close()


def close_exchanges(exchanges: Sequence[ExchangeProcess]) -> None:
    """End processes after a last exchange, for which all of them together have a few seconds at most."""
    for exchange in exchanges:
        exchange.end()
    processes = [exchange.process for exchange in exchanges]
    deadline = time.monotonic() + _END_S
    for process in processes:
        process.join(max(0.0, deadline - time.monotonic()))
        if process.is_alive():
            process.kill()
    deadline = time.monotonic() + _KILL_S
    for process in processes:
        process.join(max(0.0, deadline - time.monotonic()))  # one that hangs on a share ends later
        if not process.is_alive():
            process.close()


def start_exchange(
    station: Path | None, folder: Path, claimed: Mapping[str, str | None] = {}
) -> ExchangeProcess | None:
    """Start the exchange of a folder; None if the station shares no records. Raises ConfigurationError."""
    _, config = load_station(station)
    if config.records.database is None:
        return None
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as exc:
        raise ConfigurationError("database.folder_unusable", folder=folder, reason=os_reason(exc)) from exc
    return ExchangeProcess(folder, config.records.database, config.name, claimed, config.records.archive)


def _work(
    owner: "Connection[Any, Any]",
    folder: Path,
    url: str,
    station: str,
    claimed: Mapping[str, str | None],
    archive: str | None,
) -> None:
    """Exchange until the owner closes the pipe or ends; the owner sends the units to claim."""
    applog.configure("exchange")

    def wait(seconds: float) -> bool:
        nonlocal claimed
        try:
            while owner.poll(seconds):
                claimed, seconds = owner.recv(), 0.0
        except (EOFError, OSError):
            return True
        return False

    try:
        watch(folder, url, station, wait, lambda: claimed, archive)
    except Exception:
        logger.exception("the exchange ended by a mistake of the program")
        raise


def watch(
    folder: Path,
    url: str,
    station: str,
    wait: Callable[[float], bool],
    claimed: Callable[[], Mapping[str, str | None]] = dict,
    archive: str | None = None,
) -> None:
    """Exchange a folder again and again, and copy its logs to an archive in a thread, for which nothing waits.

    Parameters
    ----------
    folder : runs folder of the station
    url, station : URL of the database, and name of the station
    wait : waits for a pause, s, and returns whether to end after a last exchange
    claimed : returns the operator by serial number of the units to claim at present
    archive : folder or URL for copies of the logs; None for no copies
    """
    failed, ended, exchange = FAILED_S, False, None
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
            exchange_once(exchange, folder)
        except Exception as exc:  # noqa: BLE001 - whatever one pass did, the next may succeed
            error = _known(exc, folder)
            if exchange is not None and error is not exc:
                exchange.close()
                exchange = None
            if exchange is None:
                with suppress(OSError):
                    change_state(folder, attempt_utc=datetime.now(UTC), error=error.as_text.to_json())
            pause, failed = failed, min(2.0 * failed, LONGEST_S)
        else:
            pause, failed = min(max(PAUSE_S, (time.thread_time() - begin) / _DUTY), LONGEST_S), FAILED_S
        if ended:
            break
        ended = wait(pause)
    stop.set()
    if exchange is not None:
        exchange.close()


def _known(exc: Exception, folder: Path) -> CalstationError:
    """Log an exception of an exchange, and return it; one that is a mistake of the program as an error with a code."""
    if isinstance(exc, CalstationError):
        logger.warning("exchange of %s: %s", folder, exc)
        return exc
    logger.error("exchange of %s: a mistake of the program", folder, exc_info=exc)
    return CalstationError("program.internal", detail=f"{type(exc).__name__}: {exc}")


def _copy_logs(folder: Path, archive: str, stop: threading.Event) -> None:
    """Copy the closed logs of a folder to an archive until `stop` is set."""
    from calstation.database.archiver import LogArchiver

    archiver, failed = None, FAILED_S
    while not stop.is_set():
        try:
            archiver = archiver or LogArchiver(folder, archive)
            while archiver.copy_next() and not stop.is_set():
                pass
        except Exception as exc:  # noqa: BLE001 - the next attempt may succeed
            with suppress(OSError):
                change_state(folder, archive_error=_known(exc, folder).as_text.to_json())
            stop.wait(failed)
            failed = min(2.0 * failed, LONGEST_S)
        else:
            failed = FAILED_S
        stop.wait(PAUSE_S)


def exchange_once(exchange: "Exchange", folder: Path) -> ExchangeState:
    """Exchange a folder in turns with other processes, and return the state, which is also written to its file.

    Raises ConfigurationError if the exchange failed, or another process did not let this one exchange.
    """
    try:
        exchange.outbox.refresh()  # takes minutes for the first time in a large folder
        while not _exchange_part(exchange, folder):
            time.sleep(_RELEASED_S)
    except TimeoutError as exc:
        raise ConfigurationError("database.busy", folder=folder) from exc
    except OSError as exc:
        raise ConfigurationError("database.folder_unusable", folder=folder, reason=os_reason(exc)) from exc
    return read_state(folder)


def _exchange_part(exchange: "Exchange", folder: Path) -> bool:
    """Exchange a folder for some seconds; return whether all is exchanged. Raises TimeoutError if others do so."""
    with locked(folder / ".exchange.lock", _LOCKED_S):
        try:
            claims = exchange.exchange(_PART_S)
        except CalstationError as error:
            failed = error.as_text.to_json()
            change_state(folder, pending=exchange.outbox.pending, attempt_utc=datetime.now(UTC), error=failed)
            raise
        if claims is None:
            return False
        now, old = datetime.now(UTC), read_state(folder)
        new = {"pending": exchange.outbox.pending, "claims": tuple(claims), "error": None}
        recent = old.contact_utc is not None and old.contact_utc > max(exchange.begun_utc, now - _UNCHANGED)
        if not recent or any(getattr(old, name) != value for name, value in new.items()):
            change_state(folder, **new, attempt_utc=now, contact_utc=now)
    return True
