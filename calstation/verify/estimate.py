"""Joint estimates, and the stages at rest (`rate`, `six_position`) as least-squares problems."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag

from .model import AT, COUNT, earth_rate, force_of, matrix, rotation
from .samples import DRIFT_TIME, SHORTEST, NotCoveredError, mean_angles, mean_force, rests

#: Smallest turn between two rests, rad, and its largest deviation from whole turns.
TURN, DEVIATION = np.deg2rad(300.0), np.deg2rad(5.0)
#: Sigma of the direction of an axis of the table on the platform, rad.
AXIS_SIGMA = np.deg2rad(0.1)
#: Number of the estimated values: the parameters, and the offsets of the table's axes.
SIZE = COUNT + 2


@dataclass
class Joint:
    """Estimate of the 30 parameters and of the two offsets of the table's axes, and its change per gravity error."""

    mean: np.ndarray  # (32,); within a stage at rest, followed by its nuisances
    covariance: np.ndarray  # (32, 32), without the error of gravity
    gravity: np.ndarray  # (32,)

    @classmethod
    def prior(cls, setting):
        """Return the estimate before the first stage."""
        covariance = np.diag(np.r_[np.zeros(COUNT), setting.offset[1]] ** 2)
        covariance[:COUNT, :COUNT] = setting.covariance
        return cls(np.r_[setting.mean, setting.offset[0]], covariance, np.zeros(SIZE))

    @property
    def sigma(self):
        """Return the standard deviations without the error of gravity."""
        return np.sqrt(np.diag(self.covariance))

    def with_equations(self, jacobian, observed, point):
        """Return the estimate that includes white equations `jacobian` (x − point, gravity error) = observed."""
        free = np.flatnonzero(self.sigma > 0.0)
        scale = self.sigma[free]
        root = np.linalg.cholesky(self.covariance[np.ix_(free, free)] / np.outer(scale, scale))
        known = np.linalg.solve(root, np.stack([self.mean - point, self.gravity], axis=1)[free] / scale[:, None])
        right = np.vstack([known, np.stack([observed, -jacobian[:, -1]], axis=1)])
        Q, R = np.linalg.qr(np.vstack([np.linalg.inv(root), jacobian[:, free] * scale]))
        solution, inverse = np.linalg.solve(R, Q.T @ right) * scale[:, None], np.linalg.inv(R) * scale[:, None]
        mean, gravity, covariance = point.copy(), self.gravity.copy(), np.zeros_like(self.covariance)
        mean[free] += solution[:, 0]
        gravity[free] = solution[:, 1]
        covariance[np.ix_(free, free)] = inverse @ inverse.T
        return Joint(mean, covariance, gravity)

    def keeping(self, before, estimated):
        """Return the estimate in which only `estimated` parameters (and the offsets) have changed since `before`.

        The other parameters are Schmidt's consider states. Both estimates are split into a part without the offsets and
        their effect; the first part of the other parameters stays.
        """
        keep = [i for i in range(COUNT) if i not in estimated]
        (mean, covariance, slope), (mean0, covariance0, slope0) = (joint._split() for joint in (self, before))
        mean[keep], slope[keep] = mean0[keep], slope0[keep]
        covariance[np.ix_(keep, keep)] = covariance0[np.ix_(keep, keep)]
        gravity, offsets, full = self.gravity.copy(), self.mean[COUNT:], np.zeros((SIZE, SIZE))
        gravity[keep] = before.gravity[keep]
        full[:COUNT, :COUNT], slopes = covariance, np.vstack([slope, np.eye(2)])
        full += slopes @ self.covariance[COUNT:, COUNT:] @ slopes.T
        return Joint(np.r_[mean + slope @ offsets, offsets], full, gravity)

    def _split(self):
        """Return mean and covariance of the parameters for offsets of 0, and their change per offset."""
        slope = self.covariance[:COUNT, COUNT:] @ np.linalg.pinv(self.covariance[COUNT:, COUNT:], hermitian=True)
        covariance = self.covariance[:COUNT, :COUNT] - slope @ self.covariance[COUNT:, :COUNT]
        return self.mean[:COUNT] - slope @ self.mean[COUNT:], covariance, slope


def _fit(stage, model, observed, variance, prior, sigma, estimated):
    """Return the joint estimate after equations observed = model(parameters, nuisances of `sigma`, gravity error)."""
    covariance, zero, error = block_diag(prior.covariance, np.diag(sigma**2)), 0.0 * sigma, np.sqrt(variance)
    start = Joint(np.r_[prior.mean, zero], covariance, np.r_[prior.gravity, zero])
    point, moving = start.mean, [*estimated, *range(SIZE, len(start.mean))]
    steps = np.r_[1e-2 * np.minimum(start.sigma, 1e-3), 1e-6]
    for _ in range(50):

        def row(h, point=point):
            return model((point + h[:-1])[:COUNT], (point + h[:-1])[SIZE:], h[-1]) / error

        slopes = [(row(h) - row(-h)) / (2.0 * max(h.max(), 1e-300)) for h in np.diag(steps)]
        posterior = start.with_equations(np.stack(slopes, axis=1), observed / error - row(0.0 * steps), point)
        target = start.mean.copy()
        target[moving] = posterior.mean[moving]
        change, point = target - point, target
        if np.max(np.abs(change) / np.where(posterior.sigma > 0, posterior.sigma, 1.0)) < 1e-3:
            used = slice(SIZE)
            posterior = Joint(posterior.mean[used], posterior.covariance[used, used], posterior.gravity[used])
            return posterior.keeping(prior, estimated)
    raise NotCoveredError(f"the stage {stage.name}, whose solution does not converge")


