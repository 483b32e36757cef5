"""Response of the rests and motions of a recording to errors of the prior and to effects outside the model."""

import itertools

import numpy as np

from calstation.estimation.effects import Sensitivity, StageEffects
from calstation.estimation.positions.rows import PositionRows, integrate_rotation
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
_ENOUGH = 10
#: Number of parts into which a motion is divided; the error of a gyro is constant within each part.
_PARTS = 40


def position_sensitivity(
    fitted: PositionRows, profile: PositionRows, point: FloatArray, attitudes: FloatArray, north: FloatArray,
    estimated: BoolArray,
) -> Sensitivity:  # fmt: skip
    """Return the sensitivity of a solution, given by `point`, `attitudes` and `north`.

    `fitted` are the rows of the estimate, whose scatter may itself be caused by an effect. The tests therefore use rows
    with the noise of the `profile`, and divide χ² by the variance that remains after fitting all constant effects and
    drifts, or the constant ones alone if too few degrees of freedom would remain.
    """
    time = profile.data.time
    effects = StageEffects(float(time[0]), float(time[-1] - time[0]))
    added = _added(profile, point, attitudes, north, effects)
    H, residual, covariance = _solved(profile, point, attitudes, north)
    jacobian = np.linalg.lstsq(profile.root.T, H[:, :COUNT].T, rcond=None)[0].T
    response = np.hstack([jacobian, added / profile.sigma[:, None]])
    weighted = response - H @ (covariance @ (H.T @ response))
    score, information = response.T @ residual, response.T @ weighted
    total, freedom = float(residual @ residual), len(H) - float(np.sum((H @ covariance) * H))
    owners = np.array([c.cause for c in effects.tested for _ in c.components])
    constant = COUNT + np.arange(sum(len(c.components) for c in EFFECTS))
    drifts = np.concatenate([constant, COUNT + np.flatnonzero(owners == "drift")])
    at = drifts if freedom - _rank(information, drifts) >= _ENOUGH else constant
    explained = float(score[at] @ np.linalg.pinv(information[np.ix_(at, at)], hermitian=True) @ score[at])
    left = freedom - _rank(information, at)
    variance = max(1.0, (total - explained) / left if left >= 1.0 else total / freedom)

    H_f, residual_f, covariance_f = _solved(fitted, point, attitudes, north)
    gain = fitted.root @ covariance_f[:COUNT] @ H_f.T
    shrunk = (profile.sigma / fitted.sigma)[:, None] * response
    remaining = np.eye(COUNT, response.shape[1]) - gain @ shrunk
    ratio = float(residual_f @ residual_f) * variance / total
    return effects.sensitivity(score / variance, information / variance, remaining, estimated, ratio)


def _rank(information: FloatArray, at: IntArray) -> int:
    return int(np.linalg.matrix_rank(information[np.ix_(at, at)], hermitian=True))


def _solved(
    rows: PositionRows, point: FloatArray, attitudes: FloatArray, north: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the rows of the observations, their remaining residuals, and the covariance of the columns."""
    H, residual = rows.rows(point, attitudes, north)
    covariance = inverse(H.T @ H)
    seen = slice(rows.observations)
    return H[seen], (residual - H @ (covariance @ (H.T @ residual)))[seen], covariance


def inverse(information: FloatArray) -> FloatArray:
    """Return the inverse of a positive definite matrix with columns of very different sizes."""
    scale = 1.0 / np.sqrt(np.diag(information))
    return np.asarray(np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale))


def _added(
    rows: PositionRows, point: FloatArray, attitudes: FloatArray, north: FloatArray, effects: StageEffects
) -> FloatArray:
    """Return the contribution of each effect component to the observations, SI, shape (observations, components)."""
    c = compensation(point)
    rate, force, time = (np.array([getattr(r, name) for r in rows.rests]) for name in ("rate", "force", "time"))
    rests = _errors(c, rate, force, time - rows.data.time[0], 1, effects)
    seen = np.concatenate([rests[:, 3:], rests[:, :3]], axis=1)[:, : rows.per_rest]
    turns = [_turned(rows, k, c, attitudes, north, effects) for k in range(len(rows.links))]
    return np.concatenate([seen.reshape(-1, seen.shape[2]), *turns])


def _turned(
    rows: PositionRows, k: int, c: Compensation, attitudes: FloatArray, north: FloatArray,
    effects: StageEffects,
) -> FloatArray:  # fmt: skip
    """Return the error of the rotation of a motion due to each component, rad, shape (3, components)."""
    link, data = rows.links[k], rows.data
    earth = np.append(north[rows.chain[link.first]], rows.up_rate)
    B = rotation_matrix(-earth * (link.stop - link.start) * data.dt) @ attitudes[link.first]
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
