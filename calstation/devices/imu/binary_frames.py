"""Binary frames in a byte stream: their size, validity and numbers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calstation.devices.codecs import ByteOrder, number
from calstation.devices.profiles import FrameField, FrameSection, hex_bytes
from calstation.physics import BoolArray, FloatArray, IntArray

Column = FloatArray | IntArray


@dataclass(frozen=True)
class Columns:
    """Raw numbers of each field (0 or NaN if absent) and mask of the packets that contain it, both of shape (n,)."""

    values: dict[str, Column]
    present: dict[str, BoolArray]


class BinaryFrame:
    """A binary frame format with a fixed layout, with a length field, or with items that have ids."""

    def __init__(self, frame: FrameSection) -> None:
        self.sync = frame.sync_bytes
        self._frame = frame
        self._fields = [f for f in frame.fields if not f.is_spare]
        self._check, self._check_size = frame.crc.function(), frame.crc.size
        self._check_order = frame.crc.byte_order or frame.byte_order
        self._tail = frame.tail_bytes
        self._id = hex_bytes(frame.id.value) if frame.id else b""
        self._positions = [(f, at) for f, at, _ in frame.positions() if not f.is_spare]
        #: Smallest size of a frame in bytes.
        self.min_frame_size = frame.min_size()
        if frame.length is not None:
            header = max(len(self.sync), frame.length.at + number(frame.length.type).width)
            self.min_frame_size = header + self._check_size + len(self._tail)
        self._layouts: dict[tuple[int, bytes], Layout] = {}

    def size(self, buffer: bytes, start: int) -> int | None:
        """Return the size of the frame at `start`; see `PacketKind`."""
        length = self._frame.length
        if length is None:
            return self.min_frame_size
        at, width = start + length.at, number(length.type).width
        if len(buffer) < at + width:
            return None
        stated = int.from_bytes(buffer[at : at + width], self._frame.byte_order)
        size = stated + length.adds
        if length.extended and stated == (1 << 8 * width) - 1:
            extra = number(length.extended).width
            if len(buffer) < at + width + extra:
                return None
            stated = int.from_bytes(buffer[at + width : at + width + extra], self._frame.byte_order)
            size = stated + length.adds + extra
        return size if self.min_frame_size <= size <= self._frame.max_size else 0

    def is_valid(self, packet: bytes) -> bool:
        """Return whether the tail, checksum and items of a frame are correct."""
        end = len(packet) - len(self._tail) - self._check_size
        if not packet.endswith(self._tail):
            return False
        check = int.from_bytes(packet[end : end + self._check_size], self._check_order)
        if self._check(packet[self._frame.crc.start : end]) != check:
            return False
        return not self.is_sample(packet) or self._items(packet) is not None

    def is_sample(self, packet: bytes) -> bool:
        """Return whether a valid packet has the id of sample frames."""
        at = self._frame.id.at if self._frame.id else 0
        return packet[at : at + len(self._id)] == self._id

    def columns(self, packets: Sequence[bytes]) -> Columns:
        """Return the numbers in valid packets; all packets with the same layout are decoded together."""
        groups: dict[tuple[int, bytes], list[int]] = {}
        for row, packet in enumerate(packets):
            groups.setdefault(self._layout_key(packet), []).append(row)
        values = {f.name: _absent_column(f, len(packets)) for f in self._fields}
        present = {f.name: np.zeros(len(packets), np.bool_) for f in self._fields}
        for key, rows in groups.items():
            layout = self._layout(packets[rows[0]], key)
            for name, column in layout.read(b"".join(packets[row] for row in rows)).items():
                values[name][rows] = column
                present[name][rows] = True
        return Columns(values, present)

    def _layout_key(self, packet: bytes) -> tuple[int, bytes]:
        """Return the key of a packet's layout; in packets with equal keys, the numbers have the same positions."""
        width = 0 if self._frame.items is None else self._frame.items.header
        return len(packet), b"".join(packet[at - width : at] for _, at, _ in self._items(packet) or ())

    def _layout(self, packet: bytes, key: tuple[int, bytes]) -> "Layout":
        layout = self._layouts.get(key)
        if layout is None:
            layout = Layout(len(packet), self._field_positions(packet), self._frame.byte_order)
            if len(self._layouts) < _MAX_LAYOUTS:
                self._layouts[key] = layout
        return layout

    def _field_positions(self, packet: bytes) -> list[tuple[FrameField, int]]:
        if self._frame.items is None:
            end = len(packet) - len(self._tail) - self._check_size
            extra = self._extra(packet)
            return [(f, at + extra) for f, at in self._positions if at + extra + f.width <= end]
        items: dict[bytes, tuple[int, int]] = {}
        for name, at, size in self._items(packet) or []:
            items.setdefault(name, (at, size))
        positions = []
        for f, at in self._positions:
            begin, size = items.get(hex_bytes(f.item or ""), (0, 0))
            if at + f.width <= size:
                positions.append((f, begin + at))
        return positions

    def _extra(self, packet: bytes) -> int:
        """Return the number of bytes by which an extended length shifts the following data."""
        length = self._frame.length
        if length is None or not length.extended:
            return 0
        width = number(length.type).width
        long = packet[length.at : length.at + width] == b"\xff" * width
        return number(length.extended).width if long else 0

    def _items(self, packet: bytes) -> list[tuple[bytes, int, int]] | None:
        """Return the id and the start and size of the data of each item; None if the items do not fill the packet."""
        items = self._frame.items
        if items is None:
            return []
        start = items.at + self._extra(packet)
        end = len(packet) - len(self._tail) - self._check_size
        widths = (number(items.id).width, number(items.length).width)
        id_at, length_at = (0, widths[0]) if items.order == "id length" else (widths[1], 0)
        walked = []
        while start < end:
            data = start + items.header
            if data > end:
                return None
            stated = packet[start + length_at : start + length_at + widths[1]]
            size = int.from_bytes(stated, self._frame.byte_order) - (items.header if items.counts_header else 0)
            if size < 0 or data + size > end:
                return None
            walked.append((packet[start + id_at : start + id_at + widths[0]], data, size))
            start = data + size
        return walked


