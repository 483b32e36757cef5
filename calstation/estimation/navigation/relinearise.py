"""Maximum a posteriori estimation by relinearisation: the navigation filter passes over a stage until it converges.

Every pass has the same prior; only the linearisation point changes. The problem is linear in an unknown azimuth only
near the solution, so the likeliest of several headings is refined with a narrow prior before it is estimated freely.
"""

from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from calstation.estimation.common import (
    AMBIGUOUS_AZIMUTH_SIGMA,
    SHORTEST_REST,
    Posterior,
    SolveContext,
    StageData,
    Start,
    no_rest_error,
    starts,
)
from calstation.estimation.method import Progress
from calstation.estimation.navigation.group_update import Updates
from calstation.estimation.navigation.navigation_pass import ClosedLoopFilter, History, NavigationPass, ReferencePass
from calstation.physics import (
    BoolArray,
    FloatArray,
    axis_rotation,
    body_rotation,
    compensation,
    group_indices,
    rotation_matrix,
    rotation_rate,
)

MAX_PASSES = 20
#: Number of passes about fixed parameters after which the attitudes no longer change significantly.
PASSES_AT_POINT = 2
#: Largest mean normalised innovation squared (3 degrees of freedom) of an accepted first pass: up to it, the error of
#: the linearisation point contributes less than the noise.
MAX_FIRST_NIS = 1.25 * 3.0
#: Usual number of passes of a solution, for the progress report.
USUAL_PASSES = 2
#: Step of a pass, in sigmas, below which the iteration ends; it also ends if, after a step below `LINEAR_STEP`, the
#: next step predicted from the last two is below this.
CONVERGED_STEP = 0.001
#: Largest step, in sigmas, from which the next step is predicted; the linearisation is invalid for longer steps.
LINEAR_STEP = 1.0
#: Number of equally spaced headings that are compared if the azimuth is ambiguous.
AZIMUTH_CANDIDATES = 12
#: Prior sigma of an unknown azimuth while it is being refined, rad.
NARROW_AZIMUTH_SIGMA = 0.3


Pass = TypeVar("Pass", ClosedLoopFilter, ReferencePass)
#: Largest rate between two observations at rest, rad/s.
REST_RATE = np.deg2rad(0.1)


@dataclass(frozen=True)
class NavigationResult:
    """Posterior of the parameters after the last pass."""

    posterior: Posterior
    history: History
    starts: tuple[Start, ...]  #: Starts of the segments that were solved.
    attitudes: tuple[FloatArray, ...]  #: C_bn at the starts about which the pass linearised, shape (3, 3).
    point: FloatArray  #: Parameters about which the pass linearised, SI, shape (30,).
    passes: int
    converged: bool  #: Whether the last pass made no significant change.
    azimuth_free: bool  #: Whether the azimuth was estimated from the data alone.
    updates: tuple[Updates, ...]  #: Every update of the last pass, in order.


def solve_navigation(
    data: StageData,
    context: SolveContext,
    prior: Posterior,
    estimated: BoolArray,
    progress: Progress | None = None,
    initial: NavigationResult | None = None,
) -> NavigationResult:
    """Repeat passes, relinearising all parameters, until the `estimated` ones converge.

    If none is estimated, the passes linearise about the mean of the prior, and only the attitudes are updated. If
    `initial` is given, the first pass linearises about this solution. Raises InsufficientDataError if no segment
    contains a rest for alignment.

    Parameters
    ----------
    data : samples of a stage
    context : IMU, table and site
    prior : estimate before the stage
    estimated : whether each parameter is estimated, shape (30,)
    progress : callback with the solved fraction
    initial : solution about which the first pass is linearised
    """
    if initial is not None:
        solver = _Relinearisation(
            data, context, prior, estimated, _PassProgress(progress, USUAL_PASSES), initial.passes
        )
        return replace(
            solver.iterate(list(initial.starts), list(initial.attitudes), initial.point),
            azimuth_free=initial.azimuth_free,
        )
    segments = _aligned(data, context, prior)
    free = any(s.azimuth_sigma is not None for s in segments)
    ambiguous = any((s.azimuth_sigma or 0.0) > AMBIGUOUS_AZIMUTH_SIGMA for s in segments)
    pass_progress = _PassProgress(progress, USUAL_PASSES * (1 + free) + AZIMUTH_CANDIDATES * ambiguous)
    solver = _Relinearisation(data, context, prior, estimated, pass_progress)
    point, attitudes = solver.first_point(segments[0]), [s.attitude for s in segments]
    if free:
        narrow = [replace(s, prior_sigma=np.append(s.prior_sigma[:2], NARROW_AZIMUTH_SIGMA)) for s in segments]
        if ambiguous:
            narrow = solver.best_azimuth(point, narrow)
        initial = solver.iterate(narrow, [s.attitude for s in narrow], point)
        point, attitudes = initial.point, list(initial.attitudes)
        segments = [replace(n, prior_sigma=s.prior_sigma) for n, s in zip(narrow, segments, strict=True)]
    return replace(solver.iterate(segments, attitudes, point), azimuth_free=free)


