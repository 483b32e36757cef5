"""The engine's end of the pipe to its listener, over which it sends events and receives commands."""

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from queue import Empty, Full, Queue
from typing import Any

from calstation.sequencer import LOSSY, Command, Event, to_json

#: Heartbeat message, to which the listener replies with the same message.
HEARTBEAT = "beat"

#: Host time between two heartbeats, s.
HEARTBEAT_INTERVAL = 0.25

#: Host time without a reply to a heartbeat after which the listener is considered frozen, s.
LISTENER_TIMEOUT = 10.0

_MAX_QUEUED = 10_000
_FLUSH_TIMEOUT = 5.0


class Channel:
    """Sends events without blocking the engine, and passes received commands to `on_command`.

    Heartbeats are sent as long as `alive()` returns True, which means that the engine's thread is not stuck. If the
    listener disconnects, dies or sends invalid data, `on_lost` is called once. If the listener does not reply to
    heartbeats for `silent_after` s, it is considered frozen: `on_silent` is called, and the channel stays open,
    because the listener may recover.
    """

    def __init__(
        self,
        connection: "Connection[Any, Any]",
        on_command: Callable[[Command], None],
        on_lost: Callable[[], None],
        on_silent: Callable[[], None],
        alive: Callable[[], bool],
        silent_after: float = LISTENER_TIMEOUT,
    ) -> None:
        self._connection = connection
        self._on_command, self._on_lost, self._on_silent = on_command, on_lost, on_silent
        self._alive, self._silent_after = alive, silent_after
        self._queue: Queue[dict[str, Any] | None] = Queue(_MAX_QUEUED)
        self._unanswered_since: float | None = None
        self._blocked_since: float | None = None  #: Time since which the pipe accepts no message; None if it does.
        self._lost, self._reporting = threading.Event(), threading.Lock()
        self._closing = False
        self._sender = threading.Thread(target=self._send, name="events", daemon=True)
        self._receiver = threading.Thread(target=self._receive, name="commands", daemon=True)
        self._sender.start()
        self._receiver.start()

    def emit(self, event: Event) -> None:
        """Send an event; if the listener is slow, events that only refresh a display are dropped."""
        if self._lost.is_set() or (isinstance(event, LOSSY) and self._queue.qsize() > 100):
            return
        try:
            self._queue.put_nowait(to_json(event))
        except Full:
            self._report_loss()

    def close(self) -> None:
        """Send all queued events, then close the connection; a listener that does not read them has 5 s."""
        self._closing = True
        if not self._lost.is_set():
            end = time.monotonic() + _FLUSH_TIMEOUT
            with suppress(Full):
                self._queue.put(None, timeout=_FLUSH_TIMEOUT)
            self._sender.join(max(0.0, end - time.monotonic()))
        self._connection.close()

    def _send(self) -> None:
        try:
            due = time.monotonic()
            while not self._lost.is_set():
                now = time.monotonic()
                if now >= due:
                    due = now + HEARTBEAT_INTERVAL
                    if self._alive():
                        if self._unanswered_since is None:
                            self._unanswered_since = now  # before the reply can arrive
                        self._transmit(HEARTBEAT)
                try:
                    message = self._queue.get(timeout=due - now)
                except Empty:
                    continue
                if message is None:
                    return
                self._transmit(message)
        except Exception:  # noqa: BLE001 - after any error, the listener is lost
            self._report_loss()

    def _transmit(self, message: Any) -> None:
        self._blocked_since = time.monotonic()
        self._connection.send(message)
        self._blocked_since = None

    def _receive(self) -> None:
        while True:
            try:
                if not self._connection.poll(HEARTBEAT_INTERVAL):
                    # Checked only if there is nothing to read: after a delay, the reply may already be in the pipe.
                    times = [t for t in (self._unanswered_since, self._blocked_since) if t is not None]
                    if times and time.monotonic() - min(times) > self._silent_after:
                        self._unanswered_since = self._blocked_since = None
                        self._on_silent()
                    continue
                text = self._connection.recv()
                if text != HEARTBEAT:
                    self._on_command(Command(text))
            except Exception:  # noqa: BLE001 - end of the pipe, or invalid data
                self._report_loss()
                return
            self._unanswered_since = None

    def _report_loss(self) -> None:
        with self._reporting:  # both threads notice the end of the listener
            if self._lost.is_set() or self._closing:
                return
            self._lost.set()
        self._on_lost()
