"""Time alignment of independent sample streams from IMUs on one body, each with its own clock.

    primary's time = secondary's time + τ,    τ(t) = τ₀ + d (t − t₀)

Arrival times determine τ to some milliseconds: the smallest delay of a stream's samples is its transport delay. In
motion, τ is measured from the rates alone. Within a window, the secondary's rate at the primary's times is

    ω₂ = C ω₁ + b + C ω₁' δ

where the remaining offset δ is common to all axes. ω₁ and a constant are regressed out, which removes the scale
factors, misalignments and biases of both units, and δ follows by least squares. A Kalman filter of offset and drift
combines the windows; the drift is a random walk.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calstation.estimation.common import ImuModel, SampleBlock
from calstation.estimation.pairs.filtering import lagrange_weights
from calstation.physics import FloatArray, IntArray

#: Duration of a window in which the offset is measured, s.
WINDOW = 2.0
#: Sample rate after averaging, before differentiation, Hz: well above the motion, below most of the noise.
_AVERAGED_RATE = 100.0
#: Smallest rms change of the rate within a window from which the offset is measured, rad/s.
_MIN_CHANGE = np.deg2rad(5.0)
#: Smallest correlation of the rate magnitudes for an initial measurement.
_MIN_CORRELATION = 0.9
#: Standard deviations of an offset from arrival times, s, and of an unmeasured drift.
ARRIVAL_SIGMA, _DRIFT_SIGMA = 0.05, 100e-6
#: Random walk of the drift, 1/√s: 0.1 ppm in 20 minutes.
_DRIFT_WALK = 3e-9
#: Smallest standard deviation of a measured offset, s.
_MIN_SIGMA = 1e-6
#: Largest deviation of a measurement from its prediction, in sigmas, and number of rejections after which the offset is
#: searched for again.
_MAX_DEVIATION, _MAX_REJECTIONS = 6.0, 3
#: Largest error of an offset from arrival times that the initial measurement corrects, s.
_SEARCH_RANGE = 0.25
_ITERATIONS = 5

#: Number of samples on each side for an interpolation.
_HALF_WIDTH = 5
#: Duration of the stored samples, s.
_BUFFER_TIME = 6.0
#: Window over which the smallest delay is determined, s.
_DELAY_WINDOW = 10.0
#: Increase of the delay that indicates a jump of a unit's clock, s, and time for which it must last, s, because a busy
#: computer also delays samples.
_JUMP, _MIN_JUMP_TIME = 0.5, 3.0
#: Decrease of the delay that indicates a jump of a unit's clock, s; the first samples may be delayed by a buffer.
_JUMP_FORWARD = 2.0
#: Delay after which a row is output even if samples are missing, s.
LATE = 0.5


def interpolate(counts: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate the rows of `counts`, shape (n, k), at fractional indices `at`, shape (m,); return shape (m, k).

    The interpolation uses 10 samples; the result is NaN if one of them is missing or NaN.
    """
    nodes = np.arange(-_HALF_WIDTH + 1, _HALF_WIDTH + 1)
    whole = np.floor(at).astype(np.int64)
    weights = lagrange_weights(nodes, at - whole)
    rows = whole[:, None] + nodes
    inside = (rows[:, 0] >= 0) & (rows[:, -1] < len(counts))
    values = np.full((len(at), counts.shape[1]), np.nan)
    values[inside] = np.einsum("mk,mkc->mc", weights[inside], counts[rows[inside]])
    return values


@dataclass(frozen=True)
class OffsetFix:
    """A measured offset and its standard deviation, s, valid at `time`, s, from the first sample."""

    offset: float
    sigma: float
    time: float


def measure(omega: FloatArray, omega2: FloatArray, dt: float) -> OffsetFix | None:
    """Return the offset δ for which `omega2`(t) is a linear function of `omega`(t + δ), both rad/s, shape (n, 3).

    Return None if the motion does not determine it. `dt` is the sample period, s.
    """
    rows = slice(1, -1)
    slope = (omega[2:] - omega[:-2]) / (2.0 * dt)
    base = np.column_stack([np.ones(len(slope)), omega[rows]])
    fit = np.linalg.lstsq(base, omega2[rows], rcond=1e-3)[0]
    expected = slope @ fit[1:]
    g = expected - base @ np.linalg.lstsq(base, expected, rcond=1e-6)[0]
    r = omega2[rows] - base @ np.linalg.lstsq(base, omega2[rows], rcond=1e-6)[0]
    square = float(np.sum(g * g))
    if square <= 0.0:
        return None
    offset = float(np.sum(g * r)) / square
    freedom = max(r.size - 13, 1)
    variance = float(np.sum((r - g * offset) ** 2)) / freedom / square
    # `time` is the centroid of the information, because the offset drifts
    weight = np.sum(g * g, axis=1)
    time = dt * (1.0 + float(weight @ np.arange(len(g))) / square)
    return OffsetFix(offset, float(np.hypot(np.sqrt(variance), _MIN_SIGMA)), time)


