"""The task of a worker for a log: copy and solve it, write the solution to the database, and return the status."""

import hashlib
import json
import logging
import os
import signal
import sys
import tempfile
import time
from asyncio import to_thread
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from distributed import Worker, WorkerPlugin, get_worker
from sqlalchemy import Engine
from sqlalchemy.exc import DataError, DBAPIError, IntegrityError, InterfaceError, OperationalError

from calstation import __version__
from calstation.database import connect
from calstation.database import failure as database_error
from calstation.errors import CalstationError, ConfigurationError, InputError
from calstation.fleet.sources import Origin, StoredLog, files_of, storage_reason
from calstation.fleet.store import (
    Assignment,
    Outcome,
    SolveSettings,
    Status,
    add_location,
    add_solution,
    find_solution,
    stored_error,
)
from calstation.messages import values_to_json
from calstation.records import Log, LogMeta, locked, open_log
from calstation.results import SCHEMA, Result, resolve_log, warm_up

#: Delays before another attempt to reach a file or the database, s.
RETRY_DELAYS = (1.0, 3.0, 10.0)
#: Timeout for another process of this host that compiles the kernels, s.
_COMPILE_TIMEOUT = 600.0

logger = logging.getLogger(__name__)

T = TypeVar("T")


class UnreachableError(Exception):
    """Raised if a log or the database is currently unreachable."""

    def __init__(self, error: CalstationError) -> None:
        super().__init__(str(error))
        self.error = error


class WarmUp(WorkerPlugin):
    """Prepares a worker: compiles the kernels once per host, and lets a local worker ignore Ctrl-C."""

    name = "calstation"
    idempotent = True

    def __init__(self, local: bool) -> None:
        self._local = local

    async def setup(self, worker: Worker) -> None:
        """Compile the kernels, or load them."""
        if self._local:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        await to_thread(_compile_kernels)


def _compile_kernels() -> None:
    user = "" if sys.platform == "win32" else str(os.getuid())  # other users cannot open the lock
    with locked(Path(tempfile.gettempdir()) / f"calstation-warm-up-{user}.lock", _COMPILE_TIMEOUT):
        warm_up()


def solve_stored_log(assignment: Assignment, stored: StoredLog) -> Status:
    """Copy a log to the local disk, solve it, and write the solution if it is missing.

    A log that cannot be solved is stored as failed, unless memory is exhausted. This function never raises, because the
    program would wait forever for a task whose traceback `distributed` cannot unpickle.
    """
    seconds: dict[str, float] = {}
    try:
        if assignment.software != __version__:
            raise ConfigurationError("fleet.worker_version", worker=__version__, wanted=assignment.software)
        status = _copy_and_solve(assignment, stored, seconds)
    except UnreachableError as exc:
        status = Status(stored.location, "unreachable", error=error_of(exc.error))
    except OSError as exc:
        status = Status(stored.location, "unreachable", error=error_of(_read_error(exc)))
    except MemoryError:
        failure = CalstationError("fleet.no_memory", file=stored.location)
        status = Status(stored.location, "unreachable", error=error_of(failure))
    except ConfigurationError as exc:
        status = Status(stored.location, "refused", error=error_of(exc))
    except Exception as exc:  # a programming error must not stop the other tasks
        logger.exception("solving %s failed", stored.location)
        status = Status(stored.location, "unreachable", error=error_of(_internal_error(stored, exc)))
    return replace(status, seconds=seconds)


def _copy_and_solve(assignment: Assignment, stored: StoredLog, seconds: dict[str, float]) -> Status:
    with tempfile.TemporaryDirectory(dir=get_worker().local_directory) as folder:
        begin = time.perf_counter()
        local = _with_retries(lambda: _copy_log(stored, Path(folder)))
        seconds["copy"] = time.perf_counter() - begin
        engine = _with_retries(lambda: _engine(assignment.database))
        try:
            return _LogTask(engine, assignment, stored, local, seconds).solve()
        except DBAPIError as exc:
            raise database_error(exc, engine.url) from exc


