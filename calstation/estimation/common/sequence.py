"""Unwrapping of angles, and of sample counters: wraps, resets and gaps (docs/contract.md, "CSV import")."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from calstation.errors import InputError
from calstation.physics import FloatArray, IntArray

#: Numbers of counts after which a counter wraps.
SEQUENCE_MODULI = (2**8, 2**16, 2**32)
_RESTART_SECONDS = 1.0
#: Rate between two angles above which they are recorded modulo a turn, rad/s; no table is as fast.
_FASTEST = np.deg2rad(720.0)
#: Largest time between two angles, s, for which their change is compared with that at the previous rate.
_CONTINUOUS = 1.5
#: Change of angle, and its difference from the change at the previous rate, above which a turn was skipped, rad.
_JUMP = np.deg2rad(270.0)


class SequenceError(InputError):
    """Error of a row whose counter repeats or is out of order."""

    @property
    def row(self) -> int:
        """Index of the row in its chunk."""
        return int(self.values["row"])


class SequenceUnwrapper:
    """Converts a logged counter to a strictly increasing one, chunk by chunk.

    A drop from near 2^8, 2^16 or 2^32 to near 0 with continuous time is a wrap. A drop with a jump in time is a reset,
    at which the count advances by the number of sample periods in the jump, at least 2. If the unit's clock restarts
    together with its counter, the count and the time advance by 2 samples. Any other decrease is an error.
    """

    def __init__(self, sample_period: float) -> None:
        self._period = sample_period
        self._restart_count = max(16, round(_RESTART_SECONDS / sample_period))
        self._last_raw: int | None = None
        self._last_time = 0.0
        self._offset = 0
        self._time_offset = 0.0

    def feed(self, seq: IntArray, time: FloatArray) -> tuple[IntArray, FloatArray, list[int]]:
        """Unwrap the next chunk of counter and clock (s).

        Return the increasing counter and clock, shape (n,), and the indices of restarts, at which the unit's counter
        and clock were reset together. Raises SequenceError with the index of the first row that repeats, is out of
        order or has decreasing time.
        """
        if len(seq) == 0:
            return seq.astype(np.int64), time.astype(np.float64), []
        last_raw, last_time = self._last_raw, self._last_time
        if last_raw is None:
            last_raw, last_time = int(seq[0]) - 1, float(time[0]) - self._period
        previous_seq = np.concatenate([np.array([last_raw], np.int64), seq[:-1]])
        previous_time = np.concatenate([np.array([last_time]), time[:-1]])
        if int(np.min(seq)) < 0:
            raise SequenceError("recording.seq_negative", row=int(np.argmax(seq < 0)))
        irregular = np.flatnonzero((seq <= previous_seq) | (time <= previous_time))
        offsets = np.full(len(seq), self._offset, dtype=np.int64)
        shifts = np.full(len(seq), self._time_offset)
        restarts = []
        for row in irregular:
            k = int(row)
            jump, shift = self._step(k, int(previous_seq[k]), int(seq[k]), float(previous_time[k]), float(time[k]))
            offsets[k:] += jump
            shifts[k:] += shift
            if shift:
                restarts.append(k)
        self._last_raw, self._last_time = int(seq[-1]), float(time[-1])
        self._offset, self._time_offset = int(offsets[-1]), float(shifts[-1])
        return seq + offsets, time + shifts, restarts

    def _step(self, row: int, last: int, now: int, last_time: float, now_time: float) -> tuple[int, float]:
        """Return the offsets to add to the counter and the clock (s) from a row at which one does not increase."""
        elapsed = (now_time - last_time) / self._period
        if now == last:
            raise SequenceError("recording.seq_repeated", row=row, seq=now)
        if now > last:
            raise SequenceError("recording.time_falls", row=row, before=last_time, time=now_time)
        for modulus in SEQUENCE_MODULI:
            steps = now - last + modulus
            margin = modulus // 4
            if modulus - margin <= last < modulus and now < margin and abs(elapsed - steps) < 0.5 + 0.01 * steps:
                return modulus, 0.0
        if now < self._restart_count and elapsed > 1.5:
            return last + max(2, round(elapsed)) - now, 0.0
        clock_restarted = now_time <= (now + 1) * self._period + _RESTART_SECONDS
        if now < self._restart_count and clock_restarted and last_time - now_time > _RESTART_SECONDS:
            return last + 2 - now, last_time + 2 * self._period - now_time
        raise SequenceError("recording.seq_falls", row=row, before=last, seq=now)


def unwrap_counter(raw: Sequence[int] | IntArray, last: int | None, bits: int, last_raw: int | None = None) -> IntArray:
    """Continue a live counter and return the continuous counts, shape (n,).

    Forward steps are computed modulo 2^bits. A drop to the first eighth of the range that would imply a gap of more
    than half the range is a reset, counted as one missing sample. A repeated value is a full cycle of the counter.

    Parameters
    ----------
    raw : received values of the counter, shape (n,)
    last, last_raw : preceding continuous count, and the value that was received for it; None at the start
    bits : width of the counter
    """
    received = np.asarray(raw, dtype=np.int64)
    if len(received) == 0:
        return received
    modulus = 1 << bits
    start = int(received[0]) - 1 if last is None else last
    previous = np.concatenate(([start % modulus if last_raw is None else last_raw], received[:-1]))
    steps = (received - previous) % modulus
    reset = (steps > modulus // 2) & (received < modulus // 8)
    return start + np.cumsum(np.where(reset, 2, np.where(steps == 0, modulus, steps)))


#: Largest rounding of a recorded angle, rad.
_ROUNDING = 0.01


class AngleUnwrapper:
    """Makes the angles of a table cumulative, chunk by chunk, if they are recorded modulo a whole turn.

    Cumulative angles remain unchanged, even if the table turns between two polls: they exceed the range of one turn
    somewhere in the recording. The result does not depend on the division into chunks.
    """

    def __init__(self, spans: Callable[[], FloatArray]) -> None:
        """Create the state; `spans` returns the ranges of the angles of a whole recording, rad, shape (k,)."""
        self._spans = cache(spans)
        self._columns: list[_LastAngle] = []

    def feed(self, time: FloatArray, angles: FloatArray) -> FloatArray:
        """Return the angles of the next chunk, rad, shape (n, k), NaN between polls; `time` is in s, shape (n,)."""
        self._columns = self._columns or [_LastAngle() for _ in range(angles.shape[1])]
        columns = [
            column.unwrap(time, values, partial(self._is_modulo, k))
            for k, (column, values) in enumerate(zip(self._columns, angles.T, strict=True))
        ]
        return np.column_stack(columns) if columns else angles

    def _is_modulo(self, column: int) -> bool:
        return bool(self._spans()[column] < 2.0 * np.pi + _ROUNDING)


@dataclass
class _LastAngle:
    """The last angle of a column that was polled."""

    time: float = np.nan  #: s
    recorded: float = np.nan  #: rad
    rate: float = 0.0  #: Mean rate since the angle polled before it, rad/s.
    turns: int = 0  #: Whole turns added to the recorded angle.

    def unwrap(self, time: FloatArray, angles: FloatArray, is_modulo: Callable[[], bool]) -> FloatArray:
        """Return the next angles of the column, rad, shape (n,).

        `is_modulo` returns whether all angles of the recording are within a turn. It is called only at a jump.
        """
        polled = np.flatnonzero(np.isfinite(angles))
        if not len(polled):
            return np.asarray(angles + 2.0 * np.pi * self.turns)
        times, recorded = (
            np.concatenate([[last], x[polled]]) for last, x in ((self.time, time), (self.recorded, angles))
        )
        elapsed, change = np.diff(times), np.diff(recorded)
        added = np.zeros(len(angles), np.int64)
        for k in np.flatnonzero(np.abs(change) > np.pi):
            rate = change[k - 1] / elapsed[k - 1] if k > 0 and elapsed[k - 1] > 0.0 else self.rate
            unexpected = min(abs(change[k]), abs(change[k] - rate * elapsed[k])) > _JUMP
            is_jump = abs(change[k]) > _FASTEST * elapsed[k] or (unexpected and elapsed[k] <= _CONTINUOUS)
            if is_jump and is_modulo():
                added[polled[k]] = -round(change[k] / (2.0 * np.pi))
                change[k] += 2.0 * np.pi * added[polled[k]]
        turns = self.turns + np.cumsum(added)
        self.time, self.recorded, self.turns = float(times[-1]), float(recorded[-1]), int(turns[-1])
        if elapsed[-1] > 0.0:
            self.rate = float(change[-1] / elapsed[-1])
        return np.asarray(angles + 2.0 * np.pi * turns)
