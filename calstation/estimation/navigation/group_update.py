"""Compiled Kalman filter of a pass along a reference: prediction and update with groups of correlated observations.

Only the navigation states change, and the bias drift decays, so the prediction changes nine rows of the covariance. An
observation whose noise is correlated with the process noise (M) updates it by

    V = H P + Mᵀ,   S = V Hᵀ + H M + R = L Lᵀ,   W = L⁻¹ V,   P⁺ = P − Wᵀ W,   x⁺ = x + Wᵀ L⁻¹ (z − H x)

(Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 8.3),
which stays exactly symmetric. Every sum has a fixed order, so that results do not depend on the number of threads.
"""

from typing import NamedTuple

import numpy as np

from calstation.estimation.navigation.small_matrices import add_product, cholesky, forward
from calstation.estimation.navigation.velocity_group import NAVIGATION, Reference, Setting, VelocityGroup, observe
from calstation.physics import STATES, Compensation, FloatArray, Increments, IntervalWork, kernel


class State(NamedTuple):
    """Mean and covariance of a filter with n states, 39, or 45 with bias drift; updated in place."""

    x: FloatArray  #: Shape (n,).
    P: FloatArray  #: Shape (n, n).


class Updates(NamedTuple):
    """Results of processing g groups of k observations, for r = 3 k rows and n states."""

    #: Transition of φ, δv and δp over the group, shape (g, 9, n); empty for the observation at a start, before which
    #: these states are reset.
    transition: FloatArray
    #: Decay of the bias drift over a group, or since the last group before a start, shape (n − 39,).
    decay: FloatArray
    H: FloatArray  #: Jacobian of the observations, shape (g, r, n).
    root: FloatArray  #: Cholesky factor L of the covariance of the innovations, shape (g, r, r).
    gain: FloatArray  #: W, the transposed gain of the normalised innovations, shape (g, r, n).
    innovation: FloatArray  #: Normalised innovation L⁻¹ (z − H x), shape (g, r); empty for the observation at a start.
    attitude: FloatArray  #: C_bn at each observation, shape (g k, 3, 3).
    rate: FloatArray  #: ω_ib at each observation, rad/s, shape (g k, 3).


def updates(groups: int, count: int, decay: FloatArray) -> Updates:
    """Allocate the arrays for the updates by groups of observations.

    Parameters
    ----------
    groups, count : number of groups, and of observations in each
    decay : decay of the bias drift over a group, shape (n − 39,) for n states
    """
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


@kernel
def process(
    c: Compensation,
    s: Setting,
    motion: Increments,
    start: int,
    reference: Reference,
    arm_velocity: FloatArray,
    work: IntervalWork,
    group: VelocityGroup,
    state: State,
    out: Updates,
) -> None:
    """Process groups of observations along a reference: strapdown integration, prediction and update.

    Parameters
    ----------
    c, s : constants of the assumed parameters and of the pass
    motion : increments of all samples
    start : index of the first sample
    reference : trajectory at the ends of the g k intervals
    arm_velocity : C (ω_nb × outer_lever) at the last observation, m/s, shape (3,); updated in place
    work, state : states of the navigation and of the filter; updated in place
    group : decay and noise of the bias drift on input, the last group on output
    out : output; its length is the number of groups
    """
    count, FP = group.attitude.shape[0], np.empty((NAVIGATION, len(state.x)))
    for g in range(len(out.H)):
        rows = slice(g * count, (g + 1) * count)
        first = start + g * count * s.stride
        group_reference = Reference(reference.attitude[rows], reference.velocity[rows])
        observe(c, s, motion, first, group_reference, arm_velocity, work, group)
        predict(group, state, FP)
        for i in range(NAVIGATION):
            state.x[i] += group.shift[i]
        update(group, state, out.root[g], out.gain[g], out.innovation[g])
        out.transition[g], out.H[g] = group.transition[:NAVIGATION], group.H
        out.rate[rows], out.attitude[rows] = group.rate, group.attitude


