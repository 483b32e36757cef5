"""Noise of IMU and table: spectral densities from the profiles for the filters, and noise measured at rest.

If the noise measured in a stage exceeds that of the profile, the measured noise is used.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from calstation.estimation.common.context import ImuModel, SolveContext
from calstation.estimation.common.model_test import Diagnosis, ModelTest
from calstation.estimation.common.stage import StageData, find_rests, group_means, slope_weights
from calstation.physics import CHANNELS, FloatArray

#: Correlation time of the Gauss-Markov process that models bias instability, s.
BIAS_DRIFT_TIME = 200.0
#: Sigma of that process in units of the bias instability B, for which its Allan deviation at 100 s, half the
#: correlation time, is 0.664 B.
BIAS_DRIFT_PER_INSTABILITY = 1.375
#: Rounding step, in sigmas of a sample's noise, above which averaging does not reduce the rounding error.
_COARSE = 2.5
#: Time for which such a rounding error is constant, s: the duration of a rest or of a turn at constant rate.
_COARSE_TIME = 20.0
#: Ratio to the profile's noise above which a unit or a table fails; a smaller excess increases the sigmas.
MAX_NOISE = 3.0
#: The same for the table, whose noise is measured with more scatter.
MAX_TABLE_NOISE = 3.3
#: Number of intervals per interval between observations for gyros, so that short rests suffice.
_PARTS = 4
#: Averaging times in intervals, and the factor by which the correlation of neighbouring times increases a sigma.
_TIMES, _OVERLAP = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128), 1.3
#: Shortest averaging time at which the table's velocity affects the estimate, s.
_SLOW_TIME = 0.4
#: Largest rounding step at an averaging time at which noise is measured, in sigmas of the noise over this time.
_FINE = 3.0
#: Median of the χ² distribution with 1 degree of freedom; larger multiples of the variance are disturbances.
_MEDIAN, _LARGEST = 0.4549, 12.0
#: Smallest number of independent values from which a variance is estimated.
_MIN_COUNT = 10
#: Smallest significant excess, in standard deviations and as a ratio.
_SIGMAS, _MIN_EXCESS = 5.0, 1.05
#: Smallest significant excess of the mean of three channels, and largest disagreement of averaging times, in sigmas.
_MEAN_SIGMAS, _CONSISTENT = 3.5, 3.0
#: Duration of the segments in which periodic motion at rest is detected, s, and their smallest and largest number.
_SEGMENT, _MIN_SEGMENTS, _MAX_SEGMENTS = 4.0, 8, 60
#: Number of frequencies on either side of a line for its background, and smallest ratio of the line to the background.
_BACKGROUND, _LINE = 15, 12.0


@dataclass(frozen=True)
class FilterNoise:
    """Process and observation noise."""

    rate: float  #: Spectral density of the angle random walk, rad²/s.
    force: float  #: Spectral density of the velocity random walk, (m/s)²/s.
    velocity: float  #: Variance of a velocity observation, (m/s)².
    interval: float  #: Time between observations, s.
    #: Stationary sigma of each bias about its constant value, gyro x y z, accel x y z, rad/s and m/s², shape (6,).
    bias_drift: FloatArray


def filter_noise(context: SolveContext) -> FilterNoise:
    """Return the noise densities for a filter.

    Quantisation q has variance q²/12. A rate output rounds every sample independently, which is white noise at the
    sample rate. An increment output carries the remainder over to the next sample, so only one rounding error remains
    per observation interval. A bias instability B gives an Allan deviation floor of 0.664 B (IEEE Std 952-2020, annex
    C). It is modelled as a first-order Gauss-Markov process about the constant bias, so that the estimate of the
    constant never degrades. Coarse rounding (see `coarse_rounding`) is modelled as white noise with the density of an
    error that is constant for `_COARSE_TIME`.
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
    return FilterNoise(rate, force, table.velocity_sigma**2, max(interval, 1.0 / imu.sample_rate), bias_drift)


