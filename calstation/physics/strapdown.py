"""Compiled strapdown navigation at the sample rate, with the transition matrix of its errors.

The error states (see `physics.parameters`) are φ, δv, δp and the 30 parameters, where
`C_true = (I + [φ×]) C_computed`, `v_true = v + δv`. Errors are true minus computed.
With ω, f compensated with the assumed parameters:

    φ̇  = −Ω×φ + C δω                 δv̇ = −[C f×] φ − 2Ω×δv + C δf              δṗ = δv
    δω = −(I+M_g)⁻¹ (δb_g + δM_g ω)
    δf = −J⁻¹ (δb_a + δM_a f + δK2∘f²) + δl∘c + l∘δc,   J = I + M_a + 2 diag(K2∘f),   c_i = |ω|² − ω_i²

References
----------
P. G. Savage, *Strapdown Inertial Navigation Integration Algorithm Design*, J. Guidance Control Dynamics
21(1-2), 1998: coning and sculling terms from the previous and the current increment;
the third-order term assumes constant ω and quadratic f over the sample.
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14.
"""

from typing import NamedTuple

import numpy as np

from calstation.physics.arrays import FloatArray
from calstation.physics.imu_model import Compensation
from calstation.physics.kernels import kernel
from calstation.physics.parameters import (
    ACCEL_BIAS,
    ACCEL_MISALIGN,
    ACCEL_QUADRATIC,
    ACCEL_SCALE,
    COUNT,
    DP,
    DV,
    GYRO_BIAS,
    GYRO_MISALIGN,
    GYRO_SCALE,
    GYROS,
    INNER_LEVER,
    PARAMETER_START,
    PHI,
    SENSORS,
    STATES,
)

# first indices of groups, for the kernels
_BG, _SG, _MG = GYRO_BIAS.start, GYRO_SCALE.start, GYRO_MISALIGN.start
_B, _S, _M, _Q = ACCEL_BIAS.start, ACCEL_SCALE.start, ACCEL_MISALIGN.start, ACCEL_QUADRATIC.start
_L, _GYROS, _SENSORS = INNER_LEVER.start, GYROS.stop, SENSORS.stop
_PHI, _DV, _DP = PHI.start, DV.start, DP.start


class IntervalWork(NamedTuple):
    """State and output of `propagate` for one interval."""

    transition: FloatArray  #: Transition matrix over the interval, shape (39, 39).
    attitude: FloatArray  #: C_bn, shape (3, 3), updated in place.
    velocity: FloatArray  #: v in n, m/s, shape (3,), updated in place.
    rate: FloatArray  #: Angular rate ω_ib at the end of the interval, rad/s, shape (3,).
    rate_jacobian: FloatArray  #: ∂ω/∂parameters at the end of the interval, shape (3, 30).
    force: FloatArray  #: Mean specific force in n, m/s², shape (3,).
    displacement: FloatArray  #: ∫v dt over the interval in n, m, shape (3,).


class Increments(NamedTuple):
    """Motion during n samples in b, computed with the assumed parameters."""

    rate: FloatArray  #: Angular rate, rad/s, shape (n, 3).
    rotation: FloatArray  #: Rotation matrix of the sample relative to inertial space, by rows, shape (n, 9).
    velocity: FloatArray  #: Velocity increment, m/s, shape (n, 3).


def interval_work() -> IntervalWork:
    """Allocate the arrays for `propagate`."""
    velocity, rate, force, displacement = np.zeros((4, 3))
    return IntervalWork(np.eye(STATES), np.eye(3), velocity, rate, np.zeros((3, COUNT)), force, displacement)


#: A vector in registers; allocating arrays would take longer than the computation.
Vector = tuple[float, float, float]
#: Rows of a matrix in registers.
Matrix = tuple[Vector, Vector, Vector]


@kernel
def _vector(a: FloatArray) -> Vector:
    return (a[0], a[1], a[2])


