"""Preview of a run by covariance analysis: joint angles, duration, violated limits, and sigmas after every stage.

It runs the plans and solvers of the run with simulated samples of an ideal unit during the planned motion.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from calstation.config import RunConfiguration, RunRequest, check_manual_rig, load_configuration
from calstation.errors import ConfigurationError, InputError, InsufficientDataError
from calstation.estimation.common import PlannedSamples, profile
from calstation.jobs import ProgressCallback
from calstation.judgement import is_partial, undetermined, unobservable
from calstation.messages import Text
from calstation.physics import (
    JOINTS,
    NAMES,
    FloatArray,
    GimbalTurn,
    GimbalZero,
    ManualMove,
    Move,
    RoundEnd,
    Soak,
    Step,
    move_time,
    parameter_indices,
)
from calstation.records import LogMeta, context_from_meta
from calstation.results.calibration import current_calibration
from calstation.results.history import History
from calstation.results.solver_chain import StageChain, one_blas_thread
from calstation.sequencer import StagePlan, check_limits, planned, step_time, table_task
from procedures import method

#: Maximum number of rounds of a stage that ends only when its targets are reached.
MAX_ROUNDS = 20

#: Number of points per drawn move, enough to show its acceleration.
_POINTS_PER_MOVE = 9

#: Assumed mounting error in units of the profile's mount sigma. With a perfect fixture, scale factors and misalignments
#: would be slightly more observable than with a real fixture.
_MOUNT = np.full(3, 0.3)

#: Reason why no sigma of a stage with such a step can be predicted.
_UNPREDICTABLE: Mapping[type[Step], Text] = {
    ManualMove: Text("preview.manual_motion"),
    GimbalZero: Text("preview.gimbal_motion"),
    GimbalTurn: Text("preview.gimbal_motion"),
    Soak: Text("preview.over_temperature"),
}

#: Maximum progress reported before the last stage is solved.
_MAX_FEED_PROGRESS = 0.95


@dataclass(frozen=True)
class Violation:
    """A planned move that exceeds a limit of the table."""

    stage: str
    step: int  #: Number of the move in the stage, from 1.
    label: tuple[str | float, ...]  #: Label of the move.
    kind: str  #: ``rate``, ``acceleration`` or ``travel``; ``plan`` if no motion could be planned.
    text: Text  #: Error that the run would raise.
    joint: str = ""  #: ``outer`` or ``inner``; empty for both.
    value: float = 0.0  #: Value required by the move, rad, rad/s or rad/s².
    low: float = 0.0  #: Lowest allowed value.
    high: float = 0.0  #: Highest allowed value.
    more: int = 0  #: Number of other moves of the stage with the same violation.


@dataclass(frozen=True)
class StagePreview:
    """Preview of a stage."""

    stage: str
    begin: float  #: Start time, since the start of the first stage, s.
    end: float  #: End time, since the start of the first stage, s.
    #: Reason why the stage ends: plan, rounds, duration, targets or operator; "" after `MAX_ROUNDS`.
    reason: str
    rounds: int  #: Complete rounds.
    moves: int  #: Number of moves of the table, by hand or of the gimbal.
    estimated: tuple[str, ...]  #: Names of the estimated parameters.
    sigma: FloatArray | None = None  #: Sigmas of the parameters at its end, SI, shape (30,); None if not computed.
    error: Text | None = None  #: Reason why `sigma` was not computed.
    predictable: bool = True  #: Whether `sigma` can be predicted; if not, the run can nevertheless be solved.
    observability: Mapping[str, Any] = field(default_factory=dict)
    missed: tuple[str, ...] = ()  #: Parameters whose sigma at its end exceeds the target.


@dataclass(frozen=True)
class Preview:
    """Preview of a run."""

    stages: tuple[StagePreview, ...]
    time: FloatArray  #: Time of each vertex of the trajectory, s, shape (n,).
    outer: FloatArray  #: Angle of the outer joint at each vertex, rad, shape (n,).
    inner: FloatArray  #: Angle of the inner joint at each vertex, rad, shape (n,).
    violations: tuple[Violation, ...]  #: Violations of the table's limits; if any, no sigma is computed.
    before: FloatArray  #: Sigmas before the first stage, SI, shape (30,).
    limits: Mapping[str, float]  #: Largest allowed sigma of estimated parameters, SI.
    targets: Mapping[str, float]  #: Sigma at which a repeated stage may stop, per parameter, SI.
    #: Lowest and highest angle of each joint, rad, outer then inner.
    travel: tuple[tuple[float, float], tuple[float, float]]
    #: Labels of the moves, by the number of the step in `observability`.
    step_labels: Mapping[int, tuple[str | float, ...]] = field(default_factory=dict)
    #: Parameters that the data of the run do not determine, so that the run fails.
    undetermined: tuple[str, ...] = ()
    #: Parameters known from the current calibration that the run does not improve and therefore does not judge.
    not_improved: tuple[str, ...] = ()
    partial: bool = False  #: Whether the run omits stages of the product.
    calibrated: bool = False  #: Whether the run starts from the current calibration of the unit.

    @property
    def duration(self) -> float:
        """Total duration of all stages, s."""
        return self.stages[-1].end if self.stages else 0.0


def compute_preview(report: ProgressCallback, request: RunRequest) -> Preview:
    """Job: compute the preview of a run; its serial number need not match the product. Raises ConfigurationError."""
    setup = load_configuration(request)
    check_manual_rig(setup)
    with one_blas_thread():
        return _Previewer(report, setup).run()


def _expected_meta(setup: RunConfiguration) -> LogMeta:
    """Return the log configuration of a run if the registers contain the unit's latest calibration."""
    meta, folder = setup.log_meta(), setup.request.out
    if not is_partial(meta) or not folder.is_dir():
        return meta
    history = History.at(folder, setup.station)
    history.refresh()
    calibration, _ = current_calibration(history, setup, None)
    return meta if calibration is None else calibration.prior(setup, meta)