def coarse_rounding(imu: ImuModel) -> tuple[float, float]:
    """Return the sigmas of rate, rad/s, and force, m/s², due to rounding that averaging does not reduce; 0 without it.

    The rounding errors of a constant input are independent only if the noise of a sample exceeds a fraction of the step
    (B. Widrow and I. Kollár, *Quantization Noise*, Cambridge 2008, chapter 4); an increment output carries the rounding
    error over to the next sample.
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
    force noise, q Σ∫w² dt, with weights that are linear between the velocities; and the bias drift.
    """
    noise = filter_noise(context)
    m = max(int(duration / noise.interval + 1e-9) - 1, 1)
    j = np.arange(m + 2)
    size = m * (m + 1) * (m + 2)
    weights = 6.0 * j * (m + 1 - j) / (size * noise.interval)
    square = float(np.sum(weights[1:] ** 2 + weights[1:] * weights[:-1] + weights[:-1] ** 2)) / 3.0
    return (
        12.0 * noise.velocity / (noise.interval**2 * size)
        + noise.force * noise.interval * square
        + float(noise.bias_drift[3]) ** 2
    )


def rest_weights(data: StageData, context: SolveContext, start: int, stop: int) -> FloatArray:
    """Return the `slope_weights` of a rest, for which motion of bounded amplitude hardly changes the mean."""
    return slope_weights(stop - start, max(round(filter_noise(context).interval / data.dt), 1))


def rest_force(data: StageData, context: SolveContext, start: int, stop: int) -> tuple[FloatArray, float]:
    """Return the mean specific force of a rest, weighted with `slope_weights`, m/s², shape (3,), and its variance."""
    force = rest_weights(data, context, start, stop) @ data.accel[start:stop]
    return np.asarray(force), rest_mean_variance(context, (stop - start) * data.dt)


@dataclass(frozen=True)
class Line:
    """Periodic motion of the table at rest."""

    frequency: float  #: Hz
    rms: float  #: Velocity, m/s, or angle, rad.


