"""Joint estimates, their update by equations, and the stages at rest (`rate`, `six_position`)."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .model import AT, COUNT, UP, compensated, matrix, rotation, turned
from .samples import DRIFT_TIME, SHORTEST, NotCoveredError, mean_angles, mean_force, rests

#: Smallest turn between two rests, rad, and its largest deviation from whole turns.
TURN, DEVIATION = np.deg2rad(300.0), np.deg2rad(5.0)
#: Sigma of the direction of an axis of the table on the platform, rad.
AXIS_SIGMA = np.deg2rad(0.1)
#: Columns of equations after the parameters: offsets of the table's axes, relative error of gravity, misclosure.
ASIDE, COLUMNS = 4, COUNT + 4


@dataclass
class Joint:
    """Estimate of the parameters by the offsets of the table's axes and the error of gravity (Friedland's method)."""

    response: np.ndarray  # change per unit of each offset and of gravity error, and the mean without them, (30, 4)
    covariance: np.ndarray  # for given offsets and gravity, (30, 30)
    aside: np.ndarray  # white equations of the offsets, the gravity error and a misclosure alone, (k, 4)

    @classmethod
    def prior(cls, mean, covariance):
        """Return the estimate before the first stage."""
        return cls(np.eye(1, ASIDE, 3) * mean[:, None], covariance, np.zeros((0, ASIDE)))

    @property
    def mean(self):
        """Return the parameters without offsets and error of gravity."""
        return self.response[:, -1]

    @property
    def sigma(self):
        """Return the standard deviations for given offsets and gravity."""
        return np.sqrt(np.diag(self.covariance))

    def updated(self, equations, point):
        """Return the estimate after white equations J (x − point) + A (offsets, gravity error) + w = noise, by QR."""
        free = np.flatnonzero(self.sigma > 0.0)
        scale, known = self.sigma[free, None], np.eye(1, ASIDE, 3) * point[:, None] - self.response
        root = np.linalg.inv(np.linalg.cholesky(self.covariance[np.ix_(free, free)] / (scale * scale.T)))
        Q, R = np.linalg.qr(np.vstack([root, equations[:, free] * scale.T]))
        right = np.vstack([root @ (known[free] / scale), equations[:, COUNT:]])
        inverse, rest = scale * np.linalg.inv(R), right - Q @ (Q.T @ right)
        response, covariance = np.eye(1, ASIDE, 3) * point[:, None], np.zeros_like(self.covariance)
        response[free] -= inverse @ (Q.T @ right)
        covariance[np.ix_(free, free)] = inverse @ inverse.T
        return Joint(response, covariance, np.linalg.qr(np.vstack([self.aside, rest]), mode="r"))

    def keeping(self, before, estimated):
        """Return the estimate in which the parameters that are not `estimated` stay: Schmidt's consider states."""
        keep = np.setdiff1d(np.arange(COUNT), estimated)
        self.response[keep], self.covariance[np.ix_(keep, keep)] = (
            before.response[keep],
            before.covariance[np.ix_(keep, keep)],
        )
        return self

    def complete(self, offset, offset_sigma, gravity_sigma):
        """Return mean, covariance and its part from the offsets, after the least-squares estimate of the offsets."""
        A = np.vstack([np.eye(2), self.aside[:, :2] * offset_sigma])
        right = np.vstack([np.zeros((2, 2)), self.aside[:, 2:] + np.outer(self.aside[:, :2] @ offset, [0.0, 1.0])])
        inverse = np.linalg.inv(A.T @ A)
        change, slope = -inverse @ A.T @ right, self.response[:, :2] * offset_sigma
        gravity, mean = (self.response[:, 2:] + slope @ change).T
        part, error = slope @ inverse @ slope.T, gravity_sigma * gravity
        return mean + self.response[:, :2] @ offset, self.covariance + part + np.outer(error, error), part


def solve(name, linearise, prior, estimated):
    """Return the joint estimate after a stage by the Gauss-Newton method.

    `linearise(point)` returns the white equations of the stage, shape (k, 34), see `Joint.updated`, and a function that
    corrects the unknowns which it has eliminated for a change of the parameters.
    """
    point = prior.mean.copy()
    for _ in range(50):
        equations, correct = linearise(point)
        posterior = prior.updated(equations, point)
        correct(posterior.mean - point)
        before, point = point, prior.mean.copy()
        point[estimated] = posterior.mean[estimated]
        if np.max(np.abs(point - before) / np.where(posterior.sigma > 0, posterior.sigma, 1.0)) < 1e-3:
            return posterior.keeping(prior, estimated)
    raise NotCoveredError(f"the stage {name}, whose solution does not converge")


