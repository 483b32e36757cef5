"""Motions of a gimbal recording (turns of one joint and returns to zero), and their least-squares fit.

The fit compares the rotation of every motion measured by the gyros with that of the joints:

    Exp(−Ω T) C_before B(gyro parameters) = C_after,  C from the joints, B the body rotation from the compensated gyros
"""

from dataclasses import dataclass

import numpy as np

from calstation.errors import InputError, InsufficientDataError
from calstation.estimation.common import (
    SHORTEST_REST,
    ImuModel,
    Posterior,
    SampleBlock,
    SolveContext,
    StageData,
    filter_noise,
    find_stillness,
    gauss_newton,
    stage_data,
)
from calstation.estimation.gimbal.iteration import drift_matrix, gimbal_attitude, joints_after_turn, other_axes
from calstation.estimation.positions import GYRO_COLUMNS, gyro_derivative, integrate_rotation, square_root
from calstation.physics import AXES, COUNT, GYRO_BIAS, RATE, FloatArray, compensation, rotation_matrix, rotation_vector

#: Largest angle at which a joint counts as being at zero, rad.
ZERO_TOLERANCE = np.deg2rad(2.0)
#: Smallest rotation of a joint in a turn, rad; a smaller rotation is drift.
MIN_JOINT_TURN = np.deg2rad(5.0)
#: Duration of the part of a rest next to a motion from which the joint rates are determined, s.
RATE_FIT = 3.0
#: Duration of the part of a rest next to a motion whose mean gyro output is subtracted, s. It equals the shortest
#: stabilised rest, because a small return to zero after a rest does not end the rest.
MEAN_FIT = 2.0
#: Duration of the part of a rest next to a motion from which the joint angles are determined, s.
ANGLE_FIT = 0.3
MAX_ITERATIONS = 12


@dataclass(frozen=True)
class Motion:
    """A motion between two rests."""

    start: int  #: Index of the first sample.
    stop: int  #: Index after the last sample.
    before: FloatArray  #: Joints x, y, z at the start of the motion, rad, shape (3,).
    after: FloatArray  #: Joints x, y, z at the end of the motion, rad, shape (3,).
    drift: FloatArray  #: Joint rates at the rest before, rad/s, shape (3,).
    rest: float  #: Duration of the fit of these rates, s.
    duration: float  #: s
    between: tuple[int, int]  #: Indices of the rests before and after the motion.
    rotation: FloatArray  #: Integral of the gyro output minus its mean over the adjacent rests, rad, shape (3,).

    @property
    def axis(self) -> int | None:
        """Index of the joint that moved most; None if no joint moved."""
        change = np.abs(self.after - self.before)
        return int(np.argmax(change)) if change.max() > MIN_JOINT_TURN else None

    @property
    def to_zero(self) -> bool:
        """Whether the motion ends with all joints near zero and begins elsewhere."""
        return bool(np.abs(self.before).max() > ZERO_TOLERANCE and np.abs(self.after).max() < ZERO_TOLERANCE)

    @property
    def angle(self) -> float:
        """Angle of the joint that moved most, rad."""
        change = self.after - self.before
        return float(change[int(np.argmax(np.abs(change)))])

    def cross_rotation(self, axis: int, correction: FloatArray) -> float:
        """Return the rotation about the axes other than `axis`, rad, from the rates corrected with K, shape (3, 3).

        It is zero for a gimbal that stabilises on these rates.
        """
        corrected = np.linalg.solve(np.eye(3) + correction, self.rotation)
        return float(np.linalg.norm(corrected[other_axes(axis)]))

    def joint_drift(self, axis: int, order: str) -> FloatArray:
        """Return D, the drift of the joints other than `axis`, converted to the same turn from zero, rad, shape (2,).

        The drift is the deviation from the ideal turn about the body axis, minus the drift at rest.
        """
        rows, angle = other_axes(axis), self.angle
        J = drift_matrix(order, axis, angle, self.before)
        start = gimbal_attitude(order, self.before)
        at_rest = rotation_vector(start.T @ gimbal_attitude(order, self.before + self.drift * self.duration))
        deviation = self.after - joints_after_turn(order, self.before, axis, angle)
        deviation = (deviation + np.pi) % (2.0 * np.pi) - np.pi
        drift = deviation[rows] - J @ at_rest[rows] / angle
        if np.abs(deviation[rows]).max() > MIN_JOINT_TURN:
            raise InputError("recording.two_joints_turned", axis=AXES[axis])
        return np.asarray(drift_matrix(order, axis, angle) @ np.linalg.solve(J, drift))


