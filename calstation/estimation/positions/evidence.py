"""Evidence from a stage for the product's checks: rests, and rotations measured by the gyros."""

from dataclasses import dataclass

import numpy as np

from calstation.estimation.common import SolveContext, StageData, find_stillness, mean_angles
from calstation.estimation.positions.rows import GYRO_COLUMNS, gyro_derivative, integrate_rotation
from calstation.physics import (
    FloatArray,
    compensate,
    compensation,
    rotation_matrix,
    rotation_vector,
)

SHORTEST_REST = 1.0


@dataclass(frozen=True)
class RestEvidence:
    """A rest: its first and last sequence number, its duration, s, and the means over it."""

    first_seq: int
    last_seq: int
    duration: float
    force: FloatArray  #: Raw force, m/s², shape (3,).
    rate: FloatArray  #: Raw rate, rad/s, shape (3,).
    angles: FloatArray | None  #: Encoder angles, rad, shape (2,); None if they were not polled.

    def compensated(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rate, rad/s, and specific force, m/s², compensated with these parameters, shape (3,) each."""
        omega, force = compensate(compensation(parameters), self.rate[None], self.force[None])
        return omega[0], force[0]


@dataclass(frozen=True)
class MotionEvidence:
    """An uninterrupted motion between two rests."""

    before: int  #: Index of the rest before the motion.
    after: int  #: Index of the rest after the motion.
    first_seq: int
    last_seq: int
    duration: float  #: s
    path: float  #: Integral of the magnitude of the rate, rad.
    uncalibrated: FloatArray  #: Body rotation with the parameters before the calibration, shape (3, 3).
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


def gather(stage: str, data: StageData, context: SolveContext, before: FloatArray, found: FloatArray) -> Evidence:
    """Collect the evidence of a stage with the parameters before the calibration and those found, SI, shape (30,)."""
    still = find_stillness(data, context.imu, SHORTEST_REST)
    rests = tuple(
        RestEvidence(
            int(data.seq[a]),
            int(data.seq[b - 1]),
            (b - a) * data.dt,
            data.accel[a:b].mean(axis=0),
            data.gyro[a:b].mean(axis=0),
            mean_angles(data, a, b),
        )
        for a, b in still.rests
    )
    c, old = compensation(found), compensation(before)
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
                first_seq=int(data.seq[link.start]),
                last_seq=int(data.seq[link.stop - 1]),
                duration=(link.stop - link.start) * data.dt,
                path=float(np.linalg.norm(omega, axis=1).sum()) * data.dt,
                uncalibrated=uncalibrated,
                point=found,
                rotation=B,
                derivative=gyro_derivative(np.eye(3), c, time, rate),
            )
        )
    return Evidence(stage, rests, tuple(motions))


def turned_angle(rotation: FloatArray, earth: FloatArray, duration: float, path: float) -> float:
    """Return the angle of a body rotation relative to the ground, including whole revolutions, rad.

    `earth` is the earth rate in b before the rotation, rad/s; `path`, rad, determines the number of revolutions.
    """
    angle = float(np.linalg.norm(rotation_vector(rotation_matrix(-earth * duration) @ rotation)))
    turns = 2.0 * np.pi * np.arange(int(path / (2.0 * np.pi)) + 2)
    candidates = np.concatenate([turns + angle, turns - angle])
    return float(candidates[int(np.argmin(np.abs(candidates - path)))])


def gravity_misses(evidence: Evidence, motion: MotionEvidence, found: FloatArray) -> tuple[float, float]:
    """Return the angles, rad, between gravity after a motion and its gyro prediction, before and after compensation.

    In both cases gravity is measured by the accelerometers with the parameters `found`.
    """
    earth, up = evidence.rests[motion.before].compensated(found)
    seen = evidence.rests[motion.after].compensated(found)[1]
    misses = []
    for rotation in (motion.uncalibrated, motion.calibrated(found)):
        carried = (rotation_matrix(-earth * motion.duration) @ rotation).T @ up
        cosine = carried @ seen / np.linalg.norm(carried) / np.linalg.norm(seen)
        misses.append(float(np.arccos(np.clip(cosine, -1.0, 1.0))))
    return misses[0], misses[1]
