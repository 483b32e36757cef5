"""Samples of a recording of any format as blocks: counter, clock, damaged rows and repeated rows."""

import itertools
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from calstation.errors import InputError
from calstation.estimation.common import (
    SEQUENCE_MODULI,
    AngleUnwrapper,
    SampleBlock,
    SequenceError,
    SequenceUnwrapper,
)
from calstation.physics import CHANNELS, FloatArray, IntArray
from calstation.records.arrival import TIMES, SampleTimes, are_arrivals, sample_period, sample_times
from calstation.records.clock import ClockUnwrapper, TimeReport
from calstation.records.log import DamagedRows
from calstation.records.meta import LogMeta
from calstation.records.samples import SampleTable
from calstation.records.temporary_rows import TemporaryRows

#: Size limit of a stage's name, bytes, as in the raw log.
_MAX_STAGE = 64
#: Largest number of characters of a stage's name that a message quotes.
_MAX_QUOTED = 40
#: Largest magnitudes that an IMU can measure, rad/s and m/s².
_MAX_RATE, _MAX_FORCE = 1e3, 1e5
#: Rows are assumed to be means of positions if the median angle between the forces of successive rows, rad, exceeds the
#: first limit and the relative scatter of their magnitudes does not exceed the second.
_MEANS_ANGLE, _MEANS_SCATTER = 0.2, 0.03


class _TimedRows(NamedTuple):
    """Rows with counter (None if there is none), continuous time, s, and the rows where the clock was set back."""

    table: SampleTable
    seq: IntArray | None
    time: FloatArray
    set_back: list[int]


