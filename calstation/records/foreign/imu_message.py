"""Messages `sensor_msgs/Imu` of ROS 1 and ROS 2 as columns.

A message ends with orientation, angular velocity and linear acceleration, each with its covariance: 37 numbers.
Sources: ROS message definition sensor_msgs/Imu; OMG CDR (XCDR1) for ROS 2.
"""

import itertools
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calstation.physics import FloatArray, IntArray
from calstation.records.foreign.topics import CHUNK_ROWS, Columns, vector_columns

#: Names of the message type in ROS 1 and ROS 2.
IMU_TYPES = ("sensor_msgs/Imu", "sensor_msgs/msg/Imu")
#: Columns of the CSV format; the time comes from the headers, or from the recorder if no header has a time.
IMU_COLUMNS = vector_columns("angular_velocity.{}", "linear_acceleration.{}", ("rad/s", "m/s2"), ("header.stamp", "s"))
_NUMBERS = 37
_GYRO, _ACCEL = 4 + 9, 4 + 9 + 3 + 9
#: Size of the counter of ROS 1 or the encapsulation header of CDR, and of the header up to the name of the frame.
_PREFIX, _HEADER = 4, 12


class Messages(NamedTuple):
    """Messages that were read together."""

    recorded: FloatArray  #: Times of recording, s, shape (n,).
    data: NDArray[np.uint8]  #: Bytes that contain all messages.
    starts: IntArray  #: Position of the first byte of each message, shape (n,).
    lengths: IntArray  #: Number of bytes of each message, shape (n,).


def messages_of(messages: Iterable[tuple[float, bytes]]) -> Iterator[Messages]:
    """Yield messages in parts, given the time of recording, s, and the bytes of each."""
    stream = iter(messages)
    while part := list(itertools.islice(stream, CHUNK_ROWS)):
        lengths = np.array([len(data) for _, data in part])
        data = np.frombuffer(b"".join(data for _, data in part), np.uint8)
        yield Messages(np.array([recorded for recorded, _ in part]), data, np.cumsum(lengths) - lengths, lengths)


def imu_columns(messages: Messages, *, is_cdr: bool) -> Columns:
    """Return the columns of messages (of ROS 2 if `is_cdr`); a message that is too short becomes a row of NaN."""
    values = np.full((len(messages.starts), 1 + 6), np.nan)
    big = np.zeros(len(values), np.bool_)
    intact = messages.lengths >= _PREFIX + _HEADER
    if is_cdr:
        big[intact] = messages.data[messages.starts[intact] + 1] == 0
    for order, of_order in (("<", intact & ~big), (">", intact & big)):
        _decode(messages, np.flatnonzero(of_order), order, values, is_cdr)
    header = values[:, 0]
    is_stamped = np.nanmax(header, initial=0.0) > 0.0
    names = [name.format(axis) for name in ("angular_velocity.{}", "linear_acceleration.{}") for axis in "xyz"]
    columns = {"header.stamp": header if is_stamped else messages.recorded, "recorded": messages.recorded}
    return columns | dict(zip(names, values[:, 1:].T.copy(), strict=True))


def _decode(messages: Messages, rows: IntArray, order: str, values: FloatArray, is_cdr: bool) -> None:
    """Store the time of the header, s, angular velocity and linear acceleration of messages in their rows."""
    if not len(rows):
        return
    header = messages.starts[rows] + _PREFIX
    seconds, nanoseconds, name = _gather(messages.data, header, 3, f"{order}u4").T.astype(np.int64)
    begin = header + _HEADER + name
    if is_cdr:
        begin += -(begin - header) % 8
    fits = begin + 8 * _NUMBERS <= messages.starts[rows] + messages.lengths[rows]
    rows, begin = rows[fits], begin[fits]
    values[rows, 0] = seconds[fits] + 1e-9 * nanoseconds[fits]
    for first, number in ((1, _GYRO), (4, _ACCEL)):
        values[rows, first : first + 3] = _gather(messages.data, begin + 8 * number, 3, f"{order}f8")


def _gather(data: NDArray[np.uint8], starts: IntArray, count: int, kind: str) -> np.ndarray:
    """Return `count` numbers of a dtype, starting at each of n positions, shape (n, count)."""
    size = count * np.dtype(kind).itemsize
    return np.asarray(data[starts[:, None] + np.arange(size)].view(kind))
