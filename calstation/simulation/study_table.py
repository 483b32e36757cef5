"""Statistics of a study case over its units: rms of error/sigma by group, NEES and bound ratio, with their bands."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import gammaincinv

from calstation.physics import GROUPS, NAMES, BoolArray, FloatArray, IntArray, group_indices

BAND = (0.0005, 0.9995)
#: Largest rms of error/bound over all parameters, or the upper end of its 99.9 % band if that is larger.
BOUND_RATIO_LIMIT = 1.1


@dataclass(frozen=True)
class UnitResult:
    """Errors, shape (30,), and covariances of posterior and bound, shape (30, 30), of one unit in one case."""

    case: str
    estimated: BoolArray
    error: FloatArray
    covariance: FloatArray
    bound: FloatArray
    nis: dict[str, tuple[float, float, float]]
    #: Ratio of the sigmas with and without the optional states, shape (30,); None without such states.
    cost: FloatArray | None = None
    seconds: float = 0.0  #: Duration of the samples that were solved, s.


def chi_squared_band(freedom: float) -> FloatArray:
    """Return the 99.9 % band of χ²/n with n degrees of freedom, shape (2,)."""
    return np.asarray(2.0 * gammaincinv(freedom / 2.0, BAND) / freedom)


def rms_band(correlations: list[FloatArray]) -> tuple[float, float]:
    """Return the 99.9 % band of the rms of normalised errors with these correlation matrices, one per unit.

    The sum of squares of correlated standard normals has mean n and variance 2 Σλ²; the scaled χ² distribution with the
    same mean and variance (Satterthwaite, Biometrics 2, 1946) gives the band.
    """
    count = sum(len(c) for c in correlations)
    squares = sum(float(np.sum(c * c)) for c in correlations)
    freedom = count**2 / squares
    low, high = np.sqrt(chi_squared_band(freedom)).tolist()
    return low, high


def summary(units: list[UnitResult], error_covariance: FloatArray | None) -> dict[str, Any]:
    """Return the statistics of one case as JSON data.

    `error_covariance` is the covariance of the errors, normalised by the filter's sigmas, shape (30, 30), if the noise
    exceeds the filter's model; the bands of the groups then follow from it.
    """
    estimated = np.flatnonzero(units[-1].estimated)
    groups = {}
    for group in GROUPS:
        indices = [i for i in group_indices(group) if i in estimated]
        if indices:
            groups[group] = _group(units, indices, error_covariance)
    nees = _nees(units, estimated)
    over_bound, correlations = [], []
    for unit in units:
        sigma = np.sqrt(np.diag(unit.bound)[estimated])
        nonzero = sigma > 0.0
        over_bound.append((unit.error[estimated] / np.where(nonzero, sigma, 1.0))[nonzero])
        correlation = unit.bound[np.ix_(estimated, estimated)] / np.outer(sigma, sigma)
        correlations.append(correlation[np.ix_(nonzero, nonzero)])
    bound = _rms(over_bound)
    limit = max(BOUND_RATIO_LIMIT, rms_band(correlations)[1])
    groups_passed = all(g["passed"] for g in groups.values())
    nis = {}
    for stage in units[0].nis:
        means, lows, highs = np.array([unit.nis[stage] for unit in units]).T
        nis[stage] = {"mean": float(np.mean(means)), "inside": float(np.mean((lows <= means) & (means <= highs)))}
    return {
        "units": len(units),
        "groups": groups,
        "nees": nees,
        "bound_ratio": bound,
        "bound_limit": limit,
        "nis": nis,
        "seconds": {"mean": float(np.mean([u.seconds for u in units])), "largest": max(u.seconds for u in units)},
        "passed": groups_passed and (error_covariance is not None or (nees["passed"] and bound <= limit)),
    }


def _group(units: list[UnitResult], chosen: list[int], ratio: FloatArray | None) -> dict[str, Any]:
    normalised, correlations = [], []
    for unit in units:
        sigma = np.sqrt(np.diag(unit.covariance)[chosen])
        normalised.append(unit.error[chosen] / sigma)
        correlations.append(unit.covariance[np.ix_(chosen, chosen)] / np.outer(sigma, sigma))
    if ratio is None:
        expected, (low, high) = 1.0, rms_band(correlations)
    else:
        block = ratio[np.ix_(chosen, chosen)]
        expected = float(np.sqrt(np.trace(block) / len(chosen)))
        low, high = rms_band([block / expected**2] * len(units))
        low, high = low * expected, high * expected
    rms = _rms(normalised)
    return {
        "rms": rms,
        "expected": expected,
        "low": low,
        "high": high,
        "passed": low <= rms <= high,
        "sigma": float(np.mean([np.sqrt(np.mean(np.diag(unit.covariance)[chosen])) for unit in units])),
        "worst": NAMES[chosen[int(np.argmax(np.sqrt(np.mean(np.square(normalised), axis=0))))]],
        **({} if units[0].cost is None else {"cost": _rms([u.cost[chosen] for u in units if u.cost is not None])}),
    }


def _nees(units: list[UnitResult], estimated: IntArray) -> dict[str, Any]:
    """Return the mean normalised estimation error squared per parameter (Bar-Shalom et al., *Estimation*, 5.4.2)."""
    total, count = 0.0, 0
    for unit in units:
        indices = [i for i in estimated if unit.covariance[i, i] > 0.0]
        covariance = unit.covariance[np.ix_(indices, indices)]
        total += float(unit.error[indices] @ np.linalg.solve(covariance, unit.error[indices]))
        count += len(indices)
    low, high = chi_squared_band(count)
    mean = total / count
    return {"mean": mean, "low": float(low), "high": float(high), "passed": bool(low <= mean <= high)}


def _rms(parts: list[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.square(np.concatenate(parts)))))
