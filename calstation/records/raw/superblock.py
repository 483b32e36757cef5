"""The superblock of an HDF5 file, which is patched in memory so that an unclosed file is read like a closed one.

The HDF5 mode for a file left open by its writer (SWMR) retries damaged metadata with doubling waits, so that a single
wrong byte would block the reader for hours. In a closed file, the same damage causes an error immediately.

References
----------
HDF5 file format specification 4.0, II.A (superblock version 3); R. J. Jenkins, lookup3.c (2006), hashlittle.
"""

import io
from pathlib import Path
from typing import Any

#: Size of a superblock of version 3, bytes.
SUPERBLOCK = 48

_SIGNATURE = b"\x89HDF\r\n\x1a\n\x03"
_FLAGS, _END, _CHECK = 11, slice(28, 36), slice(44, 48)
_MASK = 0xFFFFFFFF


def superblock_end(head: bytes) -> int:
    """Return the length of a file according to its first `SUPERBLOCK` bytes."""
    return int.from_bytes(head[_END], "little")


def superblock_valid(head: bytes) -> bool:
    """Return whether a file begins with a superblock of version 3 with a correct checksum."""
    return (
        len(head) == SUPERBLOCK
        and head.startswith(_SIGNATURE)
        and _lookup3(head[: _CHECK.start]) == int.from_bytes(head[_CHECK], "little")
    )


def is_unclosed(head: bytes) -> bool:
    """Return whether the writer has left the file unclosed."""
    return head[_FLAGS] != 0


class AsClosed(io.FileIO):
    """Reads a file that was not closed, or was truncated, as if it had been closed at its current length."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "rb")
        head = bytearray(super().read(SUPERBLOCK) or b"")
        head[_FLAGS] = 0
        head[_END] = self.seek(0, io.SEEK_END).to_bytes(8, "little")
        head[_CHECK] = _lookup3(head[: _CHECK.start]).to_bytes(4, "little")
        self._head = bytes(head)

    def readinto(self, buffer: Any) -> int:
        """Read bytes into a buffer; see `io.RawIOBase`."""
        start = self.tell()
        view = memoryview(buffer).cast("B")
        count = super().readinto(view) or 0
        if start < SUPERBLOCK:
            part = self._head[start : start + count]
            view[: len(part)] = part
        return count


def _lookup3(data: bytes | bytearray) -> int:
    """Return the 32-bit Jenkins hash, which HDF5 uses as the checksum of metadata."""
    a = b = c = (0xDEADBEEF + len(data)) & _MASK
    remaining = bytes(data)
    while len(remaining) > 12:
        a, b, c = (value + word & _MASK for value, word in zip((a, b, c), _words(remaining), strict=True))
        a, c = (a - c & _MASK) ^ _rotated(c, 4), c + b & _MASK
        b, a = (b - a & _MASK) ^ _rotated(a, 6), a + c & _MASK
        c, b = (c - b & _MASK) ^ _rotated(b, 8), b + a & _MASK
        a, c = (a - c & _MASK) ^ _rotated(c, 16), c + b & _MASK
        b, a = (b - a & _MASK) ^ _rotated(a, 19), a + c & _MASK
        c, b = (c - b & _MASK) ^ _rotated(b, 4), b + a & _MASK
        remaining = remaining[12:]
    if not remaining:
        return c
    a, b, c = (value + word & _MASK for value, word in zip((a, b, c), _words(remaining), strict=True))
    c = (c ^ b) - _rotated(b, 14) & _MASK
    a = (a ^ c) - _rotated(c, 11) & _MASK
    b = (b ^ a) - _rotated(a, 25) & _MASK
    c = (c ^ b) - _rotated(b, 16) & _MASK
    a = (a ^ c) - _rotated(c, 4) & _MASK
    b = (b ^ a) - _rotated(a, 14) & _MASK
    return (c ^ b) - _rotated(b, 24) & _MASK


def _words(data: bytes) -> tuple[int, int, int]:
    padded = data[:12].ljust(12, b"\0")
    return (
        int.from_bytes(padded[:4], "little"),
        int.from_bytes(padded[4:8], "little"),
        int.from_bytes(padded[8:], "little"),
    )


def _rotated(value: int, bits: int) -> int:
    return (value << bits | value >> (32 - bits)) & _MASK
