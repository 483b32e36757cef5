"""ROS 1 bags (`.bag`) and ROS 2 bags (a folder with `metadata.yaml`, or its `.db3`) with `sensor_msgs/Imu`."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from calstation.errors import InputError
from calstation.records.foreign.imu_message import IMU_COLUMNS, IMU_TYPES, imu_columns, messages_of
from calstation.records.foreign.topics import Columns, ForeignFormat, Topic
from calstation.records.foreign.unpacking import Unpacking

#: Largest description of a ROS 2 bag, bytes.
_MAX_DESCRIPTION = 1 << 20


def _topics(path: Path) -> list[Topic]:
    with _opened(path) as reader:
        infos = reader.topics
    kinds = {name: info.msgtype or "?" for name, info in infos.items()}
    columns = {name: IMU_COLUMNS if kind in IMU_TYPES else {} for name, kind in kinds.items()}
    return [Topic(name, kinds[name], info.msgcount, columns[name]) for name, info in infos.items()]


def _read(path: Path, topic: Topic) -> Iterator[Columns]:
    with _opened(path) as reader:
        connections = [each for each in reader.connections if each.topic == topic.name]
        messages = ((1e-9 * time, data) for _, time, data in reader.messages(connections))
        for part in messages_of(messages):
            yield imu_columns(part, is_cdr=reader.is2)


def _opened(path: Path) -> Any:
    """Return the reader of a bag, which unpacks no more than permitted and executes no query. Raises InputError."""
    from rosbags import rosbag1, rosbag2
    from rosbags.highlevel import AnyReader

    bag = _bag(path)
    unpacking = Unpacking(bag)
    rosbag1.reader.decompressors.update(bz2=unpacking.bz2, lz4=unpacking.lz4)
    rosbag2.storage_mcap.DECOMPRESSORS.update(lz4=unpacking.lz4, zstd=unpacking.zstd)
    reader: Any = rosbag2.reader
    reader.zstd = SimpleNamespace(open=unpacking.open, decompress=unpacking.zstd)
    for kind, name in ((reader.Reader, ".db3"), (reader.DirectoryReader, "sqlite3")):
        kind.STORAGE_PLUGINS = {**kind.STORAGE_PLUGINS, name: _database}
    if (bag / "metadata.yaml").is_file() and (bag / "metadata.yaml").stat().st_size > _MAX_DESCRIPTION:
        raise InputError("foreign.too_large", file=bag / "metadata.yaml")
    return AnyReader([bag])


def _database(path: Path) -> Any:
    """Return the reader of a database. Raises ValueError if it contains a query, which may never end."""
    from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

    query = "SELECT name FROM sqlite_master WHERE type IN ('view', 'trigger') OR sql LIKE 'CREATE VIRTUAL%'"
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?immutable=1", uri=True)) as database:
        if (row := database.execute(query).fetchone()) is not None:
            raise ValueError(f"'{row[0]}' is not a table")
    return Sqlite3Reader(path)


def _bag(path: Path) -> Path:
    """Return the folder of a ROS 2 bag, given one of its files."""
    return path.parent if path.suffix == ".db3" and (path.parent / "metadata.yaml").is_file() else path


FORMAT = ForeignFormat("ROS bag", (".bag", ".db3"), "rosbags", _topics, _read)
