"""Columns of a CSV from another program: names, units, separator and header row, from `[columns]` and the file."""

import csv
import difflib
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, field_validator

from calstation.errors import InputError
from calstation.messages import Text
from calstation.physics import AXES, CHANNELS, STANDARD_GRAVITY, FloatArray
from calstation.records.meta import FURTHER_IMUS, ImuSection, LogMeta
from calstation.schema import EntryError, StrictModel, near_miss, read_toml

ANGLES = ("outer_deg", "inner_deg")
#: Columns that every CSV must have, except those in `_OPTIONAL`.
REQUIRED = ("seq", "time_s", *CHANNELS, *ANGLES, "stage", "step")
JOINTS = ("joint_x_deg", "joint_y_deg", "joint_z_deg")
#: Time at which the station received a sample, s.
STATION = "station_s"
#: Temperature of the air in a thermal chamber, °C.
CHAMBER = "chamber_c"
COLUMNS = (*REQUIRED, "temp_c", "valid", *JOINTS, STATION, CHAMBER)
#: Columns that may be missing if there is no table. In a file of another program, all but the angles may be missing
#: even with a table, and so may `time_s`: then the samples are counted.
_OPTIONAL = (*ANGLES, "seq", "stage", "step")
_GYROS = CHANNELS[:3]

#: Unit name of raw output.
COUNTS = "counts"
_DEGREE = float(np.pi / 180.0)
_RATES = {
    "rad/s": 1.0, "mrad/s": 1e-3, "deg/s": _DEGREE, "°/s": _DEGREE, "dps": _DEGREE, "mdeg/s": 1e-3 * _DEGREE,
    "deg/h": _DEGREE / 3600.0, "°/h": _DEGREE / 3600.0,
}  # fmt: skip
_FORCES = {
    "m/s2": 1.0, "m/s^2": 1.0, "m/s²": 1.0, "g": STANDARD_GRAVITY, "mg": 1e-3 * STANDARD_GRAVITY,
    "ug": 1e-6 * STANDARD_GRAVITY, "µg": 1e-6 * STANDARD_GRAVITY,
}  # fmt: skip
#: Units of increments over one sample, which are rates multiplied by the sample period.
_ANGLE_INCREMENTS = {"rad": 1.0, "deg": _DEGREE, "°": _DEGREE, "arcsec": _DEGREE / 3600.0}
_VELOCITY_INCREMENTS = {"m/s": 1.0}
_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
#: Other spellings of units in header rows, in lower case.
_SPELLINGS = {
    "deg/sec": "deg/s", "degrees/s": "deg/s", "º/s": "deg/s", "rad/sec": "rad/s", "rad s-1": "rad/s",
    "m/s/s": "m/s2", "m/s**2": "m/s2", "ms-2": "m/s2", "m s-2": "m/s2", "gn": "g", "g": "g", "μg": "ug",
    "sec": "s", "seconds": "s", "msec": "ms", "usec": "us", "μs": "us", "nsec": "ns", "degc": "degC", "c": "degC",
    "lsb": COUNTS, "raw": COUNTS, "digit": COUNTS, "digits": COUNTS, "count": COUNTS,
}  # fmt: skip
_ANGLES = {"deg": 1.0, "°": 1.0, "rad": 1.0 / _DEGREE}
_TEMPERATURES = {"degC": 1.0, "°C": 1.0, "C": 1.0}
#: Separators, which are tried in this order; a blank matches any number of blanks.
_SEPARATORS = (",", ";", "\t", " ")
_PLAIN_SEPARATOR = ","
#: Largest number of columns.
_MAX_COLUMNS = 1000
#: Characters with which a comment line begins.
COMMENT = "#%"
_SENSORS = ("gyro", "accel")


def further_channels(number: int) -> tuple[str, ...]:
    """Return the columns of a secondary IMU on the same body, for example gyro2_x, ..., accel2_z."""
    return tuple(f"{sensor}{number}_{axis}" for sensor in _SENSORS for axis in AXES)


_KNOWN = (*COLUMNS, *(name for number in FURTHER_IMUS for name in further_channels(number)))


def is_column(name: str) -> bool:
    """Return whether a column of the CSV format has this name and contains numbers."""
    return name in _KNOWN and name != "stage"


class ColumnSection(StrictModel):
    """`[columns]`, NAME = { from, unit } or { value }: source of a column in a file of another program."""

    #: Name of the column in the file, or its number from 1; if all are numbers, the file needs no header row.
    source: str | int | None = Field(default=None, alias="from")
    unit: str | None = None  #: None for the header's unit, or else counts, s, degrees or °C.
    value: str | None = None  #: The stage of all samples; permitted only for the column `stage`.


