"""Response of a stage's innovations and estimates to errors of the prior and to effects outside the model.

An effect that is not modelled adds J θ to the innovations and leaves the error D θ in the estimate (truth minus
estimate). Both follow from the gains of the estimator, optimal or not.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numba as nb
import numpy as np

from calstation.estimation.effects.candidates import CONSTANT, Candidate, Motion, changing
from calstation.physics import COUNT, BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Sensitivity:
    """Score and information of c columns, and the estimation errors that they cause.

    The columns are an error of each parameter's prior mean (30), the components of `CONSTANT`, and the components of
    `changing`.
    """

    score: FloatArray  #: Jᵀ S⁻¹ ν, shape (c,).
    information: FloatArray  #: Jᵀ S⁻¹ J, shape (c, c).
    error: FloatArray  #: D: error left in each parameter, truth minus estimate, shape (30, c).
    changing: tuple[Candidate, ...] = ()  #: Effects that change a parameter during the stage.
    begin: float = 0.0  #: Time at which the stage begins, s.
    duration: float = 0.0  #: Duration of the stage, s.
    #: χ² of the innovations with the noise of the estimate, divided by χ² with the noise of `score` and `information`.
    noise_ratio: float = 1.0


def all_errors(motion: Motion, candidates: Sequence[Candidate], counts: IntArray) -> FloatArray:
    """Return the errors of the six channels due to the constant effects and `candidates`, shape (k, 6, components).

    They are averaged over k groups of `counts` intervals, shape (k,).
    """
    return mean_errors(motion, (*CONSTANT, *candidates), counts)


def mean_errors(motion: Motion, candidates: Sequence[Candidate], counts: IntArray) -> FloatArray:
    """Return the same as `all_errors` for `candidates` alone."""
    regressors, places = mean_regressors(motion, candidates, counts)
    errors = np.zeros((len(counts), 6, sum(len(c.components) for c in candidates)))
    channel, component, regressor = places.T
    errors[:, channel, component] = regressors[:, regressor]
    return errors


def mean_regressors(motion: Motion, candidates: Sequence[Candidate], counts: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the regressors of candidates averaged over k groups of `counts` intervals, and the channels they apply to.

    The means have the shape (k, r), the places (channel, component, regressor) the shape (places, 3).
    """
    means = [np.empty((len(counts), 0))]
    places: list[tuple[int, int, int]] = []
    component = regressor = 0
    for c in candidates:
        means.append(_means(c.regressors(motion), counts))
        places += [(p.channel, component + p.component, regressor + p.regressor) for p in c.places]
        component, regressor = component + len(c.components), regressor + means[-1].shape[1]
    return np.hstack(means), np.array(places, dtype=np.int64).reshape(-1, 3)


@nb.njit(cache=True)
def _means(values: FloatArray, counts: IntArray) -> FloatArray:
    """Return the means of the rows of `values`, shape (n, m), over k groups of `counts` rows, shape (k, m)."""
    means, first = np.zeros((len(counts), values.shape[1])), 0
    for g in range(len(counts)):
        for k in range(first, first + counts[g]):
            for j in range(values.shape[1]):
                means[g, j] += values[k, j]
        for j in range(values.shape[1]):
            means[g, j] /= counts[g]
        first += counts[g]
    return means


def batch_sensitivity(
    jacobian: FloatArray,
    gain: FloatArray,
    covariance: FloatArray,
    innovation: FloatArray,
    added: FloatArray,
    estimated: BoolArray,
    begin: float,
    duration: float,
) -> Sensitivity:
    """Return the sensitivity of an estimate from m observations in one batch.

    Parameters
    ----------
    jacobian, gain : of the 30 parameters, shapes (m, 30) and (30, m)
    covariance, innovation : of the innovations, shapes (m, m) and (m,)
    added : contribution of each component of `CONSTANT` and of `changing` to the observations, shape (m, components)
    estimated : True for the parameters that the gain corrects, shape (30,)
    begin, duration : of the stage, s
    """
    response = np.hstack([jacobian, added])
    weighted = np.linalg.solve(covariance, response)
    before = np.eye(COUNT, response.shape[1])
    error = before - np.where(estimated[:, None], gain, 0.0) @ response
    score, information = weighted.T @ innovation, response.T @ weighted
    return Sensitivity(score, information, error, tuple(changing(duration)), begin, duration)
