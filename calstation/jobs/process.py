"""Start child processes, and read their messages without blocking."""

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

#: Interval at which the reader checks whether it has been closed, host time, s.
_POLL_INTERVAL = 0.1

#: Largest number of unread messages; beyond it, the pipe fills up and its writer blocks.
_MAX_MESSAGES = 1000


def spawn_process(process: BaseProcess) -> None:
    """Start a spawned process whose target is in a module of this package.

    The process ignores Ctrl-C, because its owner sends a stop command instead. It does not import the caller's main
    module, as multiprocessing normally does: a plain script that opens the window must not open it twice.
    """
    with _ignoring_interrupts(), _without_main():
        process.start()


@contextmanager
def _ignoring_interrupts() -> Iterator[None]:
    """Ignore Ctrl-C inside the block, so that a child process started there also ignores it."""
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
    """Hide the spec and file of the main module, so that a spawned process does not import it."""
    main = sys.modules["__main__"]
    spec, file = main.__spec__, main.__dict__.pop("__file__", None)
    main.__spec__ = None
    try:
        yield
    finally:
        main.__spec__ = spec
        if file is not None:
            main.__file__ = file


class PipeReader:
    """Reads whole messages from a pipe in a thread, and closes the pipe; the owner may write to it.

    If a process freezes while sending a message larger than the pipe's buffer, only this thread blocks.
    """

    def __init__(self, connection: "Connection[Any, Any]") -> None:
        self._connection = connection
        self._messages: Queue[bytes | None] = Queue(_MAX_MESSAGES)
        self._lock = threading.Lock()
        self._closing = self._ended = self._at_end = False
        threading.Thread(target=self._read, name="pipe reader", daemon=True).start()

    def take(self, wait: float = 0.0) -> Any:
        """Return the next message, waiting at most `wait` s for it.

        Raises queue.Empty if no message is complete yet, EOFError if the other end is closed and no message is left,
        and any error of unpickling.
        """
        if self._at_end:
            raise EOFError
        message = self._messages.get(wait > 0.0, wait)
        if message is None:
            self._at_end = True
            raise EOFError
        return pickle.loads(message)

    def close(self) -> None:
        """Close the pipe without waiting; if the thread is still reading, the thread closes it."""
        with self._lock:
            self._closing = True
            if self._ended:
                self._connection.close()

    def _read(self) -> None:
        try:
            while not self._closing:
                if self._connection.poll(_POLL_INTERVAL):
                    self._put(self._connection.recv_bytes())
        except (EOFError, OSError):
            self._put(None)
        finally:
            with self._lock:
                self._ended = True
                if self._closing:
                    self._connection.close()

    def _put(self, message: bytes | None) -> None:
        while not self._closing:
            try:
                self._messages.put(message, timeout=_POLL_INTERVAL)
            except Full:
                continue
            return
