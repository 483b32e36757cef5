"""Data acquisition: drains the IMU, assigns table angles to its samples, and stamps stage and step."""

import math
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from calstation.devices import Imu, SampleBatch, TableStatus
from calstation.estimation.common import SampleBlock, snap_angles
from calstation.physics import CHANNELS, FloatArray
from calstation.sequencer.context import Clock, LastSample, UnitTask

#: Number of ticks over which the minimum delay between IMU clock and station clock is determined.
CLOCK_WINDOW = 200

#: Assumed interval, in counter and IMU time, between the last sample of a run and the first one after resumption, s.
#: The true interval is unknown if the unit lost power.
INTERRUPTION = 1.0

#: A channel is stuck if its noise is at least this many output steps and its value is constant over this many samples;
#: the probability of this occurring by chance is 1e-28.
_MIN_NOISE, _STUCK_AFTER = 0.35, 400

#: Lateness of samples, as a fraction of the counter's wrap time, that indicates an undetected wrap. Transport delay
#: only increases the lateness.
_WRAPPED = 0.9

#: Maximum duration of a poll, s. A longer one was lost and repeated, so the time of its angles is unknown.
SLOWEST_POLL = 0.3


@dataclass(frozen=True)
class Flow:
    """Result of a drain: number of samples, number missing before or among them, and status bits.

    `invalid` is True if some output is not a number; `stuck` is the name of a channel that was constant for too long,
    or "".
    """

    count: int = 0
    missing: int = 0
    ready: bool = False
    saturated: bool = False
    failed: bool = False
    invalid: bool = False
    stuck: str = ""


@dataclass
class Stamps:
    """Stamps that all units share: every later drain assigns `stage`, `step` and `valid` to its samples.

    While `unlogged` is set, samples are passed to taps only.
    """

    step: int = 0
    stage: str = ""
    valid: bool = True
    unlogged: bool = False

    @contextmanager
    def unlogged_samples(self) -> Iterator[None]:
        """Keep samples out of the logs while the context is open."""
        before, self.unlogged = self.unlogged, True
        try:
            yield
        finally:
            self.unlogged = before


