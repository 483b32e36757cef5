"""The section ``temperature`` of a result: curves, worst values, and the points that were fitted."""

import numpy as np
import pytest

from calstation.physics import INDEX, PARAMETERS
from calstation.results import Result
from tests.thermal_results import TEMPERATURES, thermal_meta, thermal_result, thermal_solution


@pytest.fixture(scope="module")
def result() -> Result:
    """A stored result over temperature."""
    return Result.from_json(thermal_result().to_json())


def test_parameters_are_those_at_the_reference_in_their_own_units(result: Result) -> None:
    reference = np.array([result.temperature.reference_c])
    for name, row in result.parameters.items():
        assert row.unit == PARAMETERS[INDEX[name]].unit
        assert row.value == result.temperature.coefficients[name].values[0]
        (value,), (sigma,) = result.curve(name, reference)
        assert (value, sigma) == (row.value, pytest.approx(row.sigma, rel=1e-9))


def test_coefficients_state_their_rate_term_even_if_there_is_none() -> None:
    section = thermal_result().to_json()["temperature"]
    keys = {"values", "sigma", "rate", "unit"}
    assert all(row.keys() == keys for row in section["coefficients"].values())
    assert section["coefficients"]["gyro_bias_x"]["rate"].keys() == {"value", "sigma"}
    assert section["coefficients"]["accel_bias_x"]["rate"] is None


def test_curve_is_that_of_the_fit(result: Result) -> None:
    _, solution = thermal_solution(thermal_meta())
    for name in ("gyro_bias_x", "accel_scale_z"):
        i = INDEX[name]
        values, sigmas = result.curve(name, np.array([-40.0, 3.0, 85.0]))
        expected = [solution.temperature.at(t) for t in (-40.0, 3.0, 85.0)]
        assert values == pytest.approx([p.mean[i] for p in expected], rel=1e-9)
        assert sigmas == pytest.approx([p.sigma[i] for p in expected], rel=1e-6)


def test_worst_value_and_sigma_are_those_that_were_compared(result: Result) -> None:
    checks = {(check.kind, check.subject): check for check in result.checks}
    for name, row in result.compared.items():
        assert row.value == pytest.approx(checks["within", name].value, rel=1e-9)
        assert row.sigma == pytest.approx(checks["sigma_below", name].value, rel=1e-6)
        assert row.sigma == pytest.approx(result.temperature.worst[name].sigma, rel=1e-6)
    assert result.worst("gyro_bias_x")[1] == result.temperature.worst["gyro_bias_x"].at_c


def test_points_have_their_own_values_without_the_rate_of_change(result: Result) -> None:
    points = result.temperature.points
    assert [point.at_c for point in points] == list(TEMPERATURES)
    assert [point.at_c for point in points if point.held_out] == [-10.0, 60.0]
    for point in points:
        for name in ("gyro_bias_x", "gyro_misalign_xy"):
            (value,), _ = result.curve(name, np.array([point.at_c]))
            assert abs(point.values[name] - value) < 5.0 * point.sigma[name]
