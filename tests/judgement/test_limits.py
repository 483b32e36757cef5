"""The limits of a product become checks; unobservable parameters are listed."""

from dataclasses import replace

import numpy as np
import pytest

from calstation.errors import ConfigurationError
from calstation.estimation import Estimate, Solution
from calstation.estimation.common import Consistency, Posterior
from calstation.judgement import check_limits, estimated_stage, unobservable
from calstation.judgement.limits import check_prior, not_compared
from calstation.messages import sentence
from calstation.physics import COUNT, INDEX, NAMES
from calstation.records import Limit
from calstation.results.result import StageConsistency
from calstation.schema import validate
from calstation.sequencer import StageSolved, solution_events

PRIOR = Posterior(np.zeros(COUNT), np.eye(COUNT))
GOOD = Consistency(1.0, 0.9, 1.1, 100)


def solution(stage: str, names: tuple[str, ...], values: dict[str, tuple[float, float]]) -> Solution:
    mean, sigma = np.zeros(COUNT), np.ones(COUNT)
    for name, (value, spread) in values.items():
        mean[INDEX[name]], sigma[INDEX[name]] = value, spread
    return Solution(stage, Posterior(mean, np.diag(sigma**2)), names, GOOD)


def limit(**fields: object) -> Limit:
    return validate(Limit, fields, "product")


def test_value_and_sigma_are_compared_and_a_parameter_precedes_its_group() -> None:
    output = solution(
        "rate",
        ("gyro_scale_x", "gyro_scale_y"),
        {"gyro_scale_x": (2e-3, 1e-6), "gyro_scale_y": (-2e-3, 1e-4)},
    )
    limits = {
        "gyro_scale": limit(within=1e-3, sigma_below=1e-5),
        "gyro_scale_y": limit(within=[-3e-3, 0.0]),
        "accel_bias": limit(within=1.0),
    }
    checks = {c.name: c for c in check_limits(limits, PRIOR, [output])}
    assert not checks["gyro_scale_x within"].passed
    assert checks["gyro_scale_x sigma below"].passed
    assert checks["gyro_scale_y within"].passed
    assert checks["gyro_scale_y within"].to_json()["limit"] == [-3e-3, 0.0]
    assert "gyro_scale_y sigma below" not in checks
    assert not any("accel" in name for name in checks)
    assert checks["rate consistency"].passed
    assert checks["unobservable parameters"].passed


def test_parameter_that_kept_its_prior_sigma_is_unobservable_and_fails() -> None:
    output = solution(
        "rate", ("gyro_bias_x", "gyro_scale_x"), {"gyro_scale_x": (0.0, 1e-3), "gyro_bias_x": (0.0, 0.95)}
    )
    assert unobservable(PRIOR, [output]) == ["gyro_bias_x"]
    assert not check_limits({"gyro_bias": limit(within=1.0)}, PRIOR, [output])[-1].passed


def ranked(output: Solution, **steps: int | None) -> Solution:
    """Return the solution with an observability analysis in which these states become observable in these steps."""
    return replace(output, observability={"states": {name: {"step": step} for name, step in steps.items()}})


def test_unobservable_parameter_is_listed_even_if_correlation_reduced_its_sigma() -> None:
    names = ("gyro_bias_x", "gyro_bias_y")
    sharp = dict.fromkeys(names, (0.0, 0.1))
    output = ranked(solution("excitation", names, sharp), gyro_bias_x=None, gyro_bias_y=3)
    assert unobservable(PRIOR, [output]) == ["gyro_bias_x"]
    assert unobservable(PRIOR, [output, ranked(solution("azimuth_flip", names, sharp), gyro_bias_x=2)]) == []
    assert unobservable(PRIOR, [solution("rate", names, sharp), output]) == []


def test_limits_of_unobservable_parameters_are_not_checked() -> None:
    names = ("gyro_bias_x", "gyro_bias_y")
    values = dict.fromkeys(names, (0.0, 0.1))
    output = ranked(solution("excitation", names, values), gyro_bias_x=None, gyro_bias_y=3)
    limits = {"gyro_bias": limit(within=1.0, sigma_below=1.0), "accel_bias_x": limit(within=1.0)}
    checks = check_limits(limits, PRIOR, [output])
    claims = [(c.kind, c.subject) for c in checks if c.subject in names]
    assert claims == [("within", "gyro_bias_y"), ("sigma_below", "gyro_bias_y")]
    assert not checks[-1].passed
    assert not_compared(limits, PRIOR, [output]) == ["gyro_bias_x", "gyro_bias_z", "accel_bias_x"]


def test_stage_without_redundancy_has_no_consistency_check() -> None:
    output = Solution("six_position", PRIOR, (), Consistency(0.0, 0.0, 0.0, 0))
    assert [c.kind for c in check_limits({}, PRIOR, [output])] == ["unobservable"]
    assert StageConsistency.of(output.consistency).passed is None
    (solved,) = solution_events(output)
    assert isinstance(solved, StageSolved)
    assert solved.consistency["passed"] is None


