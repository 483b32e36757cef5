"""Stage plans, their durations, and the rules that end repeated plans."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np

from calstation.physics import (
    GROUPS,
    Dwell,
    FloatArray,
    GimbalTurn,
    GimbalZero,
    ManualMove,
    Move,
    RoundEnd,
    Soak,
    Step,
    group_indices,
    move_time,
    targets_reached,
)
from calstation.sequencer.events import StageProgress

_MAX_STEPS = 10_000

#: Tolerance of sums of durations, s.
_TIME_TOLERANCE = 1e-6

#: Default settling time after a move if the table's profile does not specify one, s.
SETTLE_TIME = 1.5

#: Time until a unit is usually steady at the next temperature, s; the progress of each soak corrects this estimate.
_USUAL_SOAK = 2400.0


@dataclass(frozen=True)
class StopRule:
    """Conditions that are checked at the end of each round of a repeated plan; any of them ends the plan.

    They are a number of rounds, an IMU time, s, and the largest sigma by parameter or group, SI; each can be None or
    empty. The operator can end a repeated plan after any move.
    """

    rounds: int | None = None
    duration: float | None = None
    targets: Mapping[str, float] = field(default_factory=dict)
    #: Typical number of rounds until the targets end a plan, used for the displayed duration; None if unknown.
    usual: int | None = None
    repeated: bool = False  #: Whether the plan repeats; otherwise it is executed to its end.

    @property
    def open_ended(self) -> bool:
        """Whether neither a number of rounds nor a duration limits the plan."""
        return self.rounds is None and self.duration is None

    def reason(self, rounds: int, elapsed: float, sigma: FloatArray | None) -> str | None:
        """Return why to stop at the end of a round: ``rounds``, ``duration`` or ``targets``, or None to continue.

        Parameters
        ----------
        rounds : number of completed rounds
        elapsed : IMU time since the start of the stage, s
        sigma : standard deviations of the parameters, shape (30,), SI; None if unknown
        """
        if self.rounds is not None and rounds >= self.rounds:
            return "rounds"
        if self.duration is not None and elapsed >= self.duration:
            return "duration"
        if self.targets and sigma is not None and targets_reached(sigma, self.targets):
            return "targets"
        return None


@dataclass(frozen=True)
class StagePlan:
    """A stage with its stop rule; `steps` returns a new iterator over its steps.

    In a run that is resumed, `completed` rounds precede these steps.
    """

    name: str
    steps: Callable[[], Iterator[Step]]
    rule: StopRule = field(default_factory=StopRule)
    completed: int = 0

    def after(self, rounds: int) -> "StagePlan":
        """Return the rest of the stage after a number of rounds."""

        def steps() -> Iterator[Step]:
            remaining = self.steps()
            if rounds:
                next(step for step in remaining if isinstance(step, RoundEnd) and step.rounds == rounds)
            yield from remaining

        return replace(self, steps=steps, completed=rounds)


class StageTracker:
    """Progress of a stage, or of a round of an open-ended stage, whose planned `duration` is in s.

    If the targets are not reached within this duration, the stage takes up to `longest` s.
    """

    def __init__(self, stage: str, duration: float, longest: float = 0.0) -> None:
        self._stage, self._duration, self._longest = stage, duration, longest
        self._done = self._step_begin = self._step = 0.0
        self._sigma: dict[str, dict[str, float]] = {}

    def begin(self, now: float, seconds: float) -> None:
        """Begin a step of duration `seconds` at station time `now`."""
        self._step_begin, self._step = now, seconds

    def end(self, sigma: Mapping[str, FloatArray]) -> None:
        """End the step; `sigma` contains the standard deviations reached in every slot, shape (30,), SI.

        Infinite standard deviations, which are unknown, are not shown.
        """
        self._done += self._step
        self._step = 0.0
        largest = {slot: {g: float(np.max(values[group_indices(g)])) for g in GROUPS} for slot, values in sigma.items()}
        self._sigma = {slot: {g: s for g, s in groups.items() if np.isfinite(s)} for slot, groups in largest.items()}

    def revise(self, now: float, remaining: float) -> None:
        """Set the remaining time of the current step, s, at station time `now`."""
        change = now - self._step_begin + remaining - self._step
        self._step += change
        self._duration += change
        self._longest += change

    def next_round(self) -> None:
        """Continue after a round; once the planned duration has passed, plan up to the longest duration."""
        if self._done > self._duration - _TIME_TOLERANCE:
            self._duration = max(self._duration, self._longest)

    def event(self, now: float, slot: str) -> StageProgress:
        """Return the progress of the stage at station time `now` for the unit in a slot."""
        done = self._done + min(max(now - self._step_begin, 0.0), self._step)
        fraction = min(done / self._duration, 1.0) if self._duration > 0.0 else 1.0
        return StageProgress(self._stage, fraction, max(self._duration - done, 0.0), self._sigma.get(slot, {}))


def step_time(step: Step, start: tuple[float, float], settle: float = SETTLE_TIME) -> float:
    """Return the duration of a step, s.

    Parameters
    ----------
    step : step of a plan
    start : joint angles before the step, rad
    settle : settling time after a move, s
    """
    if isinstance(step, Move):
        return move_time(start, step) + settle
    if isinstance(step, ManualMove):
        return step.travel_time + step.rest
    if isinstance(step, GimbalTurn):
        return 2.0 * step.rest + step.angle / step.rate + settle
    if isinstance(step, GimbalZero):
        return step.rest + settle
    if isinstance(step, Soak):
        return min(step.hold + _USUAL_SOAK, step.timeout)
    return step.duration if isinstance(step, Dwell) else 0.0


def planned(
    steps: Iterable[Step], rule: StopRule, start: tuple[float, float], settle: float = SETTLE_TIME
) -> Iterator[tuple[Step, float]]:
    """Yield the steps that a run will execute, and the duration of each step, s.

    A repeated plan ends after its rounds or its duration. If only the targets or the operator can end it, one round is
    yielded.

    Parameters
    ----------
    steps : steps of the plan
    rule : stop rule of the plan
    start : joint angles before the first step, rad
    settle : settling time after a move, s
    """
    elapsed = 0.0
    for step in islice(steps, _MAX_STEPS):
        seconds = step_time(step, start, settle)
        elapsed += seconds
        if isinstance(step, Move):
            start = (step.outer, step.inner)
        yield step, seconds
        if isinstance(step, RoundEnd) and (rule.open_ended or rule.reason(step.rounds, elapsed, None) is not None):
            return


def plan_time(steps: Iterable[Step], rule: StopRule, start: tuple[float, float], settle: float = SETTLE_TIME) -> float:
    """Return the duration of the steps from `planned`, s, up to the usual number of rounds of the rule."""
    return sum(seconds for _, seconds in _usual_steps(steps, rule, start, settle))


def stage_times(stages: Iterable[StagePlan], settle: float = SETTLE_TIME) -> list[float]:
    """Return the duration of each stage of a run, s; each stage starts at the final angles of the previous one.

    Parameters
    ----------
    stages : stages in the order of their execution; the first starts at angles of zero
    settle : settling time after a move, s
    """
    times, position = [], (0.0, 0.0)
    for stage in stages:
        total = 0.0
        for step, seconds in _usual_steps(stage.steps(), stage.rule, position, settle):
            total += seconds
            if isinstance(step, Move | ManualMove):
                position = (step.outer, step.inner)
        times.append(float(total))
    return times


def _usual_steps(
    steps: Iterable[Step], rule: StopRule, start: tuple[float, float], settle: float
) -> Iterator[tuple[Step, float]]:
    for step, seconds in planned(steps, rule, start, settle):
        yield step, seconds
        if isinstance(step, RoundEnd) and rule.usual is not None and step.rounds >= rule.usual:
            return
