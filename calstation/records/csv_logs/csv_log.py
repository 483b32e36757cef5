"""Logs in the CSV format of docs/contract.md, and CSV files of other programs."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from calstation.errors import InputError
from calstation.physics import AXES
from calstation.records.columns import (
    ColumnMap,
    Layout,
    RecordingMeta,
    is_increment,
    min_step,
    read_configuration,
    read_layout,
    unit_factor,
    unit_factors,
)
from calstation.records.csv_logs.csv_table import csv_tables
from calstation.records.csv_logs.csv_text import text_chunks
from calstation.records.log import Log
from calstation.records.meta import FURTHER_IMUS, LogMeta
from calstation.records.recording import Recording
from calstation.records.samples import SampleTable
from calstation.schema import validate

#: Suffixes of text recordings; .gz may follow.
_TEXT_SUFFIXES = (".csv", ".txt", ".tsv", ".dat")
#: Suffixes of CSV logs and text recordings.
CSV_SUFFIXES = tuple(suffix + compressed for suffix in _TEXT_SUFFIXES for compressed in ("", ".gz"))
#: Number of samples from which the step of the output, and whether it is integer, are determined.
_FIRST_ROWS = 1024
#: Relative rounding error of a count size with six digits, by which counts may deviate from whole numbers.
_LSB_ERROR = 1e-6


def meta_path(path: Path) -> Path:
    """Return NAME.toml next to NAME.csv or NAME.csv.gz."""
    name = Path(path.name.removesuffix(".gz"))
    return path.with_name((name.stem if name.suffix in _TEXT_SUFFIXES else name.name) + ".toml")


def open_csv(path: Path, meta_file: Path | None = None) -> Log:
    """Open a CSV with its TOML file next to it or at `meta_file`. Raises InputError if one is missing or invalid."""
    if not path.is_file():
        raise InputError("log.not_found" if path.name.endswith((".csv", ".csv.gz")) else "log.not_a_log", file=path)
    meta, (layout,) = load_recording([path], meta_file or meta_path(path))
    return recorded_log(path, meta, partial(csv_tables, path, layout, unit_factors(layout, meta)), layout)


def recorded_log(path: Path, meta: LogMeta, tables: Callable[[], Iterator[SampleTable]], layout: Layout) -> Log:
    """Return the log of a recording; the quantisation of sensors with non-integer output is 0 unless it is given.

    Parameters
    ----------
    path : file of the recording
    meta : its configuration
    tables : function that reads its samples from the start, in the units of the CSV format
    layout : its columns
    """
    unit = unit_factor("time_s", layout.units.get("time_s", "s"))
    recording = Recording(path, with_quantisation(meta, tables), tables, unit)
    return Log(
        path,
        recording.meta,
        recording.blocks,
        times=recording.report,
        columns=layout.sources,
        unused=layout.unused,
        _damaged=recording.damaged,
    )


def with_quantisation(meta: LogMeta, tables: Callable[[], Iterator[SampleTable]]) -> LogMeta:
    """Return the configuration; the quantisation of sensors with non-integer output is 0 unless it is given."""
    counts = [np.empty((0, 6))]
    with suppress(InputError):  # reported when the samples are read
        counts += [part.counts()[part.valid] for part in _first_rows(tables)]
    values = np.concatenate(counts)
    values = values[np.isfinite(values).all(axis=1)]  # excessive values are refused when the samples are read
    is_decimal = np.any(np.abs(values - np.rint(values)) > _LSB_ERROR * np.abs(values), axis=0)
    sensors = {"gyro_quantisation": is_decimal[:3].any(), "accel_quantisation": is_decimal[3:].any()}
    added = {name: 0.0 for name, has_decimals in sensors.items() if has_decimals and getattr(meta.imu, name) is None}
    return meta.model_copy(update={"imu": meta.imu.model_copy(update=added)}) if added else meta


def _first_rows(tables: Callable[[], Iterator[SampleTable]]) -> list[SampleTable]:
    """Return the first rows of a recording, regardless of the parts in which it is read. Raises InputError."""
    parts, remaining = list[SampleTable](), _FIRST_ROWS
    for table in tables():
        parts.append(table.select(np.arange(len(table)) < remaining))
        remaining -= len(table)
        if remaining <= 0:
            break
    return parts


def load_recording(paths: Sequence[Path], meta_file: Path) -> tuple[LogMeta, list[Layout]]:
    """Read the TOML of CSV files and find the layout of each. Raises InputError with file, field and remedy."""
    data = read_configuration(meta_file)
    columns = validate(ColumnMap, {"columns": data.get("columns", {})}, meta_file, InputError).columns
    secondaries = list(itertools.takewhile(lambda n: f"imu{n}" in data, FURTHER_IMUS))
    layouts = [read_layout(path, _head(path), columns, secondaries) for path in paths]
    complete_counts(data, layouts[0], partial(csv_tables, paths[0], layouts[0], {}))
    return validate(RecordingMeta, data, meta_file, InputError).log_meta, layouts


def complete_counts(data: dict[str, Any], layout: Layout, tables: Callable[[], Iterator[SampleTable]]) -> None:
    """Set missing count sizes of columns with a physical unit to their smallest step.

    Parameters
    ----------
    data : content of the TOML, which is changed
    layout : columns of the recording
    tables : function that reads its samples from the start, in the units of the file
    """
    for number in ("", *FURTHER_IMUS):
        section = data.get(f"imu{number}")
        if not isinstance(section, dict):
            continue
        if not layout.has_gyros:
            section |= {name: section.get(name, 1.0) for name in ("gyro_lsb", "gyro_arw")}
        for sensor in ("gyro", "accel"):
            names = [f"{sensor}{number}_{axis}" for axis in AXES]
            unit = layout.units.get(names[0])
            if unit is None or f"{sensor}_lsb" in section:
                continue
            output = "increment" if is_increment(unit) else "rate"
            if section.setdefault("output", output) == output and (head := _first_rows(tables)):
                values = (np.concatenate([part.floats(name) for part in head]) for name in names)
                step = min_step(values) or 1.0
                section[f"{sensor}_lsb"] = float(f"{step * unit_factor(names[0], unit):.6g}")


def _head(path: Path) -> str:
    """Return the first lines of the file. Raises InputError if it is empty."""
    head = next(text_chunks(path), "")
    if not head.strip():
        raise InputError("csv.empty", file=path)
    return head
