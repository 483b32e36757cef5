"""Control charts of single values over time: individuals and moving range, EWMA, CUSUM, and Nelson's rules.

Sources: D. C. Montgomery, *Introduction to Statistical Quality Control*, 7th ed., 2013, chapters 6 and 9;
NIST/SEMATECH *e-Handbook of Statistical Methods*, section 6.3; L. S. Nelson, *The Shewhart Control Chart: Tests for
Special Causes*, Journal of Quality Technology 16(4), 1984, 237-239.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calstation.errors import InputError
from calstation.physics import BoolArray, FloatArray, IntArray

#: Mean and standard deviation of the range of two values from a normal distribution, in sigmas (d2 and d3 for n = 2).
D2 = 2.0 / math.sqrt(math.pi)
D3 = math.sqrt(2.0 - 4.0 / math.pi)
#: Upper limit of the moving range in mean moving ranges.
D4 = 1.0 + 3.0 * D3 / D2

#: Numbers of Nelson's rules.
RULES = (1, 2, 3, 4, 5, 6, 7, 8)

#: Number of first values from which center and standard deviation are estimated; later values do not change them.
BASELINE = 100

#: Smallest number of values for an estimate.
_MIN_COUNT = 2
#: Number of values that `restarted_ewma_chart` initially processes after a signal.
_RESTART_LENGTH = 512
#: Half the logarithm of a number that is negligible compared with 1.
_HALF_LOG_EPSILON = -20.0


@dataclass(frozen=True)
class Widths:
    """Distances of the charts' limits from the center, in sigmas."""

    individuals: float = 3.0
    ewma: float = 2.86  #: L, in sigmas of the average.
    cusum: float = 4.77  #: h.


#: Limits for a known center and sigma: one false alarm of each chart in 370 values (Montgomery; J. M. Lucas and
#: M. S. Saccucci, Technometrics 32(1), 1990, 1-12; D. M. Hawkins, Journal of Quality Technology 25(4), 1993, 248-261).
KNOWN_WIDTHS = Widths()
#: Limits for a center and sigma estimated from `BASELINE` values, whose errors would otherwise cause 50 % more alarms:
#: one false alarm in 370 values on average over baselines. The limit of the individuals is exact,
#: t(0.99865) with the degrees of freedom of the mean moving range, times sqrt(1 + 1 / BASELINE) (F. S. Hillier, Journal
#: of Quality Technology 1(1), 1969, 17-26); the limits of EWMA and CUSUM are simulated (L. A. Jones, Journal of Quality
#: Technology 34(3), 2002, 277-288; L. A. Jones, C. W. Champ and S. E. Rigdon, Journal of Quality Technology 36(1),
#: 2004, 95-108).
ESTIMATED_WIDTHS = Widths(3.13, 3.06, 5.35)

#: Origin of a chart's center and sigma: the first `BASELINE` values, all values if there are fewer, or given values.
Source = Literal["baseline", "retrospective", "stated"]


@dataclass(frozen=True)
class Process:
    """Center and short-term standard deviation of a process in control."""

    center: float
    sigma: float
    baseline: int = 0  #: Number of values used for the estimate; 0 if center and sigma are given.

    @classmethod
    def estimated(cls, values: FloatArray, center: float | None = None) -> "Process":
        """Return mean, and mean moving range over d2, of the first `BASELINE` values, or of all if there are fewer.

        A known `center` replaces the mean. Raises InputError if there are fewer than two values.
        """
        baseline = values[:BASELINE]
        if len(baseline) < _MIN_COUNT:
            raise InputError("quality.too_few", count=len(baseline), least=_MIN_COUNT)
        mean = float(np.mean(baseline)) if center is None else center
        return cls(mean, float(np.mean(np.abs(np.diff(baseline)))) / D2, len(baseline))

    @property
    def source(self) -> Source:
        """Origin of the values."""
        return "stated" if self.baseline == 0 else "baseline" if self.baseline == BASELINE else "retrospective"

    @property
    def widths(self) -> Widths:
        """Distances of the limits for charts of this process."""
        return KNOWN_WIDTHS if self.baseline == 0 else ESTIMATED_WIDTHS


