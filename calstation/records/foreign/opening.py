"""Opening of recordings in foreign formats: choice of the topic, its columns, and its samples as a log."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from calstation.errors import CalstationError, InputError
from calstation.messages import Text, os_reason
from calstation.physics import CHANNELS, FloatArray
from calstation.records.columns import (
    COUNTS,
    ColumnMap,
    ColumnSection,
    Layout,
    RecordingMeta,
    read_configuration,
    unit_factors,
)
from calstation.records.csv_logs import complete_counts, recorded_log
from calstation.records.foreign import dataflash, mat, mcap, novatel, rosbag, tdms, ulog
from calstation.records.foreign.topics import Columns, ForeignFormat, Topic
from calstation.records.log import Log
from calstation.records.samples import SampleTable, damages, is_excessive
from calstation.schema import near_miss, validate

_Part = TypeVar("_Part", list[Topic], Columns)

FOREIGN_FORMATS: tuple[ForeignFormat, ...] = (
    mcap.FORMAT, rosbag.FORMAT, ulog.FORMAT, dataflash.FORMAT, novatel.FORMAT, mat.FORMAT, tdms.FORMAT
)  # fmt: skip
#: Number of bytes that are searched for the signature of a format.
_BEGIN = 4096


def foreign_format(path: Path) -> ForeignFormat | None:
    """Determine the format of a file, or of a ROS 2 bag's folder, from its name and its first bytes.

    Return None for any other file.
    """
    if (path / "metadata.yaml").is_file():
        return rosbag.FORMAT
    named = [each for each in FOREIGN_FORMATS if path.name.lower().endswith(each.suffixes)]
    if not any(each.begin for each in named):
        return next(iter(named), None)
    try:
        with path.open("rb") as stream:
            head = stream.read(_BEGIN)
    except OSError:
        return None
    return next((each for each in named if re.search(each.begin, head)), None)


def open_foreign(path: Path, meta_file: Path | None = None, topic: str | None = None) -> Log:
    """Open a recording with its TOML file next to it or at `meta_file`.

    Without `topic`, the only IMU of the file is taken. Raises InputError if the file, its library or its TOML is
    missing or invalid, or if the topic is not unique.
    """
    kind = foreign_format(path)
    if kind is None or not path.exists():
        raise InputError("log.not_found" if kind else "log.not_a_log", file=path)
    meta_file = meta_file or path.with_suffix(".toml")
    data = read_configuration(meta_file)
    mapped = validate(ColumnMap, {"columns": data.get("columns", {})}, meta_file, InputError).columns
    topics = next(_guarded(path, kind, lambda: iter([kind.topics(path)])))
    chosen = _choose(path, topics, topic, mapped)
    layout = _layout(path, chosen, mapped)
    tables = partial(_tables, path, kind, chosen, layout)
    if isinstance(data.get("imu"), dict):
        data["imu"] = {**chosen.imu, **data["imu"]}
        _check_counts(path, chosen, mapped, data["imu"])
    complete_counts(data, layout, partial(tables, {}))
    meta = validate(RecordingMeta, data, meta_file, InputError).log_meta
    log = recorded_log(path, meta, partial(tables, unit_factors(layout, meta)), layout)
    return replace(log, topics=tuple(map(str, topics)))


def _choose(path: Path, topics: list[Topic], name: str | None, mapped: Mapping[str, ColumnSection]) -> Topic:
    """Return the topic called `name`, or the topic from which `[columns]` takes the accelerometers, or the only IMU.

    Raises InputError.
    """
    names = [topic.name for topic in topics]
    if name is not None:
        if name not in names:
            raise InputError("foreign.no_topic", file=path, topic=name, remedy=_one_of(name, names))
        topic = topics[names.index(name)]
        if not topic.columns and not mapped:
            raise InputError("foreign.not_imu", file=path, topic=name, kind=topic.kind)
        return topic
    source = str(mapped[CHANNELS[3]].source) if CHANNELS[3] in mapped else ""
    named = [topic for topic in topics if source == topic.name or source.startswith(f"{topic.name}(")]
    imus = named or [topic for topic in topics if topic.columns] or (topics if mapped else [])
    if len(imus) == 1:
        return imus[0]
    if imus:
        raise InputError("foreign.several_imus", file=path, topics=[topic.name for topic in imus])
    raise InputError("foreign.no_imu", file=path, topics=[str(topic) for topic in topics])


def _layout(path: Path, topic: Topic, mapped: Mapping[str, ColumnSection]) -> Layout:
    """Return the columns of a topic; entries of `[columns]` replace them.

    Raises InputError if the column of an axis is missing; a recording may lack the gyros.
    """
    sources = {name: str(section.source) for name, section in mapped.items() if section.source is not None}
    sources = {name: source for name, (source, _) in topic.columns.items()} | sources
    required = CHANNELS if any(name in sources for name in CHANNELS[:3]) else CHANNELS[3:]
    for name in required:
        if name not in sources:
            raise InputError("csv.column_missing", file=path, column=name)
    units = {name: unit for name, (_, unit) in topic.columns.items() if unit}
    units |= {name: section.unit for name, section in mapped.items() if section.unit is not None}
    stage = mapped["stage"].value if "stage" in mapped else None
    units = {name: unit for name, unit in units.items() if unit != COUNTS}
    return Layout(header=tuple(sources.values()), names=tuple(sources), units=units, stage=stage or "")


def _check_counts(path: Path, topic: Topic, mapped: Mapping[str, ColumnSection], imu: Mapping[str, object]) -> None:
    """Raise InputError if a topic has counts whose size neither the file nor the TOML states."""
    for sensor in ("gyro", "accel"):
        name = f"{sensor}_x"
        if topic.columns.get(name, ("", ""))[1] == COUNTS and name not in mapped and f"{sensor}_lsb" not in imu:
            raise InputError("foreign.no_scale", file=path, topic=topic.name)


def _tables(
    path: Path, kind: ForeignFormat, topic: Topic, layout: Layout, factors: Mapping[str, float]
) -> Iterator[SampleTable]:
    """Yield the samples of a topic in the units of the CSV format; rows without a required number are damaged.

    Raises InputError if a number is excessive.
    """
    first = 0
    for part in _guarded(path, kind, lambda: kind.read(path, topic)):
        values = dict[str, FloatArray]()
        for name, source in zip(layout.names, layout.header, strict=True):
            if source not in part:
                remedy = _one_of(source, list(part))
                raise InputError("csv.no_such_column", file=path, name=name, source=source, remedy=remedy)
            values[name] = np.asarray(part[source], np.float64)
        count = len(values[CHANNELS[3]])
        for name, column in values.items():
            if len(column) != count:
                lengths = {"found": len(column), "expected": count, "other": CHANNELS[3]}
                raise InputError("foreign.lengths_differ", file=path, name=name, **lengths)
        rows = first + np.arange(count)
        first += len(rows)
        is_damaged = np.zeros(len(rows), np.bool_)
        valid = np.nan_to_num(values["valid"]) != 0.0 if "valid" in values else ~is_damaged
        for name, column in values.items():
            matters = valid | (name not in CHANNELS)
            is_wrong = damages(name, column) & matters
            is_large = is_excessive(name, column) & matters & ~is_wrong
            if is_large.any():
                row = int(np.argmax(is_large))
                where = {"file": path, "line": int(rows[row]) + 1, "column": name, "cell": f"{column[row]:.15g}"}
                raise InputError("csv.cell_too_large", **where)
            is_damaged |= is_wrong
        with np.errstate(over="ignore", invalid="ignore"):  # a number that becomes too large is refused later
            scaled = {name: column * factors.get(name, 1.0) for name, column in values.items()}
        table = SampleTable(scaled, [layout.stage] * len(rows), rows + 1, rows, rows[is_damaged])
        yield table.select(~is_damaged)


def _one_of(name: str, names: list[str]) -> Text:
    """Return the remedy for a wrong name."""
    return near_miss(name, names, Text.of("entry.choose_from", names=names))


def _guarded(path: Path, kind: ForeignFormat, read: Callable[[], Iterator[_Part]]) -> Iterator[_Part]:
    """Yield what a library reads; its errors are raised as InputError."""
    try:
        yield from read()
    except CalstationError:
        raise
    except ImportError as exc:
        raise InputError("foreign.no_library", file=path, format=kind.name, package=kind.package) from exc
    except OSError as exc:
        raise InputError("log.unreadable", file=path, reason=os_reason(exc)) from exc
    except Exception as exc:  # the libraries raise errors of all kinds for a damaged file
        raise InputError("foreign.damaged", file=path, format=kind.name, detail=str(exc)[:200]) from exc
