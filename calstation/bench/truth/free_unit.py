"""What a unit on a freely moving body puts out: the error model over the motion, noise, counts."""

from dataclasses import dataclass

import numpy as np

from calstation.bench.truth.free_motion import FreeMotion
from calstation.bench.truth.imu import ImuTruth, digitise
from calstation.bench.truth.noise import (
    INSTABILITY_TIMES,
    instability_steps,
    instability_variance,
    vibration_steps,
)
from calstation.bench.truth.stream import StreamOutput, shake
from calstation.physics.arrays import BoolArray, FloatArray

#: Gauss-Legendre nodes and weights on (0, 1), exact to the fifth degree.
_NODES = np.array([0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15)])
_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
_CHUNK = 20_000


@dataclass(frozen=True)
class Place:
    """Where and how a unit sits on the body.

    turn : from the unit's frame to the body's, shape (3, 3)
    arm : of the unit's reference point from the body's, in the body's frame, m, shape (3,)
    """

    turn: FloatArray
    arm: FloatArray


@dataclass(frozen=True)
class Field:
    """Force of a body at rest (m/s²) and the earth's rotation (rad/s) in n, shape (3,); rms of its vibration, m/s."""

    up_force: FloatArray
    earth: FloatArray
    velocity_sigma: float = 0.0


def ideal_increments(
    imu: ImuTruth, motion: FreeMotion, place: Place, field: Field, borders: FloatArray
) -> FloatArray:
    """Increments of the six channels between `borders` (s, shape (n + 1,)) without noise, rad and m/s, shape (n, 6)."""
    model = imu.error_model()
    result = np.empty((len(borders) - 1, 6))
    for first in range(0, len(result), _CHUNK):
        cut = borders[first : first + _CHUNK + 1]
        width = np.diff(cut)
        times = (cut[:-1, None] + width[:, None] * _NODES).ravel()
        force, rate, acceleration = motion.states(times, field.up_force, field.earth)
        rates = _outputs(model, force, rate, acceleration, place)
        weighted = rates.reshape(len(width), 3, 6) * (_WEIGHTS[:, None] * width[:, None, None])
        result[first : first + len(width)] = weighted.sum(axis=1)
    return result


def _outputs(
    model: FloatArray, force: FloatArray, rate: FloatArray, acceleration: FloatArray, place: Place
) -> FloatArray:
    """The six channels from force, ω and ω' of the body's point, shape (n, 6)."""
    force = force + np.cross(rate, np.cross(rate, place.arm)) + np.cross(acceleration, place.arm)
    f, w, a = (v @ place.turn for v in (force, rate, acceleration))
    sensed = f.copy()
    for i in range(3):  # each accelerometer at its own place, row 9 + i of the model, senses along e_i
        site = model[9 + i]
        sensed[:, i] += (np.cross(w, np.cross(w, site)) + np.cross(a, site))[:, i]
    gyro = w @ model[0:3].T + model[6]
    accel = sensed @ model[3:6].T + model[8] * sensed**2 + model[7]
    return np.hstack([gyro, accel])


class FreeStream:
    """Samples of one unit on a freely moving body, one after another; how they are asked for does not change them.

    Parameters
    ----------
    vibration, noise : draw the body's vibration and the unit's noise; who asks once may give one for both
    begin : time of the motion at which the first sample begins, s

    Attributes
    ----------
    interval : of a sample, s; produced : samples so far
    """

    def __init__(
        self,
        imu: ImuTruth,
        place: Place,
        field: Field,
        vibration: np.random.Generator,
        noise: np.random.Generator,
        *,
        begin: float = 0.0,
    ) -> None:
        self.interval = 1.0 / imu.sample_rate
        self.produced = 0
        self._imu, self._place, self._field = imu, place, field
        self._vibration, self._noise = vibration, noise
        self._begin = begin
        self._shaken = field.velocity_sigma > 0.0
        if self._shaken:
            self._transition, self._root, stationary = vibration_steps(field.velocity_sigma, self.interval)
            self._base = stationary[:, None] * vibration.standard_normal((2, 3))
        self._instability = np.repeat([imu.gyro_bias_instability, imu.accel_bias_instability], 3)
        self._decay, self._driven = instability_steps(self._instability, self.interval)
        self._bank: FloatArray | None = None
        self._remainder = np.zeros(6)

    def produce(self, count: int, motion: FreeMotion) -> StreamOutput:
        """The next `count` samples of a body that moves so."""
        imu, interval = self._imu, self.interval
        borders = np.asarray(
            self._begin + np.arange(self.produced, self.produced + count + 1) * interval, dtype=np.float64
        )
        increments = ideal_increments(imu, motion, self._place, self._field, borders)
        if self._shaken:
            drawn = self._vibration.standard_normal((count, 6))
            velocity = shake(self._base, self._transition, self._root, drawn)
            increments[:, 3:] += np.diff(velocity, axis=0)
        if self._bank is None:
            sigma = np.sqrt(instability_variance(self._instability))[:, None]
            self._bank = sigma * self._noise.standard_normal((6, len(INSTABILITY_TIMES)))
        as_rate = imu.output == "rate"
        lsb = np.repeat([imu.gyro_lsb, imu.accel_lsb], 3)
        reach = np.repeat([imu.gyro_range, imu.accel_range], 3) * (1.0 if as_rate else interval)
        counts, saturated = digitise(
            increments,
            self._noise.standard_normal((count, 6 + self._bank.size)),
            np.repeat([imu.gyro_arw, imu.accel_vrw], 3) * np.sqrt(interval),
            self._decay,
            self._driven,
            self._bank,
            lsb,
            np.floor(reach / lsb),
            interval,
            as_rate,
            self._remainder,
        )
        self.produced += count
        return StreamOutput(counts, saturated)


def sampled(
    imu: ImuTruth,
    motion: FreeMotion,
    place: Place,
    field: Field,
    count: int,
    seed: int | np.random.SeedSequence,
    *,
    begin: float = 0.0,
) -> tuple[FloatArray, BoolArray]:
    """Counts, shape (count, 6), and saturation, shape (count,), of samples that start at `begin` s of the motion."""
    random = np.random.default_rng(seed)
    output = FreeStream(imu, place, field, random, random, begin=begin).produce(count, motion)
    return output.counts, output.saturated