@dataclass(frozen=True)
class Alignment:
    """State of a secondary's clock."""

    offset: float  #: Added to the secondary's time to obtain the primary's, s.
    drift: float  #: Change of the offset per second.
    sigma: float  #: Standard deviation of the offset, s.
    measured: bool  #: Whether measurements of the offset agree (`ClockFilter.locked`).


class ClockFilter:
    """Estimates the offset and drift of a secondary's clock relative to the primary's.

    `locked` is True while measurements of the offset agree, and `arrival` while the offset is known only from arrival
    times.
    """

    def __init__(self) -> None:
        self.locked, self.arrival = False, True
        self._time = 0.0
        self._state = np.zeros(2)
        self._covariance = np.diag([ARRIVAL_SIGMA**2, _DRIFT_SIGMA**2])
        self._rejected = 0

    def alignment(self, time: float) -> Alignment:
        """Return the state at a time of the primary, s."""
        return Alignment(float(self.offset(time)), float(self._state[1]), self.sigma(time), self.locked)

    def offset(self, time: FloatArray | float) -> FloatArray:
        """Return the offset at times of the primary, s."""
        return np.asarray(self._state[0] + self._state[1] * (np.asarray(time) - self._time))

    def sigma(self, time: float) -> float:
        """Return the standard deviation of the offset at a time of the primary, s."""
        P = self._predicted(time - self._time)[1]
        return float(np.sqrt(P[0, 0]))

    def restart(self, time: float, offset: float) -> None:
        """Restart with an offset from arrival times, s."""
        self.locked, self.arrival, self._time, self._rejected = False, True, time, 0
        self._state[0] = offset
        self._covariance = np.diag([ARRIVAL_SIGMA**2, max(float(self._covariance[1, 1]), (1e-6) ** 2)])

    def update(self, time: float, offset: float, sigma: float) -> bool:
        """Update with an offset measured at `time` of the primary and its sigma, s; return whether it was accepted.

        Parameters
        ----------
        time : time of the primary, s
        offset, sigma : measured offset of the clocks and its standard deviation, s
        """
        state, P = self._predicted(time - self._time)
        innovation = offset - state[0]
        variance = P[0, 0] + sigma**2
        if self.locked and abs(innovation) > _MAX_DEVIATION * np.sqrt(variance):
            self._rejected += 1
            if self._rejected >= _MAX_REJECTIONS:
                self.locked, self._rejected = False, 0
                self._covariance += np.diag([innovation**2, (1e-6) ** 2])
            return False
        gain = P[:, 0] / variance
        self._state, self._time, self._rejected = state + gain * innovation, time, 0
        P = P - np.outer(gain, P[0])
        self._covariance = 0.5 * (P + P.T)
        self.locked, self.arrival = True, False
        return True

    def _predicted(self, dt: float) -> tuple[FloatArray, FloatArray]:
        F = np.array([[1.0, dt], [0.0, 1.0]])
        t = abs(dt)
        Q = _DRIFT_WALK**2 * np.array([[t**3 / 3.0, t**2 / 2.0], [t**2 / 2.0, t]])
        return F @ self._state, F @ self._covariance @ F.T + Q