def find_motions(data: StageData, imu: ImuModel) -> list[Motion]:
    """Return the motions of a recording in order. Raises InputError or InsufficientDataError if it cannot be used."""
    if data.joints.shape[1] != 3:
        raise InputError("recording.no_joint_angles")
    still = find_stillness(data, imu)
    motions = []
    for link in still.links:
        first, second = still.rests[link.first], still.rests[link.second]
        before, after = _joint_line(data, first, end=True), _joint_line(data, second, end=False)
        if before is not None and after is not None:
            rest = min((first[1] - first[0]) * data.dt, RATE_FIT)
            duration = (link.stop - link.start) * data.dt
            between = (link.first, link.second)
            near = round(MEAN_FIT / data.dt)
            intervals = (max(first[0], first[1] - near), first[1]), (second[0], min(second[1], second[0] + near))
            at_rest = [data.gyro[slice(*interval)].mean(axis=0) for interval in intervals]
            rotation = (data.gyro[link.start : link.stop] - 0.5 * (at_rest[0] + at_rest[1])).sum(axis=0) * data.dt
            ends = (before[0], after[0], before[1])
            motions.append(Motion(link.start, link.stop, *ends, rest, duration, between, rotation))
    if not any(m.axis is not None for m in motions):
        raise InsufficientDataError("recording.no_joint_turn", seconds=SHORTEST_REST, motions=len(motions))
    return motions


def joint_turn(blocks: list[SampleBlock], imu: ImuModel, begin: int, axis: int) -> Motion:
    """Return the only motion after sequence number `begin`. Raises InputError unless it is a turn about `axis`."""
    data = stage_data(blocks, imu)
    motions = [m for m in find_motions(data, imu) if data.seq[m.stop - 1] > begin]
    if len(motions) != 1 or motions[0].axis != axis:
        raise InputError("recording.joint_turn_not_seen", axis=AXES[axis])
    return motions[0]


def _joint_line(data: StageData, rest: tuple[int, int], end: bool) -> tuple[FloatArray, FloatArray] | None:
    """Return joint angles, rad, shape (3,), and rates, rad/s, shape (3,), at the end (`end`) or start of a rest.

    The rates require a long fit. The angles require a short fit, because gyro noise makes the gimbal drift.
    """
    a, b = rest
    long, short = (
        (max(a, b - round(seconds / data.dt)), b) if end else (a, min(b, a + round(seconds / data.dt)))
        for seconds in (RATE_FIT, ANGLE_FIT)
    )
    polled = long[0] + np.flatnonzero(~np.isnan(data.joints[slice(*long)]).any(axis=1))
    if len(polled) < 3:
        return None
    near = polled[(polled >= short[0]) & (polled < short[1])]
    if not len(near):  # joints polled less often than `ANGLE_FIT`
        near = polled[-1:] if end else polled[:1]
    slope = np.polyfit(polled * data.dt, data.joints[polled], 1)[0]
    edge = b if end else a
    value = data.joints[near].mean(axis=0) + slope * (edge - 0.5 - float(near.mean())) * data.dt
    return np.asarray(value), np.asarray(slope)


@dataclass(frozen=True)
class GimbalFit:
    """Solution of the least-squares fit."""

    posterior: Posterior  #: Posterior of the parameters.
    chi2: float  #: Sum of the squared residuals in units of sigma.
    freedom: float  #: Degrees of freedom of the residuals.
    residual: FloatArray  #: Residual of every motion, rad, shape (n, 3).


