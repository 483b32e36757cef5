"""Tests of the recorded data: configuration, clipped channels, sample clock, heading, and temperature."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calstation.errors import InputError
from calstation.estimation import Diagnosis, ModelTest, Solution
from calstation.estimation.common import (
    ImuModel,
    Posterior,
    RestResiduals,
    SampleBlock,
    SolveContext,
    StageData,
    rest_residuals,
    stage_data,
)
from calstation.judgement.changed_unit import ChangedUnit
from calstation.judgement.gross_errors import gross_error, heading_test
from calstation.judgement.over_temperature import sensor_test
from calstation.judgement.sample_faults import clipped, sample_test
from calstation.judgement.table_motion import TableMotion, table_motion
from calstation.physics import PARAMETERS, BoolArray, FloatArray, group_indices, kernel
from calstation.records import ChecksSection, LogMeta, SampleClockLimit, TemperatureLimit

#: Largest number of samples expected from the noise beyond the largest one, if a channel is not clipped.
MISSING_SAMPLES = 30.0
#: Default for the largest error of the reference clock of the sample rate, ppm: the quartz of a computer.
CLOCK_ERROR_PPM = 50.0
#: Window in which the noise of a channel and the means of times and temperatures are computed, s.
_WINDOW = 1.0
#: Number of sigmas of the clock rate that are added to its limit; if they exceed the limit, only a failed test counts.
_SIGMAS = 5.0
#: Smallest range of the differences between a clock and the counter, s; below it, the times come from the counter.
_DERIVED = 1e-6
#: Smallest number of windows from which the clock rate is determined.
_MIN_WINDOWS = 20
#: Smallest range of the temperature, °C, for a regression.
_MIN_CHANGE = 0.5


@dataclass(frozen=True)
class TestedSamples:
    """Results of the tests of a stage's samples that need no solution."""

    clocks: dict[str, "SampleClock"]  #: Sample clocks by the name of their reference.
    tests: list[ModelTest]


