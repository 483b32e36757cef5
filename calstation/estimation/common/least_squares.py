"""Maximum a posteriori (MAP) estimation by Gauss-Newton, consider parameters, and consistency tests."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import gammaincinv

from calstation.estimation.common.context import Posterior
from calstation.physics import COUNT, GROUPS, PARAMETERS, BoolArray, FloatArray

Point = TypeVar("Point")
Result = TypeVar("Result")

MAX_ITERATIONS = 60
#: Largest step of a converged iteration, in sigmas.
CONVERGED = 1e-3
#: Largest variance due to the unknowns in a tested direction, in units of the noise variance. Near 1, the products of
#: unknowns, which the linear covariance omits, may be as large as the noise.
MAX_EXPLAINED = 0.1
#: Smallest share of an innovation that lies in the tested directions, for it to be tested.
MIN_SHARE = 1e-6


class BatchGain(NamedTuple):
    """Gain of the 30 parameters from m observations in one batch."""

    jacobian: FloatArray  #: Shape (m, 30).
    gain: FloatArray  #: Shape (30, m).
    covariance: FloatArray  #: Covariance of the innovations, shape (m, m).
    innovation: FloatArray  #: Shape (m,).


@dataclass(frozen=True)
class MapResult:
    """Joint posterior of parameters and nuisance parameters, and the quality of the fit."""

    posterior: Posterior  #: Posterior of the 30 parameters.
    nuisance: FloatArray  #: Posterior mean of the nuisance parameters, shape (k,).
    residual: FloatArray  #: Observations minus model at the solution, shape (m,).
    redundancy: "Redundancy"  #: Test of the part of the innovations that the unknowns cannot explain, at the solution.
    gain: BatchGain  #: Gain of the last iteration.
    messages: tuple[tuple[str, Mapping[str, Any]], ...] = ()  #: ``not_converged`` if the iteration did not converge.


@dataclass(frozen=True)
class Redundancy:
    """Part of the innovations of a fit that its unknowns cannot explain, see `redundant_part`."""

    freedom: int  #: Number of independent directions in this part.
    total: float  #: Sum of the squares of the innovations in these directions, in units of sigma.
    #: This part of each decorrelated innovation, in its sigmas, shape (m,); NaN if the unknowns can explain it.
    normalised: FloatArray

    @property
    def consistency(self) -> "Consistency":
        """Mean square per degree of freedom, and its band."""
        return nis_consistency(self.total, self.freedom, 1)


#: Probabilities of a NIS below the lower and the upper end of its band.
NIS_BAND = (0.0005, 0.99999)


@dataclass(frozen=True)
class Consistency:
    """Normalised innovation squared (NIS) of a stage: mean over `count` observations or degrees of freedom, and band.

    If the model is correct, the mean is below the band in 1 of 2,000 stages, which is a warning, and above it in 1 of
    100,000, which fails the unit. If no observation is tested, all values are 0.
    """

    nis_mean: float
    nis_low: float
    nis_high: float
    count: int

    @property
    def passed(self) -> bool:
        """Whether the model explains the innovations."""
        return self.nis_mean <= self.nis_high

    @property
    def verdict(self) -> bool | None:
        """Whether the innovations passed; None if no observation was tested."""
        return bool(self.passed) if self.count else None

    @property
    def warning(self) -> bool:
        """Whether the innovations are smaller than predicted: the model is too conservative."""
        return self.nis_mean < self.nis_low


def gauss_newton(
    step: Callable[[Point], tuple[Point, Result, float]], start: Point, max_iterations: int = MAX_ITERATIONS
) -> tuple[Point, Result, bool]:
    """Repeat a Gauss-Newton step until it changes the unknowns by less than `CONVERGED` sigmas.

    `step` returns the next linearisation point, the result at the current one, and the largest change of an unknown, in
    sigmas. Return the last point and result, and whether the iteration converged within `max_iterations`.
    """
    point, result, change = step(start)
    for _ in range(max_iterations - 1):
        if change < CONVERGED:
            break
        point, result, change = step(point)
    return point, result, change < CONVERGED


def map_estimate(
    stage: str,
    model: Callable[[FloatArray, FloatArray], FloatArray],
    observed: FloatArray,
    noise: FloatArray,
    prior: Posterior,
    nuisance: FloatArray,
    nuisance_sigma: FloatArray,
    estimated: BoolArray,
    noisy: slice = slice(0, 0),
    groups: Collection[str] = GROUPS,
) -> MapResult:
    """Maximise p(parameters, nuisances | observed), relinearising until `estimated` parameters and nuisances converge.

    The covariance form (Bell and Cathey, *The iterated Kalman filter update as a Gauss-Newton method*, IEEE TAC
    38(2), 1993) allows a prior sigma of zero. The Jacobian is computed by central differences.

    Parameters
    ----------
    stage : name of the stage in the message
    model : (parameters, shape (30,); nuisances, shape (k,)) -> predicted observations, shape (m,)
    observed, noise : observed values and their variances, shape (m,)
    nuisance, nuisance_sigma : prior mean and sigma of the nuisance parameters, shape (k,)
    estimated : True for parameters that are relinearised; the others only affect the gain; shape (30,)
    noisy : nuisance parameters that are measurement errors, which the redundancy test treats as noise
    groups : parameter groups on which the model depends
    """
    prior_mean = np.concatenate([prior.mean, nuisance])
    P = np.zeros((len(prior_mean), len(prior_mean)))
    P[:COUNT, :COUNT] = prior.covariance
    P[COUNT:, COUNT:] = np.diag(nuisance_sigma**2)
    relinearised = np.concatenate([estimated, np.ones(len(nuisance), dtype=bool)])
    scale = np.minimum(np.sqrt(np.diag(P)), 1e-3) * 1e-2
    scale[:COUNT] *= [p.group in groups for p in PARAMETERS]
    R = np.diag(noise)

    def step(point: FloatArray) -> tuple[FloatArray, tuple[FloatArray, FloatArray, BatchGain], float]:
        predicted, H = _linearised(model, point, scale)
        S = H @ P @ H.T + R
        innovation = observed - predicted - H @ (prior_mean - point)
        K = np.asarray(np.linalg.solve(S, H @ P).T, np.float64)
        mean = prior_mean + K @ innovation
        I_KH = np.eye(len(prior_mean)) - K @ H
        covariance = I_KH @ P @ I_KH.T + K @ R @ K.T
        sigma, target = np.sqrt(np.diag(covariance)), np.where(relinearised, mean, prior_mean)
        change = float(np.max(np.abs(target - point) / np.where(sigma > 0.0, sigma, 1.0)))
        return target, (mean, covariance, BatchGain(H[:, :COUNT], K[:COUNT], S, innovation)), change

    _, (mean, covariance, gain), converged = gauss_newton(step, prior_mean)
    predicted, H = _linearised(model, mean, scale)
    noisy_columns = np.zeros(len(prior_mean), dtype=bool)
    noisy_columns[COUNT:][noisy] = True
    unknown, error = np.where(noisy_columns, 0.0, H), np.where(noisy_columns, H, 0.0)
    residual = observed - predicted
    redundancy = redundant_part(unknown @ P @ unknown.T, R + error @ P @ error.T, residual - H @ (prior_mean - mean))
    posterior = Posterior(mean[:COUNT], covariance[:COUNT, :COUNT])
    messages = () if converged else (("not_converged", {"stage": stage, "passes": MAX_ITERATIONS}),)
    return MapResult(posterior, mean[COUNT:], residual, redundancy, gain, messages)


def _linearised(
    model: Callable[[FloatArray, FloatArray], FloatArray], point: FloatArray, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return predicted observations and Jacobian, by central differences with steps `scale`; 0 for a step of 0."""
    predicted = model(point[:COUNT], point[COUNT:])
    columns = np.zeros((len(predicted), len(point)))
    for i in np.flatnonzero(scale):
        high, low = point.copy(), point.copy()
        high[i] += scale[i]
        low[i] -= scale[i]
        columns[:, i] = (model(high[:COUNT], high[COUNT:]) - model(low[:COUNT], low[COUNT:])) / (2.0 * scale[i])
    return predicted, columns


