"""The fit of coefficients over temperature against truth that is drawn point by point."""

from dataclasses import replace

import numpy as np
import pytest

from calstation.estimation.common import Posterior, TemperatureModel
from calstation.estimation.effects import ModelledEffects
from calstation.estimation.temperature import (
    ELEMENT_OF,
    TemperaturePoint,
    fit_temperature,
    held_out_points,
    with_orders,
)
from calstation.estimation.temperature import polynomials as polynomials_of
from calstation.physics import COUNT, GROUPS, INDEX, NAMES, PARAMETERS, group_indices

PRIOR = Posterior(np.zeros(COUNT), np.diag([p.prior_sigma**2 for p in PARAMETERS]))
ORDER = {"gyro_bias": 3, "gyro_scale": 2, "accel_bias": 2, "accel_scale": 1}
MODEL = TemperatureModel(25.0, (-40.0, 85.0), ORDER)
RAMP = replace(MODEL, has_lag=True)
TEMPERATURES = (25.0, -40.0, -10.0, 25.0, 55.0, 85.0, 25.0)


def measured(rng, truth, temperatures=TEMPERATURES, ratio=1e-3):
    """Return a solution for each temperature, whose errors have the stated, correlated covariance."""
    points = []
    for k, t in enumerate(temperatures):
        mix = np.linalg.qr(rng.normal(size=(COUNT, COUNT)))[0]
        sigma = PRIOR.sigma * ratio * rng.uniform(0.5, 2.0, COUNT)
        data = np.outer(PRIOR.sigma, PRIOR.sigma) * (mix @ np.diag((sigma / PRIOR.sigma) ** 2) @ mix.T)
        posterior = np.linalg.inv(np.linalg.inv(data) + np.linalg.inv(PRIOR.covariance))
        observed = rng.multivariate_normal(truth(t, k), data)
        mean = posterior @ np.linalg.solve(data, observed)
        way = "soak" if k == 0 else "up" if t > temperatures[k - 1] else "down"
        points.append(TemperaturePoint(t, 0.0, 600.0 * k, way, 0, 1, PRIOR, Posterior(mean, posterior)))
    return points


def polynomials(rng, order=ORDER):
    """Return random coefficients at the scale of the priors, as a function of the temperature."""
    model = TemperatureModel(MODEL.reference, MODEL.range, order)
    scaled = np.array([0.3 * PRIOR.sigma[c.parameter] * rng.normal() for c in model.columns])
    return scaled, lambda t, k: model.basis(t) @ scaled


@pytest.mark.long
def test_errors_of_coefficients_and_parameters_agree_with_their_covariance() -> None:
    rng = np.random.default_rng(3)
    nees, over_range, nis = [], [], []
    for _ in range(60):
        scaled, truth = polynomials(rng)
        fit = fit_temperature(MODEL, measured(rng, truth), PRIOR)
        without, error = fit.without_hysteresis, fit.scaled - scaled
        nees.append(error @ np.linalg.solve(without.scaled_covariance, error) / len(error))
        for t in np.linspace(-40.0, 85.0, 12):
            at = without.at(t)
            over_range.append((at.mean - truth(t, 0)) / at.sigma)
        nis.append(fit.consistency.nis_mean)
        assert fit.test.passed
    assert abs(np.mean(nees) - 1.0) < 5.0 * np.sqrt(2.0 / (60 * len(MODEL.columns)))
    assert np.std(over_range) == pytest.approx(1.0, abs=0.05)
    assert np.mean(nis) == pytest.approx(1.0, abs=0.03)


def test_coefficients_per_kelvin_give_the_same_parameters() -> None:
    rng = np.random.default_rng(4)
    _, truth = polynomials(rng)
    fit = fit_temperature(MODEL, measured(rng, truth), PRIOR)
    at = [k for k, c in enumerate(MODEL.columns) if c.parameter == INDEX["gyro_bias_x"]]
    powers = (70.0 - 25.0) ** np.arange(4)
    assert fit.coefficients[at] @ powers == pytest.approx(fit.at(70.0).mean[INDEX["gyro_bias_x"]], rel=1e-9)


def test_largest_value_and_sigma_are_found_over_the_range() -> None:
    rng = np.random.default_rng(5)
    _, truth = polynomials(rng)
    fit = fit_temperature(MODEL, measured(rng, truth), PRIOR)
    worst = fit.worst("gyro_bias_y")
    i = INDEX["gyro_bias_y"]
    values = [fit.at(t) for t in np.linspace(-40.0, 85.0, 101)]
    assert abs(worst.value) == max(abs(p.mean[i]) for p in values)
    assert worst.sigma == max(p.sigma[i] for p in values)


