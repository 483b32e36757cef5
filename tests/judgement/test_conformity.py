"""Decision rules and probabilities of wrong decisions agree with closed forms, quadrature and SciPy."""

import itertools
import json
import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from calstation.config import RunRequest, library, load_configuration
from calstation.estimation import Solution
from calstation.estimation.common import Consistency, Posterior
from calstation.judgement import Check, End, acceptance_interval, judge, verdict_of
from calstation.judgement.conformity import Measurement, bivariate_normal, probability_outside, product_risks
from calstation.messages import sentence
from calstation.physics import COUNT, INDEX, NAMES
from calstation.records import ConformitySection, LogFacts, LogMeta, prior_from_meta
from calstation.results import Ending, Result, build_result

LIMITS = (-1.0, 1.0)


def test_simple_acceptance_at_the_limit_is_wrong_with_probability_one_half() -> None:
    assert acceptance_interval(LIMITS, 0.01, "simple") == LIMITS
    assert probability_outside(Measurement(1.0, 0.01), LIMITS) == pytest.approx(0.5, abs=1e-12)
    assert probability_outside(Measurement(-1.0, 0.01), LIMITS) == pytest.approx(0.5, abs=1e-12)


def test_two_sigma_guard_band_leaves_2_3_percent_risk_at_its_limit() -> None:
    low, high = acceptance_interval(LIMITS, 0.01, "guard_band")
    assert (low, high) == pytest.approx((-0.98, 0.98))
    for value in (low, high):
        assert probability_outside(Measurement(value, 0.01), LIMITS) == pytest.approx(norm.cdf(-2.0), abs=1e-12)


def test_probability_outside_the_limits_includes_both_tails() -> None:
    assert probability_outside(Measurement(0.0, 1.0), LIMITS) == pytest.approx(2.0 * norm.cdf(-1.0), rel=1e-12)


def test_product_spread_is_used_as_the_prior() -> None:
    measured, spread, mu = Measurement(1.1, 0.3), 0.4, 0.0

    def density(y: float) -> float:
        return float(norm.pdf(y, mu, spread) * norm.pdf(measured.value, y, measured.sigma))

    inside = quad(density, *LIMITS, epsabs=0.0)[0]
    total = quad(density, -5.0, 5.0, epsabs=0.0, limit=200)[0]
    assert probability_outside(measured, LIMITS, spread) == pytest.approx(1.0 - inside / total, rel=1e-9)


def test_product_spread_replaces_the_prior_of_the_imu_profile() -> None:
    """An estimate with a prior gives the same probability as the data alone; an equal prior changes nothing."""
    data, sigma_data, mean, prior = 1.3, 0.5, 0.2, 0.8
    precision = sigma_data**-2 + prior**-2
    value = (data / sigma_data**2 + mean / prior**2) / precision
    with_prior = Measurement(value, precision**-0.5, mean, prior)
    expected = probability_outside(Measurement(data, sigma_data), LIMITS, 0.4)
    assert probability_outside(with_prior, LIMITS, 0.4) == pytest.approx(expected, rel=1e-12)
    equal = Measurement(value, precision**-0.5, 0.0, prior)
    assert probability_outside(equal, LIMITS, prior) == pytest.approx(
        probability_outside(Measurement(value, precision**-0.5), LIMITS), rel=1e-12
    )


@pytest.mark.parametrize("rho", [-0.9, 0.0, 0.5, 0.99, 0.999999])
def test_bivariate_normal_distribution_agrees_with_scipy(rho: float) -> None:
    root = math.sqrt((1.0 - rho) * (1.0 + rho))
    for h in (-2.0, -0.3, 0.0, 0.7, math.inf):
        for k in (-1.5, 0.0, 0.31, 2.2, math.inf):
            expected = multivariate_normal([0.0, 0.0], [[1.0, rho], [rho, 1.0]]).cdf([h, k])
            assert bivariate_normal(h, k, rho, root) == pytest.approx(expected, abs=1e-10)
    assert bivariate_normal(0.0, 0.0, rho, root) == pytest.approx(0.25 + math.asin(rho) / (2.0 * math.pi), abs=1e-14)
    assert bivariate_normal(-math.inf, 1.0, rho, root) == 0.0


