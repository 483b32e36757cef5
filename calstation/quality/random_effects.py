"""Mean and variance between units of values with different uncertainties: the random effects model.

A value x_i has the variance sigma_i² + tau², the sum of the measurement variance and the variance between units.
Source: R. C. Paule and J. Mandel, *Consensus Values and Weighting Factors*, Journal of Research of the National Bureau
of Standards 87(5), 1982, 377-385. Unlike the estimate of R. DerSimonian and N. Laird (Controlled Clinical Trials 7,
1986, 177-188), which is its first step, it is also accurate if tau is large compared with unequal sigmas.
"""

from dataclasses import dataclass

import numpy as np

from calstation.physics import FloatArray

#: Relative change at which the iteration ends, and its largest number of steps.
_CONVERGED, _STEPS = 1e-9, 100


@dataclass(frozen=True)
class RandomEffects:
    """Estimate of the random effects model, in the unit of the values."""

    mean: float  #: Mean with weights 1 / (sigma² + tau²).
    between: float  #: Standard deviation between units, tau.

    def scores(self, values: FloatArray, sigmas: FloatArray) -> FloatArray:
        """Return (x - mean) / sqrt(sigma² + tau²), which has variance 1, shape (n,)."""
        return np.asarray((values - self.mean) / np.hypot(sigmas, self.between))


def random_effects(values: FloatArray, sigmas: FloatArray) -> RandomEffects:
    """Estimate mean and standard deviation between units from values and their standard deviations, shape (n,).

    The weighted sum of squares about the mean decreases with tau² and is convex, so that Newton's method approaches its
    expectation n - 1 from above; tau is 0 if the sum does not exceed n - 1 for tau = 0.
    """
    variances, between = sigmas**2, 0.0
    for _ in range(_STEPS):
        weights = 1.0 / (variances + between)
        squares = weights * (values - np.average(values, weights=weights)) ** 2
        excess = float(squares.sum()) - (len(values) - 1)
        step = excess / float(np.sum(weights * squares)) if excess > 0.0 else 0.0
        between += step
        if step <= _CONVERGED * between:
            break
    return RandomEffects(float(np.average(values, weights=1.0 / (variances + between))), float(np.sqrt(between)))
