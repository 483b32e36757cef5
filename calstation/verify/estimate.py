"""Joint estimates, and the stages at rest (`rate`, `six_position`) as least-squares problems."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .model import AT, COUNT, UP, accel_matrix, earth_rate, force_of, gyro_matrix, rotation
from .samples import DRIFT_TIME, SHORTEST, NotCoveredError, mean_angles, rests

#: Smallest turn between two rests, rad, and its largest deviation from whole turns.
TURN, DEVIATION = np.deg2rad(300.0), np.deg2rad(5.0)
#: Sigma of the direction of an axis of the table on the platform, rad.
AXIS_SIGMA = np.deg2rad(0.1)


@dataclass
class Joint:
    """Estimate of the 30 parameters and of the offset of the table's axes, and its change per gravity error."""

    mean: np.ndarray  # (31,)
    covariance: np.ndarray  # (31, 31), without the error of gravity
    gravity: np.ndarray  # (31,)

    @classmethod
    def prior(cls, setting):
        """Return the estimate before the first stage."""
        covariance = np.zeros((COUNT + 1, COUNT + 1))
        covariance[:COUNT, :COUNT], covariance[COUNT, COUNT] = setting.covariance, setting.offset[1] ** 2
        return cls(np.append(setting.mean, setting.offset[0]), covariance, np.zeros(COUNT + 1))

    @property
    def sigma(self):
        """Return the standard deviations without the error of gravity."""
        return np.sqrt(np.diag(self.covariance))

    def with_equations(self, jacobian, observed, point):
        """Return the estimate that includes white equations `jacobian` (x − point, gravity error) = observed."""
        free, size = np.flatnonzero(self.sigma > 0.0), COUNT + 1
        scale = self.sigma[free]
        root = np.linalg.cholesky(self.covariance[np.ix_(free, free)] / np.outer(scale, scale))
        known = np.linalg.solve(root, np.stack([self.mean - point, self.gravity], axis=1)[free] / scale[:, None])
        right = np.vstack([known, np.stack([observed, -jacobian[:, size]], axis=1)])
        left = np.vstack([np.linalg.inv(root), jacobian[:, free] * scale])
        Q, R = np.linalg.qr(left)
        solution = np.linalg.solve(R, Q.T @ right) * scale[:, None]
        inverse = np.linalg.inv(R)
        mean, gravity, covariance = point.copy(), self.gravity.copy(), np.zeros((size, size))
        mean[free] = point[free] + solution[:, 0]
        gravity[free] = solution[:, 1]
        covariance[np.ix_(free, free)] = inverse @ inverse.T * np.outer(scale, scale)
        return Joint(mean, covariance, gravity)

    def keeping(self, before, estimated):
        """Return the estimate in which only `estimated` parameters (and the offset) have changed since `before`.

        The other parameters are Schmidt's consider states. Both estimates are split into a part without the offset and
        its effect; the first part of the other parameters stays.
        """
        keep = [i for i in range(COUNT) if i not in estimated]
        (mean, covariance, slope), (mean0, covariance0, slope0) = (joint._split() for joint in (self, before))
        mean[keep], slope[keep] = mean0[keep], slope0[keep]
        covariance[np.ix_(keep, keep)] = covariance0[np.ix_(keep, keep)]
        gravity = self.gravity.copy()
        gravity[keep] = before.gravity[keep]
        variance, offset = self.covariance[COUNT, COUNT], self.mean[COUNT]
        mean, slope = np.append(mean + slope * offset, offset), np.append(slope, 1.0)
        full = np.zeros((COUNT + 1, COUNT + 1))
        full[:COUNT, :COUNT] = covariance
        return Joint(mean, full + variance * np.outer(slope, slope), gravity)

    def _split(self):
        """Return mean and covariance of the parameters for an offset of 0, and their change per offset."""
        slope = self.covariance[:COUNT, COUNT] / self.covariance[COUNT, COUNT]
        mean = self.mean[:COUNT] - slope * self.mean[COUNT]
        return mean, self.covariance[:COUNT, :COUNT] - np.outer(slope, slope) * self.covariance[COUNT, COUNT], slope

    def final_sigma(self, gravity_sigma):
        """Return the standard deviations of the 30 parameters, including the error of gravity."""
        return np.sqrt(np.diag(self.covariance) + (gravity_sigma * self.gravity) ** 2)[:COUNT]


