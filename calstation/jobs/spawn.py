"""Starts a process of ours apart from the program that asked for it: its Ctrl-C and its main module stay its own."""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.process import BaseProcess


def spawn_process(process: BaseProcess) -> None:
    """Start a spawned `process`, whose target stands in a module of ours.

    It hears no Ctrl-C: its listener sends a stop instead. And it does not run the caller's main module again, which
    spawning would do to find a target there: a plain script that opens the window must not open it twice.
    """
    with _deaf_to_interrupts(), _without_main():
        process.start()


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """A child started inside inherits that Ctrl-C is not for it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _without_main() -> Iterator[None]:
    """Hide where the main module came from, which is all that spawning looks at."""
    main = sys.modules["__main__"]
    spec, file = main.__spec__, main.__dict__.pop("__file__", None)
    main.__spec__ = None
    try:
        yield
    finally:
        main.__spec__ = spec
        if file is not None:
            main.__file__ = file
