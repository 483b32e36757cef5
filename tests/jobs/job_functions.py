"""Job functions, imported by name in the worker process."""

import os
import time
from pathlib import Path
from typing import Any

from calstation.errors import InputError
from calstation.jobs import ProgressCallback


def add(tell: ProgressCallback, a: int, b: int = 0) -> int:
    """Return a sum and report progress."""
    tell(0.5, 10.0, "adding")
    return a + b


def complain(tell: ProgressCallback) -> None:
    """Raise an error of the catalogue."""
    raise InputError("entry.not_found", file="log.h5")


def blunder(tell: ProgressCallback) -> None:
    """Raise an unexpected error."""
    raise ZeroDivisionError("division\nby zero")


def unpicklable(tell: ProgressCallback) -> Any:
    """Return a result that cannot be pickled."""
    return lambda: None


def die(tell: ProgressCallback) -> None:
    """Kill the process."""
    os._exit(7)


def wait(tell: ProgressCallback, started: Path, go: Path) -> int:
    """Create the file `started`, then wait for the file `go`; return the process id."""
    started.write_text(str(os.getpid()), encoding="utf-8")
    while not go.exists():
        tell(0.25)
        time.sleep(0.01)
    return os.getpid()
