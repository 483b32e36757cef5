"""NovAtel OEM logs, ASCII and binary: RAWIMU, RAWIMUS, RAWIMUX and RAWIMUSX.

The messages contain increments in counts, y with the opposite sign. The X forms state the type of the IMU, which
determines the size of a count; otherwise the TOML states it. Source: OEM7 manual, RAWIMUSX, raw IMU scale factors.
"""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from calstation.physics import STANDARD_GRAVITY
from calstation.records.columns import COUNTS
from calstation.records.foreign.topics import CHUNK_ROWS, Columns, ForeignFormat, Topic, vector_columns

_RAW = ("RAWIMU", "RAWIMUS", "RAWIMUX", "RAWIMUSX")
_COLUMNS = vector_columns("gyro_{}", "accel_{}", (COUNTS, COUNTS), ("gps_seconds", "s"))
#: Numbers of a message after the status, in order, and their signs.
_FIELDS = ("accel_z", "accel_y", "accel_x", "gyro_z", "gyro_y", "gyro_x")
_SIGNS = np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
_DEGREE, _FOOT = float(np.pi / 180.0), 0.3048
_HONEYWELL = 2.0**-33
_KVH = (0.1 / (3600.0 * 256.0), 0.05 * 2.0**-15)
#: Sizes of a count, rad and m/s, by the type numbers of IMUs.
_SCALES = {
    (5, 20, 27, 28, 1, 11): (_HONEYWELL, 2.0**-27 * _FOOT),  # HG1900, HG1930, HG1700-AG11 and -AG58
    (4, 12): (_HONEYWELL, 2.0**-26 * _FOOT),  # HG1700-AG17 and -AG62
    (58, 68, 69): (_HONEYWELL, 2.0**-29),  # HG4930
    (8,): (2.0**-19, 2.0**-14),  # LN200
    (13,): (0.1 * 2.0**-8 * _DEGREE / 3600.0, 0.05 * 2.0**-15),  # iMAR FSAS
    (16, 33): _KVH,  # KVH COTS (CPT), KVH 1750
    (26, 52): (1e-9, 2e-8),  # ISA-100C, µIMU
    (31,): (720.0 * 2.0**-31 * _DEGREE, 200.0 * 2.0**-31),  # ADIS16488
    (32, 56): (2.0**-21 * _DEGREE, 2.0**-22),  # STIM300
    (41,): (0.008 * 2.0**-16 * _DEGREE / 125.0, 2e-4 * 2.0**-16 * STANDARD_GRAVITY / 125.0),  # Epson G320, 125 Hz
    (62,): (0.008 * 2.0**-16 * _DEGREE / 200.0, 2e-4 * 2.0**-16 * STANDARD_GRAVITY / 200.0),  # Epson G320, 200 Hz
    (61,): (0.0151515 * 2.0**-16 * _DEGREE / 200.0, 4e-4 * 2.0**-16 * STANDARD_GRAVITY / 200.0),  # Epson G370
}


def _topics(path: Path) -> list[Topic]:
    counts, types = Counter[str](), dict[str, int]()
    for name, message in _messages(path):
        counts[name] += 1
        if name in _RAW and name.endswith("X"):
            types.setdefault(name, message.imu_type)
    return [Topic(name, name, count, *_known(name, types.get(name))) for name, count in counts.items()]


def _known(name: str, imu_type: int | None) -> tuple[dict[str, tuple[str, str]], dict[str, float | str]]:
    """Return the columns of a message, and the entries of `[imu]` that the type of the IMU determines."""
    if name not in _RAW:
        return {}, {}
    scale = next((scale for types, scale in _SCALES.items() if imu_type in types), None)
    sizes = {} if scale is None else {"gyro_lsb": scale[0], "accel_lsb": scale[1]}
    return _COLUMNS, {"output": "increment", **sizes}


def _read(path: Path, topic: Topic) -> Iterator[Columns]:
    rows = list[list[float]]()
    for name, message in _messages(path):
        if name == topic.name:
            rows.append([message.gps_seconds, *message.get_field_values()[-6:]])
        if len(rows) == CHUNK_ROWS:
            yield _columns(rows)
            rows = []
    if rows:
        yield _columns(rows)


def _columns(rows: list[list[float]]) -> Columns:
    numbers = np.array(rows, np.float64)
    return {"gps_seconds": numbers[:, 0], **dict(zip(_FIELDS, (numbers[:, 1:] * _SIGNS).T + 0.0, strict=True))}


def _messages(path: Path) -> Iterator[tuple[str, Any]]:
    """Yield name and content of the messages whose checksum is right."""
    from novatel_edie.oem import FileParser, Message

    for message in FileParser(str(path)):
        if isinstance(message, Message):
            yield message.name, message


FORMAT = ForeignFormat(
    "NovAtel OEM",
    (".gps", ".nov", ".asc", ".bin", ".log", ".raw", ".txt"),
    "novatel-edie",
    _topics,
    _read,
    rb"\xaaD[\x12\x13]|[#%]RAWIMUS?X?A,",
)
