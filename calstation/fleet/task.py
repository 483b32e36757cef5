"""One log on a worker: copied, solved, written into the database; only its status returns."""

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
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, TypeVar

from distributed import Worker, WorkerPlugin, get_worker
from sqlalchemy import Engine
from sqlalchemy.exc import DataError, InterfaceError, OperationalError, SQLAlchemyError

from calstation import __version__
from calstation.database import connect
from calstation.errors import CalstationError, ConfigurationError
from calstation.fleet.sources import StoredLog, files_of
from calstation.fleet.store import Wanted, add_solution, find_solution, set_location, stored_error
from calstation.messages import values_to_json
from calstation.records import Log, LogMeta, locked, open_log
from calstation.results import SCHEMA, Result, resolve_log, warm_up

#: Pauses before a file or the database is tried again, s.
PAUSES = (1.0, 3.0, 10.0)
#: Longest time to wait for another process of this host that compiles the kernels, s.
_COMPILED_WITHIN = 600.0

logger = logging.getLogger(__name__)

T = TypeVar("T")


@dataclass(frozen=True)
class Assignment:
    """What all tasks have in common."""

    database: str
    wanted: Wanted
    software: str = __version__


@dataclass(frozen=True)
class Status:
    """What became of a log."""

    location: str
    #: ``failed``: stored as failed, now or before; ``unreachable``: failed without being stored.
    outcome: Literal["solved", "there", "failed", "unreachable", "refused"]
    solution: int | None = None  #: Its number in the database; None without one.
    error: dict[str, Any] = field(default_factory=dict)  #: The error as in a result JSON; {} if there is none.
    seconds: dict[str, float] = field(default_factory=dict)  #: Duration of ``copy``, ``solve`` and ``write``.


class WarmUp(WorkerPlugin):
    """Prepares a worker: its host compiles the kernels once; on a local worker, Ctrl-C concerns only its program."""

    name = "calstation"
    idempotent = True

    def __init__(self, local: bool) -> None:
        self._local = local

    async def setup(self, worker: Worker) -> None:
        """Compile the kernels, or load them."""
        if self._local:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        await to_thread(_warm)


def _warm() -> None:
    with locked(Path(tempfile.gettempdir()) / f"calstation-warm-up-{_user()}.lock", _COMPILED_WITHIN):
        warm_up()


def _user() -> str:
    """Number of the user, whose lock no other user can open; on Windows the folder is the user's own."""
    return "" if sys.platform == "win32" else str(os.getuid())


def solve_stored_log(assignment: Assignment, stored: StoredLog) -> Status:
    """Copy a log to the local disk, solve it and write the solution, unless there is one.

    A log that cannot be solved is written as failed, but not for lack of memory. Raises nothing, because a traceback
    that distributed cannot unpack would leave the program that waits for this task waiting for ever.
    """
    seconds: dict[str, float] = {}
    try:
        if assignment.software != __version__:
            raise ConfigurationError("fleet.worker_version", worker=__version__, wanted=assignment.software)
        status = _copy_and_solve(assignment, stored, seconds)
    except OSError as exc:
        status = Status(stored.location, "unreachable", error=unreachable(exc))
    except MemoryError:
        failure = CalstationError("fleet.no_memory", file=stored.location)
        status = Status(stored.location, "unreachable", error=error_of(failure))
    except SQLAlchemyError as exc:
        refused = ConfigurationError("fleet.database_failed", reason=str(exc).partition("\n")[0])
        status = Status(stored.location, "refused", error=error_of(refused))
    except ConfigurationError as exc:
        status = Status(stored.location, "refused", error=error_of(exc))
    return replace(status, seconds=seconds)


def _copy_and_solve(assignment: Assignment, stored: StoredLog, seconds: dict[str, float]) -> Status:
    with tempfile.TemporaryDirectory(dir=get_worker().local_directory) as folder:
        begin = time.perf_counter()
        local = _persistently(lambda: _copied(stored.location, Path(folder)))
        seconds["copy"] = time.perf_counter() - begin
        engine = _persistently(lambda: _engine(assignment.database))
        try:
            return _solve(engine, assignment.wanted, stored, local, seconds)
        finally:
            engine.dispose()  # hundreds of workers must not each keep a connection


