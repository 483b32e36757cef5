"""The one road of a sample: drain the IMU, put the table's angles on its samples, stamp stage and step."""

import math
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from calstation.devices.interfaces import Imu, SampleBatch, TableStatus
from calstation.devices.profiles.frame import Span
from calstation.estimation.common.context import ImuModel
from calstation.estimation.common.samples import SampleBlock, snap_angles
from calstation.physics.arrays import BoolArray, FloatArray
from calstation.sequencer.ports import Clock

#: Ticks over which the least delay between IMU clock and station clock is sought.
CLOCK_WINDOW = 200

#: Between the last sample of a run and the first after it was resumed, s of counter and IMU time: how long it really
#: was, nobody knows where the unit lost its power.
INTERRUPTION = 1.0

CHANNELS = ("gyro x", "gyro y", "gyro z", "accel x", "accel y", "accel z")

#: A channel with at least so much noise, in steps of its output, that shows one value so often in a row is stuck: by
#: chance it does so once in 10^28 times.
_RESTLESS, _STUCK = 0.35, 400

#: Part of a counter's wrap by which samples come late where it wrapped unseen: their way to here only adds to it.
_WRAPPED = 0.9

#: A poll that took longer, s, was lost and asked again on the way: nobody knows when its angles were true.
SLOWEST_POLL = 0.3


@dataclass(frozen=True)
class StatusMasks:
    """Bits of the IMU's status word: data valid since power-up, output saturated, self-test failed."""

    ready: int = 0
    saturated: int = 0
    failed: int = 0


@dataclass(frozen=True)
class Flow:
    """What a drain brought: samples, missing samples before or among them, and the status bits met.

    invalid : some output is no number; stuck : a channel that has shown one value for too long, "" for none
    """

    count: int
    missing: int
    ready: bool
    saturated: bool
    failed: bool
    invalid: bool = False
    stuck: str = ""


@dataclass(frozen=True)
class LastSample:
    """Where a run that is resumed had come to: counter, IMU time (s) and step of its last sample."""

    seq: int
    time: float
    step: int


@dataclass(frozen=True)
class _Poll:
    """One poll of the table: station time of the angles, rad, and rates, rad/s."""

    time: float
    angles: FloatArray
    rates: FloatArray


def to_si(model: ImuModel) -> FloatArray:
    """Factor from counts to rad/s (gyro) and m/s² (accel), shape (6,)."""
    rate = model.sample_rate if model.output == "increment" else 1.0
    return np.repeat([model.gyro_lsb * rate, model.accel_lsb * rate], 3)


def noise_counts(model: ImuModel) -> FloatArray:
    """Standard deviation of the white noise of one sample, in counts, shape (6,)."""
    period = 1.0 / model.sample_rate
    scale = period**0.5 if model.output == "increment" else period**-0.5
    noise = np.repeat([model.gyro_arw / model.gyro_lsb, model.accel_vrw / model.accel_lsb], 3)
    return np.asarray(noise * scale, dtype=np.float64)


