"""Control charts reproduce published limits, sums and signal rates."""

import math

import numpy as np
import pytest
from scipy import stats

from calstation.errors import InputError
from calstation.physics import FloatArray
from calstation.quality import BASELINE, Process, cusum_chart, ewma_chart, individuals_chart, nelson_signals
from calstation.quality.charts import D2, D4, ESTIMATED_WIDTHS, KNOWN_WIDTHS, restarted_ewma_chart


def numbers(text: str) -> FloatArray:
    """Return an array from numbers separated by spaces."""
    return np.array(text.split(), dtype=float)


#: NIST/SEMATECH e-Handbook of Statistical Methods, 6.3.2.2, flow rates of ten batches.
FLOW = np.array([49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1])

#: NIST/SEMATECH e-Handbook, 6.3.2.3: values, and the two sums for mean 325, k = 0.3175 and h = 4.1959 of the values.
CUSUM_VALUES = numbers(
    """
    324.925 324.675 324.725 324.350 325.350 325.225 324.125 324.525 325.225 324.600 324.625 325.150
    328.325 327.250 327.825 328.500 326.675 327.775 326.875 328.350
    """
)
CUSUM_HIGH = [0, 0, 0, 0, 0.03, 0, 0, 0, 0, 0, 0, 0, 3.01, 4.94, 7.45, 10.63, 11.99, 14.44, 16.00, 19.04]
CUSUM_LOW = [0, 0.01, 0, 0.33, 0, 0, 0.56, 0.72, 0.17, 0.25, 0.31, 0, 0, 0, 0, 0, 0, 0, 0, 0]

#: NIST/SEMATECH e-Handbook, 6.3.2.4: values and their EWMA for mean 50, sigma 2.0539 and lambda 0.3.
EWMA_VALUES = numbers(
    """
    52.0 47.0 53.0 49.3 50.1 47.0 51.0 50.1 51.2 50.5 49.6 47.6 49.9 51.3 47.8 51.2 52.6 52.4 53.6 52.1
    """
)
EWMA_AVERAGE = numbers(
    """
    50.60 49.52 50.56 50.18 50.16 49.21 49.75 49.85 50.26 50.33 50.11 49.36 49.52 50.05 49.38 49.92
    50.73 51.23 51.94 51.99
    """
)

#: R package qcc 3.0, data set `viscosity` (Montgomery, 5th ed., 2005, p. 232); the first 20 are the trial samples.
VISCOSITY = numbers(
    """
    34.05 34.40 33.59 35.96 34.70 33.51 33.79 34.04 34.52 33.75 33.27 33.71 34.03 34.58 34.02 33.97
    34.05 34.04 33.73 34.05 34.39 33.75 33.40 33.27 34.65 34.80 34.55 35.40 34.75 34.50 34.70 34.29
    34.61 34.49 35.03
    """
)

#: R package qcc 3.0, data set `pistonrings`: means of the first 25 samples of five.
RINGS = numbers(
    """
    74.0102 74.0006 74.0080 74.0030 74.0034 73.9956 74.0000 73.9968 74.0042 73.9980 73.9942 74.0014
    73.9984 73.9902 74.0060 73.9966 74.0008 74.0074 73.9982 74.0092 73.9998 74.0016 74.0024 74.0052
    73.9982
    """
)


def test_chart_constants_are_valid_for_ranges_of_two_values() -> None:
    assert pytest.approx((1.128, 3.267), abs=1.5e-3) == (D2, D4)


def test_individuals_chart_agrees_with_the_nist_handbook() -> None:
    process = Process.estimated(FLOW)
    assert (process.baseline, process.source) == (10, "retrospective")
    chart = individuals_chart(FLOW, process.center, process.sigma)
    assert chart.center == pytest.approx(50.81)
    assert D2 * chart.sigma == pytest.approx(1.8778, abs=1e-4)
    assert (chart.low, chart.high) == pytest.approx((45.8159, 55.8041), abs=2e-3)  # 1.128 is rounded there
    assert chart.range_high == pytest.approx(3.267 * 1.8778, abs=1e-3)
    assert len(chart.signals.index) == len(chart.range_signals) == 0
    assert chart.ranges == pytest.approx([2.0, 2.3, 1.4, 3.5, 3.4, 1.4, 0.2, 1.2, 1.5])


