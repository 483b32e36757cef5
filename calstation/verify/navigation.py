"""Stages of motion: one least-squares problem of the trajectory and the parameters, solved for all samples at once.

The unknowns are attitude and velocity errors (and drifts of the biases) at the ends of intervals of 0.1 s, and the
parameters. Every interval gives nine equations: attitude and velocity at its end follow from those at its start and
from the samples between (integrated in the body frame), and the mean velocity of the table's centre is zero except for
its vibration. The errors of the samples correlate the nine equations. The trajectory is eliminated by a banded Cholesky
factorisation, and the parameters follow from what remains of the equations. No filter is run.

Derivatives use the specific force that gravity and the rotation imply, and not the measured one, whose noise would
appear as information about the heading.
"""

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.spatial.transform import Rotation

from .estimate import SIZE
from .model import AT, COUNT, UP, derivatives, earth_rate, force_of, rate_of, rotation, skew
from .samples import DRIFT_TIME, MARGIN, SHORTEST, NotCoveredError, mean_angles, rests

#: Number of columns: the parameters, the offsets of the table's axes, the relative error of gravity, the misclosure.
COLUMNS = SIZE + 2
_PASSES, _CONVERGED = 25, 1e-3
_LONGEST_ALIGNMENT = 20.0


class Segment:
    """The samples from the first rest of a span on, the prior attitude at its start, and the trajectory so far."""

    def __init__(self, stage, setting, span, rest):
        self.setting, self.stride = setting, max(round(setting.interval / setting.dt), 1)
        self.T = self.stride * setting.dt
        self.begin = rest[0]
        self.count = (span[1] - self.begin) // self.stride
        self.stop = self.begin + self.count * self.stride
        self.gyro, self.accel, self.last = stage.gyro, stage.accel, span[1]
        self.first_time, self.last_time = (float(stage.seq[k]) * setting.dt for k in (self.begin, self.stop - 1))
        sigma, end = setting.sigma, min(rest[1], rest[0] + int(_LONGEST_ALIGNMENT / setting.dt))
        heading = np.sqrt(sigma["azimuth"] ** 2 + sigma["mount"] ** 2 + sigma["encoder"] ** 2)
        self.prior_sigma = np.r_[sigma["tilt"], sigma["tilt"], heading, [np.sqrt(100.0 * setting.velocity)] * 3]
        self.prior = (setting.platform(mean_angles(stage, (self.begin, end))[None]) @ setting.orientation)[0]
        at = np.arange(self.begin, self.stop + 1, self.stride)
        polled = self.begin + np.flatnonzero(np.isfinite(stage.angles[self.begin : span[1]]).all(axis=1))
        angles = np.stack([np.interp(at, polled + 1, stage.angles[polled, j]) for j in (0, 1)], axis=1)
        self.attitude = setting.platform(angles) @ setting.orientation
        self.velocity = np.zeros((self.count + 1, 3))
        self.drift = np.zeros((self.count + 1, 6))

    def _integrate(self, p):
        """Return rotation, velocity and displacement over intervals in b, their derivatives in n, and the rates."""
        dt, n = self.setting.dt, self.count
        raw = slice(max(self.begin - 1, 0), self.stop)
        omega = rate_of(p, self.gyro[raw])
        force = force_of(p, self.accel[raw], omega)
        if self.begin == 0:
            omega, force = np.vstack([omega[:1], omega]), np.vstack([force[:1], force])
        turn, push = omega * dt, force * dt
        before, now = (turn[:-1], push[:-1]), (turn[1:], push[1:])
        angle = now[0] + np.cross(before[0], now[0]) / 12.0
        change = now[1] + 0.5 * np.cross(now[0], now[1]) + np.cross(now[0], np.cross(now[0], now[1])) / 6.0
        change += (np.cross(before[0], now[1]) + np.cross(before[1], now[0])) / 12.0
        angle, change = (x.reshape(n, self.stride, 3) for x in (angle, change))
        # exact if the force is constant in n: a force constant in b would need a sixth instead of a quarter
        shift = (0.5 * now[1] + np.cross(now[0], now[1]) / 4.0).reshape(n, self.stride, 3) * dt
        R, v, x = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3)), np.zeros((n, 3))
        J_phi, J_v, J_x = (np.zeros((n, 3, COUNT)) for _ in range(3))
        spin, up = omega[1:].reshape(n, self.stride, 3), self.attitude[:-1, 2]
        for j in range(self.stride):
            middle = R @ rotation(0.5 * angle[:, j])
            central = np.cross(spin[:, j], np.cross(spin[:, j], p[AT["outer_lever"]]))
            lift = self.setting.gravity * up + _turned(middle, central)
            implied = _turned(middle.transpose(0, 2, 1), lift)
            by_rate, by_force = derivatives(p, spin[:, j], implied)
            turned = dt * middle @ by_rate
            pushed = middle @ by_force - skew(lift) @ (J_phi + 0.5 * turned)
            J_x += dt * (J_v + 0.5 * dt * pushed)
            J_v += dt * pushed
            J_phi += turned
            x = x + v * dt + _turned(R, shift[:, j])
            v = v + _turned(R, change[:, j])
            R = R @ rotation(angle[:, j])
        edge = omega[self.stride :: self.stride][:n]  # last sample of every interval
        following = np.vstack([omega[self.stride + 1 :: self.stride][: n - 1], edge[-1:]])
        if self.stop < self.last:
            following[-1] = rate_of(p, self.gyro[self.stop : self.stop + 1])
        ends = 0.5 * (edge + following)
        first = 0.5 * (omega[:1] + omega[1:2])
        C = self.attitude[:-1]
        return R, v, x, (C @ J_phi, C @ J_v, C @ J_x), np.vstack([first, ends])

    def equations(self, p, offset):
        """Return the whitened equations about the present trajectory, the parameters and the offsets of the axes.

        Coefficients of the states at the start and at the end of every interval, of the columns, and the misclosures,
        shape (n, 9, 2 m + 34); m is 6, or 12 with drifts.
        """
        s, T, n, m = self.setting, self.T, self.count, states_of(self.setting)
        earth = earth_rate(s.latitude)
        R, v, x, (J_phi, J_v, J_x), rate = self._integrate(p)
        C0, C1, r = self.attitude[:-1], self.attitude[1:], p[AT["outer_lever"]]
        arm = self.attitude @ r
        u = _turned(self.attitude, np.cross(rate - earth @ self.attitude, r))
        push, way = _turned(C0, v), _turned(C0, x)
        impulse = s.gravity * T * UP + np.diff(u, axis=0)
        moment = 0.5 * s.gravity * T**2 * UP + np.diff(arm, axis=0) - T * u[:-1]
        # the trajectory predicted over every interval, with the drifts of the biases to first order
        lean, bias, b = skew(impulse), np.r_[AT["gyro_bias"], AT["accel_bias"]], self.drift[:-1, :, None]
        attitude = rotation((J_phi[:, :, bias] @ b)[..., 0]) @ rotation(-earth * T) @ C0 @ R
        coriolis = np.cross(earth, np.diff(arm, axis=0))
        velocity = self.velocity[:-1] + push - 0.5 * T * np.cross(earth, push) - s.gravity * T * UP - 2.0 * coriolis
        velocity = velocity + (J_v[:, :, bias] @ b)[..., 0]
        shift = T * self.velocity[:-1] + way - T / 3.0 * np.cross(earth, way) - 0.5 * s.gravity * T**2 * UP
        shift = shift - T * np.cross(earth, T * self.velocity[:-1]) + (J_x[:, :, bias] @ b)[..., 0]
        centre = np.diff(self._directions(), axis=0)
        E = np.zeros((n, 9, 2 * m + COLUMNS))
        before, after, columns, wrong = E[:, :, :m], E[:, :, m : 2 * m], E[:, :, 2 * m : -1], E[:, :, -1]
        spin = skew(earth) * T
        before[:, 0:3, 0:3] = -(np.eye(3) - spin)
        before[:, 3:6, 0:3], before[:, 3:6, 3:6] = lean, -(np.eye(3) - 2.0 * spin)
        before[:, 6:9, 0:3] = (skew(arm[:-1]) + skew(moment)) / T
        before[:, 6:9, 3:6] = -np.eye(3)
        after[:, 0:3, 0:3] = after[:, 3:6, 3:6] = np.eye(3)
        after[:, 6:9, 0:3] = -skew(arm[1:]) / T
        columns[:, :, :COUNT] = np.concatenate([-J_phi, -J_v, -J_x / T], axis=1)
        columns[:, 6:9, AT["outer_lever"]] += (C1 - C0) / T
        columns[:, 6:9, COUNT:SIZE] = centre / T
        columns[:, 3:6, SIZE], columns[:, 6:9, SIZE] = s.gravity * T * UP, 0.5 * s.gravity * T * UP
        if m == 12:
            before[:, :, 6:12] = columns[:, :, bias]
        wrong[:, 0:3] = -_vector(attitude @ C1.transpose(0, 2, 1))
        wrong[:, 3:6] = self.velocity[1:] - velocity
        wrong[:, 6:9] = (np.diff(arm, axis=0) + centre @ offset - shift) / T
        return np.linalg.solve(np.linalg.cholesky(self._noise(lean / T)), E)

    def _noise(self, F):
        """Return the covariance of the nine equations of every interval for white noise of rate and force."""
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
        """Return the directions in n of the offsets of the axes, at the ends of the intervals."""
        s = self.setting
        inner = self.attitude @ (s.orientation.T @ s.axes[1])
        hinge = np.cross(rotation(-s.azimuth * UP) @ s.axes[0], inner)
        return np.stack([hinge / np.linalg.norm(hinge, axis=1, keepdims=True), inner], axis=2)

    def start(self, m):
        """Return the equations of attitude and velocity at the start, shape (1, 9, 2 m + 34)."""
        E = np.zeros((1, 9, 2 * m + COLUMNS))
        E[0, :6, m : m + 6] = np.diag(1.0 / self.prior_sigma)
        E[0, :6, -1] = np.r_[-_vector(self.prior @ self.attitude[0].T), self.velocity[0]] / self.prior_sigma
        return E

    def correct(self, states):
        """Add the corrections of the states at the ends of the intervals, shape (n + 1, m)."""
        self.attitude = rotation(states[:, :3]) @ self.attitude
        self.velocity = self.velocity + states[:, 3:6]
        if states.shape[1] == 12:
            self.drift = self.drift + states[:, 6:]


