"""The stage temperature against a unit whose parameters are polynomials, or other functions, of its temperature."""

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import calstation as cs
from calstation.errors import ConfigurationError, InputError
from calstation.estimation.common import Diagnosis, ModelTest, Posterior, SampleBlock
from calstation.estimation.navigation.temperature_stage import _severity, temperature_parts
from calstation.estimation.temperature import TemperaturePoint, compensate_each, fit_temperature, held_out_points
from calstation.judgement import End, judge, verdict_of
from calstation.physics import NAMES, PARAMETERS, compensate, compensation, group_matrix
from calstation.records import LogFacts, TemperatureSection, context_from_meta
from calstation.results import Ending, TemperatureResult, build_result
from procedures.temperature import METHOD, Schedule
from tests.helpers import raises_code
from tests.outside.thermal_bench import ThermalBench, ThermalCase

ORDER = {"gyro_bias": 3, "gyro_scale": 2, "accel_bias": 2, "accel_scale": 1}
#: Sizes of the coefficients over the range.
SIZES = {"gyro_bias": 2e-4, "gyro_scale": 1e-4, "accel_bias": 2e-3, "accel_scale": 2e-4}
SECTION = TemperatureSection(range_c=(-40.0, 85.0), order=ORDER)
TEMPERATURES = (25.0, -40.0, 0.0, 40.0, 85.0, 25.0)
PRIOR = Posterior(np.zeros(len(NAMES)), np.diag([p.prior_sigma**2 for p in PARAMETERS]))


def polynomials(seed: int) -> dict[str, Callable[[np.ndarray], np.ndarray]]:
    """Return changes over temperature, by parameter."""
    random, courses = np.random.default_rng(seed), {}
    for p in PARAMETERS:
        if p.group in ORDER:
            c = SIZES[p.group] * random.normal(size=ORDER[p.group])
            courses[p.name] = lambda t, c=c: sum(s * ((t - 25.0) / 65.0) ** (k + 1) for k, s in enumerate(c))
    return courses


def errors(case: ThermalCase, bench: ThermalBench, fit, temperature: float) -> np.ndarray:
    """Return the errors of the parameters at a temperature, in sigmas."""
    at = np.array([temperature])
    added = [case.courses[n](at)[0] if n in case.courses else 0.0 for n in NAMES]
    truth = np.array([bench.bench.unit.parameters.get(n, 0.0) for n in NAMES]) + added
    found = fit.at(temperature)
    return (found.mean - truth) / np.where(found.sigma > 0.0, found.sigma, np.inf)


