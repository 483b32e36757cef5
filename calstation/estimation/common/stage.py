"""Samples of a stage as contiguous arrays (raw rates, encoder angles, segments between gaps), and its rests."""

import itertools
import pickle
import tempfile
import weakref
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from calstation.errors import InsufficientDataError
from calstation.estimation.common.context import ImuModel, Posterior
from calstation.estimation.common.samples import SampleBlock, join_blocks
from calstation.physics import BoolArray, FloatArray, IntArray, kernel

#: Width of the averaging window of rest detection, s.
REST_WINDOW = 0.5
#: Largest rate minus bias at rest, before noise: this many sigmas of the bias ...
BIAS_SIGMAS = 3.0
#: ... plus this rate, rad/s, which includes earth rate.
REST_RATE = np.deg2rad(0.1)
#: Time omitted at both ends of a rest, s, because a table creeps before it settles.
REST_MARGIN = 0.3
#: Shortest rest, s; a shorter interval is a pause during a rotation.
SHORTEST_REST = 1.0
#: Number of samples of a joined block, because many small blocks are slow, and number of such blocks kept in memory:
#: 44 minutes at 200 Hz in 60 MB. Reading them from the file would take several percent of the time of a solution.
_BLOCK_SAMPLES, _BLOCKS_IN_MEMORY = 16_384, 32
#: Number of samples before and after a jump in time whose medians determine whether it is permanent.
_JITTER_SAMPLES = 20
#: Change of the mean specific force from one window to the next that indicates a new position, m/s².
FORCE_STEP = 0.5


@dataclass(frozen=True)
class StageData:
    """Valid samples of one stage."""

    dt: float  #: Sample period, s.
    seq: IntArray  #: As in `SampleBlock`, shape (n,).
    time: FloatArray  #: As in `SampleBlock`, shape (n,).
    gyro: FloatArray  #: Raw mean rate, rad/s, shape (n, 3).
    accel: FloatArray  #: Raw mean specific force, m/s², shape (n, 3).
    angles: FloatArray  #: Encoder angles, rad, NaN between polls, shape (n, 2).
    step: IntArray  #: As in `SampleBlock`, shape (n,).
    segments: tuple[tuple[int, int], ...]  #: (start, stop) of each interval without gap, reset or invalid sample.
    gaps: int  #: Number of gaps and resets within the stage.
    others: FloatArray = field(default_factory=lambda: np.empty((0, 0, 6)))  #: As in `SampleBlock`.
    joints: FloatArray = field(default_factory=lambda: np.empty((0, 0)))  #: As in `SampleBlock`.

    def __len__(self) -> int:
        return len(self.seq)

    @property
    def has_gyros(self) -> bool:
        """Whether the samples contain gyro output, which is NaN for a unit without gyros."""
        return not np.isnan(self.gyro[:1]).any()

    @property
    def has_angles(self) -> bool:
        """Whether an encoder was polled; a recording by hand has no encoder angles."""
        return bool(np.isfinite(self.angles).any())

    def seq_range(self, start: int, stop: int) -> dict[str, int]:
        """Return the first and last sequence number of samples `start` to `stop` as JSON values."""
        return {"first_seq": int(self.seq[start]), "last_seq": int(self.seq[stop - 1])}


def stage_data(blocks: list[SampleBlock], imu: ImuModel) -> StageData:
    """Join the blocks of a stage; invalid samples are omitted and count as gaps, like missing ones."""
    dt, block = 1.0 / imu.sample_rate, join_blocks(blocks)
    valid = slice(None) if block.valid.all() else block.valid  # a slice copies nothing
    seq, time, counts = block.seq[valid], block.time[valid], np.asarray(block.counts[valid], np.float64)
    broken = (np.diff(seq) != 1) | _time_jumps(seq, time, dt)
    cuts = np.concatenate([[0], np.flatnonzero(broken) + 1, [len(seq)]])
    segments = tuple((int(a), int(b)) for a, b in itertools.pairwise(cuts) if b > a)
    gyro, accel = sensor_rates(counts, imu, segments)
    return StageData(
        dt=dt,
        seq=seq,
        time=time,
        gyro=gyro,
        accel=accel,
        angles=block.angles[valid],
        step=block.step[valid],
        segments=segments,
        gaps=int(np.count_nonzero(broken)),
        others=block.others[valid],
        joints=block.joints[valid],
    )


