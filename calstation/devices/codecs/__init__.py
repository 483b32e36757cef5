"""Encoding of numbers, checksums and matrix conventions in bytes and registers, independent of profiles and ports."""

from calstation.devices.codecs.conventions import (
    SENSORS,
    SLOTS,
    Convention,
    from_registers,
    legal_range,
    matrix_slots,
    offset_slots,
    parameter_of,
    to_registers,
)
from calstation.devices.codecs.frame_checks import (
    CHECK_WIDTHS,
    CRC_WIDTHS,
    CheckFunction,
    check_bytes,
    check_function,
    parametric_crc,
)
from calstation.devices.codecs.numbers import ByteOrder, Number, NumberName, WordOrder, is_code, number, order_error
from calstation.devices.codecs.packets import PacketKind, Reply, ReplyKind, quote, quote_text, register_text
