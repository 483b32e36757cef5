"""Compiled strapdown navigation at the sample rate, with the transition matrix of its errors.

The order of the error states is φ (0:3), δv (3:6), δp (6:9), the 30 parameters (9:39), where
`C_true = (I + [φ×]) C_computed`, `v_true = v + δv`. With ω, f compensated with the assumed parameters:

    φ̇  = −Ω×φ + C δω                 δv̇ = −[C f×] φ − 2Ω×δv + C δf              δṗ = δv
    δω = −(I+M_g)⁻¹ (δb_g + δM_g ω)
    δf = −J⁻¹ (δb_a + δM_a f + δK2∘f²) + δl∘c + l∘δc,   J = I + M_a + 2 diag(K2∘f),   c_i = |ω|² − ω_i²

References
----------
P. G. Savage, *Strapdown Inertial Navigation Integration Algorithm Design*, J. Guidance Control Dynamics
21(1-2), 1998: coning and sculling from the last and the present increment;
the third-order term assumes constant ω and quadratic f over the sample.
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14.
"""

from typing import NamedTuple

import numba as nb
import numpy as np

from calstation.physics.arrays import FloatArray
from calstation.physics.imu_model import Compensation

STATES = 39
PARAMETER_START = 9


class IntervalWork(NamedTuple):
    """State and output of `propagate` for one interval."""

    transition: FloatArray  #: Transition matrix over the interval, shape (39, 39).
    attitude: FloatArray  #: C_bn, shape (3, 3), updated in place.
    velocity: FloatArray  #: v in n, m/s, shape (3,), updated in place.
    rate: FloatArray  #: Angular rate ω_ib at the end of the interval, rad/s, shape (3,).
    rate_jacobian: FloatArray  #: ∂ω/∂parameters at the end of the interval, shape (3, 30).
    force: FloatArray  #: Mean specific force in n, m/s², shape (3,).


def interval_work() -> IntervalWork:
    """Allocate the arrays for `propagate`."""
    return IntervalWork(np.eye(STATES), np.eye(3), np.zeros(3), np.zeros(3), np.zeros((3, 30)), np.zeros(3))


@nb.njit(cache=True, inline="always")
def _cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@nb.njit(cache=True)
def _exponential(rotvec: FloatArray, E: FloatArray) -> None:
    """Write the rotation matrix of a rotation vector, rad, to `E` (Rodrigues' formula)."""
    angle2 = rotvec[0] ** 2 + rotvec[1] ** 2 + rotvec[2] ** 2
    if angle2 < 1e-8:
        a, b = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    else:
        angle = np.sqrt(angle2)
        a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2
    for i in range(3):
        for j in range(3):
            E[i, j] = b * rotvec[i] * rotvec[j]
        E[i, i] += 1.0 - b * angle2
    E[0, 1] -= a * rotvec[2]
    E[0, 2] += a * rotvec[1]
    E[1, 0] += a * rotvec[2]
    E[1, 2] -= a * rotvec[0]
    E[2, 0] -= a * rotvec[1]
    E[2, 1] += a * rotvec[0]


@nb.njit(cache=True)
def _correct(c: Compensation, gyro: FloatArray, accel: FloatArray, omega: FloatArray, force: FloatArray) -> None:
    """Compute angular rate and specific force, without size effect, from one raw sample."""
    for i in range(3):
        omega[i] = 0.0
        for j in range(3):
            omega[i] += c.gyro_inverse[i, j] * (gyro[j] - c.gyro_bias[j])
    for i in range(3):
        force[i] = 0.0
        for j in range(3):
            force[i] += c.accel_inverse[i, j] * (accel[j] - c.accel_bias[j])
    for _ in range(3):
        x = accel[0] - c.accel_bias[0] - c.quadratic[0] * force[0] * force[0]
        y = accel[1] - c.accel_bias[1] - c.quadratic[1] * force[1] * force[1]
        z = accel[2] - c.accel_bias[2] - c.quadratic[2] * force[2] * force[2]
        for i in range(3):
            force[i] = c.accel_inverse[i, 0] * x + c.accel_inverse[i, 1] * y + c.accel_inverse[i, 2] * z


