"""Number types on the wire, which are integers of 1 to 8 bytes, floats and Q formats in any byte and word order."""

import re
import struct
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator

from calstation.physics import FloatArray, IntArray
from calstation.schema import EntryError

ByteOrder = Literal["little", "big"]
#: Order of the 16-bit words of a number; `fraction_first` is a Q format with the fraction before the integer part.
WordOrder = Literal["little", "big", "fraction_first"]

_INTEGER = re.compile(r"([ui])(8|16|24|32|40|48|56|64)")
_FLOAT = re.compile(r"f(32|64)")
_Q = re.compile(r"(u?)q(\d{1,2})\.(\d{1,2})")


@dataclass(frozen=True)
class Number:
    """An unsigned, signed or IEEE 754 number type.

    width : size in bytes
    fraction : number of fraction bits of a Q format
    """

    kind: Literal["u", "i", "f"]
    width: int
    fraction: int = 0

    @property
    def is_integer(self) -> bool:
        """Whether the type represents integers only."""
        return self.kind != "f" and self.fraction == 0

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest representable number."""
        if self.kind == "f":
            largest = float(np.finfo(np.float32 if self.width == 4 else np.float64).max)
            return -largest, largest
        low, high = self.raw_bounds
        return low * 2.0**-self.fraction, high * 2.0**-self.fraction

    def scaled_bounds(self, scale: float) -> tuple[float, float]:
        """Return the lowest and highest number × `scale`, which may be negative."""
        low, high = sorted(bound * scale for bound in self.bounds)
        return low, high

    def step(self, scale: float) -> float:
        """Return the smallest difference of number × `scale`; 0 for floats, whose resolution depends on the value."""
        return 0.0 if self.kind == "f" else abs(scale) * 2.0**-self.fraction

    @property
    def raw_bounds(self) -> tuple[int, int]:
        """Lowest and highest integer on the wire; undefined for floats."""
        bits = 8 * self.width
        return (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if self.kind == "i" else (0, (1 << bits) - 1)

    def nearest(self, value: float) -> float:
        """Return the representable value nearest to `value`; raises ValueError if `value` is out of range."""
        if self.kind == "f":
            if not abs(value) <= self.bounds[1]:
                raise ValueError(f"{value:g} cannot be represented")
            return float(np.float32(value)) if self.width == 4 else float(value)
        return self._integer(value) * 2.0**-self.fraction

    def _integer(self, value: float) -> int:
        if not np.isfinite(value):
            raise ValueError(f"{value} cannot be represented")
        raw = round(value * 2.0**self.fraction)
        low, high = self.raw_bounds
        if not low <= raw <= high:
            raise ValueError(f"{value:g} lies outside {self.bounds[0]:g} to {self.bounds[1]:g}")
        return raw

    def pack(self, value: float, byte_order: ByteOrder, word_order: WordOrder | None = None) -> bytes:
        """Return the bytes of `value` on the wire; raises ValueError if it is out of range.

        Parameters
        ----------
        value : number to encode
        byte_order, word_order : order of the bytes in a word, and of the words; None for the byte order
        """
        if self.kind == "f":
            big_endian = struct.pack(">f" if self.width == 4 else ">d", self.nearest(value))
        else:
            big_endian = self._integer(value).to_bytes(self.width, "big", signed=self.kind == "i")
        wire = bytearray(self.width)
        for position, source in enumerate(self._positions(byte_order, word_order)):
            wire[source] = big_endian[position]
        return bytes(wire)

    def unpack(self, wire: bytes, byte_order: ByteOrder, word_order: WordOrder | None = None) -> float:
        """Return the value of `width` bytes from the wire.

        Parameters
        ----------
        wire : `width` bytes
        byte_order, word_order : order of the bytes in a word, and of the words; None for the byte order
        """
        column = np.frombuffer(wire, np.uint8, self.width)[None, :]
        return float(self.column(column, byte_order, word_order)[0])

    def native(self, byte_order: ByteOrder, word_order: WordOrder | None = None) -> np.dtype[np.generic] | None:
        """Return the NumPy type of the bytes on the wire; None if NumPy has no such type."""
        if self.fraction or self.width not in (1, 2, 4, 8) or word_order not in (None, byte_order):
            return None
        return np.dtype(f"{'<' if byte_order == 'little' else '>'}{self.kind}{self.width}")

    def column(
        self, wire: NDArray[np.uint8], byte_order: ByteOrder, word_order: WordOrder | None = None
    ) -> FloatArray | IntArray:
        """Decode numbers from bytes, shape (n, width), to an array of shape (n,).

        Integers become int64 (u64 wraps around to negative values), and all other numbers float64.

        Parameters
        ----------
        wire : bytes on the wire, shape (n, width)
        byte_order, word_order : order of the bytes in a word, and of the words; None for the byte order
        """
        big_endian = wire[:, self._positions(byte_order, word_order)]
        if self.kind == "f":
            real = np.ascontiguousarray(big_endian).view(">f4" if self.width == 4 else ">f8")
            with np.errstate(invalid="ignore"):  # a signalling NaN is treated like any other NaN
                return np.asarray(real[:, 0].astype(np.float64))
        padded = np.zeros((len(big_endian), 8), dtype=np.uint8)
        padded[:, 8 - self.width :] = big_endian
        if self.kind == "i":
            padded[big_endian[:, 0] > 127, : 8 - self.width] = 255
        if self.fraction == 0:
            return padded.view(">i8")[:, 0].astype(np.int64)
        whole = padded.view(">u8" if self.kind == "u" else ">i8")[:, 0].astype(np.float64)
        return np.asarray(whole * 2.0**-self.fraction)

    def _positions(self, byte_order: ByteOrder, word_order: WordOrder | None) -> list[int]:
        """Return the indices on the wire of the number's bytes, most significant byte first."""
        positions = list(range(self.width))
        if word_order == "fraction_first":
            split = self.fraction // 8
            whole, fraction = positions[split:], positions[:split]
            return [*whole, *fraction] if byte_order == "big" else [*whole[::-1], *fraction[::-1]]
        if byte_order == "big" and word_order == "little":
            return [p for k in range(self.width - 2, -1, -2) for p in positions[k : k + 2]]
        if byte_order == "little" and word_order == "big":
            return [p for k in range(0, self.width, 2) for p in positions[k : k + 2][::-1]]
        return positions if byte_order == "big" else positions[::-1]


