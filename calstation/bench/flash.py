"""The unit's flash: an image of its registers, burnt byte by byte, that a power cut may leave half written.

A sound unit has two banks and burns the one not in force; the image with a right check and the higher number counts
at power-up, so a cut leaves it old or new. A poor one has a single bank: cut short, its check fails and the unit
wakes with its defaults.
"""

import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

REGISTERS = 30
"""Float32 registers in an image."""

_IMAGE = struct.Struct(f"<I{REGISTERS}f")
IMAGE_BYTES = _IMAGE.size + 4
"""Number of the image, registers, CRC-32 of both."""

_ERASED = b"\xff" * IMAGE_BYTES


class PowerCut(Exception):  # noqa: N818 - what happens to the unit, not an error of the program
    """The supply breaks down."""


class Flash:
    """Banks of registers.

    Parameters
    ----------
    banks : 2, or 1 for a unit that a cut during a commit leaves without any
    file : keeps the banks over runs; None keeps them in memory

    Attributes
    ----------
    cycles : times that it was burnt
    """

    def __init__(self, banks: int = 2, file: Path | None = None) -> None:
        self.cycles = 0
        self._file = file
        self._banks = [_ERASED] * banks
        if file is not None and file.exists():
            content = file.read_bytes()
            self.cycles = int.from_bytes(content[:4], "little")
            self._banks = [content[4 + i * IMAGE_BYTES :][:IMAGE_BYTES] for i in range(banks)]

    def load(self) -> NDArray[np.float32]:
        """Registers in force at power-up, shape (30,), zeros where no image is whole."""
        images = [image for image in map(_read, self._banks) if image is not None]
        return max(images, key=lambda image: image[0])[1] if images else np.zeros(REGISTERS, np.float32)

    def burn(self, registers: NDArray[np.float32], power_for: int | None = None) -> None:
        """Erase a bank and write it; the power breaks down after `power_for` bytes. Raises PowerCut."""
        numbers = [image[0] if image is not None else 0 for image in map(_read, self._banks)]
        bank = int(np.argmin(numbers))
        body = _IMAGE.pack(max(numbers) + 1, *registers.tolist())
        image = body + zlib.crc32(body).to_bytes(4, "little")
        written = len(image) if power_for is None else min(power_for, len(image))
        self._banks[bank] = image[:written] + _ERASED[written:]
        self.cycles += 1
        if self._file is not None:
            self._file.write_bytes(self.cycles.to_bytes(4, "little") + b"".join(self._banks))
        if power_for is not None:
            raise PowerCut


def _read(bank: bytes) -> tuple[int, NDArray[np.float32]] | None:
    """Number and registers of an image, None where its check is wrong."""
    body = bank[: _IMAGE.size]
    if len(bank) != IMAGE_BYTES or zlib.crc32(body) != int.from_bytes(bank[_IMAGE.size :], "little"):
        return None
    number, *values = _IMAGE.unpack(body)
    return number, np.array(values, np.float32)
