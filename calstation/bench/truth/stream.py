"""The unit's output as it comes: truth, vibration, noise and counts, continued from call to call."""

from dataclasses import dataclass

import numpy as np

from calstation.bench.truth.compiled import compiled
from calstation.bench.truth.imu import ImuTruth, digitise, true_increments
from calstation.bench.truth.kinematics import JointProfile
from calstation.bench.truth.noise import (
    INSTABILITY_TIMES,
    instability_steps,
    instability_variance,
    vibration_steps,
)
from calstation.bench.truth.table import TableTruth
from calstation.physics.arrays import BoolArray, FloatArray


@compiled
def shake(state: FloatArray, transition: FloatArray, root: FloatArray, normals: FloatArray) -> FloatArray:
    """Base velocities at the samples' borders, m/s, shape (n + 1, 3); `state` (2, 3) moves along."""
    velocity = np.empty((normals.shape[0] + 1, 3))
    velocity[0] = state[1]
    for n in range(normals.shape[0]):
        for i in range(3):
            x, v = state[0, i], state[1, i]
            first, second = normals[n, 2 * i], normals[n, 2 * i + 1]
            state[0, i] = transition[0, 0] * x + transition[0, 1] * v + root[0, 0] * first
            state[1, i] = (
                transition[1, 0] * x + transition[1, 1] * v + root[1, 0] * first + root[1, 1] * second
            )
            velocity[n + 1, i] = state[1, i]
    return velocity


@dataclass(frozen=True)
class StreamOutput:
    """Counts, shape (n, 6), and whether a channel saturated, shape (n,)."""

    counts: FloatArray
    saturated: BoolArray


class SensorStream:
    """Samples of one unit on one table, one after another; how they are asked for does not change them.

    Parameters
    ----------
    imu, table : truth
    seed : of all noise of the stream
    """

    def __init__(self, imu: ImuTruth, table: TableTruth, seed: int | np.random.SeedSequence) -> None:
        self.interval = 1.0 / imu.sample_rate
        self.produced = 0
        self._random = np.random.Generator(np.random.PCG64(seed))
        self._model = imu.error_model()
        self._chain = table.chain()
        self._field = np.array([table.up_force_n, table.earth_rate_n])
        self._white = np.repeat([imu.gyro_arw, imu.accel_vrw], 3) * np.sqrt(self.interval)
        self._as_rate = imu.output == "rate"
        self._lsb = np.repeat([imu.gyro_lsb, imu.accel_lsb], 3)
        reach = np.repeat([imu.gyro_range, imu.accel_range], 3) * (1.0 if self._as_rate else self.interval)
        self._limit = np.floor(reach / self._lsb)
        self._remainder = np.zeros(6)
        instability = np.repeat([imu.gyro_bias_instability, imu.accel_bias_instability], 3)
        self._drift = bool(instability.any())
        self._decay, self._driven = instability_steps(instability, self.interval)
        self._bias = np.zeros((6, len(INSTABILITY_TIMES)))
        if self._drift:
            sigma = np.sqrt(instability_variance(instability))[:, None]
            self._bias = sigma * self._random.standard_normal(self._bias.shape)
        else:
            self._decay, self._driven, self._bias = np.zeros(0), np.zeros((6, 0)), np.zeros((6, 0))
        self._shaken = table.velocity_sigma > 0.0
        self._transition, self._root, stationary = vibration_steps(table.velocity_sigma, self.interval)
        self._base = np.zeros((2, 3))
        if self._shaken:
            self._base = stationary[:, None] * self._random.standard_normal((2, 3))
        self._columns = 6 + self._bias.size + (6 if self._shaken else 0)

    @property
    def time(self) -> float:
        """End of the last sample produced, s."""
        return self.produced * self.interval

    def produce(self, count: int, outer: JointProfile, inner: JointProfile) -> StreamOutput:
        """The next `count` samples while the joints follow these profiles."""
        normals = self._random.standard_normal((count, self._columns))
        if self._shaken:
            velocity = shake(self._base, self._transition, self._root, normals[:, -6:])
        else:
            velocity = np.zeros((count + 1, 3))
        increments = true_increments(
            self._model,
            self._chain,
            self._field,
            outer.segments,
            outer.still,
            inner.segments,
            inner.still,
            self.produced,
            self.interval,
            velocity,
        )
        counts, saturated = digitise(
            increments,
            normals,
            self._white,
            self._decay,
            self._driven,
            self._bias,
            self._lsb,
            self._limit,
            self.interval,
            self._as_rate,
            self._remainder,
        )
        self.produced += count
        return StreamOutput(counts, saturated)