def test_cusum_agrees_with_the_nist_handbook() -> None:
    chart = cusum_chart(CUSUM_VALUES, 325.0, 1.0, allowance=0.3175, decision=4.1959)
    assert chart.upper == pytest.approx(CUSUM_HIGH, abs=6e-3)
    assert chart.lower == pytest.approx(CUSUM_LOW, abs=6e-3)
    assert chart.signals_high.tolist() == [13, 14, 15, 16, 17, 18, 19]
    assert chart.signals_low.tolist() == []


def test_ewma_agrees_with_the_nist_handbook() -> None:
    chart = ewma_chart(EWMA_VALUES, 50.0, 2.0539, weight=0.3, width=3.0)
    assert chart.average == pytest.approx(EWMA_AVERAGE, abs=6e-3)
    assert (chart.low[-1], chart.high[-1]) == pytest.approx((47.4115, 52.5884), abs=2e-3)
    assert chart.high[0] == pytest.approx(50.0 + 3.0 * 0.3 * 2.0539)
    assert chart.signals.tolist() == []


def test_charts_agree_with_the_r_package_qcc() -> None:
    process = Process.estimated(VISCOSITY[:20])
    assert (process.center, process.sigma) == pytest.approx((34.088, 0.5076521), rel=4e-4)  # qcc has 1.128 for d2
    ewma = ewma_chart(VISCOSITY, process.center, process.sigma, width=2.7)
    limits = [(ewma.low[k], ewma.high[k]) for k in (0, 1, 34)]
    expected = [(33.81387, 34.36213), (33.73694, 34.43906), (33.63111, 34.54489)]
    assert np.array(limits) == pytest.approx(np.array(expected), abs=2e-4)
    rings = ewma_chart(RINGS, 74.00118, 0.009785039 / 5**0.5, width=3.0)
    limits = [(rings.low[k], rings.high[k]) for k in (0, 1, 24)]
    expected = [(73.99855, 74.00380), (73.99781, 74.00454), (73.99680, 74.00555)]
    assert np.array(limits) == pytest.approx(np.array(expected), abs=1e-5)


def test_cusum_equals_its_recursion() -> None:
    values = np.random.default_rng(1).normal(0.3, 1.0, 500)
    chart = cusum_chart(values, 0.0, 1.0)
    high = low = 0.0
    for k, value in enumerate(values):
        high, low = max(0.0, high + value - 0.5), max(0.0, low - value - 0.5)
        assert (chart.upper[k], chart.lower[k]) == pytest.approx((high, low), abs=1e-9)


#: For each rule: the shortest series in sigmas that signals, at its last point, and one that nearly does.
NELSON = {
    1: ([3.1], [2.9]),
    2: ([0.1, 0.2] * 4 + [0.1], [0.1, 0.2] * 4 + [-0.1]),
    3: ([0.0, 0.1, 0.2, 0.3, 0.4, 0.5], [0.0, 0.1, 0.2, 0.3, 0.4, 0.4]),
    4: ([0.1, -0.1] * 7, [0.1, -0.1] * 6 + [0.1, 0.1]),
    5: ([2.1, 0.0, 2.1], [2.1, 0.0, -2.1]),
    6: ([1.1, 1.1, 0.0, 1.1, 1.1], [1.1, 1.1, 0.0, 1.1, -1.1]),
    7: ([0.5, 0.4, -0.5] * 5, [0.5, 0.4, -0.5] * 4 + [0.5, 0.4, -1.1]),
    8: ([1.1, 1.2, -1.1, -1.2] * 2, [1.1, 1.2, -1.1, -1.2, 1.1, 1.2, -1.1, -0.9]),
}


