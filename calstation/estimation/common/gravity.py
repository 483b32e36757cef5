"""Effect of a gravity error on a solution, which is common to all stages and does not average out.

The data do not change if every force and the lever arms are multiplied by 1 + ε, the accelerometer matrix I + M_a is
divided by it, and the quadratic terms by its square. Only the prior distinguishes the two cases. With a relative
gravity error ε, a stage therefore shifts its estimated parameters x as if their true values had changed by ε u, with
this direction u: dx⁺/dε = dx⁻/dε + (I − P⁺ (P⁻)⁻¹)(u − dx⁻/dε).
"""

from collections.abc import Sequence

import numpy as np

from calstation.estimation.common.context import Posterior
from calstation.physics import COUNT, INDEX, NAMES, FloatArray, group_indices

#: Power of 1 + ε by which the parameters of each group are multiplied.
_POWERS = {"accel_misalign": -1.0, "accel_quadratic": -2.0, "inner_lever": 1.0, "outer_lever": 1.0}


def force_scaling(parameters: FloatArray) -> FloatArray:
    """Return the parameter change u per relative change of all forces for which the data do not change, shape (30,)."""
    u = np.zeros(COUNT)
    for group, power in _POWERS.items():
        at = list(group_indices(group))
        u[at] = power * parameters[at]
    at = list(group_indices("accel_scale"))
    u[at] = -(1.0 + parameters[at])
    return u


def gravity_sensitivity(
    before: Posterior, after: Posterior, estimated: Sequence[str], sensitivity: FloatArray
) -> FloatArray:
    """Return the change of the estimate after a stage per relative gravity error, shape (30,).

    Parameters
    ----------
    before, after : estimates before and after the stage
    estimated : names of the parameters that the stage estimates
    sensitivity : change of the estimate before the stage per relative gravity error, shape (30,)
    """
    known = np.flatnonzero(before.sigma > 0.0)
    scale = before.sigma[known]
    difference = (force_scaling(after.mean) - sensitivity)[known] / scale
    scales = np.outer(scale, scale)
    prior, posterior = (posterior.covariance[np.ix_(known, known)] / scales for posterior in (before, after))
    change = np.zeros(COUNT)
    change[known] = scale * (difference - posterior @ np.linalg.lstsq(prior, difference, rcond=None)[0])
    unchanged = np.ones(COUNT, np.bool_)
    unchanged[[INDEX[name] for name in estimated if name in NAMES]] = False
    return sensitivity + np.where(unchanged, 0.0, change)


def with_gravity(posterior: Posterior, sensitivity: FloatArray, sigma: float) -> Posterior:
    """Return the estimate with the relative standard deviation `sigma` of gravity included in its covariance.

    Parameters
    ----------
    posterior : estimate whose covariance lacks the error of gravity
    sensitivity : change of the estimate per relative gravity error, SI, shape (30,)
    sigma : relative standard deviation of gravity
    """
    shift = sensitivity * sigma
    return Posterior(posterior.mean, posterior.covariance + np.outer(shift, shift))


def without_gravity(sigma: FloatArray, gravity: float) -> FloatArray:
    """Return `sigma`, shape (30,), without the contribution of gravity to the accelerometer scale factors.

    `gravity` is the relative standard deviation of gravity. A sigma is 0 if this contribution is larger than it.
    """
    common = np.zeros(COUNT)
    common[list(group_indices("accel_scale"))] = gravity
    return np.sqrt(np.maximum(sigma**2 - common**2, 0.0))
