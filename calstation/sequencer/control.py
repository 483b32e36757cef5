"""States of a run, commands to it, and how they interrupt the running step."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from queue import SimpleQueue


class State(StrEnum):
    """State of a run."""

    IDLE = "idle"
    PREPARING = "preparing"
    RUNNING = "running"
    PAUSING = "pausing"
    PAUSED = "paused"
    STOPPING = "stopping"
    STOPPED = "stopped"
    FAULT = "fault"
    PASSED = "passed"
    FAILED = "failed"
    DONE = "done"


#: States in which a run is over. A fault is latched: only a reset to idle leaves it. A register operation neither
#: passes nor fails: it ends in `DONE`.
ENDED = frozenset({State.STOPPED, State.FAULT, State.PASSED, State.FAILED, State.DONE})

#: From each state, the states that may follow.
TRANSITIONS: dict[State, frozenset[State]] = {
    State.IDLE: frozenset({State.PREPARING}),
    State.PREPARING: frozenset({State.RUNNING, State.STOPPING, State.FAULT}),
    State.RUNNING: frozenset({State.PAUSING, State.STOPPING, State.FAULT, State.PASSED, State.FAILED, State.DONE}),
    State.PAUSING: frozenset({State.PAUSED, State.STOPPING, State.FAULT}),
    State.PAUSED: frozenset({State.RUNNING, State.STOPPING, State.FAULT}),
    State.STOPPING: frozenset({State.STOPPED, State.FAULT}),
    **dict.fromkeys(ENDED, frozenset({State.IDLE})),
}


class IllegalTransitionError(RuntimeError):
    """A transition that the table does not allow: a mistake of the program, not of its user."""


def transition(current: State, target: State) -> State:
    """`target`, if the table allows it from `current`. Raises IllegalTransitionError otherwise."""
    if target not in TRANSITIONS[current]:
        raise IllegalTransitionError(f"{current} -> {target} is not allowed")
    return target


class Command(StrEnum):
    """What a listener may ask of a run."""

    PAUSE = "pause"
    RESUME = "resume"
    STOP = "stop"
    ENOUGH = "enough"


class StopReason(StrEnum):
    """Who or what asked for a stop."""

    OPERATOR = "operator"
    SIGNAL = "signal"
    LISTENER_LOST = "listener_lost"
    LISTENER_SILENT = "listener_silent"


class Interruption(Exception):  # noqa: N818 - control flow, not an error
    """A step ends before its end."""


class StopRequested(Interruption):
    """Stop the run safely."""


class PauseRequested(Interruption):
    """Hold the table and repeat the step afterwards."""


class StepInvalid(Interruption):
    """Samples of the step are lost or unusable; it is to be repeated. `reason` : a term of the family ``reason``."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class Control:
    """Commands from any thread, taken by the engine's thread once per tick."""

    def __init__(self) -> None:
        self._queue: SimpleQueue[tuple[Command, StopReason]] = SimpleQueue()
        self._taken: float | None = None
        self.stopping = False
        self.stop_reason: StopReason | None = None
        self.pausing = False
        self.enough = False

    def send(self, command: Command, reason: StopReason = StopReason.OPERATOR) -> None:
        """Ask for something; callable from any thread."""
        self._queue.put((command, reason))

    def take(self) -> None:
        """Note all commands that came since the last call."""
        if self._taken is not None:
            self._taken = time.monotonic()
        while not self._queue.empty():
            command, reason = self._queue.get_nowait()
            if command is Command.STOP:
                self.stop_reason = self.stop_reason or reason
                self.stopping = True
            elif command is Command.PAUSE:
                self.pausing = True
            elif command is Command.RESUME:
                self.pausing = False
            else:
                self.enough = True

    def check_cancelled(self) -> None:
        """Take the commands where no tick does. Raises StopRequested."""
        self.take()
        if self.stopping:
            raise StopRequested

    @contextmanager
    def ticking(self) -> Iterator[None]:
        """Watch, while the context is open, that the engine's thread takes commands at every tick."""
        self._taken = time.monotonic()
        try:
            yield
        finally:
            self._taken = None

    def stuck(self, limit: float) -> bool:
        """Whether no command was taken for `limit` s of host time within `ticking`; callable from any thread."""
        taken = self._taken
        return taken is not None and time.monotonic() - taken > limit