class ColumnMap(StrictModel):
    """`[columns]`: the columns whose names or units in the file differ from the CSV format."""

    columns: dict[str, ColumnSection] = Field(default_factory=dict)

    @field_validator("columns")
    @classmethod
    def _check_columns(cls, columns: dict[str, ColumnSection]) -> dict[str, ColumnSection]:
        for name, column in columns.items():
            if name not in _KNOWN:
                raise EntryError("entry.unknown_name", name, name=name, remedy=near_miss(name, _KNOWN))
            constant = column.value is not None and name == "stage"
            if constant == (column.source is not None) or (column.value is not None and not constant):
                raise EntryError("csv.column_without_source", name, name=name)
            units = [*_units(name), COUNTS] if name.startswith(_SENSORS) else [*_units(name)]
            if column.unit is not None and column.unit not in units:
                names = Text.of("entry.choose_from", names=units) if units else Text("entry.remove_it")
                remedy = near_miss(column.unit, units, names)
                raise EntryError("csv.unit_unknown", name, "unit", unit=column.unit, remedy=remedy)
        return columns


class RecordingMeta(LogMeta):
    """The TOML of a CSV: the configuration of a log, and the columns of the file, which `ColumnMap` validates."""

    columns: dict[str, ColumnSection] = Field(default_factory=dict)

    @property
    def stage(self) -> str:
        """Stage of the whole recording; empty if it is not given."""
        return (self.columns["stage"].value or "") if "stage" in self.columns else ""

    @property
    def log_meta(self) -> LogMeta:
        """The configuration of the log, without the columns of the file."""
        return LogMeta.model_validate({name: getattr(self, name) for name in LogMeta.model_fields})


def read_configuration(file: Path) -> dict[str, Any]:
    """Read the TOML of a recording. Raises InputError, which names an example if there is no such file."""
    if not file.exists():
        raise InputError("log.no_configuration", file=file)
    return read_toml(file, InputError)


def unit_of(name: str, unit: str) -> str | None:
    """Return the standard spelling of a column's unit, "" for counts or an unknown unit; None for an unknown column."""
    unit = _SPELLINGS.get(unit.lower(), unit)
    return (unit if unit in _units(name) else "") if is_column(name) else None


def is_increment(unit: str) -> bool:
    """Return whether the unit of a channel is an increment over one sample."""
    return unit in _ANGLE_INCREMENTS or unit in _VELOCITY_INCREMENTS


def unit_factor(name: str, unit: str) -> float:
    """Return the factor that converts a column from `unit` to the unit of the CSV format, and a channel to SI."""
    return _units(name)[unit]


def unit_factors(layout: "Layout", meta: LogMeta) -> dict[str, float]:
    """Return the factors that convert columns to the units of the CSV format, and channels to counts."""
    imus: dict[int, ImuSection] = {1: meta.imu, **meta.secondaries}
    rate, factors = meta.imu.sample_rate_hz, {}
    for name, unit in layout.units.items():
        factor = unit_factor(name, unit)
        if name.startswith(_SENSORS):
            imu = imus[int(re.sub(r"\D", "", name) or 1)]
            to_rate = rate if is_increment(unit) else 1.0
            to_output = rate if imu.output == "increment" else 1.0
            factor *= to_rate / (to_output * (imu.gyro_lsb if name.startswith("gyro") else imu.accel_lsb))
        factors[name] = factor
    return factors


def min_step(columns: Iterable[FloatArray]) -> float:
    """Return the smallest difference between two values of a column, shape (n,) each; 0 if all are constant.

    The result is at least 2^-53 of the largest magnitude, so that float64 can represent all multiples of it.
    """
    values = [np.unique(column[np.isfinite(column)]) for column in columns]
    steps = [float(np.diff(each).min()) for each in values if len(each) > 1]
    largest = max((float(np.abs(each).max(initial=0.0)) for each in values), default=0.0)
    return max(min(steps), largest * 2.0**-53) if steps else 0.0


def _units(name: str) -> Mapping[str, float]:
    """Return the units of a column with their factors to SI, degrees or °C; empty for a column without a unit."""
    if name.startswith("gyro"):
        return {**_RATES, **_ANGLE_INCREMENTS}
    if name.startswith("accel"):
        return {**_FORCES, **_VELOCITY_INCREMENTS}
    if name in (*ANGLES, *JOINTS):
        return _ANGLES
    return {"time_s": _TIMES, STATION: _TIMES, "temp_c": _TEMPERATURES, CHAMBER: _TEMPERATURES}.get(name, {})


