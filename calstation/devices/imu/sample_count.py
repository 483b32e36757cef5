"""Conversion of a unit's counter or clock to a continuous count of samples."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from calstation.devices.profiles import FrameField, FrameSection
from calstation.estimation.common import unwrap_counter
from calstation.physics import IntArray

#: Maximum number of later frames that may overtake a frame; a larger decrease of the counter is a reset.
_MAX_DELAYED = 3

#: Largest step of a clock in samples; a larger step is invalid and is clipped to avoid an overflow.
_MAX_STEP = 2.0**40

#: Number of ticks per sample to which a counter in floating-point seconds is converted.
FLOAT_TICKS = 2.0**16


def whole_ticks(counter: FrameField, values: NDArray[Any]) -> IntArray:
    """Return the counters of frames as integers, shape (n,), with `FLOAT_TICKS` per sample if they are floats."""
    if not counter.is_float:
        return values.astype(np.int64)
    ticks = np.rint(values / counter.per_sample * FLOAT_TICKS)
    return np.asarray(ticks.clip(-(2.0**62), 2.0**62).astype(np.int64))


class SampleCount:
    """Counts samples with the frame's field `counter`, which is a clock if it advances by more than 1 per sample.

    gaps : number of interruptions
    restarts : number of interruptions at which the counter or the clock restarted
    """

    def __init__(self, frame: FrameSection) -> None:
        counter = frame.required_field("counter")
        self._bits = 64 if counter.is_float else 8 * counter.width
        self._per_sample = FLOAT_TICKS if counter.is_float else counter.per_sample
        self._is_clock = self._per_sample != 1.0 or self._bits > 32
        #: Count of the last sample; None before the first sample.
        self.last: int | None = None
        self._last_ticks = 0
        self._last_raw: int | None = None
        self.gaps = self.restarts = 0

    def in_order(self, raw: IntArray) -> IntArray:
        """Return the indices of the new samples in order, shape (m,), m ≤ n; `raw` is in order of arrival, shape (n,).

        A frame that arrives twice, or after its successors were counted, is omitted. A frame that a few later frames
        have overtaken is inserted at the correct position.
        """
        if not len(raw):
            return np.arange(0)
        steps = self._clock_steps(raw) if self._is_clock else self._counter_steps(raw)
        if not ((steps <= 0) & (steps >= -_MAX_DELAYED)).any():
            return np.arange(len(raw))
        # Frames received after a reset are not moved to before it.
        position = np.cumsum(np.where(steps < -_MAX_DELAYED, 1, steps))
        order = np.argsort(position, kind="stable")
        fresh = np.diff(position[order], prepend=0) > 0
        return np.asarray(order[fresh])

    def _counter_steps(self, raw: IntArray) -> IntArray:
        """Return the step in samples from each received frame to the next; a small step may be negative."""
        modulus = 1 << self._bits
        first = int(raw[0]) - 1 if self._last_raw is None else self._last_raw
        steps = (raw.astype(np.int64) - np.concatenate(([first], raw[:-1]))) % modulus
        return np.asarray(np.where(steps >= modulus - _MAX_DELAYED, steps - modulus, steps))

    def _clock_steps(self, ticks: IntArray) -> IntArray:
        """Return the rounded step in samples between consecutive frames; it is negative if the clock runs backwards."""
        first = int(ticks[0]) - round(self._per_sample) if self.last is None else self._last_ticks
        elapsed_ticks = ticks.astype(np.uint64) - np.concatenate(([first], ticks[:-1])).astype(np.uint64)
        signed = (elapsed_ticks << np.uint64(64 - self._bits)).view(np.int64) >> (64 - self._bits)
        return np.asarray(np.rint(signed / self._per_sample).clip(-_MAX_STEP, _MAX_STEP).astype(np.int64))

    def feed(self, raw: IntArray) -> IntArray:
        """Convert the ordered raw counters of new samples, int64, shape (n,), to a continuous count, shape (n,)."""
        if not len(raw):
            return raw
        seq = self._count_clock(raw) if self._is_clock else self._count_counter(raw)
        if self.last is not None and seq[0] != self.last + 1:
            self.gaps += 1
        self.gaps += int(np.count_nonzero(np.diff(seq) != 1))
        self.last = int(seq[-1])
        return seq

    def _count_counter(self, raw: IntArray) -> IntArray:
        """Unwrap the counter; also store its raw value, because a reset permanently shifts it relative to the count."""
        seq = unwrap_counter(raw, self.last, self._bits, self._last_raw)
        before = seq[0] - 1 if self.last is None else self.last
        before_raw = raw[0] - 1 if self._last_raw is None else self._last_raw
        jumps = np.diff(seq, prepend=before) - np.diff(raw, prepend=before_raw)
        self.restarts += int(np.count_nonzero(jumps % (1 << self._bits)))
        self._last_raw = int(raw[-1])
        return seq

    def _count_clock(self, ticks: IntArray) -> IntArray:
        """Convert the steps of a clock to samples; a negative step is a reset, at which one sample counts as lost."""
        steps = self._clock_steps(ticks)
        self.restarts += int((steps < 0).sum())
        steps = np.where(steps < 0, 2, np.maximum(1, steps))
        start = round(int(ticks[0]) / self._per_sample) - 1 if self.last is None else self.last
        self._last_ticks = int(ticks[-1])
        return np.asarray(start + np.cumsum(steps))
