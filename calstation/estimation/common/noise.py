"""Noise of IMU and table: spectral densities from the profiles for the filters, and noise measured at rest.

If the noise measured in a stage exceeds the profile's, the larger value applies.
"""

from dataclasses import dataclass, replace

import numpy as np

from calstation.estimation.common.context import ImuModel, SolveContext
from calstation.estimation.common.model_test import Diagnosis, ModelTest
from calstation.estimation.common.stage import StageData, find_rests, group_means, slope_weights
from calstation.physics import CHANNELS, FloatArray

#: Correlation time of the Gauss-Markov process that models bias instability, s.
BIAS_DRIFT_TIME = 200.0
#: Sigma of that process in units of B, so that its Allan deviation at 100 s, half the correlation time, is 0.664 B.
BIAS_DRIFT_PER_INSTABILITY = 1.375
#: Rounding step, in sigmas of a sample's noise, above which averaging does not reduce the rounding error.
_COARSE = 2.5
#: Time for which such an error is constant, s: the duration of a rest or of a turn at constant rate.
_COARSE_TIME = 20.0
#: Ratio to the profile's noise above which a unit or a table fails; a smaller excess increases the sigmas.
MAX_NOISE = 3.0
#: Averaging times, s: white noise dominates at the first, slower noise at the second.
_TIMES = (1.0, 4.0)
#: Averaging time for gyros with a fine resolution, s, for which a few rests suffice.
_SHORT_TIME = 0.2
#: Largest share of rounding in the Allan variance at this time.
_FINE = 0.05
#: Median of the χ² distribution with 1 degree of freedom.
_MEDIAN = 0.4549
#: Relative uncertainty of the table's contribution to an Allan variance, because its velocity is not quite white.
_NOT_WHITE = 0.3
#: Smallest number of differences from which a variance is estimated.
_MIN_COUNT = 10
#: Smallest significant excess, in standard deviations and as a ratio; a smaller one is measurement scatter.
_SIGMAS, _MIN_EXCESS = 5.0, 1.05


@dataclass(frozen=True)
class FilterNoise:
    """Process and observation noise."""

    rate: float  #: Spectral density of the angle random walk, rad²/s.
    force: float  #: Spectral density of the velocity random walk, (m/s)²/s.
    velocity: float  #: Variance of a velocity observation, (m/s)².
    interval: float  #: Time between observations, s.
    end_rate: float  #: Variance of the angular rate at an observation, (rad/s)².
    #: Stationary sigma of each bias about its constant value, gyro x y z, accel x y z, rad/s and m/s², shape (6,).
    bias_drift: FloatArray


def filter_noise(context: SolveContext) -> FilterNoise:
    """Return the noise densities for a filter.

    Quantisation q has variance q²/12. A rate output rounds every sample independently, which is white noise at the
    sample rate. An increment output carries its remainder over to the next sample, so the error is one count per
    observation interval. Bias instability B has an Allan floor of 0.664 B (IEEE Std 952-2020, annex C). It is modelled
    as a first-order Gauss-Markov process about the constant bias, so that the estimate of the constant never degrades.
    Coarse rounding (see `coarse_rounding`) is also modelled as white noise that is constant for `_COARSE_TIME`.
    """
    imu, table = context.imu, context.table
    interval = table.velocity_interval
    per_count = 1.0 / imu.sample_rate if imu.output == "rate" else 1.0
    rounding_rate = imu.sample_rate if imu.output == "rate" else 1.0 / interval
    gyro_count, accel_count = (step * per_count for step in imu.quantisation)
    gyro_rounding, accel_rounding = coarse_rounding(imu)
    rate = imu.gyro_arw**2 + gyro_count**2 / 12.0 * rounding_rate + gyro_rounding**2 * _COARSE_TIME
    force = imu.accel_vrw**2 + accel_count**2 / 12.0 * rounding_rate + accel_rounding**2 * _COARSE_TIME
    bias_drift = np.repeat(bias_drift_sigmas(imu), 3)
    end_rate = 0.5 * (imu.gyro_arw**2 * imu.sample_rate + (gyro_count * imu.sample_rate) ** 2 / 12.0)
    return FilterNoise(rate, force, table.velocity_sigma**2, max(interval, 1.0 / imu.sample_rate), end_rate, bias_drift)


def coarse_rounding(imu: ImuModel) -> tuple[float, float]:
    """Return the sigmas of rate, rad/s, and force, m/s², due to rounding that averaging does not reduce, otherwise 0.

    The rounding errors of a constant input are independent only if the noise of a sample exceeds a fraction of the step
    (B. Widrow and I. Kollár, *Quantization Noise*, Cambridge 2008, chapter 4); an increment output carries them over to
    the next sample.
    """
    if imu.output == "increment":
        return 0.0, 0.0
    gyro, accel = imu.quantisation
    root = float(np.sqrt(imu.sample_rate))
    return (
        gyro / 12.0**0.5 if gyro > _COARSE * imu.gyro_arw * root else 0.0,
        accel / 12.0**0.5 if accel > _COARSE * imu.accel_vrw * root else 0.0,
    )


