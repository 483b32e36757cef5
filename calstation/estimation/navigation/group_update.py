"""Compiled Kalman algebra of a pass: prediction and update with groups of correlated observations.

Only the navigation states move, and the bias drift decays, so that prediction changes nine rows of the covariance. An
observation whose noise is correlated with the process noise (M) changes it by

    V = H P + Mᵀ,   S = V Hᵀ + H M + R = L Lᵀ,   W = L⁻¹ V,   P⁺ = P − Wᵀ W,   x⁺ = x + Wᵀ L⁻¹ (z − H x)

(Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 8.3),
which stays exactly symmetric. Every sum has a fixed order, so that results do not depend on the number of threads.
"""

from typing import NamedTuple

import numba as nb
import numpy as np

from calstation.estimation.navigation.triangular import cholesky, forward
from calstation.estimation.navigation.velocity_group import NAVIGATION, Setting, VelocityGroup, observe
from calstation.physics import STATES, Compensation, FloatArray, IntervalWork, rotate


class State(NamedTuple):
    """Estimate of a filter with n states: 39, or 45 with bias drift; updated in place."""

    x: FloatArray  #: Shape (n,).
    P: FloatArray  #: Shape (n, n).
    #: The filter mean that would result if every observation agreed with the linearisation point, shape (n,).
    offset: FloatArray
    arm_velocity: FloatArray  #: C (ω_nb × outer_lever) at the last observation, m/s, shape (3,).


class Updates(NamedTuple):
    """g groups of k observations as they were processed, for r = 3 k rows and n states."""

    #: Transition of φ, δv and δp over the group, shape (g, 9, n); empty for the observation at a start, after these
    #: states were reset.
    transition: FloatArray
    decay: FloatArray  #: Decay of the bias drift over a group, shape (n − 39,).
    H: FloatArray  #: Jacobian of the observations, shape (g, r, n).
    root: FloatArray  #: Cholesky factor L of the covariance of the innovations, shape (g, r, r).
    gain: FloatArray  #: W, the transposed gain for the normalised innovations, shape (g, r, n).
    innovation: FloatArray  #: Normalised: L⁻¹ (z − H x), shape (g, r); empty for the observation at a start.
    attitude: FloatArray  #: C_bn at each observation, shape (g k, 3, 3).
    rate: FloatArray  #: ω_ib at each observation, rad/s, shape (g k, 3).


def updates(groups: int, count: int, decay: FloatArray) -> Updates:
    """Allocate the arrays for groups of `count` observations."""
    rows, size = 3 * count, STATES + len(decay)
    return Updates(
        np.empty((groups, NAVIGATION, size)),
        decay,
        np.empty((groups, rows, size)),
        np.empty((groups, rows, rows)),
        np.empty((groups, rows, size)),
        np.empty((groups, rows)),
        np.empty((groups * count, 3, 3)),
        np.empty((groups * count, 3)),
    )


@nb.njit(cache=True)
def process(
    c: Compensation,
    s: Setting,
    gyro: FloatArray,
    accel: FloatArray,
    start: int,
    attitudes: FloatArray,
    velocities: FloatArray,
    work: IntervalWork,
    group: VelocityGroup,
    state: State,
    out: Updates,
) -> None:
    """Process the groups of observations of `out` from sample `start`: strapdown, prediction, update and feedback.

    Parameters
    ----------
    c, s : constants of the assumed parameters and of the pass
    gyro, accel : raw mean rates of all samples, rad/s and m/s², shape (n, 3)
    start : index of the first sample
    attitudes, velocities : reference C_bn and velocity, m/s, at the ends of the intervals, shapes (g k, 3, 3) and
        (g k, 3); empty for closed loop
    work, state : state of navigation and filter; updated in place
    group : the decay and the noise of the bias drift; contains the last group afterwards
    out : output
    """
    count, rows, size = group.attitude.shape[0], group.H.shape[0], len(state.x)
    follow = len(attitudes) > 0
    moved = np.empty((NAVIGATION, size))
    for g in range(len(out.H)):
        part = slice(g * count, (g + 1) * count) if follow else slice(0, 0)
        first = start + g * count * s.stride
        observe(c, s, gyro, accel, first, attitudes[part], velocities[part], state.arm_velocity, work, group)
        predict(group, state, moved)
        if follow:
            for i in range(NAVIGATION):
                state.x[i] += group.shift[i]
        update(group, state, out.root[g], out.gain[g], out.innovation[g])
        for i in range(NAVIGATION):
            for j in range(size):
                out.transition[g, i, j] = group.transition[i, j]
        for r in range(rows):
            for j in range(size):
                out.H[g, r, j] = group.H[r, j]
        for k in range(count):
            for i in range(3):
                out.rate[g * count + k, i] = group.rate[k, i]
                for j in range(3):
                    out.attitude[g * count + k, i, j] = group.attitude[k, i, j]
        if not follow:
            _feed_back(state, work, group, out.root[g], out.gain[g])


