"""The unit's flash: an image of its registers, burnt byte by byte, that a power cut may leave half written.

A sound unit has two banks and burns the one not in force; the image with a right check and the higher number counts
at power-up, so a cut leaves it old or new. A poor one has a single bank: cut short, its check fails and the unit
wakes with its defaults.
"""

import struct
import zlib
from pathlib import Path

import numpy as np

#: Before and behind what an image holds: its number, CRC-32 of all before.
_NUMBER, _CHECK = struct.Struct("<I"), struct.Struct("<I")


class PowerCut(Exception):  # noqa: N818 - what happens to the unit, not an error of the program
    """The supply breaks down."""


class Flash:
    """Banks that hold one image each.

    Parameters
    ----------
    size : bytes that an image holds
    banks : 2, or 1 for a unit that a cut during a commit leaves without any
    file : keeps the banks over runs; None keeps them in memory

    Attributes
    ----------
    cycles : times that it was burnt
    image_bytes : of an image with its number and check
    """

    def __init__(self, size: int, banks: int = 2, file: Path | None = None) -> None:
        self.cycles = 0
        self.image_bytes = _NUMBER.size + size + _CHECK.size
        self._file = file
        self._erased = b"\xff" * self.image_bytes
        self._banks = [self._erased] * banks
        if file is not None and file.exists():
            content = file.read_bytes()
            self.cycles = int.from_bytes(content[:4], "little")
            self._banks = [content[4 + i * self.image_bytes :][: self.image_bytes] for i in range(banks)]

    def load(self) -> bytes | None:
        """What is in force at power-up, None where no image is whole."""
        images = [image for image in map(self._read, self._banks) if image is not None]
        return max(images, key=lambda image: image[0])[1] if images else None

    def burn(self, content: bytes, power_for: int | None = None) -> None:
        """Erase a bank and write it; the power breaks down after `power_for` bytes. Raises PowerCut."""
        numbers = [image[0] if image is not None else 0 for image in map(self._read, self._banks)]
        bank = int(np.argmin(numbers))
        body = _NUMBER.pack(max(numbers) + 1) + content
        image = body + _CHECK.pack(zlib.crc32(body))
        written = len(image) if power_for is None else min(power_for, len(image))
        self._banks[bank] = image[:written] + self._erased[written:]
        self.cycles += 1
        if self._file is not None:
            self._file.write_bytes(self.cycles.to_bytes(4, "little") + b"".join(self._banks))
        if power_for is not None:
            raise PowerCut

    def _read(self, bank: bytes) -> tuple[int, bytes] | None:
        """Number and content of an image, None where its check is wrong."""
        body = bank[: -_CHECK.size]
        if len(bank) != self.image_bytes or _CHECK.pack(zlib.crc32(body)) != bank[-_CHECK.size :]:
            return None
        return _NUMBER.unpack_from(body)[0], body[_NUMBER.size :]