@pytest.mark.parametrize(
    ("cause", "group", "size"),
    [
        ("temperature_order", "gyro_scale", lambda t, k: ((t - 25.0) / 65.0) ** 3),
        ("changed_in_time", "gyro_bias", lambda t, k: k / 6.0),
    ],
)
def test_what_the_polynomials_do_not_describe_is_named(cause, group, size) -> None:
    rng = np.random.default_rng(6)
    changed = np.zeros(COUNT)
    changed[group_indices(group)[0]] = 0.05 * PRIOR.sigma[group_indices(group)[0]]
    for _ in range(5):
        _, truth = polynomials(rng)
        points = measured(rng, lambda t, k, truth=truth: truth(t, k) + changed * size(t, k))
        test = fit_temperature(MODEL, points, PRIOR).test
        assert not test.passed
        assert (test.diagnosis.cause, test.diagnosis.values["group"]) == (cause, group)


def test_hysteresis_has_a_size_and_leaves_the_other_tests_alone() -> None:
    rng = np.random.default_rng(6)
    i = INDEX["accel_bias_x"]
    for size in (0.0, 0.05):
        for _ in range(5):
            _, truth = polynomials(rng)
            step = np.zeros(COUNT)
            step[i] = size * PRIOR.sigma[i]
            points = measured(
                rng,
                lambda t, k, truth=truth, step=step: (
                    truth(t, k) + 0.5 * step * (np.sign(t - TEMPERATURES[max(k - 1, 0)]) + 0.7 * (k == 0))
                ),
            )
            fit = fit_temperature(MODEL, points, PRIOR)
            assert fit.test.passed
            found = {row.parameter: row for row in fit.up_down}
            assert found.keys() == ({"accel_bias_x", "accel_bias_y", "accel_bias_z"} if size else set(NAMES))
            row = found["accel_bias_x"]
            assert abs(row.difference - step[i]) < 5.0 * row.sigma < 0.05 * PRIOR.sigma[i]


def test_effects_are_estimated_from_all_points_as_in_one_problem() -> None:
    """The points are solved without the effects; data, coefficients and effects in one problem are the reference."""
    rng, model = np.random.default_rng(21), TemperatureModel(25.0, (-40.0, 85.0), {"gyro_bias": 1, "accel_bias": 1})
    columns, points, rows, observed = len(model.columns), [], [], []
    scaled, size = 0.3 * PRIOR.sigma[[c.parameter for c in model.columns]], np.array([1.5, -0.5])
    for k, t in enumerate(TEMPERATURES):
        H, E = 30.0 * rng.normal(size=(60, COUNT)) / PRIOR.sigma, 20.0 * rng.normal(size=(60, 2))
        z = H @ model.basis(t) @ scaled + E @ size + rng.normal(size=60)
        posterior = np.linalg.inv(np.linalg.inv(PRIOR.covariance) + H.T @ H)
        weighted = np.linalg.solve(np.eye(60) + H @ PRIOR.covariance @ H.T, np.column_stack([E, z]))
        effects = ModelledEffects(np.zeros(COUNT), -posterior @ H.T @ E, E.T @ weighted[:, 2], E.T @ weighted[:, :2])
        solved = Posterior(posterior @ H.T @ z, posterior)
        points.append(TemperaturePoint(t, 0.0, 600.0 * k, "soak", 0, 1, PRIOR, solved, effects=effects))
        rows.append(np.hstack([H @ model.basis(t), E]))
        observed.append(z)
    A, sigma = np.vstack(rows), np.append(PRIOR.sigma[[c.parameter for c in model.columns]], [1.0, 1.0])
    covariance = np.linalg.inv(A.T @ A + np.diag(sigma**-2.0))
    mean = covariance @ A.T @ np.concatenate(observed)
    fit, expected = polynomials_of(model, points, PRIOR), np.sqrt(np.diag(covariance))[:columns]
    assert np.max(np.abs(fit.scaled - mean[:columns]) / expected) < 1e-3
    assert np.sqrt(np.diag(fit.scaled_covariance)) == pytest.approx(expected, rel=1e-5)
    assert fit_temperature(model, points, PRIOR).effects == pytest.approx(mean[columns:], abs=1e-5)


