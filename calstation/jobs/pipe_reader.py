"""What another process says, read in a thread of its own: half a message never makes a listener wait."""

import pickle
import threading
from multiprocessing.connection import Connection
from queue import Full, Queue
from typing import Any

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
