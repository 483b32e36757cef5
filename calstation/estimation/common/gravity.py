"""Effect of an error of gravity on a solution; it is common to all stages and never averages out.

The data do not change if every force grows by a factor 1 + ε while the accelerometers' matrix shrinks by it, the
quadratic terms by its square, and the lever arms grow: only the prior tells the two apart. A stage therefore moves its
estimated parameters x along that direction u as if ε u were their prior, dx⁺/dε = dx⁻/dε + (I − P⁺ (P⁻)⁻¹)(u − dx⁻/dε).
"""

from collections.abc import Sequence

import numpy as np

from calstation.estimation.common.context import Belief
from calstation.physics import COUNT, INDEX, NAMES, FloatArray, group_indices

#: Powers of the factor 1 + ε by which parameters change.
_POWERS = {"accel_misalign": -1.0, "accel_quadratic": -2.0, "inner_lever": 1.0, "outer_lever": 1.0}


def force_scaling(parameters: FloatArray) -> FloatArray:
    """Return the change u of the parameters per relative change of all forces that leaves the data as they are."""
    u = np.zeros(COUNT)
    for group, power in _POWERS.items():
        at = list(group_indices(group))
        u[at] = power * parameters[at]
    at = list(group_indices("accel_scale"))
    u[at] = -(1.0 + parameters[at])
    return u


def gravity_sensitivity(before: Belief, after: Belief, estimated: Sequence[str], sensitivity: FloatArray) -> FloatArray:
    """Return the change of the estimate after a stage per relative error of gravity, shape (30,).

    `sensitivity` is that of the estimate before the stage, and `estimated` names the parameters that it estimates.
    """
    known = np.flatnonzero(before.sigma > 0.0)
    scale = before.sigma[known]
    to_go = (force_scaling(after.mean) - sensitivity)[known] / scale
    both = np.outer(scale, scale)
    prior, posterior = (belief.covariance[np.ix_(known, known)] / both for belief in (before, after))
    moved = np.zeros(COUNT)
    moved[known] = scale * (to_go - posterior @ np.linalg.lstsq(prior, to_go, rcond=None)[0])
    kept = np.ones(COUNT, np.bool_)
    kept[[INDEX[name] for name in estimated if name in NAMES]] = False
    return sensitivity + np.where(kept, 0.0, moved)


def with_gravity(belief: Belief, sensitivity: FloatArray, sigma: float) -> Belief:
    """Return the estimate with the error of gravity, of relative standard deviation `sigma`, in its covariance."""
    shift = sensitivity * sigma
    return Belief(belief.mean, belief.covariance + np.outer(shift, shift))


def without_gravity(sigma: FloatArray, gravity: float) -> FloatArray:
    """Return the sigmas, shape (30,), that a stage may leave for `sigma` to be reached with the error of gravity.

    `gravity` is its relative standard deviation. The sigma is 0 where that error alone is larger.
    """
    common = np.zeros(COUNT)
    common[list(group_indices("accel_scale"))] = gravity
    return np.sqrt(np.maximum(sigma**2 - common**2, 0.0))
