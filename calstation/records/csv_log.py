"""The contract's CSV as sample blocks: read in chunks, checked cell by cell, and written back exactly."""

import csv
import gzip
import io
import itertools
import math
import zlib
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import IO

import numpy as np

from calstation.errors import InputError
from calstation.estimation.common.samples import SampleBlock, snap_angles
from calstation.estimation.common.sequence import SequenceError, SequenceUnwrapper
from calstation.physics.arrays import BoolArray, FloatArray, IntArray
from calstation.records.meta import FURTHER_IMUS, LogMeta
from calstation.schema import suggestion

CHANNELS = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
ANGLES = ("outer_deg", "inner_deg")
#: Of these `ANGLES` may be absent, both together: a recording made by hand has no table.
REQUIRED = ("seq", "time_s", *CHANNELS, *ANGLES, "stage", "step")
JOINTS = ("joint_x_deg", "joint_y_deg", "joint_z_deg")
COLUMNS = (*REQUIRED, "temp_c", "valid", *JOINTS)


def further_channels(number: int) -> tuple[str, ...]:
    """Columns of a further IMU on the same body: gyro2_x, ..., accel2_z."""
    return tuple(f"{sensor}{number}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz")


ALL_FURTHER = frozenset(name for number in FURTHER_IMUS for name in further_channels(number))
_CHUNK_BYTES = 1 << 17
_MEND = "correct the cell or remove the row"


def meta_path(path: Path) -> Path:
    """NAME.toml beside NAME.csv or NAME.csv.gz."""
    name = path.name.removesuffix(".gz").removesuffix(".csv")
    return path.with_name(name + ".toml")


def csv_blocks(path: Path, meta: LogMeta) -> Iterator[SampleBlock]:
    """Read a CSV's samples in order, counters unwrapped, cut at stage changes.

    Raises
    ------
    InputError
        naming the file, the line, the column and the mend.
    """
    chunks = _text_chunks(path)
    line = 1
    first = next(chunks, "")
    if not first.strip():
        raise InputError(f"{path}: is empty; give a header row and samples")
    header, rest = _header(path, first, meta)
    unwrapper = SequenceUnwrapper(1.0 / meta.imu.sample_rate_hz)
    starts: set[tuple[float, ...]] = set()
    empty = True
    for text in itertools.chain([rest], chunks):
        if text:
            table = _Table(path, header, text, line + 1, len(meta.secondaries))
            seq, time = table.integers("seq"), table.floats("time_s")
            spoilt = ~table.valid
            counts = np.column_stack([table.floats(name, spoilt=spoilt) for name in CHANNELS]) + 0.0
            try:
                unwrapped, clock, restarts = unwrapper.feed(seq, time)
            except SequenceError as exc:
                raise InputError(f"{path}: line {table.first + exc.place}: {exc}") from exc
            for k in ([0] if empty else []) + restarts:
                row = (int(seq[k]), float(time[k]), *counts[k])
                if row in starts:
                    raise InputError(
                        f"{path}: line {table.first + k}: the log's rows are repeated from here; remove them"
                    )
                starts.add(row)
            if empty:
                _check_rate(path, unwrapped, clock, meta.imu.sample_rate_hz)
            empty = False
            yield from table.blocks(unwrapped, clock, counts)
            line += len(seq)
    if empty:
        raise InputError(f"{path}: no samples after the header; record some")


def estimated_rows(path: Path) -> int:
    """About how many samples a CSV holds, from its size and its first lines; at least 1."""
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as stream:
            head = stream.read(_CHUNK_BYTES)
        size = path.stat().st_size
        if path.suffix == ".gz":
            with path.open("rb") as stream:  # RFC 1952, 2.3.1: the last four bytes are the size, modulo 2^32
                stream.seek(-4, io.SEEK_END)
                size = int.from_bytes(stream.read(4), "little")
    except (OSError, EOFError, zlib.error):
        return 1  # reading it will say what is wrong
    lines = head.count(b"\n")
    return max(1, round(size * lines / max(len(head), 1)) - 1)


def _text_chunks(path: Path) -> Iterator[str]:
    """The file's text in pieces of whole lines, without the last line's end."""
    rest = b""
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as stream:
            while data := stream.read(_CHUNK_BYTES):
                data = rest + data
                cut = data.rfind(b"\n") + 1
                rest = data[cut:]
                if cut:
                    yield data[:cut].decode("utf-8").replace("\r\n", "\n").removesuffix("\n")
        if rest.strip():
            yield rest.decode("utf-8")
    except FileNotFoundError as exc:
        raise InputError(f"{path}: no such file; give the path of an existing log") from exc
    except (EOFError, zlib.error, gzip.BadGzipFile) as exc:
        raise InputError(f"{path}: the compressed file is damaged or cut short; copy it again") from exc
    except UnicodeDecodeError as exc:
        raise InputError(f"{path}: not UTF-8 text; save it as UTF-8") from exc
    except OSError as exc:
        raise InputError(f"{path}: cannot be read ({exc.strerror or exc})") from exc


