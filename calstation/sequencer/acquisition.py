"""Data acquisition, which reads samples of an IMU, assigns table angles to them, and tags them with stage and step."""

import math
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from calstation.devices import Imu, SampleBatch, TableStatus
from calstation.estimation.common import LARGEST_VALUE, SampleBlock, snap_angles
from calstation.physics import CHANNELS, FloatArray
from calstation.sequencer.context import Clock, LastSample, UnitTask

#: Number of ticks over which the minimum delay between the IMU clock and the station clock is determined.
CLOCK_WINDOW = 200

#: Assumed interval of counter and IMU time between the last sample of a run and the first sample after it is resumed,
#: s. The true interval is unknown if the unit lost power.
RESUME_GAP = 1.0

#: A channel is stuck if its noise is at least `_MIN_NOISE` output steps but its value is constant over `_STUCK_AFTER`
#: samples. The probability that this occurs by chance is 1e-28.
_MIN_NOISE, _STUCK_AFTER = 0.35, 400

#: Delay of samples, as a fraction of the wrap period of the counter, that indicates an undetected wrap; the transport
#: can only increase the delay.
_WRAP_DELAY = 0.9

#: Maximum duration of a poll, s; a longer poll was lost and repeated, so that the time of its angles is unknown.
MAX_POLL_DURATION = 0.3


@dataclass(frozen=True)
class DrainResult:
    """The numbers of samples read and of samples missing before or among them, and the combined status of the samples.

    `invalid` is True if any output is not a number. `stuck` is the name of a channel that has been constant for too
    long, or "".
    """

    count: int = 0
    missing: int = 0
    ready: bool = False
    saturated: bool = False
    failed: bool = False
    invalid: bool = False
    stuck: str = ""


@dataclass
class SampleTags:
    """The stage, step and validity with which the samples of all units are tagged when they are read.

    While `unlogged` is set, samples are passed only to the taps. `chamber` is the temperature of the chamber's air, °C.
    """

    step: int = 0
    stage: str = ""
    valid: bool = True
    unlogged: bool = False
    chamber: float | None = None

    @contextmanager
    def without_logging(self) -> Iterator[None]:
        """Do not log samples while the context is open."""
        before, self.unlogged = self.unlogged, True
        try:
            yield
        finally:
            self.unlogged = before