@dataclass(frozen=True)
class Recording:
    """Samples of a file, and the irregularities and damaged rows found while reading it."""

    path: Path
    meta: LogMeta
    tables: Callable[[], Iterator[SampleTable]]  #: Reads the file from its start.
    time_unit: float = 1.0  #: Unit of the time stamps in the file, s.
    report: TimeReport = field(default_factory=TimeReport)
    damaged: list[DamagedRows] = field(default_factory=list)

    def blocks(self) -> Iterator[SampleBlock]:
        """Yield the samples in order, with unwrapped counters, split at stage changes; set report and damaged rows.

        Raises InputError with file, line and remedy.
        """
        self.report.reset()
        self.damaged.clear()
        rate, secondaries = self.meta.imu.sample_rate_hz, len(self.meta.secondaries)
        unwrapper, angles = SequenceUnwrapper(1.0 / rate), AngleUnwrapper(self._angle_spans)
        starts: set[tuple[float, ...]] = set()
        damage, samples = _Damage(self.damaged), 0
        for table, seq, time, set_back in self._numbered():
            if not len(table):
                damage.add(table, seq)
                continue
            counts = table.counts()
            try:
                unwrapped, clock, restarts = unwrapper.feed(seq, time)
            except SequenceError as exc:
                raise self._sequence_error(exc, table) from exc
            for k in sorted({*([] if samples else [0]), *restarts, *set_back}):
                row = (float(table.integers("seq")[k]), float(table.floats("time_s")[k]), *np.nan_to_num(counts[k]))
                if row in starts:
                    raise InputError("csv.repeated", file=self.path, line=int(table.lines[k]))
                starts.add(row)
            if not samples and len(table) > 1:
                self._check_rate(float(np.median(np.diff(clock) / np.diff(unwrapped))))
            samples += len(table)
            damage.add(table, unwrapped)
            yield from table.blocks(unwrapped, clock, counts, angles, secondaries)
        damage.finish()
        if not samples:
            raise InputError("csv.no_samples", file=self.path)

    def _numbered(self) -> Iterator[tuple[SampleTable, IntArray, FloatArray, list[int]]]:
        """Yield rows with counter, continuous time, s, and the rows where the clock was set back."""
        stream = self._timed(self.report)
        first = next(stream, None)
        if first is None:
            return
        self._check_no_means(first.table.counts())
        period = 1.0 / self.meta.imu.sample_rate_hz
        with ExitStack() as files:
            times, rows, position, read = None, None, 0, 0
            if first.seq is None or (not self.report.counted and are_arrivals(first.seq, first.time, period)):
                times, rows = self._sample_times(files)
            for table, seq, time, set_back in itertools.chain([first], stream):
                if rows is not None:
                    kept = ~rows.read(read, len(table))["repeated"]
                    read += len(table)
                    numbers = np.cumsum(kept) - 1
                    set_back = [int(numbers[k]) for k in set_back if kept[k]]
                    table = table.select(kept)
                if times is not None:
                    clock = times.clock.read(position, len(table))
                    time, seq = clock["time"], clock["seq"] if seq is None else seq
                    position += len(table)
                if seq is not None:
                    yield table, seq, time, set_back
            if times is not None:
                self.report.repeated = 0 if rows is None else len(rows) - len(times.clock)
                self.report.jitter = times.jitter
                self.report.jumps = 0 if times.jitter else self.report.jumps

    def _timed(self, report: TimeReport) -> Iterator[_TimedRows]:
        """Yield rows with their counter and their continuous time; irregularities of the time are added to `report`."""
        period = 1.0 / self.meta.imu.sample_rate_hz
        clock, counter = ClockUnwrapper(period, self.time_unit, report), _CounterTime(period)
        for table in self.tables():
            self._check_stages(table)
            self._check_counts(table)
            seq = table.integers("seq") if "seq" in table else None
            if "time_s" not in table:
                report.counted = True
                numbers = table.rows if seq is None else seq
                yield _TimedRows(table, numbers, counter.feed(numbers), [])
                continue
            try:
                time, set_back = clock.feed(table.floats("time_s"), seq)
            except SequenceError as exc:
                raise self._sequence_error(exc, table) from exc
            yield _TimedRows(table, seq, time, set_back)

    def _sample_times(self, files: ExitStack) -> tuple[SampleTimes, TemporaryRows | None]:
        """Return counter and clock of the rows that are not repeated; also the rows `TIMES` if any row is repeated.

        In a file without a counter, a row with the time and the values of the previous row is repeated, unless the time
        stamps are so coarse that rows with different values share them, or the sample rate agrees better with the
        configuration if these rows count. `files` closes the temporary files.
        """
        nominal = 1.0 / self.meta.imu.sample_rate_hz
        rows = files.enter_context(TemporaryRows(TIMES))
        last, coarse = np.full((1, 1 + len(CHANNELS)), np.nan), False
        for table, seq, time, _ in self._timed(TimeReport()):
            values = np.vstack([last, np.column_stack([time, np.nan_to_num(table.counts())])])
            last = values[-1:]
            same = values[1:] == values[:-1]
            part = np.empty(len(time), TIMES)
            part["time"], part["row"], part["repeated"] = time, table.rows, same.all(axis=1) & (seq is None)
            rows.append(part)
            coarse |= bool((same[:, 0] & ~same.all(axis=1)).any())
        kept = files.enter_context(_without_repeated(rows))
        if coarse or abs(sample_period(rows, nominal) - nominal) < abs(sample_period(kept, nominal) - nominal):
            kept = rows
        self._check_rate(sample_period(kept, nominal))
        times = sample_times(kept, nominal)
        files.enter_context(times.clock)
        return times, None if len(kept) == len(rows) else rows

    def _angle_spans(self) -> FloatArray:
        """Return the ranges of the encoder angles of the file, rad, shape (2,)."""
        low, high = np.full(2, np.inf), np.full(2, -np.inf)
        for table in self.tables():
            angles = table.angles()
            low, high = np.fmin(low, np.fmin.reduce(angles)), np.fmax(high, np.fmax.reduce(angles))
        return np.asarray(high - low)

    def _check_rate(self, period: float) -> None:
        rate = self.meta.imu.sample_rate_hz
        if abs(period * rate - 1.0) > 0.05:
            raise InputError("csv.wrong_rate", file=self.path, found=1.0 / period if period else np.inf, rate=rate)

    def _check_stages(self, table: SampleTable) -> None:
        """Raise InputError if the name of a stage is too long for a raw log."""
        for stage in dict.fromkeys(table.stages):
            if len(stage.encode()) > _MAX_STAGE:
                line, quoted = int(table.lines[table.stages.index(stage)]), stage[:_MAX_QUOTED] + "…"
                raise InputError("csv.stage_too_long", file=self.path, line=line, column="stage", cell=quoted)

    def _check_counts(self, table: SampleTable) -> None:
        """Raise InputError if an output is more than an IMU can measure."""
        imu = self.meta.imu
        per_second = imu.sample_rate_hz if imu.output == "increment" else 1.0
        counts = table.counts()
        sensors = ((0, imu.gyro_lsb, _MAX_RATE, "rad/s"), (3, imu.accel_lsb, _MAX_FORCE, "m/s²"))
        for first, lsb, limit, unit in sensors:
            values = counts[:, first : first + 3] * (lsb * per_second)
            is_large = (np.abs(values) > limit) & table.valid[:, None]
            if is_large.any():
                row, column = divmod(int(np.argmax(is_large)), 3)
                where = {"file": self.path, "line": int(table.lines[row]), "column": CHANNELS[first + column]}
                cell = f"{counts[row, first + column]:.15g}"
                value = float(values[row, column])
                raise InputError("csv.cell_implausible", **where, cell=cell, value=value, unit=unit)

    def _check_no_means(self, counts: FloatArray) -> None:
        """Raise InputError if the direction of the force changes in most rows: the rows are then means of positions."""
        force = counts[np.isfinite(counts[:, 3:]).all(axis=1), 3:]
        length = np.linalg.norm(force, axis=1)
        if len(force) < 4 or np.std(length) > _MEANS_SCATTER * np.mean(length):
            return
        with np.errstate(over="ignore", invalid="ignore"):  # a zero vector has no direction
            turn = np.arccos(np.clip(np.sum(force[1:] * force[:-1], axis=1) / (length[1:] * length[:-1]), -1.0, 1.0))
        if float(np.median(turn)) > _MEANS_ANGLE:
            raise InputError("csv.means", file=self.path)

    def _sequence_error(self, error: SequenceError, table: SampleTable) -> InputError:
        return InputError("csv.sequence", file=self.path, line=int(table.lines[error.row]), what=error.as_text)


