"""Samples of a stage as contiguous arrays (raw rates, encoder angles, segments between gaps), and its rests."""

import itertools
from dataclasses import dataclass, field

import numba as nb
import numpy as np

from calstation.estimation.common.context import Belief, ImuModel
from calstation.estimation.common.samples import SampleBlock
from calstation.physics import BoolArray, FloatArray, IntArray, group_indices

#: Width of the averaging window of rest detection, s.
REST_WINDOW = 0.5
#: At rest the rate minus the bias is below this many sigmas of the bias ...
BIAS_SIGMAS = 3.0
#: ... plus this rate, rad/s.
SLOWEST = np.deg2rad(0.1)
#: Time removed from both ends of a rest found in the data, s, because a table creeps before it settles.
REST_MARGIN = 0.3
#: Number of samples before and after a jump in time whose medians show whether it is permanent.
_JITTER_SAMPLES = 20
#: A larger change of mean specific force from one window to the next, m/s², indicates a new position.
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

    def seq_range(self, start: int, stop: int) -> dict[str, int]:
        """Return the first and last sequence number of samples `start` to `stop` as JSON values."""
        return {"first_seq": int(self.seq[start]), "last_seq": int(self.seq[stop - 1])}


def stage_data(blocks: list[SampleBlock], imu: ImuModel) -> StageData:
    """Join the blocks of a stage; invalid samples are omitted and count as gaps, like missing ones."""
    dt = 1.0 / imu.sample_rate
    known = _joined([b.valid for b in blocks], np.bool_)
    valid = slice(None) if known.all() else known  # a slice copies nothing
    seq = _joined([b.seq for b in blocks], np.int64)[valid]
    time = _joined([b.time for b in blocks], np.float64)[valid]
    counts = _joined([b.counts for b in blocks], np.float64, 6)[valid]
    broken = (np.diff(seq) != 1) | _time_jumps(seq, time, dt)
    cuts = np.concatenate([[0], np.flatnonzero(broken) + 1, [len(seq)]])
    return StageData(
        dt=dt,
        seq=seq,
        time=time,
        gyro=_scaled(counts[:, :3], imu.gyro_lsb * imu.rate_factor),
        accel=_scaled(counts[:, 3:], imu.accel_lsb * imu.rate_factor),
        angles=_joined([b.angles for b in blocks], np.float64, 2)[valid],
        step=_joined([b.step for b in blocks], np.int64)[valid],
        segments=tuple((int(a), int(b)) for a, b in itertools.pairwise(cuts) if b > a),
        gaps=int(np.count_nonzero(broken)),
        others=_joined([b.others for b in blocks], np.float64)[valid] if blocks else np.empty((0, 0, 6)),
        joints=_joined([b.joints for b in blocks], np.float64)[valid] if blocks else np.empty((0, 0)),
    )


@nb.njit(cache=True)
def _scaled(counts: FloatArray, size: float) -> FloatArray:
    """Return n samples of three channels in units of `size`, shape (n, 3); NumPy is slow on short rows."""
    found = np.empty(counts.shape)
    for k in range(len(counts)):
        for j in range(counts.shape[1]):
            found[k, j] = counts[k, j] * size
    return found


def _time_jumps(seq: IntArray, time: FloatArray, dt: float) -> BoolArray:
    """Return the steps of time, shape (n − 1,), that are permanent; jitter of arrival times does not count."""
    jumps = np.abs(np.diff(time) - dt) > 0.5 * dt
    late = time - seq * dt
    for k in np.flatnonzero(jumps & (np.diff(seq) == 1)):
        before, after = late[max(k + 1 - _JITTER_SAMPLES, 0) : k + 1], late[k + 1 : k + 1 + _JITTER_SAMPLES]
        jumps[k] = abs(float(np.median(after) - np.median(before))) > 0.5 * dt
    return jumps


def _joined(parts: list[np.ndarray], dtype: type, columns: int = 0) -> np.ndarray:
    if not parts:
        return np.empty((0, columns) if columns else 0, dtype)
    return (parts[0] if len(parts) == 1 else np.concatenate(parts)).astype(dtype, copy=False)