def states_of(setting):
    """Return the number of states of the trajectory: attitude, velocity, and drifts of the biases, if there are any."""
    return 12 if setting.drift.any() else 6


def _vector(R):
    return Rotation.from_matrix(R).as_rotvec()


def _turned(R, v):
    return (R @ v[:, :, None])[:, :, 0]


def _with_drift(setting, E, seconds, before, after):
    """Return equations with those of the drifts `before` and `after` intervals: a first-order Gauss-Markov process."""
    if states_of(setting) == 6:
        return E
    keep, known = np.exp(-seconds / DRIFT_TIME), setting.drift > 0.0
    scale = np.where(known, 1.0 / np.where(known, setting.drift * np.sqrt(1.0 - keep**2), 1.0), 1e12)
    more = np.zeros((len(E), 6, E.shape[2]))
    more[:, :, 6:12], more[:, :, 18:24], more[:, :, -1] = (
        -keep * np.diag(scale),
        np.diag(scale),
        (after - keep * before) * scale,
    )
    return np.concatenate([E, more], axis=1)


def reduce(segments, p, offset):
    """Eliminate the trajectory of all segments; return the remaining equations and their misclosures, and a step.

    Shapes (k, 33) and (k,); `step` corrects the trajectory for a change of the columns. Attitude and velocity begin
    anew with every segment, the drifts of the biases continue.
    """
    s, parts, end, last = segments[0].setting, [], -np.inf, 0.0
    m = states_of(s)
    for segment in segments:
        drift = segment.drift
        parts.append(_with_drift(s, segment.start(m), segment.first_time - end, last, drift[:1]))
        parts.append(_with_drift(s, segment.equations(p, offset), segment.T, drift[:-1], drift[1:]))
        end, last = segment.last_time, drift[-1:]
    # units in which the states are of order one; every state follows from the one before, the first from nothing
    unit = np.r_[[1e-6] * 3, [1e-3] * 3, np.where(s.drift > 0, s.drift, 1e-9)][:m]
    before, after, right = np.split(np.concatenate(parts), [m, 2 * m], axis=2)
    before, after = before[1:] * unit, after * unit
    blocks, load = after.transpose(0, 2, 1) @ after, after.transpose(0, 2, 1) @ right
    blocks[:-1] += before.transpose(0, 2, 1) @ before
    load[:-1] += before.transpose(0, 2, 1) @ right[1:]
    below, n = after[1:].transpose(0, 2, 1) @ before, len(after)
    band = np.zeros((2 * m, n * m))
    for i in range(m):
        for j in range(m):
            if i >= j:
                band[i - j, j::m] = blocks[:, i, j]
            band[m + i - j, j : (n - 1) * m : m] = below[:, i, j]
    Y = cho_solve_banded((cholesky_banded(band, lower=True), True), load.reshape(n * m, -1)).reshape(load.shape)
    rest = right - after @ Y
    rest[1:] -= before @ Y[:-1]

    def step(change):
        states = -(Y[:, :, :SIZE] @ change + Y[:, :, -1]) * unit
        ends = np.cumsum([segment.count + 1 for segment in segments])
        for segment, part in zip(segments, np.split(states, ends[:-1]), strict=True):
            segment.correct(part)

    remaining = rest.reshape(-1, COLUMNS)
    return remaining[:, :-1], remaining[:, -1], step