def fit_gimbal(
    data: StageData, motions: list[Motion], order: str, context: SolveContext, prior: Posterior, joint_sigma: float
) -> GimbalFit:
    """Fit the gyro rotations of all motions of a gimbal to the rotations of its joints.

    Parameters
    ----------
    data, motions : samples, and the motions between their rests
    order : names of the joints from the base to the unit
    context, prior : noise of the profiles, and the estimate before the stage
    joint_sigma : sigma of an attitude from the joints at a rest, per axis, rad
    """
    noise = filter_noise(context)
    sigma = np.sqrt(np.repeat([noise.rate * m.duration for m in motions], 3))
    root = square_root(prior.covariance)
    # gyro noise is independent for each motion; joint errors are shared with the preceding and the following motion
    rests = 1 + max(max(m.between) for m in motions)
    scale = np.concatenate([[RATE] * 3, np.full(3 * rests, joint_sigma)])
    start = prior.mean.copy()
    measured = np.median(data.gyro[: round(1.0 / data.dt)], axis=0)
    start[GYRO_BIAS] = np.where(prior.sigma[GYRO_BIAS] > RATE, measured, start[GYRO_BIAS])

    def step(unknowns: tuple[FloatArray, FloatArray]) -> tuple[tuple[FloatArray, FloatArray], GimbalFit, float]:
        point, nuisance = unknowns
        H, r = _rows(data, motions, order, point, nuisance)
        innovation = (r + H[:, :COUNT] @ (point - prior.mean) + H[:, COUNT:] @ nuisance) / sigma
        columns = np.hstack([H[:, :COUNT] @ root, H[:, COUNT:] * scale]) / sigma[:, None]
        covariance = np.linalg.inv(columns.T @ columns + np.eye(columns.shape[1]))
        x = covariance @ (columns.T @ innovation)
        mean, posterior_covariance = prior.mean + root @ x[:COUNT], root @ covariance[:COUNT, :COUNT] @ root.T
        width = np.sqrt(np.diag(posterior_covariance))
        change = float(np.max(np.abs(mean - point) / np.where(width > 0.0, width, 1.0)))
        rest = innovation - columns @ x
        freedom = len(innovation) - float(np.einsum("ij,jk,ik->", columns, covariance, columns))
        posterior = Posterior(mean, 0.5 * (posterior_covariance + posterior_covariance.T))
        fit = GimbalFit(posterior, float(rest @ rest), freedom, (rest * sigma).reshape(-1, 3))
        return (mean, scale * x[COUNT:]), fit, change

    return gauss_newton(step, (start, np.zeros(len(scale))), MAX_ITERATIONS)[1]


def _rows(
    data: StageData, motions: list[Motion], order: str, point: FloatArray, nuisance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives, shape (3 n, 33 + 3 rests), and the residuals, rad, shape (3 n,).

    `nuisance` contains earth rate, rad/s, and the joint errors at rests as rotation vectors, rad, in the base frame.
    """
    c, earth, joint_errors = compensation(point), nuisance[:3], nuisance[3:].reshape(-1, 3)
    H, residuals = np.zeros((3 * len(motions), COUNT + len(nuisance))), []
    for k, m in enumerate(motions):
        B, time, rate = integrate_rotation(c.gyro_inverse, c.gyro_bias, data.dt, data.gyro, m.start, m.stop)
        first, second = m.between
        before = rotation_matrix(joint_errors[first]) @ gimbal_attitude(order, m.before)
        start = rotation_matrix(-earth * m.duration) @ before
        rows = slice(3 * k, 3 * k + 3)
        H[rows, GYRO_COLUMNS] = gyro_derivative(start, c, time, rate)
        H[rows, COUNT : COUNT + 3] = -m.duration * np.eye(3)
        H[rows, COUNT + 3 + 3 * first : COUNT + 6 + 3 * first] = np.eye(3)
        H[rows, COUNT + 3 + 3 * second : COUNT + 6 + 3 * second] = -np.eye(3)
        after = rotation_matrix(joint_errors[second]) @ gimbal_attitude(order, m.after)
        residuals.append(rotation_vector(after @ (start @ B).T))
    return H, np.concatenate(residuals)
