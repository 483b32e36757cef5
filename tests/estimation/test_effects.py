"""Score tests find unmodelled effects, with the sizes and parameter shifts of an augmented model."""

import numpy as np
import pytest
from simulated_stages import with_effect

from calstation.estimation.common import BatchGain, Posterior
from calstation.estimation.effects import EffectEvidence, EffectTests, StageEffects, parameter_changes
from calstation.physics import COUNT, EFFECTS, INDEX, NAMES, PARAMETERS, Motion, OuterTurn, rotation_matrix
from calstation.simulation.study import draw_unit, simulate_stages, study_prior
from procedures import DEFAULT_STAGES, method

SIGMA = np.array([p.prior_sigma for p in PARAMETERS])


def test_score_test_equals_the_estimate_of_the_augmented_model() -> None:
    random = np.random.default_rng(1)
    count = sum(len(c.components) for c in EFFECTS)
    H, constant = random.normal(size=(80, COUNT)) / SIGMA, random.normal(size=(80, count))
    added = np.hstack([constant, np.zeros((80, sum(len(c.components) for c in parameter_changes(1.0))))])
    truth = SIGMA * random.normal(size=COUNT)
    tests, posterior = EffectTests(SIGMA), Posterior(np.zeros(COUNT), np.diag(SIGMA**2))
    size = 0.02 * np.array([c.plausible for c in EFFECTS if c.cause == "time_skew"])[0]
    skew = [name for c in EFFECTS for name in c.names].index("time_skew")
    observed = H @ truth + size * constant[:, skew] + 1e-4 * random.normal(size=80)
    for rows in (slice(0, 45), slice(45, 80)):
        h, y = H[rows], observed[rows] - H[rows] @ posterior.mean
        S = h @ posterior.covariance @ h.T + 1e-8 * np.eye(len(h))
        K = np.linalg.solve(S, h @ posterior.covariance).T
        tests.add(
            "a stage",
            StageEffects(0.0, 1.0).batch_sensitivity(BatchGain(h, K, S, y), added[rows], np.ones(COUNT, dtype=bool)),
            NAMES,
        )
        posterior = Posterior(posterior.mean + K @ y, posterior.covariance - K @ h @ posterior.covariance)
    result = next(f for f in tests.evidence(posterior) if f.cause == "time_skew")
    augmented, plausible = np.hstack([H, constant[:, [skew]]]), 0.02
    normal = augmented.T @ augmented * 1e8 + np.diag([*SIGMA**-2.0, plausible**-2.0])
    solution = np.linalg.solve(normal, augmented.T @ observed * 1e8)
    assert (result.size, result.sigma) == pytest.approx(
        (solution[-1], np.sqrt(np.linalg.inv(normal)[-1, -1])), rel=1e-5
    )
    expected = (posterior.mean - solution[:COUNT]) / posterior.sigma
    np.testing.assert_allclose(
        [result.parameter_shift[name] for name in NAMES], expected, atol=1e-3 * np.abs(expected).max()
    )


def test_effects_are_sorted_by_start_time_and_zero_before_it() -> None:
    time = np.linspace(0.5, 80.0, 160)
    moved = Motion(*np.random.default_rng(4).normal(size=(4, 160, 3)), time)
    candidates = list(parameter_changes(80.0))
    assert [c.begin for c in candidates] == sorted(c.begin for c in candidates)
    for c in candidates:
        errors = np.abs(c.errors(moved)).max(axis=(1, 2))
        assert not errors[time < c.begin].any()
        assert errors[time >= c.begin].all()


