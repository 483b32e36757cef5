"""Effect of an error of gravity on a solution; it is common to all stages and does not average out.

The data do not change if every force grows by a factor 1 + ε while the accelerometer matrix shrinks by the same factor,
the quadratic terms shrink by its square, and the lever arms grow by it. Only the prior distinguishes the two cases. A
stage therefore shifts its estimated parameters x along this direction u as if ε u were added to their prior: dx⁺/dε =
dx⁻/dε + (I − P⁺ (P⁻)⁻¹)(u − dx⁻/dε).
"""

from collections.abc import Sequence

import numpy as np

from calstation.estimation.common.context import Posterior
from calstation.physics import COUNT, INDEX, NAMES, FloatArray, group_indices

#: Powers of the factor 1 + ε by which parameters change.
_POWERS = {"accel_misalign": -1.0, "accel_quadratic": -2.0, "inner_lever": 1.0, "outer_lever": 1.0}


def force_scaling(parameters: FloatArray) -> FloatArray:
    """Return the parameter change u that compensates a relative change of all forces and leaves the data unchanged."""
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
    """Return the change of the estimate after a stage per relative error of gravity, shape (30,).

    `sensitivity` is the sensitivity before the stage, and `estimated` names the parameters that the stage estimates.
    """
    known = np.flatnonzero(before.sigma > 0.0)
    scale = before.sigma[known]
    to_go = (force_scaling(after.mean) - sensitivity)[known] / scale
    both = np.outer(scale, scale)
    prior, posterior = (posterior.covariance[np.ix_(known, known)] / both for posterior in (before, after))
    moved = np.zeros(COUNT)
    moved[known] = scale * (to_go - posterior @ np.linalg.lstsq(prior, to_go, rcond=None)[0])
    kept = np.ones(COUNT, np.bool_)
    kept[[INDEX[name] for name in estimated if name in NAMES]] = False
    return sensitivity + np.where(kept, 0.0, moved)


def with_gravity(posterior: Posterior, sensitivity: FloatArray, sigma: float) -> Posterior:
    """Return the estimate with a relative standard deviation `sigma` of gravity included in its covariance."""
    shift = sensitivity * sigma
    return Posterior(posterior.mean, posterior.covariance + np.outer(shift, shift))


def without_gravity(sigma: FloatArray, gravity: float) -> FloatArray:
    """Return the sigmas, shape (30,), that together with the error of gravity amount to `sigma`.

    `gravity` is the relative standard deviation of gravity. A sigma is 0 if the error of gravity alone is larger.
    """
    common = np.zeros(COUNT)
    common[list(group_indices("accel_scale"))] = gravity
    return np.sqrt(np.maximum(sigma**2 - common**2, 0.0))