def _header(path: Path, text: str, meta: LogMeta) -> tuple[list[str], str]:
    first, _, rest = text.removeprefix("\ufeff").partition("\n")
    names = [name.strip() for name in next(_cells(path, [first], 1), [])]
    table = any(name in names for name in ANGLES)
    for name in REQUIRED:
        if name not in names and (table or name not in ANGLES):
            unknown = [n for n in names if n not in COLUMNS]
            near = suggestion(name, unknown).replace("did you mean", "is it")
            raise InputError(f"{path}: column '{name}' is missing{near or '; add it to the header and rows'}")
    further = [name for number in meta.secondaries for name in further_channels(number)]
    for name in further:
        if name not in names:
            number = name.split("_")[0][-1]
            raise InputError(
                f"{path}: column '{name}' is missing; add it, or remove [imu{number}] from the configuration"
            )
    for name in names:
        if name in ALL_FURTHER and name not in further:
            number = name.split("_")[0][-1]
            raise InputError(
                f"{path}: column '{name}' has no [imu{number}] in the configuration; add the table"
            )
    if any(name in names for name in JOINTS) and not all(name in names for name in JOINTS):
        raise InputError(f"{path}: of {', '.join(JOINTS)} one is missing; add it or remove all three")
    for name in (*COLUMNS, *further):
        if names.count(name) > 1:
            raise InputError(f"{path}: column '{name}' is there twice; remove one")
    return names, rest


def _cells(path: Path, lines: Iterable[str], first: int) -> Iterator[list[str]]:
    """Rows of cells, quotes undone; `first` is the number of the first line. Raises InputError."""
    try:
        yield from csv.reader(lines)
    except csv.Error as exc:
        raise InputError(f"{path}: line {first} or behind it is no CSV ({exc}); save it again") from exc


def _check_rate(path: Path, seq: IntArray, time: FloatArray, rate: float) -> None:
    steps = np.diff(time) / np.diff(seq)
    if len(steps) and abs(float(np.median(steps)) * rate - 1.0) > 0.05:
        found = 1.0 / float(np.median(steps))
        raise InputError(
            f"{path}: time_s runs at {found:.6g} Hz but imu.sample_rate_hz = {rate:g}; correct one of them"
        )


class _Table:
    """One chunk's cells by column; `first` is the line number of its first row."""

    def __init__(self, path: Path, header: list[str], text: str, first: int, further: int) -> None:
        self._path = path
        self._header = header
        self._further = further
        self.first = first
        width = len(header)
        if '"' in text:
            cells = [c for row in _cells(path, io.StringIO(text), first) for c in (*row, "\n")]
        else:
            cells = text.replace("\n", ",\n,").split(",")
            cells.append("\n")
        rows = len(cells) // (width + 1)
        if len(cells) != rows * (width + 1) or cells[width :: width + 1].count("\n") != rows:
            self._complain_width(text)
        self._columns = {name: cells[i :: width + 1] for i, name in enumerate(header)}

    def _complain_width(self, text: str) -> None:
        for k, line in enumerate(text.split("\n")):
            found = len(next(_cells(self._path, [line], self.first + k), []))
            if found != len(self._header):
                raise InputError(
                    f"{self._path}: line {self.first + k} has {found} cells, the header {len(self._header)};"
                    " complete the row or remove it"
                )
        raise InputError(f"{self._path}: rows near line {self.first} do not fit the header; save it again")

    def _complain(self, name: str, row: int, what: str) -> InputError:
        return InputError(f"{self._path}: line {self.first + row}: {name} {what}; {_MEND}")

    @cached_property
    def valid(self) -> BoolArray:
        """Which rows are not marked as spoilt, shape (n,)."""
        if "valid" in self._header:
            return np.asarray(self.integers("valid") != 0)
        return np.ones(len(self._columns[self._header[0]]), np.bool_)

    def floats(self, name: str, may_be_empty: bool = False, *, spoilt: BoolArray | None = None) -> FloatArray:
        """A column as float64, shape (n,); empty cells become NaN where allowed: of a `spoilt` row anything is."""
        cells = self._columns[name]
        lenient = may_be_empty or (spoilt is not None and bool(spoilt.any()))
        try:
            filled = [cell or "nan" for cell in cells] if lenient else cells
            values = np.fromiter(map(float, filled), np.float64, len(cells))
        except ValueError:
            values = np.array([self._float(name, i, c, lenient) for i, c in enumerate(cells)])
        wrong = np.isinf(values) if may_be_empty else ~np.isfinite(values)
        if spoilt is not None:
            wrong &= ~spoilt
        if wrong.any():
            row = int(np.argmax(wrong))
            what = "NaN" if np.isnan(values[row]) else "infinite"
            raise self._complain(name, row, f"is {what if cells[row].strip() else 'empty'}")
        return values

    def _float(self, name: str, row: int, cell: str, may_be_empty: bool) -> float:
        if not cell.strip():
            if may_be_empty:
                return math.nan
            raise self._complain(name, row, "is empty")
        try:
            return float(cell)
        except ValueError:
            raise self._complain(name, row, f"= '{cell}' is not a number") from None

    def integers(self, name: str) -> IntArray:
        """A column as int64, shape (n,)."""
        try:
            return np.fromiter(map(int, self._columns[name]), np.int64, len(self._columns[name]))
        except (ValueError, OverflowError):
            values = self.floats(name)
        odd = (values != np.rint(values)) | (np.abs(values) > 2**53)
        if odd.any():
            row = int(np.argmax(odd))
            raise self._complain(name, row, f"= {self._columns[name][row]} is not a whole number")
        return values.astype(np.int64)

    def blocks(self, seq: IntArray, time: FloatArray, counts: FloatArray) -> Iterator[SampleBlock]:
        """The chunk's samples, one block per run of a stage."""
        n = len(seq)
        angles = np.full((n, 2), np.nan)
        if ANGLES[0] in self._header:
            angles = snap_angles(np.deg2rad(np.column_stack([self.floats(a, True) for a in ANGLES])))
        step = self.integers("step")
        heat = self.floats("temp_c", True) if "temp_c" in self._header else np.full(n, np.nan)
        others, joints = self._others(n), self._joints(n)
        stages = self._columns["stage"]
        if stages.count(stages[0]) == n:
            edges = np.array([0, n])
        else:
            names = np.array(stages)
            edges = np.concatenate(([0], np.flatnonzero(names[1:] != names[:-1]) + 1, [n]))
        for a, b in itertools.pairwise(edges.tolist()):
            k = slice(a, b)
            yield SampleBlock(
                stages[a].strip(),
                seq[k],
                time[k],
                counts[k],
                angles[k],
                step[k],
                self.valid[k],
                heat[k],
                others[k],
                joints[k],
            )

    def _others(self, count: int) -> FloatArray:
        """Columns of further IMUs, shape (n, k, 6)."""
        if not self._further:
            return np.empty((count, 0, 6))
        names = [name for number in FURTHER_IMUS[: self._further] for name in further_channels(number)]
        columns = np.column_stack([self.floats(name, True) for name in names]) + 0.0
        return np.asarray(columns.reshape(count, self._further, 6))

    def _joints(self, count: int) -> FloatArray:
        """Columns of a gimbal's joints, rad, shape (n, 3), or (n, 0) where there is none."""
        if JOINTS[0] not in self._header:
            return np.empty((count, 0))
        return snap_angles(np.deg2rad(np.column_stack([self.floats(name, True) for name in JOINTS])))