@pytest.mark.long
def test_sigmas_include_the_hysteresis_and_the_bias_instability() -> None:
    rng = np.random.default_rng(11)
    group, half = group_indices("accel_bias"), 0.01 * PRIOR.sigma[INDEX["accel_bias_x"]]
    at_rest, in_use = [], []
    for _ in range(30):
        scaled, truth = polynomials(rng)
        loop = half * rng.choice([-1.0, 1.0], 3)

        def looped(t, k, truth=truth, loop=loop):
            values = truth(t, k)
            values[group] += loop * np.sign(t - TEMPERATURES[max(k - 1, 0)])
            return values

        fit = fit_temperature(MODEL, measured(rng, looped), PRIOR)
        assert fit.hysteresis[group] == pytest.approx(half, rel=0.5)
        assert fit.at(60.0).sigma[group].min() > fit.hysteresis[group[0]]
        error = (fit.at(60.0).mean - MODEL.basis(60.0) @ scaled)[group]
        at_rest.append(error / fit.without_hysteresis.at(60.0).sigma[group])
        in_use.append((error - rng.choice([-1.0, 1.0]) * loop) / fit.at(60.0).sigma[group])
    assert 0.8 < np.std(at_rest) < 1.2
    assert 0.8 < np.std(in_use) < 1.2
    points = measured(rng, polynomials(rng)[1])
    before, drift = fit_temperature(MODEL, points, PRIOR).at(60.0).sigma, np.zeros(COUNT)
    drift[group] = 1e-3
    after = fit_temperature(MODEL, points, PRIOR, instability=drift).at(60.0).sigma
    assert np.hypot(before, drift) == pytest.approx(after, rel=1e-9)


@pytest.mark.long
def test_lags_of_gyros_and_accelerometers_are_estimated_from_a_ramp() -> None:
    rng, lags, errors = np.random.default_rng(12), np.array([25.0, -15.0]), []
    for _ in range(4):
        scaled, _ = polynomials(rng)
        ways = [(1.0, t) for t in np.linspace(-40.0, 85.0, 8)] + [(-1.0, t) for t in np.linspace(80.0, -40.0, 8)]
        rates = 4.0 / 60.0 * np.array([way for way, _ in ways])
        temperatures = [t for _, t in ways]

        def at(k, lag, rates=rates, temperatures=temperatures):
            """Return mean temperatures and rates of gyros and accelerometers."""
            return np.array([temperatures[k] - lag * rates[k], np.full(2, rates[k])])

        def truth(t, k, scaled=scaled, at=at):
            return MODEL.basis(*(row[ELEMENT_OF] for row in at(k, lags))) @ scaled

        assumed, points = np.zeros(2), measured(rng, truth, temperatures)
        for _ in range(3):
            points = [replace(p, rate=rates[k], elements=at(k, assumed)) for k, p in enumerate(points)]
            used, assumed = assumed, polynomials_of(RAMP, points, PRIOR, assumed).lags
        fit = fit_temperature(RAMP, points, PRIOR, used)
        assert fit.test.passed
        assert (fit.lag_sigmas < 3.0).all()
        errors += [(fit.lags - lags) / fit.lag_sigmas, (fit.at(70.0).mean - MODEL.basis(70.0) @ scaled)]
        errors[-1] = errors[-1] / fit.at(70.0).sigma
        blind = fit_temperature(MODEL, [replace(p, rate=0.0, elements=None) for p in points], PRIOR)
        assert not blind.test.passed
    assert np.concatenate(errors).std() == pytest.approx(1.0, abs=0.25)


@pytest.mark.long
def test_covariance_contains_the_course_of_a_hysteresis_at_the_turns_of_a_ramp() -> None:
    rng = np.random.default_rng(12)
    temperatures = (*np.arange(21.0, -44.0, -9.0), *np.arange(-42.0, 81.0, 9.0), *np.arange(75.0, 21.0, -9.0))
    middle, loops = 23.0, []
    for t in temperatures:
        middle = float(np.clip(middle, t - 8.0, t + 8.0))
        loops.append((t - middle) / 8.0)
    biases, nees = [*group_indices("gyro_bias"), *group_indices("accel_bias")], []
    for _ in range(15):
        scaled, truth = polynomials(rng)
        size = np.zeros(COUNT)
        size[biases] = 3e-3 * PRIOR.sigma[biases] * rng.uniform(-1.0, 1.0, 6)
        points = measured(rng, lambda t, k, truth=truth, size=size: truth(t, k) + size * loops[k], temperatures)
        fit = fit_temperature(MODEL, points, PRIOR)
        used = [k for k, c in enumerate(MODEL.columns) if c.parameter in biases]
        for found in (fit.without_hysteresis, polynomials_of(MODEL, points, PRIOR)):
            error = (found.scaled - scaled)[used]
            covariance = found.scaled_covariance[np.ix_(used, used)]
            nees.append(error @ np.linalg.solve(covariance, error) / len(used))
    assert np.mean(nees[::2]) == pytest.approx(1.0, abs=0.3)
    assert np.mean(nees[1::2]) > 2.0  # without the hysteresis