def _aligned(data: StageData, context: SolveContext, prior: Posterior) -> list[Start]:
    """Return the starts of the segments. Raises InsufficientDataError if there is none."""
    segments = starts(data, context, prior)
    if not segments:
        raise no_rest_error(data, context.imu, prior)
    return segments


@dataclass
class _PassProgress:
    """Progress of the passes: the `expected` passes account for 0.9, each additional pass for half the remainder."""

    report: Progress | None
    expected: int
    passes: int = field(default=0, init=False)
    groups: int = field(default=0, init=False)
    processed: int = field(default=0, init=False)

    def begin(self, groups: int) -> None:
        """Begin a pass of `groups` groups of observations."""
        self.groups, self.processed = groups, 0

    def advance(self, groups: int) -> None:
        """Count groups of observations."""
        if self.report is not None:
            self.processed += groups
            passes = self.passes + min(1.0, self.processed / max(self.groups, 1))
            additional = max(0.0, passes - self.expected)
            self.report(0.9 * (passes - additional) / self.expected + 0.1 * (1.0 - 0.5**additional))


def _chi2(run: NavigationPass) -> float:
    """Return the sum of the squared normalised innovations; infinity for a pass that diverged."""
    return float(np.nan_to_num(np.sum(run.history.nis), nan=np.inf))


