"""Checks of the recorded samples themselves: clipped channels, the sample clock, and the temperature."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calstation.estimation import Misfit, ModelTest, Solution
from calstation.estimation.common import ImuModel, RestResiduals, SampleBlock, SolveContext, StageData, rest_residuals
from calstation.physics import CHANNELS, PARAMETERS, FloatArray, group_indices
from calstation.records import ChecksSection, LogMeta, SampleClockLimit, TemperatureLimit

#: A channel is clipped if its noise lets this many samples be expected above the largest one.
MISSING_SAMPLES = 30.0
#: Default of the largest error of a clock with which the sample rate is compared, ppm: that of a computer's quartz.
CLOCK_ERROR_PPM = 50.0
#: Window in which the noise of a channel and the mean of times and temperatures are determined, s.
_WINDOW = 1.0
#: Sigmas of the rate of the clock beyond its limit that fail; no verdict where these are more than the limit.
_SIGMAS = 5.0
#: Times that differ less from the counter, s, are derived from it and show no clock.
_DERIVED = 1e-6
#: Fewest windows from which the rate of the clock is determined.
_FEWEST_WINDOWS = 20
#: Range of the temperature, °C, below which nothing is regressed on it.
_LEAST_CHANGE = 0.5


class DataChecks:
    """Checks of the samples of a log's stages, in order."""

    def __init__(self, meta: LogMeta, context: SolveContext) -> None:
        checks = (meta.product.checks if meta.product is not None else None) or ChecksSection()
        given = meta.run.clock_error_ppm if meta.run is not None else None
        error = CLOCK_ERROR_PPM if given is None else given
        self._clock_within = 1e-6 * ((checks.sample_clock or SampleClockLimit()).within_ppm + error)
        self._temperature_within = (checks.temperature or TemperatureLimit()).change_within
        self._context = context
        self._temperatures: list[float] = []

    def checked(self, solution: Solution, samples: SampleBlock, data: StageData) -> Solution:
        """Return the solution of a stage with the tests of its samples, and what they show in its details."""
        clocks = sample_clocks(samples, self._context.imu.sample_rate)
        tests = [self._clipping(samples), *self._clock(clocks)]
        details: dict[str, Any] = {}
        if clocks:
            details["sample_clock"] = {name: vars(found) for name, found in clocks.items()}
        windows = _windows(samples.temperature[:, None], self._context.imu.sample_rate)[:, 0]
        if len(windows):
            self._temperatures += [float(windows.min()), float(windows.max())]
            tests.append(self._temperature())
            residuals = rest_residuals(data, self._context, solution.belief)
            details["temperature"] = temperature_coefficients(residuals, samples, self._context.site.local_gravity)
        return replace(solution, tests=(*solution.tests, *tests), details={**solution.details, **details})

    def _clipping(self, samples: SampleBlock) -> ModelTest:
        """Return the worst test of the IMUs on the body; a secondary IMU's number follows the name of the sensor."""
        imus = [("", self._context.imu, samples.counts)]
        imus += [(str(s.number), s.imu, samples.others[:, k]) for k, s in enumerate(self._context.secondaries)]
        found = []
        for number, imu, counts in imus:
            known = samples.valid & ~np.isnan(counts).any(axis=1)
            found.append(clipping_test(counts[known], samples.time[known], imu, number))
        return max(found, key=lambda test: test.value)

    def _clock(self, clocks: dict[str, "SampleClock"]) -> Iterator[ModelTest]:
        """Yield the test of the sample rate, unless the time is too short to decide it."""
        limit = self._clock_within
        if not clocks:
            return
        reference = max(clocks, key=lambda name: abs(clocks[name].offset) - _SIGMAS * clocks[name].sigma)
        found = clocks[reference]
        largest = limit + _SIGMAS * found.sigma
        if largest > 2.0 * limit and abs(found.offset) <= largest:
            return
        values = {
            "reference": reference,
            "ppm": 1e6 * found.offset,
            "ppm_sigma": 1e6 * found.sigma,
            "rate": self._context.imu.sample_rate * (1.0 + found.offset),
        }
        misfit = Misfit("sample_clock", found.offset, found.sigma, values=values)
        yield ModelTest("sample_clock", abs(found.offset), largest, "1", misfit)

    def _temperature(self) -> ModelTest:
        low, high = min(self._temperatures), max(self._temperatures)
        misfit = Misfit("temperature_changed", high - low, unit="K", values={"low": low, "high": high})
        return ModelTest("temperature", high - low, self._temperature_within, "K", misfit)


