"""Messages `sensor_msgs/Imu` of ROS 1 and ROS 2 as columns.

A message ends with orientation, angular velocity and linear acceleration, each with its covariance: 37 numbers.
Sources: ROS message definition sensor_msgs/Imu; OMG CDR (XCDR1) for ROS 2.
"""

import struct
from collections.abc import Iterable, Iterator

import numpy as np

from calstation.records.foreign.topics import CHUNK_ROWS, Columns, vector_columns

#: Names of the message type in ROS 1 and ROS 2.
IMU_TYPES = ("sensor_msgs/Imu", "sensor_msgs/msg/Imu")
#: Columns of the CSV format: the time is that of the header, or that of the recorder where no header has a time.
IMU_COLUMNS = vector_columns("angular_velocity.{}", "linear_acceleration.{}", ("rad/s", "m/s2"), ("header.stamp", "s"))
_NUMBERS = 37
_GYRO, _ACCEL = 4 + 9, 4 + 9 + 3 + 9


def imu_columns(messages: Iterable[tuple[float, bytes]], *, is_cdr: bool) -> Iterator[Columns]:
    """Yield the columns of messages in parts, given the time of recording, s, and the bytes of each message.

    A message that is too short is a damaged row of NaN. `is_cdr` tells ROS 2 from ROS 1.
    """
    rows: list[tuple[float, float]] = []
    numbers = np.empty((CHUNK_ROWS, _NUMBERS))
    for recorded, data in messages:
        rows.append((_decode(data, numbers[len(rows)], is_cdr), recorded))
        if len(rows) == CHUNK_ROWS:
            yield _columns(rows, numbers)
            rows = []
    if rows:
        yield _columns(rows, numbers[: len(rows)])


def _decode(data: bytes, numbers: np.ndarray, is_cdr: bool) -> float:
    """Store the numbers of a message, shape (37,), and return the time of its header, s."""
    order = ">" if is_cdr and data[1:2] == b"\0" else "<"
    start = 4  # after the encapsulation header of CDR, or after the counter of ROS 1
    try:
        seconds, nanoseconds, length = struct.unpack_from(f"{order}3I", data, start)
        begin = start + 12 + length
        if is_cdr:
            begin += -(begin - start) % 8
        numbers[:] = np.frombuffer(data, f"{order}f8", _NUMBERS, begin)
    except (struct.error, ValueError):
        numbers[:] = np.nan
        return np.nan
    return float(seconds + 1e-9 * nanoseconds)


def _columns(rows: list[tuple[float, float]], numbers: np.ndarray) -> Columns:
    header, recorded = np.array(rows).T
    values = {"header.stamp": header if np.nanmax(header, initial=0.0) > 0.0 else recorded, "recorded": recorded}
    for k, axis in enumerate("xyz"):
        values[f"angular_velocity.{axis}"] = numbers[:, _GYRO + k].copy()
        values[f"linear_acceleration.{axis}"] = numbers[:, _ACCEL + k].copy()
    return values
