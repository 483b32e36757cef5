"""MAP by relinearisation: passes of the navigation filter over a stored stage until the point settles.

Every pass has the same prior; only the point it linearises about moves: the parameters to the last pass's
posterior, each start attitude to the one that, turned by the measured rotation, ends where the pass ended, and the
trajectory from there to the smoothed one (see `reference`).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from calstation.errors import InsufficientDataError
from calstation.estimation.alignment import HOPELESS_AZIMUTH_SIGMA, Start, starts
from calstation.estimation.context import Belief, SolveContext
from calstation.estimation.method import Consistency
from calstation.estimation.navigation import History, NavigationFilter
from calstation.estimation.stage_data import StageData
from calstation.physics.arrays import BoolArray, FloatArray
from calstation.physics.imu_model import compensation
from calstation.physics.rotation import axis_rotation, rotation_matrix
from calstation.physics.strapdown import body_rotation

MOST_PASSES = 20
SETTLED = 0.01
"""A pass that moves no parameter by more than this many sigmas is the last."""
AZIMUTHS_TRIED = 8


@dataclass(frozen=True)
class NavigationResult:
    """Posterior of the parameters after the last pass, with what it saw.

    belief, history : of the last pass; starts : the segments solved; attitudes : start attitudes it linearised
    about; point : parameters likewise; passes : how many; azimuth_free : azimuth found from the data alone
    """

    belief: Belief
    history: History
    starts: tuple[Start, ...]
    attitudes: tuple[FloatArray, ...]
    point: FloatArray
    passes: int
    azimuth_free: bool


def restricted(prior: Belief, posterior: Belief, estimated: BoolArray) -> Belief:
    """The posterior of a consider (Schmidt) estimator: only `estimated` parameters move and gain.

    The others keep mean and covariance; cross-covariances follow. For data taken in one batch the estimated
    part equals the full estimator's (S. F. Schmidt, *Application of State-Space Methods*, 1966).
    """
    mean = np.where(estimated, posterior.mean, prior.mean)
    considered = np.ix_(~estimated, ~estimated)
    covariance = posterior.covariance.copy()
    covariance[considered] = prior.covariance[considered]
    return Belief(mean, 0.5 * (covariance + covariance.T))


def nis_consistency(total: float, count: int, dimension: int) -> Consistency:
    """Mean NIS of `count` observations of `dimension` and the 99.9 % band of that mean (Bar-Shalom, 5.4)."""
    low, high = np.asarray(chi2.ppf([0.0005, 0.9995], count * dimension)) / max(count, 1)
    return Consistency(total / max(count, 1), float(low), float(high), count)


def solve_navigation(
    stage: str, data: StageData, context: SolveContext, prior: Belief, estimated: BoolArray
) -> NavigationResult:
    """Iterate passes until settled. Raises InsufficientDataError where there is nothing to start from."""
    found = starts(data, context, prior)
    if not found:
        raise InsufficientDataError(
            f"{stage}: no rest of at least 1 s in {len(data) * data.dt:.1f} s of samples to align on; "
            "include the rest before the first turn"
        )
    free = any(s.azimuth_sigma is not None for s in found)
    if any((s.azimuth_sigma or 0.0) > HOPELESS_AZIMUTH_SIGMA for s in found):
        found = _best_azimuth(data, context, prior, found)
    attitudes = [s.attitude for s in found]
    point = prior.mean
    for passes in range(1, MOST_PASSES + 1):
        run, ends = _pass(data, context, prior, point, found, attitudes, passes > 1)
        belief = run.belief
        settled_at = np.where(estimated, belief.mean, prior.mean)
        sigma = np.where(belief.sigma > 0.0, belief.sigma, 1.0)
        moved = float(np.max(np.abs(settled_at - point) / sigma))
        if (moved < SETTLED and passes > 1) or passes == MOST_PASSES:
            break
        attitudes = _carry_back(run, data, settled_at, found, ends)
        point = settled_at
    return NavigationResult(belief, run.history, tuple(found), tuple(attitudes), point, passes, free)


def _pass(
    data: StageData,
    context: SolveContext,
    prior: Belief,
    point: FloatArray,
    found: list[Start],
    attitudes: list[FloatArray],
    smooth: bool,
) -> tuple[NavigationFilter, list[FloatArray]]:
    run = NavigationFilter(context, prior, point)
    ends = []
    for start, attitude in zip(found, attitudes, strict=True):
        run.run(data, start, attitude, smooth)
        ends.append(run.attitude)
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


def _best_azimuth(data: StageData, context: SolveContext, prior: Belief, found: list[Start]) -> list[Start]:
    """Among headings all round, the one whose first pass explains the data best."""
    candidates = []
    for k in range(AZIMUTHS_TRIED):
        turn = axis_rotation((0.0, 0.0, 1.0), 2.0 * np.pi * k / AZIMUTHS_TRIED)
        turned = [replace(s, prior=turn @ s.prior, attitude=turn @ s.attitude) for s in found]
        run, _ = _pass(data, context, prior, prior.mean, turned, [s.attitude for s in turned], False)
        candidates.append((sum(run.history.nis), k, turned))
    return min(candidates, key=lambda c: c[:2])[2]
