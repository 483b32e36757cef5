"""Capability indices agree with published examples, and their intervals have the stated coverage."""

import numpy as np
import pytest
from scipy import stats

from calstation.errors import InputError
from calstation.quality import capability
from calstation.quality.capability import cp_interval, cpk_interval, moving_range_dof
from calstation.quality.charts import D2


def test_indices_and_intervals_agree_with_the_r_package_qcc() -> None:
    # qcc 3.0, processCapability of the first 25 samples of `pistonrings`, limits 73.95 and 74.05
    center, sigma, count = 74.00118, 0.009785039, 125
    cp = cp_interval(0.1 / (6 * sigma), count - 1, 0.95)
    assert (cp.value, cp.low, cp.high) == pytest.approx((1.703, 1.491, 1.915), abs=6e-4)
    cpk = cpk_interval((74.05 - center) / (3 * sigma), count, count - 1, 0.95)
    assert (cpk.value, cpk.low, cpk.high) == pytest.approx((1.663, 1.448, 1.878), abs=6e-4)


def test_indices_agree_with_the_nist_handbook() -> None:
    # e-Handbook 6.1.6: limits 8 and 20, mean 16 and sigma 2: Cp 1.0, Cpk 0.6667
    values = 16.0 + 2.0 * np.array([-1.0, 1.0]) * np.sqrt(0.5)
    values = np.concatenate([values, [16.0]])  # standard deviation of three values: 2 sqrt(0.5)
    values = 16.0 + (values - 16.0) * 2.0 / np.std(values, ddof=1)
    found = capability(values, 8.0, 20.0)
    assert (found.pp.value, found.ppk.value) == pytest.approx((1.0, 2.0 / 3.0))


def test_nearer_limit_determines_ppk_and_values_outside_limits_are_counted() -> None:
    values = np.random.default_rng(3).normal(0.0, 1.0, 200)
    upper, lower = capability(values, -9.0, 3.0), capability(-values, -3.0, 9.0)
    assert upper.ppk.value == pytest.approx(lower.ppk.value)
    assert upper.ppk.value == pytest.approx((3.0 - upper.mean) / (3.0 * upper.sigma_overall))
    assert capability(values, -1.0, 1.0).outside == np.count_nonzero(np.abs(values) > 1.0)


def test_slow_drift_lowers_only_the_overall_indices() -> None:
    values = np.random.default_rng(4).normal(0.0, 1.0, 400) + np.linspace(-3.0, 3.0, 400)
    found = capability(values, -6.0, 6.0)
    assert found.cp.value == pytest.approx(2.0, rel=0.15)
    assert found.pp.value < 1.1


def test_degrees_of_freedom_of_moving_ranges_match_their_spread() -> None:
    # the relative variance of the estimate is 1 / (2 dof); J. D. Cryer and T. P. Ryan, JQT 22(3), 1990: 0.826 / n
    values = np.random.default_rng(6).normal(size=(20_000, 50))
    sigmas = np.abs(np.diff(values, axis=1)).mean(axis=1) / D2
    assert np.mean(sigmas) == pytest.approx(1.0, abs=0.004)
    assert 1.0 / (2.0 * np.var(sigmas)) == pytest.approx(moving_range_dof(50), rel=0.04)
    assert moving_range_dof(100_000) == pytest.approx(0.605 * 100_000, rel=2e-3)


@pytest.mark.long
def test_intervals_contain_the_true_index_with_the_stated_probability() -> None:
    random, runs = np.random.default_rng(8), 3000
    inside = dict.fromkeys(("cp", "cpk", "pp", "ppk"), 0)
    for _ in range(runs):
        found = capability(random.normal(0.5, 1.0, 60), -4.0, 4.0)
        for name, true in (("cp", 4.0 / 3.0), ("cpk", 3.5 / 3.0), ("pp", 4.0 / 3.0), ("ppk", 3.5 / 3.0)):
            interval = getattr(found, name)
            inside[name] += interval.low <= true <= interval.high
    for name, count in inside.items():
        assert count / runs == pytest.approx(0.95, abs=0.012), name  # 3 sigma of the count


def test_normality_hint_distinguishes_normal_and_exponential_values() -> None:
    random = np.random.default_rng(9)
    assert capability(random.normal(size=300), -4.0, 4.0).normal
    assert not capability(random.exponential(size=300), -4.0, 4.0).normal
    rejected = sum(not capability(random.normal(size=50), -4.0, 4.0).normal for _ in range(1000))
    assert stats.binom.ppf(0.001, 1000, 0.05) <= rejected <= stats.binom.ppf(0.999, 1000, 0.05)


@pytest.mark.parametrize(("values", "code"), [([1.0, 2.0], "quality.too_few"), ([2.0] * 5, "quality.no_spread")])
def test_too_few_or_equal_values_are_refused(values: list[float], code: str) -> None:
    with pytest.raises(InputError) as caught:
        capability(np.array(values), 0.0, 3.0)
    assert caught.value.code == code