class Batch:
    """Linearises equations observed = model(parameters, nuisances, gravity error) with nuisances of mean 0."""

    def __init__(self, model, observed, variance, sigma):
        self.model, self.observed, self.error, self.sigma = model, observed, np.sqrt(variance), sigma
        self.nuisance = np.zeros(len(sigma))

    def _misclosures(self, x):
        p, nuisance, gravity = np.split(x, [COUNT, -1])
        return np.r_[(self.model(p, nuisance, gravity) - self.observed) / self.error, nuisance / self.sigma]

    def __call__(self, point):
        """Differentiate by central differences, and eliminate the nuisances by a projection; see `solve`."""
        x = np.r_[point, self.nuisance, 0.0]
        wrong, steps = self._misclosures(x), 1e-5 * np.eye(len(x))
        jacobian = np.stack([(self._misclosures(x + h) - self._misclosures(x - h)) / 2e-5 for h in steps], axis=1)
        by_parameters, by_nuisances, by_gravity = np.split(jacobian, [COUNT, -1], axis=1)
        equations = np.hstack([by_parameters, np.zeros((len(wrong), 2)), by_gravity, wrong[:, None]])
        Q, R = np.linalg.qr(by_nuisances)
        solution = np.linalg.solve(R, Q.T @ equations)

        def correct(change):
            self.nuisance = self.nuisance - solution[:, :COUNT] @ change - solution[:, -1]

        return equations - by_nuisances @ solution, correct


def rate_equations(stage, s, prior):
    """Return the equations of whole turns: integrals of the rate between rests against the angles of the table."""
    rows, number = [], 0
    for span in stage.spans:
        found = rests(stage, s, prior, [span])
        for k, (one, two) in enumerate(pairwise(found), start=number):
            a, b = sum(one) // 2, sum(two) // 2
            still = 0.5 * (stage.gyro[slice(*one)].mean(axis=0) + stage.gyro[slice(*two)].mean(axis=0))
            total, start, end = stage.gyro[a:b].sum(axis=0) * s.dt, mean_angles(stage, one), mean_angles(stage, two)
            joint = int(np.argmax(np.abs(end - start)))
            way = abs(end - start)[joint]
            whole = abs(way - 2.0 * np.pi * np.round(way / (2.0 * np.pi))) < DEVIATION
            if np.linalg.norm(total - still * (b - a) * s.dt) >= TURN and way > TURN and whole:
                speed = np.linalg.norm(stage.gyro[a:b], axis=1)[:, None]
                share = (np.cumsum(speed, axis=0) - 0.5 * speed) / speed.sum()  # of the turn, amid every sample
                C = s.platform(start + (end - start) * share).mean(axis=0)  # mean rotation from platform to n
                rows.append((total, joint, start, end, (b - a) * s.dt, C, k, k + 1))
        number += len(found)
    if not rows:
        raise NotCoveredError(f"the stage {stage.name} without whole turns")
    totals, joints, starts, ends, duration, C, one, two = (np.array(column) for column in zip(*rows, strict=True))

    def model(p, nuisance, _):
        mount = rotation(nuisance[:3]) @ s.orientation
        outer, inner = (rotation(nuisance[k : k + 3]) @ axis for k, axis in zip((4, 7), s.axes, strict=True))
        encoder = nuisance[10:].reshape(-1, 2)
        before, after = starts + encoder[one], ends + encoder[two]
        inside = rotation(-0.5 * (before + after)[:, 1:] * s.axes[1]) @ outer
        angle = (after - before)[np.arange(len(joints)), joints, None]
        earth = rotation(-nuisance[3] * UP) @ s.earth
        platform = np.where(joints[:, None] == 1, inner, inside) * angle + (earth @ C) * duration[:, None]
        return (platform @ (matrix(p, "gyro") @ mount.T).T + p[AT["gyro_bias"]] * duration[:, None]).ravel()

    encoders = [s.sigma["encoder"]] * (2 * number)
    sigma = np.array([*[s.sigma["mount"]] * 3, s.sigma["azimuth"], *[AXIS_SIGMA] * 6, *encoders])
    variance = np.repeat(s.rate_noise * duration + 2.0 * s.drift[0] ** 2 / DRIFT_TIME * duration**3 / 3.0, 3)
    return Batch(model, totals.ravel(), variance, sigma)


def position_equations(stage, s, prior):
    """Return the equations of rests in many positions: gravity in b, whose direction is free within the mounting."""
    found = [rest for rest in rests(stage, s, prior) if (rest[1] - rest[0]) * s.dt >= SHORTEST]
    if len(found) < 6:
        raise NotCoveredError(f"the stage {stage.name} with fewer than six rests")
    forces, variances = (np.array(column) for column in zip(*(mean_force(stage, s, *r) for r in found), strict=True))
    up = (s.platform(np.array([mean_angles(stage, rest) for rest in found])) @ s.orientation)[:, 2]
    force = compensated(prior.mean, np.zeros_like(forces) + prior.mean[AT["gyro_bias"]], forces)[1]
    if np.min(np.sum(force * up, axis=1) / np.linalg.norm(force, axis=1)) < np.cos(10.0 * s.sigma["tilt"]):
        raise NotCoveredError("gravity that contradicts the angles of the table")
    # two directions perpendicular to the nominal one
    one = np.cross(up, np.eye(3)[np.argmin(np.abs(up), axis=1)])
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    frame = np.stack([one, np.cross(up, one)], axis=2)

    def model(p, tilts, error):
        f = s.gravity * (1.0 + error) * turned(rotation(turned(frame, tilts.reshape(-1, 2))), up)
        return (f @ matrix(p, "accel").T + p[AT["accel_quadratic"]] * f**2 + p[AT["accel_bias"]]).ravel()

    return Batch(model, forces.ravel(), np.repeat(variances, 3), np.full(2 * len(found), s.sigma["tilt"]))