class Acquisition:
    """Converts the IMU's samples into stamped blocks for the log and the solver.

    The IMU time of a table poll is the midpoint between the station times of request and reply, minus the latency and
    the smallest delay observed between IMU clock and station clock. The angle, extrapolated with the polled rate, is
    assigned to the nearest sample; other samples have NaN. `latency` is the age of a polled angle at the midpoint, s.
    If `gimbal` is set, the polled angles belong to three joints.

    If exactly one full wrap of the counter is lost, the counter shows no gap. The station clock reveals the loss: the
    following samples are later than all previous ones by the duration of a wrap.

    `breaks` counts interruptions of the counter and losses of readiness, `restarts` only the ones caused by a restart.
    """

    def __init__(
        self,
        imu: Imu,
        unit: UnitTask,
        clock: Clock,
        stamps: Stamps,
        sink: Callable[[SampleBlock], None],
        *,
        latency: float = 0.0,
        after: LastSample | None = None,
        gimbal: bool = False,
    ) -> None:
        self._imu, self._unit, self._clock, self._stamps, self._sink = imu, unit, clock, stamps, sink
        self._latency, self._gimbal = latency, gimbal
        self.scale = unit.model.count_size
        self._latest: SampleBatch | None = None
        self._period = 1.0 / unit.model.sample_rate
        #: Station time (s), angles (rad) and rates (rad/s) of each poll of the table.
        self._polls: list[tuple[float, FloatArray, FloatArray]] = []
        model = unit.model
        scale = self._period ** (0.5 if model.output == "increment" else -0.5)
        noise = np.repeat([model.gyro_arw / model.gyro_lsb, model.accel_vrw / model.accel_lsb], 3) * scale
        self._has_noise = noise >= _MIN_NOISE * unit.span.step
        self._unchanged = np.zeros(6, np.int64)
        self._previous_counts: FloatArray | None = None
        self._delays: deque[float] = deque(maxlen=CLOCK_WINDOW)
        self._taps: list[list[SampleBlock]] = []
        self._last_seq: int | None = None
        self._after = after
        self._seq_shift, self._time_shift = 0, 0.0
        self.newest: float | None = None
        self.gaps = 0
        self.breaks = self.restarts = 0
        self._was_ready = False
        self._device_restarts = 0
        self.last_arrival = clock.now()

    def poll(self, status: TableStatus, asked: float, answered: float) -> None:
        """Add a poll of the table with the station times of its request and its reply, s; ignore a slow one."""
        if answered - asked > SLOWEST_POLL:
            return
        middle = 0.5 * (asked + answered) - self._latency
        if self._gimbal:
            self._polls.append((middle, np.array(status.joints), np.array(status.joint_rates)))
        else:
            self._polls.append((middle, np.array(status.angles), np.array(status.rates)))

    def drain(self) -> Flow:
        """Read all samples received so far, stamp them and pass them on.

        Raises DeviceFaultError, or ConfigurationError if the log cannot be written.
        """
        batch = self._imu.read()
        count = len(batch.seq)
        if count == 0:
            return Flow()
        now = self._clock.now()
        if self._after is not None and self._last_seq is None:
            # Counter and clock continue from the run that is resumed.
            after, lost = self._after, round(INTERRUPTION / self._period)
            self._seq_shift = after.seq + lost + 1 - int(batch.seq[0])
            self._time_shift = after.time + INTERRUPTION + self._period - float(batch.time[0])
        batch = self._with_wraps(batch, now)
        before = int(batch.seq[0]) - 1 if self._last_seq is None else self._last_seq
        self._last_seq = int(batch.seq[-1])
        missing = self._last_seq - before - count
        if not self._stamps.unlogged:
            self.gaps += missing > 0
        self.breaks += missing > 0
        self.newest = float(batch.time[-1])
        self._latest = batch
        self.last_arrival = now
        if missing:
            self._delays.clear()
        self._delays.append(now - self.newest)
        finite = np.isfinite(batch.counts).all(axis=1)
        ends = (batch.counts <= self._unit.span.low) | (batch.counts >= self._unit.span.high)
        saturated = (batch.status & self._unit.masks.saturated != 0) | ends.any(axis=1)
        # samples after an invalid one belong to a step that will be repeated
        sound = np.logical_and.accumulate(finite & ~saturated)
        polled = self._angles(batch)
        station = np.full((count, 1), np.nan)
        station[-1] = now
        block = SampleBlock(
            stage=self._stamps.stage,
            seq=batch.seq,
            time=batch.time,
            counts=batch.counts,
            angles=np.full((count, 2), np.nan) if self._gimbal else polled,
            step=np.full(count, self._stamps.step, np.int64),
            valid=self._stamps.valid & sound,
            temperature=batch.temperature,
            joints=polled if self._gimbal else np.empty((count, 0)),
            station=station,
        )
        for tap in self._taps:
            tap.append(block)
        if not self._stamps.unlogged:
            self._sink(block)
        masks = self._unit.masks
        ready = masks.ready == 0 or bool(batch.status[-1] & masks.ready)
        self._note_restart(batch)
        judged = ready and not saturated.any()  # a unit that is not ready may output only zeros
        return Flow(
            count,
            missing,
            ready,
            saturated=bool(saturated.any()),
            failed=bool(int(np.bitwise_or.reduce(batch.status)) & masks.failed),
            invalid=not finite.all(),
            stuck=self._stuck(batch.counts) if judged else "",
        )

    @property
    def recent(self) -> tuple[tuple[float, ...], float | None] | None:
        """Mean output (rad/s, m/s²; NaN if not numeric), temperature (°C) of the last drain; None before the first."""
        if self._latest is None:
            return None
        counts = self._latest.counts[np.isfinite(self._latest.counts).all(axis=1)]
        mean = counts.mean(axis=0) * self.scale if len(counts) else np.full(6, np.nan)
        temperature = float(self._latest.temperature[-1])
        return tuple(float(v) for v in mean), None if np.isnan(temperature) else temperature

    @contextmanager
    def tap(self) -> Iterator[list[SampleBlock]]:
        """Collect the blocks drained while the context is open."""
        blocks: list[SampleBlock] = []
        self._taps.append(blocks)
        try:
            yield blocks
        finally:
            self._taps.remove(blocks)

    def _with_wraps(self, batch: SampleBatch, now: float) -> SampleBatch:
        """Return the batch with the run's counter and time, corrected for lost whole wraps of the unit's counter."""
        if self._delays and math.isfinite(self._unit.wrap):
            seconds = self._period * self._unit.wrap
            late = now - (float(batch.time[-1]) + self._time_shift) - min(self._delays)
            wraps = max(0, math.floor(late / seconds + 1.0 - _WRAPPED))
            self._seq_shift += round(wraps * self._unit.wrap)
            self._time_shift += wraps * seconds
        return replace(batch, seq=batch.seq + self._seq_shift, time=batch.time + self._time_shift)

    def _stuck(self, counts: FloatArray) -> str:
        """Return the first channel that is stuck, or "" if there is none."""
        before = counts[:1] if self._previous_counts is None else self._previous_counts[None]
        changed = counts != np.concatenate([before, counts[:-1]])
        self._previous_counts = counts[-1]
        last = len(counts) - 1 - np.argmax(changed[::-1], axis=0)
        self._unchanged = np.where(changed.any(axis=0), len(counts) - 1 - last, self._unchanged + len(counts))
        stuck = np.flatnonzero(self._has_noise & (self._unchanged >= _STUCK_AFTER))
        return CHANNELS[int(stuck[0])].replace("_", " ") if len(stuck) else ""

    def _note_restart(self, batch: SampleBatch) -> None:
        """Count restarts of the unit's counter and losses of readiness."""
        before, self._device_restarts = self._device_restarts, self._imu.stats.restarts
        self.restarts += self._device_restarts > before
        mask = self._unit.masks.ready
        if mask:
            ready = np.concatenate([[self._was_ready], batch.status & mask != 0])
            lost = bool((ready[:-1] & ~ready[1:]).any())
            self.breaks += lost
            self.restarts += lost
            self._was_ready = bool(ready[-1])

    def _angles(self, batch: SampleBatch) -> FloatArray:
        angles = np.full((len(batch.seq), 3 if self._gimbal else 2), np.nan)
        delay, half = min(self._delays), 0.5 * self._period
        waiting = []
        for poll in self._polls:
            time, polled, rates = poll
            moment = time - delay
            if moment > batch.time[-1] + half:
                waiting.append(poll)
            elif moment >= batch.time[0] - half:
                i = int(np.argmin(np.abs(batch.time - moment)))
                angles[i] = snap_angles(polled + rates * (batch.time[i] - moment))
        self._polls = waiting
        return angles
