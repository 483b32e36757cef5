"""Response of the rests and motions of a recording to errors of the prior and to effects outside the model."""

import itertools

import numpy as np

from calstation.estimation.effects import CONSTANT, Motion, Sensitivity, all_errors
from calstation.estimation.positions.rows import PositionRows, integrate_rotation
from calstation.physics import COUNT, BoolArray, Compensation, FloatArray, compensate, compensation, rotation_matrix

#: Parts of a motion in each of which the error of a gyro is taken as constant.
_PARTS = 40


def position_sensitivity(
    fitted: PositionRows, profile: PositionRows, point: FloatArray, attitudes: FloatArray, north: FloatArray,
    estimated: BoolArray,
) -> Sensitivity:  # fmt: skip
    """Return the sensitivity of a solution, given by `point`, `attitudes` and `north`.

    `fitted` are the rows of the estimate, whose scatter may itself be the work of an effect. The tests therefore begin
    with the rows of the noise in the `profile`, and divide χ² by the variance that all effects together leave.
    """
    added = _added(profile, point, attitudes, north)
    H, residual, covariance = _solved(profile, point, attitudes, north)
    jacobian = np.linalg.lstsq(profile.root.T, H[:, :COUNT].T, rcond=None)[0].T
    response = np.hstack([jacobian, added / profile.sigma[:, None]])
    weighted = response - H @ (covariance @ (H.T @ response))
    score, information = response.T @ residual, response.T @ weighted
    total, freedom = float(residual @ residual), len(H) - float(np.sum((H @ covariance) * H))
    effects = information[COUNT:, COUNT:]
    explained = float(score[COUNT:] @ np.linalg.pinv(effects, hermitian=True) @ score[COUNT:])
    left = freedom - np.linalg.matrix_rank(effects, hermitian=True)
    variance = max(1.0, (total - explained) / left if left >= 1.0 else total / freedom)

    H_f, residual_f, covariance_f = _solved(fitted, point, attitudes, north)
    gain = fitted.root @ covariance_f[:COUNT] @ H_f.T
    shrunk = (profile.sigma / fitted.sigma)[:, None] * response
    error = np.eye(COUNT, response.shape[1]) - np.where(estimated[:, None], gain @ shrunk, 0.0)
    ratio = float(residual_f @ residual_f) * variance / total
    return Sensitivity(score / variance, information / variance, error, noise_ratio=ratio)


def _solved(
    rows: PositionRows, point: FloatArray, attitudes: FloatArray, north: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the rows of the observations, what they leave of the residuals, and the covariance of the columns."""
    H, residual = rows.rows(point, attitudes, north)
    covariance = inverse(H.T @ H)
    seen = slice(rows.observations)
    return H[seen], (residual - H @ (covariance @ (H.T @ residual)))[seen], covariance


def inverse(information: FloatArray) -> FloatArray:
    """Return the inverse of a positive definite matrix with columns of very different sizes."""
    scale = 1.0 / np.sqrt(np.diag(information))
    return np.asarray(np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale))


def _added(rows: PositionRows, point: FloatArray, attitudes: FloatArray, north: FloatArray) -> FloatArray:
    """Return what each component of `CONSTANT` adds to the observations, SI, shape (observations, components)."""
    c = compensation(point)
    rests = _errors(c, np.array([r.rate for r in rows.rests]), np.array([r.force for r in rows.rests]), 1)
    seen = np.concatenate([rests[:, 3:], rests[:, :3]], axis=1)[:, : rows.per_rest]
    turns = [_turned(rows, k, c, attitudes, north) for k in range(len(rows.links))]
    return np.concatenate([seen.reshape(-1, seen.shape[2]), *turns])


def _turned(rows: PositionRows, k: int, c: Compensation, attitudes: FloatArray, north: FloatArray) -> FloatArray:
    """Return the error of the rotation of a motion due to each component, rad, shape (3, components)."""
    link, data = rows.links[k], rows.data
    earth = np.append(north[rows.chain[link.first]], rows.up_rate)
    B = rotation_matrix(-earth * (link.stop - link.start) * data.dt) @ attitudes[link.first]
    edges = np.linspace(link.start, link.stop, _PARTS + 1).astype(int)
    turned = np.zeros((3, sum(len(candidate.components) for candidate in CONSTANT)))
    for start, stop in itertools.pairwise(edges):
        if start == stop:
            continue
        (errors,) = _errors(c, data.gyro[start:stop], data.accel[start:stop], stop - start)
        part, time, _ = integrate_rotation(c.gyro_inverse, c.gyro_bias, data.dt, data.gyro, start, stop)
        turned -= B @ time @ c.gyro_inverse @ errors[:3]
        B = B @ part
    return turned


def _errors(c: Compensation, gyro: FloatArray, accel: FloatArray, count: int) -> FloatArray:
    """Return the mean errors of the six channels in groups of `count` samples, shape (groups, 6, components)."""
    rate, force = compensate(c, np.nan_to_num(gyro), accel)  # NaN without gyros
    still = np.zeros_like(rate)
    motion = Motion(rate, force, still, still, np.zeros(len(rate)))
    return all_errors(motion, (), np.full(len(rate) // count, count))
