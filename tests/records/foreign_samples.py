"""Samples of which recordings in the formats of other programs are made, and the CSV with which they are compared."""

import struct
from pathlib import Path

import numpy as np

from calstation.records import open_log
from tests.records.records_samples import joined

COUNT = 300
NAMES = ("time_s", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
TOML = (
    "[site]\nlatitude_deg = 34.25\nlongitude_deg = 108.9\nheight_m = 400.0\n"
    '[imu]\nserial = "H7"\nsample_rate_hz = 50.0\ngyro_arw = 4.4e-5\naccel_vrw = 5.9e-4\n'
)
UNITS = "[columns]\n" + "".join(
    f'{name} = {{ from = "{name}", unit = "{"rad/s" if "gyro" in name else "m/s2"}" }}\n' for name in NAMES[1:]
)


def samples() -> np.ndarray:
    """Return times, s, rates, rad/s, and specific forces, m/s², shape (n, 7), with a gap; times in whole µs."""
    random = np.random.default_rng(3)
    seconds = 1_700_000_000 + 0.02 * np.array([k for k in range(COUNT) if k not in (100, 101)])
    values = random.normal([0, 0, 0, 0, 0, 9.8], 0.01, (len(seconds), 6)).astype(np.float32).astype(np.float64)
    return np.column_stack([stamps(seconds)[2], values])


def stamps(seconds: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times as seconds, nanoseconds, and as number."""
    whole = np.floor(seconds).astype(np.int64)
    nanoseconds = 1000 * np.rint((seconds - whole) * 1e6).astype(np.int64)
    return whole, nanoseconds, whole + 1e-9 * nanoseconds


def assert_same_as_csv(
    path: Path, rows: np.ndarray, topic: str | None = None, units: str = UNITS, toml: str = TOML
) -> None:
    """Compare the log of a recording with the log of the CSV of the same numbers; `units` is added to its TOML."""
    csv = path.parent / "plain.csv"
    csv.write_text("\n".join([",".join(NAMES), *(",".join(map(repr, row)) for row in rows.tolist())]))
    csv.with_suffix(".toml").write_text(TOML + units)
    path.with_suffix(".toml").write_text(toml)
    expected, log = open_log(csv), open_log(path, None, topic)
    assert log.meta == expected.meta
    found, wanted = joined(list(log.blocks())), joined(list(expected.blocks()))
    for name, column in wanted.items():
        np.testing.assert_array_equal(found[name], column, err_msg=name)
    assert log.facts().sha256 == expected.facts().sha256
    assert log.facts().gaps == 1


def imu_message(row: np.ndarray, *, is_cdr: bool) -> bytes:
    """Return a message sensor_msgs/Imu with the samples of a row."""
    seconds, nanoseconds, _ = stamps(row[:1])
    frame = b"imu_link\0" if is_cdr else b"imu_link"
    head = struct.pack("<3I", int(seconds[0]), int(nanoseconds[0]), len(frame)) + frame
    head += bytes(-len(head) % 8 if is_cdr else 0)
    numbers = np.concatenate([[0, 0, 0, 1], np.zeros(9), row[1:4], np.zeros(9), row[4:], np.zeros(9)])
    return (b"\0\1\0\0" if is_cdr else struct.pack("<I", 7)) + head + numbers.tobytes()
