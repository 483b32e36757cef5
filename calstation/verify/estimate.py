"""Joint estimates, and the stages as least-squares problems, which one Gauss-Newton method solves.

The unknowns of a stage of motion are attitude, velocity and drifts of the biases every 0.1 s, which sparse normal
equations eliminate, and the parameters; the mean velocity of the table's centre is zero but for vibration. Derivatives
use the force that the motion implies: noise of the measured one would count as information. No filter is run.
"""

from itertools import pairwise

import numpy as np
from scipy.linalg import hilbert
from scipy.sparse import bsr_array, csc_array, diags_array
from scipy.sparse.linalg import norm, spsolve
from scipy.spatial.transform import Rotation

from .samples import AT, BIASES, COUNT, UP, NotCoveredError, compensated, rotation, sensed

#: Window, margin at both ends and shortest duration of a rest, longest for an attitude; correlation time of drifts, s.
WINDOW, MARGIN, SHORTEST, LONGEST, DRIFT_TIME = 0.5, 0.3, 1.0, 20.0, 200.0
#: Smallest turn between two rests, and its largest deviation from whole turns, and sigma of an axis' direction, rad.
TURN, DEVIATION, AXIS_SIGMA = np.deg2rad([300.0, 5.0, 0.1])
#: Number of states of the trajectory: errors of attitude and velocity, drifts of the biases.
STATES = 12


class Joint:
    """Estimate of the parameters by the offsets of the table's axes and the error of gravity (Friedland's method).

    Response: change per unit of each offset and of the gravity error, and the mean without them, (33, 4). Aside: white
    equations of the offsets, the gravity error and a misclosure alone, (k, 4). The covariance is that without them.
    """

    def __init__(self, response, covariance, aside):
        self.response, self.covariance, self.aside = response, covariance, aside
        self.mean, self.sigma = response[:, -1], np.sqrt(np.diag(covariance))

    def updated(self, equations, point):
        """Return the estimate after white equations J (x − point) + w = noise, shape (k, 34), by QR."""
        free, response = np.flatnonzero(self.sigma > 0.0), np.outer(point, [0.0, 0.0, 0.0, 1.0])
        scale = self.sigma[free, None]
        root = np.linalg.inv(np.linalg.cholesky(self.covariance[np.ix_(free, free)] / (scale * scale.T)))
        right = np.vstack([root @ ((response - self.response)[free] / scale), equations[:, -4:]])
        Q, R = np.linalg.qr(np.vstack([root, equations[:, free] * scale.T]))
        inverse, covariance = scale * np.linalg.inv(R), np.zeros_like(self.covariance)
        response[free] -= inverse @ (Q.T @ right)
        covariance[np.ix_(free, free)] = inverse @ inverse.T
        rest = np.vstack([self.aside, right - Q @ (Q.T @ right)])
        return Joint(response, covariance, np.linalg.qr(rest, mode="r"))

    def complete(self, offset, offset_sigma, gravity_sigma):
        """Return mean, covariance and its part from the offsets, after the least-squares estimate of the offsets."""
        A, slope = self.aside[:, :2] * offset_sigma, self.response[:, :2] * offset_sigma
        right = self.aside[:, 2:] + np.outer(self.aside[:, :2] @ offset, [0.0, 1.0])
        inverse = np.linalg.inv(np.eye(2) + A.T @ A)
        by_gravity, mean = (self.response[:, 2:] - slope @ inverse @ A.T @ right).T
        part, error = slope @ inverse @ slope.T, by_gravity * gravity_sigma
        return mean + self.response[:, :2] @ offset, self.covariance + part + np.outer(error, error), part


def solve(name, linearise, prior, estimated):
    """Return the joint estimate after a stage by the Gauss-Newton method.

    `linearise(point)` returns white equations, see `Joint.updated`, and a function that corrects eliminated unknowns.
    Parameters that are not `estimated` keep mean and covariance (Schmidt's consider states).
    """
    point, keep = prior.mean.copy(), np.setdiff1d(np.arange(len(prior.mean)), estimated)
    for _ in range(50):
        equations, correct = linearise(point)
        posterior = prior.updated(equations, point)
        correct(posterior.mean - point)
        before, point = point, prior.mean.copy()
        point[estimated] = posterior.mean[estimated]
        if np.max(np.abs(point - before) / np.where(posterior.sigma > 0, posterior.sigma, 1.0)) < 1e-3:
            posterior.response[keep] = prior.response[keep]
            posterior.covariance[np.ix_(keep, keep)] = prior.covariance[np.ix_(keep, keep)]
            return Joint(posterior.response, posterior.covariance, posterior.aside)
    raise NotCoveredError(f"the stage {name}, whose solution does not converge")


