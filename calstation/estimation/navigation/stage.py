"""Solver of stages with the 39-state filter: updates the sigmas during the stage and solves the stage at its end."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType

import numpy as np

from calstation.errors import InsufficientDataError
from calstation.estimation.common import (
    ImuModel,
    PlannedSamples,
    Posterior,
    SampleBlock,
    Site,
    SolveContext,
    StageData,
    TableModel,
    blocks_from,
    consider_update,
    nis_consistency,
    noise_tests,
    rest_noise,
    stage_data,
    start_tests,
    starts,
    with_measured_noise,
)
from calstation.estimation.effects import EffectTests, Sensitivity, known_effects
from calstation.estimation.method import Innovations, Progress, Ranking, Solution, StageSolver, with_diagnosis
from calstation.estimation.navigation.measured_noise import pass_with_actual_noise, solve_with_measured_noise
from calstation.estimation.navigation.navigation_pass import ClosedLoopFilter
from calstation.estimation.navigation.observability import ObservabilityAnalysis
from calstation.estimation.navigation.relinearise import NavigationResult, first_pass
from calstation.estimation.navigation.response import local_scores, result_sensitivity
from calstation.physics import COUNT, NAMES, PARAMETERS, BoolArray, Dwell, FloatArray, targets_reached

#: Shortest duration of data after a start from which the live filter aligns, s.
LIVE_ALIGNMENT = 5.0


class LiveFilter:
    """A filter pass over the sample stream, used for the convergence display and the stop rule."""

    def __init__(self, context: SolveContext, prior: Posterior) -> None:
        self._context, self._prior = context, prior
        self._filter = ClosedLoopFilter(context, prior, prior.mean)
        self.observability = ObservabilityAnalysis(context, prior, prior.mean)
        self._pending: list[SampleBlock] = []
        self._aligned = False

    def feed(self, block: SampleBlock) -> None:
        """Store a block until the next call of `sigma`."""
        self._pending.append(block)

    @property
    def mean(self) -> FloatArray:
        """Current estimates of the 30 parameters, SI, shape (30,)."""
        return self._filter.posterior.mean

    def sigma(self) -> FloatArray:
        """Process the stored blocks and return the standard deviations of the 30 parameters, SI, shape (30,)."""
        run = self._filter
        data = stage_data(self._pending, self._context.imu)
        consumed = 0
        for first, last in data.segments:
            if first > 0 or not self._aligned:
                segment_starts = starts(replace(data, segments=((first, last),)), self._context, self._prior)
                self._aligned = bool(segment_starts) and (last - segment_starts[0].begin) * data.dt >= LIVE_ALIGNMENT
                consumed = first
                if not self._aligned:
                    continue
                run.begin(data, segment_starts[0], segment_starts[0].attitude)
                consumed = segment_starts[0].begin
            while consumed + run.group_size * run.stride < last:
                run.observe(data, consumed, run.group_size)
                consumed += run.group_size * run.stride
        self.observability.add(data, run.take_history())
        if len(data):
            self._pending = blocks_from(self._pending, int(data.seq[consumed]))
        return run.posterior.sigma


class NavigationStage(StageSolver):
    """Solves a stage with the 39-state filter, in which the parameters outside `estimated` are consider states."""

    def __init__(
        self,
        stage: str,
        context: SolveContext,
        prior: Posterior,
        estimated: tuple[str, ...],
        targets: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        super().__init__(context, prior)
        self.stage, self.estimated, self._targets = stage, estimated, targets
        #: Number of samples, and the sigmas computed from them once the live sigmas met the targets.
        self._near_targets: tuple[int, FloatArray] | None = None
        self._live = LiveFilter(context, prior)

    def feed(self, block: SampleBlock) -> None:
        """Add samples of the stage."""
        super().feed(block)
        self._live.feed(block)

    def sigma(self) -> FloatArray:
        """Return the current standard deviations of the 30 parameters, SI, shape (30,).

        Once all sigmas of the live filter are within their targets, the sigmas are those of a solution with the effects
        in the unit's model, and with the noise measured at rest if it is larger than that of the profiles. They are
        then infinite while no solution is possible, for example before the first rest of a stage that meets its targets
        from the start.
        """
        sigma = self._live.sigma()
        if not self._targets or not targets_reached(sigma, self._targets):
            return sigma
        data = self.buffer.data()
        if not len(data):
            return np.full(COUNT, np.inf)
        if self._near_targets is None or self._near_targets[0] != len(data):
            measured = rest_noise(data, self.context, self.prior.gyro_bias)
            table = float(np.sqrt(np.nan_to_num(measured.table, nan=1.0)))
            noise = max(measured.worst()[0], table, 1.0)
            reached = targets_reached(noise * sigma, self._targets)
            self._near_targets = len(data), noise * (self._sigma_with_effects(data) if reached else sigma)
        return self._near_targets[1]

    def _sigma_with_effects(self, data: StageData) -> FloatArray:
        """Return the sigmas of a solution with the effects in the model, SI, shape (30,); infinite without one."""
        mask = np.array([name in self.estimated for name in NAMES])
        try:
            result = first_pass(data, self.context, self.prior, mask, self._live.mean)
        except (InsufficientDataError, np.linalg.LinAlgError, ZeroDivisionError):  # no rest yet, or absurd parameters
            return np.full(COUNT, np.inf)
        if not np.isfinite(result.history.nis).all():
            return np.full(COUNT, np.inf)
        posterior = consider_update(self.prior, result.posterior, mask)
        return self._effects_after(data, self.context, mask, result).estimate().correct(posterior).sigma

    def _effects_after(
        self, data: StageData, context: SolveContext, mask: BoolArray, result: NavigationResult
    ) -> EffectTests:
        """Return the tests of effects after a solution of this stage."""
        priors = known_effects(self.prior.sigma, context)
        before = self.effects or EffectTests(np.zeros(COUNT), context.states, priors)
        sensitivity = result_sensitivity(result, data, context, mask)
        return before.with_stage(self.stage, sensitivity, self.estimated)

    def ranking(self) -> Ranking | None:
        """Return the observability at the last call of `sigma`; None before the first observation."""
        return self._live.observability.ranking()

    def finish(self, progress: Progress | None = None) -> Solution:
        """Solve the stored stage.

        Raises InsufficientDataError if it has no rest for alignment, numpy.linalg.LinAlgError if the solution diverges.
        """
        return self.solve(self.buffer.data(), progress)

    def solve(self, data: StageData, progress: Progress | None = None) -> Solution:
        """Solve the given samples instead of the stored ones; see `finish`."""
        mask = np.array([name in self.estimated for name in NAMES])
        measured = rest_noise(data, self.context, self.prior.gyro_bias)
        context = with_measured_noise(self.context, measured)
        result, context = solve_with_measured_noise(
            data,
            context,
            self.prior,
            mask,
            lambda result, context: self._effects_after(data, context, mask, result),
            progress,
        )
        nis = result.history.nis
        messages = list(measured.messages())
        if result.azimuth_free:
            messages.append(("azimuth_from_data", {"stage": self.stage}))
        if not result.converged:
            messages.append(("not_converged", {"stage": self.stage, "passes": result.passes}))
        solution = Solution(
            stage=self.stage,
            posterior=consider_update(self.prior, result.posterior, mask),
            estimated=self.estimated,
            consistency=nis_consistency(float(np.sum(nis)), len(nis), 3),
            gaps=data.gaps,
            details={"passes": result.passes, "segments": len(result.starts)},
            messages=tuple(messages),
            noise=measured,
            sensitivity=self._sensitivity(data, context, mask, result, measured.slow_variance),
        )
        if not context.diagnostics:
            return solution
        observability = ObservabilityAnalysis(context, self.prior, result.point)
        observability.add(data, result.history)
        solution = replace(
            solution,
            observability=observability.result(),
            innovations=Innovations(data.seq[result.history.index - 1], result.history.innovation),
            tests=(
                *start_tests(result.starts, result.attitudes, context.site),
                *noise_tests(self.context, context, measured),
            ),
            local_scores=partial(local_scores, updates=result.updates, index=result.history.index),
        )
        return with_diagnosis(solution, data, context)

    def _sensitivity(
        self, data: StageData, context: SolveContext, mask: BoolArray, result: NavigationResult, slow: float
    ) -> Sensitivity:
        """Return the sensitivity to effects, with the actual noise for tests and the assumed noise for the estimate."""
        with_noise = pass_with_actual_noise(data, context, self.prior, mask, result, slow)
        tested = result_sensitivity(with_noise, data, context, mask)
        if with_noise is result:
            return tested
        ratio = float(np.sum(result.history.nis) / np.sum(with_noise.history.nis))
        return replace(tested, error=result_sensitivity(result, data, context, mask).error, noise_ratio=ratio)


def warm_up() -> None:
    """Compile every kernel, or load it from the numba cache, by solving a few seconds of simulated rest."""
    imu = ImuModel("warm-up", 100.0, "rate", 1e-6, 1e-6, 1e-5, 1e-4)
    context = SolveContext(Site(0.6, 1.9, 0.0, azimuth=0.0), imu, TableModel())
    prior = Posterior(np.zeros(COUNT), np.diag([p.prior_sigma**2 for p in PARAMETERS]))
    stage = NavigationStage("excitation", context, prior, NAMES)
    samples = PlannedSamples(context, prior.mean, np.zeros(3))
    for block in samples.run(Dwell(10.0), 10.0, stage.stage):
        stage.feed(block)
    stage.sigma()
    stage.finish()
