"""Noise measured in the data of a stage, which widens the noise of the profiles where it is larger."""

from dataclasses import dataclass, replace

import numpy as np

from calstation.estimation.common.context import SolveContext
from calstation.estimation.common.model_test import Misfit, ModelTest
from calstation.estimation.common.noise import filter_noise
from calstation.estimation.common.stage import StageData, find_rests
from calstation.physics import CHANNELS, FloatArray

#: Noise beyond this ratio to the profile's fails a unit or a table; less of it widens the sigmas.
MOST_NOISE = 3.0
#: Averaging time at which the angle random walk dominates, s.
_GYRO_TIME = 1.0
#: An excess below this many of its own standard deviations, or below this ratio, is the scatter of the measurement.
_SIGMAS, _LEAST_EXCESS = 5.0, 1.05


@dataclass(frozen=True)
class RestNoise:
    """Noise at rest in units of that of the profiles, from `count` independent values."""

    gyro: FloatArray  #: Angle random walk of each gyro, shape (3,).
    velocity: float  #: Velocity of the table.
    count: int

    def excess(self, ratio: float) -> float:
        """Return a ratio that is significantly larger than 1, otherwise 1."""
        return ratio if ratio > max(_LEAST_EXCESS, 1.0 + _SIGMAS * np.sqrt(0.75 / max(self.count, 1))) else 1.0

    @property
    def noisiest(self) -> str:
        """Name of the gyro channel with the most noise."""
        return CHANNELS[int(np.argmax(self.gyro))]


def rest_noise(data: StageData, context: SolveContext, bias: FloatArray, bias_sigma: float) -> RestNoise:
    """Measure the noise at all rests; `bias` and `bias_sigma` of the gyros are for finding them, as in `find_rests`.

    The gyros' Allan variance at 1 s is that of the angle random walk. The velocity changes of the table between
    observations, its velocity being white, have a covariance of −σ_v² with their neighbours; the accelerometers' own
    noise has none (IEEE Std 952-2020, annex C).
    """
    noise = filter_noise(context)
    stride, wide = (max(round(t / data.dt), 1) for t in (noise.interval, _GYRO_TIME))
    gyro, velocity = [np.empty((0, 3))], [np.empty((0, 3))]
    for segment in data.segments:
        for a, b in find_rests(data, segment, context.imu, bias, bias_sigma):
            gyro.append(np.diff(_means(data.gyro[a:b], wide), axis=0))
            change = _means(data.accel[a:b], stride) * stride * data.dt
            change = change - change.mean(axis=0) if len(change) else change
            velocity.append(change[1:] * change[:-1])
    steps, products = np.concatenate(gyro), np.concatenate(velocity)
    if len(steps) < 2:
        return RestNoise(np.ones(3), 1.0, 0)
    allan = 0.5 * np.mean(steps**2, axis=0) * wide * data.dt
    variance = max(float(-np.mean(products)), 0.0)
    return RestNoise(np.sqrt(allan / noise.rate), float(np.sqrt(variance / noise.velocity)), len(steps))


def widened(context: SolveContext, measured: RestNoise) -> SolveContext:
    """Return the context with the noise of the gyros, and of the table at rest, that was measured if it is larger."""
    gyro, velocity = measured.excess(float(measured.gyro.max())), measured.excess(measured.velocity)
    imu = (
        replace(context.imu, gyro_arw=gyro * float(np.sqrt(filter_noise(context).rate))) if gyro > 1.0 else context.imu
    )
    table = replace(context.table, velocity_sigma=velocity * context.table.velocity_sigma)
    return replace(context, imu=imu, table=table)


def noise_tests(profile: SolveContext, used: SolveContext, measured: RestNoise) -> tuple[ModelTest, ...]:
    """Return the tests of the noise that was measured, and used for the solution, against that of the profiles."""
    table = used.table.velocity_sigma / profile.table.velocity_sigma
    gyro = float(measured.gyro.max())
    vibrates = Misfit("table_vibrates", used.table.velocity_sigma, unit="m/s", values={"ratio": table})
    noisy = Misfit("gyro_noise", values={"ratio": gyro, "channel": measured.noisiest})
    return (
        ModelTest("table_noise", table, MOST_NOISE, "1", vibrates),
        ModelTest("imu_noise", gyro, MOST_NOISE, "1", noisy),
    )


def _means(values: FloatArray, width: int) -> FloatArray:
    """Return the means of consecutive groups of `width` rows."""
    count = len(values) // width
    return np.asarray(values[: count * width].reshape(count, width, values.shape[1]).mean(axis=1))
