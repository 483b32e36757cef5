"""Tests of a fitted pair for effects outside the model, one added effect at a time.

The size of an effect is that of the linearised fit with it, and the jackknife over blocks of time gives its covariance,
whatever the spectrum of the residuals. It is an effect of the secondary, or of the primary with the opposite sign.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calstation.estimation.effects import CONSTANT, Candidate, EffectFound, Motion, changing
from calstation.physics import AXES, FloatArray

#: Second-order term of the accelerometers, which is a parameter in other methods.
_QUADRATIC = Candidate(
    "accel_quadratic", "s²/m", 1e-3, tuple(AXES),
    lambda m: np.concatenate([np.zeros((len(m.force), 3, 3)), np.eye(3) * m.force[:, None, :] ** 2], axis=1),
)  # fmt: skip


@dataclass(frozen=True)
class Block:
    """Normal equations of the k fitted parameters in a block of time, and what effects are added to."""

    motion: Motion  #: Of the secondary, n rows.
    columns: FloatArray  #: Derivatives of the six outputs in units of their noise, shape (n, 6, k).
    left: FloatArray  #: Residuals in units of their noise, shape (n, 6).
    weights: FloatArray  #: Shape (n, 6).
    normal: FloatArray  #: Shape (k, k).
    gradient: FloatArray  #: Shape (k,).


def jackknife(normals: FloatArray, gradient: FloatArray, prior: FloatArray | float = 0.0) -> FloatArray:
    """Return the covariance of the solution from its changes when each block is omitted, shape (k, k).

    This is the sandwich estimator corrected for the leverage of every block (R. M. Bell and D. F. McCaffrey, Survey
    Methodology 28(2), 2002); without it, the residuals of a block with strong motion would be too small. `prior` is
    information that belongs to no block.
    """
    normal, total = normals.sum(axis=0) + prior, gradient.sum(axis=0)
    solution = np.linalg.solve(normal, total)
    moved = np.linalg.solve(normal - normals, (total - gradient)[:, :, None])[:, :, 0] - solution
    return np.asarray(moved.T @ moved * (len(moved) - 1) / len(moved))


def pair_effects(
    blocks: Iterator[Block], scale: FloatArray, duration: float, sigma: FloatArray, names: Sequence[str]
) -> list[EffectFound]:
    """Return what the data say about every effect, the likeliest first.

    Parameters
    ----------
    scale : noise of the six outputs, rad/s and m/s², shape (6,)
    duration : of the recording, s
    sigma, names : of the fitted parameters, shape (k,)
    """
    drifts = (c for c in changing(duration) if c.cause == "drift")  # a jump near an end would rest on a few blocks
    candidates = (*CONSTANT, _QUADRATIC, *drifts)
    k, normals, gradients = len(names), [], []
    for block in blocks:
        added = np.concatenate([c.errors(block.motion) for c in candidates], axis=2) / scale[:, None]
        both = np.concatenate([block.columns, added], axis=2)
        weighted = both * block.weights[:, :, None]
        normal = np.tensordot(weighted, both, axes=([0, 1], [0, 1]))
        gradient = np.tensordot(weighted, block.left, axes=([0, 1], [0, 1]))
        normal[:k, :k], gradient[:k] = block.normal, block.gradient
        normals.append(normal)
        gradients.append(gradient)
    whole, found, at = (np.array(normals), np.array(gradients)), [], k
    for candidate in candidates:
        own = np.r_[0:k, at : (at := at + len(candidate.components))]
        found.append(_found(candidate, whole[0][:, own[:, None], own], whole[1][:, own], sigma, names))
    return sorted(found, key=lambda f: -f.excess)


def _found(
    candidate: Candidate, normals: FloatArray, gradients: FloatArray, sigma: FloatArray, names: Sequence[str]
) -> EffectFound:
    """Evaluate the test of an effect from the normal equations with it, shapes (blocks, m, m) and (blocks, m)."""
    k = len(names)
    plausible = np.full(len(candidate.components), candidate.plausible or np.inf)
    prior = np.diag(np.concatenate([np.zeros(k), plausible**-2.0]))
    normal, gradient = normals.sum(axis=0) + prior, gradients.sum(axis=0)
    solution = np.linalg.solve(normal, gradient)
    covariance = jackknife(normals, gradients, prior)
    size, own = solution[k:], covariance[k:, k:]
    best = int(np.argmax(np.abs(size) / np.sqrt(np.diag(own))))
    without = np.linalg.solve(normal[:k, :k], gradient[:k])
    moves = dict(zip(names, ((solution[:k] - without) / sigma).tolist(), strict=True))
    parameter = candidate.parameter_of(best)
    axis = parameter[-1:]
    changed = parameter and f"secondary_{parameter}".replace(f"scale_{axis}", f"matrix_{axis}{axis}")
    stage = "cross_calibration" if changed else ""
    excess = float(size @ np.linalg.solve(own, size)) - len(size)
    found = float(size[best]), float(np.sqrt(own[best, best]))
    return EffectFound(
        candidate.cause, candidate.components[best], changed, stage, excess, *found, candidate.unit, moves
    )
