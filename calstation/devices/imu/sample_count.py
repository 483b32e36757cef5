"""Converts a unit's counter, or its clock, to a continuous count of samples."""

import numpy as np

from calstation.devices.profiles import FrameSection
from calstation.estimation.common import unwrap_counter
from calstation.physics import IntArray

#: Largest number of frames that may overtake another; a counter that falls by more was reset.
_OVERTAKEN = 3

#: Largest step of a clock in samples; more is invalid and must not overflow.
_FARTHEST = 2.0**40


class SampleCount:
    """Counts samples by the frame's field `counter`, which is a clock if it counts more than one per sample.

    gaps : interruptions so far
    restarts : interruptions at which the counter, or the clock, restarted
    """

    def __init__(self, frame: FrameSection) -> None:
        counter = frame.named("counter")
        self._bits = 8 * counter.width
        self._per_sample = counter.per_sample
        self._is_clock = self._per_sample != 1.0 or self._bits > 32
        self._last: int | None = None
        self._last_ticks = 0
        self._last_raw: int | None = None
        self.gaps = self.restarts = 0

    def in_order(self, raw: IntArray) -> IntArray:
        """Indices that select and order further samples by their raw counter, shape (m,), m ≤ n.

        A frame that came twice, or so late that its successors are counted already, is left out; one that was
        overtaken by a few is put back in order.
        """
        if not len(raw):
            return np.arange(0)
        steps = self._clock_steps(raw) if self._is_clock else self._counter_steps(raw)
        if not ((steps <= 0) & (steps >= -_OVERTAKEN)).any():
            return np.arange(len(raw))
        # A reset is not a late frame: what follows it stays after it.
        position = np.cumsum(np.where(steps < -_OVERTAKEN, 1, steps))
        order = np.argsort(position, kind="stable")
        fresh = np.diff(position[order], prepend=0) > 0
        return np.asarray(order[fresh])

    def _counter_steps(self, raw: IntArray) -> IntArray:
        """Samples from each frame to the next received one: a few backwards, or forwards."""
        modulus = 1 << self._bits
        first = int(raw[0]) - 1 if self._last_raw is None else self._last_raw
        steps = (raw.astype(np.int64) - np.concatenate(([first], raw[:-1]))) % modulus
        return np.asarray(np.where(steps >= modulus - _OVERTAKEN, steps - modulus, steps))

    def _clock_steps(self, ticks: IntArray) -> IntArray:
        """Samples from each frame to the next received one, rounded; negative if the clock runs back."""
        first = int(ticks[0]) - round(self._per_sample) if self._last is None else self._last_ticks
        passed = ticks.astype(np.uint64) - np.concatenate(([first], ticks[:-1])).astype(np.uint64)
        signed = (passed << np.uint64(64 - self._bits)).view(np.int64) >> (64 - self._bits)
        return np.asarray(np.rint(signed / self._per_sample).clip(-_FARTHEST, _FARTHEST).astype(np.int64))

    def feed(self, raw: IntArray) -> IntArray:
        """Continuous count of further samples from their raw counter."""
        if not len(raw):
            return raw
        seq = self._of_clock(raw) if self._is_clock else self._of_counter(raw)
        if self._last is not None and seq[0] != self._last + 1:
            self.gaps += 1
        self.gaps += int(np.count_nonzero(np.diff(seq) != 1))
        self._last = int(seq[-1])
        return seq

    def _of_counter(self, raw: IntArray) -> IntArray:
        """Unwrap the counter; the raw one is kept as well, since a reset separates the two for good."""
        seq = unwrap_counter(raw, self._last, self._bits, self._last_raw)
        before = seq[0] - 1 if self._last is None else self._last
        before_raw = raw[0] - 1 if self._last_raw is None else self._last_raw
        apart = np.diff(seq, prepend=before) - np.diff(raw, prepend=before_raw)
        self.restarts += int(np.count_nonzero(apart % (1 << self._bits)))
        self._last_raw = int(raw[-1])
        return seq

    def _of_clock(self, ticks: IntArray) -> IntArray:
        """Round steps of a clock to samples; a clock that runs back was reset, which costs one sample."""
        steps = self._clock_steps(ticks)
        self.restarts += int((steps < 0).sum())
        steps = np.where(steps < 0, 2, np.maximum(1, steps))
        start = round(int(ticks[0]) / self._per_sample) - 1 if self._last is None else self._last
        self._last_ticks = int(ticks[-1])
        return np.asarray(start + np.cumsum(steps))