def clipping_test(counts: FloatArray, time: FloatArray, imu: ImuModel, number: str = "") -> ModelTest:
    """Test whether a channel of `counts`, shape (n, 6), ends at a value that its noise should exceed.

    Samples are rounded to bins of width h. Gaussian noise of standard deviation s, added to any signal, leaves
    p[k-1] p[k+1] >= p[k]² exp(-h²/s²) for the shares p of neighbouring bins (by Cauchy's inequality for one level of
    the signal, by Titu's lemma for a mixture). The two highest bins therefore give a lower bound of the number
    of samples expected above the highest one, where there is none. `time` is in s, shape (n,); `number` is the IMU's.
    """
    size = imu.count_size
    noise = np.repeat([imu.gyro_arw, imu.accel_vrw], 3) * imu.sample_rate**0.5 / size
    steps = np.repeat(imu.quantisation, 3) * imu.rate_factor / size
    worst, cause = 0.0, Misfit("clipped")
    for i, name in enumerate(CHANNELS):
        both = _missing_samples(np.ascontiguousarray(counts[:, i]), float(noise[i]), float(steps[i]), imu.sample_rate)
        for side, missing in zip((1.0, -1.0), both, strict=True):
            if missing > worst:
                values = side * counts[:, i]
                at = np.flatnonzero(values == values.max())
                level = float(side * values.max() * size[i])
                shown, unit = (np.rad2deg(level), "°/s") if i < 3 else (level, "m/s²")
                worst = missing
                cause = Misfit(
                    "clipped",
                    level,
                    unit="rad/s" if i < 3 else "m/s²",
                    values={
                        "channel": name.replace("_", f"{number} "),
                        "level": float(shown),
                        "level_unit": unit,
                        "count": len(at),
                        "first": float(time[at[0]]),
                        "last": float(time[at[-1]]),
                    },
                )
    return ModelTest("clipping", worst, MISSING_SAMPLES, "1", cause)


