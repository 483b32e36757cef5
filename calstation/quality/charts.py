"""Control charts of single values over time: individuals and moving range, EWMA, CUSUM, and Nelson's rules.

Sources: D. C. Montgomery, *Introduction to Statistical Quality Control*, 7th ed., 2013, chapters 6 and 9;
NIST/SEMATECH *e-Handbook of Statistical Methods*, section 6.3; L. S. Nelson, *The Shewhart Control Chart: Tests for
Special Causes*, Journal of Quality Technology 16(4), 1984, 237-239.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from calstation.errors import InputError
from calstation.physics import BoolArray, FloatArray, IntArray

#: Mean and standard deviation of the range of two values from a normal distribution, in sigmas (d2 and d3 for n = 2).
D2 = 2.0 / math.sqrt(math.pi)
D3 = math.sqrt(2.0 - 4.0 / math.pi)
#: Limits of the individuals in mean moving ranges (E2), and upper limit of the moving range (D4).
E2 = 3.0 / D2
D4 = 1.0 + 3.0 * D3 / D2

#: Numbers of Nelson's rules.
RULES = (1, 2, 3, 4, 5, 6, 7, 8)

#: Fewest values from which a chart's limits can be estimated.
_LEAST = 2


@dataclass(frozen=True)
class Signals:
    """Points at which a chart signals, in order of the points."""

    index: IntArray  #: Index of the point that completes the pattern, shape (m,).
    rule: IntArray  #: Nelson's rule, shape (m,).

    def count(self, rule: int) -> int:
        """Return the number of signals of a rule."""
        return int(np.count_nonzero(self.rule == rule))


@dataclass(frozen=True)
class IndividualsChart:
    """Individuals chart with its chart of moving ranges."""

    values: FloatArray  #: Shape (n,).
    center: float
    sigma: float  #: Standard deviation of a value in the short term.
    low: float  #: Lower control limit.
    high: float  #: Upper control limit.
    ranges: FloatArray  #: Moving ranges of two successive values, shape (n - 1,).
    range_center: float
    range_high: float  #: Upper control limit of the moving ranges; the lower is 0.
    signals: Signals  #: Of the individuals, by Nelson's rules.
    range_signals: IntArray  #: Indices of the values that end a moving range above its limit.


@dataclass(frozen=True)
class EwmaChart:
    """Chart of the exponentially weighted moving average."""

    values: FloatArray  #: Shape (n,).
    average: FloatArray  #: Exponentially weighted moving average, shape (n,).
    center: float
    sigma: float  #: Standard deviation of a value.
    low: FloatArray  #: Lower control limit at each point, shape (n,).
    high: FloatArray  #: Upper control limit at each point, shape (n,).
    weight: float  #: Weight of the newest value (lambda).
    width: float  #: Distance of the limits in sigmas of the average (L).
    signals: IntArray  #: Indices of the points beyond the limits.


@dataclass(frozen=True)
class CusumChart:
    """Tabular CUSUM of both sides, in sigmas of a value."""

    values: FloatArray  #: Shape (n,).
    upper: FloatArray  #: Sum of what exceeds center + k sigma, shape (n,).
    lower: FloatArray  #: Sum of what falls below center - k sigma, shape (n,), not negative.
    center: float
    sigma: float
    allowance: float  #: k, sigmas.
    decision: float  #: h, sigmas.
    signals_high: IntArray  #: Indices of the points at which `upper` exceeds h.
    signals_low: IntArray  #: Indices of the points at which `lower` exceeds h.


def individuals_chart(
    values: FloatArray, *, center: float | None = None, sigma: float | None = None, baseline: int | None = None
) -> IndividualsChart:
    """Return the individuals and moving range chart of values in the order of their time.

    Parameters
    ----------
    values
        Shape (n,), any unit.
    center, sigma
        Mean and standard deviation of the process if they are known; otherwise the mean of the baseline, and its
        mean moving range divided by d2.
    baseline
        Number of first values from which the limits are estimated; all by default.

    Raises
    ------
    InputError
        There are fewer than two values in the baseline.
    """
    center, sigma = _center_and_sigma(values, center, sigma, baseline)
    ranges = np.abs(np.diff(values))
    range_high = D4 * D2 * sigma
    return IndividualsChart(
        values=values,
        center=center,
        sigma=sigma,
        low=center - 3.0 * sigma,
        high=center + 3.0 * sigma,
        ranges=ranges,
        range_center=D2 * sigma,
        range_high=range_high,
        signals=nelson_signals(values, center, sigma),
        range_signals=np.flatnonzero(ranges > range_high) + 1,
    )


def ewma_chart(
    values: FloatArray,
    *,
    weight: float = 0.2,
    width: float = 2.86,
    center: float | None = None,
    sigma: float | None = None,
    baseline: int | None = None,
) -> EwmaChart:
    """Return the chart of the exponentially weighted moving average with the exact limits of every point.

    `weight` is lambda, `width` L in sigmas; the defaults have an in-control average run length near 370 (J. M. Lucas
    and M. S. Saccucci, Technometrics 32(1), 1990, 1-12). The other parameters are those of `individuals_chart`.
    """
    center, sigma = _center_and_sigma(values, center, sigma, baseline)
    average, _ = lfilter([weight], [1.0, weight - 1.0], values - center, zi=[0.0])
    average = np.asarray(average) + center
    remaining = np.cumprod(np.full(len(values), (1.0 - weight) ** 2))  # (1 - lambda)^2n; a power takes longer
    spread = width * sigma * np.sqrt(weight / (2.0 - weight) * (1.0 - remaining))
    beyond = np.abs(average - center) > spread
    return EwmaChart(
        values, average, center, sigma, center - spread, center + spread, weight, width, np.flatnonzero(beyond)
    )


def cusum_chart(
    values: FloatArray,
    *,
    allowance: float = 0.5,
    decision: float = 4.77,
    center: float | None = None,
    sigma: float | None = None,
    baseline: int | None = None,
) -> CusumChart:
    """Return the tabular CUSUM of both sides; it does not start again after a signal.

    `allowance` is k and `decision` h, both in sigmas; the defaults have an in-control average run length of 370
    (D. M. Hawkins, Journal of Quality Technology 25(4), 1993, 248-261). The other parameters are those of
    `individuals_chart`.
    """
    center, sigma = _center_and_sigma(values, center, sigma, baseline)
    z = (values - center) / sigma if sigma > 0.0 else np.zeros(len(values))
    upper, lower = _one_sided(z - allowance), _one_sided(-z - allowance)
    high, low = np.flatnonzero(upper > decision), np.flatnonzero(lower > decision)
    return CusumChart(values, upper, lower, center, sigma, allowance, decision, high, low)


def nelson_signals(values: FloatArray, center: float, sigma: float) -> Signals:
    """Return the signals of Nelson's eight rules, each at the point that completes its pattern.

    1: one point beyond 3 sigma. 2: nine in a row on one side of the center. 3: six in a row, each above or each below
    the one before. 4: fourteen in a row, alternately up and down. 5: two of three beyond 2 sigma on one side. 6: four
    of five beyond 1 sigma on one side. 7: fifteen in a row within 1 sigma. 8: eight in a row beyond 1 sigma. A point
    completes rules 5 and 6 only if it is itself beyond.
    """
    deviation = values - center
    above, below = deviation > 0.0, deviation < 0.0
    steps = np.sign(np.diff(values))
    turns = np.concatenate([[False, False], steps[1:] * steps[:-1] < 0.0])[: len(values)]
    rising, falling = (np.concatenate([[False], steps == sign])[: len(values)] for sign in (1.0, -1.0))
    beyond = {k: (deviation > k * sigma, deviation < -k * sigma) for k in (1, 2, 3)}
    outside = beyond[1][0] | beyond[1][1]
    found = {
        1: beyond[3][0] | beyond[3][1],
        2: _recent(above, 9, 9) | _recent(below, 9, 9),
        3: _recent(rising, 5, 5) | _recent(falling, 5, 5),
        4: _recent(turns, 12, 12),
        5: _on_a_side(beyond[2], 2, 3),
        6: _on_a_side(beyond[1], 4, 5),
        7: _recent(~outside, 15, 15),
        8: _recent(outside, 8, 8),
    }
    index = np.concatenate([np.flatnonzero(found[rule]) for rule in RULES])
    rule = np.concatenate([np.full(np.count_nonzero(found[rule]), rule) for rule in RULES])
    order = np.lexsort((rule, index))
    return Signals(index[order], rule[order])


def standardised(values: FloatArray, reference: float | FloatArray, sigmas: FloatArray) -> FloatArray:
    """Return (value - reference) / sigma of each run, which is comparable where runs of several schedules are mixed.

    All arrays have shape (n,) and the same unit; `sigmas` are the runs' own standard deviations.
    """
    return (values - reference) / sigmas


def _center_and_sigma(
    values: FloatArray, center: float | None, sigma: float | None, baseline: int | None
) -> tuple[float, float]:
    """Return what is given, and else the mean and the mean moving range over d2 of the baseline."""
    known = values[:baseline]
    if (center is None or sigma is None) and len(known) < _LEAST:
        raise InputError("quality.too_few", count=len(known), least=_LEAST)
    if center is None:
        center = float(np.mean(known))
    if sigma is None:
        sigma = float(np.mean(np.abs(np.diff(known)))) / D2
    return center, sigma


def _one_sided(steps: FloatArray) -> FloatArray:
    """Return S_i = max(0, S_(i-1) + step_i) as the cumulative sum less its smallest value so far."""
    total = np.cumsum(steps)
    least = np.minimum(np.minimum.accumulate(total), 0.0) if len(total) else total
    return np.asarray(total - least)


def _recent(flags: BoolArray, least: int, length: int) -> BoolArray:
    """Return the points with at least `least` flags among the last `length` points, fewer at the beginning."""
    total = np.cumsum(np.concatenate([np.zeros(length, dtype=np.int64), flags]))
    return np.asarray(total[length:] - total[:-length] >= least)


def _on_a_side(sides: tuple[BoolArray, BoolArray], least: int, length: int) -> BoolArray:
    """Return the flagged points that have at least `least` flags of their side among the last `length` points."""
    high, low = (flags & _recent(flags, least, length) for flags in sides)
    return high | low
