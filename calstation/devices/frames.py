"""Decodes a byte stream into sample frames and command replies, in bulk and the same however it was cut."""

from dataclasses import dataclass

import numpy as np

from calstation.devices.checks import CRC_WIDTHS, check_bytes
from calstation.devices.imu_profile import CommandSection, FrameSection, hex_bytes, numpy_type
from calstation.physics.arrays import FloatArray, IntArray

Frames = np.ndarray[tuple[int], np.dtype[np.void]]
_REPLY_HEADER = 2  # op, payload length


@dataclass(frozen=True)
class Reply:
    """A reply's op and payload."""

    op: int
    payload: bytes


@dataclass(frozen=True)
class Decoded:
    """What further bytes completed: raw sample frames, structured, shape (n,), and replies in order."""

    frames: Frames
    replies: tuple[Reply, ...]


class FrameDecoder:
    """Finds frames by their sync bytes and check; what fits neither is skipped byte by byte.

    A partial frame is kept until its rest comes, so the result does not depend on how the stream was cut.

    Attributes
    ----------
    crc_errors : frames whose check was wrong; skipped : bytes that belong to no frame
    since_frame : bytes skipped since the last whole frame or reply
    """

    def __init__(self, frame: FrameSection, commands: CommandSection) -> None:
        self._sync = hex_bytes(frame.sync)
        self._reply_sync = hex_bytes(commands.reply_sync)
        self._crc = frame.crc.kind
        self._crc_start = frame.crc.start
        self._crc_width = CRC_WIDTHS[frame.crc.kind]
        self._reply_crc = commands.crc
        self._reply_crc_width = CRC_WIDTHS[commands.crc]
        self._order = frame.byte_order
        fields: list[tuple[str, np.dtype[np.generic]]] = [("sync", np.dtype(f"V{len(self._sync)}"))]
        fields += [(f.name, numpy_type(f.type, frame.byte_order)) for f in frame.fields]
        fields += [("crc", np.dtype(f"V{self._crc_width}"))]
        self.dtype = np.dtype(fields)
        self._size = self.dtype.itemsize
        self._scales = {f.name: f.scale for f in frame.fields}
        self._buffer = b""
        self.crc_errors = 0
        self.skipped = 0
        self.since_frame = 0

    def feed(self, data: bytes) -> Decoded:
        """Take further bytes and give what they complete."""
        buffer = self._buffer + data
        replies: list[Reply] = []
        runs: list[tuple[int, int]] = []
        place = 0
        while True:
            start = self._next_sync(buffer, place)
            self._skip(start - place)
            place = start
            if place >= len(buffer):
                break
            if buffer.startswith(self._sync, place):
                end = self._run_end(buffer, place)
                if end > place:
                    runs.append((place, end))
                    place = end
                    self.since_frame = 0
                    continue
                if len(buffer) - place < self._size:
                    break
            elif buffer.startswith(self._reply_sync, place):
                size = self._reply_size(buffer, place)
                if size is None or len(buffer) - place < size:
                    break
                reply = self._reply(buffer[place : place + size])
                if reply is not None:
                    replies.append(reply)
                    place += size
                    self.since_frame = 0
                    continue
            else:  # the beginning of a sync at the very end
                break
            self.crc_errors += 1
            self._skip(1)
            place += 1
        self._buffer = buffer[place:]
        whole = b"".join(buffer[a:b] for a, b in runs)
        return Decoded(np.frombuffer(whole, self.dtype), tuple(replies))

    def samples(self, frames: Frames) -> tuple[IntArray, FloatArray, FloatArray, IntArray]:
        """Raw counter (n,), counts (n, 6), temperature in °C (n,) and status word (n,) of frames."""
        columns = [frames[name].astype(np.float64) * self._scales[name] for name in _CHANNEL_NAMES]
        names = frames.dtype.names or ()
        count = len(frames)
        heat = np.full(count, np.nan)
        if "temperature" in names:
            heat = frames["temperature"].astype(np.float64) * self._scales["temperature"]
        status = frames["status"].astype(np.int64) if "status" in names else np.zeros(count, np.int64)
        return frames["counter"].astype(np.int64), np.column_stack(columns), heat, status

    @property
    def size(self) -> int:
        """Bytes of a sample frame."""
        return self._size

    def _skip(self, count: int) -> None:
        self.skipped += count
        self.since_frame += count

    def _next_sync(self, buffer: bytes, place: int) -> int:
        """First place from which a frame or reply begins, or may begin once more bytes have come."""
        found = [p for s in (self._sync, self._reply_sync) if (p := buffer.find(s, place)) >= 0]
        if found:
            return min(found)
        longest = max(len(self._sync), len(self._reply_sync))
        for start in range(max(place, len(buffer) - longest + 1), len(buffer)):
            tail = buffer[start:]
            if self._sync.startswith(tail) or self._reply_sync.startswith(tail):
                return start
        return len(buffer)

    def _run_end(self, buffer: bytes, place: int) -> int:
        """End of the longest run of sound frames from `place`."""
        size, crc_at = self._size, self._size - self._crc_width
        while len(buffer) - place >= size and buffer.startswith(self._sync, place):
            body = buffer[place + self._crc_start : place + crc_at]
            if check_bytes(self._crc, body, self._order) != buffer[place + crc_at : place + size]:
                break
            place += size
        return place

    def _reply_size(self, buffer: bytes, place: int) -> int | None:
        header = len(self._reply_sync)
        if len(buffer) - place < header + _REPLY_HEADER:
            return None
        return header + _REPLY_HEADER + buffer[place + header + 1] + self._reply_crc_width

    def _reply(self, frame: bytes) -> Reply | None:
        body = frame[len(self._reply_sync) : -self._reply_crc_width]
        if check_bytes(self._reply_crc, body, self._order) != frame[-self._reply_crc_width :]:
            return None
        return Reply(body[0], body[_REPLY_HEADER:])


_CHANNEL_NAMES = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")


def command_frame(commands: CommandSection, frame: FrameSection, op: int, payload: bytes) -> bytes:
    """A request as it goes out: sync, op, length, payload, check."""
    body = bytes([op, len(payload)]) + payload
    return hex_bytes(commands.request_sync) + body + check_bytes(commands.crc, body, frame.byte_order)