@pytest.mark.long
def test_parameters_over_the_range_and_the_result() -> None:
    case = ThermalCase("mems_c_fast", TEMPERATURES, polynomials(1), SECTION)
    chain, bench = case.solve()
    fit, consistency = chain.solutions[0].temperature, chain.solutions[0].consistency
    assert consistency.nis_low < consistency.nis_mean < consistency.nis_high
    found = np.array([errors(case, bench, fit, t) for t in (-40.0, -20.0, 10.0, 25.0, 60.0, 85.0)])
    assert np.abs(found).max() < 5.0
    assert 0.6 < np.sqrt(np.mean(found**2)) < 1.4
    judgement = judge(case.meta(), chain.prior, tuple(chain.solutions))
    assert [check.name for check in judgement.checks if not check.passed] == []
    facts = LogFacts(sha256="", first_seq=0, last_seq=1, samples=2, gaps=0, temperature=(25.0, -40.0, 85.0))
    verdict = verdict_of(End.COMPLETED, judgement.passed, partial=False)
    result = build_result(case.meta(), chain.prior, chain.solutions, judgement, Ending(verdict, "log", facts))
    section = json.loads(json.dumps(result.to_json()))["temperature"]
    bias = section["coefficients"]["gyro_bias_x"]
    assert len(bias["values"]) == len(bias["sigma"]) == 4
    assert bias["unit"] == "rad/s"
    powers = (60.0 - section["reference_c"]) ** np.arange(4)
    assert np.dot(bias["values"], powers) == pytest.approx(fit.at(60.0).mean[NAMES.index("gyro_bias_x")], rel=1e-9)
    assert [point["way"] for point in section["points"]] == ["soak", "down", "up", "up", "up", "down"]
    assert section["worst"].keys() == set(chain.solutions[0].estimated)

    temperature = np.array([-30.0, 70.0])
    force = np.array([[0.0, 0.0, 9.8], [1.0, 9.0, -2.0]])
    truth = np.array([fit.at(t).mean for t in temperature])
    biases = truth[:, [NAMES.index(f"accel_bias_{a}") for a in "xyz"]]
    matrices = [np.eye(3) + group_matrix(p, "accel_scale", "accel_misalign") for p in truth]
    quadratic = truth[:, [NAMES.index(f"accel_quadratic_{a}") for a in "xyz"]]
    accel = np.array([m @ f for m, f in zip(matrices, force, strict=True)]) + biases + quadratic * force**2
    gyro = truth[:, [NAMES.index(f"gyro_bias_{a}") for a in "xyz"]]
    rate, corrected = cs.apply(result, gyro, accel, temperature)
    assert np.abs(rate).max() < 1e-12
    assert corrected == pytest.approx(force, abs=1e-9)
    with raises_code(InputError, "temperature.beyond"):
        cs.apply(result, gyro, accel, np.array([20.0, 90.0]))
    with raises_code(ConfigurationError, "api.no_temperature"):
        cs.apply(result, gyro, accel)


@pytest.mark.long
def test_order_that_is_too_low_is_named() -> None:
    courses = polynomials(2)
    courses["gyro_bias_z"] = lambda t: 1e-3 * np.tanh((t - 10.0) / 15.0)
    chain, _ = ThermalCase("mems_c_fast", TEMPERATURES, courses, SECTION, seed=2).solve()
    test = next(test for test in chain.solutions[0].tests if test.kind == "temperature_fit")
    assert not test.passed
    assert (test.diagnosis.cause, test.diagnosis.values["group"]) == ("temperature_order", "gyro_bias")


@pytest.mark.long
def test_range_that_was_not_measured_is_refused() -> None:
    case = ThermalCase("mems_c_fast", (25.0, 60.0), {}, SECTION)
    with raises_code(InputError, "temperature.not_covered"):
        case.solve()


@pytest.mark.parametrize(
    ("temperatures", "held_out", "code"),
    [
        ((25.0, -40.0, 85.0), -40.0, "temperature.not_covered"),
        ((25.0, -36.0, -10.0, 0.0, 50.0, 85.0), 0.0, "temperature.not_covered"),
        ((25.0, -40.0, 85.0), 0.0, "temperature.held_out_missing"),
        ((25.0, -40.0, 85.0, 24.4, 0.0), 0.0, "temperature.too_few"),
        ((25.0, -40.0, 0.0, 50.0, 85.0), 0.0, "temperature.too_few"),
    ],
)
def test_temperatures_that_do_not_determine_the_polynomials_are_refused(temperatures, held_out, code) -> None:
    section = SECTION.model_copy(update={"held_out_c": [held_out], "rate_term": ["gyro_bias"]})
    solver = METHOD.solver(context_from_meta(ThermalCase("mems_c_fast", (), {}, section).meta()), PRIOR, Schedule())
    points = [TemperaturePoint(t, 0.0, 0.0, "soak", 0, 1, PRIOR, PRIOR) for t in temperatures]
    with raises_code(InputError, code):
        solver._require_range(held_out_points(points, section.held_out_c))


