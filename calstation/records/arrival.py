"""Sample counter and clock derived from time stamps alone, which are either clock times or arrival times.

A sample arrives late, never early, so the earliest of many samples represent the sample clock. Lost samples shift all
later ones; a late sample does not shift any.
"""

from dataclasses import dataclass

import numpy as np

from calstation.physics import FloatArray, IntArray

#: Time over which the earliest samples before and after a possible gap are compared, s.
_WINDOW = 1.0
#: Times over which the mean period is determined, s.
_BASELINES = (1.0, 10.0)
#: Largest deviation of a clock's step from whole periods, in periods, and the fraction of steps that may exceed it.
_MAX_DEVIATION, _MAX_FRACTION = 0.25, 0.01
#: A step that differs by more than this from the sample period, in periods, is a gap or a late arrival.
_IRREGULAR = 0.5
#: Shift of the earliest arrivals, in periods, above which samples are missing. Samples that arrive in bursts vary by up
#: to one period, so a single lost sample is not detected.
_MIN_SHIFT = 1.5
#: Multiple of the typical change of the earliest arrivals from window to window that indicates missing samples.
_SCATTER_FACTOR = 6.0
#: Multiple of the median deviation from a first line beyond which an arrival is excluded from the final line.
_OUTLIER_FACTOR = 5.0


@dataclass(frozen=True)
class SampleTimes:
    """Sample counter and clock that were derived from the times of a recording."""

    seq: IntArray  #: Continuous count from 0, shape (n,).
    time: FloatArray  #: Times as given, or on a line fitted to the arrival times, s, shape (n,).
    jitter: float  #: Rms deviation of the arrival times from the line, s; 0 if the times are clock times.


def sample_period(time: FloatArray, nominal: float) -> float:
    """Return the period of samples in order, s.

    The median of single steps is insensitive to gaps, the median over longer times to jitter; the candidate nearest to
    `nominal` is returned.
    """
    intervals = (1, *(round(baseline / nominal) for baseline in _BASELINES), len(time) // 2)
    periods = [float(np.median(time[w:] - time[:-w])) / w for w in intervals if 0 < w < len(time)]
    return min(periods, key=lambda period: abs(period - nominal) if period > 0.0 else np.inf, default=nominal)


def are_arrivals(seq: IntArray, time: FloatArray, period: float) -> bool:
    """Return whether times of samples with a counter are arrival times: steps are irregular without missing samples.

    Parameters
    ----------
    seq, time : counter, and time, s, of each sample, shape (n,)
    period : sample period, s
    """
    steps = np.diff(time)
    irregular = (np.abs(steps - period) > _IRREGULAR * period) & (np.diff(seq) == 1)
    return bool(np.count_nonzero(irregular) > 3 + _MAX_FRACTION * len(irregular) and (steps >= 0.0).all())


def sample_times(time: FloatArray, nominal: float, numbers: IntArray | None = None) -> SampleTimes:
    """Return counter and clock of a recording.

    Parameters
    ----------
    time : time stamps in increasing order, s, shape (n,)
    nominal : configured sample period, s
    numbers : numbers of the rows, which leave out damaged rows, shape (n,); None if there are none
    """
    period = sample_period(time, nominal)
    steps = np.diff(time) / period
    rounded = np.rint(steps)
    if len(time) < 2 or (steps < 0.0).any():  # decreasing times are an error or a restart, detected with the counter
        return SampleTimes(np.arange(len(time)), time, 0.0)
    if steps.min() > _IRREGULAR and np.mean(np.abs(steps - rounded) > _MAX_DEVIATION) <= _MAX_FRACTION:
        return SampleTimes(np.concatenate([[0], np.cumsum(np.maximum(rounded, 1.0))]).astype(np.int64), time, 0.0)
    numbers = np.arange(len(time)) if numbers is None else numbers - numbers[0]
    seq = numbers + _missing_before(time - (numbers - np.arange(len(time))) * period, period)
    half = len(seq) // 2
    slope = float(np.median((time[half:] - time[:-half]) / (seq[half:] - seq[:-half])))
    residuals = time - slope * seq - np.median(time - slope * seq)
    inliers = np.abs(residuals) <= _OUTLIER_FACTOR * np.median(np.abs(residuals))
    line = np.polynomial.Polynomial.fit(seq[inliers], time[inliers], 1)(seq)
    return SampleTimes(seq, line, float(np.std(time - line)))


def _missing_before(time: FloatArray, period: float) -> IntArray:
    """Return the number of samples missing before each arrival, shape (n,)."""
    window = max(round(_WINDOW / period), 8)
    lateness = time - np.arange(len(time)) * period
    missing = np.zeros(len(time), np.int64)
    end = len(time) // window * window
    earliest = lateness[:end].reshape(-1, window).min(axis=1) if end > window else np.zeros(2)
    threshold = _MIN_SHIFT * period + _SCATTER_FACTOR * float(np.median(np.abs(np.diff(earliest))))
    last = 0
    for k in np.flatnonzero(np.diff(time) > (1.0 + _IRREGULAR) * period) + 1:
        before, after = lateness[max(last, k - window) : k].min(), lateness[k : k + window].min()
        if after - before > threshold and k + window // 4 <= len(time):
            missing[k] = round((after - before) / period)
            last = int(k)
    return np.asarray(np.cumsum(missing))
