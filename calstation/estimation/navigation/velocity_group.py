"""Compiled computation of transition, noise and Jacobian of a group of velocity observations.

The matrix algebra of 39 states takes nearly as long for three rows as for fifteen, so groups of observations are used.
The observed velocity is the mean over an interval of T s, because samples of a vibration would alias. With the outer
lever arm r and the displacement p of the IMU (the integral of its velocity), it is z_k = (C_k r − C_(k−1) r − p)/T.
The errors at the end of the interval, x_k = Φ_k x_(k−1) + w_k, change z_k by B_k x_k, and those at its start by
A_k x_(k−1), so that z_k = H_k x_(k−1) + B_k w_k + v_k with H_k = B_k Φ_k + A_k. With the state at the end of the group,

    z_k = G_k x_n + B_k w_k + v_k − G_k w_(k−1→n),      G_k = H_k Φ(n←k−1)⁻¹,

which is equivalent to processing the observations one by one. Their noise is then correlated between rows (R) and with
the process noise of the group (M). The update uses both (Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with
Applications to Tracking and Navigation*, 2001, section 8.3).
"""

from typing import NamedTuple

import numpy as np

from calstation.physics import (
    ACCEL_BIAS,
    COUNT,
    DP,
    DV,
    GYRO_BIAS,
    GYROS,
    OUTER_LEVER,
    PARAMETER_START,
    PARAMETER_STATES,
    PHI,
    STATES,
    Compensation,
    FloatArray,
    Increments,
    IntervalWork,
    kernel,
    propagate,
    rotation_vector,
    write_navigation_block,
)

#: Number of navigation states, and of those on which an observation depends: φ and δv, which never depend on δp.
NAVIGATION, OBSERVED = PARAMETER_START, DV.stop
#: Indices of the six biases in the state; with bias instability, six drift states follow the 39 states.
BIAS = PARAMETER_START + np.r_[GYRO_BIAS, ACCEL_BIAS]
_DV, _DP, _LEVER, _GYROS = DV.start, DP.start, PARAMETER_START + OUTER_LEVER.start, GYROS.stop


class Setting(NamedTuple):
    """Constants of a pass."""

    earth: FloatArray  #: Earth rate in n, rad/s, shape (3,).
    gravity: float  #: m/s²
    dt: float  #: Sample period, s.
    stride: int  #: Samples per observation.
    rate_noise: float  #: Spectral density of the rate noise, rad²/s.
    force_noise: float  #: Spectral density of the force noise, (m/s)²/s.
    variance: float  #: Variance of an observation, (m/s)².


class Reference(NamedTuple):
    """Attitude C_bn, shape (m, 3, 3), and velocity, m/s, shape (m, 3), at the ends of m intervals."""

    attitude: FloatArray
    velocity: FloatArray


class VelocityGroup(NamedTuple):
    """Output of `observe` for n observations and a filter with m states, 39, or 45 with bias drift."""

    transition: FloatArray  #: Transition over the group, shape (m, m); the caller writes the decay of the drift states.
    noise: FloatArray  #: Process noise over the group, shape (m, m); the caller writes that of the drift states.
    shift: FloatArray  #: Change of the errors φ, δv, δp due to following a reference, shape (9,).
    z: FloatArray  #: Observations of the state at the end of the group, shape (3 n,).
    H: FloatArray  #: Jacobian of the observations, shape (3 n, m).
    R: FloatArray  #: Covariance of the observations, shape (3 n, 3 n).
    M: FloatArray  #: Covariance of process and observation noise, shape (m, 3 n).
    attitude: FloatArray  #: C_bn at each observation, shape (n, 3, 3).
    rate: FloatArray  #: ω_ib at each observation, rad/s, shape (n, 3).


