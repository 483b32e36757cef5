"""Stages of motion: one least-squares problem of the trajectory and the parameters, solved for all samples at once.

The unknowns are attitude and velocity errors and drifts of the biases at the ends of intervals of 0.1 s, and the
parameters. Every interval gives nine equations: attitude and velocity at its end follow from those at its start and
from the samples between (integrated in the body frame), and the mean velocity of the table's centre is zero except for
its vibration. The errors of the samples correlate the nine equations. The trajectory is eliminated by a banded Cholesky
factorisation, and the parameters follow from what remains of the equations. No filter is run.

Derivatives use the specific force that gravity and the rotation imply, and not the measured one, whose noise would
appear as information about the heading.
"""

from functools import partial

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.spatial.transform import Rotation

from .estimate import COLUMNS
from .model import AT, BIASES, COUNT, UP, compensated, rotation, sensed, skew, turned
from .samples import DRIFT_TIME, MARGIN, SHORTEST, NotCoveredError, mean_angles, rests

#: Number of states of the trajectory: errors of attitude and velocity, drifts of the biases.
STATES = 12
LONGEST_ALIGNMENT = 20.0


class Segment:
    """The samples from the first rest of a span on, the prior attitude at its start, and the trajectory so far."""

    def __init__(self, stage, setting, span, rest):
        s, self.setting, self.stride = setting, setting, max(round(setting.interval / setting.dt), 1)
        begin, self.T, self.count = rest[0], self.stride * s.dt, (span[1] - rest[0]) // self.stride
        at = begin + self.stride * np.arange(self.count + 1)
        self.time = stage.seq[[begin, at[-1] - 1]] * s.dt
        # the samples of every interval with the one before, and the mean output of the samples before and after its end
        inside = np.clip(at[:-1, None] + np.arange(-1, self.stride), 0, None)
        self.gyro, self.accel = stage.gyro[inside], stage.accel[inside]
        self.ends = 0.5 * (stage.gyro[np.maximum(at - 1, 0)] + stage.gyro[np.minimum(at, span[1] - 1)])
        heading = np.linalg.norm([s.sigma[key] for key in ("azimuth", "mount", "encoder")])
        self.prior_sigma = np.r_[s.sigma["tilt"], s.sigma["tilt"], heading, [np.sqrt(100.0 * s.velocity)] * 3]
        first = mean_angles(stage, (begin, min(rest[1], begin + int(LONGEST_ALIGNMENT / s.dt))))
        self.prior = (s.platform(first[None]) @ s.orientation)[0]
        polled = begin + np.flatnonzero(np.isfinite(stage.angles[begin : span[1]]).all(axis=1))
        angles = np.stack([np.interp(at, polled + 1, stage.angles[polled, j]) for j in (0, 1)], axis=1)
        self.attitude = s.platform(angles) @ s.orientation
        self.velocity, self.drift = np.zeros((self.count + 1, 3)), np.zeros((self.count + 1, 6))

    def _derivatives(self, p):
        """Return the changes of attitude, velocity and displacement over intervals in n per parameter, (n, 3, 30) each.

        They are central differences over a few groups of samples with the force that gravity and the rotation imply.
        The accelerometers' parameters act on the force at the reference point, as in calstation.
        """
        groups = next(k for k in (5, 4, 3, 2, 1) if self.stride % k == 0)
        gyro, dt, C = (
            self.gyro[:, 1:].reshape(self.count, groups, -1, 3).mean(axis=2),
            self.T / groups,
            self.attitude[:-1],
        )
        omega = compensated(p, gyro, gyro)[0]
        up = (
            self.setting.gravity * (C[:, None, 2:] @ rotation((np.cumsum(omega, axis=1) - 0.5 * omega) * dt))[..., 0, :]
        )
        accel = sensed(p, omega, up + np.cross(omega, np.cross(omega, p[AT["outer_lever"]])))[1]
        gyro, accel = (np.concatenate([x[:, :1], x], axis=1) for x in (gyro, accel))
        J, step = np.zeros((3, self.count, 3, COUNT)), 1e-6
        for i in range(AT["outer_lever"][0]):
            high, low = (_integrate(p + h * np.eye(COUNT)[i], gyro, accel, dt) for h in (step, -step))
            J[0, :, :, i] = _vector(high[0] @ low[0].transpose(0, 2, 1)) / (2.0 * step)
            J[1:, :, :, i] = np.subtract(high[1:], low[1:]) / (2.0 * step)
        return C @ J

    def equations(self, p):
        """Return the whitened equations about the present trajectory and the parameters, without offsets of the axes.

        Coefficients of the states at the start and at the end of every interval, and the columns of `Joint.updated`,
        shape (n, 9, 2 STATES + COLUMNS). With rotation R, velocity v and displacement x over T s, earth rate Ω:

            C₁ = exp(−ΩT) C₀ R,   v₁ = v₀ + C₀v − ½T Ω×C₀v − gT − 2Ω×(C₁r − C₀r),   r: lever arm
            0 = (C₁r − C₀r + change of the offsets − ∫v dt) / T,   ∫v dt = T v₀ + C₀x − T/3 Ω×C₀x − ½gT² − T²Ω×v₀
        """
        s, T, earth = self.setting, self.T, self.setting.earth
        R, v, x = _integrate(p, self.gyro, self.accel, s.dt)
        J_phi, J_v, J_x = self._derivatives(p)
        rate, _ = compensated(p, self.ends, self.ends)
        C, r, b, v0 = self.attitude, p[AT["outer_lever"]], self.drift[:-1, :, None], self.velocity[:-1]
        arm, u = C @ r, turned(C, np.cross(rate - earth @ C, r))
        way, push, shift, spin = np.diff(arm, axis=0), turned(C[:-1], v), turned(C[:-1], x), skew(earth) * T
        attitude = rotation((J_phi[:, :, BIASES] @ b)[..., 0]) @ rotation(-earth * T) @ C[:-1] @ R
        velocity = v0 + push - 0.5 * push @ spin.T - s.gravity * T * UP - 2.0 * np.cross(earth, way)
        shift = T * v0 + shift - shift @ spin.T / 3.0 - 0.5 * s.gravity * T**2 * UP - T * v0 @ spin.T
        # the impulse and the moment of the implied force
        lean = skew(s.gravity * T * UP + np.diff(u, axis=0))
        moment = 0.5 * s.gravity * T**2 * UP + way - T * u[:-1]
        E = np.zeros((self.count, 9, 2 * STATES + COLUMNS))
        before, after, columns, wrong = np.split(E, [STATES, 2 * STATES, -1], axis=2)
        before[:, 0:3, 0:3] = spin - np.eye(3)
        before[:, 3:6, 0:3], before[:, 3:6, 3:6] = lean, 2.0 * spin - np.eye(3)
        before[:, 6:9, 0:3], before[:, 6:9, 3:6] = (skew(arm[:-1]) + skew(moment)) / T, -np.eye(3)
        after[:, 0:3, 0:3] = after[:, 3:6, 3:6] = np.eye(3)
        after[:, 6:9, 0:3] = -skew(arm[1:]) / T
        columns[:, :, :COUNT] = np.concatenate([-J_phi, -J_v, -J_x / T], axis=1)
        before[:, :, 6:12] = columns[:, :, BIASES]
        columns[:, 6:9, AT["outer_lever"]] += np.diff(C, axis=0) / T
        columns[:, 6:9, COUNT : COUNT + 2] = np.diff(self._directions(), axis=0) / T
        columns[:, 3:6, -1], columns[:, 6:9, -1] = s.gravity * T * UP, 0.5 * s.gravity * T * UP
        wrong[:, 0:3, 0] = -_vector(attitude @ C[1:].transpose(0, 2, 1))
        wrong[:, 3:6, 0] = self.velocity[1:] - velocity - (J_v[:, :, BIASES] @ b)[..., 0]
        wrong[:, 6:9, 0] = (way - shift - (J_x[:, :, BIASES] @ b)[..., 0]) / T
        return np.linalg.solve(np.linalg.cholesky(self._noise(lean / T)), E)

    def _noise(self, F):
        """Return the covariance of the nine equations for white noise of rate and force, by Gauss's quadrature."""
        s, T, one = self.setting, self.T, np.broadcast_to(np.eye(3), F.shape)
        N = np.zeros((len(F), 9, 9))
        N[:, 6:9, 6:9] = s.velocity * one
        for x, weight in zip(*np.polynomial.legendre.leggauss(3), strict=True):
            t = 0.5 * T * (1.0 + x)  # before the end of the interval
            by_rate = np.concatenate([one, -F * t, -F * t**2 / (2.0 * T)], axis=1)
            by_force = np.concatenate([0.0 * one, one, one * t / T], axis=1)
            for density, effect in ((s.rate_noise, by_rate), (s.force_noise, by_force)):
                N += 0.5 * T * weight * density * effect @ effect.transpose(0, 2, 1)
        return N

    def _directions(self):
        """Return the directions in n of the offsets of the axes (outer × inner, inner) at the ends of the intervals."""
        s = self.setting
        inner = self.attitude @ (s.orientation.T @ s.axes[1])
        hinge = np.cross(rotation(-s.azimuth * UP) @ s.axes[0], inner)
        return np.stack([hinge / np.linalg.norm(hinge, axis=1, keepdims=True), inner], axis=2)

    def start(self):
        """Return the equations of the prior attitude and velocity at the start, in the form of `equations`."""
        E = np.zeros((1, 9, 2 * STATES + COLUMNS))
        E[0, :6, STATES : STATES + 6] = np.diag(1.0 / self.prior_sigma)
        E[0, :6, -1] = np.r_[-_vector(self.prior @ self.attitude[0].T), self.velocity[0]] / self.prior_sigma
        return E

    def correct(self, states):
        """Add the corrections of the states at the ends of the intervals, shape (n + 1, 12)."""
        self.attitude = rotation(states[:, :3]) @ self.attitude
        self.velocity, self.drift = self.velocity + states[:, 3:6], self.drift + states[:, 6:]


