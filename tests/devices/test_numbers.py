"""Numbers of any type and byte order are encoded and decoded, singly and in bulk; values out of range are rejected."""

import itertools
import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.devices.codecs import CHECK_WIDTHS, check_bytes, check_function, number, order_error, parametric_crc
from calstation.schema import EntryError
from tests.helpers import raises_code

TYPES = ["u8", "i8", "u16", "i16", "u24", "i24", "u32", "i32", "u40", "i48", "u56", "i64", "f32", "f64"]
TYPES += ["q1.15", "q12.20", "q16.32", "uq16.16", "q8.24", "uq0.16", "q32.32"]
ORDERS = [("big", None), ("little", None), ("big", "little"), ("little", "big"), ("big", "big")]


def orders(name: str) -> list[tuple[str, str | None]]:
    kind = number(name)
    fitting = [o for o in ORDERS if o[1] is None or kind.width % 2 == 0]
    if kind.fraction and kind.fraction % 8 == 0:
        fitting += [("big", "fraction_first"), ("little", "fraction_first")]
    return fitting


@pytest.mark.parametrize(
    ("name", "order", "words", "wire", "value"),
    [
        ("u16", "big", None, "1234", 0x1234),
        ("i24", "big", None, "fffad6", -1322),
        ("i24", "little", None, "d6faff", -1322),
        ("i32", "big", None, "80000000", -(2**31)),
        ("f32", "big", None, "3f800000", 1.0),
        ("f32", "little", None, "0000803f", 1.0),
        ("f32", "big", "little", "00003f80", 1.0),
        ("f32", "little", "big", "803f0000", 1.0),
        ("f64", "big", "little", "000000000000c000", -2.0),
        ("q12.20", "big", None, "fff00000", -1.0),
        ("q16.32", "big", "fraction_first", "80000000ffff", -0.5),
        ("q16.32", "little", "fraction_first", "00000080ffff", -0.5),
        ("q16.32", "big", None, "ffff80000000", -0.5),
        ("uq16.16", "big", "little", "80000001", 1.5),
    ],
)
def test_numbers_are_encoded_to_known_bytes(name: str, order: str, words: str | None, wire: str, value: float) -> None:
    kind = number(name)
    assert kind.unpack(bytes.fromhex(wire), order, words) == value  # type: ignore[arg-type]
    assert kind.pack(value, order, words).hex() == wire  # type: ignore[arg-type]