def bias_drift_sigmas(imu: ImuModel) -> FloatArray:
    """Return the stationary sigmas of the gyro and accelerometer bias drift, rad/s and m/s², shape (2,)."""
    return np.asarray(np.hypot(BIAS_DRIFT_PER_INSTABILITY * imu.bias_instability, coarse_rounding(imu)))


def rest_mean_variance(context: SolveContext, duration: float) -> float:
    """Return the variance, (m/s²)², of the mean force of a rest of `duration` s, weighted with `slope_weights`.

    It is the sum of three terms: the slope through m + 1 velocities τ apart, 12 σ_v²/(τ² m (m+1) (m+2)); the white
    force noise, q/τ Σw², which approaches 6/5 q/T; and the bias drift.
    """
    noise = filter_noise(context)
    m = max(int(duration / noise.interval + 1e-9), 1)
    size = m * (m + 1) * (m + 2)
    return (
        12.0 * noise.velocity / (noise.interval**2 * size)
        + noise.force / noise.interval * 1.2 * (m * m + 2 * m + 2) / size
        + float(noise.bias_drift[3]) ** 2
    )


def rest_force(data: StageData, context: SolveContext, start: int, stop: int) -> tuple[FloatArray, float]:
    """Return the mean specific force of a rest weighted with `slope_weights`, m/s², shape (3,), and its variance."""
    weights = slope_weights(stop - start, max(round(filter_noise(context).interval / data.dt), 1))
    return np.asarray(weights @ data.accel[start:stop]), rest_mean_variance(context, (stop - start) * data.dt)


@dataclass(frozen=True)
class NoiseRatio:
    """Measured noise of some channels at an averaging time, as a ratio to the profile's noise."""

    time: float  #: Averaging time, s.
    value: FloatArray  #: Shape (k,).
    limit: FloatArray  #: Largest ratio explained by the profile's noise, shape (k,).

    @property
    def excess(self) -> FloatArray:
        """Ratios that are significantly larger than 1, with 1 for the others, shape (k,)."""
        return np.where(self.value > np.maximum(_MIN_EXCESS, self.limit), self.value, 1.0)


@dataclass(frozen=True)
class RestNoise:
    """Noise measured at rest as a ratio to the profiles' noise."""

    gyro: tuple[NoiseRatio, ...]  #: Angle random walk of each gyro, at every averaging time.
    accel: tuple[NoiseRatio, ...]  #: Velocity random walk of each accelerometer, at every averaging time.
    velocity: NoiseRatio  #: Velocity of the table; NaN if there is no rest.
    table_is_quiet: bool  #: Whether the table certainly vibrates less than half as much as its profile specifies.

    def worst(self) -> tuple[float, str, float]:
        """Return the largest significant noise ratio of an inertial sensor, its channel and averaging time, s."""
        rows = [np.concatenate([g.excess, a.excess]) for g, a in zip(self.gyro, self.accel, strict=True)]
        ratios = np.array(rows)
        time, channel = np.unravel_index(int(np.argmax(ratios)), ratios.shape)
        return float(ratios[time, channel]), CHANNELS[channel], self.gyro[time].time


def rest_noise(data: StageData, context: SolveContext, gyro_bias: tuple[FloatArray, float]) -> RestNoise:
    """Measure the noise at all rests, which `find_rests` finds with `gyro_bias`.

    The table's velocity noise is white, so successive velocity changes have a covariance of −σ_v², to which the noise
    of the accelerometers does not contribute. The Allan variance at time T is the sum of the white noise q/T, the bias
    drift and, for an accelerometer, the table's 3 σ_v²/T² (IEEE Std 952-2020, annex C).
    """
    noise = filter_noise(context)
    rests = [slice(*rest) for rest in find_rests(data, context.imu, gyro_bias)]
    velocity, count = _vibration([data.accel[rest] for rest in rests], noise, data.dt)
    scatter = [_vibration_scatter(part * noise.velocity, noise, count) for part in (1.0, 0.25)]
    drift = noise.bias_drift[[0, 3]] ** 2 * 2.0 / (3.0 * BIAS_DRIFT_TIME)
    gyro, accel = [], []
    for time in _TIMES:
        width = max(round(time / data.dt), 1)
        table = 3.0 * velocity / time**2
        uncertain = 3.0 * _vibration_scatter(velocity, noise, count) / time**2 + _NOT_WHITE / _SIGMAS * table
        gyro.append(_ratio(time, [data.gyro[rest] for rest in rests], width, noise.rate / time + drift[0] * time))
        white = noise.force / time + drift[1] * time
        accel.append(_ratio(time, [data.accel[rest] for rest in rests], width, white, table, uncertain))
    ratio = np.array([velocity.mean()]) / noise.velocity if count else np.array([np.nan])
    limit = np.sqrt(1.0 + _SIGMAS * scatter[0] / noise.velocity / np.sqrt(3.0))
    quiet = bool(ratio[0] < 0.25 - _SIGMAS * scatter[1] / noise.velocity / np.sqrt(3.0))
    return RestNoise(tuple(gyro), tuple(accel), NoiseRatio(noise.interval, np.sqrt(ratio), np.array([limit])), quiet)


