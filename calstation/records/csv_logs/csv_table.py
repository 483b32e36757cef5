"""Conversion of the cells of a CSV to tables of samples; damaged rows are left out and counted."""

import csv
import io
import math
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from calstation.errors import InputError
from calstation.physics import CHANNELS, BoolArray, FloatArray, IntArray
from calstation.records.columns import COMMENT, STATION, Layout, is_column
from calstation.records.csv_logs.csv_text import text_chunks
from calstation.records.samples import INTEGERS, SampleTable, damages, is_excessive

_TIMES = ("time_s", STATION)
#: Fraction of damaged rows, and their number, above which the file is refused.
_MAX_DAMAGED, _MIN_DAMAGED = 0.1, 2
#: Largest number of characters of a cell that a message quotes.
_MAX_QUOTED = 40


def csv_tables(path: Path, layout: Layout, factors: Mapping[str, float]) -> Iterator[SampleTable]:
    """Yield the rows of samples in chunks; `factors` convert columns to the units of the CSV format.

    A row with a different number of cells than the header, or without a number where one is required, is damaged. Blank
    lines, comments and repetitions of the header are skipped.

    Raises InputError if the file cannot be read, if more than a tenth of its rows are damaged, or if a number is
    excessive.
    """
    line, skipped, rows, damaged = 1, layout.skipped, 0, 0
    for chunk in text_chunks(path):
        lines = chunk.split("\n", skipped)
        line += min(skipped, len(lines))
        text = lines[skipped] if len(lines) > skipped else ""
        skipped -= min(skipped, len(lines))
        if not text:
            continue
        table, error = _Chunk(path, layout, factors, line, rows).read(layout.plain(text))
        line += text.count("\n") + 1
        rows += len(table) + len(table.damaged)
        damaged += len(table.damaged)
        if error is not None and damaged > max(_MIN_DAMAGED, _MAX_DAMAGED * rows):
            raise error
        yield table
    if damaged and damaged == rows:
        raise InputError("csv.no_samples", file=path)


class _Chunk:
    """Reader of the rows of a chunk, whose first line and row have the numbers `first_line` and `first_row`."""

    def __init__(
        self, path: Path, layout: Layout, factors: Mapping[str, float], first_line: int, first_row: int
    ) -> None:
        self._path, self._layout, self._factors = path, layout, factors
        self._first_line, self._first_row = first_line, first_row
        self._header = ",".join(layout.header)
        self._error: InputError | None = None

    def read(self, text: str) -> tuple[SampleTable, InputError | None]:
        """Return the intact rows, and the error of a damaged row; None if there is none."""
        names = self._layout.names
        width = len(names)
        if '"' in text:
            cells = [c for row in _rows(io.StringIO(text)) for c in (*row, "\n")]
        else:
            cells = text.replace("\n", ",\n,").split(",")
            cells.append("\n")
        count = len(cells) // (width + 1)
        is_regular = len(cells) == count * (width + 1) and not (self._layout.header and self._header in text)
        if is_regular and cells[width :: width + 1].count("\n") == count:
            columns = {name: cells[i :: width + 1] for i, name in enumerate(names)}
            lines = np.arange(self._first_line, self._first_line + count)
            rows, wrong_width = np.arange(count), np.zeros(0, np.int64)
        else:
            columns, lines, rows, wrong_width = self._by_line(text)
        values, is_damaged = self._numbers(columns, lines)
        stages = [s.strip() for s in columns["stage"]] if "stage" in columns else [self._layout.stage] * len(lines)
        damaged = self._first_row + np.union1d(wrong_width, rows[is_damaged])
        table = SampleTable(values, stages, lines, self._first_row + rows, damaged)
        return table.select(~is_damaged), self._error

    def _by_line(self, text: str) -> tuple[dict[str, list[str]], IntArray, IntArray, IntArray]:
        """Return cells by column, line and row numbers of rows of the right width, and numbers of the other rows."""
        names = self._layout.names
        rows: list[list[str]] = []
        lines, numbers, wrong_width, number = list[int](), list[int](), list[int](), 0
        for line, content in enumerate(text.split("\n"), self._first_line):
            if not content.strip() or content.lstrip()[0] in COMMENT:
                continue
            cells = next(_rows([content]), [])
            if [cell.strip() for cell in cells] == list(self._layout.header):
                continue
            while len(cells) > len(names) and not cells[-1].strip():
                cells.pop()
            if len(cells) == len(names):
                rows.append(cells)
                lines.append(line)
                numbers.append(number)
            else:
                wrong_width.append(number)
                values = {"file": self._path, "line": line, "found": len(cells), "expected": len(names)}
                self._error = self._error or InputError("csv.wrong_width", **values)
            number += 1
        columns = {name: [row[i] for row in rows] for i, name in enumerate(names)}
        return columns, np.array(lines, np.int64), np.array(numbers, np.int64), np.array(wrong_width, np.int64)

    def _numbers(
        self, columns: Mapping[str, list[str]], lines: IntArray
    ) -> tuple[dict[str, FloatArray | IntArray], BoolArray]:
        """Return the numbers by column, shape (n,), and the mask of damaged rows, shape (n,)."""
        is_damaged = np.zeros(len(lines), np.bool_)
        valid = np.ones(len(lines), np.bool_)
        values: dict[str, FloatArray | IntArray] = {}
        for name in sorted(filter(is_column, columns), key=lambda name: name != "valid"):
            cells, factor = columns[name], self._factors.get(name, 1.0)
            if name in INTEGERS:
                numbers, is_wrong = _integers(cells)
            elif name in _TIMES and (times := _clock_times(cells)) is not None:
                numbers, is_wrong, factor = times, ~np.isfinite(times), 1.0
            else:
                numbers, is_wrong = _floats(name, cells)
            matters = valid | (name not in CHANNELS)
            is_wrong &= matters
            is_large = is_excessive(name, numbers) & matters & ~is_wrong
            if is_large.any():
                row = int(np.argmax(is_large))
                raise self._cell_error("csv.cell_too_large", name, int(lines[row]), cells[row])
            if is_wrong.any() and self._error is None:
                row = int(np.argmax(is_wrong))
                self._error = self._cell_error(_wrong_cell(name, cells[row]), name, int(lines[row]), cells[row])
            is_damaged |= is_wrong
            if name in INTEGERS:
                values[name] = np.where(is_wrong, 0, numbers).astype(np.int64)
            else:
                values[name] = np.asarray(numbers * factor, np.float64)
            valid = values[name] != 0 if name == "valid" else valid
        return values, is_damaged

    def _cell_error(self, code: str, name: str, line: int, cell: str) -> InputError:
        cell = cell.strip()
        cell = cell if len(cell) <= _MAX_QUOTED else cell[:_MAX_QUOTED] + "…"
        return InputError(code, file=self._path, line=line, column=name, cell=cell)


