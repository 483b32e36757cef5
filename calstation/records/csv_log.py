"""Reader of the CSV format of docs/contract.md: chunks of checked cells as blocks."""

import csv
import gzip
import io
import itertools
import math
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from calstation.errors import InputError
from calstation.estimation.common import (
    AngleUnwrapper,
    SampleBlock,
    SequenceError,
    SequenceUnwrapper,
    snap_angles,
)
from calstation.messages import os_reason
from calstation.physics import AXES, CHANNELS, BoolArray, FloatArray, IntArray
from calstation.records.arrival import SampleTimes, are_arrivals, sample_period, sample_times
from calstation.records.columns import (
    ANGLES,
    JOINTS,
    STATION,
    ColumnMap,
    Layout,
    RecordingMeta,
    further_channels,
    is_increment,
    min_step,
    read_layout,
    unit_factor,
    unit_factors,
)
from calstation.records.log import Log
from calstation.records.meta import FURTHER_IMUS, LogMeta
from calstation.schema import read_toml, validate

#: Suffixes of text recordings; .gz may follow.
_TEXT_SUFFIXES = (".csv", ".txt", ".tsv", ".dat")
#: Suffixes of CSV logs and text recordings.
CSV_SUFFIXES = tuple(suffix + compressed for suffix in _TEXT_SUFFIXES for compressed in ("", ".gz"))
#: Number of samples that are checked for non-integer output.
_DECIMALS_CHECKED = 200
#: Relative error of a count size of six digits, due to which counts are not quite whole numbers.
_LSB_ERROR = 1e-6
_CHUNK_BYTES = 1 << 17
#: Size limit of a line, bytes; a longer one may also be read if it lies within a chunk.
_MAX_LINE = 1 << 16
#: Size limit of a stage's name, bytes, which the raw log also has.
_MAX_STAGE = 64
#: Largest number of characters of a cell that a message quotes.
_MAX_QUOTED = 40
#: Largest magnitude of a number in a cell, and of a whole number, which a float64 represents exactly.
_MAX_NUMBER, _MAX_INTEGER = 1e20, 2**53
#: Largest magnitudes that an IMU can measure, rad/s and m/s².
_MAX_RATE, _MAX_FORCE = 1e3, 1e5


def meta_path(path: Path) -> Path:
    """Return NAME.toml next to NAME.csv or NAME.csv.gz."""
    name = Path(path.name.removesuffix(".gz"))
    return path.with_name((name.stem if name.suffix in _TEXT_SUFFIXES else name.name) + ".toml")


def open_csv(path: Path, meta_file: Path | None = None) -> Log:
    """Open a CSV with its TOML file next to it or at `meta_file`. Raises InputError if one is missing or invalid."""
    if not path.is_file():
        raise InputError("log.not_found" if path.name.endswith((".csv", ".csv.gz")) else "log.not_a_log", file=path)
    meta, layout = load_recording(path, meta_file or meta_path(path))
    meta = _with_quantisation(path, meta, layout)
    jitter: list[float] = []
    return Log(path, meta, lambda: csv_blocks(path, meta, layout, jitter), _jitter=jitter)


def _with_quantisation(path: Path, meta: LogMeta, layout: Layout) -> LogMeta:
    """Return the configuration of a CSV with quantisation 0, if not given, for sensors with non-integer output."""
    counts: list[FloatArray] = []
    with suppress(InputError):  # reported when the samples are read
        for block in csv_blocks(path, meta, layout, []):
            counts.append(block.counts[block.valid])
            if sum(map(len, counts)) >= _DECIMALS_CHECKED:
                break
    values = np.concatenate([np.empty((0, 6)), *counts])
    is_decimal = (np.abs(values - np.rint(values)) > _LSB_ERROR * np.abs(values)).any(axis=0)
    sensors = {"gyro_quantisation": is_decimal[:3].any(), "accel_quantisation": is_decimal[3:].any()}
    added = {name: 0.0 for name, has_decimals in sensors.items() if has_decimals and getattr(meta.imu, name) is None}
    return meta.model_copy(update={"imu": meta.imu.model_copy(update=added)}) if added else meta