@pytest.mark.parametrize("rule", NELSON)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_each_nelson_rule_signals_at_the_point_that_completes_its_pattern(rule: int, sign: float) -> None:
    signalling, quiet = (10.0 + sign * 2.0 * np.array(series) for series in NELSON[rule])
    found = nelson_signals(signalling, 10.0, 2.0)
    assert found.index[found.rule == rule].tolist() == [len(signalling) - 1]
    assert found.count(rule) == 1
    assert nelson_signals(quiet, 10.0, 2.0).count(rule) == 0
    assert nelson_signals(signalling[1:], 10.0, 2.0).count(rule) == 0


def test_signals_are_in_order_of_their_points() -> None:
    found = nelson_signals(np.array([0.0, 3.5, 0.0, 2.5, 3.5]), 0.0, 1.0)
    assert list(zip(found.index.tolist(), found.rule.tolist(), strict=True)) == [(1, 1), (3, 5), (4, 1), (4, 5)]


def test_too_few_values_are_refused_and_equal_values_are_charted() -> None:
    with pytest.raises(InputError) as caught:
        Process.estimated(np.array([1.0]))
    assert caught.value.code == "quality.too_few"
    assert Process.estimated(np.ones(20)) == Process(1.0, 0.0, 20)
    chart = individuals_chart(np.ones(20), 1.0, 0.0)
    assert (chart.low, chart.high, len(chart.signals.index)) == (1.0, 1.0, 20 - 14)  # all within 1 sigma: rule 7
    assert cusum_chart(np.ones(5), 1.0, 0.0).upper.tolist() == [0.0] * 5
    assert len(nelson_signals(np.array([]), 0.0, 1.0).index) == 0


def test_limits_are_estimated_from_the_baseline_values() -> None:
    values = np.random.default_rng(3).normal(5.0, 2.0, 400)
    process = Process.estimated(values[:BASELINE])
    moved = np.append(values[:BASELINE], values[BASELINE:] + 100.0)
    assert Process.estimated(values) == Process.estimated(moved) == process
    assert (process.baseline, process.source, process.widths) == (BASELINE, "baseline", ESTIMATED_WIDTHS)
    assert Process.estimated(values, 4.0) == Process(4.0, process.sigma, BASELINE)
    assert (Process(0.0, 1.0).source, Process(0.0, 1.0).widths) == ("stated", KNOWN_WIDTHS)


def test_restarted_chart_begins_again_after_each_signal() -> None:
    random = np.random.default_rng(9)
    values = np.concatenate([random.standard_normal(1500), 2.0 + random.standard_normal(300)])
    chart = restarted_ewma_chart(values, 0.0, 1.0, weight=0.1, width=3.0)
    average, count, signals = 0.0, 0, []
    for k, value in enumerate(values.tolist()):
        average, count = 0.9 * average + 0.1 * value, count + 1
        spread = 3.0 * math.sqrt(0.1 / 1.9 * (1.0 - 0.9 ** (2 * count)))
        assert (chart.average[k], chart.high[k]) == pytest.approx((average, spread))
        if abs(average) > spread:
            signals.append(k)
            average, count = 0.0, 0
    assert chart.signals.tolist() == signals
    assert len([k for k in signals if k >= 1500]) > 10
    assert len(restarted_ewma_chart(np.empty(0), 0.0, 1.0, weight=0.1, width=3.0).average) == 0


def run_length(first: list[int | None], length: int) -> tuple[float, float]:
    """Return the average run length from first signals of series of equal length, and its standard error.

    Run lengths in control are nearly geometric, so that series without a signal are censored ones.
    """
    ended = [k + 1 for k in first if k is not None]
    arl = (sum(ended) + length * (len(first) - len(ended))) / len(ended)
    return arl, arl / len(ended) ** 0.5