@kernel
def _cross_product(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@kernel
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _product(A: FloatArray, b: Vector) -> Vector:
    return (_dot(_vector(A[0]), b), _dot(_vector(A[1]), b), _dot(_vector(A[2]), b))


@kernel
def _squares(omega: Vector) -> Vector:
    """Return |ω|² − ω_i² of every axis, (rad/s)²."""
    x, y, z = omega[0] * omega[0], omega[1] * omega[1], omega[2] * omega[2]
    return (y + z, x + z, x + y)


@kernel
def _angular_rate(c: Compensation, gyro: FloatArray, k: int) -> Vector:
    """Return the angular rate of raw sample `k`, rad/s."""
    b = c.gyro_bias
    return _product(c.gyro_inverse, (gyro[k, 0] - b[0], gyro[k, 1] - b[1], gyro[k, 2] - b[2]))


@kernel
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


@kernel
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


@kernel
def _increments(
    last_omega: Vector, last_force: Vector, omega: Vector, force: Vector, dt: float
) -> tuple[Vector, Vector]:
    """Return rotation vector, rad, and velocity increment, m/s, in b over one sample.

    Both include coning and sculling terms. The velocity also includes the third-order term ωdt×(ωdt×f dt)/6, without
    which a force perpendicular to a steady rotation would be too large by (ω dt)²/6.
    """
    coning = _cross_product(last_omega, omega)
    product = _cross_product(omega, force)
    third = _cross_product(omega, product)
    first, second = _cross_product(last_omega, force), _cross_product(last_force, omega)
    square, cube, part = dt * dt, dt * dt * dt / 6.0, dt * dt / 12.0
    rotvec = (omega[0] * dt + coning[0] * part, omega[1] * dt + coning[1] * part, omega[2] * dt + coning[2] * part)
    dv = (
        force[0] * dt + 0.5 * product[0] * square + (first[0] + second[0]) * part + third[0] * cube,
        force[1] * dt + 0.5 * product[1] * square + (first[1] + second[1]) * part + third[1] * cube,
        force[2] * dt + 0.5 * product[2] * square + (first[2] + second[2]) * part + third[2] * cube,
    )
    return rotvec, dv


@kernel
def increments(c: Compensation, dt: float, gyro: FloatArray, accel: FloatArray) -> Increments:
    """Compute the motion of n samples from their raw mean rates and specific forces.

    Parameters
    ----------
    c : parameters of the compensation; see `compensation`
    dt : sample period, s
    gyro, accel : raw mean rates, rad/s, and raw mean specific forces, m/s², shape (n, 3)
    """
    count = len(gyro)
    rate, rotation, velocity = np.empty((count, 3)), np.empty((count, 9)), np.empty((count, 3))
    # a separate loop, because the compiler vectorises samples that are independent of each other
    for k in range(count):
        omega = _angular_rate(c, gyro, k)
        force = _specific_force(c, accel, k, omega)
        for i in range(3):
            rate[k, i], velocity[k, i] = omega[i], force[i]
    last_omega, last_force = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(count):
        omega, force = _vector(rate[k]), _vector(velocity[k])
        if k == 0:
            last_omega, last_force = omega, force
        rotvec, dv = _increments(last_omega, last_force, omega, force, dt)
        E = _exponential(rotvec)
        for i in range(3):
            velocity[k, i] = dv[i]
            rotation[k, 3 * i], rotation[k, 3 * i + 1], rotation[k, 3 * i + 2] = E[i]
        last_omega, last_force = omega, force
    return Increments(rate, rotation, velocity)


@kernel
def _next_attitude(earth: Vector, C: Matrix, E: Matrix, dt: float) -> Matrix:
    """Return C_new = (I − [Ω dt×] + ½[Ω dt×]²) C E."""
    x, y, z = _times(C[0], E), _times(C[1], E), _times(C[2], E)
    p = _without_earth(earth, (x[0], y[0], z[0]), dt)
    q = _without_earth(earth, (x[1], y[1], z[1]), dt)
    r = _without_earth(earth, (x[2], y[2], z[2]), dt)
    return ((p[0], q[0], r[0]), (p[1], q[1], r[1]), (p[2], q[2], r[2]))


@kernel
def _times(a: Vector, B: Matrix) -> Vector:
    return (
        a[0] * B[0][0] + a[1] * B[1][0] + a[2] * B[2][0],
        a[0] * B[0][1] + a[1] * B[1][1] + a[2] * B[2][1],
        a[0] * B[0][2] + a[1] * B[1][2] + a[2] * B[2][2],
    )


@kernel
def _without_earth(earth: Vector, vector: Vector, dt: float) -> Vector:
    first = _cross_product(earth, vector)
    second = _cross_product(earth, first)
    return (
        vector[0] - first[0] * dt + 0.5 * second[0] * dt * dt,
        vector[1] - first[1] * dt + 0.5 * second[1] * dt * dt,
        vector[2] - first[2] * dt + 0.5 * second[2] * dt * dt,
    )


@kernel
def _lever_acceleration(c: Compensation, C: Matrix, before: Vector, after: Vector, dt: float) -> Vector:
    """Return the acceleration of the outer lever arm in n between two samples from their rates, m/s²."""
    lever = _vector(c.outer_lever)
    omega = (0.5 * (before[0] + after[0]), 0.5 * (before[1] + after[1]), 0.5 * (before[2] + after[2]))
    change = ((after[0] - before[0]) / dt, (after[1] - before[1]) / dt, (after[2] - before[2]) / dt)
    central, tangential = _cross_product(omega, _cross_product(omega, lever)), _cross_product(change, lever)
    a = (central[0] + tangential[0], central[1] + tangential[1], central[2] + tangential[2])
    return (_dot(C[0], a), _dot(C[1], a), _dot(C[2], a))


@kernel
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
    start, stop : samples of this interval; the next sample is used for the rate at its end
    work : state and output
    jacobian : whether to write the columns of the parameters and the Jacobian of the rate
    """
    F, middle = work.transition, np.empty((3, 3))
    rows = 3 if jacobian else 0
    psi_phi, psi_v, psi_p = np.zeros((rows, _GYROS)), np.zeros((rows, _SENSORS)), np.zeros((rows, _SENSORS))
    turn, push = np.empty((rows, _GYROS)), np.empty((rows, _SENSORS))
    force_sum, force_moment, displacement = np.zeros(3), np.zeros(3), (0.0, 0.0, 0.0)
    rates, rotations, velocities = motion
    rotation, v = _vector(earth), _vector(work.velocity)
    C = (_vector(work.attitude[0]), _vector(work.attitude[1]), _vector(work.attitude[2]))
    last_rate, first_rate = _vector(rates[max(start - 1, 0)]), _vector(rates[min(start, len(rates) - 1)])
    last_a = _lever_acceleration(c, C, last_rate, first_rate, dt)
    for k in range(start, stop):
        increment = _vector(velocities[k])
        f = (_dot(C[0], increment), _dot(C[1], increment), _dot(C[2], increment))
        E = (
            (rotations[k, 0], rotations[k, 1], rotations[k, 2]),
            (rotations[k, 3], rotations[k, 4], rotations[k, 5]),
            (rotations[k, 6], rotations[k, 7], rotations[k, 8]),
        )
        before, C, last_v = C, _next_attitude(rotation, C, E, dt), v
        cross, coriolis = _cross_product(rotation, f), _cross_product(rotation, v)
        f = ((f[0] - 0.5 * dt * cross[0]) / dt, (f[1] - 0.5 * dt * cross[1]) / dt, (f[2] - 0.5 * dt * cross[2]) / dt)
        v = (
            v[0] + (f[0] - 2.0 * coriolis[0]) * dt,
            v[1] + (f[1] - 2.0 * coriolis[1]) * dt,
            v[2] + (f[2] - 2.0 * coriolis[2]) * dt - gravity * dt,
        )
        displacement = (
            displacement[0] + 0.5 * dt * (last_v[0] + v[0]),
            displacement[1] + 0.5 * dt * (last_v[1] + v[1]),
            displacement[2] + 0.5 * dt * (last_v[2] + v[2]),
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
        omega, up = _vector(rates[k]), _vector(middle[2])
        central = _cross_product(omega, _cross_product(omega, _vector(c.outer_lever)))
        implied = (central[0] + up[0] * gravity, central[1] + up[1] * gravity, central[2] + up[2] * gravity)
        _rate_columns(c, omega, middle, turn)
        _size_effect_columns(c, omega, middle, push)
        _force_columns(c, omega, implied, middle, push)
        for p in range(_GYROS):
            x, y, z = turn[0, p] * dt, turn[1, p] * dt, turn[2, p] * dt
            tilt = (psi_phi[0, p] + 0.5 * x, psi_phi[1, p] + 0.5 * y, psi_phi[2, p] + 0.5 * z)
            push[0, p] -= f[1] * tilt[2] - f[2] * tilt[1]
            push[1, p] -= f[2] * tilt[0] - f[0] * tilt[2]
            push[2, p] -= f[0] * tilt[1] - f[1] * tilt[0]
            psi_phi[0, p] += x
            psi_phi[1, p] += y
            psi_phi[2, p] += z
        for i in range(3):
            for p in range(_SENSORS):
                change = push[i, p] * dt
                psi_p[i, p] += (psi_v[i, p] + 0.5 * change) * dt
                psi_v[i, p] += change

    # the rate at the end is the mean of the last sample and the next
    last_rate, next_rate = _vector(rates[max(stop - 1, 0)]), _vector(rates[min(stop, len(rates) - 1)])
    rate = (
        0.5 * (last_rate[0] + next_rate[0]),
        0.5 * (last_rate[1] + next_rate[1]),
        0.5 * (last_rate[2] + next_rate[2]),
    )
    # the trapezoidal rule is wrong by dt²/12 times the change of the acceleration (Euler-Maclaurin): gravity is
    # constant in n; the lever arm's acceleration follows from the rates, because the measured force contains noise
    a, square = _lever_acceleration(c, C, last_rate, next_rate, dt), dt * dt / 12.0
    displacement = (
        displacement[0] - square * (a[0] - last_a[0]),
        displacement[1] - square * (a[1] - last_a[1]),
        displacement[2] - square * (a[2] - last_a[2]),
    )
    T = (stop - start) * dt
    for i in range(3):
        work.velocity[i], work.rate[i], work.displacement[i] = v[i], rate[i], displacement[i]
        work.attitude[i, 0], work.attitude[i, 1], work.attitude[i, 2] = C[i]
        work.force[i] = force_sum[i] / T if stop > start else 0.0
        F[_DP + i, _DV + i] = T
    write_navigation_block(F, earth, force_sum, force_moment, T)
    if jacobian:
        _rate_columns(c, rate, np.eye(3), work.rate_jacobian)
        for i in range(3):
            for p in range(_GYROS):
                F[_PHI + i, PARAMETER_START + p] = psi_phi[i, p]
            for p in range(_SENSORS):
                F[_DV + i, PARAMETER_START + p] = psi_v[i, p]
                F[_DP + i, PARAMETER_START + p] = psi_p[i, p]


@kernel
def _rate_columns(c: Compensation, omega: Vector, C: FloatArray, out: FloatArray) -> None:
    """Write C ∂ω/∂p of the gyro parameters, ∂ω/∂p = −(I + M_g)⁻¹ [I, diag ω, ...], shape (3, ≥ 12)."""
    x, y, z = omega
    g = c.gyro_inverse
    for i in range(3):
        s, t, u = C[i, 0], C[i, 1], C[i, 2]
        d = -(s * g[0, 0] + t * g[1, 0] + u * g[2, 0])
        e = -(s * g[0, 1] + t * g[1, 1] + u * g[2, 1])
        f = -(s * g[0, 2] + t * g[1, 2] + u * g[2, 2])
        _write_gyro_columns(x, y, z, d, e, f, out[i])


@kernel
def _size_effect_columns(c: Compensation, omega: Vector, C: FloatArray, out: FloatArray) -> None:
    """Write C ∂f/∂p of the gyro parameters, on which f depends through the size effect, shape (3, ≥ 12)."""
    x, y, z = omega
    lever, g = c.inner_lever, c.gyro_inverse
    for i in range(3):
        s, t, u = C[i, 0], C[i, 1], C[i, 2]
        m = 2.0 * x * (t * lever[1] + u * lever[2])
        n = 2.0 * y * (s * lever[0] + u * lever[2])
        o = 2.0 * z * (s * lever[0] + t * lever[1])
        d = -(m * g[0, 0] + n * g[1, 0] + o * g[2, 0])
        e = -(m * g[0, 1] + n * g[1, 1] + o * g[2, 1])
        f = -(m * g[0, 2] + n * g[1, 2] + o * g[2, 2])
        _write_gyro_columns(x, y, z, d, e, f, out[i])


@kernel
def _force_columns(c: Compensation, omega: Vector, force: Vector, C: FloatArray, out: FloatArray) -> None:
    """Write C ∂f/∂p at the reference point of the accelerometer parameters and the inner lever arm, shape (3, ≥ 27)."""
    a, q = c.accel_inverse, c.quadratic
    # first-order inverse of I + M_a + 2 diag(K2 f): K2 f is a few 1e-4 at most
    weight = (1.0 - 2.0 * q[0] * force[0], 1.0 - 2.0 * q[1] * force[1], 1.0 - 2.0 * q[2] * force[2])
    square = _squares(omega)
    for i in range(3):
        s, t, u, row = C[i, 0], C[i, 1], C[i, 2], out[i]
        d = -(s * a[0, 0] + t * a[1, 0] + u * a[2, 0]) * weight[0]
        e = -(s * a[0, 1] + t * a[1, 1] + u * a[2, 1]) * weight[1]
        f = -(s * a[0, 2] + t * a[1, 2] + u * a[2, 2]) * weight[2]
        row[_B], row[_B + 1], row[_B + 2] = d, e, f
        row[_S], row[_S + 1], row[_S + 2] = d * force[0], e * force[1], f * force[2]
        row[_M], row[_M + 1], row[_M + 2] = e * force[0], f * force[0], f * force[1]
        row[_Q], row[_Q + 1] = d * force[0] * force[0], e * force[1] * force[1]
        row[_Q + 2] = f * force[2] * force[2]
        row[_L], row[_L + 1], row[_L + 2] = s * square[0], t * square[1], u * square[2]


@kernel
def _write_gyro_columns(x: float, y: float, z: float, d: float, e: float, f: float, row: FloatArray) -> None:
    """Write a row of derivatives by gyro bias, scale and misalignment: (d, e, f) per rad/s of each raw rate."""
    row[_BG], row[_BG + 1], row[_BG + 2] = d, e, f
    row[_SG], row[_SG + 1], row[_SG + 2] = d * x, e * y, f * z
    row[_MG], row[_MG + 1], row[_MG + 2] = d * y, d * z, e * x
    row[_MG + 3], row[_MG + 4], row[_MG + 5] = e * z, f * x, f * y


@kernel
def write_navigation_block(
    F: FloatArray, earth: FloatArray, force_sum: FloatArray, force_moment: FloatArray, T: float
) -> None:
    """Write the φ and δv columns of the transition matrix over T s, to first order in Ω T.

    Parameters
    ----------
    F : transition matrix, shape (n, n) with n of at least 9; changed in place
    earth : earth rate in n, rad/s, shape (3,)
    force_sum, force_moment : ∫f dt and ∬f dt² in n, m/s and m, shape (3,)
    T : duration of the interval, s
    """
    for r, scale in ((_PHI, 1.0), (_DV, 2.0)):
        F[r, r + 1] = scale * earth[2] * T
        F[r, r + 2] = -scale * earth[1] * T
        F[r + 1, r] = -scale * earth[2] * T
        F[r + 1, r + 2] = scale * earth[0] * T
        F[r + 2, r] = scale * earth[1] * T
        F[r + 2, r + 1] = -scale * earth[0] * T
    for r, s in ((_DV, force_sum), (_DP, force_moment)):
        F[r, _PHI + 1] = s[2]
        F[r, _PHI + 2] = -s[1]
        F[r + 1, _PHI] = -s[2]
        F[r + 1, _PHI + 2] = s[0]
        F[r + 2, _PHI] = s[1]
        F[r + 2, _PHI + 1] = -s[0]


@kernel
def body_rotation(c: Compensation, dt: float, gyro: FloatArray, start: int, stop: int) -> FloatArray:
    """Return the body rotation between two samples relative to inertial space, C_b(start)←b(stop), shape (3, 3).

    Parameters
    ----------
    c : parameters of the compensation; see `compensation`
    dt : sample period, s
    gyro : raw mean rates, rad/s, shape (n, 3)
    start, stop : first sample, and the one after the last
    """
    B: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
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
        B = (_times(B[0], E), _times(B[1], E), _times(B[2], E))
    return np.array(B)


@kernel
def dynamics(c: Compensation, omega: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ∂ω/∂p and ∂f/∂p, SI, shape (3, 27), of all parameters but the outer lever arm at a given rate and force.

    Parameters
    ----------
    c : parameters of the compensation; see `compensation`
    omega, force : compensated rate, rad/s, and specific force, m/s², in b, shape (3,)
    """
    rate_jacobian, force_jacobian = np.zeros((3, _SENSORS)), np.zeros((3, _SENSORS))
    _rate_columns(c, _vector(omega), np.eye(3), rate_jacobian)
    _force_columns(c, _vector(omega), _vector(force), np.eye(3), force_jacobian)
    for i in range(3):
        for k in range(_GYROS):
            change = 0.0
            for j in range(3):
                if j != i:
                    change += omega[j] * rate_jacobian[j, k]
            force_jacobian[i, k] = 2.0 * c.inner_lever[i] * change
    return rate_jacobian, force_jacobian