@dataclass(frozen=True)
class RestNoise:
    """Noise measured at rest; noise that is not significantly larger than the profile's has the ratio 1."""

    imu: FloatArray  #: Ratio of the white noise of each channel to the profile's, shape (6,).
    #: Variance of the table's velocity as a ratio to the profile's; NaN if there is no rest.
    table: float
    #: Variance, (m/s)², of white velocity noise with the density measured at low frequencies, which matter for the
    #: estimate; 0 if it was not measured.
    slow_variance: float
    table_is_quiet: bool  #: Whether the table vibrates significantly less than half as much as its profile specifies.
    sway: Line | None  #: Periodic velocity of the table.
    rocking: Line | None  #: Periodic rotation of the table.

    def worst(self) -> tuple[float, str]:
        """Return the largest noise ratio of an inertial sensor, and its channel."""
        channel = int(np.argmax(self.imu))
        return float(self.imu[channel]), CHANNELS[channel]

    def messages(self) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yield the messages about the motion of the table, with their values."""
        if self.table_is_quiet:
            yield "table_quiet", {}
        if self.sway:
            yield "table_sways", {"frequency": self.sway.frequency, "velocity": 1e3 * self.sway.rms}
        if self.rocking:
            yield "table_rocks", {"frequency": self.rocking.frequency, "angle": 1e6 * self.rocking.rms}


class _Weights(NamedTuple):
    """Weights of mean velocities, or angles, over intervals for an averaging time of `width` intervals.

    They are third differences of triangular means over twice the averaging time, which are independent of a linear
    drift of the force, or rate, and nearly independent of periodic motion.
    """

    width: int
    force: float  #: Variance due to white noise of the force, per unit of its density.
    velocity: float  #: Variance due to white noise of the velocity, per unit of its density.
    walk: float  #: Variance due to a random walk of the force, per unit of its density.

    @classmethod
    def of(cls, width: int, interval: float) -> "_Weights":
        """Return the weights for intervals of `interval` s."""
        box, third = np.ones(width) / width, np.zeros(3 * width + 1)
        third[::width] = 1.0, -3.0, 3.0, -1.0
        weights = np.convolve(np.convolve(box, box), third)
        force = np.append(0.0, np.cumsum(weights))  # linear between the middles of the intervals
        walk = np.append(0.0, np.cumsum(0.5 * (force[1:] + force[:-1]))) * interval
        square = float(np.sum(force[1:] ** 2 + force[1:] * force[:-1] + force[:-1] ** 2)) * interval / 3.0
        return cls(width, square, float(np.sum(weights**2)) / interval, float(np.sum(walk**2)) * interval)

    def apply(self, motion: FloatArray) -> FloatArray:
        """Return the weighted sums of n mean velocities, or angles, shape (n, 3)."""
        for _ in range(2):
            total = np.cumsum(np.vstack([np.zeros((1, 3)), motion]), axis=0)
            motion = (total[self.width :] - total[: -self.width]) / self.width
        for _ in range(3):
            motion = motion[self.width :] - motion[: -self.width]
        return motion


@dataclass(frozen=True)
class _Variances:
    """Variances of the three channels of a sensor at those averaging times T at which they are known, ascending.

    They are in units of the variance due to white noise q of the force, or rate, so that a value is q + ρ c with white
    noise c of the velocity, or angle, and a ratio ρ that decreases as 1/T². (Compare the modified Allan variance and
    the Hadamard variance: W. J. Riley, *Handbook of Frequency Stability Analysis*, NIST SP 1065, 2008, section 5.)
    """

    time: FloatArray  #: s, shape (k,).
    value: FloatArray  #: Variance minus that of the profile's bias drift, shape (k, 3).
    relative_sigma: FloatArray  #: Shape (k,).
    ratio: FloatArray  #: ρ, 1/s², shape (k,).

    def density(self, white: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the density c of the velocity, or angle, noise and its sigma for white noise `white`, shape (k, 3)."""
        ratio = self.ratio[:, None]
        return (self.value - white) / ratio, self.value * self.relative_sigma[:, None] / ratio

    def white(self) -> tuple[FloatArray, FloatArray]:
        """Return the white noise of the channels and its sigma, shape (3,); the sigma is infinite if unknown.

        A pair of times (T/2, T) separates the white noise from a bounded velocity, or angle, with a flat spectrum. If
        the spectrum is not flat, the pairs disagree, and the short times are disregarded.
        """
        halves = np.abs(self.time[:, None] - 0.5 * self.time) < 1e-9
        half, whole = np.nonzero(halves)
        half, whole = half[np.argsort(whole)], np.sort(whole)
        before, after = self.ratio[half, None], self.ratio[whole, None]
        value = np.hstack([self.value, self.value.mean(axis=1, keepdims=True)])  # the mean scatters less
        sigma = value * self.relative_sigma[:, None] / np.array([1.0, 1.0, 1.0, np.sqrt(3.0)])
        white = (before * value[whole] - after * value[half]) / (before - after)
        scatter = np.hypot(before * sigma[whole], after * sigma[half]) / (before - after)
        result, result_sigma = np.zeros(3), np.full(3, np.inf)
        for first in range(len(white) - 1, -1, -1):
            weight = np.maximum(scatter[first:], 1e-150) ** -2
            total = weight.sum(axis=0)
            mean = (weight * white[first:]).sum(axis=0) / total
            if (np.abs(white[first:] - mean) > _CONSISTENT * scatter[first:]).any():
                break
            result, result_sigma = mean[:3], _OVERLAP * total[:3] ** -0.5
        return result, result_sigma