@dataclass(frozen=True)
class Layout:
    """Layout of a CSV: its first row of samples, its separator, and the names and units of its columns."""

    skipped: int = 0  #: Number of lines before the first row of samples.
    separator: str = _PLAIN_SEPARATOR
    header: tuple[str, ...] = ()  #: Cells of the header row; loggers write it again when they restart.
    names: tuple[str, ...] = ()  #: Names of the columns; those of the CSV format replace the names in the file.
    units: Mapping[str, str] = field(default_factory=dict)  #: Units of columns whose unit differs from the format's.
    stage: str = ""  #: Stage of all samples if there is no column `stage`.

    def plain(self, text: str) -> str:
        """Return rows of text with commas as separators and points as decimal marks."""
        if self.separator == _PLAIN_SEPARATOR:
            return text
        text = text.replace(",", ".")
        if self.separator == " ":
            return re.sub(r"[^\S\n]+", ",", re.sub(r"^[^\S\n]+|[^\S\n]+$", "", text, flags=re.MULTILINE))
        return text.replace(self.separator, ",")

    @property
    def sources(self) -> dict[str, str]:
        """Header cell and unit of each column whose name or unit differs from the CSV format, as text."""
        cells = self.header or [f"column {number}" for number in range(1, len(self.names) + 1)]
        sources = {}
        for name, cell in zip(self.names, cells, strict=True):
            if name in _KNOWN and (name != cell or name in self.units):
                sources[name] = f"{cell!r}, {self.units[name]}" if name in self.units else f"{cell!r}"
        return sources

    @property
    def unused(self) -> tuple[str, ...]:
        """Cells of the header row of the columns that are not part of the CSV format."""
        return tuple(cell for name, cell in zip(self.names, self.header, strict=False) if cell and name not in _KNOWN)

    @property
    def has_gyros(self) -> bool:
        """Whether the file has gyro columns."""
        return _GYROS[0] in self.names


def read_layout(path: Path, head: str, columns: Mapping[str, ColumnSection], secondaries: Collection[int]) -> Layout:
    """Determine the layout of a CSV from its first lines; `secondaries` are the numbers of the secondary IMUs.

    Raises InputError if a column is missing; the message suggests the most similar column.
    """
    lines = head.removeprefix("\ufeff").split("\n")
    sources = {name: column.source for name, column in columns.items() if column.source is not None}
    if sources and all(isinstance(source, int) for source in sources.values()):
        skipped, separator, cells = _first_numbers(path, lines, max(int(s) for s in sources.values()))
        header, names = list[str](), [f"column {k}" for k in range(1, len(cells) + 1)]
    else:
        expected = {str(sources.get(name, name)) for name in _KNOWN}
        skipped, separator, header = _header(lines, expected)
        names = list(header)
    if len(names) > _MAX_COLUMNS:
        raise InputError("csv.too_many_columns", file=path, found=len(names), limit=_MAX_COLUMNS)
    next_cells = _cells(lines[skipped], separator) if skipped < len(lines) else []
    is_units_row = any(next_cells) and not any(_is_number(cell, separator) for cell in next_cells)
    headings = [_heading(cell) for cell in header or names]
    if is_units_row:
        below = [cell.strip("[]() ") for cell in next_cells] + [""] * len(names)
        headings = [(name, unit or under) for (name, unit), under in zip(headings, below, strict=False)]
    for k, (base, _) in enumerate(headings):
        if base in _KNOWN and base not in (*sources, *header):
            names[k] = base
    for name, source in sources.items():
        names[_index_of(path, names, [base for base, _ in headings], name, source)] = name
    units = _header_units(path, names, [unit for _, unit in headings])
    units |= {name: column.unit for name, column in columns.items() if column.unit is not None}
    _check_names(path, names, mapped=bool(columns) or bool(units), secondaries=secondaries)
    units = {name: unit for name, unit in units.items() if unit != COUNTS}
    stage = columns["stage"].value if "stage" in columns else None
    return Layout(skipped + is_units_row, separator, tuple(header), tuple(names), units, stage or "")


def _heading(cell: str) -> tuple[str, str]:
    """Return the name and the unit of a header cell like "GyrX [deg/s]"; the unit is "" if there is none."""
    match = re.fullmatch(r"([^\[(]*+.*?)[\[(]([^\[\]()]*+)[\])]", cell)
    return (match[1].strip().rstrip("_ \t"), match[2].strip()) if match else (cell, "")


def _header_units(path: Path, names: list[str], stated: list[str]) -> dict[str, str]:
    """Return the units of the header row by column. Raises InputError if the unit of a sensor is unknown."""
    units = {}
    for name, unit in zip(names, stated, strict=True):
        unit = _SPELLINGS.get(unit.lower(), unit)
        if unit in _units(name) or (unit == COUNTS and name.startswith(_SENSORS)):
            units[name] = unit
        elif unit and name in _KNOWN and name.startswith(_SENSORS):
            choices = [*_units(name), COUNTS]
            remedy = Text.of("entry.choose_from", names=choices)
            raise InputError("csv.header_unit", file=path, name=name, unit=unit, remedy=remedy)
    return units