@kernel
def predict(group: VelocityGroup, state: State, FP: FloatArray) -> None:
    """Predict the mean and covariance over a group.

    Parameters
    ----------
    group, state : transition and noise of the group; mean and covariance of the n states, updated in place
    FP : F P, shape (9, n), output
    """
    x, P, F, Q = state.x, state.P, group.transition, group.noise
    size = len(x)
    covariance, mean = np.zeros((NAVIGATION, NAVIGATION)), np.zeros(NAVIGATION)
    for i in range(NAVIGATION):
        for k in range(size):
            mean[i] += F[i, k] * x[k]
        for j in range(size):
            FP[i, j] = 0.0
    add_product(F[:NAVIGATION], P, FP)
    for i in range(NAVIGATION):
        for j in range(i + 1):
            t = Q[i, j]
            for k in range(size):
                t += FP[i, k] * F[j, k]
            covariance[i, j] = t
            covariance[j, i] = t
    for i in range(STATES, size):
        decay = F[i, i]
        x[i] *= decay
        for j in range(NAVIGATION):
            FP[j, i] *= decay
        for j in range(NAVIGATION, size):
            P[i, j] *= decay
            P[j, i] *= decay
        P[i, i] += Q[i, i]
    x[:NAVIGATION], P[:NAVIGATION, :NAVIGATION] = mean, covariance
    P[:NAVIGATION, NAVIGATION:] = FP[:, NAVIGATION:]
    P[NAVIGATION:, :NAVIGATION] = FP[:, NAVIGATION:].T


@kernel
def _products(gain: FloatArray, H: FloatArray, M: FloatArray, S: FloatArray) -> None:
    """Add V Hᵀ + H M to the lower triangle of S, for V in `gain`, in blocks of three rows and columns."""
    for r in range(0, len(S), 3):
        for q in range(0, r + 3, 3):
            a, b, c = S[r, q], S[r, q + 1], S[r, q + 2]
            d, e, f = S[r + 1, q], S[r + 1, q + 1], S[r + 1, q + 2]
            g, h, i = S[r + 2, q], S[r + 2, q + 1], S[r + 2, q + 2]
            for k in range(gain.shape[1]):
                x, y, z = gain[r, k], gain[r + 1, k], gain[r + 2, k]
                u, v, w = H[q, k], H[q + 1, k], H[q + 2, k]
                a, b, c = a + x * u, b + x * v, c + x * w
                d, e, f = d + y * u, e + y * v, f + y * w
                g, h, i = g + z * u, h + z * v, i + z * w
            for k in range(NAVIGATION):  # M has no other rows
                x, y, z = H[r, k], H[r + 1, k], H[r + 2, k]
                u, v, w = M[k, q], M[k, q + 1], M[k, q + 2]
                a, b, c = a + x * u, b + x * v, c + x * w
                d, e, f = d + y * u, e + y * v, f + y * w
                g, h, i = g + z * u, h + z * v, i + z * w
            S[r, q], S[r, q + 1], S[r, q + 2] = a, b, c
            S[r + 1, q], S[r + 1, q + 1], S[r + 1, q + 2] = d, e, f
            S[r + 2, q], S[r + 2, q + 1], S[r + 2, q + 2] = g, h, i


@kernel
def _subtract_square(gain: FloatArray, P: FloatArray) -> None:
    """Subtract WᵀW from P, for W in `gain`, in blocks of three rows and columns."""
    for i in range(0, len(P), 3):
        u, v, w = P[i], P[i + 1], P[i + 2]
        for r in range(0, len(gain), 3):
            x, y, z = gain[r], gain[r + 1], gain[r + 2]
            a, b, c = x[i], y[i], z[i]
            d, e, f = x[i + 1], y[i + 1], z[i + 1]
            g, h, k = x[i + 2], y[i + 2], z[i + 2]
            for j in range(i + 3):
                p, q, s = x[j], y[j], z[j]
                u[j] -= a * p + b * q + c * s
                v[j] -= d * p + e * q + f * s
                w[j] -= g * p + h * q + k * s
        for j in range(i + 3):
            P[j, i], P[j, i + 1], P[j, i + 2] = u[j], v[j], w[j]


@kernel
def update(group: VelocityGroup, state: State, root: FloatArray, gain: FloatArray, innovation: FloatArray) -> None:
    """Update the mean and covariance with a group.

    Parameters
    ----------
    group, state : m observed components; mean and covariance of the n states, updated in place
    root, gain, innovation : L, shape (m, m), W, (m, n), and the normalised innovations, (m,); output
    """
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
        for q in range(rows):
            S[r, q] = group.R[r, q]
    add_product(H, P, gain)
    _products(gain, H, M, S)
    cholesky(S, root)
    forward(root, gain)
    forward(root, innovation.reshape(rows, 1))
    for r in range(rows):
        t = innovation[r]
        for j in range(size):
            x[j] += t * gain[r, j]
    _subtract_square(gain, P)
