"""States and commands of a run, and the exceptions with which commands interrupt the current step."""

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
    DONE = "done"


#: States in which a run or a register operation has ended; a fault is latched until it is reset to idle.
ENDED = frozenset({State.STOPPED, State.FAULT, State.DONE})

#: The states that may follow each state.
TRANSITIONS: dict[State, frozenset[State]] = {
    State.IDLE: frozenset({State.PREPARING}),
    State.PREPARING: frozenset({State.RUNNING, State.STOPPING, State.FAULT}),
    State.RUNNING: frozenset({State.PAUSING, State.STOPPING, State.FAULT, State.DONE}),
    State.PAUSING: frozenset({State.PAUSED, State.STOPPING, State.FAULT}),
    State.PAUSED: frozenset({State.RUNNING, State.STOPPING, State.FAULT}),
    State.STOPPING: frozenset({State.STOPPED, State.FAULT}),
    **dict.fromkeys(ENDED, frozenset({State.IDLE})),
}


class IllegalTransitionError(RuntimeError):
    """Raised for a transition that `TRANSITIONS` does not allow, which is a programming error."""


def transition(current: State, target: State) -> State:
    """Return `target` if `TRANSITIONS` allows it from `current`. Raises IllegalTransitionError otherwise."""
    if target not in TRANSITIONS[current]:
        raise IllegalTransitionError(f"{current} -> {target} is not allowed")
    return target


class Command(StrEnum):
    """A command from a listener to a run."""

    PAUSE = "pause"
    RESUME = "resume"
    STOP = "stop"
    END_STAGE = "end_stage"
    END_FAILING = "end_failing"  #: End the run of units that will fail, and judge them from their solved stages.


class StopReason(StrEnum):
    """The source of a stop request."""

    OPERATOR = "operator"
    SIGNAL = "signal"
    LISTENER_LOST = "listener_lost"
    LISTENER_SILENT = "listener_silent"


class Interruption(Exception):  # noqa: N818 - control flow, not an error
    """Base class of the exceptions that interrupt the current step."""


class StopRequested(Interruption):
    """Raised if a safe stop of the run was requested."""


class PauseRequested(Interruption):
    """Raised if a pause was requested, after which the step is repeated."""


class Control:
    """Receives commands from any thread, which the engine's thread processes once per tick."""

    def __init__(self) -> None:
        self._queue: SimpleQueue[tuple[Command, StopReason]] = SimpleQueue()
        self._last_processed: float | None = None
        self.stopping = False
        self.stop_reason: StopReason | None = None
        self.pausing = False
        #: Whether to end and solve the current stage after the current move if its plan is repeated.
        self.ending_stage = False
        #: Whether to end the run after the current step if every unit will fail.
        self.ending_failing = False

    def send(self, command: Command, reason: StopReason = StopReason.OPERATOR) -> None:
        """Send a command, from any thread."""
        self._queue.put((command, reason))

    def take(self) -> None:
        """Process all commands received since the last call."""
        if self._last_processed is not None:
            self._last_processed = time.monotonic()
        while not self._queue.empty():
            command, reason = self._queue.get_nowait()
            if command is Command.STOP:
                self.stop_reason = self.stop_reason or reason
                self.stopping = True
            elif command is Command.PAUSE:
                self.pausing = True
            elif command is Command.RESUME:
                self.pausing = False
            elif command is Command.END_FAILING:
                self.ending_failing = True
            else:
                self.ending_stage = True

    def check_cancelled(self) -> None:
        """Process all pending commands. Raises StopRequested."""
        self.take()
        if self.stopping:
            raise StopRequested

    @contextmanager
    def ticking(self) -> Iterator[None]:
        """Monitor, while the context is open, whether the engine's thread processes commands at every tick."""
        self._last_processed = time.monotonic()
        try:
            yield
        finally:
            self._last_processed = None

    def stuck(self, limit: float) -> bool:
        """Return, in any thread, whether `take` has not been called for `limit` s of host time in `ticking`."""
        processed = self._last_processed
        return processed is not None and time.monotonic() - processed > limit
