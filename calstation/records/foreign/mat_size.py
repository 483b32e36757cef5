"""Size limits for MATLAB files of versions 5 to 7.2, in which a small packed array may unpack to an enormous one.

A file is a sequence of elements: type and size, 4 bytes each, and content, padded to 8 bytes. The content of an array,
type 14, is again a sequence of elements, of which the second one has its dimensions; the content of an element of type
15 is a packed array. An element of up to 4 bytes has its size in the upper half of its type, and its content in place
of the size. Source: MathWorks, MAT-File Format.
"""

import math
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import BinaryIO, Literal

from calstation.errors import InputError

_ARRAY, _PACKED = 14, 15
_HEADER, _TAG, _DIMENSIONS = 128, 8, 2
#: Size of a number by the type of its element, bytes; numbers of other types have one byte.
_WIDTHS = {3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8, 17: 2, 18: 4}
#: Maximum counts of numbers, 13 h of an IMU at 100 Hz, and of arrays; scipy crashes if thousands are nested.
MAX_NUMBERS, _MAX_ARRAYS = 1 << 25, 1000
_PIECE = 1 << 16
_Order = Literal["little", "big"]


def check_size(path: Path) -> None:
    """Raise InputError if reading the arrays of a file would take much more memory than its size.

    Raises zlib.error if the file is damaged.
    """
    limit = 2 * max(MAX_NUMBERS, path.stat().st_size)  # numbers are counted in dimensions and in content
    with path.open("rb") as file:
        head = file.read(_HEADER)
        if 0 in head[:4]:  # version 4, which has no compression
            return
        order: _Order = "big" if head.endswith(b"MI") else "little"
        numbers = arrays = 0
        while len(tag := file.read(_TAG)) == _TAG:
            kind, size = _integers(tag, order)
            end = file.tell() + size
            if kind == _PACKED:
                read: Callable[[int], bytes] = _Unpacked(file, end).read
            else:
                file.seek(-_TAG, 1)
                read = partial(_read, file, end)
            more_numbers, more_arrays = _count(read, order, limit - numbers, _MAX_ARRAYS - arrays)
            numbers, arrays = numbers + more_numbers, arrays + more_arrays
            if numbers > limit or arrays > _MAX_ARRAYS:
                raise InputError("foreign.too_large", file=path)
            file.seek(end)


def _count(read: Callable[[int], bytes], order: _Order, max_numbers: int, max_arrays: int) -> tuple[int, int]:
    """Return the counts of numbers and arrays in the data that `read` returns; stop above the limits."""
    numbers = arrays = position = 0
    while numbers <= max_numbers and arrays <= max_arrays and len(tag := read(_TAG)) == _TAG:
        kind, size = _integers(tag, order)
        if kind == _ARRAY:
            arrays, position = arrays + 1, 0
            continue
        position += 1
        if kind >> 16:
            continue
        numbers += size // _WIDTHS.get(kind, 1)
        if position == _DIMENSIONS and size <= _PIECE:
            numbers += abs(math.prod(_integers(read(size), order)))
            size = -size % 8
        else:
            size += -size % 8
        while numbers <= max_numbers and size > 0:
            read(min(size, _PIECE))
            size -= _PIECE
    return numbers, arrays


def _integers(data: bytes, order: _Order) -> list[int]:
    return [int.from_bytes(data[k : k + 4], order) for k in range(0, len(data) - 3, 4)]


def _read(file: BinaryIO, end: int, size: int) -> bytes:
    """Read at most `size` bytes before `end`."""
    return file.read(max(0, min(size, end - file.tell())))


class _Unpacked:
    """Unpacks the bytes of a file before `end` in parts."""

    def __init__(self, file: BinaryIO, end: int) -> None:
        self._file, self._end, self._tail, self._zlib = file, end, b"", zlib.decompressobj()

    def read(self, size: int) -> bytes:
        """Return the next bytes, fewer at the end. Raises zlib.error."""
        content = b""
        while len(content) < size and not self._zlib.eof:
            packed = self._tail or _read(self._file, self._end, _PIECE)
            part = self._zlib.decompress(packed, size - len(content))
            self._tail = self._zlib.unconsumed_tail
            if not packed and not part:
                break
            content += part
        return content