def redundant_part(explained: FloatArray, noise: FloatArray, innovation: FloatArray) -> Redundancy:
    """Return the part of `innovation` in the directions that the unknowns cannot explain (`MAX_EXPLAINED`).

    In the other directions, the unknowns absorb any innovation, and a test with a wide prior would always pass: twelve
    free tilts and six parameters leave no redundancy in 18 observations. The innovations in the tested directions are
    independent, and the sum of their squares is χ² distributed. They are the classical parity space (J. E. Potter, M.
    C. Suman, *Thresholdless redundancy management with arrays of skewed instruments*, AGARDograph 224, 1977), in which
    an unknown with an accurate prior is treated as known. `normalised` contains the statistics of the w-test (W.
    Baarda, *A testing procedure for use in geodetic networks*, 1968), each with a variance of 1, but correlated.

    Parameters
    ----------
    explained : covariance H P Hᵀ due to the unknowns and their priors, shape (m, m)
    noise : covariance of the measurement, shape (m, m)
    innovation : measured minus predicted values, shape (m,)
    """
    root = np.linalg.cholesky(noise)
    white = solve_triangular(root, innovation, lower=True)
    half = solve_triangular(root, explained, lower=True)
    size, directions = np.linalg.eigh(solve_triangular(root, half.T, lower=True))
    tested = size < MAX_EXPLAINED
    tested_directions = directions[:, tested]
    tests = tested_directions.T @ white / np.sqrt(1.0 + np.maximum(size[tested], 0.0))
    share = np.sum(tested_directions**2, axis=1)
    normalised = np.divide(
        tested_directions @ tests, np.sqrt(share), out=np.full(len(share), np.nan), where=share > MIN_SHARE
    )
    return Redundancy(int(tested.sum()), float(tests @ tests), normalised)


