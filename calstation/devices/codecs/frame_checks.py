"""Checksums of frames: the CRCs, sums and parities that profiles name, and CRCs defined by parameters."""

import zlib
from collections.abc import Callable
from functools import lru_cache
from typing import Literal

import numpy as np
from fastcrc import crc16, crc32
from numpy.typing import NDArray

from calstation.physics import kernel

CheckFunction = Callable[[bytes], int]


def _fletcher(data: bytes) -> int:
    """Return Fletcher's checksum modulo 256: the sum of the partial sums (high byte) and the sum of the bytes."""
    values = np.frombuffer(data, np.uint8).astype(np.int64)
    return (int(values.sum()) & 0xFF) << 8 | int(values @ np.arange(len(values), 0, -1)) & 0xFF


_CRCS: dict[str, tuple[int, CheckFunction]] = {
    "crc16_ccitt_false": (2, crc16.ibm_3740),
    "crc16_xmodem": (2, crc16.xmodem),
    "crc16_modbus": (2, crc16.modbus),
    "crc32": (4, crc32.iso_hdlc),
    "crc32_mpeg2": (4, crc32.mpeg_2),
    # zlib inverts the initial value and the result, but this CRC does not
    "crc32_novatel": (4, lambda data: zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF),
}
_SUMS: dict[str, tuple[int, CheckFunction]] = {
    "sum8": (1, lambda data: sum(data) & 0xFF),
    "sum8_to_zero": (1, lambda data: -sum(data) & 0xFF),
    "sum16": (2, lambda data: sum(data) & 0xFFFF),
    "xor8": (1, lambda data: int(np.bitwise_xor.reduce(np.frombuffer(data, np.uint8)))),
    "fletcher16": (2, _fletcher),
}
_CHECKS = {**_CRCS, **_SUMS}

#: Size in bytes of each kind of CRC.
CRC_WIDTHS: dict[str, int] = {kind: width for kind, (width, _) in _CRCS.items()}

#: Size in bytes of each kind of checksum, including sums and parities.
CHECK_WIDTHS: dict[str, int] = {kind: width for kind, (width, _) in _CHECKS.items()}


def check_bytes(kind: str, data: bytes, byte_order: Literal["little", "big"]) -> bytes:
    """Return the checksum of `data` as bytes on the wire."""
    width, function = _CHECKS[kind]
    return function(data).to_bytes(width, byte_order)


def check_function(kind: str) -> CheckFunction:
    """Return the function that computes a kind of checksum."""
    return _CHECKS[kind][1]


@lru_cache
def parametric_crc(
    width: int, polynomial: int, initial: int, reflect_in: bool, reflect_out: bool, final_xor: int
) -> CheckFunction:
    """Return a function that computes a CRC in the Rocksoft model.

    Parameters
    ----------
    width : number of bits, 8 to 32 in steps of 8
    polynomial : coefficients without the leading 1, highest power first
    initial : content of the CRC register before the first byte
    reflect_in : whether the bits of each input byte are reversed
    reflect_out : whether the bits of the result are reversed
    final_xor : value that is XORed with the result
    """
    top, mask = 1 << (width - 1), (1 << width) - 1
    table = np.empty(256, np.int64)
    for byte in range(256):
        value = byte << (width - 8)
        for _ in range(8):
            value = (value << 1 ^ polynomial if value & top else value << 1) & mask
        table[byte] = value

    def crc(data: bytes) -> int:
        ordered = data.translate(_MIRROR) if reflect_in else data
        value = int(_remainder(np.frombuffer(ordered, np.uint8), table, initial, width))
        return (_mirrored(value, width) if reflect_out else value) ^ final_xor

    crc(b"\0")  # compiles the function before data arrive
    return crc


@kernel
def _remainder(data: NDArray[np.uint8], table: NDArray[np.int64], initial: int, width: int) -> int:
    mask = (1 << width) - 1
    value = initial
    for byte in data:
        value = (value << 8 ^ table[value >> (width - 8) ^ byte]) & mask
    return value


def _mirrored(value: int, bits: int) -> int:
    return int(f"{value:0{bits}b}"[::-1], 2)


_MIRROR = bytes(_mirrored(byte, 8) for byte in range(256))
