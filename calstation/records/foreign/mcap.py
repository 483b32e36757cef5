"""MCAP files with `sensor_msgs/Imu` of ROS 1 or ROS 2, read in constant memory (https://mcap.dev/spec)."""

import itertools
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import numpy as np

from calstation.errors import InputError
from calstation.records.foreign.imu_message import IMU_COLUMNS, IMU_TYPES, Messages, imu_columns, messages_of
from calstation.records.foreign.topics import CHUNK_ROWS, Columns, ForeignFormat, Topic
from calstation.records.foreign.unpacking import MAX_CHUNK, Unpacking

_ENCODINGS = ("cdr", "ros1")
#: Sizes of the start of a record (kind and length), and of the fields of a message before its data.
_RECORD, _MESSAGE = 1 + 8, 2 + 4 + 8 + 8


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
    from mcap import stream_reader
    from mcap.reader import make_reader

    unpacking = Unpacking(path)
    vars(stream_reader).update(
        lz4=SimpleNamespace(decompress=unpacking.lz4), zstandard=SimpleNamespace(decompress=unpacking.zstd)
    )
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        channels = {k: c for k, c in summary.channels.items() if c.topic == topic.name} if summary else {}
        is_cdr = "cdr" in {channel.message_encoding for channel in channels.values()}
        chunks = sorted(summary.chunk_indexes, key=lambda index: index.message_start_time) if summary else []
        if any(chunk.uncompressed_size > MAX_CHUNK for chunk in chunks):
            raise InputError("foreign.too_large", file=path)
        if _are_indexed(chunks):
            parts: Iterator[Messages] = (part for chunk in chunks for part in _messages(stream, chunk, channels))
        else:
            is_ordered = bool(chunks)  # without chunks, the library would keep all messages to order them
            messages = reader.iter_messages([topic.name], log_time_order=is_ordered)
            parts = messages_of((1e-9 * message.log_time, message.data) for _, _, message in messages)
        for part in parts:
            yield imu_columns(part, is_cdr=is_cdr)


def _are_indexed(chunks: Sequence[Any]) -> bool:
    """Return whether the chunks follow each other in time, and each has an index of its messages."""
    follow = all(a.message_end_time <= b.message_start_time for a, b in itertools.pairwise(chunks))
    return bool(chunks) and follow and all(chunk.message_index_offsets for chunk in chunks)


def _messages(stream: BinaryIO, chunk: Any, channels: Collection[int]) -> Iterator[Messages]:
    """Yield the messages of channels in a chunk, ordered by their times, without an object for each."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk
    from mcap.stream_reader import get_chunk_data_stream

    indexes = [np.empty((0, 2), np.int64)]
    for channel in sorted(chunk.message_index_offsets.keys() & channels):
        stream.seek(chunk.message_index_offsets[channel] + _RECORD + 2)
        size = int.from_bytes(stream.read(4), "little")
        indexes.append(np.frombuffer(stream.read(size), "<i8").reshape(-1, 2))
    times, starts = np.concatenate(indexes).T
    if not len(times):
        return
    order = np.lexsort((starts, times))
    times, starts = times[order], starts[order]
    stream.seek(chunk.chunk_start_offset + _RECORD)
    record = Chunk.read(ReadDataStream(stream))
    if record.uncompressed_size != chunk.uncompressed_size:
        raise ValueError("a chunk and its index differ in size")
    content, size = get_chunk_data_stream(record, validate_crc=True)
    data = np.frombuffer(content.read(size), np.uint8)
    lengths = data[starts[:, None] + np.arange(1, _RECORD)].view("<i8")[:, 0] - _MESSAGE
    for first in range(0, len(times), CHUNK_ROWS):
        part = slice(first, first + CHUNK_ROWS)
        yield Messages(1e-9 * times[part], data, starts[part] + _RECORD + _MESSAGE, lengths[part])


FORMAT = ForeignFormat("MCAP", (".mcap",), "mcap", _topics, _read)