def _rows(lines: Iterable[str]) -> Iterator[list[str]]:
    """Yield rows of cells without quotes; text that is not valid CSV ends the rows."""
    try:
        yield from csv.reader(lines)
    except csv.Error:
        return


def _integers(cells: list[str]) -> tuple[IntArray | FloatArray, BoolArray]:
    """Return a column of whole numbers, shape (n,), and the mask of the other cells."""
    try:
        return np.fromiter(map(int, cells), np.int64, len(cells)), np.zeros(len(cells), np.bool_)
    except (ValueError, OverflowError):
        values = np.array([_float(cell) for cell in cells])
    return values, damages("seq", values)


def _floats(name: str, cells: list[str]) -> tuple[FloatArray, BoolArray]:
    """Return a column, shape (n,), NaN where there is no number, and the mask of wrong cells."""
    try:
        values = np.fromiter(map(float, cells), np.float64, len(cells))
    except ValueError:
        values = np.array([_float(cell) for cell in cells])
        is_text = np.array([bool(cell.strip()) for cell in cells]) & np.isnan(values)
        return values, damages(name, values) | is_text
    return values, damages(name, values)


def _float(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan


def _clock_times(cells: list[str]) -> FloatArray | None:
    """Return times of day (hh:mm:ss) or ISO 8601 times, s, shape (n,); NaN for other cells, None if these prevail."""
    if not any(":" in cell for cell in cells):
        return None
    values = np.array([_clock_time(cell.strip()) for cell in cells])
    is_other = np.isnan(values) & np.array([bool(cell.strip()) for cell in cells])
    return None if 2 * np.count_nonzero(is_other) > len(cells) else values


def _clock_time(cell: str) -> float:
    hours, _, rest = cell.partition(":")
    minutes, _, seconds = rest.partition(":")
    if hours.isdecimal() and minutes.isdecimal():
        return 3600.0 * float(hours) + 60.0 * float(minutes) + _float(seconds)
    try:
        time = datetime.fromisoformat(cell)
    except ValueError:
        return math.nan
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp() if ":" in cell else math.nan


def _wrong_cell(name: str, cell: str) -> str:
    """Return the code of the error of a cell that does not meet the requirement of its column."""
    value = _float(cell)
    if not cell.strip():
        return "csv.cell_empty"
    if math.isinf(value):
        return "csv.cell_infinite"
    if name in INTEGERS and not math.isnan(value):
        return "csv.cell_not_whole"
    if cell.strip().lower().lstrip("+-") == "nan":
        return "csv.cell_nan"
    return "csv.cell_not_time" if name in _TIMES else "csv.cell_not_number"