def _cells(line: str, separator: str) -> list[str]:
    line = line.rstrip("\r")
    if line[:1] in COMMENT:
        line = line.lstrip(COMMENT + " ")
    if separator == " ":
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]
    except csv.Error:
        return []


def _header(lines: list[str], expected: set[str]) -> tuple[int, str, list[str]]:
    """Return the number of lines up to the end of the header row, its separator and its cells.

    The header row is the first line with at least two of the `expected` names, or else the first line with one. If no
    line has any of them, it is the first line that is not a comment.
    """
    best_score, best = 0, (0, _PLAIN_SEPARATOR, list[str]())
    for number, line in enumerate(lines, 1):
        for separator in _SEPARATORS:
            cells = _cells(line, separator)
            score = len(expected.intersection(cells + [_heading(cell)[0] for cell in cells]))
            if score > best_score:
                best_score, best = score, (number, separator, cells)
        if best_score > 1:
            return best
    if best_score:
        return best
    number = next((k for k, line in enumerate(lines, 1) if line.strip() and line[:1] not in COMMENT), 1)
    line = lines[number - 1]
    separator = max(_SEPARATORS, key=lambda s: len(_cells(line, s)) if s != " " else 1)
    return number, separator, _cells(line, separator)


def _first_numbers(path: Path, lines: list[str], columns: int) -> tuple[int, str, list[str]]:
    """Return the number of lines before the first row of at least `columns` numbers, its separator and its cells."""
    for number, line in enumerate(lines):
        for separator in _SEPARATORS:
            cells = _cells(line, separator)
            if len(cells) >= columns and all(_is_number(c, separator) for c in cells):
                return number, separator, cells
    raise InputError("csv.no_numbers", file=path, columns=columns)


def _is_number(cell: str, separator: str) -> bool:
    try:
        float(cell if separator == _PLAIN_SEPARATOR else cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _index_of(path: Path, names: list[str], bases: list[str], name: str, source: str | int) -> int:
    """Return the index of the column from which `name` is read; `bases` are the column names without units.

    Raises InputError.
    """
    if isinstance(source, int):
        if not 1 <= source <= len(names):
            raise InputError("csv.no_such_column", file=path, name=name, source=source, remedy=_columns(names))
        return source - 1
    if source not in names and bases.count(source) == 1:
        return bases.index(source)
    if source not in names:
        remedy = near_miss(source, names, _columns(names))
        raise InputError("csv.no_such_column", file=path, name=name, source=source, remedy=remedy)
    if names.count(source) > 1:
        raise InputError("csv.column_twice", file=path, column=source)
    return names.index(source)


def _columns(names: list[str]) -> Text:
    return Text.of("entry.choose_from", names=[name for name in names if name])


def _looks_like_time(name: str) -> bool:
    return name.lower().startswith(("time", "utc", "gps_time")) or _heading(name)[0].lower() in ("t", "sec", "seconds")


def _check_names(path: Path, names: list[str], *, mapped: bool, secondaries: Collection[int]) -> None:
    """Raise InputError if a required column is missing, or a column belongs to an IMU that is not configured."""
    number_of = {name: number for number in FURTHER_IMUS for name in further_channels(number)}
    others = [name for number in secondaries for name in further_channels(number)]
    unknown = [name for name in names if name not in _KNOWN]
    table = any(name in names for name in ANGLES)
    gyros = any(name in names for name in _GYROS)
    for name in REQUIRED:
        if name in names:
            continue
        may_be_missing = not table or (mapped and name not in ANGLES)
        if name == "time_s" and mapped:
            near = next((each for each in unknown if _looks_like_time(each)), None)
            if near is None:
                continue  # the samples are counted
            raise InputError("csv.column_misspelt", file=path, column=name, near=near)
        optional = (name in _OPTIONAL and may_be_missing) or (name in _GYROS and not gyros)
        if optional and mapped:
            continue
        similar = difflib.get_close_matches(name, unknown, n=1)
        if similar:
            raise InputError("csv.column_misspelt", file=path, column=name, near=similar[0])
        if not optional:
            raise InputError("csv.column_missing", file=path, column=name)
    for name in others:
        if name not in names:
            raise InputError("csv.imu_column_missing", file=path, column=name, number=number_of[name])
    for name in names:
        if name in number_of and name not in others:
            raise InputError("csv.imu_not_configured", file=path, column=name, number=number_of[name])
    if any(name in names for name in JOINTS) and not all(name in names for name in JOINTS):
        raise InputError("csv.joint_missing", file=path, columns=JOINTS)
    for name in (*COLUMNS, *others):
        if names.count(name) > 1:
            raise InputError("csv.column_twice", file=path, column=name)
