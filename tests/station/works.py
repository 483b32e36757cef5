"""Works for the workshop's tests: a worker process finds them by name."""

import os
import time
from pathlib import Path
from typing import Any

from calstation.errors import InputError
from calstation.jobs.worker import Tell


def add(tell: Tell, a: int, b: int = 0) -> int:
    """A sum, with progress on the way."""
    tell(0.5, 10.0, "adding")
    return a + b


def complain(tell: Tell) -> None:
    """An error that a person can understand."""
    raise InputError("log.h5: no such file; give the path of an existing log")


def blunder(tell: Tell) -> None:
    """A mistake of the program."""
    raise ZeroDivisionError("division\nby zero")


def unpicklable(tell: Tell) -> Any:
    """A result that cannot travel."""
    return lambda: None


def die(tell: Tell) -> None:
    """The process ends without a word."""
    os._exit(7)


def wait(tell: Tell, started: Path, go: Path) -> int:
    """Say that it began, then work until told to end; returns the process's id."""
    started.write_text(str(os.getpid()), encoding="utf-8")
    while not go.exists():
        tell(0.25)
        time.sleep(0.01)
    return os.getpid()
