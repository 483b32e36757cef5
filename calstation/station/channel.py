"""The engine's end of the pipe to its listener: events out, commands in, a word when nobody listens."""

import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from queue import Empty, Full, Queue
from typing import Any

from calstation.sequencer.control import Command
from calstation.sequencer.events import LOSSY, Event, to_json

_WAITING_AT_MOST = 10_000
_LAST_WORDS_WITHIN = 5.0


class Channel:
    """Sends events without ever making the engine wait, and hands commands to `on_command`.

    A listener that hangs up, dies or talks nonsense is lost: `on_lost` is called once.
    """

    def __init__(
        self,
        connection: "Connection[Any, Any]",
        on_command: Callable[[Command], None],
        on_lost: Callable[[], None],
    ) -> None:
        self._connection = connection
        self._on_command = on_command
        self._on_lost = on_lost
        self._queue: Queue[dict[str, Any] | None] = Queue(_WAITING_AT_MOST)
        self._lost = threading.Event()
        self._closing = False
        self._sender = threading.Thread(target=self._send, name="events", daemon=True)
        self._receiver = threading.Thread(target=self._receive, name="commands", daemon=True)
        self._sender.start()
        self._receiver.start()

    def emit(self, event: Event) -> None:
        """Send an event; one that only refreshes a display is dropped where the listener is slow."""
        if self._lost.is_set() or (isinstance(event, LOSSY) and self._queue.qsize() > 100):
            return
        try:
            self._queue.put_nowait(to_json(event))
        except Full:
            self._lose()

    def close(self) -> None:
        """Send what is waiting, then hang up."""
        self._closing = True
        if not self._lost.is_set():
            self._queue.put(None)
            self._sender.join(_LAST_WORDS_WITHIN)
        self._connection.close()

    def _send(self) -> None:
        while not self._lost.is_set():
            try:
                message = self._queue.get(timeout=0.5)
            except Empty:
                continue
            if message is None:
                return
            try:
                self._connection.send(message)
            except Exception:  # noqa: BLE001 - whatever ends the sending, nobody hears the run any more
                self._lose()
                return

    def _receive(self) -> None:
        while True:
            try:
                command = Command(self._connection.recv())
            except Exception:  # noqa: BLE001 - end of the pipe, or words that no listener of ours would send
                self._lose()
                return
            self._on_command(command)

    def _lose(self) -> None:
        if not self._lost.is_set() and not self._closing:
            self._lost.set()
            self._on_lost()