def derivatives(function, size, step=1e-6):
    """Return the derivatives of function(x) at x = 0 by central differences, shape (..., size)."""
    return np.stack([(function(h) - function(-h)) / (2.0 * step) for h in step * np.eye(size)], axis=-1)


def _eliminated(by_unknowns, equations, move):
    """Return what remains of equations without unknowns, and a function that moves them for a change of parameters."""
    scaled = by_unknowns @ diags_array(1.0 / norm(by_unknowns, axis=0))
    solution = spsolve((scaled.T @ scaled).tocsc(), scaled.T @ equations)
    steps = solution / norm(by_unknowns, axis=0)[:, None]
    return equations - scaled @ solution, lambda change: move(-steps[:, :COUNT] @ change - steps[:, -1])


def _batch(model, observed, variance, sigma):
    """Return the equations of observed = model(parameters, nuisances) with nuisances of mean 0, see `solve`."""
    nuisance, zero = np.zeros(len(sigma)), np.zeros(COUNT + len(sigma))

    def linearise(point):
        def misclosures(h):
            x = nuisance + h[COUNT:]
            return np.r_[(model(point + h[:COUNT], x) - observed) / np.sqrt(variance), x / sigma]

        by_parameters, by_nuisance = np.split(derivatives(misclosures, len(zero)), [COUNT], axis=1)
        equations = np.hstack([by_parameters, misclosures(zero)[:, None]])
        return _eliminated(csc_array(by_nuisance), equations, nuisance.__iadd__)

    return linearise


def rests(stage, s, prior, spans=None):
    """Return the rests (first, last + 1) of a stage, in which the rate agrees with the median of its quiet windows."""
    width, margin, found = max(round(WINDOW / s.dt), 2), round(MARGIN / s.dt), []
    bias, bias_sigma = prior.mean[AT["gyro_bias"]], prior.sigma[AT["gyro_bias"]].max()
    noise = 5.0 * s.window(width)
    for first, last in (span for span in spans or stage.spans if span[1] - span[0] >= 2 * width):
        outputs = np.hstack([stage.gyro[first:last], stage.accel[first:last]])
        totals = np.cumsum(np.vstack([np.zeros(6), outputs - outputs[0]]), axis=0)
        means = (totals[width:] - totals[:-width]) / width + outputs[0]
        rate, change = means[:, :3] - bias, np.abs(means[width:] - means[:-width])
        quiet = np.abs(rate[width:]).max(axis=1) < 3.0 * bias_sigma + noise + np.deg2rad(0.1)
        quiet &= change[:, :3].max(axis=1) < noise + np.deg2rad(0.01)
        middle = np.median(rate[width:][quiet], axis=0) if quiet.any() else np.full(3, np.inf)
        still = np.abs(rate - middle).max(axis=1) < noise + np.deg2rad(0.03)
        jump = np.flatnonzero(change[:, 3:].max(axis=1) > 0.5)
        still[jump] = still[jump + width] = False
        for a, b in np.flatnonzero(np.diff(still.astype(int), prepend=0, append=0)).reshape(-1, 2).tolist():
            begin, end = first + a + margin * (a > 0), first + b + width - 1
            end -= margin * (end < last)
            found += [(begin, end)] * (end - begin >= width)
    return found