def sensor_rates(
    counts: FloatArray, imu: ImuModel, segments: Sequence[tuple[int, int]]
) -> tuple[FloatArray, FloatArray]:
    """Return the mean rates, rad/s, and forces, m/s², of samples; undo the coning and low-pass stated in the profile.

    Parameters
    ----------
    counts : samples, shape (n, 6)
    imu : model of the IMU
    segments : (start, stop) of the intervals of consecutive samples
    """
    gyro = _scaled(counts[:, :3], imu.gyro_lsb * imu.rate_factor)
    accel = _scaled(counts[:, 3:], imu.accel_lsb * imu.rate_factor)
    dt = 1.0 / imu.sample_rate
    for a, b in segments if imu.coning_compensated or imu.half_variance else ():
        if imu.coning_compensated:
            gyro[a:b] = _without_coning(gyro[a:b], dt)
        if imu.half_variance:
            for values in (gyro, accel):
                values[a:b] = _without_low_pass(values[a:b], imu.half_variance / dt**2)
    return gyro, accel


def _without_coning(rate: FloatArray, dt: float) -> FloatArray:
    """Return the mean rates of increments that are rotation vectors, rad/s, shape (n, 3).

    To third order, a rotation vector exceeds the integral of the rate by (Δθ_(k−1) × Δθ_k)/12 (Savage 1998).
    """
    return np.asarray(rate - dt / 12.0 * np.cross(np.concatenate([rate[:1], rate[:-1]]), rate))


def _without_low_pass(values: FloatArray, half_variance: float) -> FloatArray:
    """Remove a low-pass from samples, shape (n, 3), except its mean delay, which is common to all channels.

    To second order, the output is x + c d²x/dt², where c is half the variance of the impulse response, here in
    samples². The second derivative is taken over enough samples to limit the increase of the noise.
    """
    step = max(1, int(np.ceil(2.0 * np.sqrt(half_variance))))
    padded = np.pad(values, ((step, step), (0, 0)), mode="edge")
    curvature = padded[2 * step :] - 2.0 * values + padded[: -2 * step]
    return np.asarray(values - half_variance / step**2 * curvature)


class StageBuffer:
    """Stores the samples of a stage until it is solved; the older samples of a long stage are in a temporary file."""

    def __init__(self, imu: ImuModel) -> None:
        self._imu = imu
        self._file = tempfile.TemporaryFile(prefix="calstation-")  # noqa: SIM115 - open for the life of the buffer
        weakref.finalize(self, self._file.close)
        self._written = 0  # number of blocks in the file
        self._in_memory: deque[SampleBlock] = deque()
        self._pending: list[SampleBlock] = []
        self._pending_samples = 0
        self._block: SampleBlock | None = None
        self._data: StageData | None = None

    def append(self, block: SampleBlock) -> None:
        """Append samples; all blocks must have the same columns. Raises OSError if the disk is full."""
        self._block = self._data = None
        self._pending.append(block)
        self._pending_samples += len(block)
        if self._pending_samples >= _BLOCK_SAMPLES:
            self._in_memory.append(join_blocks(self._pending))
            self._pending, self._pending_samples = [], 0
        if len(self._in_memory) > _BLOCKS_IN_MEMORY:
            pickle.dump(self._in_memory.popleft(), self._file, pickle.HIGHEST_PROTOCOL)
            self._written += 1

    def block(self) -> SampleBlock:
        """Return all samples stored so far; the same object until more are stored."""
        if self._block is None:
            self._file.seek(0)
            written = [pickle.load(self._file) for _ in range(self._written)]
            self._block = join_blocks([*written, *self._in_memory, *self._pending])
        return self._block

    def data(self) -> StageData:
        """Return the valid samples stored so far in physical units; the same object until more are stored."""
        if self._data is None:
            self._data = stage_data([self.block()], self._imu)
        return self._data


@kernel
def _scaled(counts: FloatArray, size: float) -> FloatArray:
    """Return n samples of three channels times `size`, shape (n, 3); NumPy is slow for short rows."""
    scaled = np.empty(counts.shape)
    for k in range(len(counts)):
        for j in range(counts.shape[1]):
            scaled[k, j] = counts[k, j] * size
    return scaled


def _time_jumps(seq: IntArray, time: FloatArray, dt: float) -> BoolArray:
    """Return whether the time jumps permanently after each sample, not only by jitter of arrival, shape (n − 1,)."""
    jumps = np.abs(np.diff(time) - dt) > 0.5 * dt
    delay = time - seq * dt
    for k in np.flatnonzero(jumps & (np.diff(seq) == 1)):
        before, after = delay[max(k + 1 - _JITTER_SAMPLES, 0) : k + 1], delay[k + 1 : k + 1 + _JITTER_SAMPLES]
        jumps[k] = abs(float(np.median(after) - np.median(before))) > 0.5 * dt
    return jumps


