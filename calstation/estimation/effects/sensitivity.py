"""Response of a stage's innovations and estimates to errors of the prior and to effects outside the model.

Without the model knowing of an effect, it adds J θ to the innovations and leaves the error D θ in the estimate (truth
minus estimate). Both follow from the gains of the estimator, whatever they are.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numba as nb
import numpy as np

from calstation.estimation.effects.candidates import CONSTANT, Candidate, Motion, changing
from calstation.physics import COUNT, BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Sensitivity:
    """Score and information of c columns, and the errors that they leave.

    The columns are an error of each parameter's prior mean (30), the components of `CONSTANT`, and those of `changing`.
    """

    score: FloatArray  #: Jᵀ S⁻¹ ν, shape (c,).
    information: FloatArray  #: Jᵀ S⁻¹ J, shape (c, c).
    error: FloatArray  #: D: error left in each parameter, truth minus estimate, shape (30, c).
    changing: tuple[Candidate, ...] = ()  #: Effects that change a parameter during the stage.
    begin: float = 0.0  #: Time at which the stage begins, s.
    duration: float = 0.0  #: Duration of the stage, s.
    #: χ² of the innovations with the noise of the estimate over that with the noise of `score` and `information`.
    noise_ratio: float = 1.0


def all_errors(motion: Motion, candidates: Sequence[Candidate], counts: IntArray) -> FloatArray:
    """Return the errors of the six channels due to the constant effects and `candidates`, shape (k, 6, components).

    They are averaged over k groups of `counts` intervals, shape (k,).
    """
    return mean_errors(motion, (*CONSTANT, *candidates), counts)


def mean_errors(motion: Motion, candidates: Sequence[Candidate], counts: IntArray) -> FloatArray:
    """Return the same as `all_errors` for `candidates` alone."""
    found, done = np.empty((len(counts), 6, sum(len(c.components) for c in candidates))), 0
    for c in candidates:
        _write_means(c.errors(motion), counts, found[:, :, done : (done := done + len(c.components))])
    return found


@nb.njit(cache=True)
def _write_means(errors: FloatArray, counts: IntArray, out: FloatArray) -> None:
    """Average errors, shape (n, 6, m), over k groups of `counts` rows, shape (k,), into `out`, shape (k, 6, m)."""
    first = 0
    for g in range(len(counts)):
        for i in range(errors.shape[1]):
            for j in range(errors.shape[2]):
                total = 0.0
                for k in range(first, first + counts[g]):
                    total += errors[k, i, j]
                out[g, i, j] = total / counts[g]
        first += counts[g]


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
    added : what each component of `CONSTANT` and of `changing` adds to the observations, shape (m, components)
    estimated : True for the parameters that the gain corrects, shape (30,)
    begin, duration : of the stage, s
    """
    response = np.hstack([jacobian, added])
    weighted = np.linalg.solve(covariance, response)
    before = np.eye(COUNT, response.shape[1])
    error = before - np.where(estimated[:, None], gain, 0.0) @ response
    score, information = weighted.T @ innovation, response.T @ weighted
    return Sensitivity(score, information, error, tuple(changing(duration)), begin, duration)