class DataTests:
    """Tests of the samples of a log's stages, in order."""

    def __init__(self, meta: LogMeta, context: SolveContext, prior: Posterior) -> None:
        checks = (meta.product.checks if meta.product is not None else None) or ChecksSection()
        run_error = meta.run.clock_error_ppm if meta.run is not None else None
        error = CLOCK_ERROR_PPM if run_error is None else run_error
        self._clock_within = 1e-6 * ((checks.sample_clock or SampleClockLimit()).within_ppm + error)
        self._temperature_within = (checks.temperature or TemperatureLimit()).change_within
        self._context, self._prior = context, prior
        self._temperatures: list[float] = []
        self._motion: TableMotion | None = None
        over_temperature = context.temperature is not None
        self._changed_unit = ChangedUnit(context.site.local_gravity, over_temperature=over_temperature)
        self._is_sound = False

    def sample_fault(self, samples: SampleBlock, data: StageData) -> Diagnosis | None:
        """Return the first fault of the samples of a stage that cannot be solved; None if there is none."""
        tests = [*self._sensor(samples), _worst_clipping(samples, self._context)]
        tests += sample_test(samples, data, self._context, self._motion)
        return next((test.diagnosis for test in tests if not test.passed), None)

    def require_configuration(self, stage: str, samples: SampleBlock, data: StageData) -> None:
        """Start the tests of a stage.

        Raises InputError if the data of the stage show a gross error of the configuration, or a gross change since
        earlier stages.
        """
        self._motion = table_motion(data)
        error = gross_error(self._motion, self._context, _clock_offsets(samples, self._context))
        if self._motion is not None and (self._is_sound or error is None):
            changed = self._changed_unit.find(self._motion, data)
            if changed is not None and self.sample_fault(samples, data) is None:
                error = changed
        self._is_sound = error is None
        if error is not None:
            raise InputError("solution.in_stage", stage=stage, what=error.text(stage))

    def test_samples(self, samples: SampleBlock, data: StageData) -> "TestedSamples":
        """Test the samples of the started stage; this needs no solution and may run while the stage is solved."""
        model = self._context.temperature
        clocks = sample_clocks(samples, self._context.imu.sample_rate, None if model is None else model.reference)
        tests = [*self._sensor(samples), _worst_clipping(samples, self._context), *self._clock(clocks)]
        tests += sample_test(samples, data, self._context, self._motion)
        tests += heading_test(self._motion, self._context, self._prior)
        return TestedSamples(clocks, tests)

    def add_tests(self, solution: Solution, tested: "TestedSamples", samples: SampleBlock, data: StageData) -> Solution:
        """Return the solution of a stage with the tests of its samples, and their values in its details."""
        clocks, tests = tested.clocks, list(tested.tests)
        details: dict[str, Any] = {}
        if clocks:
            details["sample_clock"] = {name: vars(clock) for name, clock in clocks.items()}
        temperature = samples.temperature[~np.isnan(samples.temperature)]
        windows = _windows(temperature, self._context.imu.sample_rate)
        if len(windows):
            self._temperatures += [float(windows.min()), float(windows.max())]
            if solution.temperature is None:
                tests.append(self._temperature())
            span = {"low": float(temperature.min()), "high": float(temperature.max())}
            if span["high"] - span["low"] > _MIN_CHANGE:
                residuals = rest_residuals(data, self._context, solution.posterior)
                span |= temperature_coefficients(residuals, samples, self._context.site.local_gravity)
            details["temperature"] = span
        return replace(solution, tests=(*solution.tests, *tests), details={**solution.details, **details})

    def _clock(self, clocks: dict[str, "SampleClock"]) -> Iterator[ModelTest]:
        """Yield the test of the sample rate, unless the time is too short for it."""
        limit = self._clock_within
        if not clocks:
            return
        reference = max(clocks, key=lambda name: abs(clocks[name].offset) - _SIGMAS * clocks[name].sigma)
        clock = clocks[reference]
        largest = limit + _SIGMAS * clock.sigma
        if largest > 2.0 * limit and abs(clock.offset) <= largest:
            return
        values = {
            "reference": reference,
            "ppm": 1e6 * clock.offset,
            "ppm_sigma": 1e6 * clock.sigma,
            "rate": self._context.imu.sample_rate * (1.0 + clock.offset),
        }
        diagnosis = Diagnosis("sample_clock", clock.offset, clock.sigma, values=values)
        yield ModelTest("sample_clock", abs(clock.offset), largest, "1", diagnosis)

    def _sensor(self, samples: SampleBlock) -> list[ModelTest]:
        """Return the test of the temperature sensor in a chamber."""
        return [] if self._context.temperature is None else sensor_test(samples, self._context.imu.sample_rate)

    def _temperature(self) -> ModelTest:
        low, high = min(self._temperatures), max(self._temperatures)
        diagnosis = Diagnosis("temperature_changed", high - low, unit="K", values={"low": low, "high": high})
        return ModelTest("temperature", high - low, self._temperature_within, "K", diagnosis)


def data_faults(samples: SampleBlock, context: SolveContext, prior: Posterior) -> list[Diagnosis]:
    """Return the errors of samples and configuration that the data of a stage show without a solution."""
    data = stage_data([samples], context.imu)
    motion = table_motion(data)
    error = gross_error(motion, context, _clock_offsets(samples, context))
    if error is not None:
        return [error]
    tests = [*sample_test(samples, data, context, motion), *heading_test(motion, context, prior)]
    faults = [test.diagnosis for test in tests if not test.passed]
    clipping = _worst_clipping(samples, context)  # wraps and spikes look like clipping too
    return faults if faults or clipping.passed else [clipping.diagnosis]


def _clock_offsets(samples: SampleBlock, context: SolveContext) -> list[float]:
    return [clock.offset for clock in sample_clocks(samples, context.imu.sample_rate).values()]


def _worst_clipping(samples: SampleBlock, context: SolveContext) -> ModelTest:
    """Return the worst test of clipping of the IMUs on the body."""
    imus = [("", context.imu, samples.counts)]
    imus += [(str(s.number), s.imu, samples.others[:, k]) for k, s in enumerate(context.secondaries)]
    tests = []
    for number, imu, counts in imus:
        complete = _complete_samples(samples.valid, counts)
        selection = slice(None) if complete.all() else complete  # a slice copies nothing
        tests.append(clipping_test(counts[selection], samples.time[selection], imu, number))
    return max(tests, key=lambda test: test.value)


