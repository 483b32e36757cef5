"""The states of a run and the only transitions allowed between them."""

from enum import StrEnum


class State(StrEnum):
    """Where a run stands."""

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


#: From each state, the states that may follow. A fault is latched: only a reset to idle leaves it. What is no
#: calibration has neither passed nor failed in the end: it is done.
TRANSITIONS: dict[State, frozenset[State]] = {
    State.IDLE: frozenset({State.PREPARING}),
    State.PREPARING: frozenset({State.RUNNING, State.STOPPING, State.FAULT}),
    State.RUNNING: frozenset(
        {State.PAUSING, State.STOPPING, State.FAULT, State.PASSED, State.FAILED, State.DONE}
    ),
    State.PAUSING: frozenset({State.PAUSED, State.STOPPING, State.FAULT}),
    State.PAUSED: frozenset({State.RUNNING, State.STOPPING, State.FAULT}),
    State.STOPPING: frozenset({State.STOPPED, State.FAULT}),
    State.STOPPED: frozenset({State.IDLE}),
    State.FAULT: frozenset({State.IDLE}),
    State.PASSED: frozenset({State.IDLE}),
    State.FAILED: frozenset({State.IDLE}),
    State.DONE: frozenset({State.IDLE}),
}

#: States in which a run is over.
ENDED = frozenset({State.STOPPED, State.FAULT, State.PASSED, State.FAILED, State.DONE})


class IllegalTransitionError(RuntimeError):
    """A transition that the table does not allow: a mistake of the program, not of its user."""


def step(current: State, target: State) -> State:
    """`target`, if the table allows it from `current`. Raises IllegalTransitionError otherwise."""
    if target not in TRANSITIONS[current]:
        raise IllegalTransitionError(f"{current} -> {target} is not allowed")
    return target
