"""Least-squares fit of a gimbal recording: the rotation of every motion from the gyros compared with the joints.

Exp(−Ω T) C_before B(gyro parameters) = C_after,  C from the joints, B the body rotation from the compensated gyros
"""

from dataclasses import dataclass

import numpy as np

from calstation.estimation.common import Posterior, SolveContext, StageData, filter_noise, gauss_newton
from calstation.estimation.gimbal.iteration import gimbal_attitude
from calstation.estimation.gimbal.motions import Motion
from calstation.estimation.positions import GYRO_COLUMNS, gyro_derivative, integrate_rotation, square_root
from calstation.physics import (
    COUNT,
    GYRO_BIAS,
    RATE,
    FloatArray,
    compensation,
    rotation_matrix,
    rotation_vector,
)

MAX_ITERATIONS = 12


@dataclass(frozen=True)
class GimbalFit:
    """Solution of the least-squares fit."""

    posterior: Posterior  #: Posterior of the parameters.
    chi2: float  #: Sum of the squared residuals in units of sigma.
    freedom: float  #: Degrees of freedom of the residuals.
    residual: FloatArray  #: Residual of every motion, rad, shape (n, 3).


def fit_gimbal(
    data: StageData, motions: list[Motion], order: str, context: SolveContext, prior: Posterior, joint_sigma: float
) -> GimbalFit:
    """Fit all motions; `joint_sigma` is the sigma of an attitude from the joints at a rest, per axis, rad."""
    noise = filter_noise(context)
    sigma = np.sqrt(np.repeat([noise.rate * m.duration for m in motions], 3))
    root = square_root(prior.covariance)
    # gyro noise is independent for each motion; joint errors are shared with the preceding and the following motion
    rests = 1 + max(max(m.between) for m in motions)
    scale = np.concatenate([[RATE] * 3, np.full(3 * rests, joint_sigma)])
    start = prior.mean.copy()
    measured = np.median(data.gyro[: round(1.0 / data.dt)], axis=0)
    start[GYRO_BIAS] = np.where(prior.sigma[GYRO_BIAS] > RATE, measured, start[GYRO_BIAS])

    def step(at: tuple[FloatArray, FloatArray]) -> tuple[tuple[FloatArray, FloatArray], GimbalFit, float]:
        point, more = at
        H, r = _rows(data, motions, order, point, more)
        left = (r + H[:, :COUNT] @ (point - prior.mean) + H[:, COUNT:] @ more) / sigma
        columns = np.hstack([H[:, :COUNT] @ root, H[:, COUNT:] * scale]) / sigma[:, None]
        covariance = np.linalg.inv(columns.T @ columns + np.eye(columns.shape[1]))
        x = covariance @ (columns.T @ left)
        mean, spread = prior.mean + root @ x[:COUNT], root @ covariance[:COUNT, :COUNT] @ root.T
        width = np.sqrt(np.diag(spread))
        change = float(np.max(np.abs(mean - point) / np.where(width > 0.0, width, 1.0)))
        rest, spare = left - columns @ x, len(left) - float(np.einsum("ij,jk,ik->", columns, covariance, columns))
        posterior = Posterior(mean, 0.5 * (spread + spread.T))
        fit = GimbalFit(posterior, float(rest @ rest), spare, (rest * sigma).reshape(-1, 3))
        return (mean, scale * x[COUNT:]), fit, change

    return gauss_newton(step, (start, np.zeros(len(scale))), MAX_ITERATIONS)[1]


def _rows(
    data: StageData, motions: list[Motion], order: str, point: FloatArray, more: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives, shape (3 n, 33 + 3 rests), and the residuals, rad, shape (3 n,).

    `more` contains, in the base frame, the earth rate, rad/s, and the joint errors at rests as rotation vectors, rad.
    """
    c, earth, wrong = compensation(point), more[:3], more[3:].reshape(-1, 3)
    H, residuals = np.zeros((3 * len(motions), COUNT + len(more))), []
    for k, m in enumerate(motions):
        B, time, rate = integrate_rotation(c.gyro_inverse, c.gyro_bias, data.dt, data.gyro, m.start, m.stop)
        first, second = m.between
        before = rotation_matrix(wrong[first]) @ gimbal_attitude(order, m.before)
        start = rotation_matrix(-earth * m.duration) @ before
        rows = slice(3 * k, 3 * k + 3)
        H[rows, GYRO_COLUMNS] = gyro_derivative(start, c, time, rate)
        H[rows, COUNT : COUNT + 3] = -m.duration * np.eye(3)
        H[rows, COUNT + 3 + 3 * first : COUNT + 6 + 3 * first] = np.eye(3)
        H[rows, COUNT + 3 + 3 * second : COUNT + 6 + 3 * second] = -np.eye(3)
        after = rotation_matrix(wrong[second]) @ gimbal_attitude(order, m.after)
        residuals.append(rotation_vector(after @ (start @ B).T))
    return H, np.concatenate(residuals)
