"""ROS 1 bags (`.bag`) and ROS 2 bags (a folder with `metadata.yaml`, or its `.db3`) with `sensor_msgs/Imu`."""

from collections.abc import Iterator
from pathlib import Path

from calstation.records.foreign.imu_message import IMU_COLUMNS, IMU_TYPES, imu_columns, messages_of
from calstation.records.foreign.topics import Columns, ForeignFormat, Topic


def _topics(path: Path) -> list[Topic]:
    from rosbags.highlevel import AnyReader

    with AnyReader([_bag(path)]) as reader:
        infos = reader.topics
    kinds = {name: info.msgtype or "?" for name, info in infos.items()}
    columns = {name: IMU_COLUMNS if kind in IMU_TYPES else {} for name, kind in kinds.items()}
    return [Topic(name, kinds[name], info.msgcount, columns[name]) for name, info in infos.items()]


def _read(path: Path, topic: Topic) -> Iterator[Columns]:
    from rosbags.highlevel import AnyReader

    with AnyReader([_bag(path)]) as reader:
        connections = [each for each in reader.connections if each.topic == topic.name]
        messages = ((1e-9 * time, data) for _, time, data in reader.messages(connections))
        for part in messages_of(messages):
            yield imu_columns(part, is_cdr=reader.is2)


def _bag(path: Path) -> Path:
    """Return the folder of a ROS 2 bag, given one of its files."""
    return path.parent if path.suffix == ".db3" and (path.parent / "metadata.yaml").is_file() else path


FORMAT = ForeignFormat("ROS bag", (".bag", ".db3"), "rosbags", _topics, _read)