class _Previewer:
    """Executes the plans of a configuration without devices."""

    def __init__(self, report: ProgressCallback, setup: RunConfiguration) -> None:
        self._report = report
        self._setup = setup
        meta = self._meta = _expected_meta(setup)
        self._plans = table_task(setup).stages
        self._geometry = setup.table.geometry()
        self._context = context_from_meta(meta)
        self._chain = StageChain(meta)
        self._settle = setup.table.settle_s
        mount = _MOUNT * self._context.table.mount_sigma
        self._samples = PlannedSamples(self._context, self._chain.prior.mean, mount)
        self._trajectory = [(0.0, 0.0, 0.0)]
        self._clock = 0.0
        self._joints = (0.0, 0.0)
        self._labels: dict[int, tuple[str | float, ...]] = {}

    def run(self) -> Preview:
        violations: list[Violation] = []
        expected = sum(self._check(plan, violations) for plan in self._plans)
        solve = not violations
        stages: list[StagePreview] = []
        for plan in self._plans:
            stage = self._drive(plan, solve, expected)
            solve = solve and stage.error is None
            stages.append(stage)
        trajectory, limits = np.array(self._trajectory), self._geometry.limits
        chain, calibrated = self._chain, self._meta.calibrated
        unknown = undetermined(chain.prior, chain.solutions, calibrated) if solve else []
        not_observed = unobservable(chain.prior, chain.solutions) if solve else []
        return Preview(
            stages=tuple(stages),
            time=trajectory[:, 0],
            outer=trajectory[:, 1],
            inner=trajectory[:, 2],
            violations=tuple(violations),
            before=self._chain.prior.sigma,
            limits=self._setup.sigma_limits(),
            targets=self._targets(),
            travel=((limits.low[0], limits.high[0]), (limits.low[1], limits.high[1])),
            step_labels=self._labels,
            undetermined=tuple(unknown),
            not_improved=tuple(name for name in not_observed if name not in unknown),
            partial=is_partial(self._meta),
            calibrated=bool(calibrated),
        )

    def _check(self, plan: StagePlan, violations: list[Violation]) -> float:
        """Check every move of a plan against the table's limits; return the plan's duration, s, ignoring targets."""
        seconds, moves = 0.0, 0
        first_violations: dict[tuple[str, str], Violation] = {}
        try:
            for step, duration in planned(plan.steps(), plan.rule, self._joints, self._settle):
                seconds += duration
                if not isinstance(step, Move):
                    continue
                moves += 1
                for violation in self._violations(plan.name, moves, step):
                    key = violation.kind, violation.joint
                    first = first_violations.get(key)
                    first_violations[key] = violation if first is None else replace(first, more=first.more + 1)
        except ConfigurationError as error:
            first_violations["plan", ""] = Violation(plan.name, moves + 1, (), "plan", error.as_text)
        violations.extend(first_violations.values())
        return seconds

    def _violations(self, stage: str, number: int, move: Move) -> Iterator[Violation]:
        try:
            check_limits(self._geometry.limits, move)
            return
        except ConfigurationError as error:
            text = error.as_text
        limits = self._geometry.limits
        speeds = ("rate", move.rate, min(limits.rate)), ("acceleration", move.acceleration, min(limits.acceleration))
        for kind, value, limit in speeds:
            if value > limit * (1.0 + 1e-9):
                yield Violation(stage, number, move.label, kind, text, "", value, 0.0, limit)
        for joint, (name, target) in enumerate(zip(JOINTS, (move.outer, move.inner), strict=True)):
            if not limits.within(joint, target):
                span = limits.low[joint], limits.high[joint]
                yield Violation(stage, number, move.label, "travel", text, name, target, *span)

    def _drive(self, plan: StagePlan, solve: bool, expected: float) -> StagePreview:
        """Simulate a stage; `expected` is the approximate duration of the run, s."""
        begin = self._clock
        moves, rounds, reason = 0, 0, "plan"
        unpredictable: Text | None = None
        if solve:
            self._chain.start(plan.name)
        try:
            for step in plan.steps():
                if isinstance(step, RoundEnd):
                    rounds = step.rounds
                    ending = self._reason(plan, rounds, self._clock - begin, solve)
                    if ending is not None:
                        reason = ending
                        break
                else:
                    unpredictable = unpredictable or _UNPREDICTABLE.get(type(step))
                    moves += isinstance(step, Move | ManualMove | GimbalTurn)
                    self._step(step, plan.name if solve and not unpredictable else "")
                    self._report(_MAX_FEED_PROGRESS * self._clock / expected if expected else 0.0, note=plan.name)
        except ConfigurationError:
            reason = ""  # `_check` has already reported the reason
        estimated = method(plan.name).estimates(self._context)
        stage = StagePreview(plan.name, begin, self._clock, reason, rounds, moves, estimated)
        if not solve:
            return stage
        if unpredictable is not None:
            return replace(stage, error=unpredictable, predictable=False)
        try:
            solution = self._chain.finish()
        except (InsufficientDataError, InputError) as unusable:
            return replace(stage, error=unusable.as_text)
        sigma, targets = solution.posterior.sigma, {} if reason == "targets" else plan.rule.targets
        missed = {NAMES[i] for name, target in targets.items() for i in parameter_indices(name) if sigma[i] > target}
        in_order = tuple(name for name in NAMES if name in missed)
        return replace(stage, sigma=sigma, observability=solution.observability, missed=in_order)

    def _reason(self, plan: StagePlan, rounds: int, elapsed: float, solve: bool) -> str | None:
        """Return why a repeated plan ends after this round, or None if it continues."""
        rule = plan.rule
        measured = solve and bool(rule.targets)
        reason = rule.reason(rounds, elapsed, self._chain.sigma() if measured else None)
        if reason is None and rule.open_ended:
            if not rule.targets:
                return "operator"
            if rounds >= MAX_ROUNDS or not measured:
                return ""
        return reason

    def _step(self, step: Step, stage: str) -> None:
        seconds = step_time(step, self._joints, self._settle)
        if isinstance(step, Move):
            target = (step.outer, step.inner)
            t = np.linspace(0.0, move_time(self._joints, step), _POINTS_PER_MOVE)
            angles = [profile(t, a, b, step.rate, step.acceleration) for a, b in zip(self._joints, target, strict=True)]
            self._trajectory.extend(zip((self._clock + t).tolist(), *(c.tolist() for c in angles), strict=True))
            self._joints = target
        elif isinstance(step, ManualMove):
            self._joints = (step.outer, step.inner)
            self._trajectory.append((self._clock + step.travel_time, *self._joints))
        if stage:
            for block in self._samples.run(step, seconds, stage):
                self._chain.feed(block)
            if isinstance(step, Move) and step.label:
                self._labels[self._samples.step] = step.label
        self._clock += seconds
        if seconds > 0.0:
            self._trajectory.append((self._clock, *self._joints))

    def _targets(self) -> dict[str, float]:
        targets: dict[str, float] = {}
        for plan in self._plans:
            for name, target in plan.rule.targets.items():
                for i in parameter_indices(name):
                    targets[NAMES[i]] = min(target, targets.get(NAMES[i], np.inf))
        return targets