@dataclass(frozen=True)
class _LogTask:
    """A log that has been copied to the local disk."""

    engine: Engine
    assignment: Assignment
    stored: StoredLog
    local: Path
    seconds: dict[str, float]

    def solve(self) -> Status:
        """Solve the log if it is selected, and write the solution if it is missing."""
        begin = time.perf_counter()
        stored, settings, retry = self.stored, self.assignment.settings, self.assignment.retry_failed
        log: Log | None = None
        changed: bool | None = None
        try:
            log = open_log(self.local)
            origin = Origin.of(log.meta)
            if not self.assignment.selection.includes(origin):
                self._in_database(lambda: add_location(self.engine, stored, None, origin))
                return Status(stored.location, "not_selected")
            meta = settings.changes.applied(log.meta)
            changed = _is_changed(log.meta, meta, settings)
            if (sha256 := log.stored_sha256) is not None:
                existing = self._in_database(lambda: find_solution(self.engine, settings, sha256, _digest(meta)))
                if existing is not None and not (retry and existing.error) and log.facts().sha256 == sha256:
                    self._in_database(lambda: add_location(self.engine, stored, sha256, origin))
                    outcome: Outcome = "failed" if existing.error else "stored"
                    return Status(stored.location, outcome, existing.number, existing.error, existing.changed)
            span = settings.first_seq, settings.last_seq
            result = resolve_log(log, meta, settings.stages, *span, diagnostics=settings.diagnostics).result
        except (DBAPIError, UnreachableError, OSError, MemoryError):
            raise
        except Exception as exc:  # a programming error must not stop the other tasks
            logger.exception("solving %s failed", stored.location)
            failure = exc if isinstance(exc, CalstationError) else _internal_error(stored, exc)
            digests = _digests(log, settings, self.local)
            result = failed_result(failure, None if log is None else log.meta, str(self.local), *digests)
        self.seconds["solve"] = time.perf_counter() - begin
        try:
            return self._write(result, changed)
        except (DataError, IntegrityError) as exc:  # PostgreSQL does not support NUL characters, for example
            failure = CalstationError("fleet.not_stored", file=stored.location, reason=str(exc.orig))
            digests = result.log.sha256, result.configuration_sha256
            return self._write(failed_result(failure, None, str(self.local), *digests), changed)

    def _write(self, result: Result, changed: bool | None) -> Status:
        """Write a result to the database with the location of the log instead of the path of its copy."""
        begin = time.perf_counter()
        stored = self.stored
        quoted, location = (json.dumps(text, ensure_ascii=False)[1:-1] for text in (str(self.local), stored.location))
        text = json.dumps(result.to_json(), allow_nan=False, ensure_ascii=False).replace(quoted, location)
        settings, retry = self.assignment.settings, self.assignment.retry_failed
        number, new = self._in_database(
            lambda: add_solution(self.engine, settings, stored, result, text, changed=changed, retry=retry)
        )
        self.seconds["write"] = time.perf_counter() - begin
        error = stored_error(text)
        outcome: Outcome = "failed" if error else "solved" if new else "stored"
        return Status(stored.location, outcome, number, error, changed)

    def _in_database(self, action: Callable[[], T]) -> T:
        """Return the result of an action, which is repeated while the database is unreachable or locked."""

        def attempt() -> T:
            try:
                return action()
            except (OperationalError, InterfaceError) as exc:
                raise UnreachableError(database_error(exc, self.engine.url)) from exc

        return _with_retries(attempt)


def _is_changed(original: LogMeta, meta: LogMeta, settings: SolveSettings) -> bool:
    """Return whether configuration, range or stages differ from the log's own."""
    if meta != original or settings.first_seq is not None or settings.last_seq is not None:
        return True
    return settings.stages is not None and (original.run is None or [*settings.stages] != original.run.stages)


