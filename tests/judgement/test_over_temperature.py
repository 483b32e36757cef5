"""Verdict on parameters that are functions of the temperature: worst value, largest sigma, hysteresis."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calstation.config import RunRequest, load_configuration
from calstation.estimation import Solution
from calstation.estimation.common import Consistency, Posterior, SampleBlock, TemperatureModel
from calstation.estimation.temperature import TemperaturePoint, fit_temperature
from calstation.judgement import check_limits, judge, unobservable
from calstation.judgement.over_temperature import sensor_test
from calstation.physics import COUNT, INDEX, NAMES, PARAMETERS
from calstation.records import Limit

PRIOR = Posterior(np.zeros(COUNT), np.diag([p.prior_sigma**2 for p in PARAMETERS]))
MODEL = TemperatureModel(25.0, (-40.0, 85.0), {"gyro_bias": 1})
NAME, BIAS = "gyro_bias_x", INDEX["gyro_bias_x"]
TEMPERATURES = (25.0, -40.0, 20.0, 85.0, 30.0, -35.0, 25.0)
RATIO = 1e-3


def solved(slope: float = 0.0, step: float = 0.0, blind: str = "") -> Solution:
    """Return a solution without errors, for a bias with a slope over the range and a step between both directions.

    The data do not determine the parameter `blind` at the highest temperature.
    """
    points = []
    for k, t in enumerate(TEMPERATURES):
        way = "soak" if k == 0 else "up" if t > TEMPERATURES[k - 1] else "down"
        mean, sigma = np.zeros(COUNT), RATIO * PRIOR.sigma
        mean[BIAS] = PRIOR.sigma[BIAS] * (
            slope * (t - 25.0) / 65.0 + step * {"up": 0.5, "down": -0.5, "soak": 0.0}[way]
        )
        if blind and t == 85.0:
            sigma[INDEX[blind]] = PRIOR.sigma[INDEX[blind]]
        points.append(TemperaturePoint(t, 0.0, 600.0 * k, way, 0, 1, PRIOR, Posterior(mean, np.diag(sigma**2))))
    fit = fit_temperature(MODEL, points, PRIOR)
    consistency = Consistency(1.0, 0.9, 1.1, 100)
    return replace(Solution("temperature", fit.at(25.0), NAMES, consistency), temperature=fit, tests=(fit.test,))


def failed(solution: Solution, **limits: Limit) -> list[str]:
    """Return the names of the failed checks."""
    return [check.name for check in check_limits(limits, PRIOR, [solution]) if not check.passed]


def test_limits_hold_at_the_worst_temperature() -> None:
    within = Limit(within=0.5 * PRIOR.sigma[BIAS])
    assert failed(solved(0.4), gyro_bias=within) == []
    assert failed(solved(0.6), gyro_bias=within) == [f"{NAME} within"]


def test_hysteresis_is_compared_with_the_limit_of_sigma() -> None:
    step = 0.1
    assert failed(solved(step=step)) == ["temperature hysteresis"]
    assert failed(solved(step=step), gyro_bias=Limit(sigma_below=0.6 * step * PRIOR.sigma[BIAS])) == []
    strict = Limit(sigma_below=0.4 * step * PRIOR.sigma[BIAS])
    checks = [c for c in check_limits({"gyro_bias": strict}, PRIOR, [solved(step=step)]) if c.kind == "hysteresis"]
    (check,) = checks
    assert not check.passed
    assert (check.where.parameter, check.unit) == (NAME, "rad/s")
    assert check.value == pytest.approx(0.5 * step * PRIOR.sigma[BIAS], rel=1e-3)
    rest = solved(step=step).temperature.without_hysteresis.largest_sigma[BIAS]
    assert check.limit == pytest.approx(np.sqrt(strict.sigma_below**2 - rest**2))
    assert check.diagnosis.size == pytest.approx(step * PRIOR.sigma[BIAS], rel=1e-3)
    assert check.diagnosis.parameter_shift[NAME] > 10.0


def test_small_difference_of_both_directions_is_shown_and_passes() -> None:
    (check,) = [c for c in check_limits({}, PRIOR, [solved()]) if c.kind == "hysteresis"]
    assert check.passed
    assert check.value < check.limit


def test_parameter_that_one_end_of_the_range_does_not_determine_is_unobservable() -> None:
    order = {"gyro_scale": 3}
    assert unobservable(PRIOR, [solved()]) == []
    points = [p for p in solved(blind="gyro_scale_x").temperature.points if p.temperature in (25.0, -40.0, 85.0, 20.0)]
    fit = fit_temperature(replace(MODEL, order=order), points, PRIOR)
    solution = replace(solved(), posterior=fit.at(25.0), temperature=fit)
    assert solution.posterior.sigma[INDEX["gyro_scale_x"]] < 0.1 * PRIOR.sigma[INDEX["gyro_scale_x"]]
    assert unobservable(PRIOR, [solution]) == ["gyro_scale_x"]


def test_probability_of_a_wrong_decision_is_that_at_the_worst_temperature() -> None:
    meta = load_configuration(RunRequest("SN-1", product=Path("data/products/mems_c_fast.toml"))).log_meta()
    solution = solved()
    limit, columns = meta.product.limits["gyro_bias"].within, solution.temperature.model.columns
    scaled = np.array([limit if c.parameter == BIAS and c.power == 1 else 0.0 for c in columns])
    solution = replace(solution, temperature=replace(solution.temperature, scaled=scaled))
    assert judge(meta, PRIOR, (solution,)).conformity.parameters[NAME].probability == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize(
    ("offset", "heating", "passed"),
    [(0.0, 4.0, True), (2.0, 4.0, True), (5.0, 4.0, False), (-5.0, 4.0, False), (5.0, 20.0, True)],
)
def test_a_temperature_sensor_that_does_not_follow_the_chamber_is_named(
    offset: float, heating: float, passed: bool
) -> None:
    """The unit changes quickly between the soaks, and the air is known once in ten samples."""
    air, unit = [], []
    for k, (before, at) in enumerate([(25.0, -40.0), (-40.0, 30.0), (30.0, 80.0)]):
        approach = np.exp(-np.arange(600.0) / 60.0)
        air += [*np.linspace(before, at, 100), *np.full(500, at)]
        unit += [*(at + heating + (before - at) * approach + offset * (k == 2))]
    chamber = np.where(np.arange(len(air)) % 10 == 0, air, np.nan)[:, None]
    n = len(air)
    columns = {"temperature": np.array(unit), "chamber": chamber}
    samples = SampleBlock.without_table("temperature", np.arange(n), np.arange(n) + 1.0, np.zeros((n, 6)), **columns)
    (test,) = sensor_test(samples, 1.0)
    assert (test.passed, test.diagnosis.cause) == (passed, "temperature_sensor")
    if offset == 5.0 and not passed:
        assert test.value == pytest.approx(5.0, abs=0.3)
        assert test.diagnosis.values["last_unit_c"] == pytest.approx(89.0, abs=0.3)
    no_air = SampleBlock.without_table("temperature", np.arange(n), np.arange(n) + 1.0, np.zeros((n, 6)))
    assert sensor_test(no_air, 1.0) == []


@pytest.mark.parametrize(("offset", "passed"), [(0.0, True), (5.0, False)])
@pytest.mark.parametrize("time_constant", [240.0, 600.0, 1800.0])
def test_a_good_sensor_of_a_unit_that_still_approaches_its_temperature_passes(
    time_constant: float, offset: float, passed: bool
) -> None:
    """The unit is steady within 0.1 K/min at the end of every soak, in rising and in falling temperature."""
    air, unit, at = list[float](), list[float](), 25.0
    for k, target in enumerate((-40.0, 25.0, 80.0, 25.0)):
        approach = (at - target) * np.exp(-np.arange(0.0, 10.0 * time_constant) / time_constant)
        approach = approach[: int(np.argmax(np.abs(approach) < time_constant * 0.1 / 60.0)) + 200]
        at = target + approach[-1]
        air += [target] * len(approach)
        unit += [*(target + approach + offset * (k >= 2))]
    n = len(air)
    columns = {"temperature": np.array(unit), "chamber": np.array(air)[:, None]}
    samples = SampleBlock.without_table("temperature", np.arange(n), np.arange(n) + 1.0, np.zeros((n, 6)), **columns)
    (test,) = sensor_test(samples, 1.0)
    assert test.passed == passed
