"""Tests of a fitted pair for effects outside the model, one added effect at a time.

The size of an effect is estimated in a linearised fit that includes it. The jackknife over blocks of time gives its
covariance for residuals of any spectrum. The effect may be one of the secondary, or one of the primary with the
opposite sign.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calstation.estimation.effects import EffectEvidence, parameter_changes
from calstation.physics import AXES, EFFECTS, INDEX, OF_ACCELEROMETERS, Effect, FloatArray, Motion

#: Second-order term of the accelerometers, which is one of the 30 parameters in other methods.
_QUADRATIC = Effect("accel_quadratic", "s²/m", 1e-3, tuple(AXES), lambda m: m.force**2, OF_ACCELEROMETERS)


#: Smallest number of blocks for a test; it determines the degrees of freedom of the jackknife.
MIN_BLOCKS = 40


@dataclass(frozen=True)
class Block:
    """A linearised fit of k parameters in a block of time, and the data for testing effects."""

    motion: Motion  #: Motion of the secondary, n rows.
    columns: FloatArray  #: Derivatives of the six outputs in units of their noise, shape (n, 6, k).
    residual: FloatArray  #: Residuals in units of their noise, shape (n, 6).
    weights: FloatArray  #: Shape (n, 6).


def jackknife(normals: FloatArray, gradient: FloatArray, prior: FloatArray | float = 0.0) -> FloatArray:
    """Return the covariance of the solution, shape (k, k), from its changes when each of b blocks is omitted in turn.

    This is the sandwich estimator with a correction for the leverage of every block (R. M. Bell and D. F. McCaffrey,
    Survey Methodology 28(2), 2002), without which the residuals of a block with strong motion would be too small.

    Parameters
    ----------
    normals, gradient : normal matrices of the blocks, shape (b, k, k), and their right-hand sides, shape (b, k)
    prior : information matrix in addition to the blocks, shape (k, k), or 0
    """
    normal, total = normals.sum(axis=0) + prior, gradient.sum(axis=0)
    solution = np.linalg.solve(normal, total)
    change = np.linalg.solve(normal - normals, (total - gradient)[:, :, None])[:, :, 0] - solution
    return np.asarray(change.T @ change * (len(change) - 1) / len(change))


def pair_effects(
    blocks: Sequence[Block],
    is_tested: Callable[[Effect], bool],
    scale: FloatArray,
    axes: FloatArray,
    duration: float,
    bias_drift: Mapping[str, float],
    changes: FloatArray,
    sigma: FloatArray,
    names: Sequence[str],
) -> list[EffectEvidence]:
    """Return the evidence for each tested effect, the likeliest first; none from a short recording.

    Columns and motion are those of the mean of both IMUs, whose noise is independent of the residuals: the noise of the
    primary alone would resemble an effect that differs from the parameters only at rest, such as an asymmetry of an
    IMU that turns in one direction.

    Parameters
    ----------
    blocks : the linearised fit in blocks of time, in order
    is_tested : function that returns whether to test an effect
    scale : noise of the six outputs, rad/s and m/s², shape (6,)
    axes : axes of the secondary in primary axes, one per row, shape (3, 3)
    duration : duration of the recording, s
    bias_drift : variance of the change of a bias over the recording by bias instability, by group, SI
    changes : prior sigma of the change of each of the 30 parameters of an IMU, SI, see `plausible_changes`
    sigma, names : sigmas and names of the fitted parameters, shape (k,)
    """
    if len(blocks) < MIN_BLOCKS:
        return []
    # steps are not tested, because a step near an end would be determined by a few blocks only
    drifts = (c for c in parameter_changes(duration) if c.cause == "drift")
    candidates = [c for c in (*EFFECTS, _QUADRATIC, *drifts) if is_tested(c)]
    if not candidates:
        return []
    k, normals, gradients = len(names), [], []
    for block in blocks:
        errors = np.concatenate([c.errors(block.motion) for c in candidates], axis=2) / scale[:, None]
        both = np.concatenate([block.columns, errors], axis=2)
        weighted = both * block.weights[:, :, None]
        normals.append(np.tensordot(weighted, both, axes=([0, 1], [0, 1])))
        gradients.append(np.tensordot(weighted, block.residual, axes=([0, 1], [0, 1])))
    whole, evidence, at = (np.array(normals), np.array(gradients)), [], k
    for candidate in candidates:
        columns = np.r_[0:k, at : (at := at + len(candidate.components))]
        normal, gradient = whole[0][:, columns[:, None], columns], whole[1][:, columns]
        evidence.append(_evidence(candidate, normal, gradient, axes, bias_drift, changes, sigma, names))
    return sorted(evidence, key=lambda f: -f.excess)


def _evidence(
    candidate: Effect,
    normals: FloatArray,
    gradients: FloatArray,
    axes: FloatArray,
    bias_drift: Mapping[str, float],
    changes: FloatArray,
    sigma: FloatArray,
    names: Sequence[str],
) -> EffectEvidence:
    """Evaluate the test of an effect from normal equations that include it, shapes (blocks, m, m) and (blocks, m)."""
    k = len(names)
    plausible = np.array([changes[INDEX[name]] for name in candidate.parameters])
    if candidate.plausible is not None:
        plausible = np.full(len(candidate.components), candidate.plausible)
    prior = np.diag(np.concatenate([np.zeros(k), plausible**-2.0]))
    normal, gradient = normals.sum(axis=0) + prior, gradients.sum(axis=0)
    solution = np.linalg.solve(normal, gradient)
    covariance = jackknife(normals, gradients, prior)
    group = candidate.parameter_of(0).rpartition("_")[0]
    size, size_covariance = solution[k:], covariance[k:, k:] + bias_drift.get(group, 0.0) * np.eye(len(solution) - k)
    best = int(np.argmax(np.abs(size) / np.sqrt(np.diag(size_covariance))))
    base_solution = np.linalg.solve(normal[:k, :k], gradient[:k])
    shift = dict(zip(names, ((base_solution - solution[:k]) / sigma).tolist(), strict=True))
    changed_parameter = parameter = candidate.parameter_of(best)
    if parameter:
        axis_name = parameter[-1]
        axis = AXES[int(np.argmax(np.abs(axes[AXES.index(axis_name)])))]
        changed_parameter = f"secondary_{parameter}".replace(f"scale_{axis_name}", f"matrix_{axis_name}{axis}")
    stage = "cross_calibration" if changed_parameter else ""
    # Hotelling's T² with the degrees of freedom of the jackknife, as a χ²
    n, m = len(normals), len(size)
    excess = float(size @ np.linalg.solve(size_covariance, size)) * (n - m) / (n - 1) - m
    estimate = float(size[best]), float(np.sqrt(size_covariance[best, best]))
    return EffectEvidence(
        candidate.cause, candidate.components[best], changed_parameter, stage, excess, *estimate, candidate.unit, shift,
        float(np.max(np.abs(size) / plausible)),
    )  # fmt: skip