class Acquisition:
    """Turns what the IMU sends into stamped blocks for log and solver.

    A poll of the table keeps the station times of request and answer; its middle less the profile's
    latency, less the smallest delay seen between IMU clock and station clock, is its IMU time. The angle
    goes on the nearest sample, carried there by the polled rate; other samples have NaN.

    After `LastSample` of a resumed run, counter, time and steps carry on behind it.

    A counter that wraps while samples are lost shows no gap, where as many are lost as it counts. They are missed by
    the station clock then: the samples behind them come later than any before, by as long as they took.

    Parameters
    ----------
    wrap : samples after which the unit's counter begins again

    Attributes
    ----------
    stage, step, valid : stamped on the samples of every further drain
    aside : samples go to taps alone: those of a unit that was restarted on purpose, its counter with it
    newest : IMU time of the latest sample, s, None before the first
    received, gaps : samples and interruptions of the counter so far
    last_arrival : station time of the latest sample, s
    breaks : interruptions of the counter, and of a unit's being ready, those aside as well
    restarts : of them those that only a unit shows that has restarted
    """

    def __init__(
        self,
        imu: Imu,
        model: ImuModel,
        clock: Clock,
        sink: Callable[[SampleBlock], None],
        *,
        latency: float = 0.0,
        masks: StatusMasks | None = None,
        span: Span | None = None,
        wrap: float = math.inf,
        after: LastSample | None = None,
    ) -> None:
        self._imu = imu
        self._clock = clock
        self._sink = sink
        self._latency = latency
        self._masks = masks or StatusMasks()
        self._span = span or Span()
        self._wrap = wrap
        self._scale = to_si(model)
        self._latest: SampleBatch | None = None
        self._half_period = 0.5 / model.sample_rate
        self._polls: list[_Poll] = []
        self._restless = noise_counts(model) >= _RESTLESS * self._span.step
        self._unchanged = np.zeros(6, np.int64)
        self._shown: FloatArray | None = None
        self._delays: deque[float] = deque(maxlen=CLOCK_WINDOW)
        self._taps: list[list[SampleBlock]] = []
        self._last_seq: int | None = None
        self._after = after
        self._seq_shift, self._time_shift = 0, 0.0
        self.stage = ""
        self.step = 0 if after is None else after.step + 1
        self.valid = True
        self.run_in_background = False
        self.newest: float | None = None
        self.received = 0
        self.gaps = 0
        self.breaks = self.restarts = 0
        self._was_ready = False
        self._told_restarts = 0
        self.last_arrival = clock.now()

    def poll(self, status: TableStatus, asked: float, answered: float) -> None:
        """Take a poll of the table, requested and answered at these station times, s; leave a slow one out."""
        if answered - asked > SLOWEST_POLL:
            return
        middle = 0.5 * (asked + answered) - self._latency
        self._polls.append(
            _Poll(middle, np.asarray(status.angles, np.float64), np.asarray(status.rates, np.float64))
        )

    def drain(self) -> Flow:
        """Take all samples that have come, stamp them and hand them on."""
        batch = self._imu.read()
        count = len(batch.seq)
        if count == 0:
            return Flow(0, 0, False, False, False)
        now = self._clock.now()
        if self._after is not None and self._last_seq is None:
            self._carry_on(batch, self._after)
        batch = self._with_wraps(batch, now)
        missing = self._missing(batch)
        if not self.run_in_background:
            self.received += count
            self.gaps += missing > 0
        self.breaks += missing > 0
        self.newest = float(batch.time[-1])
        self._latest = batch
        self.last_arrival = now
        if missing:
            self._delays.clear()
        self._delays.append(now - self.newest)
        finite = np.isfinite(batch.counts).all(axis=1)
        saturated = self._saturated(batch)
        # What comes behind a spoilt sample belongs to a step that is about to be repeated.
        sound = np.logical_and.accumulate(finite & ~saturated)
        block = SampleBlock(
            stage=self.stage,
            seq=batch.seq,
            time=batch.time,
            counts=batch.counts,
            angles=self._angles(batch),
            step=np.full(count, self.step, np.int64),
            valid=self.valid & sound,
            temperature=batch.temperature,
        )
        for tap in self._taps:
            tap.append(block)
        if not self.run_in_background:
            self._sink(block)
        seen = int(np.bitwise_or.reduce(batch.status))
        ready = self._masks.ready == 0 or bool(batch.status[-1] & self._masks.ready)
        self._note_restart(batch)
        judged = ready and not saturated.any()  # until it is ready a unit may well show nothing but zeros
        return Flow(
            count,
            missing,
            ready,
            saturated=bool(saturated.any()),
            failed=bool(seen & self._masks.failed),
            invalid=not finite.all(),
            stuck=self._stuck(batch.counts) if judged else "",
        )

    @property
    def recent(self) -> tuple[tuple[float, ...], float | None] | None:
        """Mean output (rad/s, m/s²; NaN without a number) and temperature (°C) of the last drain; None before."""
        if self._latest is None:
            return None
        counts = self._latest.counts[np.isfinite(self._latest.counts).all(axis=1)]
        mean = counts.mean(axis=0) * self._scale if len(counts) else np.full(6, np.nan)
        temperature = float(self._latest.temperature[-1])
        return tuple(float(v) for v in mean), None if np.isnan(temperature) else temperature

    @contextmanager
    def tap(self) -> Iterator[list[SampleBlock]]:
        """Collect a copy of the blocks that pass while the context is open."""
        blocks: list[SampleBlock] = []
        self._taps.append(blocks)
        try:
            yield blocks
        finally:
            self._taps.remove(blocks)

    def _carry_on(self, batch: SampleBatch, after: LastSample) -> None:
        """Have counter and clock go on behind those of the run that is resumed."""
        lost = round(INTERRUPTION / (2.0 * self._half_period))
        self._seq_shift = after.seq + lost + 1 - int(batch.seq[0])
        self._time_shift = after.time + INTERRUPTION + 2.0 * self._half_period - float(batch.time[0])

    def _with_wraps(self, batch: SampleBatch, now: float) -> SampleBatch:
        """Counter and clock of this run, with the samples that were lost in whole wraps of the unit's counter."""
        if self._delays and math.isfinite(self._wrap):
            seconds = 2.0 * self._half_period * self._wrap
            late = now - (float(batch.time[-1]) + self._time_shift) - min(self._delays)
            wraps = max(0, math.floor(late / seconds + 1.0 - _WRAPPED))
            self._seq_shift += round(wraps * self._wrap)
            self._time_shift += wraps * seconds
        return replace(batch, seq=batch.seq + self._seq_shift, time=batch.time + self._time_shift)

    def _saturated(self, batch: SampleBatch) -> BoolArray:
        """Samples that say so in their status, or whose channels stand at their ends, shape (n,)."""
        told = batch.status & self._masks.saturated != 0
        ends = (batch.counts <= self._span.low) | (batch.counts >= self._span.high)
        return np.asarray(told | ends.any(axis=1))

    def _stuck(self, counts: FloatArray) -> str:
        """The first channel whose noise should have changed it long ago."""
        before = counts[:1] if self._shown is None else self._shown[None]
        changed = counts != np.concatenate([before, counts[:-1]])
        self._shown = counts[-1]
        last = len(counts) - 1 - np.argmax(changed[::-1], axis=0)
        any_changed = changed.any(axis=0)
        self._unchanged = np.where(any_changed, len(counts) - 1 - last, self._unchanged + len(counts))
        stuck = np.flatnonzero(self._restless & (self._unchanged >= _STUCK))
        return CHANNELS[int(stuck[0])] if len(stuck) else ""

    def _note_restart(self, batch: SampleBatch) -> None:
        """A counter that begins again, or a unit that was ready and is not any more."""
        told, self._told_restarts = self._told_restarts, self._imu.stats.restarts
        self.restarts += self._told_restarts > told
        if self._masks.ready:
            ready = np.concatenate([[self._was_ready], batch.status & self._masks.ready != 0])
            lost = bool((ready[:-1] & ~ready[1:]).any())
            self.breaks += lost
            self.restarts += lost
            self._was_ready = bool(ready[-1])

    def _missing(self, batch: SampleBatch) -> int:
        first = int(batch.seq[0]) - 1 if self._last_seq is None else self._last_seq
        self._last_seq = int(batch.seq[-1])
        return self._last_seq - first - len(batch.seq)

    def _angles(self, batch: SampleBatch) -> FloatArray:
        angles = np.full((len(batch.seq), 2), np.nan)
        delay = min(self._delays)
        waiting = []
        for poll in self._polls:
            moment = poll.time - delay
            if moment > batch.time[-1] + self._half_period:
                waiting.append(poll)
            elif moment >= batch.time[0] - self._half_period:
                i = int(np.argmin(np.abs(batch.time - moment)))
                angles[i] = snap_angles(poll.angles + poll.rates * (batch.time[i] - moment))
        self._polls = waiting
        return angles