def segments_of(stage, setting, prior):
    """Return the segments of a stage that begin with a rest. Raises NotCoveredError if there is none."""
    found = []
    for first, last in stage.spans:
        span = (first + (first > 0), last - (last < len(stage.seq)))
        long = (r for r in rests(stage, setting, prior, [span]) if (r[1] - r[0]) * setting.dt >= SHORTEST)
        found += [Segment(stage, setting, span, rest) for rest in long][:1]
    if not found:
        raise NotCoveredError(f"the stage {stage.name} without a rest of {SHORTEST + MARGIN} s")
    return found


def solve_motion(stage, setting, prior):
    """Return the joint estimate after a stage of motion; `prior` and the estimate are `estimate.Joint`."""
    segments, point = segments_of(stage, setting, prior), prior.mean.copy()
    for _ in range(_PASSES):
        jacobian, wrong, step = reduce(segments, point[:COUNT], point[COUNT:])
        posterior = prior.with_equations(jacobian, -wrong, point)
        change, point = posterior.mean - point, posterior.mean.copy()
        step(change)
        if np.max(np.abs(change) / np.where(posterior.sigma > 0, posterior.sigma, 1.0)) < _CONVERGED:
            return posterior
    raise NotCoveredError(f"the stage {stage.name}, whose solution does not converge")