def _missing_samples(values: FloatArray, noise: float, step: float, rate: float) -> tuple[float, float]:
    """Return how many samples are missing above the largest one, and below the smallest one, at least.

    `noise`, the profile's, and `step`, that of the rounding, are in counts; both are also taken from the data.
    """
    ordered = np.sort(values)
    steps = np.diff(ordered)
    steps = steps[steps > 0.0]
    if len(steps) < 2:
        return 0.0, 0.0
    step, low, high = max(step, float(steps.min())), ordered[0], ordered[-1]
    width = max(round(_WINDOW * rate), 8)
    rows = values[: len(values) // width * width].reshape(-1, width)
    rows = rows[(rows.max(axis=1) < high) & (rows.min(axis=1) > low)]
    if not len(rows):
        return 0.0, 0.0
    # Second differences exclude the motion, standard deviations include slow noise; both only limit the noise.
    fine = (np.diff(rows, 2, axis=1) ** 2).mean(axis=1) / 6.0
    noise = min(noise, float(np.sqrt(min(np.quantile(fine, 0.05), rows.var(axis=1).min()))))
    if not noise > 0.0:
        return 0.0, 0.0
    bin_width = step * max(1, round(noise / step))

    def beyond(edge: float, sorted_values: FloatArray) -> int:
        return len(values) - int(np.searchsorted(sorted_values, edge, side="right"))

    def missing(sorted_values: FloatArray) -> float:
        edge = sorted_values[-1] + 0.5 * step - bin_width
        highest = beyond(edge, sorted_values)
        next_bin = beyond(edge - bin_width, sorted_values) - highest
        return float(highest**2 / (next_bin + 3.0 * next_bin**0.5 + 3.0) * np.exp(-((bin_width / noise) ** 2)))

    return missing(ordered), missing(-ordered[::-1])


@dataclass(frozen=True)
class SampleClock:
    """A reference clock compared with the sample counter."""

    offset: float  #: Relative difference of the sample rate from its nominal value.
    sigma: float  #: Standard deviation of `offset`.
    jitter: float  #: Standard deviation of a time from a straight line, s.


def sample_clocks(samples: SampleBlock, rate: float) -> dict[str, SampleClock]:
    """Compare the counter of the samples at `rate`, Hz, with their times and with the station's, where it is known."""
    nominal = samples.seq / rate
    found = {"time_s": _clock(nominal, samples.time, rate)}
    if samples.station.shape[1]:
        found["station"] = _clock(nominal, samples.station[:, 0], rate)
    return {name: clock for name, clock in found.items() if clock is not None}


def _clock(nominal: FloatArray, time: FloatArray, rate: float) -> SampleClock | None:
    """Fit the rate of a clock with one offset for each interval without gap; None if the intervals are too short."""
    interval = np.concatenate([[0], np.cumsum(np.diff(nominal) * rate > 1.5)])
    known = ~np.isnan(time)
    nominal, late, interval = nominal[known], (time - nominal)[known], interval[known]
    if not len(nominal) or np.ptp(late) < _DERIVED:
        return None
    # Means over windows: times of arrival that are late together count once.
    window = np.floor((nominal - nominal[0]) / _WINDOW).astype(np.int64) + interval * (1 << 32)
    _, first, index = np.unique(window, return_index=True, return_inverse=True)
    weight = np.bincount(index)
    x, y = np.bincount(index, nominal) / weight, np.bincount(index, late) / weight
    part = np.unique(interval[first], return_inverse=True)[1]
    parts = np.bincount(part)
    x, y = (v - (np.bincount(part, v) / parts)[part] for v in (x, y))
    free = len(x) - len(parts) - 1
    if free < _FEWEST_WINDOWS:
        return None
    slope = float(x @ y / (x @ x))
    scatter = float(np.sqrt(((y - slope * x) ** 2).sum() / free))
    each = late - (np.bincount(index, late) / weight)[index]
    jitter = float(np.hypot(scatter, each.std()))
    # Delays may also change slowly, for example where times are read at multiples of the sample period.
    sigma = float(np.hypot(scatter / np.sqrt(x @ x), jitter / np.ptp(x)))
    return SampleClock(-slope / (1.0 + slope), sigma, jitter)


def _windows(values: FloatArray, rate: float) -> FloatArray:
    """Return the means of the rows without NaN over windows of `_WINDOW`, shape (m, columns)."""
    values = values[~np.isnan(values).any(axis=1)]
    width = max(round(_WINDOW * rate), 1)
    return np.asarray(values[: len(values) // width * width].reshape(-1, width, values.shape[1]).mean(axis=1))


def temperature_coefficients(rests: RestResiduals, samples: SampleBlock, gravity: float) -> dict[str, Any]:
    """Regress the residuals of rests on the temperature.

    Return its range, °C, and the change of each bias and accelerometer scale per °C that the rests determine, with its
    sigma, SI, as JSON values. A rest shows the gyros' biases along up, and the force's component along up.
    """
    known = ~np.isnan(samples.temperature)
    temperature = samples.temperature[known]
    found: dict[str, Any] = {"low": float(temperature.min()), "high": float(temperature.max())}
    warmth = np.interp(0.5 * (rests.first_seq + rests.last_seq), samples.seq[known], temperature)
    if not len(rests) or not np.ptp(warmth) > _LEAST_CHANGE:
        return found
    up = rests.up
    square = gravity * up**2
    found["per_degree"] = {
        **_per_degree(up, warmth, rests.vertical_rate, rests.rate_sigma, ("gyro_bias",)),
        **_per_degree(np.hstack([up, square]), warmth, rests.force, rests.force_sigma, ("accel_bias", "accel_scale")),
    }
    return found


def _per_degree(
    columns: FloatArray, warmth: FloatArray, residual: FloatArray, sigma: FloatArray, groups: tuple[str, ...]
) -> dict[str, dict[str, float]]:
    """Return value and sigma of each coefficient of `columns`, shape (k, m), that k rests determine, by parameter."""
    names = [PARAMETERS[i].name for group in groups for i in group_indices(group)]
    rows = np.hstack([columns * (warmth - warmth.mean())[:, None], columns]) / sigma[:, None]
    if len(rows) <= rows.shape[1] or np.linalg.cond(rows / np.linalg.norm(rows, axis=0)) > 1e3:
        return {}
    covariance = np.linalg.inv(rows.T @ rows)
    values = covariance @ rows.T @ (residual / sigma)
    spread = max(1.0, float(np.sqrt(((rows @ values - residual / sigma) ** 2).sum() / (len(rows) - rows.shape[1]))))
    sigmas = np.sqrt(np.diag(covariance)) * spread
    return {name: {"value": float(values[i]), "sigma": float(sigmas[i])} for i, name in enumerate(names)}