class Acquisition:
    """Converts the IMU's samples to tagged blocks for the log and the solver.

    The IMU time of a table poll is the midpoint of the station times of request and reply, minus the latency and the
    smallest delay observed between the IMU clock and the station clock. The polled angle is extrapolated with the
    polled rate to the nearest sample; the angles of all other samples are NaN.

    If exactly one full wrap of the counter is lost, the counter shows no gap. The station clock reveals the loss,
    because the following samples arrive later than all previous ones by the duration of a wrap.

    `newest_time` is the IMU time of the last sample, s, or None. `breaks` counts interruptions of the counter and
    losses of readiness, and `restarts` counts only those caused by a restart of the unit.

    Parameters
    ----------
    imu, unit, clock : the unit, its properties and the station clock
    tags : tags of the samples
    sink : called with each block that belongs in the log
    latency : age of a polled angle at the midpoint of the poll, s
    after : last sample of the run that is resumed
    gimbal : whether the polled angles belong to three joints
    """

    def __init__(
        self,
        imu: Imu,
        unit: UnitTask,
        clock: Clock,
        tags: SampleTags,
        sink: Callable[[SampleBlock], None],
        *,
        latency: float = 0.0,
        after: LastSample | None = None,
        gimbal: bool = False,
    ) -> None:
        self._imu, self._unit, self._clock, self._tags, self._sink = imu, unit, clock, tags, sink
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
        self.newest_time: float | None = None
        self.gaps = 0
        self.breaks = self.restarts = 0
        self._was_ready = False
        self._device_restarts = 0
        self.last_arrival = clock.now()

    def poll(self, status: TableStatus, requested: float, replied: float) -> None:
        """Add a poll of the table, unless it was so slow that the time of its angles is unknown.

        Parameters
        ----------
        status : state of the table
        requested, replied : station times of the request and the reply, s
        """
        if replied - requested > MAX_POLL_DURATION:
            return
        middle = 0.5 * (requested + replied) - self._latency
        angles, rates = (status.joints, status.joint_rates) if self._gimbal else (status.angles, status.rates)
        self._polls.append((middle, np.array(angles), np.array(rates)))

    def drain(self) -> DrainResult:
        """Read all samples received so far; pass them to the taps and, with their tags, to the log.

        Raises DeviceFaultError, or ConfigurationError if the log cannot be written.
        """
        batch = self._imu.read()
        count = len(batch.seq)
        if count == 0:
            return DrainResult()
        now = self._clock.now()
        if self._after is not None and self._last_seq is None:
            # The counter and the clock continue from the run that is resumed.
            after, missing_samples = self._after, round(RESUME_GAP / self._period)
            self._seq_shift = after.seq + missing_samples + 1 - int(batch.seq[0])
            self._time_shift = after.time + RESUME_GAP + self._period - float(batch.time[0])
        received = self._with_wraps(batch, now)
        batch = _without_impossible(received)
        before = int(batch.seq[0]) - 1 if self._last_seq is None else self._last_seq
        self._last_seq = int(batch.seq[-1])
        missing = self._last_seq - before - count
        if not self._tags.unlogged:
            self.gaps += missing > 0
        self.breaks += missing > 0
        self.newest_time = float(batch.time[-1])
        self._latest = batch
        self.last_arrival = now
        if missing:
            self._delays.clear()
        self._delays.append(now - self.newest_time)
        finite = np.isfinite(batch.counts).all(axis=1)
        masks, span = self._unit.masks, self._unit.span
        at_bound = (received.counts <= span.low) | (received.counts >= span.high)
        saturated = (batch.status & masks.saturated != 0) | at_bound.any(axis=1)
        # samples after an invalid one belong to a step that will be repeated
        valid = self._tags.valid & np.logical_and.accumulate(finite & ~saturated)
        polled = self._angles(batch)
        station = np.full((count, 1), np.nan)
        station[-1] = now
        chamber = np.full((count, 0 if self._tags.chamber is None else 1), np.nan)
        chamber[-1] = np.nan if self._tags.chamber is None else self._tags.chamber
        block = SampleBlock(
            stage=self._tags.stage,
            seq=batch.seq,
            time=batch.time,
            counts=batch.counts,
            angles=np.full((count, 2), np.nan) if self._gimbal else polled,
            step=np.full(count, self._tags.step, np.int64),
            valid=valid,
            temperature=batch.temperature,
            joints=polled if self._gimbal else np.empty((count, 0)),
            station=station,
            chamber=chamber,
        )
        for tap in self._taps:
            tap.append(block)
        if not self._tags.unlogged:
            self._sink(block)
        ready = masks.ready == 0 or bool(batch.status[-1] & masks.ready)
        self._count_restarts(batch)
        can_be_stuck = ready and not saturated.any()  # a unit that is not ready may output only zeros
        return DrainResult(
            count,
            missing,
            ready,
            saturated=bool(saturated.any()),
            failed=bool(int(np.bitwise_or.reduce(batch.status)) & masks.failed),
            invalid=not finite.all(),
            stuck=self._stuck(batch.counts) if can_be_stuck else "",
        )

    @property
    def recent(self) -> tuple[tuple[float, ...], float | None] | None:
        """Mean output (rad/s, m/s²; NaN if not numeric) and temperature (°C) of the last samples; None without any."""
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
        """Return the batch with the counter and time of the run, corrected for lost full wraps of the counter."""
        if self._delays and math.isfinite(self._unit.wrap):
            seconds = self._period * self._unit.wrap
            delay = now - (float(batch.time[-1]) + self._time_shift) - min(self._delays)
            wraps = max(0, math.floor(delay / seconds + 1.0 - _WRAP_DELAY))
            self._seq_shift += round(wraps * self._unit.wrap)
            self._time_shift += wraps * seconds
        return replace(batch, seq=batch.seq + self._seq_shift, time=batch.time + self._time_shift)

    def _stuck(self, counts: FloatArray) -> str:
        """Return the name of the first channel that is stuck, or ""."""
        before = counts[:1] if self._previous_counts is None else self._previous_counts[None]
        changed = counts != np.concatenate([before, counts[:-1]])
        self._previous_counts = counts[-1]
        last = len(counts) - 1 - np.argmax(changed[::-1], axis=0)
        self._unchanged = np.where(changed.any(axis=0), len(counts) - 1 - last, self._unchanged + len(counts))
        stuck = np.flatnonzero(self._has_noise & (self._unchanged >= _STUCK_AFTER))
        return CHANNELS[int(stuck[0])].replace("_", " ") if len(stuck) else ""

    def _count_restarts(self, batch: SampleBatch) -> None:
        """Count restarts of the unit's counter and losses of readiness."""
        before, self._device_restarts = self._device_restarts, self._imu.stats.restarts
        self.restarts += self._device_restarts > before
        mask = self._unit.masks.ready
        if mask:
            ready = np.concatenate([[self._was_ready], batch.status & mask != 0])
            has_lost = bool((ready[:-1] & ~ready[1:]).any())
            self.breaks += has_lost
            self.restarts += has_lost
            self._was_ready = bool(ready[-1])

    def _angles(self, batch: SampleBatch) -> FloatArray:
        angles = np.full((len(batch.seq), 3 if self._gimbal else 2), np.nan)
        delay, half = min(self._delays), 0.5 * self._period
        remaining = []
        for poll in self._polls:
            time, polled, rates = poll
            moment = time - delay
            if moment > batch.time[-1] + half:
                remaining.append(poll)
            elif moment >= batch.time[0] - half:
                i = int(np.argmin(np.abs(batch.time - moment)))
                angles[i] = snap_angles(polled + rates * (batch.time[i] - moment))
        self._polls = remaining
        return angles


def _without_impossible(batch: SampleBatch) -> SampleBatch:
    """Replace values that a log must not contain, such as infinity, by NaN."""
    counts, temperature = (
        np.where(np.abs(values) <= LARGEST_VALUE, values, np.nan) for values in (batch.counts, batch.temperature)
    )
    return replace(batch, counts=counts, temperature=temperature)
