"""Job functions, imported by name in the worker process."""

import os
import time
from pathlib import Path
from typing import Any

from calstation.errors import InputError
from calstation.jobs import ProgressCallback


def add(report: ProgressCallback, a: int, b: int = 0) -> int:
    """Return a sum and report progress."""
    report(0.5, 10.0, "adding")
    return a + b


def raise_known_error(report: ProgressCallback) -> None:
    """Raise an error of the catalogue."""
    raise InputError("entry.not_found", file="log.h5")


def raise_unexpected_error(report: ProgressCallback) -> None:
    """Raise an unexpected error."""
    raise ZeroDivisionError("division\nby zero")


def unpicklable(report: ProgressCallback) -> Any:
    """Return a result that cannot be pickled."""
    return lambda: None


def die(report: ProgressCallback) -> None:
    """Kill the process."""
    os._exit(7)


def wait(report: ProgressCallback, started: Path, go: Path) -> int:
    """Create the file `started`, then wait for the file `go`; return the process id."""
    started.write_text(str(os.getpid()), encoding="utf-8")
    while not go.exists():
        report(0.25)
        time.sleep(0.01)
    return os.getpid()
