"""Functions of jobs: the worker process finds them by name."""

import os
import time
from pathlib import Path
from typing import Any

from calstation.errors import InputError
from calstation.jobs.queue import ProgressCallback


def add(tell: ProgressCallback, a: int, b: int = 0) -> int:
    """A sum, with progress on the way."""
    tell(0.5, 10.0, "adding")
    return a + b


def complain(tell: ProgressCallback) -> None:
    """An error that a person can understand."""
    raise InputError("entry.not_found", file="log.h5")


def blunder(tell: ProgressCallback) -> None:
    """A mistake of the program."""
    raise ZeroDivisionError("division\nby zero")


def unpicklable(tell: ProgressCallback) -> Any:
    """A result that cannot travel."""
    return lambda: None


def die(tell: ProgressCallback) -> None:
    """The process ends without a word."""
    os._exit(7)


def wait(tell: ProgressCallback, started: Path, go: Path) -> int:
    """Create the file `started`, then wait for the file `go`; returns the process's id."""
    started.write_text(str(os.getpid()), encoding="utf-8")
    while not go.exists():
        tell(0.25)
        time.sleep(0.01)
    return os.getpid()
