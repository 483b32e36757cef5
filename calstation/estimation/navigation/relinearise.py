"""MAP by relinearisation: passes of the navigation filter over a stored stage until the point settles.

Every pass has the same prior; only the point it linearises about moves: the parameters to the last pass's
posterior, each start attitude to the one that, turned by the measured rotation, ends where the pass ended, and the
trajectory from there to the smoothed one (see `reference`). An unknown azimuth is linear only near its answer: of
headings all round the likeliest is settled in its neighbourhood before it is let free.
"""

from dataclasses import dataclass, replace

import numpy as np

from calstation.errors import InsufficientDataError
from calstation.estimation.common.alignment import AMBIGUOUS_AZIMUTH_SIGMA, SHORTEST_REST, Start, starts
from calstation.estimation.common.context import Belief, SolveContext
from calstation.estimation.common.stage_data import StageData
from calstation.estimation.method import Progress
from calstation.estimation.navigation.filter import History, NavigationFilter
from calstation.physics.arrays import BoolArray, FloatArray
from calstation.physics.earth import rotation_rate
from calstation.physics.imu_model import compensation
from calstation.physics.parameters import group_indices
from calstation.physics.rotation import axis_rotation, rotation_matrix
from calstation.physics.strapdown import body_rotation

MOST_PASSES = 20
USUAL_PASSES = 2
#: A pass is the last when it, or the next by the rate at which steps shrink, moves nothing by this many sigmas.
CONVERGED = 0.01
AZIMUTHS_TRIED = 12
#: An azimuth found from the data is first settled within this of where it seems to be, rad, then let free.
NARROW_AZIMUTH_SIGMA = 0.3


@dataclass(frozen=True)
class NavigationResult:
    """Posterior of the parameters after the last pass, with what it saw.

    belief, history : of the last pass; starts : the segments solved; attitudes : start attitudes it linearised
    about; point : parameters likewise; passes : how many; settled : the last one moved nothing that matters;
    azimuth_free : azimuth found from the data alone
    """

    belief: Belief
    history: History
    starts: tuple[Start, ...]
    attitudes: tuple[FloatArray, ...]
    point: FloatArray
    passes: int
    converged: bool
    azimuth_free: bool


class _Meter:
    """Tells how far the passes are: `expected` of them make up 0.9, each further one half of what is left."""

    def __init__(self, tell: Progress | None, expected: int) -> None:
        self._tell = tell
        self._expected = expected
        self._passes = self._groups = self._seen = 0

    def begin(self, groups: int) -> None:
        """A pass of so many groups of observations."""
        self._groups, self._seen = groups, 0

    def watch(self, _: NavigationFilter) -> None:
        """After a start and after every group."""
        if self._tell is not None:
            self._seen += 1
            done = self._passes + min(1.0, self._seen / max(self._groups, 1))
            beyond = max(0.0, done - self._expected)
            self._tell(0.9 * (done - beyond) / self._expected + 0.1 * (1.0 - 0.5**beyond))

    def end(self) -> None:
        """The pass is done."""
        self._passes += 1


def solve_navigation(
    stage: str,
    data: StageData,
    context: SolveContext,
    prior: Belief,
    estimated: BoolArray,
    progress: Progress | None = None,
) -> NavigationResult:
    """Iterate passes until settled. Raises InsufficientDataError where there is nothing to start from."""
    found = starts(data, context, prior)
    if not found:
        raise InsufficientDataError(
            f"{stage}: no rest of at least 1 s in {len(data) * data.dt:.1f} s of samples to align on; "
            "include the rest before the first turn"
        )
    free = any(s.azimuth_sigma is not None for s in found)
    ambiguous = any((s.azimuth_sigma or 0.0) > AMBIGUOUS_AZIMUTH_SIGMA for s in found)
    meter = _Meter(progress, USUAL_PASSES * (1 + free) + AZIMUTHS_TRIED * ambiguous)
    point = _resting_point(data, context, prior, found[0], estimated)
    attitudes = [s.attitude for s in found]
    passes = 0
    if free:
        narrow = [replace(s, prior_sigma=np.append(s.prior_sigma[:2], NARROW_AZIMUTH_SIGMA)) for s in found]
        if ambiguous:
            narrow = _best_azimuth(data, context, prior, point, narrow, meter)
        near = _iterate(
            data, context, prior, estimated, narrow, [s.attitude for s in narrow], point, passes, meter
        )
        point, attitudes, passes = near.point, list(near.attitudes), near.passes
        found = [replace(n, prior_sigma=s.prior_sigma) for n, s in zip(narrow, found, strict=True)]
    result = _iterate(data, context, prior, estimated, found, attitudes, point, passes, meter)
    return replace(result, azimuth_free=free)


