"""PX4 ULog: `sensor_gyro` with `sensor_accel` of the same instance, and the batches of their FIFO messages.

The last sample of a FIFO message has the time `timestamp_sample`; the samples before it precede each other by `dt`.
Source: message definitions SensorGyro, SensorAccel, SensorGyroFifo and SensorAccelFifo of PX4.
"""

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from calstation.physics import FloatArray
from calstation.records.columns import COUNTS
from calstation.records.foreign.topics import Columns, ForeignFormat, Topic, joined_sensors, silence, vector_columns

_FIFO = "_fifo"
#: Names of gyro messages; the names of accelerometer messages have `accel` instead of `gyro`.
_GYROS = ("sensor_gyro", f"sensor_gyro{_FIFO}")
_NAMES = [*_GYROS, *(name.replace("gyro", "accel") for name in _GYROS), "sensor_combined"]
_TIME = ("timestamp_sample", "us")
_SAMPLED = vector_columns("sensor_gyro.{}", "sensor_accel.{}", ("rad/s", "m/s2"), _TIME)
#: Number of bytes of a damaged file that pyulog may read again in its search for messages, and bytes counted per step
#: back.
_MAX_REPEATED, _STEP = 1 << 30, 1000
_COUNTED = vector_columns("sensor_gyro.{}", "sensor_accel.{}", (COUNTS, COUNTS), _TIME)


class _Stream(io.BufferedReader):
    """A file that limits pyulog's search for messages, which steps back byte by byte and may never end."""

    _repeated = 0

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Go to a position. Raises EOFError before the beginning, or after too many bytes that are read again."""
        if whence == io.SEEK_CUR and offset < 0:
            self._repeated += _STEP - offset
            if self._repeated > _MAX_REPEATED or -offset > self.tell():
                raise EOFError("a large part is damaged")
        return super().seek(offset, whence)


def _topics(path: Path) -> list[Topic]:
    data, topics = _load(path), []
    for (name, instance), fields in data.items():
        accel = data.get((name.replace("gyro", "accel"), instance))
        columns, imu = dict[str, tuple[str, str]](), dict[str, float | str]()
        if name in _GYROS and accel is not None:
            columns = _SAMPLED | ({"temp_c": ("temperature", "degC")} if "temperature" in accel else {})
        if columns and name.endswith(_FIFO):
            columns = _COUNTED
            imu = {"output": "rate", "gyro_lsb": _scale(fields), "accel_lsb": _scale(accel or fields)}
        topics.append(Topic(f"{name}/{instance}", name, len(fields["timestamp"]), columns, imu))
    return topics


def _read(path: Path, topic: Topic) -> Iterator[Columns]:
    data = _load(path)
    name, _, instance = topic.name.partition("/")
    gyro = data[name, int(instance)]
    accel = data.get((name.replace("gyro", "accel"), int(instance)))
    if name not in _GYROS or accel is None:
        yield gyro
        return
    unpack = _unpacked if name.endswith(_FIFO) else _single
    yield joined_sensors(path, unpack("sensor_gyro", gyro), unpack("sensor_accel", accel), _TIME[0])


def _load(path: Path) -> dict[tuple[str, int], dict[str, Any]]:
    """Return the fields of the messages of IMUs by name and instance."""
    from pyulog import core

    silence(core)
    with _Stream(io.FileIO(path)) as stream:
        messages = core.ULog(stream, _NAMES).data_list
    return {(each.name, each.multi_id): each.data for each in messages if len(each.data["timestamp"])}


def _scale(fields: dict[str, Any]) -> float:
    """Return the size of a count of FIFO messages, rad/s or m/s²."""
    return float(fields["scale"][0])


def _single(sensor: str, fields: dict[str, Any]) -> dict[str, FloatArray]:
    """Return the samples of messages with one sample each."""
    time = fields.get(_TIME[0], fields["timestamp"])
    columns = {_TIME[0]: np.where(time > 0, time, fields["timestamp"]).astype(np.float64)}
    columns |= {f"{sensor}.{axis}": fields[axis].astype(np.float64) for axis in "xyz"}
    return columns | ({"temperature": fields["temperature"]} if "temperature" in fields and "accel" in sensor else {})


def _unpacked(sensor: str, fields: dict[str, Any]) -> dict[str, FloatArray]:
    """Return the samples of FIFO messages, in counts of the first message."""
    width = max(int(fields["samples"].max()), 1)
    number = np.arange(width)
    present = number < fields["samples"][:, None]
    before = (fields["samples"][:, None] - 1.0 - number) * fields["dt"][:, None].astype(np.float64)
    columns = {_TIME[0]: (fields[_TIME[0]][:, None] - before)[present]}
    ratio = (fields["scale"] / fields["scale"][0]).astype(np.float64)[:, None]
    for axis in "xyz":
        counts = np.column_stack([fields[f"{axis}[{k}]"] for k in range(width)])
        columns[f"{sensor}.{axis}"] = (counts * ratio)[present]
    return columns


FORMAT = ForeignFormat("PX4 ULog", (".ulg",), "pyulog", _topics, _read)