class _Stream:
    """Buffer of the samples of one IMU; sample i ends at (i + 1) / rate on a clock that continues across restarts."""

    def __init__(self, imu: ImuModel) -> None:
        self.rate = imu.sample_rate
        self.scale = imu.count_size
        self.first, self.counts = 0, np.empty((0, 6))
        self.jumps = 0
        self._shift = 0
        self._delays: deque[tuple[float, float]] = deque()
        self._delayed: list[tuple[IntArray, FloatArray]] = []
        self._delayed_since: float | None = None

    @property
    def last(self) -> int:
        """Index of the newest sample."""
        return self.first + len(self.counts) - 1

    @property
    def delay(self) -> float | None:
        """Smallest recent delay, host time minus the stream's time, s; None before the first sample."""
        return min(delay for _, delay in self._delays) if self._delays else None

    def add(self, seq: IntArray, counts: FloatArray, arrival: FloatArray, restarted: bool) -> None:
        """Add samples in order; if the delay indicates a jump of the unit's clock, continue it from host time."""
        now, usual = float(arrival[-1]), self.delay
        delay = float(np.min(arrival - (seq + 1 + self._shift) / self.rate))
        if usual is not None:
            if not restarted and delay > usual + _JUMP:
                self._delayed_since = now if self._delayed_since is None else self._delayed_since
                if now - self._delayed_since < _MIN_JUMP_TIME:
                    self._delayed.append((seq, counts))
                    return
                restarted = True
            if restarted or delay < usual - _JUMP_FORWARD:
                self._shift += round((delay - usual) * self.rate)
                delay = float(np.min(arrival - (seq + 1 + self._shift) / self.rate))
                self._delays.clear()
                self.jumps += 1
        self._delayed_since = None
        self._delays.append((now, delay))
        while self._delays[0][0] < now - _DELAY_WINDOW:
            self._delays.popleft()
        for delayed_seq, delayed_counts in (*self._delayed, (seq, counts)):
            self._append(delayed_seq + self._shift, delayed_counts)
        self._delayed.clear()

    def at(self, index: FloatArray) -> FloatArray:
        """Return counts at fractional indices, shape (n, 6), NaN where samples are missing."""
        return interpolate(self.counts, index - self.first)

    def rows(self, start: int, stop: int) -> FloatArray:
        """Return the counts of samples `start` to `stop`, NaN where missing, shape (n, 6)."""
        rows = np.full((stop - start, 6), np.nan)
        a, b = max(start, self.first), min(stop, self.last + 1)
        if b > a:
            rows[a - start : b - start] = self.counts[a - self.first : b - self.first]
        return rows

    def _append(self, index: IntArray, counts: FloatArray) -> None:
        new = index > self.last if len(self.counts) else np.ones(len(index), np.bool_)
        index, counts = index[new], counts[new]
        if not len(index):
            return
        capacity = round(_BUFFER_TIME * self.rate)
        if not len(self.counts) or index[0] - self.last > capacity:
            self.first, self.counts = int(index[0]), np.empty((0, 6))
        start = self.last + 1
        added = np.full((int(index[-1]) - start + 1, 6), np.nan)
        added[index - start] = counts
        self.counts = np.concatenate([self.counts, added])
        surplus = max(len(self.counts) - capacity, 0)
        self.first, self.counts = self.first + surplus, self.counts[surplus:]