@dataclass(frozen=True)
class Signals:
    """Points at which a chart signals, in chronological order."""

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
    sigma: float  #: Short-term standard deviation of a value.
    low: float  #: Lower control limit.
    high: float  #: Upper control limit.
    #: Moving ranges of two successive values, shape (n - 1,), or (n,) with the range of an earlier and the first value.
    ranges: FloatArray
    range_center: float
    range_high: float  #: Upper control limit of the moving ranges; the lower is 0.
    signals: Signals  #: Signals of the individuals, by Nelson's rules.
    range_signals: IntArray  #: Indices of the values that end a moving range above its limit.

    def after(self, count: int) -> "IndividualsChart":
        """Return the chart without the first `count` values."""
        index, rule = self.signals.index, self.signals.rule
        return replace(
            self,
            values=self.values[count:],
            ranges=self.ranges[max(0, count - 1) :],
            signals=Signals(_after(index, count), rule[index >= count]),
            range_signals=_after(self.range_signals, count),
        )


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

    def after(self, count: int) -> "EwmaChart":
        """Return the chart without the first `count` values, which its average still includes."""
        names = ("values", "average", "low", "high")
        shown = {name: getattr(self, name)[count:] for name in names}
        return replace(self, **shown, signals=_after(self.signals, count))


@dataclass(frozen=True)
class CusumChart:
    """Tabular CUSUM of both sides, in sigmas of a value."""

    values: FloatArray  #: Shape (n,).
    upper: FloatArray  #: Cumulative sum of the excess over center + k sigma, shape (n,).
    lower: FloatArray  #: Cumulative sum of the shortfall below center - k sigma, shape (n,), not negative.
    center: float
    sigma: float
    allowance: float  #: k, sigmas.
    decision: float  #: h, sigmas.
    signals_high: IntArray  #: Indices of the points at which `upper` exceeds h.
    signals_low: IntArray  #: Indices of the points at which `lower` exceeds h.

    def after(self, count: int) -> "CusumChart":
        """Return the chart without the first `count` values, which its sums still include."""
        shown = {name: getattr(self, name)[count:] for name in ("values", "upper", "lower")}
        high, low = (_after(signals, count) for signals in (self.signals_high, self.signals_low))
        return replace(self, **shown, signals_high=high, signals_low=low)


def individuals_chart(
    values: FloatArray, center: float, sigma: float, *, width: float = KNOWN_WIDTHS.individuals
) -> IndividualsChart:
    """Return the individuals and moving range chart of values in chronological order.

    Parameters
    ----------
    values : shape (n,), any unit
    center, sigma : mean and standard deviation of the process in control
    width : distance of the limits of the individuals from the center, in sigmas
    """
    ranges = np.abs(np.diff(values))
    range_high = D4 * D2 * sigma
    return IndividualsChart(
        values=values,
        center=center,
        sigma=sigma,
        low=center - width * sigma,
        high=center + width * sigma,
        ranges=ranges,
        range_center=D2 * sigma,
        range_high=range_high,
        signals=nelson_signals(values, center, sigma, width),
        range_signals=np.flatnonzero(ranges > range_high) + 1,
    )


def ewma_chart(
    values: FloatArray, center: float, sigma: float, *, weight: float = 0.2, width: float = KNOWN_WIDTHS.ewma
) -> EwmaChart:
    """Return the chart of the exponentially weighted moving average with the exact limits of every point.

    Parameters
    ----------
    values, center, sigma : as in `individuals_chart`
    weight, width : lambda, and L in sigmas of the average
    """
    from scipy.signal import lfilter  # takes 0.3 s to import

    average, _ = lfilter([weight], [1.0, weight - 1.0], values - center, zi=[0.0])
    average = np.asarray(average) + center
    spread = width * sigma * _ewma_sigmas(weight, len(values))
    is_outside = np.abs(average - center) > spread
    return EwmaChart(
        values, average, center, sigma, center - spread, center + spread, weight, width, np.flatnonzero(is_outside)
    )


def restarted_ewma_chart(values: FloatArray, center: float, sigma: float, *, weight: float, width: float) -> EwmaChart:
    """Return the chart of `ewma_chart`, with average and limits restarted after each signal."""
    parts: list[EwmaChart] = []
    signals: list[int] = []
    first, size = 0, _RESTART_LENGTH
    while first < len(values):
        part = ewma_chart(values[first : first + size], center, sigma, weight=weight, width=width)
        if not len(part.signals) and first + size < len(values):
            size *= 2
            continue
        stop = int(part.signals[0]) + 1 if len(part.signals) else len(part.values)
        signals += [first + stop - 1] if len(part.signals) else []
        parts.append(replace(part, average=part.average[:stop], low=part.low[:stop], high=part.high[:stop]))
        first, size = first + stop, _RESTART_LENGTH
    average, low, high = (
        np.concatenate([np.empty(0), *(getattr(part, name) for part in parts)]) for name in ("average", "low", "high")
    )
    return EwmaChart(values, average, center, sigma, low, high, weight, width, np.array(signals, dtype=np.int64))


