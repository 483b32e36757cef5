"""Gauss-Newton MAP for a handful of rests or turns: parameters with their prior, nuisances with theirs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular

from calstation.estimation.common.context import Belief
from calstation.physics.arrays import BoolArray, FloatArray
from calstation.physics.parameters import COUNT

MOST_ITERATIONS = 20
SETTLED = 1e-3


@dataclass(frozen=True)
class MapResult:
    """Joint posterior of the parameters and of the nuisances, and the test of the fit.

    chi2 : squared innovations y' (H P H' + R)⁻¹ y at the solution, as many as observations
    residual : observations less model at the solution
    normalised : the innovations freed of their correlation, in units of sigma; their squares sum to chi2
    messages : ``not_settled`` where the last iteration still moved something that matters
    """

    belief: Belief
    nuisance: FloatArray
    chi2: float
    residual: FloatArray
    normalised: FloatArray
    messages: tuple[tuple[str, Mapping[str, Any]], ...] = ()


def gauss_newton(
    stage: str,
    model: Callable[[FloatArray, FloatArray], FloatArray],
    observed: FloatArray,
    noise: FloatArray,
    prior: Belief,
    nuisance: FloatArray,
    nuisance_sigma: FloatArray,
    estimated: BoolArray,
) -> MapResult:
    """Maximise p(parameters, nuisances | observed) of `stage`, relinearising until `estimated` and nuisances settle.

    Parameters
    ----------
    model : (parameters, shape (30,); nuisances, shape (k,)) -> predicted observations, shape (m,)
    observed, noise : values and variances, shape (m,)
    prior : of the parameters; those not `estimated` enter the gain but are not relinearised
    nuisance, nuisance_sigma : prior mean and sigma, shape (k,); a sigma may be infinite-like (large)

    Notes
    -----
    Covariance form (Bell and Cathey, *The iterated Kalman filter update as a Gauss-Newton method*, IEEE TAC
    38(2), 1993), so a prior sigma of zero is allowed. Jacobian by central differences in steps of the scale of
    each unknown.
    """
    mean = np.concatenate([prior.mean, nuisance])
    P = np.zeros((len(mean), len(mean)))
    P[:COUNT, :COUNT] = prior.covariance
    P[COUNT:, COUNT:] = np.diag(nuisance_sigma**2)
    free = np.concatenate([estimated, np.ones(len(nuisance), dtype=bool)])
    scale = np.minimum(np.sqrt(np.diag(P)), 1e-3) * 1e-2
    R = np.diag(noise)
    point = mean.copy()
    for _ in range(MOST_ITERATIONS):
        predicted = model(point[:COUNT], point[COUNT:])
        H = _jacobian(model, point, scale)
        S = H @ P @ H.T + R
        innovation = observed - predicted - H @ (mean - point)
        K = np.linalg.solve(S, H @ P).T
        posterior = mean + K @ innovation
        target = np.where(free, posterior, mean)
        I_KH = np.eye(len(mean)) - K @ H
        covariance = I_KH @ P @ I_KH.T + K @ R @ K.T
        sigma = np.sqrt(np.diag(covariance))
        moved = np.max(np.abs(target - point) / np.where(sigma > 0.0, sigma, 1.0))
        point = target
        if moved < SETTLED:
            unsettled: tuple[tuple[str, Mapping[str, Any]], ...] = ()
            break
    else:
        unsettled = (("not_settled", {"stage": stage, "passes": MOST_ITERATIONS}),)
    chi2 = float(innovation @ np.linalg.solve(S, innovation))
    normalised = solve_triangular(np.linalg.cholesky(S), innovation, lower=True)
    belief = Belief(posterior[:COUNT], covariance[:COUNT, :COUNT])
    residual = observed - model(posterior[:COUNT], posterior[COUNT:])
    return MapResult(belief, posterior[COUNT:], chi2, residual, normalised, unsettled)


def _jacobian(
    model: Callable[[FloatArray, FloatArray], FloatArray], point: FloatArray, scale: FloatArray
) -> FloatArray:
    columns: list[FloatArray] = []
    for i, h in enumerate(scale):
        if h == 0.0:
            columns.append(
                np.zeros_like(columns[0]) if columns else model(point[:COUNT], point[COUNT:]) * 0.0
            )
            continue
        high, low = point.copy(), point.copy()
        high[i] += h
        low[i] -= h
        columns.append((model(high[:COUNT], high[COUNT:]) - model(low[:COUNT], low[COUNT:])) / (2.0 * h))
    return np.stack(columns, axis=1)