def _integrate(p, gyro, accel, dt):
    """Return rotation, velocity and displacement over intervals in b; the first of the samples (n, k, 3) precedes them.

    The rotation vector of a sample is ω dt + coning, its velocity f dt + ½ ω×f dt² + ω×(ω×f) dt³/6 + sculling.
    """
    omega, force = (x * dt for x in compensated(p, gyro, accel))
    last, w, before, f = omega[:, :-1], omega[:, 1:], force[:, :-1], force[:, 1:]
    product = np.cross(w, f)
    turns = rotation(w + np.cross(last, w) / 12.0)
    change = f + 0.5 * product + np.cross(w, product) / 6.0 + (np.cross(last, f) + np.cross(before, w)) / 12.0
    shift = (0.5 * f + 0.25 * product) * dt  # exact if the force is constant in n; in b, a sixth instead of a quarter
    R, v, x = np.broadcast_to(np.eye(3), (len(w), 3, 3)), np.zeros((len(w), 3)), np.zeros((len(w), 3))
    for j in range(w.shape[1]):
        x = x + v * dt + turned(R, shift[:, j])
        v = v + turned(R, change[:, j])
        R = R @ turns[:, j]
    return R, v, x


def _vector(R):
    return Rotation.from_matrix(R).as_rotvec()


