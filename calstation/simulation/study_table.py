"""Statistics of a case over its units: rms of error over sigma per group, NEES and bound ratio, with their bands."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.stats import chi2

from calstation.physics import GROUPS, NAMES, BoolArray, FloatArray, group_indices

BAND = (0.0005, 0.9995)
#: Largest rms of error over bound, pooled over all parameters; with few parameters their 99.9 % band if wider.
BOUND_RATIO_LIMIT = 1.1


@dataclass
class CaseData:
    """Results of one case, one entry per unit."""

    estimated: BoolArray | None = None
    errors: list[FloatArray] = field(default_factory=list)
    covariances: list[FloatArray] = field(default_factory=list)
    bounds: list[FloatArray] = field(default_factory=list)
    nis: list[dict[str, tuple[float, float, float]]] = field(default_factory=list)

    def add(
        self,
        estimated: BoolArray,
        error: FloatArray,
        covariance: FloatArray,
        bound: FloatArray,
        nis: dict[str, tuple[float, float, float]],
    ) -> None:
        """Add one unit."""
        self.estimated = estimated
        self.errors.append(error)
        self.covariances.append(covariance)
        self.bounds.append(bound)
        self.nis.append(nis)


def rms_band(correlations: list[FloatArray]) -> tuple[float, float]:
    """99.9 % band of the rms of normalised errors with these correlation matrices, one per unit.

    The sum of squares of correlated standard normals has mean n and variance 2 Σλ²; the χ² with the same two
    (Satterthwaite, Biometrics 2, 1946) gives the band.
    """
    count = sum(len(c) for c in correlations)
    squares = sum(float(np.sum(c * c)) for c in correlations)
    freedom = count**2 / squares
    low, high = np.asarray(chi2.ppf(BAND, freedom)) / freedom
    return float(np.sqrt(low)), float(np.sqrt(high))


def summary(grade: str, name: str, data: CaseData, true_covariance_ratio: FloatArray | None) -> dict[str, Any]:
    """One row of the study, JSON-ready.

    Parameters
    ----------
    grade, name : of the units and the case
    data : results of all units
    true_covariance_ratio : covariance of the error in units of the filter's sigmas, shape (30, 30), if the noise is
        richer than the filter's model: its trace widens the bands; else None
    """
    assert data.estimated is not None
    estimated = np.flatnonzero(data.estimated)
    groups = {}
    for group in GROUPS:
        chosen = [i for i in group_indices(group) if i in estimated]
        if chosen:
            groups[group] = _group(data, chosen, true_covariance_ratio)
    whole = _nees(data, estimated)
    over_bound, alike = [], []
    for error, b in zip(data.errors, data.bounds, strict=True):
        sigma = np.sqrt(np.diag(b)[estimated])
        known = sigma > 0.0
        over_bound.append((error[estimated] / np.where(known, sigma, 1.0))[known])
        alike.append((b[np.ix_(estimated, estimated)] / np.outer(sigma, sigma))[np.ix_(known, known)])
    bound = _rms(over_bound)
    limit = max(BOUND_RATIO_LIMIT, rms_band(alike)[1])
    row: dict[str, Any] = {
        "grade": grade,
        "case": name,
        "units": len(data.errors),
        "groups": groups,
        "nees": whole,
        "bound_ratio": bound,
        "bound_limit": limit,
        "nis": {
            stage: {
                "mean": float(np.mean([n[stage][0] for n in data.nis])),
                "inside": float(np.mean([n[stage][1] <= n[stage][0] <= n[stage][2] for n in data.nis])),
            }
            for stage in data.nis[0]
        },
    }
    if true_covariance_ratio is None:
        row["passed"] = all(g["passed"] for g in groups.values()) and whole["passed"] and bound <= limit
    else:
        row["passed"] = all(g["passed"] for g in groups.values())
    return row


def _group(data: CaseData, chosen: list[int], ratio: FloatArray | None) -> dict[str, Any]:
    normalised, correlations = [], []
    for error, covariance in zip(data.errors, data.covariances, strict=True):
        sigma = np.sqrt(np.diag(covariance)[chosen])
        normalised.append(error[chosen] / sigma)
        if ratio is None:
            correlations.append(covariance[np.ix_(chosen, chosen)] / np.outer(sigma, sigma))
    if ratio is None:
        expected, (low, high) = 1.0, rms_band(correlations)
    else:
        block = ratio[np.ix_(chosen, chosen)]
        expected = float(np.sqrt(np.trace(block) / len(chosen)))
        low, high = rms_band([block / expected**2] * len(data.errors))
        low, high = low * expected, high * expected
    rms = _rms(normalised)
    size = float(np.mean([np.sqrt(np.mean(np.diag(c)[chosen])) for c in data.covariances]))
    return {
        "rms": rms,
        "expected": expected,
        "low": low,
        "high": high,
        "passed": low <= rms <= high,
        "sigma": size,
        "worst": NAMES[chosen[int(np.argmax(np.sqrt(np.mean(np.square(normalised), axis=0))))]],
    }


def _nees(data: CaseData, estimated: np.ndarray) -> dict[str, Any]:
    """Mean normalised estimation error squared per parameter (Bar-Shalom et al., *Estimation*, 5.4.2)."""
    total, count = 0.0, 0
    for error, covariance in zip(data.errors, data.covariances, strict=True):
        chosen = [i for i in estimated if covariance[i, i] > 0.0]
        total += float(error[chosen] @ np.linalg.solve(covariance[np.ix_(chosen, chosen)], error[chosen]))
        count += len(chosen)
    low, high = np.asarray(chi2.ppf(BAND, count)) / count
    mean = total / count
    return {"mean": mean, "low": float(low), "high": float(high), "passed": bool(low <= mean <= high)}


def _rms(parts: list[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.square(np.concatenate(parts)))))
