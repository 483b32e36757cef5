"""MAP and consider estimates agree with closed forms of the linear Gaussian case."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.estimation.common import Posterior, consider_update, map_estimate, nis_consistency
from calstation.estimation.common.least_squares import MAX_ITERATIONS, redundant_part
from calstation.physics import COUNT, PARAMETERS

ALL = np.ones(COUNT, dtype=bool)
SEEDS = st.integers(0, 2**31)


def correlated_prior(random, size=1.0):
    root = random.normal(size=(COUNT, COUNT)) * size
    return Posterior(random.normal(size=COUNT) * size, root @ root.T + 0.1 * size**2 * np.eye(COUNT))


def linear_case(seed, nuisances=4, observations=20):
    """A linear model with its observations, and its posterior in information form."""
    random = np.random.default_rng(seed)
    prior = correlated_prior(random)
    nuisance, nuisance_sigma = random.normal(size=nuisances), random.uniform(0.5, 2.0, nuisances)
    A = random.normal(size=(observations, COUNT))
    B = random.normal(size=(observations, nuisances))
    noise = random.uniform(0.5, 2.0, observations)
    observed = random.normal(size=observations) * 5.0
    H = np.hstack([A, B])
    P = np.zeros((COUNT + nuisances,) * 2)
    P[:COUNT, :COUNT], P[COUNT:, COUNT:] = prior.covariance, np.diag(nuisance_sigma**2)
    information = np.linalg.inv(P) + H.T @ (H / noise[:, None])
    mean = np.concatenate([prior.mean, nuisance])
    posterior = mean + np.linalg.solve(information, H.T @ ((observed - H @ mean) / noise))
    arguments = (observed, noise, prior, nuisance, nuisance_sigma)
    return (lambda p, n: A @ p + B @ n), arguments, H, posterior, np.linalg.inv(information)


@given(SEEDS)
def test_linear_model_gives_the_gaussian_posterior(seed):
    model, arguments, _, posterior, covariance = linear_case(seed)
    result = map_estimate("test", model, *arguments, ALL)
    assert result.posterior.mean == pytest.approx(posterior[:COUNT], abs=1e-6)
    assert result.nuisance == pytest.approx(posterior[COUNT:], abs=1e-6)
    assert result.posterior.covariance == pytest.approx(covariance[:COUNT, :COUNT], abs=1e-6)


def test_only_parameters_in_the_model_are_varied():
    model, arguments, *_ = linear_case(3)
    entering = np.array([p.group.startswith("gyro") for p in PARAMETERS])
    calls = []

    def counted(p, n):
        calls.append(p)
        return model(np.where(entering, p, 0.0), n)

    every = map_estimate("test", counted, *arguments, ALL)
    all_calls = len(calls)
    chosen = map_estimate("test", counted, *arguments, ALL, groups=("gyro_bias", "gyro_scale", "gyro_misalign"))
    assert len(calls) - all_calls < all_calls
    assert np.array_equal(chosen.posterior.mean, every.posterior.mean)
    assert np.array_equal(chosen.posterior.covariance, every.posterior.covariance)


@given(SEEDS)
def test_residual_is_evaluated_at_the_posterior_mean(seed):
    model, arguments, *_ = linear_case(seed)
    result = map_estimate("test", model, *arguments, ALL)
    assert result.residual == pytest.approx(arguments[0] - model(result.posterior.mean, result.nuisance), abs=1e-9)


def redundancy_case(seed, unknowns=6, observations=14, width=1.0):
    """Return H, the covariances of unknowns and noise, and a random number generator."""
    random = np.random.default_rng(seed)
    H, root = random.normal(size=(observations, unknowns)), random.normal(size=(observations, observations))
    return H, width**2 * np.eye(unknowns), root @ root.T + np.eye(observations), random


@given(SEEDS)
def test_redundancy_with_free_unknowns_equals_the_least_squares_residual(seed):
    H, P, N, random = redundancy_case(seed, width=1e4)
    observed = random.normal(size=len(H)) * 3.0
    weight = np.linalg.inv(N)
    residual = observed - H @ np.linalg.solve(H.T @ weight @ H, H.T @ weight @ observed)
    output = redundant_part(H @ P @ H.T, N, observed)
    assert output.freedom == len(H) - H.shape[1]
    assert output.total == pytest.approx(residual @ weight @ residual, rel=1e-4)


@given(SEEDS)
def test_redundancy_with_known_parameters_uses_every_observation(seed):
    H, P, N, random = redundancy_case(seed, width=1e-6)
    observed = random.normal(size=len(H)) * 3.0
    output = redundant_part(H @ P @ H.T, N, observed)
    assert output.freedom == len(H)
    assert output.total == pytest.approx(observed @ np.linalg.solve(N, observed), rel=1e-6)


def test_equal_numbers_of_unknowns_and_observations_leave_no_redundancy():
    H, P, N, random = redundancy_case(4, 14, width=1e4)
    output = redundant_part(H @ P @ H.T, N, random.normal(size=14))
    assert output.freedom == 0
    assert output.total == 0.0
    assert np.all(np.isnan(output.normalised))
    assert output.consistency.count == 0
    assert output.consistency.passed
    assert not output.consistency.warning


@pytest.mark.long
@pytest.mark.parametrize("width", [1e-3, 1.0, 1e3])
def test_redundancy_bounds_contain_999_of_1000_cases(width):
    H, P, N, random = redundancy_case(6, width=width)
    prior, noise = np.linalg.cholesky(P), np.linalg.cholesky(N)
    outside, total = 0, 0.0
    for _ in range(4000):
        observed = H @ prior @ random.normal(size=H.shape[1]) + noise @ random.normal(size=len(H))
        output = redundant_part(H @ P @ H.T, N, observed)
        outside += not output.consistency.passed or output.consistency.warning
        total += output.consistency.nis_mean
    assert total / 4000 == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 / output.freedom / 4000))
    assert outside <= 14  # expected 4, Poisson


@pytest.mark.parametrize("unknowns", [6, 13])
def test_every_tested_innovation_has_a_variance_of_one(unknowns):
    H, P, N, _ = redundancy_case(3, unknowns, width=1e4)
    H[0] = 0.0
    H[0, 0] = 1.0
    H[1:, 0] = 0.0  # only the first observation depends on the first unknown
    explained, noise = H @ P @ H.T, np.diag(np.diag(N))
    root = np.sqrt(noise)
    output = np.stack(
        [redundant_part(explained, noise, unit).normalised for unit in root], axis=1
    )  # linear in its noise
    assert np.isnan(output[0]).all()
    np.testing.assert_allclose(np.linalg.norm(output[1:], axis=1), 1.0, rtol=1e-6)


def test_random_nuisance_parameters_count_as_noise():
    prior = Posterior(np.zeros(COUNT), 1e8 * np.eye(COUNT))
    observed, noise = np.array([1.0, 5.0]), np.full(2, 1e-6)

    def model(p, n):
        return p[0] + n

    output = [
        map_estimate("test", model, observed, noise, prior, np.zeros(2), np.ones(2), ALL, noisy).redundancy
        for noisy in (slice(0, 0), slice(0, 2))
    ]
    assert [f.freedom for f in output] == [0, 1]
    # the difference of two readings with a sigma of 1 each
    assert output[1].total == pytest.approx(16.0 / 2.0, rel=1e-5)


def test_exactly_known_parameters_do_not_change():
    model, arguments, *_ = linear_case(5)
    observed, noise, prior, nuisance, nuisance_sigma = arguments
    covariance = prior.covariance.copy()
    for known in (0, 7):
        covariance[known, :] = covariance[:, known] = 0.0
    result = map_estimate(
        "test", model, observed, noise, Posterior(prior.mean, covariance), nuisance, nuisance_sigma, ALL
    )
    assert np.all(np.isfinite(result.posterior.covariance))
    for known in (0, 7):
        assert result.posterior.mean[known] == pytest.approx(prior.mean[known], abs=1e-12)
        assert result.posterior.covariance[known] == pytest.approx(np.zeros(COUNT), abs=1e-12)


def test_nonlinear_model_is_relinearised_at_its_solution():
    prior = Posterior(np.zeros(COUNT), np.diag(np.r_[1.0, np.full(COUNT - 1, 1e-12)]))
    result = map_estimate(
        "test",
        lambda p, n: np.array([np.exp(p[0])]),
        np.array([np.e]),
        np.array([1e-8]),
        prior,
        np.zeros(0),
        np.zeros(0),
        ALL,
    )
    assert result.posterior.mean[0] == pytest.approx(1.0, abs=1e-6)
    assert result.messages == ()
    # sigma over slope, at the solution and not at the prior's mean
    assert result.posterior.sigma[0] == pytest.approx(1e-4 / np.e, rel=1e-3)


def test_consider_parameters_are_not_relinearised():
    seen = []

    def model(p, n):
        seen.append(p[1])
        return np.array([p[0] + p[1], p[0] * p[1] + p[0]])

    prior = Posterior(np.zeros(COUNT), np.diag(np.r_[1.0, 0.5, np.full(COUNT - 2, 1e-12)]) ** 2)
    estimated = ALL.copy()
    estimated[1] = False
    map_estimate("test", model, np.array([1.0, 0.8]), np.full(2, 1e-4), prior, np.zeros(0), np.zeros(0), estimated)
    # the last calls evaluate the residual and its redundancy; all before are small steps about the prior's mean
    assert max(abs(value) for value in seen[: -2 * COUNT - 1]) < 1e-4


def schmidt(prior, H, noise, observed, estimated):
    """Return Schmidt's batch update in partitioned form: x estimated, p considered (Schmidt 1966; Jazwinski, 8.3)."""
    x, p = np.flatnonzero(estimated), np.flatnonzero(~estimated)
    P = prior.covariance
    Pxx, Pxp, Ppp = P[np.ix_(x, x)], P[np.ix_(x, p)], P[np.ix_(p, p)]
    Hx, Hp = H[:, x], H[:, p]
    R = np.diag(noise)
    S = Hx @ Pxx @ Hx.T + Hx @ Pxp @ Hp.T + Hp @ Pxp.T @ Hx.T + Hp @ Ppp @ Hp.T + R
    K = (Pxx @ Hx.T + Pxp @ Hp.T) @ np.linalg.inv(S)
    mean, covariance = prior.mean.copy(), P.copy()
    mean[x] += K @ (observed - H @ prior.mean)
    covariance[np.ix_(x, x)] = Pxx - K @ S @ K.T
    cross = Pxp - K @ (Hx @ Pxp + Hp @ Ppp)
    covariance[np.ix_(x, p)], covariance[np.ix_(p, x)] = cross, cross.T
    return mean, covariance


