"""Process capability, short-term (Cp, Cpk) and overall (Pp, Ppk), with confidence intervals.

Sources: S. Kotz and N. L. Johnson, *Process Capability Indices*, 1993; A. F. Bissell, *How reliable is your capability
index?*, Applied Statistics 39(3), 1990, 331-340; NIST/SEMATECH *e-Handbook of Statistical Methods*, section 6.1.6.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import gammaincinv, ndtri

from calstation.errors import InputError
from calstation.physics import FloatArray
from calstation.quality.charts import D2

#: Smallest number of values for an index.
_MIN_COUNT = 3
#: Largest number of values, evenly spaced, in the normality test, which would reject irrelevant deviations of more
#: values.
_MAX_TESTED = 1000
#: Variance of the mean of n - 1 moving ranges of normal values, times (n - 1), relative to the square of the mean: the
#: variance of a range and twice its covariance with the next range, which shares a value, for n much larger than 1.
_RANGE_VARIANCE = (math.pi / 2 - 1) + 2 * (math.sqrt(3) / 2 + math.pi / 12 - 1)


@dataclass(frozen=True)
class Interval:
    """A value with its confidence interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Capability:
    """Capability of a parameter relative to its limits."""

    count: int
    mean: float
    sigma_within: float  #: Short-term standard deviation, from the mean moving range.
    sigma_overall: float  #: Standard deviation of all values.
    low: float  #: Lower limit.
    high: float  #: Upper limit.
    confidence: float
    cp: Interval  #: Width of the limits divided by 6 `sigma_within`.
    cpk: Interval  #: Distance of the nearer limit divided by 3 `sigma_within`.
    pp: Interval  #: As `cp`, with `sigma_overall`.
    ppk: Interval  #: As `cpk`, with `sigma_overall`.
    outside: int  #: Number of values outside the limits.
    #: p-value of the Anderson-Darling test of the normal distribution assumed by the indices, from 0.01 (or less) to
    #: 0.15 (or more).
    normality_p: float

    @property
    def normal(self) -> bool:
        """Whether the test does not reject a normal distribution at 5 %."""
        return self.normality_p >= 0.05


def capability(values: FloatArray, low: float, high: float, *, confidence: float = 0.95) -> Capability:
    """Return the capability of values in chronological order, in the unit of the limits.

    The intervals of Cp and Pp follow from the standard deviation (chi-square), the intervals of Cpk and Ppk are
    Bissell's. The overall standard deviation has n - 1 degrees of freedom, the standard deviation from moving ranges
    about 0.605 (n - 1).

    Parameters
    ----------
    values : shape (n,)
    low, high : limits
    confidence : probability of the intervals

    Raises
    ------
    InputError : if there are fewer than three values, or if they are all equal
    """
    count = len(values)
    if count < _MIN_COUNT:
        raise InputError("quality.too_few", count=count, least=_MIN_COUNT)
    mean, overall = float(np.mean(values)), float(np.std(values, ddof=1))
    if not overall > 0.0:
        raise InputError("quality.no_spread", count=count)
    within = float(np.mean(np.abs(np.diff(values)))) / D2
    dof = moving_range_dof(count)
    side, width = min(mean - low, high - mean), high - low
    return Capability(
        count=count,
        mean=mean,
        sigma_within=within,
        sigma_overall=overall,
        low=low,
        high=high,
        confidence=confidence,
        cp=cp_interval(width / (6.0 * within), dof, confidence),
        cpk=cpk_interval(side / (3.0 * within), count, dof, confidence),
        pp=cp_interval(width / (6.0 * overall), count - 1, confidence),
        ppk=cpk_interval(side / (3.0 * overall), count, count - 1, confidence),
        outside=int(np.count_nonzero((values < low) | (values > high))),
        normality_p=_normality(values[:: -(-count // _MAX_TESTED)]),
    )


def cp_interval(index: float, dof: float, confidence: float) -> Interval:
    """Return Cp or Pp with the confidence interval for a standard deviation with `dof` degrees of freedom."""
    low, high = _factors(dof, confidence)
    return Interval(index, index * low, index * high)


def cpk_interval(index: float, count: int, dof: float, confidence: float) -> Interval:
    """Return Cpk or Ppk with Bissell's normal approximation to its confidence interval."""
    z = float(ndtri(0.5 + confidence / 2.0))
    half = z * math.sqrt(1.0 / (9.0 * count) + index**2 / (2.0 * dof))
    return Interval(index, index - half, index + half)


def moving_range_dof(count: int) -> float:
    """Return the degrees of freedom of the standard deviation from the mean moving range of `count` normal values.

    They equal the degrees of freedom of the chi distribution with the same relative variance, 1 / (2 dof).
    """
    n = count - 1
    shared = 2.0 * (math.sqrt(3) / 2 + math.pi / 12 - 1) / n  # the last range has no successor
    return n / (2.0 * (_RANGE_VARIANCE - shared))


@lru_cache
def _factors(dof: float, confidence: float) -> tuple[float, float]:
    """Return the confidence limits of the reciprocal of a standard deviation relative to its estimate."""
    tail = (1.0 - confidence) / 2.0
    low, high = (float(math.sqrt(2.0 * gammaincinv(dof / 2.0, p) / dof)) for p in (tail, 1.0 - tail))
    return low, high


def _normality(values: FloatArray) -> float:
    from scipy import stats  # takes 0.3 s to import

    return float(stats.anderson(values, "norm", method="interpolate").pvalue)  # type: ignore[call-overload]