def velocity_group(count: int, size: int) -> VelocityGroup:
    """Allocate the arrays for `count` observations and a filter with `size` states."""
    rows = 3 * count
    return VelocityGroup(
        np.eye(size),
        np.zeros((size, size)),
        np.zeros(NAVIGATION),
        np.zeros(rows),
        np.zeros((rows, size)),
        np.zeros((rows, rows)),
        np.zeros((size, rows)),
        np.zeros((count, 3, 3)),
        np.zeros((count, 3)),
    )


@kernel
def _inverse(S: FloatArray) -> FloatArray:
    """Return the inverse of a 3×3 matrix, computed from its adjugate."""
    A = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a, b, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            A[i, j] = S[a, c] * S[b, d] - S[a, d] * S[b, c]
    A /= S[0, 0] * A[0, 0] + S[0, 1] * A[1, 0] + S[0, 2] * A[2, 0]
    return A


@kernel
def _process_noise(force: FloatArray, rate_q: float, force_q: float, T: float, Q: FloatArray) -> None:
    """Write into Q, shape (9, 9), the covariance in n of white rate and force noise over T s (Groves 14.80)."""
    fx, fy, fz = force[0], force[1], force[2]
    A = np.zeros((3, 3))
    A[0, 1], A[0, 2], A[1, 2] = fz, -fy, fx
    A[1, 0], A[2, 0], A[2, 1] = -fz, fy, -fx
    for i in range(3):
        Q[i, i] = rate_q * T
        for j in range(3):
            Q[_DV + i, j] = A[i, j] * rate_q * T**2 / 2.0
            Q[j, _DV + i] = Q[_DV + i, j]
            Q[_DP + i, j] = A[i, j] * rate_q * T**3 / 6.0
            Q[j, _DP + i] = Q[_DP + i, j]
            s = 0.0
            for k in range(3):
                s += A[i, k] * A[j, k]
            Q[_DV + i, _DV + j] = s * rate_q * T**3 / 3.0
            Q[_DP + i, _DV + j] = s * rate_q * T**4 / 8.0
            Q[_DV + j, _DP + i] = Q[_DP + i, _DV + j]
            Q[_DP + i, _DP + j] = s * rate_q * T**5 / 20.0
        Q[_DV + i, _DV + i] += force_q * T
        Q[_DP + i, _DP + i] += force_q * T**3 / 3.0
        Q[_DP + i, _DV + i] += force_q * T**2 / 2.0
        Q[_DV + i, _DP + i] = Q[_DP + i, _DV + i]