@nb.njit(cache=True)
def _rate_jacobian(c: Compensation, omega: FloatArray, out: FloatArray) -> None:
    """Write ∂ω/∂(gyro bias 0:3, scale 3:6, misalignments 6:12) = −(I+M_g)⁻¹ [I, diag ω, ...], shape (3, ≥12)."""
    for i in range(3):
        for j in range(3):
            out[i, j] = -c.gyro_inverse[i, j]
            out[i, 3 + j] = -c.gyro_inverse[i, j] * omega[j]
        out[i, 6] = -c.gyro_inverse[i, 0] * omega[1]
        out[i, 7] = -c.gyro_inverse[i, 0] * omega[2]
        out[i, 8] = -c.gyro_inverse[i, 1] * omega[0]
        out[i, 9] = -c.gyro_inverse[i, 1] * omega[2]
        out[i, 10] = -c.gyro_inverse[i, 2] * omega[0]
        out[i, 11] = -c.gyro_inverse[i, 2] * omega[1]


@nb.njit(cache=True)
def _force_jacobian(
    c: Compensation, omega: FloatArray, force: FloatArray, rate_jacobian: FloatArray, out: FloatArray
) -> None:
    """Write ∂f/∂parameters at the reference point: gyro terms (0:12), accelerometer (12:24), inner lever (24:27)."""
    for i in range(3):
        for j in range(3):  # first-order inverse of I + M_a + 2 diag(K2 f): K2 f is a few 1e-4 at most
            inverse = c.accel_inverse[i, j] * (1.0 - 2.0 * c.quadratic[j] * force[j])
            out[i, 12 + j] = -inverse
            out[i, 15 + j] = -inverse * force[j]
            out[i, 21 + j] = -inverse * force[j] * force[j]
            out[i, 24 + j] = 0.0
        out[i, 18] = out[i, 13] * force[0]
        out[i, 19] = out[i, 14] * force[0]
        out[i, 20] = out[i, 14] * force[1]
        square = 0.0
        for j in range(3):
            if j != i:
                square += omega[j] * omega[j]
        out[i, 24 + i] = square
        for k in range(12):
            change = 0.0
            for j in range(3):
                if j != i:
                    change += omega[j] * rate_jacobian[j, k]
            out[i, k] = 2.0 * c.inner_lever[i] * change