def load_recording(path: Path, meta_file: Path) -> tuple[LogMeta, Layout]:
    """Read the TOML of a CSV and find the layout of the CSV. Raises InputError with file, field and remedy."""
    data = read_toml(meta_file, InputError)
    columns = validate(ColumnMap, {"columns": data.get("columns", {})}, meta_file, InputError).columns
    secondaries = list(itertools.takewhile(lambda n: f"imu{n}" in data, FURTHER_IMUS))
    layout = read_layout(path, _head(path), columns, secondaries)
    for n in ("", *FURTHER_IMUS):
        if isinstance(section := data.get(f"imu{n}"), dict):
            _complete_counts(section, path, layout, str(n))
    return validate(RecordingMeta, data, meta_file, InputError).log_meta, layout


def _complete_counts(section: dict[str, Any], path: Path, layout: Layout, number: str) -> None:
    """Set a missing count size of columns with a physical unit to their smallest step."""
    if not layout.has_gyros:
        section |= {name: section.get(name, 1.0) for name in ("gyro_lsb", "gyro_arw")}
    for sensor in ("gyro", "accel"):
        names = [f"{sensor}{number}_{axis}" for axis in AXES]
        unit = layout.units.get(names[0])
        if unit is None or f"{sensor}_lsb" in section:
            continue
        output = "increment" if is_increment(unit) else "rate"
        if section.setdefault("output", output) == output:
            head = next(_tables(path, layout, {}, 0))
            step = min_step(head.floats(name, True) for name in names) or 1.0
            section[f"{sensor}_lsb"] = float(f"{step * unit_factor(names[0], unit):.6g}")


def csv_blocks(path: Path, meta: LogMeta, layout: Layout, jitter: list[float]) -> Iterator[SampleBlock]:
    """Yield the samples of a CSV in order, with unwrapped counters, split at stage changes.

    If the times are arrival times, their rms deviation from the line that replaces them, s, is appended to `jitter`.
    Raises InputError with file, line, column and remedy.
    """
    jitter.clear()
    rate, factors, secondaries = meta.imu.sample_rate_hz, unit_factors(layout, meta), len(meta.secondaries)
    unwrapper = SequenceUnwrapper(1.0 / rate)
    angles = AngleUnwrapper(lambda: _angle_spans(_tables(path, layout, factors, secondaries)))
    starts: set[tuple[float, ...]] = set()
    times: SampleTimes | None = None
    rows = 0
    for table in _tables(path, layout, factors, secondaries):
        time = table.floats("time_s")
        part = slice(rows, rows + len(time))
        if not rows and (not table.has_counter or are_arrivals(table.integers("seq"), time, 1.0 / rate)):
            all_times = np.concatenate([t.floats("time_s") for t in _tables(path, layout, factors, secondaries)])
            _check_rate(path, sample_period(all_times, 1.0 / rate), rate)
            times = sample_times(all_times, 1.0 / rate)
            jitter += [times.jitter] if times.jitter else []
        if times is not None:
            time = times.time[part]
        seq = table.integers("seq") if table.has_counter or times is None else times.seq[part]
        counts = table.counts(meta)
        try:
            unwrapped, clock, restarts = unwrapper.feed(seq, time)
        except SequenceError as exc:
            line = table.first + exc.row
            raise InputError("csv.sequence", file=path, line=line, what=exc.as_text) from exc
        for k in ([] if rows else [0]) + restarts:
            row = (int(seq[k]), float(time[k]), *np.nan_to_num(counts[k]))
            if row in starts:
                raise InputError("csv.repeated", file=path, line=table.first + k)
            starts.add(row)
        if not rows and len(seq) > 1:
            _check_rate(path, float(np.median(np.diff(clock) / np.diff(unwrapped))), rate)
        rows += len(seq)
        yield from table.blocks(unwrapped, clock, counts, angles)
    if not rows:
        raise InputError("csv.no_samples", file=path)