@pytest.mark.parametrize("rule", ["simple", "guard_band"])
@pytest.mark.parametrize(("spread", "sigma"), [(0.5, 0.1), (1.0, 0.3), (0.4, 1e-3)])
def test_product_risks_agree_with_the_integrals_of_jcgm_106(rule: str, spread: float, sigma: float) -> None:
    low, high = acceptance_interval(LIMITS, sigma, rule)

    def accepted(y: float) -> float:
        return float(norm.cdf((high - y) / sigma) - norm.cdf((low - y) / sigma))

    def integral(function, begin: float, end: float) -> float:
        marks = [edge + k * sigma for edge in (low, high) for k in (-8.0, 0.0, 8.0)]
        points = sorted({begin, end, *(mark for mark in marks if begin < mark < end)})
        pieces = itertools.pairwise(points)
        return sum(quad(function, *piece, epsabs=1e-14, limit=200)[0] for piece in pieces)

    far = 1.0 + 12.0 * spread
    accept = sum(integral(lambda y: norm.pdf(y, 0.0, spread) * accepted(y), *e) for e in ((-far, -1.0), (1.0, far)))
    reject = integral(lambda y: norm.pdf(y, 0.0, spread) * (1.0 - accepted(y)), -1.0, 1.0)
    output = product_risks(Measurement(0.0, sigma), LIMITS, spread, rule)
    assert output == pytest.approx((accept, reject), rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("rule", ["simple", "guard_band"])
@pytest.mark.parametrize("sigma", [1e-4, 1e-6, 1e-7, 1e-9, 1e-12, 1e-16, 1e-30])
@pytest.mark.parametrize("limits", [LIMITS, (-math.inf, 0.0)])
def test_risks_of_a_precise_measurement_agree_with_the_first_order_formula(
    rule: str, sigma: float, limits: tuple[float, float]
) -> None:
    """To first order, the risk is density at the limit · sigma · E max(0, N(∓shift, 1))."""
    spread, shift = 0.4, 0.0 if rule == "simple" else 2.0
    density = sum(norm.pdf(limit, 0.0, spread) for limit in limits)
    beyond = norm.pdf(shift) - shift * norm.cdf(-shift)
    accept, reject = product_risks(Measurement(0.0, sigma), limits, spread, rule)
    assert accept == pytest.approx(density * sigma * beyond, rel=1e-2, abs=1e-8)
    assert reject == pytest.approx(density * sigma * (beyond + shift), rel=1e-2, abs=1e-8)


@pytest.mark.parametrize(("mean", "accepted"), [(0.2, True), (1.2, False)])
@pytest.mark.parametrize("sigma", [0.5, 0.5 + 1e-16])
def test_uninformative_measurement_gives_the_decision_of_its_prior(mean: float, accepted: bool, sigma: float) -> None:
    conforming = float(norm.cdf(1.0, 0.0, 0.4) - norm.cdf(-1.0, 0.0, 0.4))
    expected = (1.0 - conforming, 0.0) if accepted else (0.0, conforming)
    output = product_risks(Measurement(mean, sigma, mean, 0.5), LIMITS, 0.4, "simple")
    assert output == pytest.approx(expected, abs=1e-12)


def test_product_risks_of_an_estimate_with_a_prior_agree_with_a_simulation() -> None:
    rng, sigma_data, spread, mean, prior = np.random.default_rng(1), 0.4, 0.7, 0.3, 0.9
    precision = sigma_data**-2 + prior**-2
    sigma = precision**-0.5
    y = rng.normal(0.0, spread, 1_000_000)
    data = y + rng.normal(0.0, sigma_data, y.size)
    estimate = (data / sigma_data**2 + mean / prior**2) / precision
    accepted, inside = np.abs(estimate) <= 1.0, np.abs(y) <= 1.0
    output = product_risks(Measurement(0.0, sigma, mean, prior), LIMITS, spread, "simple")
    assert output[0] == pytest.approx(np.mean(accepted & ~inside), abs=1e-3)
    assert output[1] == pytest.approx(np.mean(~accepted & inside), abs=1e-3)


def test_overlapping_guard_bands_accept_nothing() -> None:
    accept, reject = product_risks(Measurement(0.0, 0.6), LIMITS, 0.5, "guard_band")
    assert (accept, reject) == (0.0, pytest.approx(1.0 - 2.0 * norm.cdf(-2.0)))


def test_guard_band_lowers_the_consumer_risk_and_raises_the_producer_risk() -> None:
    simple, guarded = (product_risks(Measurement(0.0, 0.1), LIMITS, 0.6, rule) for rule in ("simple", "guard_band"))
    assert guarded[0] < 0.05 * simple[0]
    assert guarded[1] > simple[1]


def configuration(**conformity: object) -> LogMeta:
    meta = load_configuration(RunRequest("SN-000001", product=library.find("products", "mems_c"))).log_meta()
    product = meta.product.model_copy(update={"conformity": ConformitySection.model_validate(conformity)})
    return LogMeta.model_validate_json(meta.model_copy(update={"product": product}).to_json())


def solution(**values: tuple[float, float]) -> Solution:
    mean, sigma = np.zeros(COUNT), np.full(COUNT, 1e-9)
    for name, (value, spread) in values.items():
        mean[INDEX[name]], sigma[INDEX[name]] = value, spread
    return Solution("excitation", Posterior(mean, np.diag(sigma**2)), NAMES, Consistency(1.0, 0.9, 1.1, 100))


def judged(meta: LogMeta, output: Solution) -> Result:
    prior = prior_from_meta(meta)
    judgement = judge(meta, prior, (output,))
    verdict = verdict_of(End.COMPLETED, judgement.passed, partial=judgement.partial)
    ending = Ending(verdict, "a.h5", LogFacts(0, 99, 100, 0, None, 64 * "0"))
    result = build_result(meta, prior, (output,), judgement, ending)
    assert Result.from_json(json.loads(json.dumps(result.to_json()))) == result
    return result


def within(result: Result, name: str) -> Check:
    return next(check for check in result.checks if (check.kind, check.subject) == ("within", name))


#: In the limits of mems_c, 0.0052 rad/s, by less than two sigmas.
NEAR_THE_LIMIT = {"gyro_bias_x": (0.00518, 2e-5)}


def test_acceptance_limits_equal_the_limits_without_a_decision_rule() -> None:
    result = judged(configuration(), solution(**NEAR_THE_LIMIT))
    check, output = within(result, "gyro_bias_x"), result.conformity.parameters["gyro_bias_x"]
    assert (check.passed, check.acceptance, "acceptance" in check.to_json()) == (True, None, False)
    assert (result.conformity.rule, output.accepted, output.acceptance) == ("simple", True, (-0.0052, 0.0052))
    assert output.probability == pytest.approx(norm.cdf(-1.0), rel=1e-9)
    assert (output.spread, output.false_accept, output.false_reject) == (None, None, None)


def test_guard_band_rejects_values_within_two_sigma_of_the_limit() -> None:
    result = judged(configuration(rule="guard_band"), solution(**NEAR_THE_LIMIT))
    check, output = within(result, "gyro_bias_x"), result.conformity.parameters["gyro_bias_x"]
    assert result.passed is False
    assert check.to_json()["limit"] == [-0.0052, 0.0052]
    assert check.to_json()["acceptance"] == pytest.approx([-0.00516, 0.00516])
    assert check.margin == pytest.approx(-2e-5)
    assert not output.accepted
    assert output.probability == pytest.approx(norm.cdf(1.0), rel=1e-9)  # that a good unit was refused
    assert within(result, "gyro_bias_y").near_miss is False
    assert Check.from_json(check.to_json()) == check


def test_guard_band_wider_than_the_limits_fails_with_its_cause() -> None:
    result = judged(configuration(rule="guard_band"), solution(gyro_bias_x=(0.0, 0.003)))
    check = within(result, "gyro_bias_x")
    assert (check.passed, check.diagnosis.cause) == (False, "guard_band")
    assert "No value of gyro_bias_x can be accepted" in sentence(check.cause_text)
    assert result.conformity.parameters["gyro_bias_x"].accepted is False


def test_group_spread_gives_the_product_risks() -> None:
    meta = configuration(spread={"gyro_bias": 0.002, "gyro_bias_y": 0.001})
    output = judged(meta, solution(**NEAR_THE_LIMIT)).conformity.parameters
    assert (output["gyro_bias_x"].spread, output["gyro_bias_y"].spread) == (0.002, 0.001)
    assert 0.0 < output["gyro_bias_x"].false_accept < 1e-3
    assert output["accel_bias_x"].false_accept is None


def test_unknown_name_or_zero_spread_is_refused() -> None:
    with pytest.raises(ValueError, match="gyro_bais"):
        ConformitySection.model_validate({"spread": {"gyro_bais": 1.0}})
    with pytest.raises(ValueError, match="greater than 0"):
        ConformitySection.model_validate({"spread": {"gyro_bias": 0.0}})


def test_digest_of_a_log_without_a_decision_rule_is_unchanged() -> None:
    meta = load_configuration(RunRequest("SN-000001")).log_meta()
    assert "conformity" not in meta.to_json()
