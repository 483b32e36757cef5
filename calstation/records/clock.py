"""Continuous time from the time stamps of a recording; wraps, steps back and jumps of its clock are counted."""

from dataclasses import dataclass

import numpy as np

from calstation.estimation.common import SEQUENCE_MODULI, SequenceError
from calstation.messages import Text
from calstation.physics import FloatArray, IntArray

#: Lengths of a day and of a GPS week, s, after which time of day and time of week restart.
_DAY, _WEEK = 86400.0, 604800.0
#: Longest step across a wrap, the larger of s and sample periods; at a longer step, the clock was set back.
_WRAP_STEP, _WRAP_PERIODS = 1.0, 10.0
#: If the times return within this number of rows after a step back, the rows are out of order.
_RETURN_ROWS = 8
#: Excess of a step over the expected one, in sample periods, above which the clock has jumped.
_JUMP = 0.5


@dataclass
class TimeReport:
    """Irregularities of the time stamps of a recording; known after all samples have been read."""

    wraps: int = 0  #: Number of wraps, which do not interrupt the time.
    steps_back: int = 0  #: Number of steps back of the clock.
    jumps: int = 0  #: Number of steps forward that are longer than the counter explains.
    repeated: int = 0  #: Number of repeated rows, which are left out.
    counted: bool = False  #: Whether there are no time stamps, so that the time follows from the count.
    jitter: float = 0.0  #: Rms deviation of arrival times from the line that replaces them, s.

    def reset(self) -> None:
        """Clear the report before the recording is read again."""
        self.__init__()  # type: ignore[misc]

    def add(self, other: "TimeReport") -> None:
        """Add the irregularities of another file of the same log."""
        for name in ("wraps", "steps_back", "jumps", "repeated"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.counted |= other.counted
        self.jitter = max(self.jitter, other.jitter)

    @property
    def irregularities(self) -> list[Text]:
        """Sentences about the irregularities, except the jitter."""
        counts = {name: getattr(self, name) for name in ("wraps", "steps_back", "jumps", "repeated")}
        texts = [Text.of(f"recording.time_{name}", count=count) for name, count in counts.items() if count]
        return [*([Text("recording.time_counted")] if self.counted else []), *texts]


class ClockUnwrapper:
    """Makes the time stamps of a recording continuous, chunk by chunk.

    A decrease from the end of the clock's range to its start is a wrap; the range is 2^16 or 2^32 units of the time
    stamps, a day or a GPS week. At any other decrease, the clock was set back: the time then continues according to
    the counter, or after a gap of one sample if there is no counter. If the times return within a few rows, the rows
    are out of order, which is an error.
    """

    def __init__(self, period: float, unit: float, report: TimeReport) -> None:
        """Create the state; `unit` is the unit of the time stamps in the file, s."""
        self._period, self._report = period, report
        self._moduli = (*(modulus * unit for modulus in SEQUENCE_MODULI[1:]), _DAY, _WEEK)
        self._last: tuple[float, int] | None = None
        self._offset = 0.0
        self._decrease: tuple[int, float, float] | None = None

    def feed(self, time: FloatArray, seq: IntArray | None) -> tuple[FloatArray, list[int]]:
        """Return the continuous time of the next samples, s, shape (n,), and the rows where the clock was set back.

        `seq` is the sample counter, shape (n,), or None. Raises SequenceError with the row number.
        """
        if not len(time):
            return time, []
        last_time, last_seq = self._last or (float(time[0]) - self._period, 0 if seq is None else int(seq[0]) - 1)
        steps = np.diff(time, prepend=last_time)
        counted = np.ones(len(time), np.int64) if seq is None else np.diff(seq, prepend=last_seq)
        self._last = float(time[-1]), 0 if seq is None else int(seq[-1])
        jumped = (steps < 0.0) | ((counted > 0) & (steps > (counted + _JUMP) * self._period))
        offsets, set_back = np.full(len(time), self._offset), list[int]()
        for k in np.flatnonzero(jumped).tolist():
            before = float(time[k]) - float(steps[k])
            count = self._report.steps_back
            if correction := self._correction(k, before, float(time[k]), int(counted[k]), seq is not None):
                self._offset += correction
                offsets[k:] = self._offset
                set_back += [k] * (self._report.steps_back - count)
        if self._decrease is not None:
            row, before, after = self._decrease
            self._decrease = (row - len(time), before, after)
        return np.asarray(time + offsets), set_back

    def _correction(self, row: int, before: float, now: float, counted: int, has_counter: bool) -> float:
        """Return the correction of the time, s, from a discontinuous row onwards."""
        if now > before:
            if self._decrease is not None and row - self._decrease[0] <= _RETURN_ROWS and now > self._decrease[1]:
                first = self._decrease
                raise SequenceError("recording.time_returns", row=max(first[0], 0), before=first[1], time=first[2])
            self._report.jumps += has_counter
            return 0.0
        longest = max(_WRAP_STEP, _WRAP_PERIODS * self._period)
        for modulus in self._moduli:
            if before <= modulus and 0.0 < now + modulus - before <= longest:
                self._report.wraps += 1
                return modulus
        if has_counter and counted <= 0:
            return 0.0  # the counter decreased, too: SequenceUnwrapper decides
        self._report.steps_back += 1
        self._decrease = row, before, now
        return before + (counted if has_counter else 2) * self._period - now