def gyro_excess(data: StageData, context: SolveContext, gyro_bias: tuple[FloatArray, float]) -> float:
    """Return the largest significant ratio of a gyro's noise to its profile's over short times at rest, at least 1.

    Rests of a few seconds suffice, as in a stage that may end early. The arguments are as for `rest_noise`.
    """
    noise = filter_noise(context)
    expected = noise.rate / _SHORT_TIME
    per_count = 1.0 if context.imu.output == "increment" else data.dt
    rounding = 0.25 * (context.imu.quantisation[0] * per_count / _SHORT_TIME) ** 2
    if rounding > _FINE * expected:
        return 1.0
    rests = [data.gyro[a:b] for a, b in find_rests(data, context.imu, gyro_bias)]
    return float(_ratio(_SHORT_TIME, rests, max(round(_SHORT_TIME / data.dt), 1), expected).excess.max())


def _vibration(rests: list[FloatArray], noise: FilterNoise, dt: float) -> tuple[FloatArray, int]:
    """Return the velocity variance along each accelerometer at rest, (m/s)², shape (3,), and its number of values.

    If there are too few values, return the variance of the profile and 0.
    """
    stride = max(round(noise.interval / dt), 1)
    changes = (group_means(rest, stride) * stride * dt for rest in rests)
    centred = (change - change.mean(axis=0) for change in changes if len(change))
    products = np.concatenate([np.empty((0, 3)), *(-change[1:] * change[:-1] for change in centred)])
    if len(products) < _MIN_COUNT:
        return np.full(3, noise.velocity), 0
    return np.maximum(products.mean(axis=0), 0.0), len(products)


def _vibration_scatter(velocity: FloatArray | float, noise: FilterNoise, count: int) -> FloatArray:
    """Return the scatter of the variance from `_vibration` for white velocity noise of a given variance, (m/s)².

    The products of successive changes, of variance c₀ and covariance c₁, have a variance of c₀² + c₁² and a covariance
    of c₁² with their neighbours.
    """
    variance = 2.0 * velocity + noise.force * noise.interval
    return np.asarray(np.sqrt((variance**2 + 3.0 * velocity**2) / max(count, 1)))


def _ratio(
    time: float,
    rests: list[FloatArray],
    width: int,
    expected: float,
    table: FloatArray | float = 0.0,
    uncertain: FloatArray | float = 0.0,
) -> NoiseRatio:
    """Return the noise of three channels from the Allan variance of means of `width` samples.

    `expected` is the profile's variance, `table` the table's variance, shape (3,), and `uncertain` its uncertainty. The
    median is insensitive to creep after a move; expressed as a sigma, the median of n values exceeds 1 + 5 √(2/n) less
    than once in 10⁵ cases.
    """
    steps = np.concatenate([np.empty((0, 3)), *(np.diff(group_means(rest, width), axis=0) for rest in rests)])
    if len(steps) < _MIN_COUNT:
        return NoiseRatio(time, np.ones(3), np.full(3, np.inf))
    variance = 0.5 * np.median(steps**2, axis=0) / _MEDIAN - table
    largest = (1.0 + _SIGMAS * np.sqrt(2.0 / len(steps))) ** 2 * (expected + table) - table + _SIGMAS * uncertain
    value, limit = (np.sqrt(np.maximum(x, 0.0) / expected) for x in (variance, largest))
    return NoiseRatio(time, value, np.broadcast_to(limit, 3))


def with_measured_noise(context: SolveContext, measured: RestNoise) -> SolveContext:
    """Return the context with the measured noise of the IMU, and of the table at rest, wherever it is larger."""
    noise, imu = filter_noise(context), context.imu
    gyro, accel = (float(np.max([ratio.excess for ratio in ratios])) for ratios in (measured.gyro, measured.accel))
    if gyro > 1.0:
        imu = replace(imu, gyro_arw=gyro * float(np.sqrt(noise.rate)))
    if accel > 1.0:
        imu = replace(imu, accel_vrw=accel * float(np.sqrt(noise.force)))
    velocity = float(measured.velocity.excess[0])
    table = replace(context.table, velocity_sigma=velocity * context.table.velocity_sigma)
    return replace(context, imu=imu, table=table)


def noise_tests(profile: SolveContext, used: SolveContext, measured: RestNoise) -> tuple[ModelTest, ...]:
    """Return the tests of the measured noise, and of the noise used for the solution, against the profiles."""
    table = used.table.velocity_sigma / profile.table.velocity_sigma
    if table == 1.0 and np.isfinite(measured.velocity.value[0]):
        table = min(float(measured.velocity.value[0]), 1.0)
    ratio, channel, time = measured.worst()
    vibrates = Diagnosis("table_vibrates", used.table.velocity_sigma, unit="m/s", values={"ratio": table})
    noisy = Diagnosis("imu_noise", values={"ratio": ratio, "channel": channel, "seconds": time})
    return (
        ModelTest("table_noise", table, MAX_NOISE, "1", vibrates),
        ModelTest("imu_noise", ratio, MAX_NOISE, "1", noisy),
    )
