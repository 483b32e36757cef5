"""Smoothed trajectory of attitude and velocity with fixed parameters, about which the next pass is linearised.

A six-state filter (φ, δv) and a Rauch-Tung-Striebel pass track the effect of gyro noise without the jumps of a filter,
so that the passes are Gauss-Newton steps (Bell, *The iterated Kalman smoother as a Gauss-Newton method*, SIAM J.
Optim. 4(3), 1994).
"""

from typing import NamedTuple

import numba as nb
import numpy as np

from calstation.estimation.common import FilterNoise
from calstation.estimation.navigation.small_matrices import backward, cholesky, forward
from calstation.physics import Compensation, FloatArray, Increments, IntervalWork, interval_work, propagate, rotate

#: Prior sigma of the initial heading, rad: small, because the parameters may be too inaccurate for gyrocompassing.
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
    motion: Increments,
    dt: float,
    span: tuple[int, int, int],
    attitude: FloatArray,
    tilt_sigma: float,
) -> Reference:
    """Compute the smoothed trajectory of a segment with fixed parameters.

    `motion` are the increments of all samples with these parameters, `dt` s apart. `span` is the index of the first
    sample, the index after the last, and the number of samples per interval. `attitude` is the start C_bn, whose
    heading is retained, and `tilt_sigma` the prior sigma of its tilt, rad.
    """
    begin, end, stride = span
    count = (end - begin) // stride
    variances = np.array([tilt_sigma**2, tilt_sigma**2, HEADING_SIGMA**2, *[noise.velocity] * 3])
    work = interval_work()
    work.attitude[:] = attitude
    return _smoothed(
        c, earth, gravity, dt, motion, begin, count, stride,
        np.diag(variances), noise.rate, noise.force, noise.velocity, work,
    )  # fmt: skip


@nb.njit(cache=True)
def _smoothed(
    c: Compensation,
    earth: FloatArray,
    gravity: float,
    dt: float,
    motion: Increments,
    begin: int,
    count: int,
    stride: int,
    P: FloatArray,
    rate_q: float,
    force_q: float,
    observation: float,
    work: IntervalWork,
) -> Reference:
    """Run the closed-loop filter and the RTS pass."""
    T = stride * dt
    attitude, velocity = np.empty((count + 1, 3, 3)), np.empty((count + 1, 3))
    gains = np.empty((count, 6, 6))
    corrections = np.zeros((count + 1, 6))
    predicted, L, S, root = np.empty((6, 6)), np.empty((6, 6)), np.empty((3, 3)), np.empty((3, 3))
    H, K, z, d = np.zeros((3, 6)), np.empty((3, 6)), np.empty((3, 1)), np.empty(6)
    H[0, 3] = H[1, 4] = H[2, 5] = 1.0
    propagate(c, earth, gravity, dt, motion, begin, begin, work, False)
    work.velocity[:] = _arm_velocity(c, earth, work)
    attitude[0], velocity[0] = work.attitude, work.velocity
    for k in range(count):
        first = begin + k * stride
        propagate(c, earth, gravity, dt, motion, first, first + stride, work, False)
        F, gain = work.transition, gains[k]
        gain[:] = 0.0
        for i in range(6):
            for m in range(6):
                for j in range(6):
                    gain[i, j] += F[i, m] * P[m, j]
        for i in range(6):
            for j in range(6):
                t = 0.0
                for m in range(6):
                    t += gain[i, m] * F[j, m]
                predicted[i, j] = t
        for i in range(3):
            predicted[i, i] += rate_q * T
            predicted[3 + i, 3 + i] += force_q * T
        cholesky(predicted, L)
        forward(L, gain)
        backward(L, gain)
        u = _arm_velocity(c, earth, work)
        H[0, 1], H[0, 2], H[1, 2] = -u[2], u[1], -u[0]
        H[1, 0], H[2, 0], H[2, 1] = u[2], -u[1], u[0]
        for i in range(3):
            z[i, 0] = u[i] - work.velocity[i]
            for j in range(6):
                K[i, j] = predicted[3 + i, j]
                for m in range(3):
                    K[i, j] += H[i, m] * predicted[m, j]
            for j in range(i + 1):
                S[i, j] = K[i, 3 + j]
                for m in range(3):
                    S[i, j] += K[i, m] * H[j, m]
            S[i, i] += observation
        cholesky(S, root)
        forward(root, K)
        forward(root, z)
        for i in range(6):
            d[i] = K[0, i] * z[0, 0] + K[1, i] * z[1, 0] + K[2, i] * z[2, 0]
            corrections[k + 1, i] = d[i]
            for j in range(i + 1):
                P[i, j] = predicted[i, j] - K[0, i] * K[0, j] - K[1, i] * K[1, j] - K[2, i] * K[2, j]
                P[j, i] = P[i, j]
        rotate(d, work.attitude)
        for i in range(3):
            work.velocity[i] += d[3 + i]
        attitude[k + 1], velocity[k + 1] = work.attitude, work.velocity
    smoothed = np.zeros((count + 1, 6))
    for k in range(count - 1, -1, -1):
        for m in range(6):
            t = corrections[k + 1, m] + smoothed[k + 1, m]
            for i in range(6):
                smoothed[k, i] += gains[k, m, i] * t
    for k in range(count + 1):
        rotate(smoothed[k], attitude[k])
        for i in range(3):
            velocity[k, i] += smoothed[k, 3 + i]
    return Reference(attitude, velocity)


@nb.njit(cache=True)
def _arm_velocity(c: Compensation, earth: FloatArray, work: IntervalWork) -> FloatArray:
    """Return the velocity of the IMU about the table's centre, C (ω_nb × outer_lever), m/s, shape (3,)."""
    C, r, w = work.attitude, c.outer_lever, np.empty(3)
    for i in range(3):
        w[i] = work.rate[i] - C[0, i] * earth[0] - C[1, i] * earth[1] - C[2, i] * earth[2]
    x, y, z = w[1] * r[2] - w[2] * r[1], w[2] * r[0] - w[0] * r[2], w[0] * r[1] - w[1] * r[0]
    for i in range(3):
        w[i] = C[i, 0] * x + C[i, 1] * y + C[i, 2] * z
    return w
