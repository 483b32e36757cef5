"""A plain NumPy version of the navigation filter with one prediction of all 39 states per sample.

States φ, δv, δp and the 30 parameters; first-order transition per sample. The mean velocity of the centre of rotation
over every `interval` s is observed, and attitude and velocity are fed back. Implemented independently of the compiled
kernel from the equations in docs/contract.md and Groves (2nd ed., ch. 14), for comparison.
"""

import numpy as np

from calstation.estimation.navigation.navigation_pass import START_RATIO
from calstation.physics import INDEX, normal_gravity, rotation_rate


def cross_matrix(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def turn(vector):
    """Return the rotation matrix of a rotation vector to fifth order, enough for the rotation in one sample."""
    K = cross_matrix(vector)
    K2 = K @ K
    return np.eye(3) + K + K2 / 2.0 + K @ K2 / 6.0 + K2 @ K2 / 24.0


def model_matrices(p):
    """Return (I + M_g)⁻¹ and (I + M_a)⁻¹ from named parameters."""
    gyro, accel = np.eye(3), np.eye(3)
    for i, a in enumerate("xyz"):
        gyro[i, i] += p[INDEX[f"gyro_scale_{a}"]]
        accel[i, i] += p[INDEX[f"accel_scale_{a}"]]
        for j, b in enumerate("xyz"):
            if i != j:
                gyro[i, j] += p[INDEX[f"gyro_misalign_{a}{b}"]]
            if j < i:
                accel[i, j] += p[INDEX[f"accel_misalign_{a}{b}"]]
    return np.linalg.inv(gyro), np.linalg.inv(accel)


GYRO_PAIRS = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))
ACCEL_PAIRS = ((1, 0), (2, 0), (2, 1))


def parameter_columns(gyro_inverse, accel_inverse, omega, force):
    """Return the partials of angular rate and specific force by the 30 parameters, shape (3, 30) each."""
    rate, accel = np.zeros((3, 30)), np.zeros((3, 30))
    rate[:, 0:3] = -gyro_inverse
    rate[:, 3:6] = -gyro_inverse * omega
    for k, (row, column) in enumerate(GYRO_PAIRS):
        rate[:, 6 + k] = -gyro_inverse[:, row] * omega[column]
    accel[:, 12:15] = -accel_inverse
    accel[:, 15:18] = -accel_inverse * force
    for k, (row, column) in enumerate(ACCEL_PAIRS):
        accel[:, 18 + k] = -accel_inverse[:, row] * force[column]
    accel[:, 21:24] = -accel_inverse * force**2
    accel[:, 24:27] = np.diag(omega @ omega - omega**2)
    return rate, accel


