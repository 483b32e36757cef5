"""Response of a stage's innovations and estimates to errors of the prior and to effects outside the model.

An effect that is not modelled adds J θ to the innovations and leaves the error D θ in the estimate (truth minus
estimate). Both follow from the gains of the estimator, optimal or not.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calstation.estimation.common import BatchGain, means
from calstation.estimation.effects.changes import changing
from calstation.physics import COUNT, EFFECTS, BoolArray, Effect, FloatArray, IntArray, Motion


@dataclass(frozen=True)
class StageEffects:
    """The effects for which a stage is tested, from which its solver builds its `Sensitivity`."""

    begin: float  #: Time at which the stage begins, s.
    duration: float  #: s

    @cached_property
    def changing(self) -> tuple[Effect, ...]:
        """Effects that change a parameter during the stage, see `changing`."""
        return tuple(changing(self.duration))

    @property
    def tested(self) -> tuple[Effect, ...]:
        """All effects: `EFFECTS`, then `changing`."""
        return (*EFFECTS, *self.changing)

    def errors(self, motion: Motion, counts: IntArray) -> FloatArray:
        """Return the errors of the six channels, averaged over k groups of `counts` intervals, shape (k, 6, c)."""
        return mean_errors(motion, self.tested, counts)

    def sensitivity(
        self,
        score: FloatArray,
        information: FloatArray,
        remaining: FloatArray,
        estimated: BoolArray,
        noise_ratio: float = 1.0,
    ) -> "Sensitivity":
        """Return the sensitivity of a stage.

        Parameters
        ----------
        score, information, noise_ratio : as in `Sensitivity`
        remaining : error left in each parameter if all were estimated, shape (30, c)
        estimated : True for the parameters that the stage estimates, shape (30,)
        """
        error = np.where(estimated[:, None], remaining, np.eye(COUNT, len(score)))
        return Sensitivity(score, information, error, self, noise_ratio)

    def of_batch(self, gain: BatchGain, added: FloatArray, estimated: BoolArray) -> "Sensitivity":
        """Return the sensitivity of an estimate from m observations in one batch.

        Parameters
        ----------
        gain : gain of the 30 parameters
        added : contribution of each component of `tested` to the observations, shape (m, components)
        estimated : True for the parameters that the gain corrects, shape (30,)
        """
        jacobian, K, covariance, innovation = gain
        response = np.hstack([jacobian, added])
        weighted = np.linalg.solve(covariance, response)
        remaining = np.eye(COUNT, response.shape[1]) - K @ response
        return self.sensitivity(weighted.T @ innovation, response.T @ weighted, remaining, estimated)


@dataclass(frozen=True)
class Sensitivity:
    """Score and information of c columns, and the estimation errors that they cause.

    The columns are an error of each parameter's prior mean (30), and the components of the `tested` effects.
    """

    score: FloatArray  #: Jᵀ S⁻¹ ν, shape (c,).
    information: FloatArray  #: Jᵀ S⁻¹ J, shape (c, c).
    error: FloatArray  #: D: error left in each parameter, truth minus estimate, shape (30, c).
    effects: StageEffects
    #: χ² of the innovations with the noise of the estimate, divided by χ² with the noise of `score` and `information`.
    noise_ratio: float = 1.0


def mean_errors(motion: Motion, effects: Sequence[Effect], counts: IntArray) -> FloatArray:
    """Return the errors of the six channels, averaged over k groups of `counts` intervals, shape (k, 6, components)."""
    regressors, terms = mean_regressors(motion, effects, counts)
    errors = np.zeros((len(counts), 6, sum(len(effect.components) for effect in effects)))
    channel, component, regressor = terms.T
    errors[:, channel, component] = regressors[:, regressor]
    return errors


def mean_regressors(motion: Motion, effects: Sequence[Effect], counts: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the regressors averaged over k groups of `counts` intervals, shape (k, r), and their terms, shape (t, 3).

    The components and regressors of the terms are counted over all effects.
    """
    columns = [np.empty((len(counts), 0))]
    terms: list[tuple[int, int, int]] = []
    component = regressor = 0
    for effect in effects:
        columns.append(means(effect.regressors(motion), counts))
        terms += [(t.channel, component + t.component, regressor + t.regressor) for t in effect.terms]
        component, regressor = component + len(effect.components), regressor + columns[-1].shape[1]
    return np.hstack(columns), np.array(terms, dtype=np.int64).reshape(-1, 3)