@nb.njit(cache=True)
def propagate(
    c: Compensation,
    earth: FloatArray,
    gravity: float,
    dt: float,
    gyro: FloatArray,
    accel: FloatArray,
    start: int,
    stop: int,
    work: IntervalWork,
) -> None:
    """Integrate attitude and velocity over samples `start` to `stop` and write the transition over this interval.

    Parameters
    ----------
    c : constants of the assumed parameters
    earth, gravity : earth rate in n, rad/s, shape (3,), and gravity, m/s²
    dt : sample period, s
    gyro, accel : raw mean rates of all samples, rad/s and m/s², shape (n, 3)
    start, stop : samples of this interval; those before and after it are used for coning and the end rate
    work : state and output
    """
    C, v, F = work.attitude, work.velocity, work.transition
    omega, force, last_omega, last_force = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    jw, jf = np.zeros((3, 27)), np.zeros((3, 27))
    psi_phi, psi_v, psi_p = np.zeros((3, 27)), np.zeros((3, 27)), np.zeros((3, 27))
    tilt, push = np.empty((3, 12)), np.empty((3, 27))
    rotvec, dv, cross, step = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    E, middle, turned = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    demanded = np.empty(3)
    force_sum, force_moment, f_n = np.zeros(3), np.zeros(3), np.empty(3)

    before = start - 1 if start > 0 else start
    _correct(c, gyro[before], accel[before], last_omega, last_force)
    for i in range(3):
        square = 0.0
        for j in range(3):
            if j != i:
                square += last_omega[j] * last_omega[j]
        last_force[i] += c.inner_lever[i] * square

    for k in range(start, stop):
        _correct(c, gyro[k], accel[k], omega, force)
        _rate_jacobian(c, omega, jw)
        # parameter errors act on the force implied by gravity and rotation: the measured force contains noise,
        # which an observation with the same noise would mistake for a signal
        _cross(omega, c.outer_lever, step)
        _cross(omega, step, demanded)
        for i in range(3):
            demanded[i] += C[2, i] * gravity
        _force_jacobian(c, omega, demanded, jw, jf)
        for i in range(3):
            force[i] += c.inner_lever[i] * jf[i, 24 + i]

        # rotation and velocity increments in b: coning, sculling, and the third-order term ωdt×(ωdt×f dt)/6 without
        # which gravity in a steadily rotating body is too small by (ω dt)²/6
        _cross(last_omega, omega, cross)
        for i in range(3):
            rotvec[i] = omega[i] * dt + cross[i] * dt * dt / 12.0
        _cross(omega, force, dv)
        _cross(omega, dv, turned[0])
        _cross(last_omega, force, cross)
        _cross(last_force, omega, step)
        for i in range(3):
            second = 0.5 * dv[i] + (cross[i] + step[i]) / 12.0
            dv[i] = force[i] * dt + second * dt * dt + turned[0, i] * dt**3 / 6.0

        # C_new = (I − [Ω dt×] + ½[Ω dt×]²) C Exp(rotvec)
        _exponential(rotvec, E)
        for i in range(3):
            for j in range(3):
                s = 0.0
                for m in range(3):
                    s += C[i, m] * E[m, j]
                turned[i, j] = s
        for j in range(3):
            cross[0] = earth[1] * turned[2, j] - earth[2] * turned[1, j]
            cross[1] = earth[2] * turned[0, j] - earth[0] * turned[2, j]
            cross[2] = earth[0] * turned[1, j] - earth[1] * turned[0, j]
            step[0] = earth[1] * cross[2] - earth[2] * cross[1]
            step[1] = earth[2] * cross[0] - earth[0] * cross[2]
            step[2] = earth[0] * cross[1] - earth[1] * cross[0]
            for i in range(3):
                turned[i, j] += -cross[i] * dt + 0.5 * step[i] * dt * dt
        for i in range(3):
            f_n[i] = 0.0
            for j in range(3):
                f_n[i] += C[i, j] * dv[j]
                middle[i, j] = 0.5 * (C[i, j] + turned[i, j])
        _cross(earth, f_n, cross)
        _cross(earth, v, step)
        for i in range(3):
            f_n[i] = (f_n[i] - 0.5 * dt * cross[i]) / dt
            v[i] += (f_n[i] - 2.0 * step[i]) * dt
        v[2] -= gravity * dt
        for i in range(3):
            for j in range(3):
                C[i, j] = turned[i, j]

        # transition blocks of the parameters by the midpoint rule
        for i in range(3):
            force_moment[i] += (force_sum[i] + 0.5 * f_n[i] * dt) * dt
            force_sum[i] += f_n[i] * dt
        for i in range(3):
            for p in range(12):
                turn = middle[i, 0] * jw[0, p] + middle[i, 1] * jw[1, p] + middle[i, 2] * jw[2, p]
                tilt[i, p] = psi_phi[i, p] + 0.5 * turn * dt
                psi_phi[i, p] += turn * dt
            for p in range(27):
                push[i, p] = middle[i, 0] * jf[0, p] + middle[i, 1] * jf[1, p] + middle[i, 2] * jf[2, p]
        for p in range(12):
            push[0, p] -= f_n[1] * tilt[2, p] - f_n[2] * tilt[1, p]
            push[1, p] -= f_n[2] * tilt[0, p] - f_n[0] * tilt[2, p]
            push[2, p] -= f_n[0] * tilt[1, p] - f_n[1] * tilt[0, p]
        for i in range(3):
            for p in range(27):
                psi_p[i, p] += (psi_v[i, p] + 0.5 * push[i, p] * dt) * dt
                psi_v[i, p] += push[i, p] * dt
        for i in range(3):
            last_omega[i] = omega[i]
            last_force[i] = force[i]

    # the rate at the end is the mean of the last sample and the next
    if stop < gyro.shape[0]:
        _correct(c, gyro[stop], accel[stop], omega, force)
        for i in range(3):
            omega[i] = 0.5 * (omega[i] + last_omega[i])
    for i in range(3):
        work.rate[i] = omega[i]
    _rate_jacobian(c, omega, work.rate_jacobian)

    T = (stop - start) * dt
    for i in range(3):
        work.force[i] = force_sum[i] / T if stop > start else 0.0
        for p in range(27):
            F[i, 9 + p] = psi_phi[i, p]
            F[3 + i, 9 + p] = psi_v[i, p]
            F[6 + i, 9 + p] = psi_p[i, p]
        F[6 + i, 3 + i] = T
    write_navigation_block(F, earth, force_sum, force_moment, T)