@kernel
def window_mean(values: FloatArray, offset: FloatArray, width: int) -> FloatArray:
    """Return the moving mean of `width` samples minus `offset`, shape (n − width + 1, 3).

    `values` has the shape (n, 3), `offset` (3,). A mean is computed as the difference of two running totals.
    """
    mean = np.empty((max(len(values) - width + 1, 0), 3))
    for j in range(3):
        total = subtracted = 0.0
        shift = offset[j]
        for k in range(min(width - 1, len(values))):
            total += values[k, j] - shift
        for k in range(len(mean)):
            total += values[k + width - 1, j] - shift
            mean[k, j] = (total - subtracted) / width
            subtracted += values[k, j] - shift
    return mean


@kernel
def means(values: FloatArray, counts: IntArray) -> FloatArray:
    """Return the means of the rows of `values`, shape (n, m), over k groups of `counts` rows, shape (k, m)."""
    mean, first = np.zeros((len(counts), values.shape[1])), 0
    for g in range(len(counts)):
        for k in range(first, first + counts[g]):
            for j in range(values.shape[1]):
                mean[g, j] += values[k, j]
        for j in range(values.shape[1]):
            mean[g, j] /= counts[g]
        first += counts[g]
    return mean


def group_means(values: FloatArray, width: int) -> FloatArray:
    """Return the means of consecutive groups of `width` rows; an incomplete last group is omitted."""
    return means(values, np.full(len(values) // width, width))


@kernel
def row_maxima(values: FloatArray) -> FloatArray:
    """Return the largest magnitude in each row, shape (n,), NaN for a row with NaN; NumPy is slow for short rows."""
    sizes = np.empty(len(values))
    for k in range(len(values)):
        largest = 0.0
        for j in range(values.shape[1]):
            size = abs(values[k, j])
            if size > largest or size != size:
                largest = size
        sizes[k] = largest
    return sizes


def find_rests(
    data: StageData,
    imu: ImuModel,
    gyro_bias: tuple[FloatArray, float],
    segments: Sequence[tuple[int, int]] | None = None,
) -> list[tuple[int, int]]:
    """Find the rests (start, stop) of a stage, or of some of its segments.

    Rates are averaged over `REST_WINDOW`. The rate at rest, the sum of bias and earth rate, is the median of the
    windows in which the rate is small (`BIAS_SIGMAS`, 5 sigma of noise, `REST_RATE`) and constant. A rest is an
    interval in which no window differs from it by more than noise plus 0.03 °/s (earth rate is 0.004 °/s), which
    excludes table creep. A step of the specific force (`FORCE_STEP`) separates two rests even without a recorded
    rotation.

    Parameters
    ----------
    data, imu : samples of the stage, and the profile with their noise
    gyro_bias : biases, shape (3,), and their sigma, rad/s, see `Posterior.gyro_bias`
    segments : indices (start, stop) of samples without gaps; None for all of the stage
    """
    width = max(round(REST_WINDOW / data.dt), 2)
    margin = round(REST_MARGIN / data.dt)
    rests = []
    for start, stop in data.segments if segments is None else segments:
        if stop - start < 2 * width:
            continue
        mean = window_mean(data.gyro[start:stop], gyro_bias[0], width)
        constant = _small_and_constant(mean, width, *_rest_limits(imu, width, data.dt, gyro_bias[1]))
        if not constant.shape[1]:
            continue
        at_rest = np.array([_median(rates) for rates in constant])
        still = _still(mean, at_rest, 5.0 * _window_noise(imu, width, data.dt) + np.deg2rad(0.03))
        _split(data.accel[start:stop], width, still)
        for first, last in true_intervals(still):
            begin = start + first + (margin if first > 0 else 0)
            end = start + last + width - 1
            end -= margin if end < stop else 0
            if end - begin >= width:
                rests.append((begin, end))
    return rests


def no_rest_error(data: StageData, imu: ImuModel, posterior: Posterior) -> InsufficientDataError:
    """Return the error for a recording without a rest.

    Its values, °/s, are the smallest rate and rate change of a window, NaN for a recording shorter than two windows,
    and the largest values that `find_rests` accepts.
    """
    bias, sigma = posterior.gyro_bias
    width, rate, change = max(round(REST_WINDOW / data.dt), 2), np.nan, np.nan
    if len(data) >= 2 * width:
        mean = window_mean(data.gyro, bias, width)
        rate, change = float(row_maxima(mean).min()), float(row_maxima(mean[width:] - mean[:-width]).min())
    limits = _rest_limits(imu, width, data.dt, sigma)
    values = dict(zip(("rate", "change", "largest_rate", "largest_change"), (rate, change, *limits), strict=True))
    in_degrees = {name: float(np.rad2deg(value)) for name, value in values.items()}
    return InsufficientDataError("solve.no_rest_to_align", seconds=len(data) * data.dt, **in_degrees)


def _rest_limits(imu: ImuModel, width: int, dt: float, bias_sigma: float) -> tuple[float, float]:
    """Return the largest rate of a window at rest, and its largest change to the next window, rad/s."""
    noise = 5.0 * _window_noise(imu, width, dt)
    return BIAS_SIGMAS * bias_sigma + noise + REST_RATE, noise + np.deg2rad(0.01)


def _window_noise(imu: ImuModel, width: int, dt: float) -> float:
    rounding = 1.0 / (width * dt) if imu.output == "increment" else 1.0 / np.sqrt(width)
    return float(imu.gyro_arw / np.sqrt(width * dt) + imu.quantisation[0] * rounding)


@kernel
def _small_and_constant(rate: FloatArray, width: int, max_rate: float, max_change: float) -> FloatArray:
    """Return the windows whose mean rate is small and close to the mean of the preceding window, shape (3, k)."""
    windows, count = np.empty((3, len(rate))), 0
    for k in range(width, len(rate)):
        agrees = True
        for j in range(3):
            agrees &= abs(rate[k, j]) < max_rate and abs(rate[k, j] - rate[k - width, j]) < max_change
            windows[j, count] = rate[k, j]
        count += agrees
    return windows[:, :count]


def _median(values: FloatArray) -> float:
    """Return the median; `np.median` takes five times as long, because it partitions about several elements."""
    half = len(values) // 2
    partitioned = np.partition(values, half)
    return float(partitioned[half] if len(values) % 2 else 0.5 * (partitioned[:half].max() + partitioned[half]))


@kernel
def _still(rate: FloatArray, at_rest: FloatArray, max_difference: float) -> BoolArray:
    """Return whether each window has the rate at rest, shape (n,)."""
    still = np.ones(len(rate), dtype=np.bool_)
    for k in range(len(rate)):
        for j in range(3):
            still[k] &= abs(rate[k, j] - at_rest[j]) < max_difference
    return still


@kernel
def _split(accel: FloatArray, width: int, still: BoolArray) -> None:
    """Clear `still` for windows whose mean force differs from the preceding or following one by over `FORCE_STEP`."""
    step = FORCE_STEP * width
    for j in range(3):
        current = previous = 0.0  # sums over a window and over the preceding one
        for k in range(width):
            current += accel[width + k, j]
            previous += accel[k, j]
        for k in range(width, len(still)):
            if abs(current - previous) > step:
                still[k] = still[k - width] = False
            if k + width < len(accel):
                current += accel[k + width, j] - accel[k, j]
                previous += accel[k, j] - accel[k - width, j]


def true_intervals(flags: BoolArray) -> list[tuple[int, int]]:
    """Return the intervals (first, last + 1) in which `flags` is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def slope_weights(count: int, stride: int) -> FloatArray:
    """Return weights for the mean force of a rest, shape (count,), equivalent to fitting a line to mean velocities.

    The means are over `stride` samples, between which the noise is independent; the remainder of a rest is omitted. For
    white velocity noise this is the best linear unbiased estimate of the mean.
    """
    blocks = max(count // stride - 1, 1)
    j = np.arange(1, blocks + 1)
    per_block = 6.0 * j * (blocks + 1 - j) / (blocks * (blocks + 1) * (blocks + 2))
    width = min(stride, max(count // 2, 1))
    weights = np.zeros(count)
    part = np.convolve(np.repeat(per_block, width), np.ones(width)) / width**2
    weights[: len(part)] = part
    return weights


def mean_angles(data: StageData, start: int, stop: int) -> FloatArray | None:
    """Return the mean encoder angles of a rest, rad, shape (2,); None if the encoders were not polled during it.

    Parameters
    ----------
    data : samples of a stage
    start, stop : first sample of the rest, and the one after its last
    """
    polled = data.angles[start:stop]
    polled = polled[np.isfinite(polled[:, 0]) & np.isfinite(polled[:, 1])]
    return polled.mean(axis=0) if len(polled) else None
