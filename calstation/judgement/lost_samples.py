"""Detection of samples lost or doubled without a gap in the counter, by jumps of the force or of the table's angles.

A lost sample shifts all later samples in time. This is visible in the specific force while the direction of gravity in
b changes, and in the encoder angle while the table turns, because the angle then changes by more than the integrated
rate.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calstation.estimation.common import SolveContext, StageData
from calstation.judgement.table_motion import TableMotion, turn_axis
from calstation.physics import BoolArray, FloatArray, IntArray, kernel, rotation_vector

#: Number of samples on each side of a lost or repeated sample to which lines are fitted.
_FIT = 10
#: Largest rms residual of these lines, in sigmas, and largest difference of their slopes relative to the mean slope.
_RESIDUAL, _SLOPES = 3.0, 0.1
#: Largest sigma of a detected shift in time, in samples, and smallest detected shift, in sigmas.
_MAX_SIGMA, _SIGMAS = 1.0 / 12.0, 9.0
#: Change of a force over both lines, in sigmas of noise, below which the sigma of a shift certainly exceeds
#: `_MAX_SIGMA`.
_STEEP = 50.0
#: Smallest rate near a shift detected in the angles, relative to the largest rate nearby, because a filter delays the
#: start of a rotation more than its middle.
_SLOWEST = 0.3
#: Largest deviation of a shift from a whole number of samples.
_WHOLE = 0.3
#: Smallest rotation of a motion, rad.
_SMALLEST_TURN = 0.1


@dataclass(frozen=True)
class SampleFault:
    """Samples with a fault of one kind."""

    cause: str  #: Code of the cause.
    samples: IntArray  #: Indices of the samples.
    channel: int | None = None  #: Index of the channel; None for whole samples.
    size: float = 0.0  #: Size in counts, or in samples.


@kernel
def line_weights(first: int, last: int, at: float) -> FloatArray:
    """Return the weights of points `first` to `last` for the value of their regression line at `at`."""
    count = last - first + 1
    mean = 0.5 * (first + last)
    square = 0.0
    for k in range(first, last + 1):
        square += (k - mean) ** 2
    weights = np.empty(count)
    for k in range(first, last + 1):
        weights[k - first] = 1.0 / count + (at - mean) * (k - mean) / square
    return weights


def shifts(counts: FloatArray, broken: BoolArray, sigma: FloatArray, width: int) -> Iterator[SampleFault]:
    """Yield the samples before which samples are lost or doubled, while all channels change smoothly.

    Parameters
    ----------
    counts : output of gyros and accelerometers, counts, shape (n, 6)
    broken : whether samples are missing before each sample, shape (n,)
    sigma : noise of each channel in windows of `width` samples, counts, shape (w, 6)
    """
    scores = _shift_scores(counts, sigma, width, broken, _FIT, _RESIDUAL, _SLOPES, _STEEP)
    yield from _shift_faults(np.arange(len(counts)), *scores)


@kernel
def _shift_scores(
    counts: FloatArray,
    sigma: FloatArray,
    width: int,
    broken: BoolArray,
    fit: int,
    residual_limit: float,
    slopes: float,
    steep: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the shift in time before each sample, in samples, and its sigma, infinite if unknown, shape (n,) each.

    Lines are fitted to `fit` samples on both sides; with equal slopes, a shift is the difference of the lines divided
    by the slope. Gyros only show whether the motion is smooth, because a rate may change suddenly, unlike the direction
    of gravity.
    """
    n, channels = counts.shape
    shift, spread = np.zeros(n), np.full(n, np.inf)
    before, after = line_weights(-fit, -1, -0.5), line_weights(0, fit - 1, -0.5)
    mean = 0.5 * (fit - 1)
    square = variance = 0.0
    for j in range(fit):
        square += (j - mean) ** 2
        variance += before[j] ** 2 + after[j] ** 2
    since_gap = 0
    for end in range(n):  # k is the first sample after the possible shift
        since_gap = 0 if broken[end] else since_gap + 1
        k = end - fit + 1
        if since_gap < 2 * fit - 1 or k < fit:
            continue
        window = min(k // width, len(sigma) - 1)
        is_steep = False
        for i in range(3, channels):
            is_steep |= abs(counts[end, i] - counts[k - fit, i]) > steep * sigma[window, i]
        if not is_steep:
            continue
        weight = moment = 0.0
        is_smooth = True
        for i in range(channels):
            low = high = slope_low = slope_high = mean_low = mean_high = 0.0
            for j in range(fit):
                x, y = counts[k - fit + j, i], counts[k + j, i]
                low += before[j] * x
                high += after[j] * y
                slope_low += (j - mean) * x / square
                slope_high += (j - mean) * y / square
                mean_low += x / fit
                mean_high += y / fit
            noise = sigma[window, i]
            slope = 0.5 * (slope_low + slope_high)
            if abs(slope_high - slope_low) > slopes * abs(slope) + 5.0 * noise / np.sqrt(square):
                is_smooth = False
                break
            total = 0.0
            for j in range(fit):
                total += (counts[k - fit + j, i] - mean_low - slope_low * (j - mean)) ** 2
                total += (counts[k + j, i] - mean_high - slope_high * (j - mean)) ** 2
            if total > 2.0 * fit * (residual_limit * noise) ** 2:
                is_smooth = False
                break
            if i >= 3:
                weight += slope**2 / (noise**2 * variance)
                moment += slope * (high - low) / (noise**2 * variance)
        if is_smooth and weight > 0.0:
            shift[k] = moment / weight
            spread[k] = 1.0 / np.sqrt(weight)
    return shift, spread


def _shift_faults(samples: IntArray, shift: FloatArray, spread: FloatArray) -> Iterator[SampleFault]:
    """Yield the faults for significant shifts by whole samples; all arrays have the shape (n,)."""
    whole, significance = np.rint(shift), np.abs(shift) / spread
    is_fault = (spread < _MAX_SIGMA) & (whole != 0.0) & (significance > _SIGMAS) & (np.abs(shift - whole) < _WHOLE)
    at = [  # the most significant of neighbouring shifts
        k
        for k in np.flatnonzero(is_fault).tolist()
        if significance[max(k - _FIT, 0) : k + _FIT + 1].max() <= significance[k]
    ]
    for cause, sign in (("samples_lost", 1.0), ("samples_doubled", -1.0)):
        chosen = [k for k in at if whole[k] * sign > 0.0]
        if chosen:
            yield SampleFault(cause, samples[chosen], None, float(np.abs(whole[chosen]).sum()))


def shifts_of_angles(data: StageData, motion: TableMotion, context: SolveContext) -> Iterator[SampleFault]:
    """Yield the samples at which the angle of a joint changes by more, or less, than the integrated rate."""
    samples, shift, spread = [], [], []
    for (k, _), joint, rotation in zip(motion.links, motion.joints, motion.rotation, strict=True):
        start, stop = motion.rests[k][1], motion.rests[k + 1][0]
        polled = np.flatnonzero(np.isfinite(data.angles[start:stop]).all(axis=1))
        if np.linalg.norm(rotation) < _SMALLEST_TURN or len(polled) < 4 * _FIT:
            continue
        angles, rate = data.angles[start:stop][polled], data.gyro[start:stop] - motion.rate[k : k + 2].mean(axis=0)
        if joint is None:
            angle, directions = _path(angles, context)
            rate = np.einsum("ni,ni->n", rate, directions[np.searchsorted(polled, np.arange(stop - start))])
        else:
            angle, rate = angles[:, joint], rate @ turn_axis(motion.angles[k], joint, context)
        difference = angle - np.cumsum(rate)[polled] * data.dt
        smooth = np.convolve(rate, np.ones(5) / 5.0, "same")[polled]
        scores = _angle_shifts(difference, smooth * data.dt, _FIT, _SLOWEST)
        samples.append(start + polled)
        shift.append(scores[0])
        spread.append(scores[1])
    if samples:
        yield from _shift_faults(np.concatenate(samples), np.concatenate(shift), np.concatenate(spread))


def _path(angles: FloatArray, context: SolveContext) -> tuple[FloatArray, FloatArray]:
    """Return the path length of the unit's rotation, rad, shape (n,), at joint angles, rad, shape (n, 2), and its axes.

    Row i of the directions, shape (n + 1, 3), is the axis in b of the rotation before angle i; 0 at the ends.
    """
    homes = [context.table.geometry.body_to_home(*pair) for pair in angles]
    steps = np.array([rotation_vector(before.T @ after) for before, after in pairwise(homes)])
    length = np.linalg.norm(steps, axis=1)
    directions = steps / np.maximum(length, 1e-12)[:, None]
    return np.concatenate([[0.0], np.cumsum(length)]), np.vstack([np.zeros(3), directions, np.zeros(3)])


@kernel
def _angle_shifts(
    difference: FloatArray, rotation: FloatArray, fit: int, slowest: float
) -> tuple[FloatArray, FloatArray]:
    """Return the shift in time before each angle, in samples, and its sigma, infinite if unknown, shape (n,) each.

    Parameters
    ----------
    difference : angle minus integrated rate, rad, shape (n,)
    rotation : rotation in one sample, rad, shape (n,)
    fit : number of angles on each side
    slowest : smallest rate on both sides, relative to the largest
    """
    n = len(difference)
    shift, spread = np.zeros(n), np.full(n, np.inf)
    before, after = line_weights(-fit, -1, -0.5), line_weights(0, fit - 1, -0.5)
    mean = 0.5 * (fit - 1)
    square = variance = 0.0
    for j in range(fit):
        square += (j - mean) ** 2
        variance += before[j] ** 2 + after[j] ** 2
    for k in range(fit, n - fit + 1):
        size, smallest = 0.0, np.inf
        for j in range(k - fit, k + fit):
            size, smallest = max(size, abs(rotation[j])), min(smallest, abs(rotation[j]))
        rate = 0.5 * (rotation[k - 1] + rotation[k])
        if smallest <= slowest * size:
            continue
        low = high = slope_low = slope_high = mean_low = mean_high = 0.0
        for j in range(fit):
            x, y = difference[k - fit + j], difference[k + j]
            low += before[j] * x
            high += after[j] * y
            slope_low += (j - mean) * x / square
            slope_high += (j - mean) * y / square
            mean_low += x / fit
            mean_high += y / fit
        total = 0.0
        for j in range(fit):
            total += (difference[k - fit + j] - mean_low - slope_low * (j - mean)) ** 2
            total += (difference[k + j] - mean_high - slope_high * (j - mean)) ** 2
        noise = np.sqrt(total / (2.0 * fit - 4.0)) + 1e-3 * size
        shift[k] = (high - low) / rate
        spread[k] = noise * np.sqrt(variance) / abs(rate)
    return shift, spread
