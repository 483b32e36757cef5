"""Topics of a file: the messages, variables or groups that may contain the samples of an IMU."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

import numpy as np

from calstation.errors import InputError
from calstation.physics import FloatArray

#: Columns of a part of a topic by the name of their source in the file, shape (n,) each.
Columns = Mapping[str, FloatArray]
#: Number of messages that are read at once.
CHUNK_ROWS = 4096
#: Fraction of samples of one sensor for which the other sensor must have a sample at the same time.
_MIN_JOINED = 0.9


@dataclass(frozen=True)
class Topic:
    """A topic of a file."""

    name: str
    kind: str  #: Type of its messages, as the file names it.
    samples: int
    #: Source in the file and unit of the columns of the CSV format; empty if the topic is not an IMU.
    columns: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    #: Entries of `[imu]` that the file gives; the TOML replaces them.
    imu: Mapping[str, float | str] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.name} ({self.kind}, {self.samples})"


@dataclass(frozen=True)
class ForeignFormat:
    """A file format of other programs."""

    name: str
    suffixes: tuple[str, ...]
    package: str  #: Python package that reads it.
    topics: Callable[[Path], list[Topic]]  #: Lists the topics of a file.
    read: Callable[[Path, Topic], Iterator[Columns]]  #: Reads a topic in parts.
    #: Regular expression that matches the first bytes of the file, if other files have the same suffixes.
    begin: bytes = b""


def vector_columns(gyro: str, accel: str, units: tuple[str, str], time: tuple[str, str]) -> dict[str, tuple[str, str]]:
    """Return the columns of an IMU whose sources are named with the axis in place of `{}`.

    Parameters
    ----------
    gyro, accel : names of the sources
    units : units of gyros and accelerometers
    time : name and unit of the source of the time stamps
    """
    columns = {"time_s": time}
    for sensor, name, unit in (("gyro", gyro, units[0]), ("accel", accel, units[1])):
        columns |= {f"{sensor}_{axis}": (name.format(axis), unit) for axis in "xyz"}
    return columns


def joined_sensors(path: Path, gyro: Columns, accel: Columns, time: str) -> Columns:
    """Join separately recorded gyros and accelerometers by their times; a sample without a partner is damaged.

    The partner of a gyro sample is the nearest accelerometer sample within half a sample period. Raises InputError if
    more than a tenth of the samples have no partner.

    Parameters
    ----------
    path : file
    gyro, accel : columns of the sensors; the result has the times of the gyros
    time : name of the column of times
    """
    at, other = gyro[time], accel[time]
    partners = np.full(len(at), -1)
    if len(at) > 1 and len(other) > 1:
        later = np.clip(np.searchsorted(other, at), 1, len(other) - 1)
        nearest = later - (at - other[later - 1] < other[later] - at)
        partners = np.where(np.abs(other[nearest] - at) <= 0.5 * float(np.median(np.diff(at))), nearest, -1)
    joined = int(np.count_nonzero(partners >= 0))
    if joined < _MIN_JOINED * max(len(at), len(other)):
        raise InputError("foreign.sensors_apart", file=path, gyro=len(at), accel=len(other), joined=joined)
    present = partners >= 0
    columns = dict(gyro)
    for name, values in accel.items():
        if name != time:
            columns[name] = np.where(present, values[partners], np.nan)
    return columns


def silence(module: ModuleType) -> None:
    """Suppress the output of a library, which may print a line per byte of a damaged file, even to standard output."""
    vars(module)["print"] = lambda *_, **__: None