def _solve(engine: Engine, wanted: Wanted, stored: StoredLog, local: Path, seconds: dict[str, float]) -> Status:
    begin = time.perf_counter()
    log: Log | None = None
    failure: CalstationError
    try:
        log = open_log(local)
        meta = wanted.changes.applied(log.meta)
        if log.stored_sha256 is not None:
            there = _persistently(lambda: find_solution(engine, wanted, str(log.stored_sha256), _digest(meta)))
            if there is not None and log.facts().sha256 == log.stored_sha256:
                number, stamp = there.number, stored.fingerprint or ""
                _persistently(lambda: set_location(engine, number, stored.location, stamp))
                return Status(stored.location, "failed" if there.error else "there", there.number, there.error)
        span = wanted.first_seq, wanted.last_seq
        result = resolve_log(log, meta, wanted.stages, *span, diagnostics=wanted.diagnostics).result
    except (SQLAlchemyError, OSError, MemoryError):
        raise
    except Exception as exc:  # a mistake of the program must not stop the rest
        logger.exception("solving %s failed", stored.location)
        detail = f"{type(exc).__name__}: {exc}"
        failure = CalstationError("fleet.solving_failed", file=stored.location, detail=detail)
        failure = exc if isinstance(exc, CalstationError) else failure
        result = failed_result(failure, None if log is None else log.meta, str(local), *_digests(log, wanted, local))
    seconds["solve"] = time.perf_counter() - begin
    try:
        return _write(engine, wanted, stored, result, str(local), seconds)
    except DataError as exc:  # e.g. a zero character, which PostgreSQL has not
        failure = CalstationError("fleet.not_stored", file=stored.location, reason=str(exc.orig))
        result = failed_result(failure, None, str(local), result.log.sha256, result.configuration_sha256)
        return _write(engine, wanted, stored, result, str(local), seconds)


def _write(
    engine: Engine, wanted: Wanted, stored: StoredLog, result: Result, path: str, seconds: dict[str, float]
) -> Status:
    """Write a result into the database, with the location of the log in place of the path of its copy."""
    begin = time.perf_counter()
    quoted, location = (json.dumps(text, ensure_ascii=False)[1:-1] for text in (path, stored.location))
    text = json.dumps(result.to_json(), allow_nan=False, ensure_ascii=False).replace(quoted, location)
    number, new = _persistently(
        lambda: add_solution(engine, wanted, stored.location, stored.fingerprint or "", result, text)
    )
    seconds["write"] = time.perf_counter() - begin
    error = stored_error(text)
    outcome: Literal["solved", "there", "failed"] = "failed" if error else "solved" if new else "there"
    return Status(stored.location, outcome, number, error, seconds)


def _digests(log: Log | None, wanted: Wanted, local: Path) -> tuple[str, str]:
    """Return the digests of log and configuration by which its solution is found, also in other versions.

    That of the bytes of the file stands for a log that cannot be read to its end.
    """
    try:
        assert log is not None
        sha256 = log.facts().sha256
    except (AssertionError, CalstationError):
        return hashlib.sha256(local.read_bytes()).hexdigest(), ""
    try:
        meta = wanted.changes.applied(log.meta)
    except CalstationError:
        meta = log.meta
    return sha256, _digest(meta)


def _digest(meta: LogMeta) -> str:
    return hashlib.sha256(meta.to_json().encode()).hexdigest()


def failed_result(error: CalstationError, meta: LogMeta | None, file: str, sha256: str, configuration: str) -> Result:
    """Return the result of a log that cannot be solved."""
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


def unreachable(error: OSError) -> dict[str, Any]:
    """Return the error of a log or database that cannot be reached, as in a result JSON."""
    return error_of(ConfigurationError("fleet.unreachable", reason=str(error)))


def _copied(location: str, folder: Path) -> Path:
    """Copy a log, and the TOML file of a CSV, into a folder; return its path. Raises OSError."""
    system, paths = files_of(location)
    targets = [folder / path.rpartition("/")[2] for path in paths]
    for path, target in zip(paths, targets, strict=True):
        system.get_file(path, str(target))
    return targets[0]


@lru_cache(maxsize=1)
def _engine(database: str) -> Engine:
    return connect(database)


def _persistently(action: Callable[[], T]) -> T:
    """Return the result of an action, which is repeated while a file or the database is not reachable.

    Raises OSError if it stays so.
    """
    for pause in (*PAUSES, None):
        try:
            return action()
        except (OSError, OperationalError, InterfaceError, ConfigurationError) as exc:
            if isinstance(exc, ConfigurationError) and exc.code != "database.unreachable":
                raise
            if pause is None:
                raise OSError(str(exc)) from exc
            time.sleep(pause)
    raise AssertionError
