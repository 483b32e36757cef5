"""Rests of a stage and rotations measured by the gyros, for the product's checks."""

from dataclasses import dataclass, field

import numpy as np

from calstation.estimation.common import (
    RestNoise,
    SolveContext,
    StageData,
    find_stillness,
    mean_angles,
    rest_force,
    rest_mean_variance,
    rest_noise,
    rest_weights,
    with_measured_noise,
)
from calstation.estimation.positions.rows import GYRO_COLUMNS, gyro_derivative, integrate_rotation
from calstation.physics import (
    COUNT,
    FloatArray,
    TableGeometry,
    compensate,
    compensation,
    group_vector,
    rotation_matrix,
    rotation_vector,
)


@dataclass(frozen=True)
class RestEvidence:
    """A rest: its duration, s, and its mean values."""

    duration: float
    force: FloatArray  #: Raw force, averaged with `slope_weights`, m/s², shape (3,).
    rate: FloatArray  #: Raw rate, rad/s, shape (3,).
    angles: FloatArray | None  #: Encoder angles, rad, shape (2,); None if they were not polled.
    force_sigma: float = 0.0  #: Sigma of each component of `force`, m/s².
    excess_sigma: float = 0.0  #: Increase of this sigma due to noise above the profiles', m/s².
    #: Raw rate, averaged with `slope_weights`, rad/s, shape (3,), which rocking of the table changes less than `rate`.
    steady_rate: FloatArray = field(default_factory=lambda: np.zeros(3))

    def compensated(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rate, rad/s, and specific force, m/s², compensated with these parameters, shape (3,) each."""
        omega, force = compensate(compensation(parameters), self.rate[None], self.force[None])
        return omega[0], force[0]

    def earth_rate(self, parameters: FloatArray) -> FloatArray:
        """Return `steady_rate` compensated with these parameters, rad/s, shape (3,)."""
        omega, _ = compensate(compensation(parameters), self.steady_rate[None], self.force[None])
        return np.asarray(omega[0])


@dataclass(frozen=True)
class MotionEvidence:
    """An uninterrupted motion between two rests."""

    before: int  #: Index of the rest before the motion.
    after: int  #: Index of the rest after the motion.
    duration: float  #: s
    path: float  #: Integral of the magnitude of the rate, rad.
    uncalibrated: FloatArray  #: Body rotation with the parameters `Evidence.before`, shape (3, 3).
    point: FloatArray  #: Parameters of the stage solution, SI, shape (30,).
    rotation: FloatArray  #: Body rotation with the parameters `point`, shape (3, 3).
    #: Derivative of `rotation` with respect to `GYRO_COLUMNS`, a rotation vector in b at the first rest, shape (3, 12).
    derivative: FloatArray

    def calibrated(self, parameters: FloatArray) -> FloatArray:
        """Return the body rotation with parameters near the stage solution, shape (3, 3)."""
        change = (parameters - self.point)[GYRO_COLUMNS]
        return np.asarray(rotation_matrix(self.derivative @ change) @ self.rotation)


@dataclass(frozen=True)
class Evidence:
    """Rests and motions of a stage, in order."""

    stage: str
    rests: tuple[RestEvidence, ...]
    motions: tuple[MotionEvidence, ...]
    #: Parameters that correct the output compared with the calibrated output, SI, shape (30,); 0 for raw output.
    before: FloatArray = field(default_factory=lambda: np.zeros(COUNT))


def gather(
    stage: str,
    data: StageData,
    context: SolveContext,
    before: FloatArray,
    parameters: FloatArray,
    noise: RestNoise | None = None,
) -> Evidence:
    """Collect the evidence of a stage.

    Parameters
    ----------
    stage, data, context : name of the stage, its samples, noise of the profiles
    before, parameters : parameters before the stage and near its solution, SI, shape (30,) each
    noise : noise at the rests; None to measure it, if there are gyros
    """
    still, noisy = find_stillness(data, context.imu), context
    if data.has_gyros:
        measured = noise or rest_noise(data, context, (group_vector(parameters, "gyro_bias"), 0.0))
        noisy = with_measured_noise(context, measured)
    rests = []
    for a, b in still.rests:
        force, variance = rest_force(data, context, a, b)
        sigma = float(np.sqrt(rest_mean_variance(noisy, (b - a) * data.dt)))
        rate, steady = data.gyro[a:b].mean(axis=0), rest_weights(data, context, a, b) @ data.gyro[a:b]
        excess, angles = sigma - float(np.sqrt(variance)), mean_angles(data, a, b)
        rests.append(RestEvidence((b - a) * data.dt, force, rate, angles, sigma, excess, steady))
    c, old = compensation(parameters), compensation(before)
    motions = []
    for link in still.links:
        span = (data.dt, data.gyro, link.start, link.stop)
        B, time, rate = integrate_rotation(c.gyro_inverse, c.gyro_bias, *span)
        uncalibrated, _, _ = integrate_rotation(old.gyro_inverse, old.gyro_bias, *span)
        omega, _ = compensate(c, data.gyro[link.start : link.stop], data.accel[link.start : link.stop])
        motions.append(
            MotionEvidence(
                before=link.first,
                after=link.second,
                duration=(link.stop - link.start) * data.dt,
                path=float(np.linalg.norm(omega, axis=1).sum()) * data.dt,
                uncalibrated=uncalibrated,
                point=parameters,
                rotation=B,
                derivative=gyro_derivative(np.eye(3), c, time, rate),
            )
        )
    return Evidence(stage, tuple(rests), tuple(motions), before)


@dataclass(frozen=True)
class Turn:
    """Rotation between two rests in an uninterrupted chain of motions, measured by the gyros."""

    before: int  #: Index of the first rest.
    after: int  #: Index of the second rest.
    duration: float  #: s
    path: float  #: Integral of the magnitude of the rate over the motions, rad.
    uncalibrated: FloatArray  #: Body rotation with the parameters `Evidence.before`, shape (3, 3).
    calibrated: FloatArray  #: Body rotation with the solved parameters, shape (3, 3).


def turn_between(evidence: Evidence, first: int, second: int, parameters: FloatArray) -> Turn | None:
    """Return the rotation from one rest to a later one; None if no uninterrupted chain of motions connects them.

    `parameters` are near the stage solution, SI, shape (30,). The rotation during the rests in between is computed from
    their mean rate, which includes earth rate.
    """
    motions = {motion.before: motion for motion in evidence.motions}
    uncalibrated = calibrated = np.eye(3)
    duration = path = 0.0
    for k in range(first, second):
        motion, rest = motions.get(k), evidence.rests[k]
        if motion is None:
            return None
        if k > first:
            uncalibrated = uncalibrated @ rotation_matrix(rest.compensated(evidence.before)[0] * rest.duration)
            calibrated = calibrated @ rotation_matrix(rest.compensated(parameters)[0] * rest.duration)
            duration += rest.duration
        uncalibrated, calibrated = uncalibrated @ motion.uncalibrated, calibrated @ motion.calibrated(parameters)
        duration, path = duration + motion.duration, path + motion.path
    return Turn(first, second, duration, path, uncalibrated, calibrated)


def angle_errors(
    evidence: Evidence, turn: Turn, parameters: FloatArray, axes: TableGeometry | None
) -> tuple[float, float, float]:
    """Return the errors of the angle between two rests, rad, from uncalibrated and from calibrated gyros.

    The reference is the encoders of a table with known `axes`, or gravity without a table or encoder angles. The third
    value is the sigma of the angle between the directions of gravity at both rests; 0 for encoders.
    """
    first, second = evidence.rests[turn.before], evidence.rests[turn.after]
    if axes is None or first.angles is None or second.angles is None:
        gravity = float(np.linalg.norm(first.force))
        return *gravity_errors(evidence, turn, parameters), float(
            np.hypot(first.force_sigma, second.force_sigma)
        ) / gravity
    earth = first.earth_rate(parameters)
    reference = axes.body_to_home(*first.angles).T @ axes.body_to_home(*second.angles)
    angles = [_angle(reference)]
    angles += [_angle(rotation_matrix(-earth * turn.duration) @ B) for B in (turn.uncalibrated, turn.calibrated)]
    return abs(angles[1] - angles[0]), abs(angles[2] - angles[0]), 0.0


def gravity_errors(evidence: Evidence, turn: Turn, parameters: FloatArray) -> tuple[float, float]:
    """Return the angles between up at the second rest and its gyro prediction, uncalibrated and calibrated, rad.

    In both cases up is measured by the accelerometers compensated with `parameters`.
    """
    earth, up = (
        evidence.rests[turn.before].earth_rate(parameters),
        evidence.rests[turn.before].compensated(parameters)[1],
    )
    measured = evidence.rests[turn.after].compensated(parameters)[1]
    errors = []
    for rotation in (turn.uncalibrated, turn.calibrated):
        predicted = (rotation_matrix(-earth * turn.duration) @ rotation).T @ up
        cosine = predicted @ measured / np.linalg.norm(predicted) / np.linalg.norm(measured)
        errors.append(float(np.arccos(np.clip(cosine, -1.0, 1.0))))
    return errors[0], errors[1]


def _angle(rotation: FloatArray) -> float:
    return float(np.linalg.norm(rotation_vector(rotation)))
