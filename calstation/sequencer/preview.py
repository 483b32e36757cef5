"""How long a plan takes: the same steps that the run executes, counted instead of driven."""

from collections.abc import Iterable

from calstation.physics.motion import Dwell, Finish, Move, RoundEnd, Step
from calstation.sequencer.stop_rule import StopRule

_STEPS_AT_MOST = 10_000


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


def plan_time(steps: Iterable[Step], rule: StopRule, start: tuple[float, float], settle: float) -> float:
    """Seconds that a plan takes from joint angles `start` (rad), `settle` s after each move.

    A repeated plan is followed until its rounds or duration are reached, or one round where only
    sigmas or the operator end it.
    """
    elapsed = 0.0
    for count, step in enumerate(steps):
        if isinstance(step, Move):
            elapsed += move_time(start, step) + settle
            start = (step.outer, step.inner)
        elif isinstance(step, Dwell):
            elapsed += step.duration
        elif isinstance(step, RoundEnd):
            open_ended = rule.rounds is None and rule.duration is None
            if open_ended or rule.reason(step.rounds, elapsed, None, False):
                break
        if isinstance(step, Finish) or count > _STEPS_AT_MOST:
            break
    return elapsed