def consider_update(prior: Posterior, posterior: Posterior, estimated: BoolArray) -> Posterior:
    """Return the posterior of a consider (Schmidt) estimator, in which only the `estimated` parameters change.

    The other parameters keep their mean and covariance; the cross-covariances are those of the full update. For data
    processed in one batch the estimated part equals that of the full estimator (S. F. Schmidt, *Application of
    State-Space Methods*, 1966).

    Parameters
    ----------
    prior, posterior : estimates of n parameters before and after a full update
    estimated : whether each parameter is estimated, shape (n,)
    """
    mean = np.where(estimated, posterior.mean, prior.mean)
    considered = np.ix_(~estimated, ~estimated)
    covariance = posterior.covariance.copy()
    covariance[considered] = prior.covariance[considered]
    return Posterior(mean, 0.5 * (covariance + covariance.T))


def nis_consistency(total: float, count: int, dimension: int) -> Consistency:
    """Return the mean of `count` NIS values that sum to `total`, and its band (Bar-Shalom et al. 2001, 5.4).

    Parameters
    ----------
    total : sum of the normalised innovations squared
    count : number of innovations
    dimension : number of components of an innovation
    """
    if count == 0:
        return Consistency(0.0, 0.0, 0.0, 0)
    low, high = (chi_square_quantile(p, count * dimension) / count for p in NIS_BAND)
    return Consistency(total / count, float(low), float(high), count)


def chi_square_quantile(share: float, freedom: float) -> float:
    """Return a quantile of the χ² distribution, without scipy.stats, which takes a third of a second to import."""
    return float(2.0 * gammaincinv(0.5 * freedom, share))
