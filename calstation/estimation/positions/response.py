"""Response of the rests and motions of a recording to errors of the prior and to effects outside the model."""

import itertools
from collections.abc import Sequence

import numpy as np

from calstation.estimation.effects import CONSTANT, Candidate, Motion, Sensitivity, all_errors, changing
from calstation.estimation.positions.rows import PositionRows, integrate_rotation
from calstation.physics import (
    COUNT,
    BoolArray,
    Compensation,
    FloatArray,
    IntArray,
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
    duration = float(profile.data.time[-1] - profile.data.time[0])
    candidates = tuple(changing(duration))
    added = _added(profile, point, attitudes, north, candidates)
    H, residual, covariance = _solved(profile, point, attitudes, north)
    jacobian = np.linalg.lstsq(profile.root.T, H[:, :COUNT].T, rcond=None)[0].T
    response = np.hstack([jacobian, added / profile.sigma[:, None]])
    weighted = response - H @ (covariance @ (H.T @ response))
    score, information = response.T @ residual, response.T @ weighted
    total, freedom = float(residual @ residual), len(H) - float(np.sum((H @ covariance) * H))
    owners = [c.cause for c in (*CONSTANT, *candidates) for _ in c.components]
    drifts, constant = (
        COUNT + np.flatnonzero([cause in known for cause in owners])
        for known in ({"drift", *(c.cause for c in CONSTANT)}, {c.cause for c in CONSTANT})
    )
    at = drifts if freedom - _rank(information, drifts) >= _ENOUGH else constant
    explained = float(score[at] @ np.linalg.pinv(information[np.ix_(at, at)], hermitian=True) @ score[at])
    left = freedom - _rank(information, at)
    variance = max(1.0, (total - explained) / left if left >= 1.0 else total / freedom)

    H_f, residual_f, covariance_f = _solved(fitted, point, attitudes, north)
    gain = fitted.root @ covariance_f[:COUNT] @ H_f.T
    shrunk = (profile.sigma / fitted.sigma)[:, None] * response
    error = np.eye(COUNT, response.shape[1]) - np.where(estimated[:, None], gain @ shrunk, 0.0)
    ratio = float(residual_f @ residual_f) * variance / total
    begin = float(profile.data.time[0])
    return Sensitivity(score / variance, information / variance, error, candidates, begin, duration, ratio)


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
    rows: PositionRows, point: FloatArray, attitudes: FloatArray, north: FloatArray, candidates: Sequence[Candidate]
) -> FloatArray:
    """Return the contribution of each effect component to the observations, SI, shape (observations, components)."""
    c = compensation(point)
    rate, force, time = (np.array([getattr(r, name) for r in rows.rests]) for name in ("rate", "force", "time"))
    rests = _errors(c, rate, force, time - rows.data.time[0], 1, candidates)
    seen = np.concatenate([rests[:, 3:], rests[:, :3]], axis=1)[:, : rows.per_rest]
    turns = [_turned(rows, k, c, attitudes, north, candidates) for k in range(len(rows.links))]
    return np.concatenate([seen.reshape(-1, seen.shape[2]), *turns])


def _turned(
    rows: PositionRows, k: int, c: Compensation, attitudes: FloatArray, north: FloatArray,
    candidates: Sequence[Candidate],
) -> FloatArray:  # fmt: skip
    """Return the error of the rotation of a motion due to each component, rad, shape (3, components)."""
    link, data = rows.links[k], rows.data
    earth = np.append(north[rows.chain[link.first]], rows.up_rate)
    B = rotation_matrix(-earth * (link.stop - link.start) * data.dt) @ attitudes[link.first]
    edges = np.linspace(link.start, link.stop, _PARTS + 1).astype(int)
    turned = np.zeros((3, sum(len(candidate.components) for candidate in (*CONSTANT, *candidates))))
    for start, stop in itertools.pairwise(edges):
        if start == stop:
            continue
        since = data.time[start:stop] - data.time[0]
        (errors,) = _errors(c, data.gyro[start:stop], data.accel[start:stop], since, stop - start, candidates)
        part, time, _ = integrate_rotation(c.gyro_inverse, c.gyro_bias, data.dt, data.gyro, start, stop)
        turned -= B @ time @ c.gyro_inverse @ errors[:3]
        B = B @ part
    return turned


def _errors(
    c: Compensation, gyro: FloatArray, accel: FloatArray, time: FloatArray, count: int, candidates: Sequence[Candidate]
) -> FloatArray:
    """Return the mean errors of the six channels in groups of `count` samples, shape (groups, 6, components)."""
    rate, force = compensate(c, np.nan_to_num(gyro), accel)  # NaN without gyros
    still = np.zeros_like(rate)
    motion = Motion(rate, force, still, still, time)
    return all_errors(motion, candidates, np.full(len(rate) // count, count))