@given(SEEDS, st.integers(1, COUNT - 1))
def test_consider_posterior_equals_schmidts_update(seed, count):
    random = np.random.default_rng(seed)
    estimated = np.zeros(COUNT, dtype=bool)
    estimated[random.choice(COUNT, count, replace=False)] = True
    prior = correlated_prior(random)
    H, noise, observed = random.normal(size=(12, COUNT)), random.uniform(0.1, 1.0, 12), random.normal(size=12)
    full = map_estimate("test", lambda p, n: H @ p, observed, noise, prior, np.zeros(0), np.zeros(0), ALL).posterior
    output = consider_update(prior, full, estimated)
    mean, covariance = schmidt(prior, H, noise, observed, estimated)
    assert output.mean == pytest.approx(mean, abs=1e-5)
    assert output.covariance == pytest.approx(covariance, abs=1e-5)
    kept = ~estimated
    assert np.array_equal(output.mean[kept], prior.mean[kept])
    assert np.array_equal(np.diag(output.covariance)[kept], np.diag(prior.covariance)[kept])
    assert np.linalg.eigvalsh(output.covariance).min() > -1e-9
    assert np.array_equal(output.covariance, output.covariance.T)


def test_consider_posterior_has_the_correct_limit_cases():
    model, arguments, *_ = linear_case(8)
    prior = arguments[2]
    full = map_estimate("test", model, *arguments, ALL).posterior
    nothing = consider_update(prior, full, ~ALL)
    assert np.array_equal(nothing.mean, prior.mean)
    assert nothing.covariance == pytest.approx(prior.covariance, rel=1e-12)
    assert np.array_equal(consider_update(prior, full, ALL).mean, full.mean)


def test_nis_bounds_contain_999_of_1000_means():
    random = np.random.default_rng(3)
    consistency = nis_consistency(0.0, 40, 3)
    means = random.chisquare(3, (20000, 40)).mean(axis=1)
    outside = np.mean((means < consistency.nis_low) | (means > consistency.nis_high))
    assert 0.0003 < outside < 0.002


def test_nis_above_its_bounds_fails_and_below_its_bounds_warns():
    assert not nis_consistency(40 * 5.0, 40, 3).passed
    low = nis_consistency(40 * 1.0, 40, 3)
    assert low.passed
    assert low.warning
    right = nis_consistency(40 * 3.0, 40, 3)
    assert right.passed
    assert not right.warning


def test_divergence_is_reported():
    jump = iter(range(10_000))
    prior = Posterior(np.zeros(COUNT), np.eye(COUNT))
    result = map_estimate(
        "rate",
        lambda p, n: np.array([p[0] + (-1.0) ** (next(jump) // (2 * COUNT + 1))]),
        np.array([0.0]),
        np.array([1e-6]),
        prior,
        np.zeros(0),
        np.zeros(0),
        ALL,
    )
    assert result.messages == (("not_converged", {"stage": "rate", "passes": MAX_ITERATIONS}),)