@nb.njit(cache=True)
def write_navigation_block(
    F: FloatArray, earth: FloatArray, force_sum: FloatArray, force_moment: FloatArray, T: float
) -> None:
    """Write the φ and δv columns of the transition matrix over T s, to first order in Ω T.

    `force_sum` and `force_moment` are ∫f dt and ∬f dt² in n, m/s and m, shape (3,).
    """
    for r, scale in ((0, 1.0), (3, 2.0)):
        F[r, r + 1] = scale * earth[2] * T
        F[r, r + 2] = -scale * earth[1] * T
        F[r + 1, r] = -scale * earth[2] * T
        F[r + 1, r + 2] = scale * earth[0] * T
        F[r + 2, r] = scale * earth[1] * T
        F[r + 2, r + 1] = -scale * earth[0] * T
    for r, s in ((3, force_sum), (6, force_moment)):
        F[r, 1] = s[2]
        F[r, 2] = -s[1]
        F[r + 1, 0] = -s[2]
        F[r + 1, 2] = s[0]
        F[r + 2, 0] = s[1]
        F[r + 2, 1] = -s[0]


@nb.njit(cache=True)
def body_rotation(c: Compensation, dt: float, gyro: FloatArray, start: int, stop: int) -> FloatArray:
    """Return the body rotation between two samples relative to inertial space, C_b(start)←b(stop), shape (3, 3)."""
    B, K, turned = np.eye(3), np.zeros((3, 3)), np.empty((3, 3))
    omega, last, cross, rotvec = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    before = start - 1 if start > 0 else start
    last[:] = c.gyro_inverse @ (gyro[before] - c.gyro_bias)
    for k in range(start, stop):
        for i in range(3):
            omega[i] = 0.0
            for j in range(3):
                omega[i] += c.gyro_inverse[i, j] * (gyro[k, j] - c.gyro_bias[j])
        _cross(last, omega, cross)
        for i in range(3):
            rotvec[i] = omega[i] * dt + cross[i] * dt * dt / 12.0
            last[i] = omega[i]
        _exponential(rotvec, K)
        for i in range(3):
            for j in range(3):
                turned[i, j] = B[i, 0] * K[0, j] + B[i, 1] * K[1, j] + B[i, 2] * K[2, j]
        B[:] = turned
    return B


@nb.njit(cache=True)
def dynamics(c: Compensation, omega: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ∂ω/∂p and ∂f/∂p, SI, shape (3, 27), of all parameters but the outer lever at a given rate and force."""
    rate_jacobian, force_jacobian = np.zeros((3, 27)), np.zeros((3, 27))
    _rate_jacobian(c, omega, rate_jacobian)
    _force_jacobian(c, omega, force, rate_jacobian, force_jacobian)
    return rate_jacobian, force_jacobian