def test_innovations_above_their_bounds_fail_and_below_them_pass() -> None:
    for mean, passed in ((1.2, False), (0.8, True)):
        output = Solution("rate", PRIOR, (), Consistency(mean, 0.9, 1.1, 100))
        assert check_limits({}, PRIOR, [output])[0].passed is passed


def test_parameter_is_assigned_to_the_last_stage_that_estimated_it() -> None:
    chain = [
        solution("rate", ("gyro_scale_x",), {}),
        solution("excitation", ("gyro_bias_x", "gyro_scale_x"), {}),
    ]
    assert estimated_stage(chain) == {"gyro_bias_x": "excitation", "gyro_scale_x": "excitation"}
    assert check_limits({}, PRIOR, []) == []


@pytest.mark.parametrize("fields", [{"within": -1.0}, {"within": [1.0, 0.0]}, {"sigma_below": 0.0}, {"whithin": 1.0}])
def test_contradictory_limits_are_refused(fields: dict[str, object]) -> None:
    with pytest.raises(ConfigurationError, match="product: "):
        limit(**fields)


def with_sigma(sigma: float, change: float) -> Solution:
    """Return a solution of one parameter whose prior is 0 ± 1."""
    return solution(
        "rate", ("gyro_scale_x", "gyro_scale_y"), {"gyro_scale_x": (change, sigma), "gyro_scale_y": (0.0, 0.1)}
    )


def test_parameter_far_from_a_stated_prior_fails_with_its_prior() -> None:
    stated = {"gyro_scale_x", "gyro_scale_y"}
    (check,) = check_prior(PRIOR, [with_sigma(0.1, -5.4)], stated)
    assert (check.name, check.passed, check.where.parameter) == ("prior of the profile", False, "gyro_scale_x")
    assert check.value == pytest.approx(5.4 / 0.99**0.5)
    text = sentence(check.cause_text)
    assert "-5.4e+06 ppm, but the prior states 0 ppm with a sigma of 1e+06 ppm: 5.4 sigma off." in text
    assert check_prior(PRIOR, [with_sigma(0.1, 4.9)], stated)[0].passed
    assert check_prior(PRIOR, [with_sigma(0.1, -5.4)], {"gyro_scale_y"})[0].passed
    assert check_prior(PRIOR, [with_sigma(0.1, -5.4)], set()) == []


def test_estimate_that_its_prior_pulls_is_compared_by_its_innovation() -> None:
    """A unit 5.5 sigma from its prior, measured with 0.45 sigma, is pulled to 4.57 sigma."""
    variance = 1.0 / (1.0 + 1.0 / 0.45**2)
    pulled = with_sigma(variance**0.5, 5.5 * (1.0 - variance))
    assert not check_prior(PRIOR, [pulled], {"gyro_scale_x"})[0].passed
    undecided = with_sigma(0.6, 5.5 * (1.0 - 0.36))  # the data do not halve the sigma of the prior
    assert check_prior(PRIOR, [undecided], {"gyro_scale_x"}) == []


def test_sound_units_raise_no_alarm_against_their_prior() -> None:
    rng, alarms = np.random.default_rng(1), 0
    for _ in range(1000):
        sigma = rng.uniform(0.01, 0.49, COUNT)
        true = rng.standard_normal(COUNT)
        noise = sigma / np.sqrt(1.0 - sigma**2)  # sigma of the data alone
        mean = (true + noise * rng.standard_normal(COUNT)) * (1.0 - sigma**2)
        output = solution("rate", NAMES, dict(zip(NAMES, zip(mean, sigma, strict=True), strict=True)))
        (check,) = check_prior(PRIOR, [output], NAMES)
        alarms += not check.passed
    assert alarms <= 1


def test_limits_of_further_parameters_and_of_a_fixed_lever_arm() -> None:
    """A pair parameter that no stage estimated is not compared; a lever arm that the table fixes is known."""
    limits = {"outer_lever": limit(within=0.1), "clock_offset": limit(within=1e-3), "accel_bias_x": limit(within=1.0)}
    fixed = PRIOR.covariance.copy()
    for axis in "xyz":
        fixed[INDEX[f"outer_lever_{axis}"]] = 0.0
    output = solution("six_position", ("accel_bias_x",), {"accel_bias_x": (0.0, 0.1)})
    assert not_compared(limits, Posterior(PRIOR.mean, fixed), [output]) == ["clock_offset"]
    paired = replace(output, estimates={"clock_offset": Estimate(0.0, 1e-6, "s")})
    assert not_compared(limits, Posterior(PRIOR.mean, fixed), [paired]) == []