def plain_pass(context, prior, data, attitude, sigma, noise, first, last):
    """Return posterior mean and covariance of the 30 parameters, linearised about the prior mean.

    attitude : start C_bn, with the sigmas `sigma` of its error; noise : the filter's `FilterNoise`
    """
    p, dt = prior.mean, data.dt
    lever_arm, inner_lever = p[27:30], p[24:27]
    gyro_inverse, accel_inverse = model_matrices(p)
    earth = rotation_rate(context.site.latitude)
    up = np.array([0.0, 0.0, normal_gravity(context.site.latitude, context.site.height)])
    # beyond the 39 states, φ at the start of the interval
    x, P = np.zeros(42), np.zeros((42, 42))
    P[np.arange(6), np.arange(6)] = [*(sigma**2), 1.0, 1.0, 1.0]
    P[9:39, 9:39] = prior.covariance
    R = np.eye(3) * noise.velocity
    every = round(noise.interval / dt)
    T = every * dt
    C, v = attitude.copy(), np.zeros(3)

    def compensated(k):
        omega = gyro_inverse @ (data.gyro[k] - p[0:3])
        linear = data.accel[k] - p[12:15]
        force = accel_inverse @ linear
        for _ in range(3):
            force = accel_inverse @ (linear - p[21:24] * force**2)
        return omega, force

    def observe(z, H, R):
        nonlocal x, P, C, v
        S = H @ P @ H.T + R
        K = P @ H.T @ np.linalg.inv(S)
        x = x + K @ (z - H @ x)
        left = np.eye(42) - K @ H
        P = left @ P @ left.T + K @ R @ K.T
        C = turn(x[0:3]) @ C
        v = v + x[3:6]
        x[0:6] = 0.0
        # the next interval starts: δp is 0, and φ is copied
        x[6:9], x[39:42] = 0.0, 0.0
        J = np.eye(42)
        J[6:9] = J[39:42] = 0.0
        J[39:42, 0:3] = np.eye(3)
        P = J @ P @ J.T

    def arm_velocity_of(omega):
        return C @ np.cross(omega - C.T @ earth, lever_arm)

    def observe_start(omega):
        arm = np.cross(omega - C.T @ earth, lever_arm)
        rate, _ = parameter_columns(gyro_inverse, accel_inverse, omega, np.zeros(3))
        H = np.zeros((3, 42))
        H[:, 0:3] = cross_matrix(C @ arm)
        H[:, 3:6] = np.eye(3)
        H[:, 9:39] = C @ cross_matrix(lever_arm) @ rate
        H[:, 36:39] = -C @ cross_matrix(omega - C.T @ earth)
        observe(C @ arm - v, H, START_RATIO * R)

    def observe_mean(before, moved):
        H = np.zeros((3, 42))
        H[:, 0:3] = cross_matrix(C @ lever_arm) / T
        H[:, 39:42] = -cross_matrix(before @ lever_arm) / T
        H[:, 6:9] = np.eye(3) / T
        H[:, 36:39] = (before - C) / T
        observe(((C - before) @ lever_arm - moved) / T, H, R)

    omega, _ = compensated(first)
    observe_start(omega)
    arm_velocity, before, moved = arm_velocity_of(omega), C.copy(), np.zeros(3)
    for k in range(first, last):
        omega, force = compensated(k)
        acted_on = C.T @ up + np.cross(omega, np.cross(omega, lever_arm))
        rate_columns, force_columns = parameter_columns(gyro_inverse, accel_inverse, omega, acted_on)
        force = force + inner_lever * (omega @ omega - omega**2)
        middle = C @ turn(0.5 * dt * omega)
        last_v = v
        v = v + (middle @ force - up - 2.0 * np.cross(earth, v)) * dt
        moved = moved + 0.5 * dt * (last_v + v)
        C = turn(-earth * dt) @ C @ turn(omega * dt)
        arm_now = C @ np.cross(omega - C.T @ earth, lever_arm)
        demanded = up + (arm_now - arm_velocity) / dt
        arm_velocity = arm_now
        F = np.eye(42)
        F[0:3, 0:3] -= cross_matrix(earth) * dt
        F[0:3, 9:39] = middle @ rate_columns * dt
        F[3:6, 0:3] = -cross_matrix(demanded) * dt
        F[6:9, 0:3] = -0.5 * cross_matrix(demanded) * dt * dt
        F[6:9, 9:39] = 0.5 * middle @ force_columns * dt * dt
        F[3:6, 3:6] -= 2.0 * cross_matrix(earth) * dt
        F[3:6, 9:39] = middle @ force_columns * dt
        F[6:9, 3:6] = np.eye(3) * dt
        Q = np.zeros(42)
        Q[0:3], Q[3:6] = noise.rate, noise.force
        x = F @ x
        P = F @ P @ F.T + np.diag(Q * dt)
        if (k + 1 - first) % every == 0:
            observe_mean(before, moved)
            following, _ = compensated(k + 1)
            arm_velocity, before, moved = arm_velocity_of(0.5 * (omega + following)), C.copy(), np.zeros(3)
    return p + x[9:39], P[9:39, 9:39]