def _fit(stage, model, observed, variance, prior, nuisance, nuisance_sigma, estimated):
    """Return the joint estimate after equations observed = model(parameters, nuisances, relative gravity error)."""
    point, at, sigma = prior.mean[:COUNT].copy(), nuisance.copy(), np.sqrt(variance)
    n, weight = len(nuisance), 1.0 / nuisance_sigma
    for _ in range(50):

        def row(unknown, point=point, at=at):
            return model(unknown[:COUNT] + point, unknown[COUNT:-1] + at, unknown[-1]) / sigma

        steps = np.r_[1e-2 * np.minimum(prior.sigma[:COUNT], 1e-3), 1e-2 * np.minimum(nuisance_sigma, 1e-3), 1e-6]
        columns = [
            (row(h) - row(-h)) / (2.0 * s) if s else 0.0 * observed for h, s in zip(np.diag(steps), steps, strict=True)
        ]
        jacobian, misfit = np.stack(columns, axis=1), observed / sigma - row(np.zeros(len(steps)))
        equations = np.hstack([jacobian[:, COUNT:-1], jacobian[:, :COUNT], jacobian[:, -1:], misfit[:, None]])
        known = np.hstack([np.diag(weight), np.zeros((n, COUNT + 1)), (weight * (nuisance - at))[:, None]])
        R = np.linalg.qr(np.vstack([known, equations]), mode="r")
        rest = R[n:]
        full = np.insert(rest[:, n : n + COUNT + 1], COUNT, 0.0, axis=1)  # no stage at rest observes the offset
        posterior = prior.with_equations(full, rest[:, -1], np.append(point, prior.mean[COUNT]))
        change = posterior.mean[:COUNT] - point
        moved = np.linalg.solve(R[:n, :n], R[:n, -1] - R[:n, n : n + COUNT] @ change)
        at = at + moved
        target = prior.mean[:COUNT].copy()
        target[estimated] = posterior.mean[estimated]
        largest = np.max(np.abs(target - point) / np.where(posterior.sigma[:COUNT] > 0, posterior.sigma[:COUNT], 1.0))
        point = target
        if largest < 1e-3 and np.max(np.abs(moved) * weight) < 1e-3:
            return posterior.keeping(prior, estimated)
    raise NotCoveredError(f"the stage {stage.name}, whose solution does not converge")


