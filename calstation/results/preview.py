"""What a run would do and reach, before anything moves: joint angles, time, limits and the sigmas at every stage's end.

The plans are those of the run and so are the solvers: they get a perfect unit's samples of the planned motion
(`estimation.planned`) and answer with the covariance that the run will report.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from calstation.config.request import RunRequest
from calstation.config.resolved import ResolvedConfiguration, check_manual_rig, resolve_configuration
from calstation.errors import ConfigurationError, InputError, InsufficientDataError
from calstation.estimation.common.planned import PlannedSamples, profile
from calstation.jobs.queue import ProgressCallback
from calstation.messages.rendering import Text
from calstation.physics.arrays import FloatArray
from calstation.physics.motion import Carry, Finish, Move, RoundEnd, Step
from calstation.physics.parameters import INDEX, NAMES, PARAMETERS
from calstation.records.meta import context_from_meta
from calstation.results.solver_chain import StageChain, one_blas_thread
from calstation.sequencer.guard import JOINTS, check_limits
from calstation.sequencer.plan import StagePlan, move_time, named, planned, step_time
from procedures import method

#: Rounds after which a stage that only its targets end is given up.
MOST_ROUNDS = 20

#: Points of a drawn move: enough for its ramps to look as they are.
_CORNERS = 9

#: How a unit is taken to be mounted, in units of the profile's mount sigma. No fixture is perfect, and a perfect one
#: would tell scale factors and misalignments apart a little better than any run will.
_MOUNT = np.full(3, 0.3)

#: Largest fraction told: after the last motion its stage is still to be solved.
_FEEDING = 0.95


@dataclass(frozen=True)
class Violation:
    """A planned step that the table cannot do.

    Attributes
    ----------
    step, label : number of the stage's move, from 1, and what it does
    kind : rate, acceleration or travel; plan where no way was found at all
    joint : outer or inner, "" for both
    value, low, high : what is asked and what is allowed, rad, rad/s or rad/s²
    text : the refusal's own words
    more : further moves of the stage that break the same limit
    """

    stage: str
    step: int
    label: tuple[str | float, ...]
    kind: str
    text: Text
    joint: str = ""
    value: float = 0.0
    low: float = 0.0
    high: float = 0.0
    more: int = 0


@dataclass(frozen=True)
class StagePreview:
    """One stage as it would go.

    Attributes
    ----------
    begin, end : s since the first stage began
    reason : what ends it: plan, rounds, duration or targets; "" where MOST_ROUNDS are not enough
    rounds : complete rounds
    moves : of the table
    estimated : names
    sigma : of the 30 parameters at its end, SI, shape (30,); None where it was not computed
    error : why not, "" where it was
    observability : as a solution's
    """

    stage: str
    begin: float
    end: float
    reason: str
    rounds: int
    moves: int
    estimated: tuple[str, ...]
    sigma: FloatArray | None = None
    error: Text | None = None
    observability: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Preview:
    """A whole run.

    Attributes
    ----------
    stages : in order
    time, outer, inner : corners of the joints' course, s and rad, each shape (n,)
    violations : of the table's limits; with any the run would be refused, so no sigma is computed
    before : sigmas before the first stage, SI, shape (30,)
    limits : largest sigma allowed per parameter that is estimated, SI; those without limit are left out
    targets : sigma at which a repeated stage may stop, per parameter, SI
    travel : lowest and highest angle of each joint, rad, outer then inner
    """

    stages: tuple[StagePreview, ...]
    time: FloatArray
    outer: FloatArray
    inner: FloatArray
    violations: tuple[Violation, ...]
    before: FloatArray
    limits: Mapping[str, float]
    targets: Mapping[str, float]
    travel: tuple[tuple[float, float], tuple[float, float]]

    @property
    def duration(self) -> float:
        """Seconds of all stages."""
        return self.stages[-1].end if self.stages else 0.0


def compute_preview(tell: ProgressCallback, request: RunRequest) -> Preview:
    """Work for the workshop: foretell the run that `request` asks for; its serial number may be empty.

    Raises ConfigurationError with file, field and mend where it could not be run at all.
    """
    setup = resolve_configuration(request)
    check_manual_rig(setup)
    with one_blas_thread():
        return _Foretelling(tell, setup).run()


class _Foretelling:
    """Drives the plans of one setup with nothing but arithmetic."""

    def __init__(self, tell: ProgressCallback, setup: ResolvedConfiguration) -> None:
        self._tell = tell
        self._setup = setup
        meta = setup.log_meta()
        self._plans = setup.task().stages
        self._geometry = setup.table.geometry()
        self._context = context_from_meta(meta)
        self._chain = StageChain(meta)
        self._settle = setup.table.settle_s
        mount = _MOUNT * self._context.table.mount_sigma
        self._samples = PlannedSamples(self._context, self._chain.prior.mean, self._geometry, mount)
        self._course = [(0.0, 0.0, 0.0)]
        self._clock = 0.0
        self._joints = (0.0, 0.0)

    def run(self) -> Preview:
        before = self._chain.prior.sigma
        violations: list[Violation] = []
        expected = sum(self._check(plan, violations) for plan in self._plans)
        solve = not violations
        stages: list[StagePreview] = []
        for plan in self._plans:
            stage = self._drive(plan, solve, expected)
            solve = solve and stage.error is None
            stages.append(stage)
        course, limits = np.array(self._course), self._geometry.limits
        return Preview(
            stages=tuple(stages),
            time=course[:, 0],
            outer=course[:, 1],
            inner=course[:, 2],
            violations=tuple(violations),
            before=before,
            limits=self._limits(),
            targets=self._targets(),
            travel=((limits.low[0], limits.high[0]), (limits.low[1], limits.high[1])),
        )

    def _check(self, plan: StagePlan, violations: list[Violation]) -> float:
        """Every move of a plan against the table's limits; the plan's seconds, targets aside."""
        seconds, moves = 0.0, 0
        found: dict[tuple[str, str], Violation] = {}
        try:
            for step, duration in planned(plan.steps(), plan.rule, self._joints, self._settle):
                seconds += duration
                if not isinstance(step, Move):
                    continue
                moves += 1
                for new in self._broken(plan.name, moves, step):
                    key = (new.kind, new.joint)
                    seen = found.setdefault(key, new)
                    if seen is not new:
                        found[key] = replace(seen, more=seen.more + 1)
        except ConfigurationError as error:
            found["plan", ""] = Violation(plan.name, moves + 1, (), "plan", error.as_text)
        violations.extend(found.values())
        return seconds

    def _broken(self, stage: str, number: int, move: Move) -> Iterator[Violation]:
        """The limits that the run would refuse a move for."""
        try:
            check_limits(self._geometry.limits, move)
            return
        except ConfigurationError as error:
            text = error.as_text
        limits = self._geometry.limits
        for kind, value, bounds in (
            ("rate", move.rate, limits.rate),
            ("acceleration", move.acceleration, limits.acceleration),
        ):
            if value > min(bounds) * (1.0 + 1e-9):
                yield Violation(stage, number, move.label, kind, text, "", value, 0.0, min(bounds))
        for joint, (name, target) in enumerate(zip(JOINTS, (move.outer, move.inner), strict=True)):
            if not limits.within(joint, target):
                span = limits.low[joint], limits.high[joint]
                yield Violation(stage, number, move.label, "travel", text, name, target, *span)

    def _drive(self, plan: StagePlan, solve: bool, expected: float) -> StagePreview:
        """Follow a stage to its end; `expected` is what the whole run may take, s."""
        begin = self._clock
        moves, rounds, reason, by_hand = 0, 0, "plan", False
        if solve:
            self._chain.start(plan.name)
        try:
            for step in plan.steps():
                if isinstance(step, RoundEnd):
                    rounds = step.rounds
                    found = self._reason(plan, rounds, self._clock - begin, solve)
                    if found is not None:
                        reason = found
                        break
                elif isinstance(step, Finish):
                    break
                else:
                    by_hand = by_hand or isinstance(step, Carry)
                    moves += isinstance(step, Move)
                    self._step(step, plan.name if solve else "")
                    self._tell(_FEEDING * self._clock / expected if expected else 0.0, note=plan.name)
        except ConfigurationError:
            reason = ""  # the plan cannot go on; `_check` has said why
        estimated = method(plan.name).estimates(self._context)
        stage = StagePreview(plan.name, begin, self._clock, reason, rounds, moves, estimated)
        if not solve:
            return stage
        if by_hand:
            return replace(stage, error=Text("preview.manual_motion"))
        try:
            solution = self._chain.finish()
        except (InsufficientDataError, InputError) as error:
            return replace(stage, error=error.as_text)
        return replace(stage, sigma=solution.belief.sigma, observability=solution.observability)

    def _reason(self, plan: StagePlan, rounds: int, elapsed: float, solve: bool) -> str | None:
        """Why a repeated plan ends after this round; None to go on."""
        rule = plan.rule
        sigma = self._chain.sigma() if solve and rule.targets else None
        reason = rule.reason(rounds, elapsed, sigma, enough=False)
        if reason is not None:
            return reason
        endless = rule.rounds is None and rule.duration is None
        gives_up = rounds >= MOST_ROUNDS or not (solve and rule.targets)
        return "" if endless and gives_up else None

    def _step(self, step: Step, stage: str) -> None:
        """Let a step pass; its samples go to the solver of `stage`, if there is one."""
        seconds = step_time(step, self._joints, self._settle)
        if isinstance(step, Move):
            target = (step.outer, step.inner)
            t = np.linspace(0.0, move_time(self._joints, step), _CORNERS)
            course = [
                profile(t, a, b, step.rate, step.acceleration)
                for a, b in zip(self._joints, target, strict=True)
            ]
            self._course.extend(zip((self._clock + t).tolist(), *(c.tolist() for c in course), strict=True))
            self._joints = target
        elif isinstance(step, Carry):
            self._joints = (step.outer, step.inner)
            self._course.append((self._clock + step.travel_time, *self._joints))
        if stage:
            for block in self._samples.run(step, seconds, stage):
                self._chain.feed(block)
        self._clock += seconds
        if seconds > 0.0:
            self._course.append((self._clock, *self._joints))

    def _limits(self) -> dict[str, float]:
        last = {name: plan.name for plan in self._plans for name in self._estimates(plan)}
        found = {}
        for name, stage in last.items():
            limits = self._setup.product.limits
            limit = limits.get(name, limits.get(PARAMETERS[INDEX[name]].group))
            largest = limit.sigma_limit(stage) if limit is not None else None
            if largest is not None:
                found[name] = largest
        return found

    def _targets(self) -> dict[str, float]:
        """The smallest target of each parameter, a parameter's own name before its group's."""
        found: dict[str, float] = {}
        for plan in self._plans:
            for name, target in plan.rule.targets.items():
                for i in named(name):
                    found[NAMES[i]] = min(target, found.get(NAMES[i], np.inf))
        return found

    def _estimates(self, plan: StagePlan) -> tuple[str, ...]:
        return method(plan.name).estimates(self._context)
