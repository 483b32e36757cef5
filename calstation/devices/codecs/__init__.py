"""Encoding of numbers, checksums and matrices in bytes and registers, independent of profiles and ports."""

from calstation.devices.codecs.conventions import (
    ELEMENTS,
    SENSORS,
    Convention,
    from_registers,
    matrix_elements,
    offset_elements,
    parameter_of,
    permitted_range,
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
