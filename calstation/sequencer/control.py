"""The operator's words on their way to the running step: commands, and how they interrupt it."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from queue import Empty, SimpleQueue


class Command(StrEnum):
    """What a listener may ask of a run."""

    PAUSE = "pause"
    RESUME = "resume"
    STOP = "stop"
    ENOUGH = "enough"


class Interruption(Exception):  # noqa: N818 - control flow, not an error
    """A step ends before its end."""


class StopRequested(Interruption):
    """Stop the run safely."""


class PauseRequested(Interruption):
    """Hold the table and repeat the step afterwards."""


@dataclass
class SpoiltStep(Interruption):
    """Samples of the step are lost or unusable because of `reason`; the step is to be repeated."""

    reason: str


class Control:
    """Commands from any thread, taken up by the engine's thread once per tick.

    Attributes
    ----------
    stopping, pausing, enough : what was asked for
    stop_reason : who or what wanted the stop: operator, signal, listener_lost, listener_silent
    """

    def __init__(self) -> None:
        self._queue: SimpleQueue[tuple[Command, str]] = SimpleQueue()
        self._taken: float | None = None
        self.stopping = False
        self.stop_reason = ""
        self.pausing = False
        self.enough = False

    def send(self, command: Command, reason: str = "operator") -> None:
        """Ask for something; callable from any thread."""
        self._queue.put((command, reason))

    def take(self) -> None:
        """Note all commands that came since the last call."""
        if self._taken is not None:
            self._taken = time.monotonic()
        while True:
            try:
                command, reason = self._queue.get_nowait()
            except Empty:
                return
            if command is Command.STOP:
                self.stop_reason = self.stop_reason or reason
                self.stopping = True
            elif command is Command.PAUSE:
                self.pausing = True
            elif command is Command.RESUME:
                self.pausing = False
            else:
                self.enough = True

    @contextmanager
    def ticking(self) -> Iterator[None]:
        """While this is open the engine's thread promises to take commands at every tick."""
        self._taken = time.monotonic()
        try:
            yield
        finally:
            self._taken = None

    def stuck(self, limit: float) -> bool:
        """Whether that promise has been broken for more than `limit` s of host time; callable from any thread."""
        taken = self._taken
        return taken is not None and time.monotonic() - taken > limit