def write_csv(stream: IO[str], blocks: Iterator[SampleBlock]) -> None:
    """Write blocks as the contract's CSV: integers exact, floats so that they read back the same."""
    first = next(blocks, None)
    further = 0 if first is None else first.others.shape[1]
    names = [*REQUIRED, "temp_c", "valid"]
    names += [name for number in FURTHER_IMUS[:further] for name in further_channels(number)]
    names += JOINTS if first is not None and first.joints.shape[1] else ()
    stream.write(",".join(names) + "\n")
    for block in itertools.chain([] if first is None else [first], blocks):
        degrees = _shortest_degrees(block.angles)
        columns: list[list[str]] = [
            [str(v) for v in block.seq.tolist()],
            [repr(v) for v in block.time.tolist()],
            *[_numbers(block.counts[:, i]) for i in range(6)],
            *[_blank_nan(degrees[:, i]) for i in range(2)],
            [block.stage] * len(block),
            [str(v) for v in block.step.tolist()],
            _blank_nan(block.temperature),
            ["1" if v else "0" for v in block.valid.tolist()],
        ]
        columns += [_numbers(column) for column in block.others.reshape(len(block), -1).T]
        columns += [_blank_nan(column) for column in _shortest_degrees(block.joints).T]
        stream.write("".join(map("{}\n".format, map(",".join, zip(*columns, strict=True)))))


def _shortest_degrees(angles: FloatArray) -> FloatArray:
    """Degrees of ten decimals where these read back to the same `angles` (rad), as typed decimals then do."""
    exact = np.rad2deg(angles)
    short = np.round(exact, 10)
    return np.where(snap_angles(np.deg2rad(short)) == angles, short, exact)


def _numbers(values: FloatArray) -> list[str]:
    there = ~np.isnan(values)
    if np.array_equal(values[there], np.rint(values[there])) and np.all(np.abs(values[there]) < 2**53):
        whole = np.where(there, values, 0.0).astype(np.int64)
        return [str(v) if t else "" for v, t in zip(whole.tolist(), there.tolist(), strict=True)]
    return _blank_nan(values)


def _blank_nan(values: FloatArray) -> list[str]:
    return ["" if v != v else repr(v) for v in values.tolist()]


def open_csv_for_writing(path: Path) -> IO[str]:
    """Open NAME.csv or NAME.csv.gz for text; raises InputError where the place cannot be written."""
    try:
        if path.suffix == ".gz":
            return gzip.open(path, "wt", encoding="utf-8", newline="")
        return path.open("w", encoding="utf-8", newline="")
    except OSError as exc:
        raise InputError(f"{path}: cannot be written ({exc.strerror or exc}); choose another folder") from exc
