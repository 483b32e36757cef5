"""ArduPilot DataFlash logs: `IMU`, or `GYR` with `ACC` of the same instance, of binary and text logs.

The batches `ISBH` and `ISBD` are no recording of an IMU, because gyros and accelerometers alternate in them.
"""

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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
    found = list(parts)
    return {name: np.concatenate([part[name] for part in found]) for name in found[0]}


def _parts(path: Path, name: str, instance: int) -> Iterator[Columns]:
    """Yield the fields of the messages of an instance; a field that the log lacks is NaN."""
    fields = _FIELDS[name]
    rows = list[list[float]]()
    for _, number, message in _messages(path, (name,)):
        if number == instance:
            rows.append([getattr(message, field, np.nan) for field in fields])
        if len(rows) == CHUNK_ROWS:
            yield dict(zip(fields, np.array(rows, np.float64).T, strict=True))
            rows = []
    if rows:
        yield dict(zip(fields, np.array(rows, np.float64).T, strict=True))


def _messages(path: Path, names: tuple[str, ...]) -> Iterator[tuple[str, int, Any]]:
    """Yield name, instance and message of the messages with one of the names, with or without an instance."""
    from pymavlink.DFReader import DFReader_binary, DFReader_text

    with path.open("rb") as stream:
        reader = (DFReader_binary if stream.read(1) == b"\xa3" else DFReader_text)(str(path))
    kinds = [f"{name}{number}" for name in names for number in ("", *range(1, 10))]
    try:
        while (message := reader.recv_match(type=kinds, strict=True)) is not None:
            kind = message.get_type()
            yield kind[:3], int(getattr(message, "I", int(kind[3:] or 1) - 1)), message
    finally:
        reader.close()


FORMAT = ForeignFormat(
    "ArduPilot DataFlash", (".bin", ".log"), "pymavlink", _topics, _read, rb"\A(\xa3\x95\x80|FMT, ?128)"
)
