"""Decoding of a byte stream into samples and replies to commands, regardless of how the stream is divided."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calstation.devices.codecs import PacketKind, Reply, ReplyKind
from calstation.devices.imu.binary_frames import BinaryFrame, Columns
from calstation.devices.imu.sample_count import whole_ticks
from calstation.devices.imu.text_frames import TextFrame
from calstation.devices.profiles import CHANNELS, STATUS_WORDS, FrameSection
from calstation.physics import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Frames:
    """Valid frames with sample fields, in order, as bytes and as raw numbers of the fields."""

    raw: tuple[bytes, ...]
    columns: Columns

    def __len__(self) -> int:
        return len(self.raw)

    @property
    def complete(self) -> BoolArray:
        """Mask of the frames that contain the counter and all six channels, shape (n,)."""
        names, present = ("counter", *CHANNELS), self.columns.present
        if not set(names) <= present.keys():
            return np.zeros(len(self), np.bool_)
        finite = np.isfinite(self.columns.values["counter"])
        return np.asarray(np.logical_and.reduce([finite, *(present[name] for name in names)]))


class Samples(NamedTuple):
    """Raw counter, shape (n,), counts, shape (n, 6), temperature, °C, shape (n,), and status word, shape (n,)."""

    counter: IntArray
    counts: FloatArray
    temperature: FloatArray
    status: IntArray


@dataclass(frozen=True)
class DecodedPackets:
    """Sample frames and replies that were completed by new bytes, in order."""

    frames: Frames
    replies: tuple[Reply, ...]


class FrameDecoder:
    """Finds packets by their sync bytes and checksum, and skips all other bytes one by one.

    A partial packet is kept until the rest arrives, so that the result does not depend on how the stream is divided.

    crc_errors : number of packets with a wrong checksum
    skipped : number of bytes outside packets
    others : number of valid packets without sample fields
    bytes_since_frame : number of bytes skipped since the last valid packet
    """

    def __init__(self, frame: FrameSection, replies: ReplyKind | None = None) -> None:
        self._frame: BinaryFrame | TextFrame = TextFrame(frame) if frame.format == "text" else BinaryFrame(frame)
        self._replies = replies
        kinds: list[PacketKind] = [self._frame, *([replies] if replies else [])]
        # If one sync is the beginning of another, the longer one is compared first.
        self._kinds = sorted(kinds, key=lambda kind: -len(kind.sync))
        self._fields = {f.name: f for f in frame.fields}
        self._no_frames = Frames((), self._frame.columns(()))
        self._buffer = b""
        self.crc_errors = 0
        self.skipped = 0
        self.others = 0
        self.bytes_since_frame = 0

    def feed(self, data: bytes) -> DecodedPackets:
        """Return the packets that new bytes complete."""
        buffer = self._buffer + data
        replies: list[Reply] = []
        packets: list[bytes] = []
        search = _SyncSearch(buffer, [kind.sync for kind in self._kinds])
        start = 0
        while (begin := search.next(start)) < len(buffer):
            self._skip(begin - start)
            start = begin
            size, kind = self._packet(buffer, start)
            if size is None:
                break
            if kind is None:
                self.crc_errors += 1
                self._skip(1)
                start += 1
                continue
            packet = buffer[start : start + size]
            start += size
            self.bytes_since_frame = 0
            if kind is self._frame:
                if self._frame.is_sample(packet):
                    packets.append(packet)
                else:
                    self.others += 1
            elif self._replies is not None:
                replies.append(self._replies.reply(packet))
        else:
            self._skip(len(buffer) - start)
            start = len(buffer)
        self._buffer = buffer[start:]
        frames = Frames(tuple(packets), self._frame.columns(packets)) if packets else self._no_frames
        return DecodedPackets(frames, tuple(replies))

    def samples(self, frames: Frames) -> Samples:
        """Return the samples in complete frames; counts are raw × scale + offset with the values in the profile."""
        complete = frames.complete
        rows = slice(None) if complete.all() else complete
        values = frames.columns.values
        if "counter" not in values or not len(frames):
            return Samples(np.empty(0, np.int64), np.empty((0, 6)), np.empty(0), np.empty(0, np.int64))
        counter = whole_ticks(self._fields["counter"], values["counter"][rows])
        counts = np.empty((len(counter), 6))
        for i, name in enumerate(CHANNELS):
            f = self._fields[name]
            counts[:, i] = values[name][rows] * f.scale + f.offset
        temperature = np.full(len(counter), np.nan)
        if "temperature" in values:
            f, has_temperature = self._fields["temperature"], frames.columns.present["temperature"][rows]
            temperature[has_temperature] = values["temperature"][rows][has_temperature] * f.scale + f.offset
        status = np.zeros(len(counter), dtype=np.int64)
        for i, name in enumerate(STATUS_WORDS):
            if name in values:
                status |= values[name][rows].astype(np.int64) << 16 * i
        return Samples(counter, counts, temperature, status)

    @property
    def size(self) -> int:
        """Size of the shortest sample frame in bytes."""
        return self._frame.min_frame_size

    def _skip(self, count: int) -> None:
        self.skipped += count
        self.bytes_since_frame += count

    def _packet(self, buffer: bytes, start: int) -> tuple[int | None, PacketKind | None]:
        """Return the size and kind of the packet at `start`; the size is None if more bytes are needed."""
        is_incomplete = False
        for kind in self._kinds:
            if not buffer.startswith(kind.sync, start):
                # Only the last bytes of the buffer can be an incomplete sync.
                is_incomplete |= kind.sync.startswith(buffer[start : start + len(kind.sync)])
                continue
            size = kind.size(buffer, start)
            if size is None or (size and start + size > len(buffer)):
                is_incomplete = True
            elif size and kind.is_valid(buffer[start : start + size]):
                return size, kind
        return (None if is_incomplete else 0), None


class _SyncSearch:
    """Finds the indices in a buffer at which a sync begins, or may begin once more bytes arrive."""

    def __init__(self, buffer: bytes, syncs: Iterable[bytes]) -> None:
        self._buffer = buffer
        self._syncs = tuple(syncs)
        self._next_index = dict.fromkeys(self._syncs, -1)

    def next(self, start: int) -> int:
        """Return the first index of a sync from `start` on, or the buffer's length if there is none."""
        nearest = len(self._buffer)
        for sync in self._syncs:
            # The next index of each sync is cached, because a search from every packet would take quadratic time.
            if self._next_index[sync] < start:
                at = self._buffer.find(sync, start)
                self._next_index[sync] = at if at >= 0 else self._partial(sync, start)
            nearest = min(nearest, self._next_index[sync])
        return nearest

    def _partial(self, sync: bytes, start: int) -> int:
        """Return the index of a partial `sync` at the end of the buffer, or the buffer's length if there is none."""
        end = len(self._buffer)
        for begin in range(max(start, end - len(sync) + 1), end):
            if sync.startswith(self._buffer[begin:]):
                return begin
        return end
