"""Topics of a file: the messages, variables or groups with an IMU's samples that it contains."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from calstation.physics import FloatArray

#: Columns of a part of a topic by the name of their source in the file, shape (n,) each.
Columns = Mapping[str, FloatArray]
#: Number of messages that are read at once.
CHUNK_ROWS = 4096


@dataclass(frozen=True)
class Topic:
    """A topic of a file."""

    name: str
    kind: str  #: Type of its messages, as the file names it.
    samples: int
    #: Source in the file and unit of the columns of the CSV format; empty if the topic is not an IMU.
    columns: Mapping[str, tuple[str, str]] = field(default_factory=dict)

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