@pytest.mark.long
def test_scatter_of_one_group_is_no_hysteresis() -> None:
    rng = np.random.default_rng(10)
    causes = []
    for _ in range(20):
        _, truth = polynomials(rng)
        scatter = np.zeros((len(TEMPERATURES), COUNT))
        group = group_indices("gyro_bias")
        scatter[:, group] = 0.05 * PRIOR.sigma[group] * rng.normal(size=(len(TEMPERATURES), 3))
        points = measured(rng, lambda t, k, truth=truth, scatter=scatter: truth(t, k) + scatter[k])
        fit = fit_temperature(MODEL, points, PRIOR)
        assert not fit.test.passed
        assert fit.test.diagnosis.values["group"] == "gyro_bias"
        causes.append(fit.test.diagnosis.cause)
        assert fit.up_down == () or fit.test.diagnosis.cause != "temperature_scatter"
    assert causes.count("temperature_scatter") >= 18


def test_scatter_without_a_cause_is_named() -> None:
    rng = np.random.default_rng(9)
    for size, passed in ((0.0, True), (1e-3, False)):
        _, truth = polynomials(rng)
        scatter = size * PRIOR.sigma * rng.normal(size=(len(TEMPERATURES), COUNT))
        points = measured(rng, lambda t, k, truth=truth, scatter=scatter: truth(t, k) + scatter[k])
        test = fit_temperature(MODEL, points, PRIOR).test
        assert test.passed == passed
    assert test.diagnosis.cause == "temperature_scatter"


def test_orders_are_chosen_by_evidence() -> None:
    rng = np.random.default_rng(7)
    for _ in range(3):
        _, truth = polynomials(rng, {"gyro_bias": 3, "accel_scale": 1})
        points = measured(rng, truth, (25.0, -40.0, -20.0, 0.0, 25.0, 45.0, 65.0, 85.0, 25.0))
        chosen = with_orders(TemperatureModel(25.0, (-40.0, 85.0)), points, PRIOR)
        # one more than the significant order of each group, levers excepted
        assert chosen.order == {g: {"gyro_bias": 4, "accel_scale": 2}.get(g, 1) for g in GROUPS if g[-5:] != "lever"}


def test_held_out_temperature_is_compared_and_not_fitted() -> None:
    rng = np.random.default_rng(8)
    _, truth = polynomials(rng)
    points = held_out_points(measured(rng, truth), (-10.0,))
    fit = fit_temperature(MODEL, points, PRIOR)
    rows = fit.held_out(["gyro_bias_x", "accel_scale_z"])
    assert [(row.at, row.parameter) for row in rows] == [(-10.0, "gyro_bias_x"), (-10.0, "accel_scale_z")]
    assert all(abs(row.difference) < 5.0 * row.sigma for row in rows)
    twice = held_out_points(measured(rng, truth, (25.0, -10.4, 55.0, -9.8, 85.0)), (-10.0,))
    assert [p.is_held_out for p in twice] == [False, True, False, True, False]
    shifted = np.zeros(COUNT)
    shifted[INDEX["gyro_bias_x"]] = 0.1 * PRIOR.sigma[0]
    wrong = held_out_points(measured(rng, lambda t, k: truth(t, k) + shifted * (t == -10.0)), (-10.0,))
    test = fit_temperature(MODEL, wrong, PRIOR).held_out_test(["gyro_bias_x"])
    assert test is not None
    assert not test.passed


def test_hysteresis_after_soaks_is_not_taken_for_a_term_in_the_rate() -> None:
    """A unit at the end of a soak still changes by a little, in the direction from which it has come."""
    rng = np.random.default_rng(11)
    _, truth = polynomials(rng)
    i = INDEX["gyro_bias_y"]
    steps = np.sign(np.diff([25.0, *TEMPERATURES])) * (1.0 + 0.1 * (-1.0) ** np.arange(len(TEMPERATURES)))
    points = measured(rng, lambda t, k: truth(t, k) + 0.025 * steps[k] * PRIOR.sigma[i] * np.eye(COUNT)[i])
    points = [replace(p, rate=step * 0.05 / 60.0) for p, step in zip(points, steps, strict=True)]
    fit = fit_temperature(MODEL, points, PRIOR)
    assert {row.parameter for row in fit.up_down} == {"gyro_bias_x", "gyro_bias_y", "gyro_bias_z"}
    assert fit.test.diagnosis.cause != "temperature_rate"
    faster = [replace(p, rate=20.0 * p.rate) for p in points]
    assert fit_temperature(MODEL, faster, PRIOR).test.diagnosis.cause == "temperature_rate"
