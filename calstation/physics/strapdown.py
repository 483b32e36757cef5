"""Compiled strapdown navigation at the sample rate, with the transition matrix of its errors.

The order of the error states is φ (0:3), δv (3:6), δp (6:9), the 30 parameters (9:39), where
`C_true = (I + [φ×]) C_computed`, `v_true = v + δv`. With ω, f compensated with the assumed parameters:

    φ̇  = −Ω×φ + C δω                 δv̇ = −[C f×] φ − 2Ω×δv + C δf              δṗ = δv
    δω = −(I+M_g)⁻¹ (δb_g + δM_g ω)
    δf = −J⁻¹ (δb_a + δM_a f + δK2∘f²) + δl∘c + l∘δc,   J = I + M_a + 2 diag(K2∘f),   c_i = |ω|² − ω_i²

References
----------
P. G. Savage, *Strapdown Inertial Navigation Integration Algorithm Design*, J. Guidance Control Dynamics
21(1-2), 1998: coning and sculling from the last and the current increment;
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


class Increments(NamedTuple):
    """Motion of n samples with the assumed parameters, in b."""

    rate: FloatArray  #: Angular rate, rad/s, shape (n, 3).
    rotation: FloatArray  #: Rotation during the sample relative to inertial space, by rows, shape (n, 9).
    velocity: FloatArray  #: Velocity increment, m/s, shape (n, 3).


def interval_work() -> IntervalWork:
    """Allocate the arrays for `propagate`."""
    return IntervalWork(np.eye(STATES), np.eye(3), np.zeros(3), np.zeros(3), np.zeros((3, 30)), np.zeros(3))


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


#: A vector in registers: an array for each would cost more than the computation.
Vector = tuple[float, float, float]
#: Rows of a matrix in registers.
Matrix = tuple[Vector, Vector, Vector]


@nb.njit(cache=True)
def _vector(a: FloatArray) -> Vector:
    return (a[0], a[1], a[2])


@nb.njit(cache=True)
def _cross_product(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@nb.njit(cache=True)
def _product(A: FloatArray, b: Vector) -> Vector:
    return (
        A[0, 0] * b[0] + A[0, 1] * b[1] + A[0, 2] * b[2],
        A[1, 0] * b[0] + A[1, 1] * b[1] + A[1, 2] * b[2],
        A[2, 0] * b[0] + A[2, 1] * b[1] + A[2, 2] * b[2],
    )


@nb.njit(cache=True)
def _squares(omega: Vector) -> Vector:
    """Return |ω|² − ω_i² of every axis, (rad/s)²."""
    x, y, z = omega[0] * omega[0], omega[1] * omega[1], omega[2] * omega[2]
    return (y + z, x + z, x + y)


@nb.njit(cache=True)
def _angular_rate(c: Compensation, gyro: FloatArray, k: int) -> Vector:
    """Return the angular rate of raw sample `k`, rad/s."""
    b = c.gyro_bias
    return _product(c.gyro_inverse, (gyro[k, 0] - b[0], gyro[k, 1] - b[1], gyro[k, 2] - b[2]))


@nb.njit(cache=True)
def _specific_force(c: Compensation, accel: FloatArray, k: int, omega: Vector) -> Vector:
    """Return the specific force of raw sample `k` at the reference point, m/s²."""
    b, q, lever = c.accel_bias, c.quadratic, c.inner_lever
    x, y, z = accel[k, 0] - b[0], accel[k, 1] - b[1], accel[k, 2] - b[2]
    f = _product(c.accel_inverse, (x, y, z))
    for _ in range(3):
        raw = (x - q[0] * f[0] * f[0], y - q[1] * f[1] * f[1], z - q[2] * f[2] * f[2])
        f = _product(c.accel_inverse, raw)
    square = _squares(omega)
    return (f[0] + lever[0] * square[0], f[1] + lever[1] * square[1], f[2] + lever[2] * square[2])


@nb.njit(cache=True)
def _exponential(rotvec: Vector) -> Matrix:
    """Return the rows of the rotation matrix of a rotation vector, rad (Rodrigues' formula)."""
    x, y, z = rotvec
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-8:
        a, b = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    else:
        angle = np.sqrt(angle2)
        a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2
    one = 1.0 - b * angle2
    return (
        (b * x * x + one, b * x * y - a * z, b * x * z + a * y),
        (b * x * y + a * z, b * y * y + one, b * y * z - a * x),
        (b * x * z - a * y, b * y * z + a * x, b * z * z + one),
    )


@nb.njit(cache=True)
def _increments(
    last_omega: Vector, last_force: Vector, omega: Vector, force: Vector, dt: float
) -> tuple[Vector, Vector]:
    """Return rotation vector, rad, and velocity increment, m/s, in b over one sample.

    Both include coning and sculling terms. The velocity also includes the third-order term ωdt×(ωdt×f dt)/6, without
    which gravity in a steadily rotating body is too small by (ω dt)²/6.
    """
    coning = _cross_product(last_omega, omega)
    turned = _cross_product(omega, force)
    third = _cross_product(omega, turned)
    first, second = _cross_product(last_omega, force), _cross_product(last_force, omega)
    square, cube, part = dt * dt, dt * dt * dt / 6.0, dt * dt / 12.0
    rotvec = (
        omega[0] * dt + coning[0] * part,
        omega[1] * dt + coning[1] * part,
        omega[2] * dt + coning[2] * part,
    )
    dv = (
        force[0] * dt + 0.5 * turned[0] * square + (first[0] + second[0]) * part + third[0] * cube,
        force[1] * dt + 0.5 * turned[1] * square + (first[1] + second[1]) * part + third[1] * cube,
        force[2] * dt + 0.5 * turned[2] * square + (first[2] + second[2]) * part + third[2] * cube,
    )
    return rotvec, dv


@nb.njit(cache=True)
def increments(c: Compensation, dt: float, gyro: FloatArray, accel: FloatArray) -> Increments:
    """Compute the motion of n samples from their raw mean rates, rad/s and m/s², shape (n, 3), `dt` s apart."""
    count = len(gyro)
    rate, rotation, velocity = np.empty((count, 3)), np.empty((count, 9)), np.empty((count, 3))
    # separate loop, because samples that do not depend on each other are computed at the same time
    for k in range(count):
        omega = _angular_rate(c, gyro, k)
        force = _specific_force(c, accel, k, omega)
        for i in range(3):
            rate[k, i], velocity[k, i] = omega[i], force[i]
    last_omega, last_force = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(count):
        omega, force = _row(rate, k), _row(velocity, k)
        if k == 0:
            last_omega, last_force = omega, force
        rotvec, dv = _increments(last_omega, last_force, omega, force, dt)
        E = _exponential(rotvec)
        for i in range(3):
            velocity[k, i] = dv[i]
            rotation[k, 3 * i], rotation[k, 3 * i + 1], rotation[k, 3 * i + 2] = E[i]
        last_omega, last_force = omega, force
    return Increments(rate, rotation, velocity)


@nb.njit(cache=True)
def _row(a: FloatArray, k: int) -> Vector:
    return (a[k, 0], a[k, 1], a[k, 2])


@nb.njit(cache=True)
def _turned(earth: Vector, C: Matrix, E: Matrix, dt: float) -> Matrix:
    """Return C_new = (I − [Ω dt×] + ½[Ω dt×]²) C E."""
    x, y, z = _times(C[0], E), _times(C[1], E), _times(C[2], E)
    p = _less_earth(earth, (x[0], y[0], z[0]), dt)
    q = _less_earth(earth, (x[1], y[1], z[1]), dt)
    r = _less_earth(earth, (x[2], y[2], z[2]), dt)
    return ((p[0], q[0], r[0]), (p[1], q[1], r[1]), (p[2], q[2], r[2]))


@nb.njit(cache=True)
def _times(a: Vector, B: Matrix) -> Vector:
    return (
        a[0] * B[0][0] + a[1] * B[1][0] + a[2] * B[2][0],
        a[0] * B[0][1] + a[1] * B[1][1] + a[2] * B[2][1],
        a[0] * B[0][2] + a[1] * B[1][2] + a[2] * B[2][2],
    )


@nb.njit(cache=True)
def _less_earth(earth: Vector, turned: Vector, dt: float) -> Vector:
    first = _cross_product(earth, turned)
    second = _cross_product(earth, first)
    return (
        turned[0] - first[0] * dt + 0.5 * second[0] * dt * dt,
        turned[1] - first[1] * dt + 0.5 * second[1] * dt * dt,
        turned[2] - first[2] * dt + 0.5 * second[2] * dt * dt,
    )


@nb.njit(cache=True)
def _rotated(C: Matrix, a: Vector) -> Vector:
    return (
        C[0][0] * a[0] + C[0][1] * a[1] + C[0][2] * a[2],
        C[1][0] * a[0] + C[1][1] * a[1] + C[1][2] * a[2],
        C[2][0] * a[0] + C[2][1] * a[1] + C[2][2] * a[2],
    )


@nb.njit(cache=True)
def propagate(
    c: Compensation,
    earth: FloatArray,
    gravity: float,
    dt: float,
    motion: Increments,
    start: int,
    stop: int,
    work: IntervalWork,
    jacobian: bool = True,
) -> None:
    """Integrate attitude and velocity over samples `start` to `stop` and write the transition over this interval.

    Parameters
    ----------
    c : constants of the assumed parameters
    earth, gravity : earth rate in n, rad/s, shape (3,), and gravity, m/s²
    dt : sample period, s
    motion : `increments` of all samples with these parameters
    start, stop : samples of this interval; the one after it is used for the end rate
    work : state and output
    jacobian : whether to write the columns of the parameters and the Jacobian of the rate
    """
    F, middle = work.transition, np.empty((3, 3))
    rows = 3 if jacobian else 0
    psi_phi, psi_v, psi_p = np.zeros((rows, 12)), np.zeros((rows, 27)), np.zeros((rows, 27))
    turn, push = np.empty((rows, 12)), np.empty((rows, 27))
    force_sum, force_moment = np.zeros(3), np.zeros(3)
    rates, rotations, velocities = motion
    rotation, v = _vector(earth), _vector(work.velocity)
    C = (_vector(work.attitude[0]), _vector(work.attitude[1]), _vector(work.attitude[2]))
    for k in range(start, stop):
        f = _rotated(C, _row(velocities, k))
        E = (
            (rotations[k, 0], rotations[k, 1], rotations[k, 2]),
            (rotations[k, 3], rotations[k, 4], rotations[k, 5]),
            (rotations[k, 6], rotations[k, 7], rotations[k, 8]),
        )
        before, C = C, _turned(rotation, C, E, dt)
        cross, coriolis = _cross_product(rotation, f), _cross_product(rotation, v)
        f = (
            (f[0] - 0.5 * dt * cross[0]) / dt,
            (f[1] - 0.5 * dt * cross[1]) / dt,
            (f[2] - 0.5 * dt * cross[2]) / dt,
        )
        v = (
            v[0] + (f[0] - 2.0 * coriolis[0]) * dt,
            v[1] + (f[1] - 2.0 * coriolis[1]) * dt,
            v[2] + (f[2] - 2.0 * coriolis[2]) * dt - gravity * dt,
        )
        for i in range(3):
            force_moment[i] += (force_sum[i] + 0.5 * f[i] * dt) * dt
            force_sum[i] += f[i] * dt
        if not jacobian:
            continue
        # transition blocks of the parameters by the midpoint rule; their errors act on the force implied by gravity and
        # rotation: the measured force contains noise, which an observation with the same noise would mistake for a
        # signal
        for i in range(3):
            for j in range(3):
                middle[i, j] = 0.5 * (before[i][j] + C[i][j])
        _parameter_columns(c, gravity, _row(rates, k), before[2], middle, turn, push)
        for p in range(12):
            x, y, z = turn[0, p] * dt, turn[1, p] * dt, turn[2, p] * dt
            tilt = (psi_phi[0, p] + 0.5 * x, psi_phi[1, p] + 0.5 * y, psi_phi[2, p] + 0.5 * z)
            push[0, p] -= f[1] * tilt[2] - f[2] * tilt[1]
            push[1, p] -= f[2] * tilt[0] - f[0] * tilt[2]
            push[2, p] -= f[0] * tilt[1] - f[1] * tilt[0]
            psi_phi[0, p] += x
            psi_phi[1, p] += y
            psi_phi[2, p] += z
        for i in range(3):
            for p in range(27):
                change = push[i, p] * dt
                psi_p[i, p] += (psi_v[i, p] + 0.5 * change) * dt
                psi_v[i, p] += change

    # the rate at the end is the mean of the last sample and the next
    rate = _row(rates, max(stop - 1, 0))
    if stop < len(rates):
        after = _row(rates, stop)
        rate = (0.5 * (after[0] + rate[0]), 0.5 * (after[1] + rate[1]), 0.5 * (after[2] + rate[2]))
    T = (stop - start) * dt
    for i in range(3):
        work.velocity[i], work.rate[i] = v[i], rate[i]
        work.attitude[i, 0], work.attitude[i, 1], work.attitude[i, 2] = C[i]
        work.force[i] = force_sum[i] / T if stop > start else 0.0
        F[6 + i, 3 + i] = T
    write_navigation_block(F, earth, force_sum, force_moment, T)
    if jacobian:
        _rate_jacobian(c, work.rate, work.rate_jacobian)
        for i in range(3):
            for p in range(12):
                F[i, 9 + p] = psi_phi[i, p]
            for p in range(27):
                F[3 + i, 9 + p] = psi_v[i, p]
                F[6 + i, 9 + p] = psi_p[i, p]


@nb.njit(cache=True)
def _parameter_columns(
    c: Compensation, gravity: float, omega: Vector, up: Vector, C: FloatArray, turn: FloatArray, push: FloatArray
) -> None:
    """Write C ∂ω/∂p, shape (3, 12), and C ∂f/∂p, shape (3, 27), as in `dynamics`; shared products are computed once.

    `up` is the upward direction in b, for the force implied by gravity and rotation.
    """
    x, y, z = omega
    lever, g, a, q = c.inner_lever, c.gyro_inverse, c.accel_inverse, c.quadratic
    central = _cross_product(omega, _cross_product(omega, _vector(c.outer_lever)))
    force = (central[0] + up[0] * gravity, central[1] + up[1] * gravity, central[2] + up[2] * gravity)
    weight = (1.0 - 2.0 * q[0] * force[0], 1.0 - 2.0 * q[1] * force[1], 1.0 - 2.0 * q[2] * force[2])
    square = _squares(omega)
    for i in range(3):
        s, t, u = C[i, 0], C[i, 1], C[i, 2]
        d = -(s * g[0, 0] + t * g[1, 0] + u * g[2, 0])
        e = -(s * g[0, 1] + t * g[1, 1] + u * g[2, 1])
        f = -(s * g[0, 2] + t * g[1, 2] + u * g[2, 2])
        turn[i, 0], turn[i, 1], turn[i, 2] = d, e, f
        turn[i, 3], turn[i, 4], turn[i, 5] = d * x, e * y, f * z
        turn[i, 6], turn[i, 7], turn[i, 8] = d * y, d * z, e * x
        turn[i, 9], turn[i, 10], turn[i, 11] = e * z, f * x, f * y
        # the size effect turns an error of the rate into an error of the force
        m = 2.0 * x * (t * lever[1] + u * lever[2])
        n = 2.0 * y * (s * lever[0] + u * lever[2])
        o = 2.0 * z * (s * lever[0] + t * lever[1])
        d = -(m * g[0, 0] + n * g[1, 0] + o * g[2, 0])
        e = -(m * g[0, 1] + n * g[1, 1] + o * g[2, 1])
        f = -(m * g[0, 2] + n * g[1, 2] + o * g[2, 2])
        push[i, 0], push[i, 1], push[i, 2] = d, e, f
        push[i, 3], push[i, 4], push[i, 5] = d * x, e * y, f * z
        push[i, 6], push[i, 7], push[i, 8] = d * y, d * z, e * x
        push[i, 9], push[i, 10], push[i, 11] = e * z, f * x, f * y
        d = -(s * a[0, 0] + t * a[1, 0] + u * a[2, 0]) * weight[0]
        e = -(s * a[0, 1] + t * a[1, 1] + u * a[2, 1]) * weight[1]
        f = -(s * a[0, 2] + t * a[1, 2] + u * a[2, 2]) * weight[2]
        push[i, 12], push[i, 13], push[i, 14] = d, e, f
        push[i, 15], push[i, 16], push[i, 17] = d * force[0], e * force[1], f * force[2]
        push[i, 18], push[i, 19], push[i, 20] = e * force[0], f * force[0], f * force[1]
        push[i, 21], push[i, 22] = d * force[0] * force[0], e * force[1] * force[1]
        push[i, 23] = f * force[2] * force[2]
        push[i, 24], push[i, 25], push[i, 26] = s * square[0], t * square[1], u * square[2]


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
    B = np.eye(3)
    last = _angular_rate(c, gyro, start - 1 if start > 0 else start)
    for k in range(start, stop):
        omega = _angular_rate(c, gyro, k)
        coning = _cross_product(last, omega)
        E = _exponential(
            (
                omega[0] * dt + coning[0] * dt * dt / 12.0,
                omega[1] * dt + coning[1] * dt * dt / 12.0,
                omega[2] * dt + coning[2] * dt * dt / 12.0,
            )
        )
        last = omega
        for i in range(3):
            x, y, z = B[i, 0], B[i, 1], B[i, 2]
            for j in range(3):
                B[i, j] = x * E[0][j] + y * E[1][j] + z * E[2][j]
    return B


@nb.njit(cache=True)
def dynamics(c: Compensation, omega: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ∂ω/∂p and ∂f/∂p, SI, shape (3, 27), of all parameters but the outer lever at a given rate and force."""
    rate_jacobian, force_jacobian = np.zeros((3, 27)), np.zeros((3, 27))
    _rate_jacobian(c, omega, rate_jacobian)
    _force_jacobian(c, omega, force, rate_jacobian, force_jacobian)
    return rate_jacobian, force_jacobian