def _without_repeated(rows: TemporaryRows) -> TemporaryRows:
    """Return the rows `TIMES` that are not repeated, renumbered without the repeated ones."""
    kept, repeated = TemporaryRows(TIMES), 0
    for part in rows.parts():
        before = repeated + np.cumsum(part["repeated"])
        repeated = int(before[-1])
        part = part.copy()
        part["row"] -= before
        kept.append(part[~part["repeated"]])
    return kept


class _CounterTime:
    """Clock of samples without time stamps, which advances by the sample period with the counter."""

    def __init__(self, period: float) -> None:
        self._period, self._last, self._count = period, -1, 0

    def feed(self, seq: IntArray) -> FloatArray:
        """Return the times of the next samples, s, shape (n,), from their counter, which may wrap, shape (n,)."""
        if not len(seq):
            return np.empty(0)
        previous = np.concatenate([[self._last], seq[:-1]])
        steps = seq - previous
        for k in np.flatnonzero(steps <= 0).tolist():
            last = int(previous[k])
            modulus = next((m for m in SEQUENCE_MODULI if 3 * m // 4 <= last < m), None)
            steps[k] = 1 if modulus is None else steps[k] + modulus
        counts = self._count + np.cumsum(steps)
        self._last, self._count = int(seq[-1]), int(counts[-1])
        return np.asarray(counts * self._period)


class _Damage:
    """Collects damaged rows with the counters of the intact rows before and after them."""

    def __init__(self, damaged: list[DamagedRows]) -> None:
        self._damaged = damaged
        self._open: list[int] = []
        self._last: int | None = None

    def add(self, table: SampleTable, seq: IntArray) -> None:
        """Add the next rows with their unwrapped counter, shape (n,)."""
        before = np.searchsorted(table.rows, table.damaged)
        for number, k in zip(table.damaged.tolist(), before.tolist(), strict=True):
            if self._open and (k > 0 and table.rows[k - 1] > self._open[-1]):
                self._close(int(seq[np.searchsorted(table.rows, self._open[-1])]))
            if not self._open and k > 0:
                self._last = int(seq[k - 1])
            self._open.append(number)
        if not len(table):
            return
        if self._open and table.rows[-1] > self._open[-1]:
            self._close(int(seq[np.searchsorted(table.rows, self._open[-1])]))
        self._last = int(seq[-1])

    def finish(self) -> None:
        """Add the damaged rows after the last intact one."""
        if self._open:
            self._close(None)

    def _close(self, before: int | None) -> None:
        self._damaged.append(DamagedRows(self._open[0], len(self._open), self._last, before))
        self._open = []
