"""Test for a step of the accelerometer scale factors that is common to all units of a station: an error of gravity.

No run can detect an error of gravity, because all three scale factors absorb it. The mean of the three factors of a
unit changes little, and that of many units scatters about a constant. The model is c = μ + u + δ + e with the unit's
own value u, repeatability e, and a step δ between two runs; δ is estimated by generalised least squares for every time
of the step (C. E. McCulloch and S. R. Searle, *Generalized, Linear, and Mixed Models*, 2001, chapter 6).
"""

from dataclasses import dataclass

import numpy as np

from calstation.config import StationConfig
from calstation.physics import AXES, FloatArray, IntArray
from calstation.quality.runs import judged_runs
from calstation.records import RunColumns

#: Name of the mean of the three accelerometer scale factors among the charted quantities.
COMMON_SCALE = "accel_scale"
SCALES = tuple(f"accel_scale_{axis}" for axis in AXES)
#: Number of latest runs that are tested.
_MAX_RUNS = 500
#: Smallest number of runs, and of repeated runs from which repeatability is estimated.
_MIN_RUNS, _MIN_REPEATED = 6, 3
#: Smallest step, in sigmas, of all units, and of the other units if any single unit is left out.
_MIN_SIGMAS, _MIN_WITHOUT_ONE = 5.0, 3.0
#: Ratio of the standard deviation of normal values to the median of their magnitudes.
_MAD = 1.4826


@dataclass(frozen=True)
class GravityShift:
    """A step of the mean accelerometer scale factor that is common to the units of a station."""

    name: str  #: File name of the log of the first run after the step, without suffix.
    started: float  #: Its start, s since 1970 in UTC.
    step: float  #: Relative change; an assumed gravity that becomes too large by this ratio causes the opposite step.
    sigma: float
    units: int  #: Number of units after the step.


def gravity_shift(station: StationConfig, runs: RunColumns) -> GravityShift | None:
    """Return the most significant common step over the runs of a product at a station, or None.

    Check standards and repeated units reveal small steps, new units only steps that exceed their scatter.
    """
    rows = judged_runs(runs)
    rows = rows[runs.stations.isin((station.name,))[rows]]
    scales = common_scale(runs)
    if scales is None:
        return None
    common, _ = scales
    rows = rows[~np.isnan(common[rows])][-_MAX_RUNS:]
    if len(rows) < _MIN_RUNS:
        return None
    _, unit = np.unique(runs.serials.codes[rows], return_inverse=True)
    shift = common_step(common[rows], unit)
    if shift is None:
        return None
    k, step, sigma = shift
    at = int(rows[k])
    return GravityShift(runs.names[at], float(runs.started[at]), step, sigma, len(np.unique(unit[k:])))


def common_scale(runs: RunColumns) -> tuple[FloatArray, FloatArray] | None:
    """Return the mean of the three accelerometer scale factors of every run, and its sigma, shape (n,).

    An error of gravity changes all three alike. None if no run has solved all three.
    """
    if any(name not in runs.values for name in SCALES):
        return None
    values, sigmas = (np.array([columns[name] for name in SCALES]) for columns in (runs.values, runs.sigmas))
    return values.mean(axis=0), np.linalg.norm(sigmas, axis=0) / len(SCALES)


def common_step(values: FloatArray, unit: IntArray) -> tuple[int, float, float] | None:
    """Return the index after the most significant step that is common to several units, its size and its sigma.

    Parameters
    ----------
    values : values in chronological order, shape (n,)
    unit : number of the unit of each value, from 0, shape (n,)
    """
    spread, repeatability = _sigmas(values, unit)
    if not repeatability > 0.0:
        return None
    steps = [(k, *_step(values, unit, k, spread, repeatability)) for k in range(1, len(values))]
    k, step, sigma = max(steps, key=lambda each: abs(each[1]) / each[2])
    if abs(step) < _MIN_SIGMAS * sigma:
        return None
    for one in np.unique(unit[k:]):
        others = unit != one
        rest, rest_sigma = _step(values[others], unit[others], int(others[:k].sum()), spread, repeatability)
        if not abs(rest) > _MIN_WITHOUT_ONE * rest_sigma:
            return None  # a single unit has changed
    return k, step, sigma


def _sigmas(values: FloatArray, unit: IntArray) -> tuple[float, float]:
    """Return the standard deviations between units and between runs of a unit; a step hardly changes the medians."""
    order = np.argsort(unit, kind="stable")
    again = np.diff(unit[order]) == 0
    changes = np.abs(np.diff(values[order])[again])
    _, first = np.unique(unit, return_index=True)
    firsts = values[first]
    spread = _MAD * float(np.median(np.abs(firsts - np.median(firsts))))
    if len(changes) < _MIN_REPEATED:
        return spread, spread  # repeated units then count no more than new ones
    return spread, max(_MAD * float(np.median(changes)) / np.sqrt(2.0), 1e-9)


def _step(values: FloatArray, unit: IntArray, k: int, spread: float, repeatability: float) -> tuple[float, float]:
    """Return the step between the values k − 1 and k, and its sigma, which is infinite if it is not determined."""
    after = (np.arange(len(values)) >= k).astype(float)
    count, X = np.bincount(unit), np.stack([np.ones(len(values)), after, values])
    sums = np.array([np.bincount(unit, row) for row in X])
    share = spread**2 / (repeatability**2 + count * spread**2)
    normal = (X @ X.T - (sums * share) @ sums.T) / repeatability**2
    if np.linalg.cond(normal[:2, :2]) > 1e12:
        return 0.0, np.inf
    covariance = np.linalg.inv(normal[:2, :2])
    return float((covariance @ normal[:2, 2])[1]), float(np.sqrt(covariance[1, 1]))
