"""Frame checks by name: the CRCs that profiles may ask for."""

from collections.abc import Callable
from typing import Literal

from fastcrc import crc16, crc32

_CHECKS: dict[str, tuple[int, Callable[[bytes], int]]] = {
    "crc16_ccitt_false": (2, crc16.ibm_3740),
    "crc16_xmodem": (2, crc16.xmodem),
    "crc16_modbus": (2, crc16.modbus),
    "crc32": (4, crc32.iso_hdlc),
    "crc32_mpeg2": (4, crc32.mpeg_2),
}

CRC_WIDTHS: dict[str, int] = {kind: width for kind, (width, _) in _CHECKS.items()}
"""Bytes that each kind of check takes."""


def check_bytes(kind: str, data: bytes, byte_order: Literal["little", "big"]) -> bytes:
    """The check of `data` as it stands on the wire."""
    width, function = _CHECKS[kind]
    return function(data).to_bytes(width, byte_order)