def clipping_test(counts: FloatArray, time: FloatArray, imu: ImuModel, number: str = "") -> ModelTest:
    """Test whether a channel is clipped at a value that its noise would exceed.

    Samples are rounded to bins of width h. With Gaussian noise of standard deviation s, the fractions p of samples in
    neighbouring bins satisfy p[k-1] p[k+1] >= p[k]² exp(-h²/s²) for any signal (by Cauchy's inequality for one level of
    the signal, by Titu's lemma for a mixture). The two highest bins therefore give a lower bound of the number of
    samples expected above the highest bin.

    Parameters
    ----------
    counts, time : raw output, counts, shape (n, 6), and its times, s, shape (n,)
    imu : profile with the noise and the size of a count
    number : displayed number of a secondary IMU, "" for the primary
    """
    size = imu.count_size
    noise = np.repeat([imu.gyro_arw, imu.accel_vrw], 3) * imu.sample_rate**0.5 / size
    steps = np.repeat(imu.quantisation, 3) * imu.rate_factor / size
    missing = _missing_samples(counts, noise, steps, max(round(_WINDOW * imu.sample_rate), 8))
    i, side = np.unravel_index(int(np.argmax(missing)), missing.shape)
    worst = float(missing[i, side])
    if not worst > 0.0:
        return ModelTest("clipping", 0.0, MISSING_SAMPLES, "1", Diagnosis("clipped"))
    values = counts[:, i]
    cause = clipped(values, float((values.max(), values.min())[side]), time, int(i), imu, number)
    return ModelTest("clipping", worst, MISSING_SAMPLES, "1", cause)


def _missing_samples(counts: FloatArray, noise: FloatArray, step: FloatArray, width: int) -> FloatArray:
    """Return a lower bound of the samples missing above the largest and below the smallest one, shape (6, 2).

    `noise`, the profile's noise, and `step`, the rounding step, are in counts, shape (6,). Both are also estimated from
    the data, the noise in windows of `width` samples.
    """
    missing = np.zeros((len(step), 2))
    if not len(counts):
        return missing
    low, high, fine, slow, finest = _windows_of(counts, width)
    for i in range(len(step)):
        lowest, highest_value = float(low[:, i].min()), float(high[:, i].max())
        if finest[i] > step[i]:  # successive samples may always differ by several steps
            finest[i] = np.diff(np.unique(counts[:, i])).min(initial=np.inf)
        inside = (high[: len(fine), i] < highest_value) & (low[: len(fine), i] > lowest)
        if not inside.any():
            continue
        # Second differences exclude motion, standard deviations include slow noise; both are upper limits of the noise.
        measured = np.sqrt(min(np.quantile(fine[inside, i], 0.05), slow[inside, i].min()))
        smallest, spacing = min(noise[i], measured), max(step[i], finest[i])
        if not smallest > 0.0:
            continue
        bin_width = smallest
        if smallest < 2.0**53 * spacing:
            bin_width = spacing * max(1, round(smallest / spacing))
        edges = np.array([highest_value, -lowest]) + 0.5 * spacing - bin_width
        highest = _count_beyond(counts, i, edges, low, high, width)
        next_bin = _count_beyond(counts, i, edges - bin_width, low, high, width) - highest
        share = highest**2 / (next_bin + 3.0 * next_bin**0.5 + 3.0)
        missing[i] = share * np.exp(-((bin_width / smallest) ** 2))
    return missing


@kernel
def _complete_samples(valid: BoolArray, counts: FloatArray) -> BoolArray:
    """Return whether each sample is valid and has all of its channels, shape (n,)."""
    complete = valid.copy()
    for k in range(len(counts)):
        for i in range(counts.shape[1]):
            complete[k] &= counts[k, i] == counts[k, i]
    return complete