@nb.njit(cache=True)
def predict(group: VelocityGroup, state: State, moved: FloatArray) -> None:
    """Predict mean and covariance over a group; `moved` is for intermediate results, shape (9, n)."""
    x, P, F, Q = state.x, state.P, group.transition, group.noise
    size = len(x)
    across, mean = np.zeros((NAVIGATION, NAVIGATION)), np.zeros(NAVIGATION)
    for i in range(NAVIGATION):
        for k in range(size):
            mean[i] += F[i, k] * x[k]
        for j in range(size):
            moved[i, j] = 0.0
        _add_rows(F[i], P, moved[i])
    for i in range(NAVIGATION):
        for j in range(i + 1):
            t = Q[i, j]
            for k in range(size):
                t += moved[i, k] * F[j, k]
            across[i, j] = t
            across[j, i] = t
    for i in range(STATES, size):
        decay = F[i, i]
        x[i] *= decay
        for j in range(NAVIGATION):
            moved[j, i] *= decay
        for j in range(NAVIGATION, size):
            P[i, j] *= decay
            P[j, i] *= decay
        P[i, i] += Q[i, i]
    for i in range(NAVIGATION):
        x[i] = mean[i]
        for j in range(NAVIGATION):
            P[i, j] = across[i, j]
        for j in range(NAVIGATION, size):
            P[i, j] = moved[i, j]
            P[j, i] = moved[i, j]


@nb.njit(cache=True)
def _add_rows(factors: FloatArray, A: FloatArray, out: FloatArray) -> None:
    """Add the rows of A, shape (n, n), times their factors to `out`, three at a time: n is a multiple of 3."""
    for k in range(0, len(factors), 3):
        s, t, u = factors[k], factors[k + 1], factors[k + 2]
        if s != 0.0 or t != 0.0 or u != 0.0:
            for j in range(len(out)):
                out[j] += s * A[k, j] + t * A[k + 1, j] + u * A[k + 2, j]


@nb.njit(cache=True)
def update(group: VelocityGroup, state: State, root: FloatArray, gain: FloatArray, innovation: FloatArray) -> None:
    """Update mean and covariance with a group; write L, W and the normalised innovations."""
    x, P, H, M = state.x, state.P, group.H, group.M
    rows, size = H.shape
    S = np.empty((rows, rows))
    for r in range(rows):
        for j in range(size):
            gain[r, j] = M[j, r]
        residual = group.z[r]
        for k in range(size):
            residual -= H[r, k] * x[k]
        innovation[r] = residual
        _add_rows(H[r], P, gain[r])
    transposed = H.T.copy()
    for r in range(rows):
        for q in range(rows):
            S[r, q] = group.R[r, q]
        for k in range(size):
            v = gain[r, k]
            for q in range(r + 1):
                S[r, q] += v * transposed[k, q]
        for k in range(NAVIGATION):  # M has no other rows
            h = H[r, k]
            for q in range(r + 1):
                S[r, q] += h * M[k, q]
    cholesky(S, root)
    forward(root, gain)
    forward(root, innovation.reshape(rows, 1))
    for r in range(rows):
        t = innovation[r]
        for j in range(size):
            x[j] += t * gain[r, j]
    for i in range(size):
        for r in range(0, rows, 3):
            s, t, u = gain[r, i], gain[r + 1, i], gain[r + 2, i]
            for j in range(i + 1):
                P[i, j] -= s * gain[r, j] + t * gain[r + 1, j] + u * gain[r + 2, j]
        for j in range(i):
            P[j, i] = P[i, j]


@nb.njit(cache=True)
def _feed_back(state: State, work: IntervalWork, group: VelocityGroup, root: FloatArray, gain: FloatArray) -> None:
    """Close the loop on the observations, not on the mean of the prior.

    x = offset + correction: the offset remains in x and decays with each observation. Only the correction is applied to
    the reference, which therefore stays near the levelled start from the first sample on.
    """
    x, offset = state.x, state.offset
    moved = np.zeros(NAVIGATION)
    size, rows = len(x), len(root)
    for i in range(NAVIGATION):
        for j in range(size):
            moved[i] += group.transition[i, j] * offset[j]
    for i in range(NAVIGATION):
        offset[i] = moved[i]
    for i in range(STATES, size):
        offset[i] *= group.transition[i, i]
    white = np.zeros((rows, 1))
    for r in range(rows):
        for j in range(size):
            white[r, 0] += group.H[r, j] * offset[j]
    forward(root, white)
    for r in range(rows):
        for j in range(size):
            offset[j] -= white[r, 0] * gain[r, j]
    for i in range(3):
        work.velocity[i] += x[3 + i] - offset[3 + i]
    rotate(x - offset, work.attitude)
    for i in range(6):
        x[i] = offset[i]