def test_false_alarm_rate_of_each_nelson_rule_is_its_pattern_probability() -> None:
    p = {k: float(stats.norm.sf(k)) for k in (1, 2, 3)}  # beyond k sigma on one side
    alternating = 199360981  # alternating permutations of 14 values that begin upwards (OEIS A000111)
    rates = {
        1: 2 * p[3],
        2: 2 / 2**9,
        3: 2 / math.factorial(6),
        4: 2 * alternating / math.factorial(14),
        5: 2 * p[2] * (1 - (1 - p[2]) ** 2),
        6: 2 * p[1] * float(stats.binom.sf(2, 4, p[1])),
        7: (1 - 2 * p[1]) ** 15,
        8: (2 * p[1]) ** 8,
    }
    count = 1_000_000
    found = nelson_signals(np.random.default_rng(7).normal(size=count), 0.0, 1.0)
    for rule, rate in rates.items():
        # successive points share values: the variance of a count is up to five times that of separate points
        assert found.count(rule) == pytest.approx(count * rate, abs=4.0 * (5.0 * count * rate) ** 0.5), rule


def test_false_alarm_rates_agree_with_published_values() -> None:
    random = np.random.default_rng(11)
    alarms = nelson_signals(random.normal(size=1_000_000), 0.0, 1.0).count(1)
    rate = 0.0026998  # beyond 3 sigma: ARL 370.4
    assert alarms == pytest.approx(1e6 * rate, abs=3.0 * (1e6 * rate) ** 0.5)
    length, ewma, cusum = 1500, [], []
    for _ in range(2500):
        values = random.normal(size=length)
        found = ewma_chart(values, 0.0, 1.0).signals
        ewma.append(int(found[0]) if len(found) else None)
        sums = cusum_chart(values, 0.0, 1.0)
        firsts = [int(s[0]) for s in (sums.signals_high, sums.signals_low) if len(s)]
        cusum.append(min(firsts) if firsts else None)
    for found_first, published in ((ewma, 370.0), (cusum, 370.0)):
        arl, error = run_length(found_first, length)
        # the exact first limits of the EWMA are narrower than the asymptotic ones of the published value, by 2 %
        assert arl == pytest.approx(published, abs=3.0 * error + 0.02 * published)


@pytest.mark.long
def test_moving_range_chart_signals_more_often_than_the_other_charts() -> None:
    """The average run length is documented in docs/how-to/quality.md; P(range > D4) = P(|x| > D4 d2 / sqrt 2)."""
    random, length = np.random.default_rng(12), 2000
    found = [individuals_chart(random.standard_normal(length), 0.0, 1.0) for _ in range(3000)]
    first = [int(chart.range_signals[0]) if len(chart.range_signals) else None for chart in found]
    arl, error = run_length(first, length)
    assert arl == pytest.approx(120.0, abs=3.0 * error + 2.0)


@pytest.mark.long
def test_baseline_limits_keep_the_average_false_alarm_rate() -> None:
    """One false alarm in 370 values, as for a known process; documented in docs/how-to/quality.md."""
    random, length, series = np.random.default_rng(13), 1200, 1500
    counts = dict.fromkeys(("individuals", "ewma", "cusum", "range"), 0)
    for _ in range(series):
        process = Process.estimated(random.standard_normal(BASELINE))
        center, sigma, widths = process.center, process.sigma, process.widths
        values = random.standard_normal(length)
        chart = individuals_chart(values, center, sigma, width=widths.individuals)
        counts["individuals"] += chart.signals.count(1)
        counts["range"] += len(chart.range_signals)
        counts["ewma"] += len(restarted_ewma_chart(values, center, sigma, weight=0.2, width=widths.ewma).signals)
        first = 0
        while first < length:
            sums = cusum_chart(values[first:], center, sigma, decision=widths.cusum)
            signals = np.concatenate([sums.signals_high, sums.signals_low])
            if not len(signals):
                break
            counts["cusum"] += 1
            first += int(signals.min()) + 1
    rates = {name: series * length / count for name, count in counts.items()}
    for name in ("individuals", "ewma", "cusum"):
        assert rates[name] == pytest.approx(370.0, rel=0.12), rates
    assert rates["range"] == pytest.approx(90.0, rel=0.1)