def test_range_of_a_ramp_is_that_of_its_samples() -> None:
    context = context_from_meta(ThermalCase("mems_c_fast", (), {}, SECTION).meta())
    ends = [(-40.0, -30.0), (-10.0, 0.0), (20.0, 30.0), (50.0, 60.0), (75.0, 83.5)]
    points = [TemperaturePoint(sum(e) / 2, 0.1, 0.0, "up", 0, 1, PRIOR, PRIOR, extent=e) for e in ends]
    solver = METHOD.solver(context, PRIOR, Schedule())
    solver._require_range(points)
    with raises_code(InputError, "temperature.not_covered"):
        solver._require_range([*points[:-1], replace(points[-1], extent=(73.0, 82.0))])


def test_samples_without_gyros_are_corrected_as_at_one_temperature() -> None:
    parameters = 1e-4 * np.arange(1.0, 1.0 + len(NAMES)) / len(NAMES)
    gyro, accel = np.full((2, 3), np.nan), np.array([[0.1, 0.2, 9.8], [9.8, 0.1, 0.2]])
    rate, force = compensate_each(gyro, accel, np.tile(parameters, (2, 1)))
    assert np.isnan(rate).all()
    assert force == pytest.approx(compensate(compensation(parameters), gyro, accel)[1], abs=1e-9)


def test_moves_without_temperature_are_refused() -> None:
    steps = [(1, 100.0), (2, 10.0), (3, 10.0), (4, 10.0), (5, 100.0), (6, 10.0), (7, 10.0), (8, 10.0)]
    samples = block(steps)
    samples.temperature[len(samples) // 2 :] = np.nan
    solver = METHOD.solver(context_from_meta(ThermalCase("mems_c_fast", (), {}, SECTION).meta()), PRIOR, Schedule())
    solver.feed(samples)
    with raises_code(InputError, "temperature.unknown"):
        solver.finish()


def test_section_of_a_toml_file_and_its_rate_term_are_read() -> None:
    data = {"range_c": [-40.0, 85.0], "order": {"gyro_bias": 1}, "rate_term": ["gyro_bias"]}
    model = TemperatureSection.model_validate(data).model()
    points = [TemperaturePoint(t, 1e-3 * t, 0.0, "soak", 0, 1, PRIOR, PRIOR) for t in TEMPERATURES]
    fit = fit_temperature(model, points, PRIOR)
    result = TemperatureResult.of(fit, ["gyro_bias_x", "gyro_scale_x"], fit.at(25.0).covariance)
    row = result.coefficients["gyro_bias_x"]
    assert len(row.values) == 2
    assert row.rate.sigma == pytest.approx(60.0 * PRIOR.sigma[0])
    assert result.coefficients["gyro_scale_x"].rate is None


def block(steps: list[tuple[int, float]], rate: float = 10.0) -> SampleBlock:
    """Return samples of moves with their durations, s."""
    step = np.concatenate([np.full(round(duration * rate), number) for number, duration in steps])
    n = len(step)
    seq, temperature = np.arange(n), np.full(n, 25.0)
    return SampleBlock.without_table(
        "temperature", seq, (seq + 1) / rate, np.zeros((n, 6)), step=step, temperature=temperature
    )


def test_soaks_separate_the_temperatures() -> None:
    steps = [(1, 100.0), (2, 10.0), (3, 10.0), (4, 10.0), (5, 100.0), (6, 10.0), (7, 10.0), (8, 10.0)]
    assert temperature_parts(block(steps), 60.0, 10) == [(800, 1300), (2100, 2600)]


def test_cycles_of_moves_are_the_points_of_a_ramp() -> None:
    steps = [(number, 10.0) for number in range(1, 9)]
    assert temperature_parts(block(steps), 60.0, 4) == [(0, 400), (400, 800)]


def test_moves_without_numbers_are_refused() -> None:
    with raises_code(InputError, "temperature.no_steps"):
        temperature_parts(block([(0, 100.0)]), 60.0, 4)


def test_a_test_that_is_not_a_number_at_one_temperature_is_the_worst() -> None:
    tests = [ModelTest("imu_noise", value, 2.0, "1", Diagnosis("noisy")) for value in (1.9, np.nan, 0.5)]
    assert max(tests, key=_severity) is tests[1]
