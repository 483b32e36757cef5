"""Signals that would end a process, and are treated as requests for a safe stop instead."""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_NAMES = (
    *("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGBREAK", "SIGUSR1", "SIGUSR2", "SIGALRM", "SIGVTALRM"),
    *("SIGPROF", "SIGXCPU", "SIGIO", "SIGPWR", "SIGSTKFLT"),
)
#: All signals that end a process and can be caught, except those of faults of the program.
STOP_SIGNALS: tuple[signal.Signals, ...] = tuple(getattr(signal, name) for name in _NAMES if hasattr(signal, name))


@contextmanager
def on_stop_signals(action: Callable[[], object]) -> Iterator[None]:
    """Call `action` instead of ending the process each time a stop signal arrives, while the context is open.

    After the terminal has closed, output to it is discarded, so that the process can complete its work.
    """

    def handle(number: int, frame: object) -> None:
        if sys.platform != "win32" and number == signal.SIGHUP:
            _discard_terminal_output()
        action()

    previous = {number: signal.signal(number, handle) for number in STOP_SIGNALS}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def _discard_terminal_output() -> None:
    for stream in (1, 2):
        with suppress(OSError):
            if os.isatty(stream):
                with Path(os.devnull).open("wb") as nothing:
                    os.dup2(nothing.fileno(), stream)
