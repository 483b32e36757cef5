"""ArduPilot DataFlash logs, binary or text: messages `IMU`, or `GYR` and `ACC` of the same instance.

The batches `ISBH` and `ISBD` are not read, because gyros and accelerometers alternate in them. A message
of a binary log begins with its type, which a message FMT describes (ArduPilot, LogStructure.h); it has no checksum.
"""

import math
import mmap
import struct
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from calstation.physics import CHANNELS
from calstation.records.foreign.topics import CHUNK_ROWS, Columns, ForeignFormat, Topic, joined_sensors

#: Fields of the messages that are read; old logs have the instance in the name, as in IMU2, and no field I.
_FIELDS = {
    "IMU": ("TimeUS", *(f"{sensor}{axis}" for sensor in ("Gyr", "Acc") for axis in "XYZ"), "T"),
    "GYR": ("SampleUS", "GyrX", "GyrY", "GyrZ"),
    "ACC": ("SampleUS", "AccX", "AccY", "AccZ"),
}
_COLUMNS = {
    name: (field, "rad/s" if name.startswith("gyro") else "m/s2")
    for name, field in zip(CHANNELS, _FIELDS["IMU"][1:7], strict=True)
}

#: Name, layout, labels and scale factors of the fields of a message; the layout includes the first bytes and the type.
_Format = tuple[str, struct.Struct, list[str], dict[str, float]]
#: First bytes of a binary message; type and layout of the message FMT, and position of the name in its text form.
_HEAD, _FMT_TYPE, _FMT, _FMT_NAME = b"\xa3\x95", 128, struct.Struct("<3xBB4s16s64s"), 2
_FMT_LABELS = ["Type", "Length", "Name", "Format", "Columns"]
#: Types of fields in `struct` by their letters in FMT, and scale factors of some letters.
_TYPES = {letter: letter for letter in "bBhHiIfdqQ"}
_TYPES |= {
    "a": "64s",
    "g": "e",
    "n": "4s",
    "N": "16s",
    "Z": "64s",
    "c": "h",
    "C": "H",
    "e": "i",
    "E": "I",
    "L": "i",
    "M": "b",
}
_SCALES = {**dict.fromkeys("cCeE", 0.01), "L": 1e-7}
_UNKNOWN: _Format = ("", struct.Struct(""), [], {})
_LONGEST_LINE, _INSTANCES = 4096, 16


def _topics(path: Path) -> list[Topic]:
    counts = defaultdict[tuple[str, int], int](int)
    for name, instance, _ in _messages(path, tuple(_FIELDS)):
        counts[name, instance] += 1
    topics = []
    for (name, instance), count in sorted(counts.items()):
        columns = dict[str, tuple[str, str]]()
        if name == "IMU":
            columns = {"time_s": ("TimeUS", "us"), **_COLUMNS, "temp_c": ("T", "degC")}
        elif name == "GYR" and ("ACC", instance) in counts:
            columns = {"time_s": ("SampleUS", "us"), **_COLUMNS}
        topics.append(Topic(f"{name}/{instance}", name, count, columns))
    return topics


def _read(path: Path, topic: Topic) -> Iterator[Columns]:
    name, _, instance = topic.name.partition("/")
    if name == "GYR" and topic.columns:
        parts = [_concatenated(_parts(path, each, int(instance))) for each in ("GYR", "ACC")]
        yield joined_sensors(path, parts[0], parts[1], "SampleUS")
    else:
        yield from _parts(path, name, int(instance))


def _concatenated(parts: Iterator[Columns]) -> Columns:
    columns = list(parts)
    return {name: np.concatenate([part[name] for part in columns]) for name in columns[0]}


def _parts(path: Path, name: str, instance: int) -> Iterator[Columns]:
    """Yield the fields of the messages of an instance; fields missing in the log are NaN."""
    fields = _FIELDS[name]
    rows = list[list[float]]()
    for _, number, message in _messages(path, (name,)):
        if number == instance:
            rows.append([message.get(field, math.nan) for field in fields])
        if len(rows) == CHUNK_ROWS:
            yield dict(zip(fields, np.array(rows, np.float64).T, strict=True))
            rows = []
    if rows:
        yield dict(zip(fields, np.array(rows, np.float64).T, strict=True))


def _messages(path: Path, names: tuple[str, ...]) -> Iterator[tuple[str, int, Mapping[str, float]]]:
    """Yield name, instance and fields of the messages with one of the names, which may end with an instance number."""
    selected = {f"{name}{number}" for name in names for number in ("", *range(1, 10))}
    with path.open("rb") as stream:
        is_binary = stream.read(len(_HEAD)) == _HEAD
        stream.seek(0)
        for name, fields in _binary(stream, selected) if is_binary else _text(stream, selected):
            instance = fields.get("I", int(name[3:] or 1) - 1)
            if 0 <= instance < _INSTANCES:
                yield name[:3], int(instance), fields


def _binary(stream: BinaryIO, selected: set[str]) -> Iterator[tuple[str, Mapping[str, float]]]:
    """Yield names and fields of `selected` messages of a binary log; a message must end where the next one begins."""
    formats = {_FMT_TYPE: ("FMT", _FMT, _FMT_LABELS, dict[str, float]())}
    with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        at = data.find(_HEAD)
        while 0 <= at < len(data) - len(_HEAD):
            kind = data[at + 2]
            name, form, labels, scales = formats.get(kind, _UNKNOWN)
            end = at + form.size
            if not form.size or end > len(data) or not _HEAD.startswith(data[end : end + 2]):
                at = data.find(_HEAD, at + 1)
                continue
            if kind == _FMT_TYPE or name in selected:
                fields = dict(zip(labels, form.unpack_from(data, at), strict=False))
                if kind != _FMT_TYPE:
                    yield name, {n: x * scales.get(n, 1.0) for n, x in fields.items() if not isinstance(x, bytes)}
                elif fields["Type"] != _FMT_TYPE:
                    formats[fields["Type"]] = _format(fields)
            at = end


def _format(fields: Mapping[str, Any]) -> _Format:
    """Return the format of a message that FMT describes; `_UNKNOWN` if FMT is contradictory."""
    name, types, columns = (_decoded(fields[each]) for each in _FMT_LABELS[2:])
    form, labels = struct.Struct("<3x" + "".join(_TYPES.get(each, "") for each in types)), columns.split(",")
    scales = {label: _SCALES[each] for label, each in zip(labels, types, strict=False) if each in _SCALES}
    return (name, form, labels, scales) if form.size == fields["Length"] else _UNKNOWN


def _decoded(text: bytes) -> str:
    return text.partition(b"\0")[0].decode("latin-1")


def _text(stream: BinaryIO, selected: set[str]) -> Iterator[tuple[str, Mapping[str, float]]]:
    """Yield names and fields of the `selected` messages of a text log; a cell that is not a number is NaN."""
    labels: dict[str, list[str]] = {}
    while line := stream.readline(_LONGEST_LINE):
        name, *cells = [cell.strip() for cell in line.decode("latin-1").split(",")]
        if name == "FMT" and len(cells) > _FMT_NAME:
            labels[cells[_FMT_NAME]] = cells[_FMT_NAME + 2 :]
        elif name in selected and name in labels and line.endswith(b"\n"):
            yield name, dict(zip(labels[name], map(_number, cells), strict=False))


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan


FORMAT = ForeignFormat("ArduPilot DataFlash", (".bin", ".log"), "numpy", _topics, _read, rb"\A(\xa3\x95\x80|FMT, ?128)")