def test_drift_is_estimated_across_the_stages_of_a_run() -> None:
    random, settled = np.random.default_rng(2), 300.0
    stages = {(0.0, 400.0): slice(0, 45), (600.0, 500.0): slice(45, 80)}
    names = ["gyro_bias_x", "gyro_bias_y", "gyro_bias_z"]
    i = [INDEX[name] for name in names]
    H = random.normal(size=(80, COUNT)) / SIGMA
    time = np.concatenate([np.linspace(0.0, 400.0, 45), np.linspace(600.0, 1100.0, 35)])
    courses = np.stack([time / 1100.0, np.expm1(-time / settled) / np.expm1(-1100.0 / settled)], axis=1)
    regressors = (H[:, i, None] * courses[:, None, :]).reshape(80, 6)  # of the sizes at the end
    theta = 0.1 * np.repeat(SIGMA[i], 2) * random.normal(size=6)
    observed = regressors @ theta + 1e-4 * random.normal(size=80)
    tests, posterior = EffectTests(SIGMA), Posterior(np.zeros(COUNT), np.diag(SIGMA**2))
    count = sum(len(c.components) for c in EFFECTS)
    for (begin, duration), rows in stages.items():
        h, y = H[rows], observed[rows] - H[rows] @ posterior.mean
        S = h @ posterior.covariance @ h.T + 1e-8 * np.eye(len(h))
        K = np.linalg.solve(S, h @ posterior.covariance).T
        part = (time[rows] - begin)[:, None]
        shapes = np.hstack([part / duration, np.expm1(-part / settled) / np.expm1(-duration / settled)])
        added = [
            (h[:, i, None] * shapes[:, None, :]).reshape(len(h), 6)
            if (c.cause, c.parameters[:1]) == ("drift", ("gyro_bias_x",))
            else np.zeros((len(h), len(c.components)))
            for c in parameter_changes(duration)
        ]
        columns = np.hstack([np.zeros((len(h), count)), *added])
        tests.add(
            "a stage",
            StageEffects(begin, duration).batch_sensitivity(BatchGain(h, K, S, y), columns, np.ones(COUNT, bool)),
            NAMES,
        )
        posterior = Posterior(posterior.mean + K @ y, posterior.covariance - K @ h @ posterior.covariance)
    result = next(f for f in tests.evidence(posterior) if f.cause == "drift_throughout" and f.parameter in names)
    augmented = np.hstack([H, regressors])
    normal = augmented.T @ augmented * 1e8 + np.diag([*SIGMA**-2.0, *np.repeat(SIGMA[i], 2) ** -2.0])
    solution, covariance = np.linalg.solve(normal, augmented.T @ observed * 1e8), np.linalg.inv(normal)
    both_courses = np.repeat(np.eye(3), 2, axis=1)
    size = both_courses @ solution[COUNT:]
    sigma = np.sqrt(np.diag(both_courses @ covariance[COUNT:, COUNT:] @ both_courses.T))
    best = int(np.argmax(np.abs(size) / sigma))
    assert result.parameter == names[best]
    assert (result.size, result.sigma) == pytest.approx((size[best], sigma[best]), rel=1e-5)
    at_end = solution[:COUNT].copy()
    at_end[i] += solution[COUNT:].reshape(3, 2).sum(axis=1)
    expected = (posterior.mean - at_end) / posterior.sigma
    np.testing.assert_allclose(
        [result.parameter_shift[name] for name in NAMES], expected, atol=1e-3 * np.abs(expected).max()
    )


def solved(
    seed: int,
    cause: str,
    size: float,
    schedules: dict[str, dict[str, float]],
    stages: tuple[str, ...],
    component: int = 0,
) -> tuple[list[EffectEvidence], np.ndarray, np.ndarray]:
    """Return effects found in simulated stages of a navigation-grade unit, its errors in sigmas, and the mean NIS."""
    truth, context = draw_unit("nav", seed, "estimated", instability=False)
    data = simulate_stages(truth, seed, list(stages), schedules)
    posterior = study_prior("nav", "estimated")
    tests, nis = EffectTests(posterior.sigma), []
    for stage in stages:
        m = method(stage)
        solver = m.solver(context, posterior, m.schedule(**schedules.get(stage, {})))
        solver.feed(with_effect(data[stage], context, truth.parameters, cause, size, component))
        solution = solver.finish()
        posterior = solution.posterior
        assert solution.sensitivity is not None
        tests.add(stage, solution.sensitivity, solution.estimated)
        nis.append(solution.consistency.nis_mean)
    return tests.evidence(posterior), (posterior.mean - truth.parameters) / posterior.sigma, np.array(nis)


SHORT = {"excitation": {"dwell_s": 5.0, "rounds": 1}}


@pytest.mark.long
def test_effect_is_reported_with_its_size_and_parameter_shifts() -> None:
    result, errors, _ = solved(1, "accel_cubic", 2e-6, SHORT, ("excitation",))
    first = result[0]
    assert (first.cause, first.component, first.excess > 30.0) == ("accel_cubic", "x", True)
    assert first.size == pytest.approx(2e-6, rel=0.1)
    worst = max(first.parameter_shift, key=lambda name: abs(first.parameter_shift[name]))
    without = solved(1, "accel_cubic", 0.0, SHORT, ("excitation",))[1]
    shift = [first.parameter_shift[name] for name in NAMES]
    assert errors - without == pytest.approx(shift, rel=0.15, abs=4.0)
    assert (errors - without)[INDEX[worst]] == pytest.approx(first.parameter_shift[worst], rel=0.1)


