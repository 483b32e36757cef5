"""Sample counter and clock derived from time stamps alone, which are either clock times or arrival times.

Samples may arrive late but never early, so the earliest arrivals follow the sample clock. A lost sample shifts all
later arrivals; a late sample shifts only its own. The times are kept in a temporary file, so that memory use does not
grow with the length of the recording; medians use evenly spaced rows.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calstation.physics import FloatArray, IntArray
from calstation.records.temporary_rows import TemporaryRows

#: Length of the windows before and after a possible gap whose earliest arrivals are compared, s.
_WINDOW = 1.0
#: Times over which the mean period is determined, s.
_BASELINES = (1.0, 10.0)
#: Largest deviation of a clock's step from whole periods, in periods, and fraction of steps that may exceed it.
_MAX_DEVIATION, _MAX_FRACTION = 0.25, 0.01
#: Deviation of a step from the sample period, in periods, above which the step is a gap or a late arrival.
_IRREGULAR = 0.5
#: Shift of the earliest arrivals, in periods, above which samples are missing. Samples that arrive in bursts vary by up
#: to one period, so a single lost sample is not detected.
_MIN_SHIFT = 1.5
#: Multiple of the typical change of the earliest arrivals between windows that is added to `_MIN_SHIFT`.
_SCATTER_FACTOR = 6.0
#: Arrivals that deviate from a preliminary line by more than this multiple of the median are left out of the final fit.
_OUTLIER_FACTOR = 5.0
#: Largest number of rows over which a median is taken.
_MAX_ROWS = 2**18

#: Row of the times of a recording: time, s, row number, and whether the row repeats the previous one.
TIMES = np.dtype([("time", "<f8"), ("row", "<i8"), ("repeated", "?")])
#: Row of a clock: sample counter and time, s.
CLOCK = np.dtype([("seq", "<i8"), ("time", "<f8")])


@dataclass(frozen=True)
class SampleTimes:
    """Sample counter and clock derived from the times of a recording."""

    #: Rows `CLOCK`: count from 0, with gaps for missing samples, and given times or times on a line fitted to arrivals.
    clock: TemporaryRows
    jitter: float  #: Rms deviation of the arrival times from the line, s; 0 if the times are clock times.


def sample_period(times: TemporaryRows, nominal: float) -> float:
    """Return the sample period, s, from the times of successive samples in rows `TIMES`.

    The median of single steps is insensitive to gaps, the median over longer times to jitter; the candidate nearest to
    `nominal` is returned.
    """
    intervals = (1, *(round(baseline / nominal) for baseline in _BASELINES), len(times) // 2)
    periods = [float(np.median(_steps(times, w, "time"))) / w for w in intervals if 0 < w < len(times)]
    return min(periods, key=lambda period: abs(period - nominal) if period > 0.0 else np.inf, default=nominal)


def are_arrivals(seq: IntArray, time: FloatArray, period: float) -> bool:
    """Return whether the times of counted samples are arrival times: irregular although no samples are missing.

    Parameters
    ----------
    seq, time : counter, and time, s, of each sample, shape (n,)
    period : sample period, s
    """
    steps = np.diff(time)
    irregular = (np.abs(steps - period) > _IRREGULAR * period) & (np.diff(seq) == 1)
    return bool(np.count_nonzero(irregular) > 3 + _MAX_FRACTION * len(irregular) and (steps >= 0.0).all())


def sample_times(times: TemporaryRows, nominal: float) -> SampleTimes:
    """Return the sample counter and clock of a recording in a temporary file, which the caller must close.

    Parameters
    ----------
    times : rows `TIMES` in increasing order; the row numbers skip damaged rows
    nominal : configured sample period, s
    """
    period = sample_period(times, nominal)
    clock, smallest, irregular = TemporaryRows(CLOCK), np.inf, 0
    for steps in _pairs(times, 1, "time"):
        steps = steps / period
        smallest = min(smallest, float(steps.min()))
        irregular += int(np.count_nonzero(np.abs(steps - np.rint(steps)) > _MAX_DEVIATION))
    if len(times) < 2 or smallest < 0.0:  # a restart or an error, which `SequenceUnwrapper` detects
        _count(times, clock, None)
    elif smallest > _IRREGULAR and irregular <= _MAX_FRACTION * (len(times) - 1):
        _count(times, clock, period)
    else:
        with clock:
            _count_arrivals(times, clock, period)
            return _fit(clock)
    return SampleTimes(clock, 0.0)


def _steps(rows: TemporaryRows, interval: int, name: str) -> FloatArray:
    """Return at most `_MAX_ROWS` differences of a field over `interval` rows, evenly spaced."""
    return _subsampled(_pairs(rows, interval, name), len(rows) - interval)


def _pairs(rows: TemporaryRows, interval: int, name: str) -> Iterator[FloatArray]:
    """Yield the differences of a field over `interval` rows in parts."""
    for later, earlier in zip(rows.parts(interval), rows.parts(), strict=False):
        yield later[name] - earlier[name][: len(later)]


def _subsampled(parts: Iterator[FloatArray], count: int) -> FloatArray:
    """Return at most `_MAX_ROWS` of `count` values, evenly spaced."""
    stride, position, kept = -(-count // _MAX_ROWS), 0, [np.empty(0)]
    for part in parts:
        kept.append(part[-position % stride :: stride])
        position += len(part)
    return np.concatenate(kept)


def _count(times: TemporaryRows, clock: TemporaryRows, period: float | None) -> None:
    """Append counter and time of samples with clock times; without `period`, number the samples consecutively."""
    last: tuple[int, float] | None = None
    for part in times.parts():
        steps = np.ones(len(part))
        if period is not None:
            steps = np.rint(np.diff(part["time"], prepend=part["time"][0] if last is None else last[1]) / period)
        steps = np.maximum(steps, 1.0)
        seq = np.cumsum(steps).astype(np.int64) + (-int(steps[0]) if last is None else last[0])
        last = int(seq[-1]), float(part["time"][-1])
        _append(clock, seq, part["time"])


def _append(clock: TemporaryRows, seq: IntArray, time: FloatArray) -> None:
    rows = np.empty(len(seq), CLOCK)
    rows["seq"], rows["time"] = seq, time
    clock.append(rows)


def _count_arrivals(times: TemporaryRows, clock: TemporaryRows, period: float) -> None:
    """Append counter and arrival time of the samples; the counter has gaps where samples are missing."""
    window = max(round(_WINDOW / period), 8)
    first = int(times.read(0, 1)["row"][0])
    earliest = [np.zeros(2)]
    size = window * max(1, times.part_rows // window)
    for part in times.parts(rows=size):
        end = len(part) // window * window
        earliest.append(_lateness(part, first, period)[:end].reshape(-1, window).min(axis=1, initial=np.inf))
    typical = np.diff(np.concatenate(earliest[1:])) if len(times) // window > 1 else np.zeros(1)
    threshold = _MIN_SHIFT * period + _SCATTER_FACTOR * float(np.median(np.abs(typical)))
    start, last, total = 0, 0, 0
    for part in times.parts(rows=size):
        low = max(start - window, 0)
        lateness = _lateness(times.read(low, start + len(part) + window - low), first, period)
        missing = np.zeros(len(part), np.int64)
        for k in (np.flatnonzero(np.diff(lateness) > _IRREGULAR * period) + 1 + low).tolist():
            if not max(start, 1) <= k < start + len(part) or k + window // 4 > len(times):
                continue
            before = lateness[max(last, k - window) - low : k - low].min()
            after = lateness[k - low : k - low + window].min()
            if after - before > threshold:
                missing[k - start] = round((after - before) / period)
                last = k
        _append(clock, part["row"] - first + total + np.cumsum(missing), part["time"])
        total += int(missing.sum())
        start += len(part)


def _lateness(rows: np.ndarray, first: int, period: float) -> FloatArray:
    """Return the times of rows minus those of a uniform clock that is zero at row `first`, s, shape (n,)."""
    return np.asarray(rows["time"] - (rows["row"] - first) * period)


def _fit(arrivals: TemporaryRows) -> SampleTimes:
    """Return the counter and a clock whose times are on a line fitted to the arrival times."""
    half = len(arrivals) // 2
    slope = float(np.median(_steps(arrivals, half, "time") / _steps(arrivals, half, "seq")))
    seq, time = (
        _subsampled((part[name] for part in arrivals.parts()), len(arrivals)).astype(np.float64)
        for name in ("seq", "time")
    )
    residuals = time - slope * seq - np.median(time - slope * seq)
    inliers = np.abs(residuals) <= _OUTLIER_FACTOR * np.median(np.abs(residuals))
    line = np.polynomial.Polynomial.fit(seq[inliers], time[inliers], 1)
    clock, total, squares = TemporaryRows(CLOCK), 0.0, 0.0
    for part in arrivals.parts():
        fitted = line(part["seq"])
        late = part["time"] - fitted
        total, squares = total + float(late.sum()), squares + float(late @ late)
        _append(clock, part["seq"], fitted)
    mean = total / len(arrivals)
    return SampleTimes(clock, float(np.sqrt(max(squares / len(arrivals) - mean**2, 0.0))))