class PairAligner:
    """Combines the streams of a primary and its secondaries into blocks of simultaneous samples at the primary's times.

    Rows are also output while the primary sends no samples. `clocks` are the clocks of the secondaries.
    """

    def __init__(self, primary: ImuModel, secondaries: Sequence[ImuModel]) -> None:
        self._streams = [_Stream(imu) for imu in (primary, *secondaries)]
        self.clocks = [ClockFilter() for _ in secondaries]
        self._known_jumps = [0] * len(self._streams)
        self._next: int | None = None
        self._measured = 0

    def feed(
        self, number: int, seq: IntArray, counts: FloatArray, arrival: FloatArray, *, restarted: bool = False
    ) -> None:
        """Add samples of one IMU.

        Parameters
        ----------
        number : number of the IMU, 0 for the primary
        seq : increasing count of its samples, shape (n,)
        counts : raw output, NaN if invalid, shape (n, 6)
        arrival : host time at which each sample was received, s, shape (n,)
        restarted : whether the unit restarted before these samples
        """
        if len(seq):
            self._streams[number].add(seq, counts, arrival, restarted)

    def take(self, now: float) -> tuple[SampleBlock, list[int]]:
        """Return the rows that are complete at host time `now`, s, and the indices of realigned secondaries.

        A secondary is realigned when its offset is measured for the first time, or again after measurements disagreed.
        """
        primary = self._streams[0]
        delay = primary.delay
        if delay is None:
            return _block(np.empty(0, np.int64), primary.rate, np.empty((0, 6)), np.empty((0, len(self.clocks), 6))), []
        if self._next is None:
            self._next = primary.first
            self._measured = self._next
        due = int(np.floor((now - delay - LATE) * primary.rate)) - 1
        stop = max(min([primary.last, *(self._complete(k) for k in range(len(self.clocks)))]), due) + 1
        self._restart_clocks(delay, (self._next + 1) / primary.rate)
        index = np.arange(self._next, max(stop, self._next))
        time = (index + 1) / primary.rate
        others = np.full((len(index), len(self.clocks), 6), np.nan)
        for k in range(len(self.clocks)):
            others[:, k] = self._streams[k + 1].at(self._position(k, time))
        block = _block(index, primary.rate, primary.rows(self._next, self._next + len(index)), others)
        self._next += len(index)
        window, aligned = round(WINDOW * primary.rate), list[int]()
        if self._next - self._measured >= window + round(_SEARCH_RANGE * primary.rate):
            start, self._measured = self._measured, self._measured + window
            aligned = [k for k in range(len(self.clocks)) if self._measure(k, start, self._measured)]
        return block, aligned

    def _position(self, k: int, time: FloatArray) -> FloatArray:
        """Return the fractional index of a secondary's sample at times of the primary, s."""
        return np.asarray((time - self.clocks[k].offset(time)) * self._streams[k + 1].rate - 1.0)

    def _complete(self, k: int) -> int:
        """Return the last row for which the samples of a secondary have arrived."""
        stream = self._streams[k + 1]
        if stream.delay is None:
            return -1
        last = (stream.last - _HALF_WIDTH + 1) / stream.rate
        time = last + float(self.clocks[k].offset(last + float(self.clocks[k].offset(last))))
        return int(np.floor(time * self._streams[0].rate - 1e-6)) - 1

    def _restart_clocks(self, delay: float, time: float) -> None:
        """Restart the clocks of restarted units, and set unmeasured clocks from the arrival times."""
        jumped = [stream.jumps != known for stream, known in zip(self._streams, self._known_jumps, strict=True)]
        self._known_jumps = [stream.jumps for stream in self._streams]
        for clock, stream, clock_jumped in zip(self.clocks, self._streams[1:], jumped[1:], strict=True):
            if stream.delay is not None and (jumped[0] or clock_jumped or clock.arrival):
                clock.restart(time, stream.delay - delay)

    def _measure(self, k: int, start: int, stop: int) -> bool:
        """Measure the offset of a secondary in rows `start` to `stop`. Return whether it is realigned."""
        primary, stream, clock = self._streams[0], self._streams[k + 1], self.clocks[k]
        omega = (primary.rows(start, stop) * primary.scale)[:, :3]
        average = max(round(primary.rate / _AVERAGED_RATE), 1)
        dt = average / primary.rate
        omega = _averaged(omega, average)
        if np.isnan(omega).any() or float(np.sqrt(omega.var(axis=0).sum())) < _MIN_CHANGE:
            return False
        time = (np.arange(start, stop) + 1) / primary.rate
        position = self._position(k, time)

        def secondary_rate(offset: float) -> FloatArray:
            return _averaged((stream.at(position - offset * stream.rate) * stream.scale)[:, :3], average)

        def measure_at(offset: float) -> OffsetFix | None:
            omega2 = secondary_rate(offset)
            return None if np.isnan(omega2).any() else measure(omega, omega2, dt)

        offset = 0.0 if clock.locked else _search(omega, secondary_rate(0.0), dt)
        if offset is None:
            return False
        fix = measure_at(offset)
        for _ in range(_ITERATIONS - 1):
            if fix is None or abs(fix.offset) < 0.1 * fix.sigma:
                break
            offset += fix.offset
            fix = measure_at(offset)
        if fix is None:
            return False
        offset += fix.offset
        moment, before = start / primary.rate + fix.time, clock.locked
        return clock.update(moment, float(clock.offset(moment)) + offset, fix.sigma) and not before


def _search(omega: FloatArray, omega2: FloatArray, dt: float) -> float | None:
    """Return the offset, s, with the largest correlation of the rate magnitudes; None if it is too small."""
    max_lag = round(_SEARCH_RANGE / dt)
    a, b = (np.linalg.norm(values, axis=1) for values in (omega, omega2))
    inner = b[max_lag : len(b) - max_lag]
    if np.isnan(inner).any() or len(inner) < max_lag:
        return None
    best, best_lag = _MIN_CORRELATION, 0
    for lag in range(-max_lag, max_lag + 1):
        shifted = a[max_lag + lag : len(a) - max_lag + lag]
        correlation = float(np.corrcoef(shifted, inner)[0, 1])
        if correlation > best:
            best, best_lag = correlation, lag
    return best_lag * dt if best > _MIN_CORRELATION else None


def _averaged(values: FloatArray, count: int) -> FloatArray:
    """Return the means of groups of `count` rows, shape (n // count, columns)."""
    whole = len(values) // count * count
    return np.asarray(values[:whole].reshape(-1, count, values.shape[1]).mean(axis=1))


def _block(index: IntArray, rate: float, counts: FloatArray, others: FloatArray) -> SampleBlock:
    valid = np.asarray(np.isfinite(counts).all(axis=1))
    return SampleBlock.without_table("cross_calibration", index, (index + 1) / rate, counts, valid=valid, others=others)