def _angle_spans(tables: "Iterable[_Table]") -> FloatArray:
    """Return the ranges of the encoder angles of a file, rad, shape (2,)."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for table in tables:
        angles = table.angles()
        low, high = np.fmin(low, np.fmin.reduce(angles)), np.fmax(high, np.fmax.reduce(angles))
    return np.asarray(high - low)


def _check_rate(path: Path, period: float, rate: float) -> None:
    if abs(period * rate - 1.0) > 0.05:
        raise InputError("csv.wrong_rate", file=path, found=1.0 / period if period else np.inf, rate=rate)


def csv_rows(path: Path) -> int:
    """Estimate the number of samples in a CSV from its size and its first lines; the result is at least 1."""
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as stream:
            head = stream.read(_CHUNK_BYTES)
        size = path.stat().st_size
        if path.suffix == ".gz":
            with path.open("rb") as stream:  # RFC 1952, 2.3.1: the last four bytes are the size modulo 2^32
                stream.seek(-4, io.SEEK_END)
                size = int.from_bytes(stream.read(4), "little")
    except (OSError, EOFError, zlib.error):
        return 1  # the error is reported when the file is read
    lines = head.count(b"\n")
    return max(1, round(size * lines / max(len(head), 1)) - 1)


def _text_chunks(path: Path) -> Iterator[str]:
    """Yield the text of the file in chunks of whole lines, without the final line break."""
    remainder, lines, line_break = b"", 0, b""
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as stream:
            while data := stream.read(_CHUNK_BYTES):
                line_break = line_break or (b"\r" if b"\r" in data and b"\n" not in data else b"\n")
                data = remainder + (data if line_break == b"\n" else data.replace(line_break, b"\n"))
                end = data.rfind(b"\n") + 1
                remainder = data[end:]
                lines += data.count(b"\n")
                if end:
                    yield data[:end].decode("utf-8").replace("\r\n", "\n").removesuffix("\n")
                if len(remainder) > _MAX_LINE:
                    raise InputError("csv.line_too_long", file=path, line=lines + 1, limit=_MAX_LINE)
        if remainder.strip():
            yield remainder.decode("utf-8")
    except FileNotFoundError as exc:
        raise InputError("log.not_found", file=path) from exc
    except (EOFError, zlib.error, gzip.BadGzipFile) as exc:
        raise InputError("csv.damaged_gzip", file=path) from exc
    except UnicodeDecodeError as exc:
        raise InputError("csv.not_utf8", file=path) from exc
    except OSError as exc:
        raise InputError("log.unreadable", file=path, reason=os_reason(exc)) from exc


def _head(path: Path) -> str:
    """Return the first lines of the file. Raises InputError if it is empty."""
    head = next(_text_chunks(path), "")
    if not head.strip():
        raise InputError("csv.empty", file=path)
    return head


def _tables(path: Path, layout: Layout, factors: Mapping[str, float], secondaries: int) -> "Iterator[_Table]":
    """Yield the rows of samples in chunks. Raises InputError."""
    line, skipped = 1, layout.skipped
    for chunk in _text_chunks(path):
        lines = chunk.split("\n", skipped)
        line += min(skipped, len(lines))
        text = lines[skipped] if len(lines) > skipped else ""
        skipped -= min(skipped, len(lines))
        if text:
            table = _Table(path, layout, factors, layout.plain(text), line, secondaries)
            line += len(table)
            yield table


def _cells(path: Path, lines: Iterable[str], first: int) -> Iterator[list[str]]:
    """Yield rows of cells without quotes; `first` is the number of the first line. Raises InputError."""
    try:
        yield from csv.reader(lines)
    except csv.Error as exc:
        raise InputError("csv.malformed", file=path, line=first, detail=str(exc)) from exc


class _Table:
    """The cells of a chunk by column; `first` is the number of its first line in the file."""

    def __init__(
        self, path: Path, layout: Layout, factors: Mapping[str, float], text: str, first: int, secondaries: int
    ) -> None:
        self._path = path
        self._layout, self._factors = layout, factors
        self._header = header = layout.names
        self._secondaries = secondaries
        self.first = first
        width = len(header)
        if '"' in text:
            cells = [c for row in _cells(path, io.StringIO(text), first) for c in (*row, "\n")]
        else:
            cells = text.replace("\n", ",\n,").split(",")
            cells.append("\n")
        rows = len(cells) // (width + 1)
        if len(cells) != rows * (width + 1) or cells[width :: width + 1].count("\n") != rows:
            self._raise_wrong_width(text)
        self._columns = {name: cells[i :: width + 1] for i, name in enumerate(header)}

    def __len__(self) -> int:
        return len(self._columns[self._header[0]])

    @property
    def has_counter(self) -> bool:
        """Whether there is a sample counter."""
        return "seq" in self._header

    def _raise_wrong_width(self, text: str) -> None:
        for k, line in enumerate(text.split("\n"), self.first):
            width = len(next(_cells(self._path, [line], k), []))
            if width != len(self._header):
                expected = len(self._header)
                raise InputError("csv.wrong_width", file=self._path, line=k, found=width, expected=expected)
        raise InputError("csv.wrong_widths", file=self._path, line=self.first)

    def _wrong_cell(self, code: str, column: str, row: int) -> InputError:
        cell = self._columns[column][row]
        cell = cell if len(cell) <= _MAX_QUOTED else cell[:_MAX_QUOTED] + "…"
        return InputError(code, file=self._path, line=self.first + row, column=column, cell=cell)

    @cached_property
    def valid(self) -> BoolArray:
        """Mask of the rows that are not marked as invalid, shape (n,)."""
        if "valid" in self._header:
            return np.asarray(self.integers("valid") != 0)
        return np.ones(len(self), np.bool_)

    def counts(self, meta: LogMeta) -> FloatArray:
        """Return the raw output, counts, shape (n, 6); NaN for gyros that are not in the file. Raises InputError."""
        invalid = ~self.valid
        absent = np.full(len(self), np.nan)
        columns = [self.floats(n, invalid=invalid) + 0.0 if n in self._header else absent for n in CHANNELS]
        counts = np.column_stack(columns)
        imu = meta.imu
        per_second = imu.sample_rate_hz if imu.output == "increment" else 1.0
        sensors = ((CHANNELS[:3], imu.gyro_lsb, _MAX_RATE, "rad/s"), (CHANNELS[3:], imu.accel_lsb, _MAX_FORCE, "m/s²"))
        for number, (names, lsb, limit, unit) in enumerate(sensors):
            values = counts[:, 3 * number : 3 * number + 3] * (lsb * per_second)
            is_large = (np.abs(values) > limit) & self.valid[:, None]
            if is_large.any():
                row, column = divmod(int(np.argmax(is_large)), 3)
                error = self._wrong_cell("csv.cell_implausible", names[column], row)
                raise InputError(error.code, **error.values, value=float(values[row, column]), unit=unit)
        return counts

    def floats(self, name: str, may_be_empty: bool = False, *, invalid: BoolArray | None = None) -> FloatArray:
        """Return a column as float64, shape (n,); empty cells become NaN if `may_be_empty` or in `invalid` rows."""
        cells = self._columns[name]
        lenient = may_be_empty or (invalid is not None and bool(invalid.any()))
        try:
            filled = [cell or "nan" for cell in cells] if lenient else cells
            values = np.fromiter(map(float, filled), np.float64, len(cells))
        except ValueError:
            values = np.array([self._float(name, i, c, lenient) for i, c in enumerate(cells)])
        is_wrong = np.isinf(values) if may_be_empty else ~np.isfinite(values)
        if invalid is not None:
            is_wrong &= ~invalid
        if is_wrong.any():
            row = int(np.argmax(is_wrong))
            if not cells[row].strip():
                raise self._wrong_cell("csv.cell_empty", name, row)
            raise self._wrong_cell("csv.cell_nan" if np.isnan(values[row]) else "csv.cell_infinite", name, row)
        self._check_size(name, values if invalid is None else np.where(invalid, 0.0, values), _MAX_NUMBER)
        return values * self._factors[name] if name in self._factors else values

    def _check_size(self, name: str, values: FloatArray | IntArray, limit: float) -> None:
        """Raise InputError if the magnitude of a value of a column exceeds the limit."""
        is_large = (values > limit) | (values < -limit)
        if is_large.any():
            raise self._wrong_cell("csv.cell_too_large", name, int(np.argmax(is_large)))

    def _float(self, name: str, row: int, cell: str, may_be_empty: bool) -> float:
        if not cell.strip():
            if may_be_empty:
                return math.nan
            raise self._wrong_cell("csv.cell_empty", name, row)
        try:
            return float(cell)
        except ValueError:
            raise self._wrong_cell("csv.cell_not_number", name, row) from None

    def angles(self) -> FloatArray:
        """Return the recorded encoder angles, rad, shape (n, 2)."""
        return np.deg2rad(np.column_stack([self.floats(a, True) for a in ANGLES]))

    def integers(self, name: str) -> IntArray:
        """Return a column as int64, shape (n,)."""
        try:
            integers = np.fromiter(map(int, self._columns[name]), np.int64, len(self._columns[name]))
        except (ValueError, OverflowError):
            values = self.floats(name)
            is_wrong = values != np.rint(values)
            if is_wrong.any():
                raise self._wrong_cell("csv.cell_not_whole", name, int(np.argmax(is_wrong))) from None
            self._check_size(name, values, _MAX_INTEGER)
            return values.astype(np.int64)
        self._check_size(name, integers, _MAX_INTEGER)
        return integers

    def blocks(
        self, seq: IntArray, time: FloatArray, counts: FloatArray, unwrapper: AngleUnwrapper
    ) -> Iterator[SampleBlock]:
        """Yield the samples of the chunk, one block per interval of a stage."""
        n = len(seq)
        angles = np.full((n, 2), np.nan)
        if ANGLES[0] in self._header:
            angles = snap_angles(unwrapper.feed(time, self.angles()))
        step = self.integers("step") if "step" in self._header else np.zeros(n, np.int64)
        temperature = self.floats("temp_c", True) if "temp_c" in self._header else np.full(n, np.nan)
        secondaries, joints = self._secondary_counts(n), self._joints(n)
        station = self.floats(STATION, True)[:, None] if STATION in self._header else np.empty((n, 0))
        stages = self._columns.get("stage", [self._layout.stage] * n)
        for row, stage in enumerate(stages):
            if len(stage) > _MAX_STAGE or (not stage.isascii() and len(stage.encode()) > _MAX_STAGE):
                raise self._wrong_cell("csv.stage_too_long", "stage", row)
        if stages.count(stages[0]) == n:
            edges = np.array([0, n])
        else:
            names = np.array(stages)
            edges = np.concatenate(([0], np.flatnonzero(names[1:] != names[:-1]) + 1, [n]))
        for a, b in itertools.pairwise(edges.tolist()):
            part = slice(a, b)
            yield SampleBlock(
                stages[a].strip(),
                seq[part],
                time[part],
                counts[part],
                angles[part],
                step[part],
                self.valid[part],
                temperature[part],
                secondaries[part],
                joints[part],
                station[part],
            )

    def _secondary_counts(self, count: int) -> FloatArray:
        """Return the columns of the secondary IMUs, shape (n, k, 6)."""
        if not self._secondaries:
            return np.empty((count, 0, 6))
        names = [name for number in FURTHER_IMUS[: self._secondaries] for name in further_channels(number)]
        columns = np.column_stack([self.floats(name, True) for name in names]) + 0.0
        return np.asarray(columns.reshape(count, self._secondaries, 6))

    def _joints(self, count: int) -> FloatArray:
        """Return the joint angles of a gimbal, rad, shape (n, 3), or (n, 0) without a gimbal."""
        if JOINTS[0] not in self._header:
            return np.empty((count, 0))
        return snap_angles(np.deg2rad(np.column_stack([self.floats(name, True) for name in JOINTS])))
