"""Response of the rests and motions of a recording to errors of the prior and to effects outside the model."""

import itertools

import numpy as np

from calstation.estimation.effects import Sensitivity, StageEffects
from calstation.estimation.positions.rows import PositionPoint, PositionRows, integrate_rotation
from calstation.physics import (
    COUNT,
    EFFECTS,
    BoolArray,
    Compensation,
    FloatArray,
    IntArray,
    Motion,
    compensate,
    compensation,
    rotation_matrix,
)

#: Smallest number of degrees of freedom that must remain after fitting drifts.
MIN_FREEDOM = 10
#: Number of parts into which a motion is divided; the error of a gyro is constant within each part.
_PARTS = 40


def position_sensitivity(
    fitted: PositionRows, profile: PositionRows, at: PositionPoint, estimated: BoolArray
) -> Sensitivity:
    """Return the sensitivity of a solution about a linearisation point.

    `fitted` are the rows of the estimate, whose scatter may itself be caused by an effect. The tests therefore use rows
    with the noise of the `profile`, and divide χ² by the variance that remains after fitting all constant effects and
    drifts, or the constant ones alone if too few degrees of freedom would remain.
    """
    time, seen = profile.data.time, slice(profile.observations)
    effects = StageEffects(float(time[0]), float(time[-1] - time[0]))
    added = _added(profile, at, effects)
    with_profile, with_scatter = profile.solve(at), fitted.solve(at)
    H, residual, covariance = with_profile.H[seen], with_profile.left[seen], with_profile.covariance
    jacobian = np.linalg.lstsq(profile.root.T, H[:, :COUNT].T, rcond=None)[0].T
    response = np.hstack([jacobian, added / profile.sigma[:, None]])
    weighted = response - H @ (covariance @ (H.T @ response))
    score, information = response.T @ residual, response.T @ weighted
    total, freedom = float(residual @ residual), len(H) - float(np.sum((H @ covariance) * H))
    owners = np.array([c.cause for c in effects.tested for _ in c.components])
    constant = COUNT + np.arange(sum(len(c.components) for c in EFFECTS))
    drifts = np.concatenate([constant, COUNT + np.flatnonzero(owners == "drift")])
    fit = drifts if freedom - _rank(information, drifts) >= MIN_FREEDOM else constant
    explained = float(score[fit] @ np.linalg.pinv(information[np.ix_(fit, fit)], hermitian=True) @ score[fit])
    spare = freedom - _rank(information, fit)
    variance = max(1.0, (total - explained) / spare if spare >= 1.0 else total / freedom)
    gain = fitted.root @ with_scatter.covariance[:COUNT] @ with_scatter.H[seen].T
    remaining = np.eye(COUNT, response.shape[1]) - gain @ ((profile.sigma / fitted.sigma)[:, None] * response)
    ratio = float(with_scatter.left[seen] @ with_scatter.left[seen]) * variance / total
    return effects.sensitivity(score / variance, information / variance, remaining, estimated, ratio)


def _rank(information: FloatArray, at: IntArray) -> int:
    return int(np.linalg.matrix_rank(information[np.ix_(at, at)], hermitian=True))


def _added(rows: PositionRows, at: PositionPoint, effects: StageEffects) -> FloatArray:
    """Return the contribution of each effect component to the observations, SI, shape (observations, components)."""
    c = compensation(at.parameters)
    rate, force, time = (np.array([getattr(r, name) for r in rows.rests]) for name in ("rate", "force", "time"))
    rests = _errors(c, rate, force, time - rows.data.time[0], 1, effects)
    seen = np.concatenate([rests[:, 3:], rests[:, :3]], axis=1)[:, : rows.per_rest]
    turns = [_turned(rows, k, c, at, effects) for k in range(len(rows.links))]
    return np.concatenate([seen.reshape(-1, seen.shape[2]), *turns])


def _turned(rows: PositionRows, k: int, c: Compensation, at: PositionPoint, effects: StageEffects) -> FloatArray:
    """Return the error of the rotation of motion `k` due to each component, rad, shape (3, components)."""
    link, data = rows.links[k], rows.data
    earth = np.append(at.north[rows.chain[link.first]], rows.up_rate)
    B = rotation_matrix(-earth * (link.stop - link.start) * data.dt) @ at.attitudes[link.first]
    edges = np.linspace(link.start, link.stop, _PARTS + 1).astype(int)
    turned = np.zeros((3, sum(len(effect.components) for effect in effects.tested)))
    for start, stop in itertools.pairwise(edges):
        if start == stop:
            continue
        since = data.time[start:stop] - data.time[0]
        (errors,) = _errors(c, data.gyro[start:stop], data.accel[start:stop], since, stop - start, effects)
        part, time, _ = integrate_rotation(c.gyro_inverse, c.gyro_bias, data.dt, data.gyro, start, stop)
        turned -= B @ time @ c.gyro_inverse @ errors[:3]
        B = B @ part
    return turned


def _errors(
    c: Compensation, gyro: FloatArray, accel: FloatArray, time: FloatArray, count: int, effects: StageEffects
) -> FloatArray:
    """Return the mean errors of the six channels in groups of `count` samples, shape (groups, 6, components)."""
    rate, force = compensate(c, np.nan_to_num(gyro), accel)  # NaN without gyros
    return effects.errors(Motion.steady(rate, force, time), np.full(len(rate) // count, count))
