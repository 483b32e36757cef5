"""Maximum a posteriori estimation by relinearisation: the navigation filter is run over a stage until it converges.

Every pass has the same prior; only the linearisation point changes. The problem is linear in an unknown azimuth only
near the solution, so the likeliest of several headings is refined with a narrow prior before it is estimated freely. If
the innovations show more table vibration than the table's profile, the stage is solved again with that noise.
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
#: Passes about a fixed point, after which the attitudes no longer change significantly.
PASSES_AT_POINT = 2
#: A first pass follows the motion well enough if its mean normalised innovation squared, of 3 degrees of freedom, is
#: below this: the errors of its linearisation point then add less than the noise.
FITS = 1.25 * 3.0
#: Number of passes that a solution usually needs, for the progress report.
USUAL_PASSES = 2
#: The iteration ends when the step of a pass, or the next step predicted from the last two, is below this many sigmas.
CONVERGED = 0.01
#: Number of equally spaced headings tried when the azimuth is ambiguous.
AZIMUTHS_TRIED = 12
#: Prior sigma, rad, of an azimuth found from the data while it is being refined.
NARROW_AZIMUTH_SIGMA = 0.3


Pass = TypeVar("Pass", ClosedLoopFilter, ReferencePass)
#: Ratio of the median normalised innovation squared to its expected median up to which the profile's noise is used.
_AGREES = 1.25
#: Median of the χ² distribution with 3 degrees of freedom.
_MEDIAN = 2.366
MAX_ADJUSTMENTS = 4
#: Smallest fraction of the profile's variance that is used: other noise remains, and rounding errors grow.
_MIN_RATIO = 0.01
#: A rotation between two observations slower than this, rad/s, is rest.
_AT_REST = np.deg2rad(0.1)
#: Smallest number of observations at rest, or in motion, for which the median is used.
_MIN_COUNT = 50


@dataclass(frozen=True)
class NavigationResult:
    """Posterior of the parameters after the last pass."""

    posterior: Posterior
    history: History
    starts: tuple[Start, ...]  #: Starts of the segments that were solved.
    attitudes: tuple[FloatArray, ...]  #: Start attitudes of the linearisation, C_bn, shape (3, 3).
    point: FloatArray  #: Parameters of the linearisation, SI, shape (30,).
    passes: int
    converged: bool  #: Whether the last pass made no significant change.
    azimuth_free: bool  #: Whether the azimuth was found from the data alone.
    updates: tuple[Updates, ...]  #: Every update of the last pass, in order.


def solve_navigation(
    stage: str,
    data: StageData,
    context: SolveContext,
    prior: Posterior,
    estimated: BoolArray,
    progress: Progress | None = None,
    near: NavigationResult | None = None,
) -> NavigationResult:
    """Iterate passes, relinearising all parameters, until the `estimated` ones converge.

    If none is estimated, the passes linearise about the mean of the prior and only the attitudes are updated. If `near`
    is given, the first pass linearises about this solution. Raises InsufficientDataError if no segment contains a rest
    for alignment.
    """
    if near is not None:
        solver = _Relinearisation(data, context, prior, estimated, _Meter(progress, USUAL_PASSES), near.passes)
        return replace(
            solver.iterate(list(near.starts), list(near.attitudes), near.point), azimuth_free=near.azimuth_free
        )
    begun = starts(data, context, prior)
    if not begun:
        raise no_rest_error(data, context.imu, prior)
    free = any(s.azimuth_sigma is not None for s in begun)
    ambiguous = any((s.azimuth_sigma or 0.0) > AMBIGUOUS_AZIMUTH_SIGMA for s in begun)
    meter = _Meter(progress, USUAL_PASSES * (1 + free) + AZIMUTHS_TRIED * ambiguous)
    solver = _Relinearisation(data, context, prior, estimated, meter)
    point, attitudes = solver.first_point(begun[0]), [s.attitude for s in begun]
    if free:
        narrow = [replace(s, prior_sigma=np.append(s.prior_sigma[:2], NARROW_AZIMUTH_SIGMA)) for s in begun]
        if ambiguous:
            narrow = solver.best_azimuth(point, narrow)
        near = solver.iterate(narrow, [s.attitude for s in narrow], point)
        point, attitudes = near.point, list(near.attitudes)
        begun = [replace(n, prior_sigma=s.prior_sigma) for n, s in zip(narrow, begun, strict=True)]
    return replace(solver.iterate(begun, attitudes, point), azimuth_free=free)


def pass_about(
    data: StageData, context: SolveContext, prior: Posterior, estimated: BoolArray, near: NavigationResult
) -> NavigationResult:
    """Run one pass, with the noise of `context`, about the solution `near`."""
    solver = _Relinearisation(data, context, prior, estimated, _Meter(None, USUAL_PASSES))
    run, _ = solver.one_pass(ReferencePass, near.point, list(near.starts), list(near.attitudes))
    return replace(near, posterior=run.posterior, history=run.history, updates=tuple(run.updates))


@dataclass
class _Meter:
    """Progress over the passes: the `expected` passes account for 0.9, each additional pass for half the remainder."""

    report: Progress | None
    expected: int
    passes: int = field(default=0, init=False)
    groups: int = field(default=0, init=False)
    seen: int = field(default=0, init=False)

    def begin(self, groups: int) -> None:
        """Begin a pass of `groups` groups of observations."""
        self.groups, self.seen = groups, 0

    def advance(self, groups: int) -> None:
        """Count groups of observations."""
        if self.report is not None:
            self.seen += groups
            done = self.passes + min(1.0, self.seen / max(self.groups, 1))
            beyond = max(0.0, done - self.expected)
            self.report(0.9 * (done - beyond) / self.expected + 0.1 * (1.0 - 0.5**beyond))


def _chi2(run: NavigationPass) -> float:
    """Return the sum of the squared normalised innovations; infinity for a pass that diverged."""
    return float(np.nan_to_num(np.sum(run.history.nis), nan=np.inf))


@dataclass
class _Relinearisation:
    """Passes over one stage; `passes` counts the passes made by `iterate`."""

    data: StageData
    context: SolveContext
    prior: Posterior
    estimated: BoolArray
    meter: _Meter
    passes: int = 0

    def first_point(self, start: Start) -> FloatArray:
        """Return the first linearisation point: the prior mean, or the first rest's gyro bias where more accurate."""
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

    def best_azimuth(self, point: FloatArray, begun: list[Start]) -> list[Start]:
        """Return the starts for the heading, out of `AZIMUTHS_TRIED`, whose first pass fits the data best."""
        candidates = []
        for k in range(AZIMUTHS_TRIED):
            turn = axis_rotation((0.0, 0.0, 1.0), 2.0 * np.pi * k / AZIMUTHS_TRIED)
            turned = [replace(s, prior=turn @ s.prior, attitude=turn @ s.attitude) for s in begun]
            run, _ = self.one_pass(ClosedLoopFilter, point, turned, [s.attitude for s in turned])
            candidates.append((_chi2(run), k, turned))
        return min(candidates, key=lambda c: c[:2])[2]

    def iterate(self, begun: list[Start], attitudes: list[FloatArray], point: FloatArray) -> NavigationResult:
        """Run passes until one makes no significant change.

        If the very first pass leaves innovations larger than their noise, it is repeated in closed loop, and the pass
        with the smaller innovations is used: a closed loop follows large errors of the first point, but may diverge
        while little has been observed.
        """
        moved = 1.0  # the rate at which steps shrink is unknown before the first pass
        for _ in range(MAX_PASSES):
            self.passes += 1
            smooth, ends = self.one_pass(ReferencePass, point, begun, attitudes)
            run: NavigationPass = smooth
            nis = run.history.nis
            if self.passes == 1 and not np.sum(nis) < FITS * len(nis):
                other, other_ends = self.one_pass(ClosedLoopFilter, point, begun, attitudes)
                if _chi2(other) <= _chi2(run):
                    run, ends = other, other_ends
            posterior = run.posterior
            sigma = np.where(posterior.sigma > 0.0, posterior.sigma, 1.0)
            before, moved = moved, float(np.max((np.abs(posterior.mean - point) / sigma)[self.estimated], initial=0.0))
            # steps shrink at least as fast as the last two did, which bounds the next one
            enough = self.passes > (1 if self.estimated.any() else PASSES_AT_POINT)
            converged = enough and (moved < CONVERGED or moved * moved < CONVERGED * before)
            if converged:
                break
            if self.estimated.any():
                point = posterior.mean
            attitudes = self._carry_back(run, point, begun, ends)
        return NavigationResult(
            posterior,
            run.history,
            tuple(begun),
            tuple(attitudes),
            point,
            self.passes,
            converged,
            azimuth_free=False,
            updates=tuple(smooth.updates),  # a pass in closed loop is never the last
        )

    def one_pass(
        self, kind: type[Pass], point: FloatArray, begun: list[Start], attitudes: list[FloatArray]
    ) -> tuple[Pass, list[FloatArray]]:
        """Run one pass of a kind about a point and start attitudes; also return the attitudes at the ends."""
        run = kind(self.context, self.prior, point)
        ends = []
        self.meter.begin(sum(-(-(s.end - s.begin) // (run.stride * run.group_size)) for s in begun))
        for start, attitude in zip(begun, attitudes, strict=True):
            for groups in run.steps(self.data, start, attitude):
                self.meter.advance(groups)
            ends.append(run.attitude)
        self.meter.passes += 1
        return run, ends

    def _carry_back(
        self, run: NavigationPass, point: FloatArray, begun: list[Start], ends: list[FloatArray]
    ) -> list[FloatArray]:
        """Compute start from end attitudes: C_end = Exp(−Ω T) C_start B, with B from the gyros and `point`."""
        constants, dt = compensation(point), self.data.dt
        carried = []
        for start, end in zip(begun, ends, strict=True):
            stop = start.begin + (start.end - start.begin) // run.stride * run.stride
            B = body_rotation(constants, dt, self.data.gyro, start.begin, stop)
            carried.append(rotation_matrix(run.earth * (stop - start.begin) * dt) @ end @ B.T)
        return carried


def solve_with_table_noise(
    stage: str,
    data: StageData,
    context: SolveContext,
    prior: Posterior,
    estimated: BoolArray,
    progress: Progress | None = None,
) -> tuple[NavigationResult, SolveContext]:
    """Solve a stage, and again with the velocity noise found from its innovations if that exceeds the profile's.

    Returns the result and the context with that noise. On a quieter table the profile's noise is kept, see `judged`.
    The median is insensitive to an effect in a part of the stage; the larger of the medians of rests and motions is
    used. Raises InsufficientDataError if no segment contains a rest.
    """
    result = solve_navigation(stage, data, context, prior, estimated, progress)
    for _ in range(MAX_ADJUSTMENTS):
        ratio = _ratio(result.history, data.dt)
        if ratio < _AGREES:
            break
        context = _with_variance(context, ratio)
        result = solve_navigation(stage, data, context, prior, estimated, near=result)
    return result, context


def judged(
    data: StageData, context: SolveContext, prior: Posterior, estimated: BoolArray, result: NavigationResult
) -> NavigationResult:
    """Return a pass about a solution with the actual noise, if the table is quieter than `context` specifies.

    It serves to test the model. The estimate keeps the profile's noise, which also covers disturbances that occur only
    in some moves.
    """
    ratio = _ratio(result.history, data.dt)
    if ratio > 1.0 / _AGREES:
        return result
    quieter = pass_about(data, _with_variance(context, max(ratio, _MIN_RATIO)), prior, estimated, result)
    return quieter if np.isfinite(quieter.history.nis).all() else result


def _with_variance(context: SolveContext, ratio: float) -> SolveContext:
    """Return the context with the table's velocity variance multiplied by `ratio`."""
    sigma = context.table.velocity_sigma * float(np.sqrt(ratio))
    return replace(context, table=replace(context.table, velocity_sigma=sigma))


def _ratio(history: History, dt: float) -> float:
    """Return the ratio of the innovations' variance to the predicted one."""
    turned = np.einsum("nij,nij->n", history.attitude[1:], history.attitude[:-1])
    angle: FloatArray = np.arccos(np.clip(0.5 * (turned - 1.0), -1.0, 1.0))
    still = angle < _AT_REST * dt * np.maximum(np.diff(history.index), 1)
    nis = history.nis[1:]
    parts = [part for part in (nis[still], nis[~still]) if len(part) >= _MIN_COUNT]
    return max((float(np.median(part)) / _MEDIAN for part in parts), default=1.0)
