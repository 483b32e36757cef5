"""Child processes that exchange messages with their owner without ever blocking it."""

import multiprocessing
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from queue import Full, Queue
from typing import Any

from calstation.jobs.signals import STOP_SIGNALS

#: Interval at which the reader checks whether it has been closed, host time, s.
_POLL_INTERVAL = 0.1

#: Largest number of unread messages; beyond it, the pipe fills up and its writer blocks.
_MAX_MESSAGES = 1000

#: Time allowed for a killed process to exit, host time, s.
_KILL_TIMEOUT = 5.0


@contextmanager
def deferred_signals() -> Iterator[None]:
    """Defer stop signals to the end of the block; a process started there does not receive them.

    The process inherits the blocked signals, on Windows an ignored Ctrl-C; `receive_stop_signals` unblocks them.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    if sys.platform == "win32":
        with _deferred({signal.SIGINT}, lambda number: signal.SIG_IGN):
            yield
        return
    pending: list[int] = []
    with _deferred(STOP_SIGNALS, lambda number: lambda *_: pending.append(number)):
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
        resource_tracker.ensure_running()  # its start unblocks some of the signals
        signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
    for number in pending:
        signal.raise_signal(number)


@contextmanager
def _deferred(numbers: Iterable[signal.Signals], handler: Callable[[int], Any]) -> Iterator[None]:
    """Replace the handlers of signals in the block, except signals that are ignored or handled outside Python."""
    unchanged = (signal.SIG_IGN, None)
    before = {number: signal.getsignal(number) for number in numbers}
    replaced = {number: previous for number, previous in before.items() if previous not in unchanged}
    for number in replaced:
        signal.signal(number, handler(number))
    try:
        yield
    finally:
        for number, previous in replaced.items():
            signal.signal(number, previous)


def receive_stop_signals() -> None:
    """Unblock the stop signals in a process that was started with `deferred_signals`, except Ctrl-C."""
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, set(STOP_SIGNALS) - {signal.SIGINT})


@contextmanager
def _hide_main_module() -> Iterator[None]:
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
    """Reads complete messages from a pipe in a thread, and closes the pipe; the owner may write to the pipe.

    If a process freezes while sending a message larger than the pipe's buffer, only this thread blocks.
    """

    def __init__(self, connection: "Connection[Any, Any]") -> None:
        self.connection = connection
        self._messages: Queue[bytes | None] = Queue(_MAX_MESSAGES)
        self._lock = threading.Lock()
        self._closing = self._ended = self._at_end = False
        threading.Thread(target=self._read, name="pipe reader", daemon=True).start()

    def take(self, wait: float = 0.0) -> Any:
        """Return the next message, waiting at most `wait` s for it.

        Raises queue.Empty if no complete message has arrived, EOFError if the other end is closed and no message is
        left, and any error of unpickling.
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
                self.connection.close()

    def _read(self) -> None:
        try:
            while not self._closing:
                if self.connection.poll(_POLL_INTERVAL):
                    self._put(self.connection.recv_bytes())
        except (EOFError, OSError):
            self._put(None)
        finally:
            with self._lock:
                self._ended = True
                if self._closing:
                    self.connection.close()

    def _put(self, message: bytes | None) -> None:
        while not self._closing:
            try:
                self._messages.put(message, timeout=_POLL_INTERVAL)
            except Full:
                continue
            return


class ChildProcess(PipeReader):
    """A spawned process and the pipe to it; its messages are read with `take`, and only `end` waits.

    `target`, a function at the top level of a module, is called in the process with its end of the pipe and `args`. The
    process ignores Ctrl-C, because its owner sends a stop command instead, and receives no other stop signal before
    `target` calls `receive_stop_signals`. Unlike other spawned processes, it does not import the caller's main module,
    because a plain script that opens the window must not open it twice.
    """

    def __init__(self, name: str, target: Callable[..., None], *args: Any, daemon: bool = False) -> None:
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        self.process: BaseProcess = context.Process(
            target=target, args=(there, *args), name=f"calstation {name}", daemon=daemon
        )
        with deferred_signals(), _hide_main_module():
            self.process.start()
        there.close()
        super().__init__(here)

    def send(self, message: Any) -> None:
        """Send a message; ignored if the process has ended."""
        with suppress(OSError):
            self.connection.send(message)

    def end(self, within: float) -> None:
        """Close the pipe, and wait at most `within` s of host time for the end of the process; then kill it."""
        self.close()
        self.process.join(within)
        if self.process.is_alive():
            self.process.kill()
            self.process.join(_KILL_TIMEOUT)