@kernel
def _windows_of(counts: FloatArray, width: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return statistics of windows of `width` samples of m channels, and the smallest step of each channel.

    The smallest and the largest value of each window have the shape (k, m); the last window may be incomplete. The
    other results are the noise variance from second differences and the variance of complete windows, shape (k or
    k − 1, m), and the steps, infinite for a constant channel, shape (m,).
    """
    whole, channels = len(counts) // width, counts.shape[1]
    total = -(-len(counts) // width)
    low, high = np.full((total, channels), np.inf), np.full((total, channels), -np.inf)
    fine, slow, finest = np.zeros((whole, channels)), np.zeros((whole, channels)), np.full(channels, np.inf)
    for w in range(total):
        first, last = w * width, min((w + 1) * width, len(counts))
        for i in range(channels):
            mean = 0.0
            for k in range(first, last):
                value = counts[k, i]
                low[w, i], high[w, i] = min(low[w, i], value), max(high[w, i], value)
                mean += value
                step = abs(value - counts[k - 1, i]) if k > 0 else 0.0
                if 0.0 < step < finest[i]:
                    finest[i] = step
            if w == whole:
                continue
            mean /= width
            for k in range(first, last):
                slow[w, i] += (counts[k, i] - mean) ** 2
            for k in range(first + 2, last):
                fine[w, i] += (counts[k, i] - 2.0 * counts[k - 1, i] + counts[k - 2, i]) ** 2
            slow[w, i] /= width
            fine[w, i] /= 6.0 * (width - 2)
    return low, high, fine, slow, finest


@kernel
def _count_beyond(
    counts: FloatArray, channel: int, edges: FloatArray, low: FloatArray, high: FloatArray, width: int
) -> FloatArray:
    """Return the number of values above the first edge, and of their negatives above the second, shape (2,).

    `low` and `high` are the limits of the windows of `width` samples, as in `_windows_of`.
    """
    counted = np.zeros(2)
    for w in range(len(low)):
        if high[w, channel] > edges[0] or -low[w, channel] > edges[1]:
            for k in range(w * width, min((w + 1) * width, len(counts))):
                counted[0] += counts[k, channel] > edges[0]
                counted[1] += -counts[k, channel] > edges[1]
    return counted


@dataclass(frozen=True)
class SampleClock:
    """Comparison of the sample counter with a reference clock."""

    offset: float  #: Relative difference of the sample rate from its nominal value.
    sigma: float  #: Standard deviation of `offset`.
    jitter: float  #: Standard deviation of the times about the fitted line, s.


def sample_clocks(samples: SampleBlock, rate: float, reference: float | None = None) -> dict[str, SampleClock]:
    """Compare the counter of samples at `rate`, Hz, with their times and with station time, if known.

    With a temperature `reference`, °C, the offset is that at this temperature: the rate of a quartz changes by tens of
    ppm over the range of a unit, which is fitted by a second-order polynomial.
    """
    nominal, warmth = samples.seq / rate, None
    known = np.flatnonzero(~np.isnan(samples.temperature))
    if reference is not None and len(known):
        warmth = np.interp(samples.seq, samples.seq[known], samples.temperature[known]) - reference
    clocks = {"time_s": _clock(nominal, samples.time, rate, warmth)}
    if samples.station.shape[1]:
        clocks["station"] = _clock(nominal, samples.station[:, 0], rate, warmth)
    return {name: clock for name, clock in clocks.items() if clock is not None}


def _clock(nominal: FloatArray, time: FloatArray, rate: float, warmth: FloatArray | None) -> SampleClock | None:
    """Fit the rate of a clock, with an offset for each interval without gaps; None if the intervals are too short.

    Parameters
    ----------
    nominal, time : times by the counter and by the clock, s, shape (n,)
    rate : nominal sample rate, Hz
    warmth : temperatures relative to the reference of the rate, K, shape (n,); None for a constant rate
    """
    interval = np.concatenate([[0], np.cumsum(np.diff(nominal) * rate > 1.5)])
    is_known = ~np.isnan(time)
    nominal, late, interval = nominal[is_known], (time - nominal)[is_known], interval[is_known]
    warmth = None if warmth is None else warmth[is_known]
    if not len(nominal) or np.ptp(late) < _DERIVED:
        return None
    # Use means over windows, so that a common delay of several samples is counted once.
    window = np.floor((nominal - nominal[0]) / _WINDOW).astype(np.int64) + interval * (1 << 32)
    _, first, index = np.unique(window, return_index=True, return_inverse=True)
    weight = np.bincount(index)
    x, y = np.bincount(index, nominal) / weight, np.bincount(index, late) / weight
    part = np.unique(interval[first], return_inverse=True)[1]
    parts = np.bincount(part)
    columns = [x]
    if warmth is not None:
        mean = np.bincount(index, warmth) / weight
        columns += [np.cumsum(mean**power * np.diff(x, prepend=x[0])) for power in (1, 2)]
    y, *columns = (v - (np.bincount(part, v) / parts)[part] for v in (y, *columns))
    design, x = np.stack(columns, axis=1), columns[0]
    free = len(x) - len(parts) - len(columns)
    if free < _MIN_WINDOWS:
        return None
    sizes = np.linalg.norm(design, axis=0)
    sizes[sizes == 0.0] = 1.0
    inverse = np.linalg.pinv(design / sizes, rcond=1e-6)
    fitted = inverse @ y / sizes
    slope, spread = float(fitted[0]), float(np.linalg.norm(inverse[0])) / float(sizes[0])
    scatter = float(np.sqrt(((y - design @ fitted) ** 2).sum() / free))
    within_window = late - (np.bincount(index, late) / weight)[index]
    jitter = float(np.hypot(scatter, within_window.std()))
    # Delays may also change slowly, for example if times are read at multiples of the sample period.
    sigma = float(np.hypot(scatter * spread, jitter / np.ptp(x)))
    return SampleClock(-slope / (1.0 + slope), sigma, jitter)


def _windows(values: FloatArray, rate: float) -> FloatArray:
    """Return the means of values over windows of `_WINDOW`, shape (m,)."""
    width = max(round(_WINDOW * rate), 1)
    return np.asarray(values[: len(values) // width * width].reshape(-1, width).mean(axis=1))


def temperature_coefficients(rests: RestResiduals, samples: SampleBlock, gravity: float) -> dict[str, Any]:
    """Regress the residuals of rests on the temperature.

    Return the change of each bias and accelerometer scale per °C that the rests determine, with its sigma, SI, as JSON
    values; {} if the temperature of the rests is constant. A rest determines the gyro bias along up and the force
    component along up.

    Parameters
    ----------
    rests : residuals of the k rests of a stage, SI
    samples : samples of the stage with their temperatures, °C
    gravity : local gravity, m/s²
    """
    measured = ~np.isnan(samples.temperature)
    warmth = np.interp(0.5 * (rests.first_seq + rests.last_seq), samples.seq[measured], samples.temperature[measured])
    if not len(rests) or not np.ptp(warmth) > _MIN_CHANGE:
        return {}
    up = rests.up
    square = gravity * up**2
    per_degree = {
        **_per_degree(up, warmth, rests.vertical_rate, rests.rate_sigma, ("gyro_bias",)),
        **_per_degree(np.hstack([up, square]), warmth, rests.force, rests.force_sigma, ("accel_bias", "accel_scale")),
    }
    return {"per_degree": per_degree}


def _per_degree(
    columns: FloatArray, warmth: FloatArray, residual: FloatArray, sigma: FloatArray, groups: tuple[str, ...]
) -> dict[str, dict[str, float]]:
    """Return the value and sigma of the coefficient of each of m columns, shape (k, m), from k rests, by parameter."""
    names = [PARAMETERS[i].name for group in groups for i in group_indices(group)]
    rows = np.hstack([columns * (warmth - warmth.mean())[:, None], columns]) / sigma[:, None]
    if len(rows) <= rows.shape[1] or np.linalg.cond(rows / np.linalg.norm(rows, axis=0)) > 1e3:
        return {}
    covariance = np.linalg.inv(rows.T @ rows)
    values = covariance @ rows.T @ (residual / sigma)
    spread = max(1.0, float(np.sqrt(((rows @ values - residual / sigma) ** 2).sum() / (len(rows) - rows.shape[1]))))
    sigmas = np.sqrt(np.diag(covariance)) * spread
    return {name: {"value": float(values[i]), "sigma": float(sigmas[i])} for i, name in enumerate(names)}