def _iterate(
    data: StageData,
    context: SolveContext,
    prior: Belief,
    estimated: BoolArray,
    found: list[Start],
    attitudes: list[FloatArray],
    point: FloatArray,
    done: int,
    meter: _Meter,
) -> NavigationResult:
    """Passes until one moves nothing that matters; the very first, with `done` = 0 before it, closes the loop."""
    moved = 1.0  # before the first pass nothing is known of how fast steps shrink
    for passes in range(done + 1, done + MOST_PASSES + 1):
        run, ends = _pass(data, context, prior, point, found, attitudes, passes > 1, meter)
        belief = run.belief
        settled_at = np.where(estimated, belief.mean, prior.mean)
        sigma = np.where(belief.sigma > 0.0, belief.sigma, 1.0)
        before, moved = moved, float(np.max(np.abs(settled_at - point) / sigma))
        # steps shrink at least as the last two did, so the next one's size is known without taking it
        converged = passes > 1 and (moved < CONVERGED or moved * moved < CONVERGED * before)
        if converged:
            break
        attitudes = _carry_back(run, data, settled_at, found, ends)
        point = settled_at
    return NavigationResult(
        belief, run.history, tuple(found), tuple(attitudes), point, passes, converged, azimuth_free=False
    )


def _resting_point(
    data: StageData, context: SolveContext, prior: Belief, start: Start, estimated: BoolArray
) -> FloatArray:
    """Where to linearise first: the prior's mean, but the gyro bias that the first rest shows where it tells more."""
    point = prior.mean.copy()
    bias = group_indices("gyro_bias")
    earth = rotation_rate(context.site.latitude)
    expected = np.linalg.solve(compensation(prior.mean).gyro_inverse, start.attitude.T @ earth)
    stop = start.begin + max(round(SHORTEST_REST / data.dt), 1)
    shown = data.gyro[start.begin : stop].mean(axis=0) - expected
    worth = context.imu.gyro_arw / np.sqrt(SHORTEST_REST) + float(np.linalg.norm(earth))
    for axis, index in enumerate(bias):
        if estimated[index] and prior.sigma[index] > 10.0 * worth:
            point[index] = shown[axis]
    return point


def _pass(
    data: StageData,
    context: SolveContext,
    prior: Belief,
    point: FloatArray,
    found: list[Start],
    attitudes: list[FloatArray],
    smooth: bool,
    meter: _Meter,
) -> tuple[NavigationFilter, list[FloatArray]]:
    run = NavigationFilter(context, prior, point)
    ends = []
    meter.begin(sum(-(-(s.end - s.begin) // (run.stride * run.group_size)) + 1 for s in found))
    for start, attitude in zip(found, attitudes, strict=True):
        run.run(data, start, attitude, smooth, meter.watch)
        ends.append(run.attitude)
    meter.end()
    return run, ends


def _carry_back(
    run: NavigationFilter, data: StageData, point: FloatArray, found: list[Start], ends: list[FloatArray]
) -> list[FloatArray]:
    """Start attitudes from end attitudes: C_end = Exp(−Ω T) C_start B, B from the gyros with `point`."""
    constants = compensation(point)
    carried = []
    for start, end in zip(found, ends, strict=True):
        stop = start.begin + (start.end - start.begin) // run.stride * run.stride
        B = body_rotation(constants, data.dt, data.gyro, start.begin, stop)
        carried.append(rotation_matrix(run.earth * (stop - start.begin) * data.dt) @ end @ B.T)
    return carried


def _best_azimuth(
    data: StageData,
    context: SolveContext,
    prior: Belief,
    point: FloatArray,
    found: list[Start],
    meter: _Meter,
) -> list[Start]:
    """Among headings all round, the one whose first pass explains the data best."""
    candidates = []
    for k in range(AZIMUTHS_TRIED):
        turn = axis_rotation((0.0, 0.0, 1.0), 2.0 * np.pi * k / AZIMUTHS_TRIED)
        turned = [replace(s, prior=turn @ s.prior, attitude=turn @ s.attitude) for s in found]
        run, _ = _pass(data, context, prior, point, turned, [s.attitude for s in turned], False, meter)
        candidates.append((sum(run.history.nis), k, turned))
    return min(candidates, key=lambda c: c[:2])[2]
