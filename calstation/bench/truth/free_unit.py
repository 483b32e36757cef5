"""Output of one or several units on a freely moving body."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from calstation.bench.truth.free_motion import FreeMotion
from calstation.bench.truth.imu import GAUSS_NODES, GAUSS_WEIGHTS, Digitiser, ImuTruth, StreamOutput
from calstation.bench.truth.noise import Vibration
from calstation.physics import FloatArray, group_matrix, group_vector

_NODES, _WEIGHTS = np.array(GAUSS_NODES), np.array(GAUSS_WEIGHTS)
_CHUNK = 20_000


@dataclass(frozen=True)
class Mounting:
    """Position and orientation of a unit on the body.

    `turn` is the rotation from the unit's frame to the body's, shape (3, 3); `arm` is the position of the unit's
    reference point in the body's frame, m, shape (3,).
    """

    turn: FloatArray
    arm: FloatArray


class Motion(Protocol):
    """The motion of a body."""

    def states(
        self, times: FloatArray, up_force: FloatArray, earth: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return specific force, rate and angular acceleration as in `FreeMotion.states`."""


@dataclass(frozen=True)
class Field:
    """Specific force at rest, m/s², and earth rate, rad/s, in n, shape (3,), and rms vibration velocity, m/s."""

    up_force: FloatArray
    earth: FloatArray
    velocity_sigma: float = 0.0


def ideal_increments(
    imu: ImuTruth, motion: Motion, mounting: Mounting, field: Field, borders: FloatArray
) -> FloatArray:
    """Return noise-free increments, rad and m/s, shape (n, 6), between `borders`, s, shape (n + 1,)."""
    model = imu.error_model()
    result = np.empty((len(borders) - 1, 6))
    for first in range(0, len(result), _CHUNK):
        chunk = borders[first : first + _CHUNK + 1]
        width = np.diff(chunk)
        times = (chunk[:-1, None] + width[:, None] * _NODES).ravel()
        force, rate, acceleration = motion.states(times, field.up_force, field.earth)
        force = force + np.cross(rate, np.cross(rate, mounting.arm)) + np.cross(acceleration, mounting.arm)
        f, w, a = (v @ mounting.turn for v in (force, rate, acceleration))
        sensed = f.copy()
        for i in range(3):  # accelerometer i, whose position is row 9 + i of the model, senses along e_i
            site = model[9 + i]
            sensed[:, i] += (np.cross(w, np.cross(w, site)) + np.cross(a, site))[:, i]
        gyro = w @ model[0:3].T + model[6]
        accel = sensed @ model[3:6].T + model[8] * sensed**2 + model[7]
        rates = np.hstack([gyro, accel])
        weighted = rates.reshape(len(width), 3, 6) * (_WEIGHTS[:, None] * width[:, None, None])
        result[first : first + len(width)] = weighted.sum(axis=1)
    return result


class FreeStream:
    """Samples of one unit on a freely moving body; they do not depend on how many are requested at a time.

    The first sample begins at time `begin` of the motion, s; `gain` is the rate of the unit's clock. The generators of
    vibration and noise may be the same if there is only one request.
    """

    def __init__(
        self,
        imu: ImuTruth,
        mounting: Mounting,
        field: Field,
        vibration: np.random.Generator,
        noise: np.random.Generator,
        *,
        begin: float = 0.0,
        gain: float = 1.0,
    ) -> None:
        self.interval = 1.0 / imu.sample_rate
        self.produced = 0
        self._imu, self._mounting, self._field = imu, mounting, field
        self._random, self._noise = vibration, noise
        self._begin, self._width = begin, self.interval / gain
        self._vibration = Vibration(field.velocity_sigma, self.interval, vibration)
        self._digitiser = Digitiser(imu)

    def produce(self, count: int, motion: Motion) -> StreamOutput:
        """Return the next `count` samples of a body with this motion."""
        borders = np.asarray(
            self._begin + np.arange(self.produced, self.produced + count + 1) * self._width, dtype=np.float64
        )
        increments = ideal_increments(self._imu, motion, self._mounting, self._field, borders)
        if self._vibration.active:
            velocity = self._vibration.velocities(self._random.standard_normal((count, 6)))
            increments[:, 3:] += np.diff(velocity, axis=0)
        if self.produced == 0:
            self._digitiser.start_drift(self._noise)
        self.produced += count
        normals = self._noise.standard_normal((count, self._digitiser.columns))
        return self._digitiser.digitise(increments, normals)


@dataclass(frozen=True)
class SecondaryTruth:
    """A secondary IMU with its mounting; its time plus `offset`, s, is the primary's time."""

    imu: ImuTruth
    mounting: Mounting
    offset: float = 0.0


def record_pair(
    primary: ImuTruth,
    secondaries: list[SecondaryTruth],
    motion: FreeMotion,
    duration: float,
    field: Field,
    seed: int | np.random.SeedSequence,
) -> tuple[FloatArray, FloatArray]:
    """Return simultaneous counts of the primary at the reference point, shape (n, 6), and the secondaries, (n, k, 6).

    The vibration of the motion acts on all units; the vibration of the field, which differs between units, is omitted.
    """
    field = replace(field, velocity_sigma=0.0)
    root = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    count = int(duration * primary.sample_rate)
    units = [SecondaryTruth(primary, Mounting(np.eye(3), np.zeros(3))), *secondaries]
    counts = []
    for unit, unit_seed in zip(units, root.spawn(len(units)), strict=True):
        random = np.random.default_rng(unit_seed)
        stream = FreeStream(unit.imu, unit.mounting, field, random, random, begin=unit.offset)
        counts.append(stream.produce(count, motion).counts)
    return counts[0], np.stack(counts[1:], axis=1) if secondaries else np.empty((count, 0, 6))


def pair_truth(primary: ImuTruth, secondary: SecondaryTruth) -> dict[str, FloatArray]:
    """Return the true result of a cross-calibration: C and b of both sensors, the lever and the clock offset.

    The primary measures y = M₁ x + b₁, and the secondary M₂ Tᵀ x + b₂, where T rotates from its frame to the body's.
    Therefore C = M₂ Tᵀ M₁⁻¹ and b = b₂ − C b₁.
    """
    truth: dict[str, FloatArray] = {"lever": secondary.mounting.arm, "clock_offset": np.array(secondary.offset)}
    for sensor in ("gyro", "accel"):
        first, second = (
            np.eye(3) + group_matrix(imu.parameters, f"{sensor}_scale", f"{sensor}_misalign")
            for imu in (primary, secondary.imu)
        )
        C = second @ secondary.mounting.turn.T @ np.linalg.inv(first)
        truth[f"{sensor}_matrix"] = C
        truth[f"{sensor}_bias"] = group_vector(secondary.imu.parameters, f"{sensor}_bias") - C @ group_vector(
            primary.parameters, f"{sensor}_bias"
        )
    return truth