class Layout:
    """Positions of the numbers in packets with the same layout."""

    def __init__(self, size: int, positions: list[tuple[FrameField, int]], byte_order: ByteOrder) -> None:
        self._size = size
        self._order: ByteOrder = byte_order
        native = [(f, at, number(f.type).native(byte_order, f.word_order)) for f, at in positions]
        self._native_dtype = np.dtype(
            {
                "names": [f.name for f, _, kind in native if kind is not None],
                "formats": [kind for _, _, kind in native if kind is not None],
                "offsets": [at for _, at, kind in native if kind is not None],
                "itemsize": size,
            }
        )
        self._is_integer = {f.name: number(f.type).is_integer for f, _, _ in native}
        self._other_types = [(f, at, number(f.type)) for f, at, kind in native if kind is None]

    def read(self, packets: bytes) -> dict[str, Column]:
        """Return the numbers of consecutive packets by field."""
        rows = np.frombuffer(packets, self._native_dtype)
        with np.errstate(invalid="ignore"):  # a signalling NaN is treated like any other NaN
            columns: dict[str, Column] = {
                name: rows[name].astype(np.int64) if self._is_integer[name] else rows[name].astype(np.float64)
                for name in self._native_dtype.names or ()
            }
        if self._other_types:
            table = np.frombuffer(packets, np.uint8).reshape(-1, self._size)
            for f, at, kind in self._other_types:
                columns[f.name] = kind.column(table[:, at : at + f.width], self._order, f.word_order)
        return columns


#: Largest number of stored layouts, so that noise with a matching checksum cannot fill the memory.
_MAX_LAYOUTS = 256


def _absent_column(f: FrameField, count: int) -> Column:
    return np.zeros(count, np.int64) if number(f.type).is_integer else np.full(count, np.nan)
