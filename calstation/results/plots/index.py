"""Index of a log for the log page: min-max pyramid, marks, and reading of samples."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calstation.errors import ConfigurationError
from calstation.estimation.common import SampleBlock
from calstation.jobs import ProgressCallback
from calstation.messages import os_reason
from calstation.physics import FloatArray, IntArray
from calstation.records import (
    SUFFIX,
    Log,
    LogFacts,
    LogMeta,
    UnusedSamples,
    estimated_rows,
    open_log,
    raw_rows,
    step_labels,
)
from calstation.results.plots.min_max_pyramid import (
    CHANNELS,
    Columns,
    MinMaxPyramid,
    PyramidWriter,
    Values,
    bins_per_column,
    merge_columns,
)
from calstation.results.result import Result

#: Largest number of stored marks of one kind; further marks are only counted.
MAX_MARKS = 20_000
#: Number of rows read before the requested ones, for the last polled angles.
_LOOK_BACK = 4096
#: File with the first row and the number of rows of each damaged range, shape (n, 2).
_DAMAGED_ROWS = "holes.npy"


@dataclass(frozen=True)
class StageSpan:
    """A section of a log in one stage: its number of samples, and its first and last sequence number."""

    stage: str
    first_seq: int
    last_seq: int
    samples: int

    def within(self, first: int, last: int) -> int:
        """Return the approximate number of samples in the section between two sequence numbers, both included."""
        width = self.last_seq - self.first_seq + 1
        inside = min(last, self.last_seq) - max(first, self.first_seq) + 1
        return max(0, round(self.samples * inside / width))


@dataclass(frozen=True)
class Marks:
    """Marks of one kind: first and last sequence number, shape (n, 2), of at most `MAX_MARKS` of `count` marks."""

    ranges: IntArray
    count: int

    def contains(self, seq: int) -> bool:
        """Return whether a sample is in one of the ranges, which are in order."""
        number = int(self.ranges[:, 0].searchsorted(seq, side="right")) - 1
        return number >= 0 and seq <= int(self.ranges[number, 1])


@dataclass(frozen=True)
class LogIndex:
    """Contents of a log for the log page."""

    path: Path
    meta: LogMeta
    outcome: str | None
    stored: Result | None  #: Result of its run, if stored.
    facts: LogFacts
    folder: Path  #: Folder of the min-max pyramid.
    spans: tuple[StageSpan, ...]  #: Stages in order.
    steps: Marks  #: First sequence number of each move, as both first and last.
    gaps: Marks  #: Samples before and after each gap.
    invalid: Marks  #: First and last sample of each invalid range.
    invalid_samples: int  #: Number of invalid samples.
    paused: Marks  #: First and last sample of each pause.
    paused_samples: int  #: Number of samples in pauses, which are valid but not used.
    scale: FloatArray  #: Units of `CHANNELS` per count, shape (6,).
    channels: tuple[str, ...]  #: The members of `CHANNELS` that have values.
    step_numbers: IntArray  #: Numbers of the steps before and after each mark of `steps`, shape (n + 1,).
    step_labels: Mapping[int, tuple[str | float, ...]]  #: Labels of the moves, by the number of the step.

    @property
    def rate(self) -> float:
        """Samples per second."""
        return self.meta.imu.sample_rate_hz


def log_index(report: ProgressCallback, path: Path, folder: Path) -> LogIndex:
    """Job: read a log once and write its min-max pyramid to a new folder.

    Raises InputError if the log cannot be used, ConfigurationError if the pyramid cannot be written.
    """
    log = open_log(path)
    total, imu = estimated_rows(path), log.meta.imu
    per_count = imu.sample_rate_hz if imu.output == "increment" else 1.0
    scale = np.repeat([np.rad2deg(imu.gyro_lsb) * per_count, imu.accel_lsb * per_count], 3)
    builder = _IndexBuilder(log)
    last_polled, last = np.full(3, np.nan), -1
    try:
        folder.mkdir(parents=True)
        writer = PyramidWriter(folder, keep_samples=path.suffix != SUFFIX)
        done = 0
        for block in log.blocks():
            polled = _hold(_polled(block.angles, block.temperature), block.seq, last_polled, last)
            last_polled, last = polled[-1], int(block.seq[-1])
            values = np.hstack([block.counts * scale, polled]).astype(np.float32)
            writer.add(block.seq, values)
            builder.add(block, values)
            done += len(block)
            report(min(done / total, 0.99))
        writer.close()
        holes = np.array([(part.row, part.count) for part in log.damaged_rows], np.int64).reshape(-1, 2)
        np.save(folder / _DAMAGED_ROWS, holes)
    except OSError as exc:
        raise ConfigurationError("solution.index_not_written", folder=folder, reason=os_reason(exc)) from exc
    return builder.log_index(log, folder, scale)


def samples(
    report: ProgressCallback, path: Path, folder: Path, scale: FloatArray, start: int, stop: int, count: int
) -> Columns:
    """Job: read rows of a log as columns; see `_hold`.

    Parameters
    ----------
    report, path, folder : progress, the log, and the folder of its index
    scale : units of `CHANNELS` per count, shape (6,)
    start, stop : first row, and the row after the last
    count : largest number of columns
    """
    before = max(0, start - _LOOK_BACK)
    if path.suffix == SUFFIX:
        rows = raw_rows(path, before, stop, np.load(folder / _DAMAGED_ROWS))
        seq = rows["seq"]
        polled = _hold(_polled(rows["angles"], rows["temperature"]), seq, np.full(3, np.nan), -1)
        values = np.hstack([rows["counts"] * scale, polled]).astype(np.float32)
    else:
        stored = MinMaxPyramid(folder).samples(before, stop)
        seq, values = stored["seq"], stored["values"]
    report(1.0)
    seq, values = seq[start - before :], values[start - before :]
    return merge_columns(seq, values, values, bins_per_column(len(seq), count), 1)


def _polled(angles: FloatArray, temperature: FloatArray) -> FloatArray:
    """Return the polled values, NaN for most samples: angles, °, and temperature, °C, shape (n, 3)."""
    return np.column_stack([np.rad2deg(angles), temperature])


def _hold(polled: FloatArray, seq: IntArray, before: FloatArray, last_seq: int) -> FloatArray:
    """Repeat each polled value until the next poll, but not across missing samples; return shape (n, 3).

    `before` and `last_seq` are the values and the sequence number of the sample before the first one.
    """
    filled = np.vstack([before, polled])
    after_gap = np.diff(seq, prepend=last_seq) != 1
    for column in range(filled.shape[1]):
        keep = ~np.isnan(filled[:, column]) | np.concatenate([[False], after_gap])
        last = np.maximum.accumulate(np.where(keep, np.arange(len(filled)), 0))
        filled[:, column] = filled[last, column]
    return filled[1:]


class _IndexBuilder:
    def __init__(self, log: Log) -> None:
        self._spans: list[StageSpan] = []
        self._step: int | None = None
        self._last: int | None = None
        self._steps, self._gaps, self._invalid, self._paused = _Marker(), _Marker(), _Marker(), _Marker()
        self._unused = UnusedSamples(log.events, log.meta)
        self._after_gap = True
        self._present = np.zeros(len(CHANNELS), np.bool_)
        self._step_numbers: list[IntArray] = []

    def add(self, block: SampleBlock, values: Values) -> None:
        self._present |= np.isfinite(values).any(axis=0)
        if block.stage:
            self._add_span(block)
        self._after_gap = not block.stage
        seq, step = block.seq, block.step
        if self._step is None:
            self._step_numbers.append(step[:1])
        changes = np.flatnonzero(np.diff(step, prepend=step[0] if self._step is None else self._step))
        self._step_numbers.append(step[changes])
        self._step = int(step[-1])
        self._steps.add(seq[changes], seq[changes])
        before = np.concatenate([seq[:1] - 1 if self._last is None else [self._last], seq[:-1]])
        gaps = np.flatnonzero(seq - before != 1)
        self._last = int(seq[-1])
        self._gaps.add(before[gaps], seq[gaps])
        self._add_unused(self._unused.add(block))

    def _add_unused(self, ranges: IntArray) -> None:
        paused = ranges[:, 3] != 0
        for marker, rows in ((self._paused, ranges[paused]), (self._invalid, ranges[~paused])):
            marker.add(rows[:, 0], rows[:, 1])

    def _add_span(self, block: SampleBlock) -> None:
        first, last, count = int(block.seq[0]), int(block.seq[-1]), len(block)
        if self._spans and self._spans[-1].stage == block.stage and not self._after_gap:
            before = self._spans.pop()
            first, count = before.first_seq, before.samples + count
        self._spans.append(StageSpan(block.stage, first, last, count))

    def log_index(self, log: Log, folder: Path, scale: FloatArray) -> LogIndex:
        self._add_unused(self._unused.close())
        return LogIndex(
            path=log.path,
            meta=log.meta,
            outcome=log.outcome,
            stored=Result.from_json(log.results[-1]) if log.results else None,
            facts=log.facts(),
            folder=folder,
            spans=tuple(self._spans),
            steps=self._steps.marks(),
            gaps=self._gaps.marks(),
            invalid=self._invalid.marks(),
            invalid_samples=self._unused.invalid,
            paused=self._paused.marks(),
            paused_samples=self._unused.paused,
            scale=scale,
            channels=tuple(name for name, present in zip(CHANNELS, self._present, strict=True) if present),
            step_numbers=np.concatenate(self._step_numbers),
            step_labels=step_labels(log.events),
        )


class _Marker:
    """Collects marks of one kind up to `MAX_MARKS`."""

    def __init__(self) -> None:
        self._ranges: list[IntArray] = []
        self._stored = self._count = 0

    def add(self, first: IntArray, last: IntArray) -> None:
        if len(first) == 0:
            return
        ranges = np.column_stack([first, last]).astype(np.int64)
        self._count += len(ranges)
        ranges = ranges[: MAX_MARKS - self._stored]
        if len(ranges):
            self._stored += len(ranges)
            self._ranges.append(ranges)

    def marks(self) -> Marks:
        ranges = np.concatenate([np.empty((0, 2), np.int64), *self._ranges])
        return Marks(ranges, self._count)