@given(name=st.sampled_from(TYPES), wires=st.binary(min_size=8, max_size=64), data=st.data())
def test_every_byte_pattern_survives_decoding_and_encoding(name: str, wires: bytes, data: st.DataObject) -> None:
    kind = number(name)
    order, words = data.draw(st.sampled_from(orders(name)))
    table = np.frombuffer(wires[: len(wires) // kind.width * kind.width], np.uint8).reshape(-1, kind.width)
    column = kind.column(table, order, words)  # type: ignore[arg-type]
    assert column.shape == (len(table),)
    for row, value in zip(table, column, strict=True):
        alone = kind.unpack(row.tobytes(), order, words)  # type: ignore[arg-type]
        assert alone == value or (math.isnan(alone) and math.isnan(value))
        exact = math.isfinite(value) and (kind.kind == "f" or abs(value) * 2.0**kind.fraction < 2**53)
        if exact and not (name == "u64" and value < 0):
            assert kind.pack(float(value), order, words) == row.tobytes() or value == 0.0  # type: ignore[arg-type]


@given(name=st.sampled_from(TYPES), part=st.floats(0, 1))
def test_values_within_bounds_are_rounded_to_half_a_step(name: str, part: float) -> None:
    kind = number(name)
    low, high = kind.bounds
    value = low / 2 + part * (high / 2 - low / 2)
    held = kind.nearest(value)
    assert kind.unpack(kind.pack(value, "big"), "big") == held
    step = 2.0**-kind.fraction if kind.kind != "f" else abs(value) * 2.0**-23
    assert abs(held - value) <= 0.5 * step + abs(value) * 2.0**-52


@pytest.mark.parametrize(
    ("name", "value"), [("u8", 256), ("u8", -1), ("i16", 40000), ("q1.15", 1.0), ("f32", 1e39), ("i32", math.nan)]
)
def test_a_value_out_of_range_is_rejected(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=r"outside|cannot be represented"):
        number(name).pack(value, "big")


@pytest.mark.parametrize("name", ["u12", "f16", "i72", "q0.0", "q4.5", "q40.40", "float", "", "q8.0"])
def test_an_unknown_type_is_rejected(name: str) -> None:
    with raises_code(EntryError, "profile.unknown_type"):
        number(name)


@pytest.mark.parametrize(
    ("name", "words", "code"),
    [
        ("i24", "little", "profile.no_words"),
        ("u8", "big", "profile.no_words"),
        ("f32", "fraction_first", "profile.fraction_first"),
    ],
)
def test_word_order_incompatible_with_its_type_is_rejected(name: str, words: str, code: str) -> None:
    problem = order_error(name, words)  # type: ignore[arg-type]
    assert isinstance(problem, EntryError)
    assert problem.code == code


# Checks ---------------------------------------------------------------------------------------------------------

TEXT = b"123456789"


@pytest.mark.parametrize(
    ("kind", "value"),
    [("sum8", 0xDD), ("sum8_to_zero", 0x23), ("sum16", 0x01DD), ("xor8", 0x31), ("fletcher16", 0xDDF3 - 0xF3 + 0x15)],
)
def test_checksums_match_reference_values(kind: str, value: int) -> None:
    assert check_function(kind)(TEXT) == value
    assert check_bytes(kind, TEXT, "big") == value.to_bytes(CHECK_WIDTHS[kind], "big")


def test_fletcher16_matches_its_definition() -> None:
    data = bytes(itertools.islice(itertools.cycle(range(7, 250, 11)), 700))
    a = b = 0
    for byte in data:
        a = (a + byte) % 256
        b = (b + a) % 256
    assert check_function("fletcher16")(data) == a << 8 | b
    assert check_function("fletcher16")(b"") == 0


@pytest.mark.parametrize(
    ("width", "polynomial", "initial", "reflected", "final", "value"),
    [  # G. Cook, Catalogue of parametrised CRC algorithms
        (8, 0x07, 0x00, False, 0x00, 0xF4),
        (8, 0x31, 0x00, True, 0x00, 0xA1),
        (16, 0x1021, 0xFFFF, False, 0x0000, 0x29B1),
        (16, 0x8005, 0xFFFF, True, 0x0000, 0x4B37),
        (16, 0x1021, 0x0000, True, 0x0000, 0x2189),
        (24, 0x864CFB, 0xB704CE, False, 0x000000, 0x21CF02),
        (32, 0x04C11DB7, 0xFFFFFFFF, False, 0x00000000, 0x0376E6E7),
        (32, 0x04C11DB7, 0xFFFFFFFF, True, 0xFFFFFFFF, 0xCBF43926),
    ],
)
def test_parametric_crc_matches_reference_values(
    width: int, polynomial: int, initial: int, reflected: bool, final: int, value: int
) -> None:
    assert parametric_crc(width, polynomial, initial, reflected, reflected, final)(TEXT) == value


@given(data=st.binary(max_size=80))
def test_parametric_crc_equals_the_named_crc(data: bytes) -> None:
    assert parametric_crc(16, 0x1021, 0xFFFF, False, False, 0)(data) == check_function("crc16_ccitt_false")(data)
    assert parametric_crc(32, 0x04C11DB7, 0xFFFFFFFF, True, True, 0xFFFFFFFF)(data) == check_function("crc32")(data)
    assert struct.pack(">I", check_function("crc32")(data)) == check_bytes("crc32", data, "big")