@dataclass
class _Relinearisation:
    """Passes over one stage; `passes` counts those of `iterate`."""

    data: StageData
    context: SolveContext
    prior: Posterior
    estimated: BoolArray
    pass_progress: _PassProgress
    passes: int = 0

    def first_point(self, start: Start) -> FloatArray:
        """Return the first linearisation point: the prior mean, or the gyro bias of the first rest if more accurate."""
        context, prior, dt = self.context, self.prior, self.data.dt
        point = prior.mean.copy()
        earth = rotation_rate(context.site.latitude)
        expected = np.linalg.solve(compensation(prior.mean).gyro_inverse, start.attitude.T @ earth)
        stop = start.begin + max(round(SHORTEST_REST / dt), 1)
        measured = self.data.gyro[start.begin : stop].mean(axis=0) - expected
        sigma = context.imu.gyro_arw / np.sqrt(SHORTEST_REST) + float(np.linalg.norm(earth))
        for axis, index in enumerate(group_indices("gyro_bias")):
            if self.estimated[index] and prior.sigma[index] > 10.0 * sigma:
                point[index] = measured[axis]
        return point

    def best_azimuth(self, point: FloatArray, segments: list[Start]) -> list[Start]:
        """Return the starts for that heading, of `AZIMUTH_CANDIDATES`, whose first pass fits the data best."""
        candidates = []
        for k in range(AZIMUTH_CANDIDATES):
            turn = axis_rotation((0.0, 0.0, 1.0), 2.0 * np.pi * k / AZIMUTH_CANDIDATES)
            candidate = [replace(s, prior=turn @ s.prior, attitude=turn @ s.attitude) for s in segments]
            run, _ = self.one_pass(ClosedLoopFilter, point, candidate, [s.attitude for s in candidate])
            candidates.append((_chi2(run), k, candidate))
        return min(candidates, key=lambda c: c[:2])[2]

    def iterate(self, segments: list[Start], attitudes: list[FloatArray], point: FloatArray) -> NavigationResult:
        """Repeat passes until one makes no significant change.

        If the innovations of the first pass exceed their expected noise, it is repeated in closed loop, and the pass
        with the smaller innovations is used. A closed loop tolerates a poor first linearisation point, but may diverge
        after a few observations.
        """
        step = 1.0  # the rate at which steps shrink is unknown before the first pass
        for _ in range(MAX_PASSES):
            self.passes += 1
            smooth, ends = self.one_pass(ReferencePass, point, segments, attitudes)
            run: NavigationPass = smooth
            nis = run.history.nis
            if self.passes == 1 and not np.sum(nis) < MAX_FIRST_NIS * len(nis):
                closed_loop, closed_loop_ends = self.one_pass(ClosedLoopFilter, point, segments, attitudes)
                if _chi2(closed_loop) <= _chi2(run):
                    run, ends = closed_loop, closed_loop_ends
            posterior = run.posterior
            sigma = np.where(posterior.sigma > 0.0, posterior.sigma, 1.0)
            last_step, step = step, float(np.max((np.abs(posterior.mean - point) / sigma)[self.estimated], initial=0.0))
            # small steps decrease at least at the ratio of the last two, which bounds the next step
            small_next = step < LINEAR_STEP and step * step < CONVERGED_STEP * last_step
            enough_passes = self.passes > (1 if self.estimated.any() else PASSES_AT_POINT)
            converged = enough_passes and (step < CONVERGED_STEP or small_next)
            if converged:
                break
            if self.estimated.any():
                point = posterior.mean
            attitudes = self._start_attitudes(run, point, segments, ends)
        return NavigationResult(
            posterior,
            run.history,
            tuple(segments),
            tuple(attitudes),
            point,
            self.passes,
            converged,
            azimuth_free=False,
            updates=tuple(smooth.updates),  # a pass in closed loop is never the last
        )

    def one_pass(
        self, kind: type[Pass], point: FloatArray, segments: list[Start], attitudes: list[FloatArray]
    ) -> tuple[Pass, list[FloatArray]]:
        """Run one pass of a kind about a point and start attitudes; also return the attitudes at the segments' ends."""
        run = kind(self.context, self.prior, point)
        ends = []
        self.pass_progress.begin(sum(-(-(s.end - s.begin) // (run.stride * run.group_size)) for s in segments))
        for start, attitude in zip(segments, attitudes, strict=True):
            for groups in run.steps(self.data, start, attitude):
                self.pass_progress.advance(groups)
            ends.append(run.attitude)
        self.pass_progress.passes += 1
        return run, ends

    def _start_attitudes(
        self, run: NavigationPass, point: FloatArray, segments: list[Start], ends: list[FloatArray]
    ) -> list[FloatArray]:
        """Compute the start attitudes from the end attitudes: C_end = Exp(−Ω T) C_start B, B from gyros and `point`."""
        constants, dt = compensation(point), self.data.dt
        attitudes = []
        for start, end in zip(segments, ends, strict=True):
            stop = start.begin + (start.end - start.begin) // run.stride * run.stride
            B = body_rotation(constants, dt, self.data.gyro, start.begin, stop)
            attitudes.append(rotation_matrix(run.earth * (stop - start.begin) * dt) @ end @ B.T)
        return attitudes


def first_pass(
    data: StageData, context: SolveContext, prior: Posterior, estimated: BoolArray, point: FloatArray
) -> NavigationResult:
    """Return one pass about parameters near the solution, for its covariances.

    Raises InsufficientDataError if no segment contains a rest for alignment.

    Parameters
    ----------
    data, context, prior : samples of the stage, noise of the profiles, estimate before the stage
    estimated : mask of the estimated parameters, shape (30,)
    point : parameters near the solution, SI, shape (30,)
    """
    solver = _Relinearisation(data, context, prior, estimated, _PassProgress(None, USUAL_PASSES))
    segments = _aligned(data, context, prior)
    attitudes = [s.attitude for s in segments]
    run, _ = solver.one_pass(ReferencePass, point, segments, attitudes)
    return NavigationResult(
        run.posterior,
        run.history,
        tuple(segments),
        tuple(attitudes),
        point,
        1,
        converged=False,
        azimuth_free=False,
        updates=tuple(run.updates),
    )


def pass_about(
    result: NavigationResult, data: StageData, context: SolveContext, prior: Posterior, estimated: BoolArray
) -> NavigationResult:
    """Return another pass about a solution, with the noise of `context`."""
    solver = _Relinearisation(data, context, prior, estimated, _PassProgress(None, USUAL_PASSES))
    run, _ = solver.one_pass(ReferencePass, result.point, list(result.starts), list(result.attitudes))
    return replace(result, posterior=run.posterior, history=run.history, updates=tuple(run.updates))