def rest_noise(data: StageData, context: SolveContext, gyro_bias: tuple[FloatArray, float]) -> RestNoise:
    """Measure the noise at all rests, which `find_rests` finds with `gyro_bias`.

    A motion of the table has a bounded velocity and a bounded angle, so its share of the variance decreases faster with
    the averaging time than that of the IMU's noise. The noise of the IMU is too large only if it is significant at
    every averaging time; otherwise the table moves. Rocking is sensed by the gyros and does not affect the estimate.

    Parameters
    ----------
    data : samples of a stage
    context : IMU, table and site with the noise of their profiles
    gyro_bias : gyro biases, shape (3,), and their sigma, rad/s
    """
    noise = filter_noise(context)
    rests = [slice(*rest) for rest in find_rests(data, context.imu, gyro_bias)]
    lines = [_line(samples, data.dt, rests) for samples in (data.accel, data.gyro)]
    imu, walk = context.imu, noise.bias_drift[[0, 3]] ** 2 * 2.0 / BIAS_DRIFT_TIME
    steps = imu.quantisation if imu.output == "increment" else (0.0, 0.0)
    whole = max(round(noise.interval / data.dt), 1)
    gyros = _variances(data.gyro, data.dt, rests, max(whole // _PARTS, 1), noise.rate, walk[0], steps[0])
    measured = _variances(data.accel, data.dt, rests, whole, noise.force, walk[1], steps[1])
    sensors = ((gyros, noise.rate), (measured, noise.force))
    ratios = np.concatenate([_excess(*(values / q for values in sensor.white())) for sensor, q in sensors])
    expected = noise.velocity * noise.interval
    density, sigma = (values / expected for values in measured.density(ratios[3:] ** 2 * noise.force))
    if not len(density):
        return RestNoise(ratios, np.nan, 0.0, False, *lines)
    mean, mean_sigma = density.mean(axis=1), sigma.mean(axis=1) / np.sqrt(3.0)  # the mean scatters less
    # decreased by the scatter, because the largest of several values is biased upward
    largest = np.where(density - _SIGMAS * sigma > _MIN_EXCESS**2, density - 2.0 * sigma, 0.0).max()
    largest = max(largest, np.where(mean - _MEAN_SIGMAS * mean_sigma > _MIN_EXCESS**2, mean - mean_sigma, 0.0).max())
    slow = np.max((mean - mean_sigma)[measured.time >= _SLOW_TIME], initial=0.0)
    quiet = bool(mean[0] + _SIGMAS * mean_sigma[0] < 0.25 and slow < 0.25)
    table = float(largest if largest > 0.0 else np.clip(mean[0], 0.0, 1.0))
    return RestNoise(ratios, table, float(slow) * noise.velocity, quiet, *lines)


def _excess(white: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return the ratios of the noise of three channels to the profile's; 1 if the noise is not significantly larger.

    `white` and `sigma` are relative to the variance of the profile, shape (3,).
    """
    larger = white - _SIGMAS * sigma > _MIN_EXCESS**2
    ratios = np.where(larger, np.sqrt(np.maximum(white, 1.0)), 1.0)
    mean, mean_sigma = float(white.mean()), float(np.linalg.norm(sigma)) / 3.0
    if not larger.any() and mean - _SIGMAS * mean_sigma > _MIN_EXCESS**2:
        ratios[:] = np.sqrt(mean)
    return np.asarray(ratios)


def _variances(
    samples: FloatArray, dt: float, rests: list[slice], stride: int, white: float, walk: float, step: float
) -> _Variances:
    """Return the variances at the averaging times with enough data at rest and sufficiently fine rounding.

    Parameters
    ----------
    samples, dt : forces, or rates, of all samples, shape (n, 3), and sample period, s
    rests : rests as slices of the samples
    stride : number of samples of an interval
    white, walk : densities of white noise and random walk in the profile
    step : step of increments, m/s or rad
    """
    interval, motions = stride * dt, []
    for rest in rests:
        centred = samples[rest] - samples[rest].mean(axis=0)
        motions.append(group_means(np.cumsum(centred, axis=0) * dt, stride))
    rows: list[tuple[float, FloatArray, float, float]] = []
    for width in _TIMES:
        weights = _Weights.of(width, interval)
        long = [motion for motion in motions if len(motion) >= 5 * width]
        count = sum(len(motion) // width - 4 for motion in long)
        if count < _MIN_COUNT or step > _FINE * np.sqrt(white * width * interval):
            continue
        squares = np.concatenate([weights.apply(motion)[:: max(width // 2, 1)] for motion in long]) ** 2
        largest = _LARGEST / _MEDIAN * np.median(squares, axis=0)
        value = (np.minimum(squares, largest).mean(axis=0) - walk * weights.walk) / weights.force
        rows.append((width * interval, value, np.sqrt(2.0 / count), weights.velocity / weights.force))
    time, value, scatter, ratio = zip(*rows, strict=True) if rows else ((), (), (), ())
    return _Variances(np.array(time), np.array(value).reshape(-1, 3), np.array(scatter), np.array(ratio))


def _line(samples: FloatArray, dt: float, rests: list[slice]) -> Line | None:
    """Return the strongest periodic velocity, or angle, of the table at rest from the force, or rate; None if none.

    A line in the mean spectrum of the segments is significant if it exceeds its background `_LINE` times.
    """
    length = round(_SEGMENT / dt)
    begins = [b for rest in rests for b in range(rest.start, rest.stop - length + 1, length)]
    if len(begins) < _MIN_SEGMENTS or length < 2 * _BACKGROUND:
        return None
    begins = begins[:: -(-len(begins) // _MAX_SEGMENTS)]
    window, frequency = np.hanning(length)[:, None], np.fft.rfftfreq(length, dt)
    power = np.zeros((len(frequency), 3))
    for begin in begins:
        part = samples[begin : begin + length]
        power += np.abs(np.fft.rfft(window * (part - part.mean(axis=0)), axis=0)) ** 2
    power *= 2.0 / (len(begins) * np.sum(window) ** 2)  # the sum over a line is its mean square times 1.5
    total = power.sum(axis=1)
    background = np.median(sliding_window_view(np.pad(total, _BACKGROUND, "reflect"), 2 * _BACKGROUND + 1), axis=1)
    if not background[3:-2].min(initial=np.inf) > 0.0:
        return None
    k = 3 + int(np.argmax(total[3:-2] / background[3:-2]))
    if not total[k] > _LINE * background[k]:
        return None
    around = slice(k - 2, k + 3)
    square = float(np.sum(total[around] - background[around])) / 1.5
    centre = float(frequency[around] @ total[around] / total[around].sum())
    return Line(centre, float(np.sqrt(max(square, 0.0))) / (2.0 * np.pi * centre))


def with_measured_noise(context: SolveContext, measured: RestNoise) -> SolveContext:
    """Return the context with the measured noise of the IMU and of the table at rest where it is larger."""
    noise, imu = filter_noise(context), context.imu
    gyro, accel = (float(measured.imu[i : i + 3].max()) for i in (0, 3))
    if gyro > 1.0:
        imu = replace(imu, gyro_arw=gyro * float(np.sqrt(noise.rate)))
    if accel > 1.0:
        imu = replace(imu, accel_vrw=accel * float(np.sqrt(noise.force)))
    table = context.table
    if measured.table > 1.0:
        table = replace(table, velocity_sigma=float(np.sqrt(measured.table)) * table.velocity_sigma)
    return replace(context, imu=imu, table=table)


def noise_tests(profile: SolveContext, used: SolveContext, measured: RestNoise) -> tuple[ModelTest, ...]:
    """Return the tests of the measured noise, and of the noise used for the solution, against the profiles."""
    table = used.table.velocity_sigma / profile.table.velocity_sigma
    if table == 1.0 and np.isfinite(measured.table):
        table = float(np.sqrt(np.clip(measured.table, 0.0, 1.0)))
    ratio, channel = measured.worst()
    slow = float(np.sqrt(filter_noise(used).force / filter_noise(profile).force))
    if slow > ratio:
        ratio, channel = slow, "accel"
    vibrates = Diagnosis("table_vibrates", used.table.velocity_sigma, unit="m/s", values={"ratio": table})
    noisy = Diagnosis("imu_noise", values={"ratio": ratio, "channel": channel})
    return (
        ModelTest("table_noise", table, MAX_TABLE_NOISE, "1", vibrates),
        ModelTest("imu_noise", ratio, MAX_NOISE, "1", noisy),
    )