def _with_drift(s, E, seconds, before, after):
    """Return equations with those of the drifts after `seconds`, b₁ = exp(−t/τ) b₀ + noise (Gauss-Markov process)."""
    keep, known = np.exp(-seconds / DRIFT_TIME), s.drift > 0.0
    scale = np.where(known, 1.0 / np.where(known, s.drift * np.sqrt(1.0 - keep**2), 1.0), 1e12)  # b = 0 if unknown
    drift = np.zeros((len(E), 6, E.shape[2]))
    drift[:, :, 6:12], drift[:, :, 18:24] = -keep * np.diag(scale), np.diag(scale)
    drift[:, :, -1] = (after - keep * before) * scale
    return np.concatenate([E, drift], axis=1)


def _eliminate(segments, p):
    """Eliminate the trajectory of all segments by normal equations; see `estimate.solve`.

    Attitude and velocity begin anew with every segment, the drifts of the biases continue.
    """
    s, parts, end, last, m = segments[0].setting, [], -np.inf, 0.0, STATES
    for segment in segments:
        drift, (first_time, last_time) = segment.drift, segment.time
        parts.append(_with_drift(s, segment.start(), first_time - end, last, drift[:1]))
        parts.append(_with_drift(s, segment.equations(p), segment.T, drift[:-1], drift[1:]))
        end, last = last_time, drift[-1:]
    # units in which the states are of order one; every state follows from the one before, the first from nothing
    unit = np.r_[[1e-6] * 3, [1e-3] * 3, np.where(s.drift > 0, s.drift, 1e-9)]
    before, after, right = np.split(np.concatenate(parts), [m, 2 * m], axis=2)
    before, after, n = before[1:] * unit, after * unit, len(after)
    blocks, load = after.transpose(0, 2, 1) @ after, after.transpose(0, 2, 1) @ right
    blocks[:-1] += before.transpose(0, 2, 1) @ before
    load[:-1] += before.transpose(0, 2, 1) @ right[1:]
    below, band = after[1:].transpose(0, 2, 1) @ before, np.zeros((2 * m, n * m))
    for i, j in np.ndindex(m, m):
        if i >= j:
            band[i - j, j::m] = blocks[:, i, j]
        band[m + i - j, j : (n - 1) * m : m] = below[:, i, j]
    Y = cho_solve_banded((cholesky_banded(band, lower=True), True), load.reshape(n * m, -1)).reshape(load.shape)
    rest = right - after @ Y
    rest[1:] -= before @ Y[:-1]

    def correct(change):
        states = -(Y[:, :, :COUNT] @ change + Y[:, :, -1]) * unit
        ends = np.cumsum([segment.count + 1 for segment in segments])
        for segment, part in zip(segments, np.split(states, ends[:-1]), strict=True):
            segment.correct(part)

    return rest.reshape(-1, COLUMNS), correct


def motion_equations(stage, setting, prior):
    """Return the equations of a stage whose segments begin with a rest; see `estimate.solve`."""
    segments = []
    for first, last in stage.spans:
        span = (first + (first > 0), last - (last < len(stage.seq)))
        long = (r for r in rests(stage, setting, prior, [span]) if (r[1] - r[0]) * setting.dt >= SHORTEST)
        segments += [Segment(stage, setting, span, rest) for rest in long][:1]
    if not segments:
        raise NotCoveredError(f"the stage {stage.name} without a rest of {SHORTEST + MARGIN} s")
    return partial(_eliminate, segments)