@cache
def number(name: str) -> Number:
    """Return the number type with a name. Raises EntryError for an unknown name."""
    if match := _INTEGER.fullmatch(name):
        return Number("u" if match[1] == "u" else "i", int(match[2]) // 8)
    if match := _FLOAT.fullmatch(name):
        return Number("f", int(match[1]) // 8)
    if match := _Q.fullmatch(name):
        bits, fraction = int(match[2]) + int(match[3]), int(match[3])
        if bits % 8 == 0 and 8 <= bits <= 64 and fraction > 0:
            return Number("u" if match[1] else "i", bits // 8, fraction)
    raise EntryError("profile.unknown_type", value=name)


def order_error(name: str, word_order: WordOrder | None) -> EntryError | None:
    """Return the error if a number type cannot have this word order, or None."""
    kind = number(name)
    if word_order == "fraction_first" and (kind.fraction == 0 or kind.fraction % 8):
        return EntryError("profile.fraction_first", "word_order", type=name)
    if word_order in ("little", "big") and kind.width % 2:
        return EntryError("profile.no_words", "word_order", type=name)
    return None


def _known(name: str) -> str:
    number(name)
    return name


#: Name of a number type in a profile.
NumberName = Annotated[str, AfterValidator(_known)]


def is_code(code: str) -> bool:
    """Return whether a device code in a profile is a decimal number in ASCII digits without leading zeros."""
    return code.isascii() and code.isdecimal() and code == str(int(code))
