"""The unit's flash memory: an image of its registers, written byte by byte, which a power cut may leave incomplete."""

import struct
import zlib
from pathlib import Path

import numpy as np

#: Sequence number that precedes the content of an image, and CRC-32 of both, which follows it.
_NUMBER, _CHECK = struct.Struct("<I"), struct.Struct("<I")


def burnt_cycles(file: Path | None) -> int:
    """Return the number of writes to a flash saved in a file; 0 without a file."""
    return int.from_bytes(file.read_bytes()[:4], "little") if file is not None and file.exists() else 0


class PowerCut(Exception):  # noqa: N818 - an event of the unit, not an error of the program
    """The unit's power supply failed."""


class Flash:
    """Flash banks with one image each, saved in a file between runs if one is given.

    With two banks, the inactive one is written; the valid image with the higher number is active at power-up, so a
    power cut leaves the old or the new image. With a single bank, a power cut leaves no valid image, and the unit
    starts with its defaults. `cycles` counts writes.
    """

    def __init__(self, size: int, banks: int = 2, file: Path | None = None) -> None:
        self.cycles = burnt_cycles(file)
        self.image_bytes = _NUMBER.size + size + _CHECK.size
        self._file = file
        self._erased = b"\xff" * self.image_bytes
        self._banks = [self._erased] * banks
        if file is not None and file.exists():
            content = file.read_bytes()
            self._banks = [content[4 + i * self.image_bytes :][: self.image_bytes] for i in range(banks)]

    def load(self) -> bytes | None:
        """Return the content of the active image; None if no image is valid."""
        images = [image for image in map(self._read, self._banks) if image is not None]
        return max(images, key=lambda image: image[0])[1] if images else None

    def burn(self, content: bytes, power_for: int | None = None) -> None:
        """Erase the inactive bank and write it; raises PowerCut after `power_for` bytes if given."""
        numbers = [image[0] if image is not None else 0 for image in map(self._read, self._banks)]
        bank = int(np.argmin(numbers))
        body = _NUMBER.pack(max(numbers) + 1) + content
        image = body + _CHECK.pack(zlib.crc32(body))
        written = len(image) if power_for is None else min(power_for, len(image))
        self._banks[bank] = image[:written] + self._erased[written:]
        self.cycles += 1
        if self._file is not None:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            self._file.write_bytes(self.cycles.to_bytes(4, "little") + b"".join(self._banks))
        if power_for is not None:
            raise PowerCut

    def _read(self, bank: bytes) -> tuple[int, bytes] | None:
        """Return the number and content of an image; None if its checksum is wrong."""
        body = bank[: -_CHECK.size]
        if len(bank) != self.image_bytes or _CHECK.pack(zlib.crc32(body)) != bank[-_CHECK.size :]:
            return None
        return _NUMBER.unpack_from(body)[0], body[_NUMBER.size :]
