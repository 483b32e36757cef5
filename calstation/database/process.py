"""The process that exchanges the runs of a folder with the shared database while the window or a run uses it."""

import logging
import multiprocessing
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from calstation import applog
from calstation.config import load_station
from calstation.database.state import Claim, ExchangeState, read_state, write_state
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

#: Shortest interval between two readings of the state, s.
_READ_S = 1.0

#: Time that the process has for a last exchange when its owner ends, s.
_END_S = 3.0

logger = logging.getLogger(__name__)


class ExchangeProcess:
    """The exchange of a folder in a process of its own, which ends with its owner; it never delays a run."""

    def __init__(
        self,
        folder: Path,
        url: str,
        station: str,
        claim: tuple[str, str | None] | None = None,
        archive: str | None = None,
    ) -> None:
        """Start the process; `claim` is the serial number of a unit and its operator, which it holds until the end."""
        self._folder, self._claim = folder, claim
        self._contact_before = read_state(folder).contact_utc
        context = multiprocessing.get_context("spawn")
        self._connection, there = context.Pipe()
        self.process = context.Process(target=_work, args=(there, folder, url, station, claim, archive), daemon=True)
        spawn_process(self.process)
        there.close()
        self._shown, self._read_at = set[Claim](), 0.0

    def claim(self, claim: tuple[str, str | None] | None) -> None:
        """Hold the claim on this unit in place of the previous one; None for no unit."""
        self._claim = claim
        with suppress(OSError):  # the process has ended
            self._connection.send(claim)

    def state(self) -> ExchangeState:
        """Return the state of the exchange; before the first contact of this process without claims, which are old."""
        state = read_state(self._folder)
        return replace(state, claims=()) if state.contact_utc == self._contact_before else state

    def new_claims(self) -> list[Claim]:
        """Return other stations' claims on the unit not returned before; reads the state once a second at most."""
        now = time.monotonic()
        if now < self._read_at + _READ_S:
            return []
        self._read_at = now
        serial = None if self._claim is None else self._claim[0]
        new = [claim for claim in self.state().claims if claim.serial == serial and claim not in self._shown]
        self._shown.update(new)
        return new

    def end(self) -> None:
        """Let the process end after a last exchange; does not wait."""
        self._connection.close()

    def close(self) -> None:
        """End the process after a last exchange, for which it has a few seconds at most."""
        self.end()
        self.process.join(_END_S)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.process.close()
        self._read_at = 0.0

    def __enter__(self) -> "ExchangeProcess":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self.close()


def start_exchange(
    station: Path | None, folder: Path, claim: tuple[str, str | None] | None = None
) -> ExchangeProcess | None:
    """Start the exchange of a folder; None if the station shares no records. Raises ConfigurationError."""
    _, config = load_station(station)
    if config.records.database is None:
        return None
    folder.mkdir(parents=True, exist_ok=True)
    return ExchangeProcess(folder, config.records.database, config.name, claim, config.records.archive)


def _work(
    owner: "Connection[Any, Any]",
    folder: Path,
    url: str,
    station: str,
    claim: tuple[str, str | None] | None,
    archive: str | None,
) -> None:
    """Exchange until the owner closes the pipe or ends; the owner sends the unit to claim, or None."""
    applog.configure("exchange")

    def wait(seconds: float) -> bool:
        nonlocal claim
        try:
            if owner.poll(seconds):
                claim = owner.recv()
        except (EOFError, OSError):
            return True
        return False

    try:
        watch(folder, url, station, wait, lambda: claim, archive)
    except Exception:
        logger.exception("the exchange ended by a mistake of the program")
        raise


def watch(
    folder: Path,
    url: str,
    station: str,
    wait: Callable[[float], bool],
    claim: Callable[[], tuple[str, str | None] | None] = lambda: None,
    archive: str | None = None,
) -> None:
    """Exchange a folder again and again, and copy its logs to an archive.

    Parameters
    ----------
    folder : runs folder of the station
    url, station : URL of the database, and name of the station
    wait : waits for a pause, s, and returns whether to end after a last exchange
    claim : returns the serial number of the unit to claim at present and its operator, None for no unit
    archive : folder or URL for copies of the logs; None for no copies
    """
    failed, ended, exchange, archiver = FAILED_S, False, None, None
    while True:
        try:
            if exchange is None:
                from calstation.database.exchange import Exchange

                exchange = Exchange(folder, url, station)
            exchange.claim = claim()
            begin = time.process_time()
            exchange_once(exchange, folder)
        except CalstationError as error:
            logger.warning("exchange of %s: %s", folder, error)
            if exchange is None:
                _note(folder, error, read_state(folder).pending)
            pause, failed = failed, min(2.0 * failed, LONGEST_S)
        else:
            pause, failed = min(max(PAUSE_S, (time.process_time() - begin) / _DUTY), LONGEST_S), FAILED_S
        if ended:
            break
        try:
            if archive is not None and exchange is not None:
                archiver = archiver or exchange.archiver(archive)
                pause = 0.0 if archiver.copy_next() else pause
        except (CalstationError, OSError) as error:
            logger.warning("archive of %s: %s", folder, error)
        ended = wait(pause)
    if exchange is not None:
        exchange.close()


def exchange_once(exchange: "Exchange", folder: Path) -> ExchangeState:
    """Exchange a folder unless another process does so, and return the state, which is also written to its file.

    Raises ConfigurationError if the exchange failed.
    """
    try:
        with locked(folder / ".exchange.lock", _LOCKED_S):
            try:
                claims = tuple(exchange.exchange())
            except CalstationError as error:
                _note(folder, error, exchange.outbox.pending)
                raise
            now = datetime.now(UTC)
            state = replace(read_state(folder), pending=exchange.outbox.pending, claims=claims, error=None)
            write_state(folder, replace(state, attempt_utc=now, contact_utc=now))
    except OSError as exc:
        raise ConfigurationError("database.folder_unusable", folder=folder, reason=os_reason(exc)) from exc
    return read_state(folder)


def _note(folder: Path, error: CalstationError, pending: int) -> None:
    """Write a failed attempt to the state of the exchange."""
    failed = error.as_text.to_json()
    write_state(folder, replace(read_state(folder), pending=pending, attempt_utc=datetime.now(UTC), error=failed))
