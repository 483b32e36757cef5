"""The application log: what the program did, for support; never sample data.

Every process writes a file of its own, named after kind, start and process; the oldest are deleted. Child processes
find folder and level in their environment.
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

#: Names of the environment variables that hand folder and level to child processes.
FOLDER, LEVEL = "CALSTATION_LOG_FOLDER", "CALSTATION_LOG_LEVEL"


class Level(StrEnum):
    """Detail of the log."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


#: Size at which a process begins a second file, and files kept of each kind.
_MAX_BYTES, _KEPT = 2_000_000, 30

_FORMAT = "%(asctime)s.%(msecs)03dZ %(levelname)-7s [%(run)s] %(name)s: %(message)s"

_run: ContextVar[str] = ContextVar("run", default="-")


def _add_run(record: logging.LogRecord) -> bool:
    record.run = _run.get()
    return True


def configure(process: str, folder: Path | None = None, level: Level | None = None) -> None:
    """Begin to log in a process of a kind, such as ``engine``.

    The environment's folder has precedence; nothing is written without a folder, or if the environment names an empty
    one. Without a level, the environment's or ``info`` applies.
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


@contextmanager
def run(name: str) -> Iterator[None]:
    """Put a run's id into every line while the context is open."""
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
    except OSError:  # a log that cannot be written must stop nothing
        return logging.NullHandler()
    formatter = logging.Formatter(_FORMAT, "%Y-%m-%dT%H:%M:%S")
    formatter.converter = time.gmtime
    handler.setFormatter(formatter)
    handler.addFilter(_add_run)
    return handler


def _prune(folder: Path, process: str) -> None:
    """Delete the oldest files of a kind."""
    files = sorted(folder.glob(f"{process}_*.log*"), reverse=True)
    for file in files[_KEPT:]:
        with suppress(OSError):  # still open in another process
            file.unlink()