def _digests(log: Log | None, settings: SolveSettings, local: Path) -> tuple[str, str]:
    """Return the digests of the log and its configuration, which identify a solution in all versions.

    If a log cannot be read to its end, the digest of the bytes of the file is used.
    """
    try:
        sha256 = "" if log is None else log.facts().sha256
    except CalstationError:
        sha256 = ""
    if log is None or not sha256:
        return hashlib.sha256(local.read_bytes()).hexdigest(), ""
    try:
        meta = settings.changes.applied(log.meta)
    except CalstationError:
        meta = log.meta
    return sha256, _digest(meta)


def _digest(meta: LogMeta) -> str:
    return hashlib.sha256(meta.to_json().encode()).hexdigest()


def failed_result(error: CalstationError, meta: LogMeta | None, file: str, sha256: str, configuration: str) -> Result:
    """Return the result for a log that cannot be solved.

    Parameters
    ----------
    error : why the log cannot be solved
    meta : configuration of the log; None if it cannot be read
    file : location of the log
    sha256 : digest of the log
    configuration : digest of the configuration
    """
    run = meta.run if meta is not None else None
    return Result.model_validate(
        {
            "schema": SCHEMA,
            "unit": {"serial": "" if meta is None else meta.imu.serial},
            "stages": [],
            "passed": None,
            "parameters": {},
            "outcome": "failed",
            "station": run.station if run else None,
            "product": meta.product.name if meta is not None and meta.product else None,
            "log": {"file": file, "sha256": sha256},
            "configuration_sha256": configuration,
            "software": {"version": __version__},
            "started_utc": run.started_utc if run else None,
            "batch": run.batch if run else None,
            "slot": run.slot if run else None,
            **error_of(error),
        }
    )


def error_of(error: CalstationError) -> dict[str, Any]:
    """Return an error as in a result JSON."""
    return {"error": str(error), "error_code": error.code, "error_values": values_to_json(error.values)}


def _internal_error(stored: StoredLog, error: Exception) -> CalstationError:
    return CalstationError("fleet.solving_failed", file=stored.location, detail=f"{type(error).__name__}: {error}")


def _read_error(error: Exception) -> ConfigurationError:
    return ConfigurationError("fleet.unreachable", reason=storage_reason(error))


def _copy_log(stored: StoredLog, folder: Path) -> Path:
    """Copy a log, and the TOML file of a CSV file, into a folder, and return the path of the copy.

    Raises UnreachableError, also if the copy differs from the original in its size or, for the archive, in its digest.
    """
    try:
        system, paths = files_of(stored.location)
        targets = [folder / path.rpartition("/")[2] for path in paths]
        for path, target in zip(paths, targets, strict=True):
            system.get_file(path, str(target))
        sizes = [target.stat().st_size for target in targets]
    except Exception as exc:  # every file system has its own errors
        raise UnreachableError(_read_error(exc)) from exc
    damaged = any(expected not in (None, size) for expected, size in zip(stored.sizes, sizes, strict=True))
    if stored.file_sha256 is not None and not damaged:
        with targets[0].open("rb") as stream:
            damaged = hashlib.file_digest(stream, "sha256").hexdigest() != stored.file_sha256
    if damaged:
        raise UnreachableError(InputError("fleet.copy_damaged", file=stored.location))
    return targets[0]


@lru_cache(maxsize=1)
def _engine(database: str) -> Engine:
    """Return an engine without a pool, so that hundreds of workers keep no connections open while they solve."""
    try:
        return connect(database, pooled=False)
    except ConfigurationError as exc:
        if exc.code == "database.unreachable":
            raise UnreachableError(exc) from exc
        raise


def _with_retries(action: Callable[[], T]) -> T:
    """Return the result of an action, which is repeated while it raises UnreachableError."""
    for pause in RETRY_DELAYS:
        try:
            return action()
        except UnreachableError:
            time.sleep(pause)
    return action()
