"""Smoothed trajectory of attitude and velocity with fixed parameters, about which a later pass is linearised.

A six-state filter (φ, δv) and a Rauch-Tung-Striebel pass track the effect of gyro noise without the jumps of a filter,
so that the passes are Gauss-Newton steps (Bell, *The iterated Kalman smoother as a Gauss-Newton method*, SIAM J.
Optim. 4(3), 1994).
"""

from typing import NamedTuple

import numba as nb
import numpy as np

from calstation.estimation.common import FilterNoise, StageData
from calstation.physics import Compensation, FloatArray, IntervalWork, interval_work, propagate, rotation_matrix

#: Prior sigma of the start heading, rad: small, because the parameters may be too inaccurate for gyrocompassing.
HEADING_SIGMA = 1e-4


class Reference(NamedTuple):
    """Attitude C_bn, shape (m + 1, 3, 3), and velocity, m/s, shape (m + 1, 3), at the ends of m intervals."""

    attitude: FloatArray
    velocity: FloatArray


def smoothed_reference(
    c: Compensation,
    earth: FloatArray,
    gravity: float,
    noise: FilterNoise,
    data: StageData,
    span: tuple[int, int, int],
    attitude: FloatArray,
    tilt_sigma: float,
) -> Reference:
    """Compute the smoothed trajectory of a segment with fixed parameters.

    `span` is the index of the first sample, the index after the last, and the number of samples per interval.
    `attitude` is the start C_bn, whose heading is retained, and `tilt_sigma` the prior sigma of its tilt, rad.
    """
    begin, end, stride = span
    count = (end - begin) // stride
    variances = np.array([tilt_sigma**2, tilt_sigma**2, HEADING_SIGMA**2, *[noise.velocity] * 3])
    work = interval_work()
    work.attitude[:] = attitude
    filtered, velocity, correction = _filter(
        c, earth, gravity, data.dt, data.gyro, data.accel, begin, count, stride,
        np.diag(variances), noise.rate, noise.force, noise.velocity, work,
    )  # fmt: skip
    for k in range(count + 1):
        filtered[k] = rotation_matrix(correction[k, :3]) @ filtered[k]
    return Reference(filtered, velocity + correction[:, 3:])


@nb.njit(cache=True)
def _filter(
    c: Compensation,
    earth: FloatArray,
    gravity: float,
    dt: float,
    gyro: FloatArray,
    accel: FloatArray,
    begin: int,
    count: int,
    stride: int,
    P: FloatArray,
    rate_q: float,
    force_q: float,
    observation: float,
    work: IntervalWork,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Run the closed-loop filter and the RTS pass; return filtered attitudes, velocities and smoother corrections."""
    T = stride * dt
    attitude, velocity = np.empty((count + 1, 3, 3)), np.empty((count + 1, 3))
    gains = np.empty((count, 6, 6))
    corrections = np.zeros((count + 1, 6))
    H, z = np.zeros((3, 6)), np.empty(3)
    H[0, 3] = H[1, 4] = H[2, 5] = 1.0
    propagate(c, earth, gravity, dt, gyro, accel, begin, begin, work)
    w = work.rate - work.attitude.T @ earth
    work.velocity[:] = work.attitude @ np.cross(w, c.outer_lever)
    attitude[0], velocity[0] = work.attitude, work.velocity
    for k in range(count):
        first = begin + k * stride
        propagate(c, earth, gravity, dt, gyro, accel, first, first + stride, work)
        F = np.ascontiguousarray(work.transition[:6, :6])
        predicted = F @ P @ F.T
        for i in range(3):
            predicted[i, i] += rate_q * T
            predicted[3 + i, 3 + i] += force_q * T
        gains[k] = np.linalg.solve(predicted, F @ P).T
        w = work.rate - work.attitude.T @ earth
        u = work.attitude @ np.cross(w, c.outer_lever)
        H[0, 1], H[0, 2], H[1, 2] = -u[2], u[1], -u[0]
        H[1, 0], H[2, 0], H[2, 1] = u[2], -u[1], u[0]
        for i in range(3):
            z[i] = u[i] - work.velocity[i]
        S = H @ predicted @ H.T + observation * np.eye(3)
        K = np.linalg.solve(S, H @ predicted).T
        d = K @ z
        P = predicted - K @ H @ predicted
        P = 0.5 * (P + P.T)
        work.attitude[:] = rotation_matrix(d[:3]) @ work.attitude
        work.velocity[:] = work.velocity + d[3:]
        corrections[k + 1] = d
        attitude[k + 1], velocity[k + 1] = work.attitude, work.velocity
    smoothed = np.zeros((count + 1, 6))
    for k in range(count - 1, -1, -1):
        smoothed[k] = gains[k] @ (corrections[k + 1] + smoothed[k + 1])
    return attitude, velocity, smoothed