@kernel
def arm_motion(work: IntervalWork, earth: FloatArray, lever: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ω_nb in b, rad/s, and the velocity of the lever arm, C (ω_nb × r), m/s, shape (3,) each.

    Parameters
    ----------
    work : state of the interval
    earth : earth rate in n, rad/s, shape (3,)
    lever : lever arm r in b, m, shape (3,)
    """
    C, r, w, u = work.attitude, lever, np.empty(3), np.empty(3)
    for i in range(3):
        w[i] = work.rate[i] - C[0, i] * earth[0] - C[1, i] * earth[1] - C[2, i] * earth[2]
    x, y, z = w[1] * r[2] - w[2] * r[1], w[2] * r[0] - w[0] * r[2], w[0] * r[1] - w[1] * r[0]
    for i in range(3):
        u[i] = C[i, 0] * x + C[i, 1] * y + C[i, 2] * z
    return w, u


@kernel
def observation(work: IntervalWork, earth: FloatArray, c: Compensation, z: FloatArray, H: FloatArray) -> FloatArray:
    """Write the velocity observation z = u − v and its Jacobian, and return the arm velocity u = C(ω_nb × r), m/s.

    The blocks of H are [u×] for φ, I for δv, C [r×] ∂ω for the gyro parameters and −C [ω_nb×] for the outer lever.

    Parameters
    ----------
    work, c : navigation state and Jacobians of the interval; constants of the assumed parameters
    earth : earth rate in n, rad/s, shape (3,)
    z, H : observation, m/s, shape (3,), and its Jacobian, shape (3, n) for n states; output
    """
    C, r, jacobian = work.attitude, c.outer_lever, work.rate_jacobian
    w, u = arm_motion(work, earth, r)
    for i in range(3):
        z[i] = u[i] - work.velocity[i]
        H[i, _DV + i] = 1.0
        H[i, _LEVER] = -(C[i, 1] * w[2] - C[i, 2] * w[1])
        H[i, _LEVER + 1] = -(C[i, 2] * w[0] - C[i, 0] * w[2])
        H[i, _LEVER + 2] = -(C[i, 0] * w[1] - C[i, 1] * w[0])
        a, b, d = C[i, 1] * r[2] - C[i, 2] * r[1], C[i, 2] * r[0] - C[i, 0] * r[2], C[i, 0] * r[1] - C[i, 1] * r[0]
        for p in range(_GYROS):
            H[i, PARAMETER_START + p] = a * jacobian[0, p] + b * jacobian[1, p] + d * jacobian[2, p]
    write_attitude_columns(u, H)
    return u


@kernel
def write_attitude_columns(u: FloatArray, H: FloatArray) -> None:
    """Write [u×] into the φ columns of H, whose diagonal is 0."""
    H[0, 1], H[0, 2], H[1, 2] = -u[2], u[1], -u[0]
    H[1, 0], H[2, 0], H[2, 1] = u[2], -u[1], u[0]


@kernel
def _add_interval_noise(
    N: FloatArray, force: FloatArray, arm: FloatArray, s: Setting, Q: FloatArray, W: FloatArray, noise: FloatArray
) -> None:
    """Add the noise Q of an interval, propagated to the end of the group, to W: W += N Q Nᵀ.

    Also write the covariance N Q Bᵀ with the observation's own noise B w, shape (9, 3), to the first rows of `noise`,
    and B Q Bᵀ to the last three rows, with B = [[arm×], 0, I/T].
    """
    T = s.stride * s.dt
    _process_noise(force, s.rate_noise, s.force_noise, T, Q)
    product, transposed, QB = np.zeros((NAVIGATION, NAVIGATION)), N.T.copy(), np.empty((NAVIGATION, 3))
    for i in range(NAVIGATION):
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            QB[i, j] = arm[a] * Q[i, b] - arm[b] * Q[i, a] + Q[i, _DP + j] / T
        for k in range(NAVIGATION):
            t = N[i, k]
            if t != 0.0:
                for j in range(NAVIGATION):
                    product[i, j] += t * Q[k, j]
    noise[:] = 0.0
    for i in range(NAVIGATION):
        for k in range(NAVIGATION):
            t = product[i, k]
            for j in range(NAVIGATION):
                W[i, j] += t * transposed[k, j]
            for j in range(3):
                noise[i, j] += N[i, k] * QB[k, j]
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            noise[NAVIGATION + i, j] = arm[a] * QB[b, j] - arm[b] * QB[a, j] + QB[_DP + i, j] / T


@kernel
def _inverse_transition(N: FloatArray) -> FloatArray:
    """Return the inverse of the φ, δv block of a transition, shape (6, 6), which has the form [[a, 0], [s, e]]."""
    a, e = _inverse(N[PHI, PHI]), _inverse(N[DV, DV])
    back = np.zeros((OBSERVED, OBSERVED))
    back[PHI, PHI], back[DV, DV] = a, e
    for i in range(3):
        for j in range(3):
            t = 0.0
            for k in range(3):
                for m in range(3):
                    t -= e[i, k] * N[_DV + k, m] * a[m, j]
            back[_DV + i, j] = t
    return back


@kernel
def observe(
    c: Compensation,
    s: Setting,
    motion: Increments,
    start: int,
    reference: Reference,
    arm_velocity: FloatArray,
    work: IntervalWork,
    group: VelocityGroup,
) -> None:
    """Integrate the strapdown equations over the observation intervals of a group and write the result to `group`.

    Parameters
    ----------
    c, s : constants of the assumed parameters and of the pass
    motion : increments of all samples
    start : index of the first sample
    reference : trajectory to which the navigation state is reset after every interval; empty for none
    arm_velocity : C(ω_nb × r) at the last observation, m/s, shape (3,); updated in place
    work : navigation state; updated in place
    group : output
    """
    count, has_reference = group.attitude.shape[0], len(reference.attitude) > 0
    steps, forces, arms = np.empty((count, NAVIGATION, STATES)), np.empty((count, 3)), np.empty((count, 3))
    shifts, step, rotation = np.zeros((count + 1, NAVIGATION)), np.zeros(NAVIGATION), np.empty((3, 3))
    group.H[:] = 0.0
    for k in range(count):
        first, before = start + k * s.stride, work.attitude.copy()
        propagate(c, s.earth, s.gravity, s.dt, motion, first, first + s.stride, work)
        forces[k], after = work.force, work.attitude.copy()
        if has_reference:
            attitude, velocity = reference.attitude[k], reference.velocity[k]
            for i in range(3):
                for j in range(3):
                    rotation[i, j] = 0.0
                    for m in range(3):
                        rotation[i, j] += attitude[i, m] * work.attitude[j, m]
            step[PHI] = rotation_vector(rotation)
            for i in range(3):
                step[_DV + i] = velocity[i] - work.velocity[i]
            work.attitude[:], work.velocity[:] = attitude, velocity
        _linearise(c, s, k, before, after, arm_velocity, work, group, steps, arms)
        if has_reference:
            for i in range(NAVIGATION):
                t = -step[i]
                for j in range(NAVIGATION):
                    t += steps[k, i, j] * shifts[k, j]
                shifts[k + 1, i] = t
    _refer_to_end(s, steps, forces, arms, shifts, group)


@kernel
def _linearise(
    c: Compensation,
    s: Setting,
    k: int,
    before: FloatArray,
    after: FloatArray,
    arm_velocity: FloatArray,
    work: IntervalWork,
    group: VelocityGroup,
    steps: FloatArray,
    arms: FloatArray,
) -> None:
    """Write observation `k` of a group and its Jacobian H_k, and the transition over its interval.

    `before` and `after` are C_bn at the start and at the end of the interval. The transition is written to `steps`,
    shape (count, 9, 39), and the lever arm at the end, divided by T, to `arms`, shape (count, 3).

    The effect of φ on velocity is computed with the force implied by attitude and lever arm (gravity and the change of
    the arm's velocity), not with the measured force. The measured force contains the vibration of the base, and a
    regressor as noisy as the observation would appear to determine the azimuth to 1/√(2N) rad.
    """
    T, F, r = s.stride * s.dt, steps[k], c.outer_lever
    z, H = group.z[3 * k : 3 * k + 3], group.H[3 * k : 3 * k + 3]
    u, first, force_moment = arm_motion(work, s.earth, r)[1], np.empty(3), np.empty(3)
    force_sum = u - arm_velocity
    force_sum[2] += s.gravity * T
    for i in range(3):
        first[i] = (before[i, 0] * r[0] + before[i, 1] * r[1] + before[i, 2] * r[2]) / T
        arms[k, i] = (after[i, 0] * r[0] + after[i, 1] * r[1] + after[i, 2] * r[2]) / T
        z[i] = arms[k, i] - first[i] - work.displacement[i] / T
        force_moment[i] = T * (arms[k, i] - first[i] - arm_velocity[i])
    force_moment[2] += 0.5 * s.gravity * T * T
    arm_velocity[:] = u
    write_navigation_block(work.transition, s.earth, force_sum, force_moment, T)
    F[:] = work.transition[:NAVIGATION]
    x, y, w = arms[k]
    for j in range(STATES):  # [arm×] φ + δp/T at the end of the interval
        H[0, j] = y * F[2, j] - w * F[1, j] + F[_DP, j] / T
        H[1, j] = w * F[0, j] - x * F[2, j] + F[_DP + 1, j] / T
        H[2, j] = x * F[1, j] - y * F[0, j] + F[_DP + 2, j] / T
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        H[i, b] -= first[a]
        H[i, a] += first[b]
        H[i, _DP + i] = 0.0  # δp is relative to the start of the interval
        for j in range(3):
            H[i, _LEVER + j] = (before[i, j] - after[i, j]) / T
    group.attitude[k], group.rate[k] = work.attitude, work.rate


@kernel
def _refer_to_end(
    s: Setting, steps: FloatArray, forces: FloatArray, arms: FloatArray, shifts: FloatArray, group: VelocityGroup
) -> None:
    """Express the observations of a group in terms of the state at its end, from the last interval to the first."""
    count = len(steps)
    N, B = np.eye(NAVIGATION), np.zeros((NAVIGATION, COUNT))
    W, Q = np.zeros((NAVIGATION, NAVIGATION)), np.zeros((NAVIGATION, NAVIGATION))
    product, row, end = np.empty(NAVIGATION), np.empty(OBSERVED), shifts[count]
    noise = np.empty((NAVIGATION + 3, 3))
    for k in range(count - 1, -1, -1):
        _add_interval_noise(N, forces[k], arms[k], s, Q, W, noise)
        for i in range(NAVIGATION):
            for j in range(NAVIGATION):
                product[j] = 0.0
            for m in range(NAVIGATION):
                x = N[i, m]
                if x != 0.0:
                    for j in range(NAVIGATION):
                        product[j] += x * steps[k, m, j]
                    for p in range(COUNT):
                        B[i, p] += x * steps[k, m, NAVIGATION + p]
            N[i] = product
        back = _inverse_transition(N)
        G = group.H[3 * k : 3 * k + 3]
        for i in range(3):
            for j in range(OBSERVED):
                row[j] = 0.0
            for m in range(OBSERVED):
                for j in range(OBSERVED):
                    row[j] += G[i, m] * back[m, j]
            t = group.z[3 * k + i]
            for j in range(OBSERVED):
                t += row[j] * end[j] - G[i, j] * shifts[k, j]
            group.z[3 * k + i] = t
            for j in range(OBSERVED):
                G[i, j] = row[j]
                for p in range(COUNT):
                    G[i, NAVIGATION + p] -= row[j] * B[j, p]
        # the noise W from the start of the interval to the end enters this row as −G W, and that of the interval itself
        # as B w; this row shares with a later one only the noise of the later intervals
        for i in range(3):
            index = 3 * k + i
            for m in range(NAVIGATION):
                t = noise[m, i]
                for j in range(OBSERVED):
                    t -= W[m, j] * G[i, j]
                group.M[m, index] = t
        for i in range(3):
            index = 3 * k + i
            for r in range(3 * k, 3 * count):
                t = s.variance if r == index else 0.0
                for j in range(OBSERVED):
                    t -= G[i, j] * group.M[j, r]
                group.R[index, r] = t
        for i in range(3):
            index = 3 * k + i
            for r in range(i, 3):
                t = noise[NAVIGATION + i, r]
                for j in range(OBSERVED):
                    t -= noise[j, i] * G[r, j]
                group.R[index, 3 * k + r] += t
            for r in range(3 * k, 3 * count):
                group.R[r, index] = group.R[index, r]
    group.shift[:] = end
    group.noise[:NAVIGATION, :NAVIGATION] = W
    group.transition[:NAVIGATION, :NAVIGATION] = N
    group.transition[:NAVIGATION, PARAMETER_STATES] = B
    for w in range(group.H.shape[1] - STATES):  # drift has the same effect as the bias
        group.transition[:NAVIGATION, STATES + w] = group.transition[:NAVIGATION, BIAS[w]]
        group.H[:, STATES + w] = group.H[:, BIAS[w]]
