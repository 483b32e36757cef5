"""Faults of the samples themselves: repeated or lost samples, spikes, wraps, stuck channels, suppressed small values.

They are detected without a model of the unit, from each channel and its neighbouring samples, and from the angles of
the table. The noise of a channel is measured in windows from second differences, which motion hardly affects.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import erf, gammainc

from calstation.estimation import Diagnosis, ModelTest
from calstation.estimation.common import ImuModel, SampleBlock, SolveContext, StageData
from calstation.judgement.lost_samples import SampleFault, line_weights, shifts, shifts_of_angles
from calstation.judgement.table_motion import TableMotion
from calstation.physics import CHANNELS, BoolArray, FloatArray, IntArray, kernel, rotation_rate

#: Window in which noise and repetitions are measured, s.
_WINDOW = 1.0
#: Ratio of the median magnitude of a second difference to the standard deviation of white noise.
_MEDIAN_OF_SECOND = 0.6745 * 6.0**0.5
#: Smallest noise of a channel, in steps, because of rounding.
_ROUNDING = 0.3
#: Largest probability that repetitions in a stage occur by chance, for a fault, and factor of their expected number,
#: because the repetitions of different channels are not quite independent.
_CHANCE, _DEPENDENCE = 1e-7, 3.0
#: Number of samples on each side from which a value is predicted, and on each side of a spike that must not deviate.
_SPIKE_FIT, _SPIKE_NEAR = 4, 10
#: Smallest spike, in sigmas of the noise of the channel, in steps, and relative to the neighbouring deviations.
_SPIKE_SIGMAS, _SPIKE_STEPS, _SPIKE_RATIO = 12.0, 4.0, 5.0
#: Changes of a count by the range of its field, and their largest deviations relative to the range, before and after
#: the usual change between samples is subtracted.
_WRAPS, _NEAR_WRAP, _WRAP_TOLERANCE = (2.0**16, 2.0**24, 2.0**32), 0.1, 0.01
#: Largest change of a channel that is not a jump, in sigmas of its noise.
_LARGEST_NOISE = 50.0
#: Fraction of repeated samples above which a channel is coarse: its steps exceed its noise.
_COARSE = 0.9
#: Number of samples in the shortest tested run of one value, and smallest rms deviation of a stuck channel from the
#: neighbouring samples, in sigmas.
_STUCK_SAMPLES, _STUCK_SIGMAS = 5, 6.0
#: Dead zone: smallest number of windows in which a channel is 0; smallest noise in other windows, in steps; or smallest
#: nonzero value, in steps.
_CONSTANT_WINDOWS, _NOISY, _GAP = 3, 0.7, 10.0
#: Smallest fraction of equal samples near a spike at which the channel keeps this value.
_KEPT = 0.7
#: Smallest number of rests, and smallest variation of earth rate in sigmas, for the test of a gyro's response to earth
#: rate; largest response of a gyro in lock-in, as a fraction.
_MIN_RESTS, _EARTH_SIGMAS, _EARTH_SHARE = 4, 8.0, 0.3
#: Smallest rotation measured by a gyro that is tested for lock-in, rad.
_TURNED = 0.5
#: Stiction: smallest change of a channel, in steps of its values; smallest fraction of repetitions; smallest number of
#: changes.
_STICKS, _STICKS_REPEATED, _STICKS_CHANGES = 5.0, 0.5, 20


@dataclass(frozen=True)
class _Noise:
    """Noise and repetitions of each channel in windows."""

    width: int  #: Number of samples of a window.
    sigma: FloatArray  #: Standard deviation of white noise, counts, shape (w, 6).
    repeated: FloatArray  #: Fraction of the samples that repeat the preceding value, shape (w, 6).
    step: FloatArray  #: Smallest step of each channel, counts, shape (6,).

    def at(self, index: IntArray) -> IntArray:
        """Return the windows of samples."""
        return np.minimum(index // self.width, len(self.sigma) - 1)


def sample_test(
    samples: SampleBlock, data: StageData, context: SolveContext, motion: TableMotion | None
) -> list[ModelTest]:
    """Test the samples of a stage with the `motion` of the table; [] if the stage is too short."""
    counts, time = samples.counts[samples.valid], samples.time[samples.valid]
    width = max(round(_WINDOW * context.imu.sample_rate), 20)
    if len(counts) < 3 * width or len(counts) != len(data):
        return []
    counts = np.nan_to_num(counts)
    broken = np.concatenate([[True], np.diff(data.seq) != 1])
    for start, _ in data.segments:
        broken[start] = True
    imu = context.imu
    rounding = np.repeat(imu.quantisation, 3) * imu.rate_factor / imu.count_size
    noise = _noise_of(counts, width, rounding)
    fault = next(_faults(counts, broken, noise, data, motion, context), None)
    if fault is None:
        return [ModelTest("samples", 0.0, 0.0, "1", Diagnosis("samples_repeated"))]
    at = fault.samples
    if fault.cause == "clipped" and fault.channel is not None:
        diagnosis = clipped(counts[:, fault.channel], fault.size, time, fault.channel, imu)
    else:
        channel = "" if fault.channel is None else CHANNELS[fault.channel]
        values = {"channel": channel, "count": len(at), "first": float(time[at[0]]), "last": float(time[at[-1]])}
        diagnosis = Diagnosis(fault.cause, values={**values, "amount": fault.size})
    return [ModelTest("samples", float(len(at)), 0.0, "1", diagnosis)]


def clipped(
    counts: FloatArray, extreme: float, time: FloatArray, channel: int, imu: ImuModel, number: str = ""
) -> Diagnosis:
    """Return the diagnosis of a channel that is clipped.

    Parameters
    ----------
    counts, time : output of the channel, counts, and its times, s, shape (n,) each
    extreme : value at which it is clipped, counts
    channel : index of the channel, 0 to 5
    imu : profile with the size of a count
    number : displayed number of a secondary IMU, "" for the primary
    """
    at = np.flatnonzero(counts == extreme)
    level = float(extreme * imu.count_size[channel])
    displayed, unit = (np.rad2deg(level), "°/s") if channel < 3 else (level, "m/s²")
    values = {
        "channel": CHANNELS[channel].replace("_", f"{number} "),
        "level": float(displayed),
        "level_unit": unit,
        "count": len(at),
        "first": float(time[at[0]]),
        "last": float(time[at[-1]]),
    }
    return Diagnosis("clipped", level, unit="rad/s" if channel < 3 else "m/s²", values=values)


def _noise_of(counts: FloatArray, width: int, rounding: FloatArray) -> _Noise:
    windows = len(counts) // width
    shaped = counts[: windows * width].reshape(windows, width, -1)
    second = np.abs(np.diff(shaped, 2, axis=1))
    change = np.diff(shaped, axis=1)
    step = np.array([np.diff(np.unique(column)).min(initial=np.inf) for column in counts[: 20 * width].T])
    step = np.maximum(np.where(np.isfinite(step), step, 1.0), rounding)
    sigma = np.maximum(np.median(second, axis=1) / _MEDIAN_OF_SECOND, _ROUNDING * step)
    return _Noise(width, sigma, (change == 0.0).mean(axis=1), step)


def _faults(
    counts: FloatArray,
    broken: BoolArray,
    noise: _Noise,
    data: StageData,
    motion: TableMotion | None,
    context: SolveContext,
) -> Iterator[SampleFault]:
    """Yield the faults; faults that cause others come first."""
    yield from _wraps(counts, broken, noise)
    yield from _repeated_rows(counts, broken, noise)
    yield from _sticking(counts, noise)
    yield from _dead_zones(counts, noise)
    if motion is not None:
        yield from _lock_in(data, motion, context)
        yield from _spikes(counts, broken, noise)
        yield from _stuck(counts, broken, noise)
        yield from shifts(counts, broken, noise.sigma, noise.width)
        yield from shifts_of_angles(data, motion, context)


def _wraps(counts: FloatArray, broken: BoolArray, noise: _Noise) -> Iterator[SampleFault]:
    """Yield channels that jump by the range of a counter from one sample to the next, while no other channel jumps."""
    change = np.diff(counts, axis=0)
    change[broken[1:]] = 0.0
    for channel in range(counts.shape[1]):
        for wrap in _WRAPS:
            near = np.flatnonzero(np.abs(np.abs(change[:, channel]) - wrap) < _NEAR_WRAP * wrap)
            at = []
            for k, window in zip(near.tolist(), noise.at(near), strict=True):
                usual = np.median(change[max(k - 5, 0) : k + 6], axis=0)
                jump = np.abs(change[k] - usual)
                alone = np.count_nonzero(jump > _LARGEST_NOISE * noise.sigma[window]) == 1
                if (
                    alone
                    and abs(usual[channel]) < _NEAR_WRAP * wrap
                    and abs(jump[channel] - wrap) < _WRAP_TOLERANCE * wrap
                ):
                    at.append(k + 1)
            if at:
                yield SampleFault("count_wrapped", np.array(at), channel, wrap)


def _repeated_rows(counts: FloatArray, broken: BoolArray, noise: _Noise) -> Iterator[SampleFault]:
    """Yield samples that repeat all channels of the preceding sample, if chance does not explain them."""
    same = np.concatenate([[False], (np.diff(counts, axis=0) == 0.0).all(axis=1)]) & ~broken
    at = np.flatnonzero(same)
    if not len(at):
        return
    windows = noise.at(at)
    per_window = np.bincount(windows, minlength=len(noise.sigma))
    other = noise.repeated * noise.width - per_window[:, None]
    chance = np.clip((np.maximum(other, 0.0) + 0.5) / (noise.width + 1.0 - per_window[:, None]), 0.0, 1.0)
    expected = noise.width * np.prod(chance, axis=1)
    for limit in (1e-8, 1e-6, 1e-4, 1e-2, np.inf):
        rare = expected < limit
        number, mean = int(per_window[rare].sum()), _DEPENDENCE * float(expected[rare].sum())
        if number and gammainc(number, mean) < _CHANCE:
            yield SampleFault("samples_repeated", at[rare[windows]])
            return


@kernel
def _deviations(values: FloatArray, broken: BoolArray, count: int) -> FloatArray:
    """Return the smaller deviation of each value from lines through `count` samples before and after, shape (n,).

    At a bend, a value lies on one of the lines. The deviation is 0 near a gap.
    """
    deviation = np.zeros(len(values))
    before, after = line_weights(-count, -1, 0.0), line_weights(1, count, 0.0)
    gap = -1
    next_gap = np.full(len(values), len(values))
    for k in range(len(values) - 2, -1, -1):
        next_gap[k] = k + 1 if broken[k + 1] else next_gap[k + 1]
    for k in range(len(values)):
        if broken[k]:
            gap = k
        if k - count < max(gap, 0) or k + count >= next_gap[k]:
            continue
        low = high = values[k]
        for j in range(count):
            low -= before[j] * values[k - count + j]
            high -= after[j] * values[k + 1 + j]
        deviation[k] = min(abs(low), abs(high))
    return deviation


def _spikes(counts: FloatArray, broken: BoolArray, noise: _Noise) -> Iterator[SampleFault]:
    """Yield single samples of a channel that deviate from the samples on both sides."""
    window = noise.at(np.arange(len(counts)))
    neighbours = np.concatenate([np.arange(-_SPIKE_NEAR, 0), np.arange(1, _SPIKE_NEAR + 1)])
    for channel in range(counts.shape[1]):
        values = np.ascontiguousarray(counts[:, channel])
        deviation = _deviations(values, broken, _SPIKE_FIT)
        sigma = noise.sigma[window, channel]
        large = np.flatnonzero(deviation > np.maximum(_SPIKE_SIGMAS * sigma, _SPIKE_STEPS * noise.step[channel]))
        near = np.pad(deviation, _SPIKE_NEAR)[large[:, None] + _SPIKE_NEAR + neighbours].max(axis=1)
        at = large[deviation[large] > _SPIKE_RATIO * near]
        if len(at) and np.mean((counts[at] == counts[at - 1]).all(axis=1)) > 0.5:
            yield SampleFault("samples_repeated", at)
        elif len(at):
            yield _spike_fault(values, at, channel, float(np.max(deviation[at] / sigma[at])))


def _spike_fault(values: FloatArray, at: IntArray, channel: int, size: float) -> SampleFault:
    """Return the fault of deviating samples: spikes, or samples at which a channel leaves its usual value.

    A clipped channel leaves its extreme value.
    """
    around = [values[max(k - _SPIKE_NEAR, 0) : k + _SPIKE_NEAR + 1] for k in at.tolist()]
    kept = [float(np.median(near)) for near in around]
    before = values[at[:, None] - np.arange(1, _SPIKE_FIT + 1)]
    for extreme in (values.max(), values.min()):  # a remainder that is carried over ends the clipping
        if np.all(before == extreme) and np.all(values[at + 1] != extreme):
            return SampleFault("clipped", at, channel, float(extreme))
    share = np.median([np.mean(near == value) for near, value in zip(around, kept, strict=True)])
    if share < _KEPT:
        return SampleFault("spikes", at, channel, size)
    if np.mean(np.array(kept) == 0.0) > 0.5:
        return SampleFault("dead_zone", at, channel, float(np.abs(values[at]).min()))
    return SampleFault("stiction", at, channel, float(np.abs(values[at] - kept).min()))


def _stuck(counts: FloatArray, broken: BoolArray, noise: _Noise) -> Iterator[SampleFault]:
    """Yield the first run of one value in a channel that the noise or the motion of the channel contradicts."""
    fit = _SPIKE_FIT + 2
    for channel in range(counts.shape[1]):
        values = counts[:, channel]
        same = np.concatenate([[False], np.diff(values) == 0.0, [False]])
        edges = np.flatnonzero(np.diff(same.astype(np.int8)))
        first, last = edges[::2], edges[1::2]  # samples first to last have one value
        long = (last - first >= _STUCK_SAMPLES - 1) & (first >= fit) & (last + fit < len(values))
        first, last = first[long], last[long]
        lowest = float(np.quantile(noise.sigma[:, channel], 0.05)) / noise.step[channel]
        # a value repeats most often if the true value is in the middle of a step
        usual = max(float(np.quantile(noise.repeated[:, channel], 0.95)), float(erf(0.5 / (lowest * 2.0**0.5))))
        nearby = [
            noise.repeated[noise.at(np.maximum(at, 0)), channel] for at in (first - noise.width, last + noise.width)
        ]
        repeated = np.maximum(np.maximum(*nearby), usual)
        chance = (last - first) * np.log(np.minimum(repeated, 1.0)) + np.log(len(values))
        improbable = (repeated < _COARSE) & (chance < np.log(_CHANCE))
        sigma = np.maximum(noise.sigma[noise.at(first), channel], noise.step[channel])
        around = np.maximum(np.abs(values[first - 2] - values[first]), np.abs(values[last + 2] - values[first]))
        for k in np.flatnonzero(improbable | (around > 2.0 * sigma)).tolist():
            a, b = int(first[k]), int(last[k])
            if broken[a - fit + 1 : b + fit + 1].any():
                continue
            if improbable[k] or _contradicted(values, a, b, fit, float(sigma[k])):
                yield SampleFault(
                    "dead_zone" if values[a] == 0.0 else "stuck", np.arange(a, b + 1), channel, b - a + 1.0
                )
                return


def _contradicted(values: FloatArray, first: int, last: int, fit: int, sigma: float) -> bool:
    """Return whether a run of one value deviates from the line through `fit` samples before and after it."""
    length = last - first + 1
    x = np.concatenate([np.arange(-fit, 0), np.arange(length, length + fit)])
    y = np.concatenate([values[first - fit : first], values[last + 1 : last + 1 + fit]])
    line = np.polynomial.polynomial.polyfit(x, y, 1)
    residual = y - np.polynomial.polynomial.polyval(x, line)
    inside = values[first] - np.polynomial.polynomial.polyval(np.arange(1, length), line)
    spread = max(float(np.sqrt(np.mean(residual**2))), sigma)
    return float(np.sqrt(np.mean(inside**2))) > _STUCK_SIGMAS * spread


def _dead_zones(counts: FloatArray, noise: _Noise) -> Iterator[SampleFault]:
    """Yield channels that are 0 in some windows although they are noisy in others, or that have no small values."""
    windows = len(noise.sigma)
    shaped = counts[: windows * noise.width].reshape(windows, noise.width, -1)
    constant = (shaped == 0.0).mean(axis=1) > 0.95
    for channel in range(counts.shape[1]):
        at = np.flatnonzero(constant[:, channel])
        others = np.abs(counts[:, channel])
        others = others[others > 0.0]
        if len(at) < _CONSTANT_WINDOWS or not len(others):
            continue
        varying = noise.sigma[noise.repeated[:, channel] < 0.5, channel]
        is_noisy = len(varying) and float(np.quantile(varying, 0.2)) > _NOISY * noise.step[channel]
        if is_noisy or others.min() > _GAP * noise.step[channel]:
            yield SampleFault("dead_zone", at * noise.width, channel, float(others.min()))


def _sticking(counts: FloatArray, noise: _Noise) -> Iterator[SampleFault]:
    """Yield channels whose value changes only by several steps at once."""
    for channel in range(counts.shape[1]):
        change = np.abs(np.diff(counts[:, channel]))
        moved = change[change > 0.0]
        if len(moved) < _STICKS_CHANGES or np.mean(change == 0.0) < _STICKS_REPEATED:
            continue
        smallest = float(np.quantile(moved, 0.02))
        values = np.unique(counts[:, channel])
        if smallest > _STICKS * float(np.quantile(np.diff(values), 0.1)):
            at = np.flatnonzero(change > 0.0)
            at_zero = np.mean(counts[1:, channel][change == 0.0] == 0.0)
            yield SampleFault("dead_zone" if at_zero > 0.5 else "stiction", at, channel, smallest)


def _lock_in(data: StageData, motion: TableMotion, context: SolveContext) -> Iterator[SampleFault]:
    """Yield gyros whose rates at the rests vary much less than earth rate would require at any heading."""
    if not data.has_gyros or len(motion.rests) < _MIN_RESTS:
        return
    imu, earth = context.imu, rotation_rate(context.site.latitude)
    duration = np.array([(b - a) * data.dt for a, b in motion.rests])
    rounding = imu.quantisation[0] * imu.rate_factor * data.dt / duration
    noise = np.sqrt(imu.gyro_arw**2 / duration + imu.gyro_bias_instability**2 + rounding**2)
    homes = np.array([context.table.geometry.body_to_home(*pair) for pair in motion.angles])
    headings = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    earths = np.array([[earth[1] * np.sin(h), earth[1] * np.cos(h), earth[2]] for h in headings])
    expected = np.einsum("kji,hj->hki", homes, earths).std(axis=1).min(axis=0)
    measured = motion.rate.std(axis=0)
    for channel in np.flatnonzero(np.abs(motion.rotation).max(axis=0, initial=0.0) > _TURNED).tolist():
        if expected[channel] > _EARTH_SIGMAS * noise.max() and measured[channel] < _EARTH_SHARE * expected[channel]:
            per_hour = 3600.0 * float(np.rad2deg(expected[channel]))
            yield SampleFault("lock_in", np.array([a for a, _ in motion.rests]), channel, per_hour)