#: Sizes and components: a gyro's sensitivity to force along its own axis is an azimuth rate, which gravity hides.
SIZES = {
    "g_sensitivity": (5e-8, 1),
    "gyro_asymmetry": (2e-5, 0),
    "accel_cubic": (1e-6, 0),
    "accel_off_axis": (5e-3, 0),
    "time_skew": (2e-3, 0),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("cause", SIZES)
def test_every_significant_effect_is_listed_first(cause: str) -> None:
    size, component = SIZES[cause]
    result, errors, _ = solved(2, cause, size, {}, DEFAULT_STAGES, component)
    assert result[0].excess > 30.0
    alike = {"gyro_asymmetry", "gyro_square"}  # the same at one rate
    assert result[0].cause in (alike if cause in alike else {cause})
    shift = result[0].parameter_shift
    worst = max(shift, key=lambda name: abs(shift[name]))
    assert errors[INDEX[worst]] == pytest.approx(shift[worst], abs=4.5 + 0.1 * abs(shift[worst]))


@pytest.mark.long
@pytest.mark.parametrize("seed", [3, 4])
def test_no_effect_is_found_for_an_ideal_unit(seed: int) -> None:
    result, errors, nis = solved(seed, "time_skew", 0.0, {}, DEFAULT_STAGES)
    assert result[0].excess < 20.0
    assert np.abs(errors).max() < 4.5
    assert np.all(nis < [12.0, 12.0, 3.2, 3.2])  # rests and turns have few redundant observations


@pytest.mark.long
def test_modelled_effects_are_estimated_with_the_parameters() -> None:
    truth, context = draw_unit("nav", 5, "estimated", instability=False)
    data = simulate_stages(truth, 5, list(DEFAULT_STAGES), {})
    posterior = study_prior("nav", "estimated")
    tests = EffectTests(posterior.sigma, ("accel_cubic", "time_skew"))
    for stage in DEFAULT_STAGES:
        m = method(stage)
        solver = m.solver(context, posterior, m.schedule())
        solver.feed(with_effect(data[stage], context, truth.parameters, "accel_cubic", 1e-6))
        solution = solver.finish()
        posterior = solution.posterior
        assert solution.sensitivity is not None
        tests.add(stage, solution.sensitivity, solution.estimated)
    known, wrong = tests.estimate(), (posterior.mean - truth.parameters) / posterior.sigma
    assert np.abs(wrong).max() > 100.0
    size = dict(zip(known.names, known.size, strict=True))
    sigma = dict(zip(known.names, np.sqrt(np.diag(known.covariance)), strict=True))
    assert abs(size["accel_cubic_x"] - 1e-6) < 4.5 * sigma["accel_cubic_x"]
    assert all(abs(size[name]) < 4.5 * sigma[name] for name in known.names if name != "accel_cubic_x")
    corrected = known.correct(posterior)
    assert np.abs((corrected.mean - truth.parameters) / corrected.sigma).max() < 4.5
    assert tests.evidence(corrected)[0].excess < 20.0


def test_velocity_of_an_axis_offset_is_its_mean_over_the_interval() -> None:
    """The unit turns about the outer axis by 60° within an interval of 0.1 s, and also about the inner axis."""
    outer, inner, duration = np.array([0.6, 0.8, 0.0]), np.array([0.0, 0.0, 1.0]), 0.1
    angles = np.linspace(0.0, np.pi / 3.0, 2001)
    directions = np.array([rotation_matrix(angle * outer) @ inner for angle in angles])
    offset = np.stack([np.cross(outer, directions), directions], axis=2)  # outer axis × inner axis, and inner axis
    velocity = np.cross(outer, offset, axisb=1).transpose(0, 2, 1) * np.gradient(angles, duration / 2000)[:, None, None]
    mean = np.trapezoid(velocity, axis=0) / 2000
    effect = next(e for e in EFFECTS if e.cause == "axis_offset")
    turn = OuterTurn(outer[None], directions[:1], directions[-1:], np.array([duration]))
    assert effect.velocity is not None
    assert effect.velocity(turn)[0] == pytest.approx(mean, abs=1e-5)