@nb.njit(cache=True)
def window_mean(values: FloatArray, offset: FloatArray, width: int) -> FloatArray:
    """Return the mean, less `offset`, of the `width` samples ending at each index from width − 1.

    `values` has the shape (n, 3), `offset` (3,), and the result (n − width + 1, 3). A mean is computed as the
    difference of two running totals.
    """
    mean = np.empty((max(len(values) - width + 1, 0), 3))
    for j in range(3):
        ahead = behind = 0.0
        less = offset[j]
        for k in range(min(width - 1, len(values))):
            ahead += values[k, j] - less
        for k in range(len(mean)):
            ahead += values[k + width - 1, j] - less
            mean[k, j] = (ahead - behind) / width
            behind += values[k, j] - less
    return mean


@nb.njit(cache=True)
def group_means(values: FloatArray, width: int) -> FloatArray:
    """Return the means of consecutive groups of `width` rows of three channels, without a remainder."""
    means = np.zeros((len(values) // width, 3))
    for k in range(len(means)):
        for i in range(k * width, (k + 1) * width):
            for j in range(3):
                means[k, j] += values[i, j]
        for j in range(3):
            means[k, j] /= width
    return means


@nb.njit(cache=True)
def largest(values: FloatArray) -> FloatArray:
    """Return the largest magnitude in each row, shape (n,), NaN if the row has one; NumPy is slow on short rows."""
    found = np.empty(len(values))
    for k in range(len(values)):
        most = 0.0
        for j in range(values.shape[1]):
            size = abs(values[k, j])
            if size > most or size != size:
                most = size
        found[k] = most
    return found


def find_rests(
    data: StageData, segment: tuple[int, int], imu: ImuModel, gyro_bias: FloatArray, bias_sigma: float
) -> list[tuple[int, int]]:
    """Find the rests (start, stop) of a segment from its data.

    Rates are averaged over `REST_WINDOW`. The median of the windows in which they are small (`BIAS_SIGMAS`, 5 sigma of
    noise, `SLOWEST`) and constant is the rate at rest, the sum of bias and earth rate. A rest is an interval in which
    no window differs from that rate by more than noise plus 0.03 °/s (earth rate is 0.004 °/s), which excludes table
    creep. A step of the specific force (`FORCE_STEP`) separates two rests even without a recorded rotation.
    `gyro_bias`, shape (3,), and `bias_sigma` are in rad/s.
    """
    start, stop = segment
    width = max(round(REST_WINDOW / data.dt), 2)
    if stop - start < 2 * width:
        return []
    mean = window_mean(data.gyro[start:stop], gyro_bias, width)
    constant = _small_and_constant(mean, width, *_limits_of_rest(imu, width, data.dt, bias_sigma))
    if not constant.shape[1]:
        return []
    at_rest = np.array([_median(rates) for rates in constant])
    still = _still(mean, at_rest, 5.0 * _window_noise(imu, width, data.dt) + np.deg2rad(0.03))
    _split(data.accel[start:stop], width, still)
    margin = round(REST_MARGIN / data.dt)
    found = []
    for first, last in runs(still):
        begin = start + first + (margin if first > 0 else 0)
        end = start + last + width - 1
        end -= margin if end < stop else 0
        if end - begin >= width:
            found.append((begin, end))
    return found


@dataclass(frozen=True)
class Quietest:
    """Smallest rate and rate change of a recording, and the largest ones accepted as a rest by `find_rests`, rad/s."""

    rate: float  #: Smallest rate of a window minus the prior bias.
    largest_rate: float
    change: float  #: Smallest change from one window to the next.
    largest_change: float


def quietest(data: StageData, imu: ImuModel, belief: Belief) -> Quietest:
    """Return the quantities that show why a recording has no rest; NaN if it is shorter than two windows."""
    bias = group_indices("gyro_bias")
    width = max(round(REST_WINDOW / data.dt), 2)
    largest_rate, largest_change = _limits_of_rest(imu, width, data.dt, float(belief.sigma[bias].max()))
    if len(data) < 2 * width:
        return Quietest(np.nan, largest_rate, np.nan, largest_change)
    mean = window_mean(data.gyro, belief.mean[bias], width)
    rate = float(largest(mean).min())
    change = float(largest(mean[width:] - mean[:-width]).min())
    return Quietest(rate, largest_rate, change, largest_change)


def _limits_of_rest(imu: ImuModel, width: int, dt: float, bias_sigma: float) -> tuple[float, float]:
    """Return the largest rate of a window at rest, and its largest change to the next window, rad/s."""
    noise = 5.0 * _window_noise(imu, width, dt)
    return BIAS_SIGMAS * bias_sigma + noise + SLOWEST, noise + np.deg2rad(0.01)


def _window_noise(imu: ImuModel, width: int, dt: float) -> float:
    rounding = 1.0 / (width * dt) if imu.output == "increment" else 1.0 / np.sqrt(width)
    return float(imu.gyro_arw / np.sqrt(width * dt) + imu.quantisation[0] * rounding)


@nb.njit(cache=True)
def _small_and_constant(rate: FloatArray, width: int, most: float, most_change: float) -> FloatArray:
    """Return the windows whose mean rate is small and close to the mean of the preceding window, shape (3, k)."""
    found, count = np.empty((3, len(rate))), 0
    for k in range(width, len(rate)):
        agrees = True
        for j in range(3):
            agrees &= abs(rate[k, j]) < most and abs(rate[k, j] - rate[k - width, j]) < most_change
            found[j, count] = rate[k, j]
        count += agrees
    return found[:, :count]


def _median(values: FloatArray) -> float:
    """Return the same as `np.median`, which takes five times as long because it partitions about several elements."""
    half = len(values) // 2
    parted = np.partition(values, half)
    return float(parted[half] if len(values) % 2 else 0.5 * (parted[:half].max() + parted[half]))


@nb.njit(cache=True)
def _still(rate: FloatArray, at_rest: FloatArray, most: float) -> BoolArray:
    """Return whether each window has the rate at rest, shape (n,)."""
    still = np.ones(len(rate), dtype=np.bool_)
    for k in range(len(rate)):
        for j in range(3):
            still[k] &= abs(rate[k, j] - at_rest[j]) < most
    return still


@nb.njit(cache=True)
def _split(accel: FloatArray, width: int, still: BoolArray) -> None:
    """Mark as not still the windows whose mean force differs from the preceding or following window."""
    step = FORCE_STEP * width
    for j in range(3):
        ahead = behind = 0.0  # sums over a window and over the one before it
        for k in range(width):
            ahead += accel[width + k, j]
            behind += accel[k, j]
        for k in range(width, len(still)):
            if abs(ahead - behind) > step:
                still[k] = still[k - width] = False
            if k + width < len(accel):
                ahead += accel[k + width, j] - accel[k, j]
                behind += accel[k, j] - accel[k - width, j]


def runs(flags: BoolArray) -> list[tuple[int, int]]:
    """Return the intervals (first, last + 1) in which `flags` is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def slope_weights(count: int, stride: int) -> FloatArray:
    """Return weights, shape (count,), sum 1, with which the mean force is the slope of a line fitted to velocity.

    Velocity is sampled every `stride` samples, the interval at which its noise is independent; the remainder of a rest
    is not used. For white velocity noise this is the best linear unbiased estimate of the mean.
    """
    blocks = max(count // stride, 1)
    used = min(blocks * stride, count)
    j = np.arange(1, blocks + 1)
    per_block = 6.0 * j * (blocks + 1 - j) / (blocks * (blocks + 1) * (blocks + 2))
    weights = np.zeros(count)
    weights[:used] = np.repeat(per_block / (used / blocks), used // blocks)
    return weights


def mean_angles(data: StageData, start: int, stop: int) -> FloatArray | None:
    """Return the mean encoder angles of a rest, rad, shape (2,); None if the encoders were not polled during it."""
    polled = data.angles[start:stop]
    polled = polled[np.isfinite(polled[:, 0]) & np.isfinite(polled[:, 1])]
    return polled.mean(axis=0) if len(polled) else None
