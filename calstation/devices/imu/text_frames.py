"""Lines of text with a checksum in a byte stream, and samples in columns of such lines."""

from collections.abc import Sequence

import numpy as np

from calstation.devices.codecs import number
from calstation.devices.imu.binary_frames import Columns
from calstation.devices.profiles import FrameField, FrameSection

#: Bound below which floats represent integers exactly.
_MAX_EXACT_INTEGER = 2.0**53


class TextLine:
    """A line that consists of sync, body, mark, checksum in hexadecimal, and tail."""

    def __init__(self, frame: FrameSection) -> None:
        self.sync = frame.sync_bytes
        self._crc, self._check = frame.crc, frame.crc.function()
        self._mark, self._tail = frame.mark.encode(), frame.tail_bytes
        self._max_size = frame.max_size

    def size(self, buffer: bytes, start: int) -> int | None:
        """Return the size of the line at `start`; see `PacketKind`."""
        end = buffer.find(self._tail, start, start + self._max_size)
        if end >= 0:
            return end - start + len(self._tail)
        return 0 if len(buffer) - start >= self._max_size else None

    def is_valid(self, packet: bytes) -> bool:
        """Return whether the checksum of a line is correct."""
        body, mark, stated = packet[: -len(self._tail)].rpartition(self._mark)
        if not mark:
            return False
        check = f"{self._check(body[self._crc.start :]):0{2 * self._crc.size}X}"
        return stated.upper() == check.encode()

    def body(self, packet: bytes) -> bytes:
        """Return a line without its checksum."""
        return packet.rpartition(self._mark)[0]


class TextFrame(TextLine):
    """Lines of numbers in ASCII with a checksum."""

    def __init__(self, frame: FrameSection) -> None:
        super().__init__(frame)
        self._separator = frame.separator
        self._fields = [f for f in frame.fields if not f.is_spare]
        #: Column of each field, from 0 after the first separator.
        self.column_of: dict[str, int] = {}
        column = -1
        for f in frame.fields:
            column = column + 1 if f.at is None else f.at
            self.column_of[f.name] = column
        #: Smallest size of a line in bytes.
        self.min_frame_size = len(self.sync) + 2 * frame.crc.size + 1 + len(frame.tail_bytes)

    def is_sample(self, packet: bytes) -> bool:
        """Return whether the header of a line is that of samples."""
        return self.body(packet)[len(self.sync) :].startswith(self._separator.encode())

    def columns(self, packets: Sequence[bytes]) -> Columns:
        """Return the numbers in valid lines; any other text counts as absent and has the value 0 or NaN."""
        begin = len(self.sync) + 1
        rows = [self.body(p)[begin:].decode("ascii", "replace").split(self._separator) for p in packets]
        columns = Columns({}, {})
        for f in self._fields:
            numbers = np.array([_parsed(row, self.column_of[f.name], f) for row in rows], np.float64)
            present = np.isfinite(numbers)
            if number(f.type).is_integer:
                present &= np.abs(numbers) < _MAX_EXACT_INTEGER
                columns.values[f.name] = np.where(present, numbers, 0.0).astype(np.int64)
            else:
                columns.values[f.name] = numbers
            columns.present[f.name] = present
        return columns


def _parsed(row: list[str], column: int, f: FrameField) -> float:
    if column >= len(row) or not row[column].startswith(f.prefix):
        return np.nan
    text = row[column][len(f.prefix) :]
    try:
        return float(text) if f.base == 10 else float(int(text, 16))
    except (ValueError, OverflowError):
        return np.nan
