"""Starts a process of ours apart from the program that asked for it: its Ctrl-C and its main module stay its own."""

import pickle
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from queue import Full, Queue
from typing import Any


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


#: Host time after which the reader sees that it is to end, s.
_LOOK_EVERY = 0.1

#: Messages kept for a listener that does not take them; then the pipe fills up and its writer notices.
_WAITING_AT_MOST = 1000


class PipeReader:
    """Whole messages from one end of a pipe, whose other direction stays its owner's.

    A message larger than the pipe's buffer comes in pieces, and a process that freezes between two of them would
    hold whoever reads it: here a thread that nobody waits for.

    Parameters
    ----------
    connection : closed with the mailbox, and by it alone
    """

    def __init__(self, connection: "Connection[Any, Any]") -> None:
        self._connection = connection
        self._letters: Queue[bytes | None] = Queue(_WAITING_AT_MOST)
        self._lock = threading.Lock()
        self._closing = self._left = self._at_end = False
        threading.Thread(target=self._read, name="mailbox", daemon=True).start()

    def take(self, wait: float = 0.0) -> Any:
        """The next message, waiting at most `wait` s for it.

        Raises queue.Empty where none is whole yet, EOFError where the other end has gone and nothing is left, and
        whatever unpacking a message raises.
        """
        if self._at_end:
            raise EOFError
        letter = self._letters.get(wait > 0.0, wait)
        if letter is None:
            self._at_end = True
            raise EOFError
        return pickle.loads(letter)

    def close(self) -> None:
        """Hang up; never waits. The reader closes the pipe: nobody may close what a thread still reads."""
        with self._lock:
            self._closing = True
            if self._left:
                self._connection.close()

    def _read(self) -> None:
        try:
            while not self._closing:
                if self._connection.poll(_LOOK_EVERY):
                    self._put(self._connection.recv_bytes())
        except (EOFError, OSError):
            self._put(None)
        finally:
            with self._lock:
                self._left = True
                if self._closing:
                    self._connection.close()

    def _put(self, letter: bytes | None) -> None:
        while not self._closing:
            try:
                self._letters.put(letter, timeout=_LOOK_EVERY)
            except Full:
                continue
            return