def solve_rate(stage, setting, prior):
    """Return the estimate after whole turns: integrals of the rate between rests against the angles of the table."""
    s, turns, number = setting, [], 0
    for span in stage.spans:
        found = rests(stage, s, prior, [span])
        for k, (one, two) in enumerate(pairwise(found)):
            a, b = sum(one) // 2, sum(two) // 2
            still = 0.5 * (stage.gyro[slice(*one)].mean(axis=0) + stage.gyro[slice(*two)].mean(axis=0))
            total, before, after = stage.gyro[a:b].sum(axis=0) * s.dt, mean_angles(stage, one), mean_angles(stage, two)
            joint = int(np.argmax(np.abs(after - before)))
            way = (after - before)[joint]
            whole = abs(way - 2.0 * np.pi * np.round(way / (2.0 * np.pi))) < DEVIATION
            if np.linalg.norm(total - still * (b - a) * s.dt) >= TURN and abs(way) > TURN and whole:
                turns.append((a, b, total, joint, before, after, number + k, number + k + 1))
        number += len(found)
    if not turns:
        raise NotCoveredError(f"the stage {stage.name} without whole turns")
    first, second, totals, joints, starts, ends, one, two = (np.array(column) for column in zip(*turns, strict=True))
    names, index = np.unique([one, two], return_inverse=True)
    (one, two), duration, sums = index.reshape(2, -1), (second - first) * s.dt, []
    for a, b, before, after in zip(first, second, starts, ends, strict=True):
        rate = np.linalg.norm(stage.gyro[a:b], axis=1)[:, None]
        share = (np.cumsum(rate, axis=0) - 0.5 * rate) / rate.sum()  # of the motion, in the middle of every sample
        sums.append(s.platform(before + (after - before) * share).mean(axis=0) * (b - a) * s.dt)
    C, earth = np.array(sums), earth_rate(s.latitude)  # integrals of the rotation from platform to n

    def model(p, nuisance, _):
        mount = rotation(nuisance[:3]) @ s.orientation
        outer, inner = (rotation(nuisance[k : k + 3]) @ axis for k, axis in zip((4, 7), s.axes, strict=True))
        encoder = nuisance[10:].reshape(-1, 2)
        before, after = starts + encoder[one], ends + encoder[two]
        inside = rotation(-0.5 * (before + after)[:, 1:] * s.axes[1]) @ outer
        axis = np.where(joints[:, None] == 1, inner, inside)
        angle = (after - before)[np.arange(len(joints)), joints]
        turned = np.array([earth[1] * np.sin(nuisance[3]), earth[1] * np.cos(nuisance[3]), earth[2]])
        platform = axis * angle[:, None] + np.einsum("nji,j->ni", C, turned)
        return (platform @ (matrix(p, "gyro") @ mount.T).T + p[AT["gyro_bias"]] * duration[:, None]).ravel()

    encoders = 2 * len(names) * [s.sigma["encoder"]]
    sigma = np.array([*[s.sigma["mount"]] * 3, s.sigma["azimuth"], *[AXIS_SIGMA] * 6, *encoders])
    variance = np.repeat(s.rate_noise * duration + 2.0 * s.drift[0] ** 2 / DRIFT_TIME * duration**3 / 3.0, 3)
    return _fit(stage, model, totals.ravel(), variance, prior, sigma, AT["gyro_scale"])


def solve_positions(stage, setting, prior):
    """Return the estimate after rests in many positions: gravity in b, whose direction is free within the mounting."""
    s = setting
    found = [rest for rest in rests(stage, s, prior) if (rest[1] - rest[0]) * s.dt >= SHORTEST]
    if len(found) < 6:
        raise NotCoveredError(f"the stage {stage.name} with fewer than six rests")
    forces, variances = (np.array(column) for column in zip(*(mean_force(stage, s, *r) for r in found), strict=True))
    up = (s.platform(np.array([mean_angles(stage, rest) for rest in found])) @ s.orientation)[:, 2]
    start = force_of(prior.mean[:COUNT], forces, np.zeros((len(found), 3)))
    if np.min(np.sum(start * up, axis=1) / np.linalg.norm(start, axis=1)) < np.cos(10.0 * s.sigma["tilt"]):
        raise NotCoveredError("gravity that contradicts the angles of the table")
    # two directions perpendicular to the nominal one
    one = np.cross(up, np.eye(3)[np.argmin(np.abs(up), axis=1)])
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    frame = np.stack([one, np.cross(up, one)], axis=1)

    def model(p, tilts, error):
        turn = np.einsum("ka,kai->ki", tilts.reshape(-1, 2), frame)
        force = s.gravity * (1.0 + error) * np.einsum("kij,kj->ki", rotation(turn), up)
        return (force @ matrix(p, "accel").T + p[AT["accel_quadratic"]] * force**2 + p[AT["accel_bias"]]).ravel()

    tilts, estimated = np.full(2 * len(found), s.sigma["tilt"]), [*AT["accel_scale"], *AT["accel_bias"]]
    return _fit(stage, model, forces.ravel(), np.repeat(variances, 3), prior, tilts, estimated)
