"""The operator's words on their way to the running step: commands, and how they interrupt it."""

from dataclasses import dataclass
from enum import StrEnum
from queue import Empty, SimpleQueue


class Command(StrEnum):
    """What a listener may ask of a run."""

    PAUSE = "pause"
    RESUME = "resume"
    STOP = "stop"
    ENOUGH = "enough"
    ANSWER = "answer"


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
    """Commands from any thread, taken up by the engine's thread once per tick."""

    def __init__(self) -> None:
        self._queue: SimpleQueue[Command] = SimpleQueue()
        self.stopping = False
        self.pausing = False
        self.enough = False
        self.answered = False

    def send(self, command: Command) -> None:
        """Ask for something; callable from any thread."""
        self._queue.put(command)

    def take(self) -> None:
        """Note all commands that came since the last call."""
        while True:
            try:
                command = self._queue.get_nowait()
            except Empty:
                return
            if command is Command.STOP:
                self.stopping = True
            elif command is Command.PAUSE:
                self.pausing = True
            elif command is Command.RESUME:
                self.pausing = False
            elif command is Command.ENOUGH:
                self.enough = True
            else:
                self.answered = True
