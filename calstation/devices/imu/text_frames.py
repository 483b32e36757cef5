"""Lines of text in a byte stream: samples in columns, and other lines with a check before their end."""

from collections.abc import Sequence

import numpy as np

from calstation.devices.codecs import number
from calstation.devices.imu.binary_frames import Columns
from calstation.devices.profiles import FrameField, FrameSection

#: Bound below which whole numbers are exact as floats.
_EXACT = 2.0**53


class TextFrame:
    """Lines of numbers in ASCII, with a check in hexadecimal before their end.

    Parameters
    ----------
    frame : the profile's section
    """

    def __init__(self, frame: FrameSection) -> None:
        self.sync = frame.sync_bytes
        self._frame = frame
        self._fields = [f for f in frame.fields if not f.name.startswith("spare")]
        self._line = TextLine(self.sync, frame)
        columns = [f.at for f in frame.fields]
        for i, at in enumerate(columns):
            if at is None:
                columns[i] = 0 if i == 0 else (columns[i - 1] or 0) + 1
        #: Column of each field, from 0 after the first separator.
        self.column_of = {f.name: at or 0 for f, at in zip(frame.fields, columns, strict=True)}
        #: Smallest size of a line in bytes.
        self.shortest = len(self.sync) + 2 * frame.crc.size + 1 + len(frame.tail_bytes)

    def size(self, buffer: bytes, place: int) -> int | None:
        """See `PacketKind`."""
        return self._line.size(buffer, place)

    def is_valid(self, packet: bytes) -> bool:
        """See `PacketKind`."""
        return self._line.is_valid(packet)

    def is_sample(self, packet: bytes) -> bool:
        """Whether its header is the samples', not only a longer one with the same beginning."""
        return self._line.body(packet)[len(self.sync) :].startswith(self._frame.separator.encode())

    def columns(self, packets: Sequence[bytes]) -> Columns:
        """Numbers of valid lines; other text counts as absent, with the value NaN."""
        rows = [
            self._line.body(p)[len(self.sync) + 1 :].decode("ascii", "replace").split(self._frame.separator)
            for p in packets
        ]
        found = Columns({}, {})
        for f in self._fields:
            numbers = np.array([_parsed(row, self.column_of[f.name], f) for row in rows], np.float64)
            present = np.isfinite(numbers)
            if number(f.type).whole:
                present &= np.abs(numbers) < _EXACT
                numbers = np.where(present, numbers, 0.0)
                found.values[f.name] = numbers.astype(np.int64)
            else:
                found.values[f.name] = numbers
            found.present[f.name] = present
        return found


class TextLine:
    """A line with a check: sync ... mark, check in hexadecimal, tail.

    Parameters
    ----------
    sync : its first characters
    frame : check, mark, tail and largest size
    """

    def __init__(self, sync: bytes, frame: FrameSection) -> None:
        self.sync = sync
        self._crc, self._check = frame.crc, frame.crc.function()
        self._mark, self._tail = frame.mark.encode(), frame.tail_bytes
        self._max_size = frame.max_size

    def size(self, buffer: bytes, place: int) -> int | None:
        """See `PacketKind`."""
        end = buffer.find(self._tail, place, place + self._max_size)
        if end >= 0:
            return end - place + len(self._tail)
        return 0 if len(buffer) - place >= self._max_size else None

    def is_valid(self, packet: bytes) -> bool:
        """See `PacketKind`."""
        body, mark, told = packet[: -len(self._tail)].rpartition(self._mark)
        if not mark:
            return False
        check = f"{self._check(body[self._crc.start :]):0{2 * self._crc.size}X}"
        return told.upper() == check.encode()

    def body(self, packet: bytes) -> bytes:
        """The line up to the mark."""
        return packet.rpartition(self._mark)[0]


def _parsed(row: list[str], column: int, f: FrameField) -> float:
    if column >= len(row) or not row[column].startswith(f.prefix):
        return np.nan
    text = row[column][len(f.prefix) :]
    try:
        return float(text) if f.base == 10 else float(int(text, 16))
    except (ValueError, OverflowError):
        return np.nan