def solve_rate(stage, setting, prior):
    """Return the estimate after whole turns: integrals of the rate between rests against the angles of the table."""
    s, turns, number = setting, [], 0
    bias, bias_sigma = prior.mean[AT["gyro_bias"]], prior.sigma[AT["gyro_bias"]].max()
    for span in stage.spans:
        found = rests(stage, s, bias, bias_sigma, [span])
        for k, (one, two) in enumerate(pairwise(found)):
            a, b = sum(one) // 2, sum(two) // 2
            still = 0.5 * (stage.gyro[slice(*one)].mean(axis=0) + stage.gyro[slice(*two)].mean(axis=0))
            total = stage.gyro[a:b].sum(axis=0) * s.dt
            before, after = mean_angles(stage, *one), mean_angles(stage, *two)
            if before is None or after is None:
                raise NotCoveredError("a stage without angles of the table")
            joint = int(np.argmax(np.abs(after - before)))
            way = (after - before)[joint]
            whole = abs(way - 2.0 * np.pi * np.round(way / (2.0 * np.pi))) < DEVIATION
            if np.linalg.norm(total - still * (b - a) * s.dt) >= TURN and abs(way) > TURN and whole:
                turns.append((a, b, total, joint, before, after, number + k, number + k + 1))
        number += len(found)
    if not turns:
        raise NotCoveredError(f"the stage {stage.name} without whole turns")
    first, second, totals, joints, starts, ends, one, two = (np.array(column) for column in zip(*turns, strict=True))
    names = np.unique([one, two])
    one, two = np.searchsorted(names, one), np.searchsorted(names, two)
    duration = (second - first) * s.dt
    earth, sums = earth_rate(s.latitude), []
    for a, b, before, after in zip(first, second, starts, ends, strict=True):
        share = np.cumsum(np.linalg.norm(stage.gyro[a:b], axis=1))
        share = (share / share[-1])[:: max((b - a) // 2000, 1), None]
        angles = before + (after - before) * share
        C = rotation(-s.azimuth * UP) @ (
            rotation(angles[:, :1] * s.axes[0]) @ rotation(angles[:, 1:] * s.axes[1])
        ).mean(axis=0)
        sums.append(C * (b - a) * s.dt)
    C = np.array(sums)  # integrals of the rotation from platform to n

    def model(p, nuisance, _):
        mount = rotation(nuisance[:3]) @ s.orientation
        outer, inner = rotation(nuisance[4:7]) @ s.axes[0], rotation(nuisance[7:10]) @ s.axes[1]
        encoder = nuisance[10:].reshape(-1, 2)
        before, after = starts + encoder[one], ends + encoder[two]
        inside = rotation(-0.5 * (before + after)[:, 1:] * s.axes[1]) @ outer
        axis = np.where(joints[:, None] == 1, inner, inside)
        angle = (after - before)[np.arange(len(joints)), joints]
        c, d = np.cos(nuisance[3]), np.sin(nuisance[3])
        turned = np.array([earth[1] * d, earth[1] * c, earth[2]])
        platform = axis * angle[:, None] + np.einsum("nji,j->ni", C, turned)
        return (platform @ (gyro_matrix(p) @ mount.T).T + p[AT["gyro_bias"]] * duration[:, None]).ravel()

    sigma = [*[s.sigma["mount"]] * 3, s.sigma["azimuth"], *[AXIS_SIGMA] * 6, *[s.sigma["encoder"]] * (2 * len(names))]
    variance = s.rate_noise * duration + 2.0 * s.drift[0] ** 2 / DRIFT_TIME * duration**3 / 3.0
    return _fit(
        stage,
        model,
        totals.ravel(),
        np.repeat(variance, 3),
        prior,
        np.zeros(len(sigma)),
        np.array(sigma),
        AT["gyro_scale"],
    )


def _mean_force(stage, setting, first, last):
    """Return the force of a rest, m/s², as the slope of a line through its mean velocities, and its variance."""
    dt, count = setting.dt, last - first
    width = min(max(round(setting.interval / dt), 1), max(count // 2, 1))
    blocks = max(count // max(round(setting.interval / dt), 1), 2)
    middle = np.arange(blocks) - 0.5 * (blocks - 1)
    slope = middle / (np.sum(middle**2) * width * dt)  # of a line through the mean velocities
    # the velocity at a sample is the sum of the forces so far; a block's mean counts a force by its later samples
    weights = np.zeros(count)
    later = (width - 0.5 - np.arange(width)) / width
    after = np.cumsum(slope[::-1])[::-1] - slope
    weights[: blocks * width] = (slope[:, None] * later + after[:, None]).ravel() * dt
    noise = setting.velocity * np.sum(slope**2) + setting.force_noise * np.sum(weights**2) / dt
    return weights @ stage.accel[first:last], noise + setting.drift[3] ** 2


def solve_positions(stage, setting, prior):
    """Return the estimate after rests in many positions: gravity in b, whose direction is free within the mounting."""
    s = setting
    found = rests(stage, s, prior.mean[AT["gyro_bias"]], prior.sigma[AT["gyro_bias"]].max())
    found = [r for r in found if (r[1] - r[0]) * s.dt >= SHORTEST]
    if len(found) < 6:
        raise NotCoveredError(f"the stage {stage.name} with fewer than six rests")
    tilt = np.sqrt(s.sigma["mount"] ** 2 + s.sigma["base_tilt"] ** 2 + s.sigma["encoder"] ** 2)
    forces, variances, nominal = [], [], []
    for rest in found:
        force, variance = _mean_force(stage, s, *rest)
        angles = mean_angles(stage, *rest)
        if angles is None:
            raise NotCoveredError("a stage without angles of the table")
        C = rotation(angles[0] * s.axes[0]) @ rotation(angles[1] * s.axes[1]) @ s.orientation
        forces.append(force), variances.append(variance), nominal.append(C[2])
    observed, up = np.concatenate(forces), np.array(nominal)
    start = force_of(prior.mean[:COUNT], np.array(forces), np.zeros((len(found), 3)))
    start /= np.linalg.norm(start, axis=1, keepdims=True)
    if np.min(np.sum(start * up, axis=1)) < np.cos(10.0 * tilt):
        raise NotCoveredError("gravity that contradicts the angles of the table")
    # two directions perpendicular to the nominal one
    helper = np.eye(3)[np.argmin(np.abs(up), axis=1)]
    one = np.cross(up, helper)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    frame = np.stack([one, np.cross(up, one)], axis=1)

    def model(p, tilts, error):
        turn = np.einsum("ka,kai->ki", tilts.reshape(-1, 2), frame)
        force = s.gravity * (1.0 + error) * np.einsum("kij,kj->ki", rotation(turn), up)
        return (force @ accel_matrix(p).T + p[AT["accel_quadratic"]] * force**2 + p[AT["accel_bias"]]).ravel()

    count = 2 * len(found)
    estimated = [*AT["accel_scale"], *AT["accel_bias"]]
    return _fit(
        stage, model, observed, np.repeat(variances, 3), prior, np.zeros(count), np.full(count, tilt), estimated
    )
