"""MCAP files with `sensor_msgs/Imu` of ROS 1 or ROS 2, read in constant memory (https://mcap.dev/spec)."""

from collections.abc import Iterator
from pathlib import Path

from calstation.errors import InputError
from calstation.records.foreign.imu_message import IMU_COLUMNS, IMU_TYPES, imu_columns
from calstation.records.foreign.topics import Columns, ForeignFormat, Topic

_ENCODINGS = ("cdr", "ros1")


def _topics(path: Path) -> list[Topic]:
    from mcap.reader import make_reader

    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    if summary is None:
        raise InputError("foreign.no_summary", file=path)
    counts = summary.statistics.channel_message_counts if summary.statistics else {}
    topics = dict[str, Topic]()
    for number, channel in summary.channels.items():
        schema = summary.schemas.get(channel.schema_id)
        kind = schema.name if schema else channel.message_encoding
        is_imu = kind in IMU_TYPES and channel.message_encoding in _ENCODINGS
        earlier = topics[channel.topic].samples if channel.topic in topics else 0
        columns = IMU_COLUMNS if is_imu else {}
        topics[channel.topic] = Topic(channel.topic, kind, earlier + counts.get(number, 0), columns)
    return list(topics.values())


def _read(path: Path, topic: Topic) -> Iterator[Columns]:
    from mcap.reader import make_reader

    with path.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        encodings = {c.message_encoding for c in summary.channels.values() if c.topic == topic.name} if summary else {}
        messages = ((1e-9 * m.log_time, m.data) for _, _, m in reader.iter_messages([topic.name]))
        yield from imu_columns(messages, is_cdr="cdr" in encodings)


FORMAT = ForeignFormat("MCAP", (".mcap",), "mcap", _topics, _read)