def cusum_chart(
    values: FloatArray, center: float, sigma: float, *, allowance: float = 0.5, decision: float = KNOWN_WIDTHS.cusum
) -> CusumChart:
    """Return the two-sided tabular CUSUM; it does not restart after a signal.

    Parameters
    ----------
    values, center, sigma : as in `individuals_chart`
    allowance, decision : k and h, in sigmas
    """
    z = (values - center) / sigma if sigma > 0.0 else np.zeros(len(values))
    upper, lower = _one_sided(z - allowance), _one_sided(-z - allowance)
    high, low = np.flatnonzero(upper > decision), np.flatnonzero(lower > decision)
    return CusumChart(values, upper, lower, center, sigma, allowance, decision, high, low)


def nelson_signals(values: FloatArray, center: float, sigma: float, width: float = KNOWN_WIDTHS.individuals) -> Signals:
    """Return the signals of Nelson's eight rules, each at the point that completes its pattern.

    1: one point beyond `width` sigmas, which is 3 in Nelson's paper. 2: nine in a row on one side of the center. 3: six
    in a row, each above or each below the previous one. 4: fourteen in a row, alternately up and down. 5: two of three
    beyond 2 sigma on one side. 6: four of five beyond 1 sigma on one side. 7: fifteen in a row within 1 sigma. 8: eight
    in a row beyond 1 sigma. A point completes rules 5 and 6 only if the point itself is beyond the limit.
    """
    deviation = values - center
    above, below = deviation > 0.0, deviation < 0.0
    steps = np.sign(np.diff(values))
    turns = np.concatenate([[False, False], steps[1:] * steps[:-1] < 0.0])[: len(values)]
    rising, falling = (np.concatenate([[False], steps == sign])[: len(values)] for sign in (1.0, -1.0))
    exceeding = {k: (deviation > k * sigma, deviation < -k * sigma) for k in (1, 2)}
    outside = exceeding[1][0] | exceeding[1][1]
    flags = {
        1: np.abs(deviation) > width * sigma,
        2: _frequent(above, 9, 9) | _frequent(below, 9, 9),
        3: _frequent(rising, 5, 5) | _frequent(falling, 5, 5),
        4: _frequent(turns, 12, 12),
        5: _frequent_on_one_side(exceeding[2], 2, 3),
        6: _frequent_on_one_side(exceeding[1], 4, 5),
        7: _frequent(~outside, 15, 15),
        8: _frequent(outside, 8, 8),
    }
    index = np.concatenate([np.flatnonzero(flags[rule]) for rule in RULES])
    rule = np.concatenate([np.full(np.count_nonzero(flags[rule]), rule) for rule in RULES])
    order = np.lexsort((rule, index))
    return Signals(index[order], rule[order])


def _after(index: IntArray, count: int) -> IntArray:
    """Return the indices of values after the first `count` values were removed."""
    return np.asarray(index[index >= count] - count)


def _ewma_sigmas(weight: float, count: int) -> FloatArray:
    """Return the standard deviation of the average of the first 1, 2, ... values, in sigmas of a value."""
    sigmas = np.full(count, math.sqrt(weight / (2.0 - weight)))
    first = sigmas[: math.ceil(_HALF_LOG_EPSILON / math.log1p(-weight))]  # later powers are 0 and slow to compute
    first *= np.sqrt(1.0 - (1.0 - weight) ** (2.0 * np.arange(1, len(first) + 1)))
    return sigmas


def _one_sided(steps: FloatArray) -> FloatArray:
    """Return S_i = max(0, S_(i-1) + step_i), computed as the cumulative sum minus its running minimum."""
    sums = np.cumsum(steps)
    minimum = np.minimum(np.minimum.accumulate(sums), 0.0) if len(sums) else sums
    return np.asarray(sums - minimum)


def _frequent(flags: BoolArray, min_count: int, length: int) -> BoolArray:
    """Return a mask of the points with at least `min_count` flags among the last `length` points."""
    padded = np.concatenate([np.zeros(length - 1, dtype=np.uint8), flags])
    return np.asarray(sum(padded[k : k + len(flags)] for k in range(length)) >= np.uint8(min_count))


def _frequent_on_one_side(sides: tuple[BoolArray, BoolArray], min_count: int, length: int) -> BoolArray:
    """Return a mask of flagged points with at least `min_count` flags on their side among the last `length` points."""
    high, low = (flags & _frequent(flags, min_count, length) for flags in sides)
    return high | low
