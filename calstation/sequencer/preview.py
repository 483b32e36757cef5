"""How long a plan takes: the same steps that the run executes, counted instead of driven."""

from collections.abc import Iterable, Iterator
from itertools import islice

from calstation.physics.motion import Carry, Dwell, Finish, Move, RoundEnd, Step
from calstation.sequencer.stop_rule import StopRule

_STEPS_AT_MOST = 10_000

#: What a preview allows for settling after a move, s, where the table's profile does not say.
SETTLE = 1.5


def move_time(start: tuple[float, float], move: Move) -> float:
    """Seconds of a trapezoidal (or triangular) move from `start` (rad); the slower joint decides."""
    return max(
        _profile_time(abs(end - begin), move.rate, move.acceleration)
        for begin, end in zip(start, (move.outer, move.inner), strict=True)
    )


def _profile_time(distance: float, rate: float, acceleration: float) -> float:
    if distance * acceleration < rate * rate:
        return float(2.0 * (distance / acceleration) ** 0.5)
    return distance / rate + rate / acceleration


def planned(
    steps: Iterable[Step], rule: StopRule, start: tuple[float, float], settle: float = SETTLE
) -> Iterator[tuple[Step, float]]:
    """The steps that a run will execute from joint angles `start` (rad), each with its seconds.

    `settle` : from the end of a move's course until the table has settled, s

    A repeated plan is followed until its rounds or duration are reached, or one round where only
    sigmas or the operator end it.
    """
    elapsed = 0.0
    open_ended = rule.rounds is None and rule.duration is None
    for step in islice(steps, _STEPS_AT_MOST):
        seconds = step_time(step, start, settle)
        elapsed += seconds
        if isinstance(step, Move):
            start = (step.outer, step.inner)
        yield step, seconds
        if isinstance(step, RoundEnd) and (
            open_ended or rule.reason(step.rounds, elapsed, None, word=False) is not None
        ):
            return
        if isinstance(step, Finish):
            return


def step_time(step: Step, start: tuple[float, float], settle: float = SETTLE) -> float:
    """Seconds of a step from joint angles `start` (rad), `settle` s after a move included."""
    if isinstance(step, Move):
        return move_time(start, step) + settle
    if isinstance(step, Carry):
        return step.travel_time + step.rest
    return step.duration if isinstance(step, Dwell) else 0.0


def plan_time(
    steps: Iterable[Step], rule: StopRule, start: tuple[float, float], settle: float = SETTLE
) -> float:
    """Seconds of all steps that `planned` lists."""
    return sum(seconds for _, seconds in planned(steps, rule, start, settle))
