"""Limits for the data that libraries of foreign formats unpack, since a small file may fill the memory or the disk."""

import bz2
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from calstation.errors import InputError

#: Largest chunk or message, bytes; recorders write chunks of a few MB.
MAX_CHUNK = 1 << 27
#: Limit of the total unpacked size: the larger of a multiple of the size of the file, and a number of bytes.
_MAX_RATIO, _MIN_TOTAL = 100, 1 << 30
#: Bytes that are unpacked at once.
_PART = 1 << 18


class Unpacking:
    """The functions of the libraries `lz4.frame`, `bz2`, `zstandard` and `zstd`, with limits for one file.

    They raise InputError beyond the limits.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        packed = sum(each.stat().st_size for each in (path.iterdir() if path.is_dir() else (path,)))
        self._remaining = max(_MIN_TOTAL, _MAX_RATIO * packed)

    def lz4(self, data: bytes, _size: int = 0) -> bytes:
        """Unpack a frame of LZ4."""
        from lz4.frame import LZ4FrameDecompressor

        return self._decompressed(LZ4FrameDecompressor(), data)

    def bz2(self, data: bytes) -> bytes:
        """Unpack a stream of bzip2."""
        return self._decompressed(bz2.BZ2Decompressor(), data)

    def zstd(self, data: bytes, _size: int = 0) -> bytes:
        """Unpack a frame of Zstandard."""
        from zstandard import ZstdDecompressor

        reader = ZstdDecompressor().stream_reader(data)
        return self._joined(iter(lambda: reader.read(_PART), b""))

    def open(self, file: BinaryIO, _mode: str) -> "_Stream":
        """Open a packed file of Zstandard for reading."""
        from zstandard import ZstdDecompressor

        return _Stream(ZstdDecompressor().stream_reader(file), self._counted)

    def _decompressed(self, decompressor: Any, data: bytes) -> bytes:
        def parts() -> Iterator[bytes]:
            yield decompressor.decompress(data, max_length=_PART)
            while not (decompressor.eof or decompressor.needs_input):
                yield decompressor.decompress(b"", max_length=_PART)

        return self._joined(parts())

    def _joined(self, parts: Iterable[bytes]) -> bytes:
        """Join the parts of one chunk; they are small, because some libraries reserve the largest size at once."""
        joined = []
        size = 0
        for part in parts:
            joined.append(self._counted(part))
            if (size := size + len(part)) > MAX_CHUNK:
                raise InputError("foreign.too_large", file=self._path)
        return b"".join(joined)

    def _counted(self, data: bytes) -> bytes:
        self._remaining -= len(data)
        if self._remaining < 0:
            raise InputError("foreign.too_large", file=self._path)
        return data


class _Stream:
    """A packed file, whose parts are unpacked as they are read."""

    def __init__(self, source: Any, counted: Callable[[bytes], bytes]) -> None:
        self._source, self._counted = source, counted

    def read(self, size: int) -> bytes:
        return self._counted(self._source.read(size))

    def __enter__(self) -> "_Stream":
        return self

    def __exit__(self, *exception: object) -> None:
        self._source.close()