def mean_force(stage, s, first, last):
    """Return the force of a rest, m/s², as the slope of a line through its mean velocities, and its variance."""
    count, stride = last - first, max(round(s.interval / s.dt), 1)
    width, blocks = min(stride, max(count // 2, 1)), max(count // stride, 2)
    middle = np.arange(blocks) - 0.5 * (blocks - 1)
    slope, velocities = middle / (np.sum(middle**2) * width * s.dt), np.zeros(count)
    velocities[: blocks * width] = np.repeat(slope, width) / width
    weights = -np.cumsum(velocities) * s.dt  # the velocity at the start of a sample contains the forces before it
    noise = s.velocity * np.sum(slope**2) + s.force_noise * np.sum(weights**2) / s.dt
    return weights @ stage.accel[first:last], noise + s.drift[3] ** 2


def rate_equations(stage, s, prior):
    """Return the equations of whole turns: integrals of the rate between rests against the angles of the table."""
    rows, found = [], rests(stage, s, prior)
    for k, (one, two) in enumerate(pairwise(found)):
        a, b = sum(one) // 2, sum(two) // 2
        start, end = (np.nanmean(stage.angles[slice(*rest)], axis=0) for rest in (one, two))
        way, has_gap = np.abs(end - start).max(), stage.seq[b] - stage.seq[a] != b - a
        if way > TURN and abs(way - 2.0 * np.pi * np.round(way / (2.0 * np.pi))) < DEVIATION and not has_gap:
            speed = np.linalg.norm(stage.gyro[a:b], axis=1)[:, None]
            share = (np.cumsum(speed, axis=0) - 0.5 * speed) / speed.sum()  # of the turn, amid every sample
            C = s.platform(start + (end - start) * share).mean(axis=0)  # mean rotation from platform to n
            rows.append((stage.gyro[a:b].mean(axis=0), start, end, (b - a) * s.dt, C, k))
    if not rows:
        raise NotCoveredError(f"the stage {stage.name} without whole turns")
    rates, starts, ends, duration, C, rest = (np.array(column) for column in zip(*rows, strict=True))
    is_inner = np.abs(ends - starts).argmax(axis=1)[:, None] == 1

    def model(p, nuisance):
        mount, azimuth, outer, inner, encoder = np.split(nuisance, [3, 4, 7, 10])
        outer, inner = rotation(outer) @ s.axes[0], rotation(inner) @ s.axes[1]
        before, after = (angles + encoder.reshape(-1, 2)[k] for angles, k in ((starts, rest), (ends, rest + 1)))
        turn, outer = (after - before) / duration[:, None], rotation(-0.5 * (before + after)[:, 1:] * s.axes[1]) @ outer
        platform = np.where(is_inner, inner * turn[:, 1:], outer * turn[:, :1]) + rotation(-azimuth * UP) @ s.earth @ C
        return sensed(p, "gyro", platform @ rotation(mount) @ s.orientation).ravel()

    sigmas = [s.sigma["mount"], s.sigma["azimuth"], AXIS_SIGMA, s.sigma["encoder"]]
    variance = np.repeat(s.rate_noise / duration + 2.0 * s.drift[0] ** 2 / DRIFT_TIME * duration / 3.0, 3)
    return _batch(model, rates.ravel(), variance, np.repeat(sigmas, [3, 1, 6, 2 * len(found)]))


def position_equations(stage, s, prior):
    """Return the equations of rests in many positions: gravity in b, whose direction is free within the mounting."""
    found = [rest for rest in rests(stage, s, prior) if (rest[1] - rest[0]) * s.dt >= SHORTEST]
    if len(found) < 6:
        raise NotCoveredError(f"the stage {stage.name} with fewer than six rests")
    forces, variances = (np.array(column) for column in zip(*(mean_force(stage, s, *r) for r in found), strict=True))
    up = (s.platform(np.array([np.nanmean(stage.angles[a:b], axis=0) for a, b in found])) @ s.orientation)[:, 2]

    def model(p, tilts):
        direction = np.matvec(rotation(tilts.reshape(-1, 3)), up)
        return sensed(p, "accel", s.gravity * (1.0 + p[-1]) * direction).ravel()

    return _batch(model, forces.ravel(), np.repeat(variances, 3), np.full(3 * len(found), s.sigma["tilt"]))


class Segment:
    """The samples from the first rest of a span on, the prior attitude at its start, and the trajectory so far."""

    def __init__(self, stage, setting, span, rest):
        s, self.setting, self.stride = setting, setting, max(round(setting.interval / setting.dt), 1)
        begin, self.T, self.count = rest[0], self.stride * s.dt, (span[1] - rest[0]) // self.stride
        at = begin + self.stride * np.arange(self.count + 1)
        self.time = stage.seq[[begin, at[-1] - 1]] * s.dt
        self.middle = (stage.seq[at[:-1]] + 0.5 * self.stride) * s.dt
        # the samples of every interval with the one before; at its end, the mean output of two samples, and its change
        inside = np.clip(at[:-1, None] + np.arange(-1, self.stride), 0, None)
        self.gyro, self.accel = stage.gyro[inside], stage.accel[inside]
        before, after = stage.gyro[np.maximum(at - 1, 0)], stage.gyro[np.minimum(at, span[1] - 1)]
        self.ends, self.changes = 0.5 * (before + after), (after - before) / s.dt
        heading = np.linalg.norm([s.sigma[key] for key in ("azimuth", "mount", "encoder")])
        self.prior_sigma = np.r_[s.sigma["tilt"], s.sigma["tilt"], heading, [np.sqrt(100.0 * s.velocity)] * 3]
        first = stage.angles[begin : min(rest[1], begin + int(LONGEST / s.dt))]
        self.prior = (s.platform(np.nanmean(first, axis=0)[None]) @ s.orientation)[0]
        polled = begin + np.flatnonzero(np.isfinite(stage.angles[begin : span[1]]).all(axis=1))
        angles = np.stack([np.interp(at, polled + 1, stage.angles[polled, j]) for j in (0, 1)], axis=1)
        self.attitude = s.platform(angles) @ s.orientation
        self.velocity, self.drift = np.zeros((self.count + 1, 3)), np.zeros((self.count + 1, 6))

    def _implied(self, p):
        """Return what the motion implies: outputs of groups of samples, integrals over intervals, and impulses in n."""
        s, T, C, r = self.setting, self.T, self.attitude, p[AT["outer_lever"]]
        groups = next(k for k in (5, 4, 3, 2, 1) if self.stride % k == 0)
        gyro, dt = self.gyro[:, 1:].reshape(self.count, groups, -1, 3).mean(axis=2), T / groups
        omega = compensated(p, gyro, gyro)[0]
        middle = C[:-1, None, 2:] @ rotation((np.cumsum(omega, axis=1) - 0.5 * omega) * dt)
        force = s.gravity * middle[..., 0, :] + np.cross(omega, np.cross(omega, r))
        outputs = (np.concatenate([x[:, :1], x], axis=1) for x in (gyro, sensed(p, "accel", force)))
        u = np.matvec(C, np.cross(compensated(p, self.ends, self.ends)[0] - s.earth @ C, r))
        impulse, back = s.gravity * T * UP + np.diff(u, axis=0), C[:-1].transpose(0, 2, 1)
        shift = 0.5 * s.gravity * T**2 * UP + np.diff(C @ r, axis=0) - T * u[:-1]
        implied = back @ rotation(s.earth * T) @ C[1:], np.matvec(back, impulse), np.matvec(back, shift)
        return (*outputs, dt), implied, impulse

    def equations(self, p, gap, drift, change):
        """Return the whitened equations about the present trajectory and the parameters, shape (n + 1, 15, 58).

        Columns are the states before and after an interval, the parameters and the misclosure. The first set is that
        of the prior, `gap` s after the end of another segment with `drift`. The others are those of intervals of
        T s with rotation R, velocity v, displacement x; earth rate Ω, lever arm r, drifts b (Gauss-Markov process):

            C₁ = exp(−ΩT) C₀ R,   v₁ = v₀ + C₀v − ½T Ω×C₀v − gT − 2Ω×(C₁r − C₀r),   b₁ = exp(−T/τ) b₀ + noise
            0 = (C₁r − C₀r + change of the offsets − ∫v dt) / T,   ∫v dt = T v₀ + C₀x − T/3 Ω×C₀x − ½gT² − T²Ω×v₀
        """
        s, T, C, (outputs, implied, impulse) = self.setting, self.T, self.attitude, self._implied(p)
        spin, gravity, E = s.earth * T, s.gravity * UP, np.zeros((self.count + 1, 15, 2 * STATES + COUNT + 1))
        inner = C @ (s.orientation.T @ s.axes[1])  # directions of the offsets in n
        hinge = np.cross(rotation(-s.azimuth * UP) @ s.axes[0], inner)
        offsets = np.diff(np.stack([hinge / np.linalg.norm(hinge, axis=1, keepdims=True), inner], axis=2), axis=0)
        keep = np.exp(-np.r_[gap, np.full(self.count, T)] / DRIFT_TIME)[:, None]
        spread = np.maximum(s.drift * np.sqrt(1.0 - keep**2), 1e-12)  # no drift without bias instability

        def misclosures(h, integrals=None):
            before, after, q = h[:STATES], h[STATES : 2 * STATES], p + h[2 * STATES :]
            q[BIASES] += before[6:]
            R, v, x = integrals or (_integrate(q, *outputs) if np.any(q != p) else implied)
            C0, C1 = rotation(before[:3]) @ C[:-1], rotation(after[:3]) @ C[1:]
            v0, v1 = self.velocity[:-1] + before[3:6], self.velocity[1:] + after[3:6]
            b0, b1, up = self.drift[:-1] + before[6:], self.drift[1:] + after[6:], gravity * (1.0 + q[-1])
            v, x, way = np.matvec(C0, v), np.matvec(C0, x), (C1 - C0) @ q[AT["outer_lever"]]
            attitude = -Rotation.from_matrix(rotation(-spin) @ C0 @ R @ C1.transpose(0, 2, 1)).as_rotvec()
            velocity = v1 - v0 - v + 0.5 * np.cross(spin, v) + up * T + 2.0 * np.cross(s.earth, way)
            integral = T * v0 + x - np.cross(spin, x / 3.0 + T * v0) - 0.5 * up * T**2
            mean = (way + offsets @ q[AT["axis_offset"]] - integral) / T
            return np.concatenate([attitude, velocity, mean, (b1 - keep[1:] * b0) / spread[1:]], axis=1)

        rows, sigma = np.r_[0:6, 9:15], np.r_[self.prior_sigma, spread[0]]
        turn = Rotation.from_matrix(C[0] @ self.prior.T).as_rotvec()
        E[0, rows, STATES + np.arange(STATES)] = 1.0 / sigma
        E[0, 9:, 6:STATES] = np.diag(-keep[0] / spread[0])
        E[0, rows, -1] = np.r_[turn, self.velocity[0], self.drift[0] - keep[0] * drift] / sigma
        drifting = p + (self.drift[:-1] @ np.eye(COUNT)[BIASES] + change)[:, None]
        E[1:, :, :-1] = derivatives(misclosures, 2 * STATES + COUNT)
        E[1:, :, -1] = misclosures(np.zeros(2 * STATES + COUNT), _integrate(drifting, self.gyro, self.accel, s.dt))
        # the acceleration of the lever arm changes within a sample (Euler-Maclaurin)
        omega, r = compensated(p, self.ends, self.ends)[0], p[AT["outer_lever"]]
        arm = np.matvec(C, np.cross(omega, np.cross(omega, r)) + np.cross(self.changes, r))
        E[1:, 6:9, -1] += s.dt**2 / 12.0 * np.diff(arm, axis=0) / T
        # covariance of the equations: the errors of rate act by [1, −Ft, −Ft²/2T], those of force by [0, 1, t/T]
        F = np.cross(np.eye(3), impulse[:, None])
        by_rate = np.concatenate([np.broadcast_to(np.eye(3), F.shape), -F, -0.5 * F], axis=1)
        N = s.rate_noise * T * by_rate @ by_rate.transpose(0, 2, 1) * np.kron(hilbert(3), np.ones((3, 3)))
        N[:, 3:, 3:] += s.force_noise * T * np.kron(hilbert(2), np.eye(3))
        N[:, 6:, 6:] += s.velocity * np.eye(3)
        E[1:, :9] = np.linalg.solve(np.linalg.cholesky(N), E[1:, :9])
        return E


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
        x = x + v * dt + np.matvec(R, shift[:, j])
        v = v + np.matvec(R, change[:, j])
        R = R @ turns[:, j]
    return R, v, x


def motion_equations(stage, setting, prior):
    """Return the equations of a stage whose segments begin with a rest, see `solve`; drifts continue across gaps."""
    segments = []
    for first, last in stage.spans:
        span = (first + (first > 0), last - (last < len(stage.seq)))
        long = (r for r in rests(stage, setting, prior, [span]) if (r[1] - r[0]) * setting.dt >= SHORTEST)
        segments += [Segment(stage, setting, span, rest) for rest in long][:1]
    if not segments:
        raise NotCoveredError(f"the stage {stage.name} without a rest of {SHORTEST + MARGIN} s")

    def linearise(point, change=lambda time: np.zeros((len(time), COUNT))):
        parts, end, drift = [], -np.inf, np.zeros(6)
        for segment in segments:
            parts.append(segment.equations(point, segment.time[0] - end, drift, change(segment.middle)))
            end, drift = segment.time[1], segment.drift[-1]
        before, after, equations = np.split(np.concatenate(parts), [STATES, 2 * STATES], axis=2)
        n, equations = len(before), equations.reshape(-1, COUNT + 1)
        blocks = np.stack([before, after], axis=1).reshape(-1, 15, STATES)[1:]
        A = bsr_array((blocks, np.repeat(np.arange(n), 2)[:-1], np.r_[0, 2 * np.arange(n) + 1]))

        def move(states):
            states = states.reshape(n, STATES)
            for segment in segments:
                part, states = np.split(states, [segment.count + 1])
                segment.attitude = rotation(part[:, :3]) @ segment.attitude
                segment.velocity, segment.drift = segment.velocity + part[:, 3:6], segment.drift + part[:, 6:]

        return _eliminated(A, equations, move)

    return linearise
