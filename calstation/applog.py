"""Application log of the actions of the program, for support; it never contains sample data.

Each process writes its own file, named after its kind, start time and process id; the oldest files are deleted. Child
processes read folder and level from their environment.
"""

import logging
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from enum import StrEnum
from logging.handlers import RotatingFileHandler
from pathlib import Path

#: Names of the environment variables that pass folder and level to child processes.
FOLDER, LEVEL = "CALSTATION_LOG_FOLDER", "CALSTATION_LOG_LEVEL"


class Level(StrEnum):
    """Detail of the log."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


#: File size at which a process starts a second file, bytes, and number of files kept of each kind.
_MAX_BYTES, _KEPT = 2_000_000, 30

_FORMAT = "%(asctime)s.%(msecs)03dZ %(levelname)-7s [%(run)s] %(name)s: %(message)s"

_run: ContextVar[str] = ContextVar("run", default="-")


def _add_run(record: logging.LogRecord) -> bool:
    record.run = _run.get()
    return True


def configure(process: str, folder: Path | None = None, level: Level | None = None) -> None:
    """Start logging in a process of the given kind, such as ``engine``.

    A folder set in the environment takes precedence; nothing is written if no folder is given, or if the environment
    variable is empty. Without `level`, the environment's level applies, or else ``info``.
    """
    if folder is not None:
        os.environ.setdefault(FOLDER, str(folder))
    if level is not None:
        os.environ[LEVEL] = level
    logger = logging.getLogger("calstation")
    for handler in list(logger.handlers):
        logger.removeHandler(handler)
        handler.close()
    logger.propagate = False
    logger.addHandler(_handler(process, os.environ.get(FOLDER)))
    logger.setLevel(os.environ.get(LEVEL, "info").upper())


def folder() -> Path | None:
    """Return the folder of the log files, or None if nothing is written."""
    name = os.environ.get(FOLDER)
    return Path(name) if name else None


@contextmanager
def run(name: str) -> Iterator[None]:
    """Add a run's id to every line while the context is open."""
    token = _run.set(name)
    try:
        yield
    finally:
        _run.reset(token)


def _handler(process: str, folder: str | None) -> logging.Handler:
    if not folder:
        return logging.NullHandler()
    path = Path(folder) / f"{process}_{time.strftime('%Y%m%dT%H%M%S', time.gmtime())}_{os.getpid()}.log"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _prune(path.parent, process)
        handler = RotatingFileHandler(path, maxBytes=_MAX_BYTES, backupCount=1, encoding="utf-8", delay=True)
    except OSError:  # a log that cannot be written must not stop the program
        return logging.NullHandler()
    formatter = logging.Formatter(_FORMAT, "%Y-%m-%dT%H:%M:%S")
    formatter.converter = time.gmtime
    handler.setFormatter(formatter)
    handler.addFilter(_add_run)
    return handler


def _prune(folder: Path, process: str) -> None:
    """Delete the oldest log files of a kind."""
    files = sorted(folder.glob(f"{process}_*.log*"), reverse=True)
    for file in files[_KEPT:]:
        with suppress(OSError):  # still open in another process
            file.unlink()
