"""Profiles describe fixed, length-prefixed, item and text frames; an invalid profile is reported by its entry."""

import struct
from typing import Any

import numpy as np
import pytest
from decoding import decode
from fastcrc import crc16

from calstation.devices.imu import FrameDecoder, SampleCount
from calstation.devices.profiles import FrameSection
from calstation.schema import problems_of
from tests.devices.editing import edited

CHANNELS = ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]


def section(**changes: Any) -> FrameSection:
    return FrameSection.model_validate(changes)


# VectorNav's binary output: group 1 with TimeStartup, AngularRate and Accel; CRC high byte first -----------------

VN_BINARY = {
    "sync": "FA 01 22 01",
    "byte_order": "little",
    "crc": {"kind": "crc16_xmodem", "start": 1, "byte_order": "big"},
    "fields": [
        {"name": "counter", "type": "u64", "per_sample": 5e6},
        *({"name": name, "type": "f32"} for name in CHANNELS),
    ],
}


def vn_binary(nanoseconds: int, *channels: float) -> bytes:
    body = b"\x01\x22\x01" + struct.pack("<Q6f", nanoseconds, *channels)
    return b"\xfa" + body + struct.pack(">H", crc16.xmodem(body))


@pytest.mark.parametrize("cut", [0, 1, 5])
def test_vectornav_binary_frames_decode(cut: int) -> None:
    frame = section(**VN_BINARY)
    data = b"".join(vn_binary(5_000_000 * k, *(0.25 * k + i for i in range(6))) for k in (9, 10, 12))
    decoder, frames = decode(frame, b"\xfa\x01" + data + b"\xfa", cut)
    counter, counts, _, _ = decoder.samples(frames)
    assert counts[1].tolist() == [2.5, 3.5, 4.5, 5.5, 6.5, 7.5]
    count = SampleCount(frame)
    assert count.feed(counter).tolist() == [9, 10, 12]
    assert count.gaps == 1
    assert decoder.skipped == 2


# VectorNav's text output, with the sync-in count appended --------------------------------------------------------

VN_TEXT = {
    "format": "text",
    "sync": "$VNIMU",
    "crc": {"kind": "xor8", "start": 1},
    "fields": [
        {"name": "spare_mag", "type": "f32", "at": 0},
        *({"name": name, "type": "f32", "at": 3 + k} for k, name in enumerate(CHANNELS[3:])),
        *({"name": name, "type": "f32", "at": 6 + k} for k, name in enumerate(CHANNELS[:3])),
        {"name": "temperature", "type": "f32"},
        {"name": "spare_pressure", "type": "f32"},
        {"name": "counter", "type": "u32", "prefix": "T"},
        {"name": "status", "type": "u16", "prefix": "S", "base": 16},
    ],
}


def line(body: str) -> bytes:
    check = 0
    for byte in body[1:].encode():
        check ^= byte
    return f"{body}*{check:02X}\r\n".encode()


def test_line_from_the_manufacturers_manual_decodes() -> None:
    """VN-100 User Manual UM001, example of register 30."""
    fields = [{"name": n, "type": "f64"} for n in ("yaw", "pitch", "roll")]
    fields += [{"name": "counter", "type": "u32", "prefix": "T"}, {"name": "status", "type": "u16", "prefix": "S"}]
    frame = section(**{**VN_TEXT, "sync": "$VNYPR", "fields": fields})
    _, frames = decode(frame, b"$VNYPR,+010.071,+000.278,-002.026,T1162704,S0000*50\r\n")
    assert [float(frames.columns.values[n][0]) for n in ("yaw", "pitch", "roll")] == [10.071, 0.278, -2.026]
    assert frames.columns.values["counter"].tolist() == [1162704]


@pytest.mark.parametrize("cut", [0, 1, 3])
def test_vectornav_text_lines_decode(cut: int) -> None:
    frame = section(**VN_TEXT)
    text = "$VNIMU,+01.1,-00.2,+00.3,-00.01,+00.02,-09.81,+0.001,-0.002,+0.003,+25.5,+101.3,T"
    other = line("$VNIMUX,1,2")
    broken = line(text + "17").replace(b"9.81", b"9.82")
    data = b"\r\n*" + line(text + "7,S00A1") + other + broken + line(text + "8,S0000") + line("$VNIMU,,,x,1e999,T9")
    decoder, frames = decode(frame, data, cut)
    counter, counts, temperature, status = decoder.samples(frames)
    assert counter.tolist() == [7, 8]
    assert status.tolist() == [0xA1, 0]
    assert counts[0].tolist() == [0.001, -0.002, 0.003, -0.01, 0.02, -9.81]
    assert temperature.tolist() == [25.5, 25.5]
    assert decoder.others == 1
    assert decoder.crc_errors >= 1
    assert len(frames) == 3, "a sound line without numbers is a frame, but no sample"


# Lengths and items -----------------------------------------------------------------------------------------------

ITEMS: dict[str, Any] = {
    "sync": "FA FF",
    "byte_order": "big",
    "crc": {"kind": "sum8_to_zero", "start": 1},
    "id": {"at": 2, "value": "36"},
    "length": {"at": 3, "type": "u8", "adds": 5, "extended": "u16"},
    "items": {"at": 4, "order": "id length", "id": "u16", "length": "u8", "counts_header": False},
    "fields": [
        {"name": "counter", "item": "10 20", "type": "u16"},
        *({"name": name, "item": "4020", "type": "i16"} for name in CHANNELS),
        {"name": "temperature", "item": "0810", "type": "i16", "scale": 0.01, "offset": -40.0},
    ],
}


def item_frame(*items: tuple[int, bytes], kind: int = 0x36) -> bytes:
    body = b"".join(struct.pack(">HB", name, len(data)) + data for name, data in items)
    length = bytes([len(body)]) if len(body) < 255 else b"\xff" + struct.pack(">H", len(body))
    head = b"\xff" + bytes([kind]) + length + body
    return b"\xfa" + head + bytes([-sum(head) & 0xFF])


def test_items_may_be_in_any_order_and_incomplete_frames_give_no_sample() -> None:
    six = struct.pack(">6h", 1, -2, 3, -4, 5, -6)
    data = (
        item_frame((0x1020, b"\x00\x07"), (0x4020, six))
        + item_frame((0x4020, six), (0x7777, b"what"), (0x0810, b"\x1b\x58"), (0x1020, b"\x00\x08"))
        + item_frame((0x1020, b"\x00\x09"))
        + item_frame((0x1020, b"\x00\x0a"), (0x4020, six[:4]))
        + item_frame((0x1020, b"\x00\x0a"), kind=0xD1)
        + item_frame((0x7000, bytes(255)), (0x1020, b"\x00\x0b"), (0x4020, six))
    )
    for cut in (0, 1, 100):
        decoder, frames = decode(section(**ITEMS), data, cut)
        counter, counts, temperature, _ = decoder.samples(frames)
        assert counter.tolist() == [7, 8, 11]
        assert counts.tolist() == [[1, -2, 3, -4, 5, -6]] * 3
        np.testing.assert_allclose(temperature, [np.nan, 30.0, np.nan])
        assert (len(frames), decoder.others, decoder.crc_errors, decoder.skipped) == (5, 1, 0, 0)


def test_frame_not_filled_by_its_items_is_invalid() -> None:
    good = item_frame((0x1020, b"\x00\x07"))
    body = b"\xff\x36\x04" + struct.pack(">HB", 0x1020, 9) + b"\x00"
    bad = b"\xfa" + body + bytes([-sum(body) & 0xFF])
    decoder, frames = decode(section(**ITEMS), bad + good)
    assert len(frames) == 1
    assert decoder.crc_errors == 1


def test_length_above_the_maximum_is_skipped_immediately_as_noise() -> None:
    good = item_frame((0x1020, b"\x00\x07"))
    decoder = FrameDecoder(section(**{**ITEMS, "max_size": 600}))
    assert len(decoder.feed(b"\xfa\xff\x36\xff\xff\xff" + good).frames) == 1
    assert len(decoder.feed(b"\xfa\xff\x36\xff\x02\x00").frames) == 0
    assert len(decoder.feed(good * 100).frames) == 100, "a length that could be is waited for and then given up"


def test_status_fields_are_combined_into_one_word() -> None:
    fields = [{"name": n, "type": "i16"} for n in CHANNELS]
    fields += [{"name": "status", "type": "u8"}, {"name": "status2", "type": "u16"}, {"name": "counter", "type": "u8"}]
    frame = section(sync="C0", byte_order="big", fields=fields, crc={"kind": "sum8", "start": 0})
    body = b"\xc0" + bytes(12) + b"\x81\x40\x02\x05"
    decoder, frames = decode(frame, body + bytes([sum(body) & 0xFF]))
    assert decoder.samples(frames)[3].tolist() == [0x4002_0081]


# The count of samples --------------------------------------------------------------------------------------------


def count_of(type_: str, per_sample: float) -> SampleCount:
    fields = [{"name": "counter", "type": type_, "per_sample": per_sample}]
    return SampleCount(section(sync="C0", byte_order="big", fields=fields, crc={"kind": "sum8", "start": 0}))


@pytest.mark.parametrize("parts", [[8], [3, 5], [1] * 8])
def test_clock_is_converted_to_a_count_across_wraps_and_jitter(parts: list[int]) -> None:
    ticks = (np.array([-302, -201, -99, 0, 101, 199, 502, 600]) + 2**32) % 2**32
    count = count_of("u32", 100.0)
    found = np.concatenate([count.feed(part) for part in np.split(ticks, np.cumsum(parts)[:-1])])
    assert np.diff(found).tolist() == [1, 1, 1, 1, 1, 3, 1]
    assert count.gaps == 1


def test_clock_that_jumps_back_counts_as_a_reset_with_one_lost_sample() -> None:
    count = count_of("u64", 1e6)
    assert count.feed(np.array([70_000_000, 71_000_000, 200_000, 1_200_000])).tolist() == [70, 71, 73, 74]
    assert count.gaps == 1


# Invalid profiles ------------------------------------------------------------------------------------------------

FIXED: dict[str, Any] = {
    "sync": "55 AA",
    "byte_order": "little",
    "fields": [{"name": "counter", "type": "u16"}, *({"name": name, "type": "i24"} for name in CHANNELS)],
    "crc": {"kind": "crc16_ccitt_false", "start": 2},
}


@pytest.mark.parametrize(
    ("base", "where", "value", "expected"),
    [
        (FIXED, "byte_order", None, "byte_order entry.missing"),
        (FIXED, "sync", "", "sync profile.no_sync_bytes"),
        (FIXED, "tail", "0D 0", "tail profile.not_hexadecimal"),
        (FIXED, "fields/2/at", 3, 'fields["gyro_y"].at profile.field_order'),
        (FIXED, "fields/2/item", "04", 'fields["gyro_y"].item profile.belongs_to'),
        (FIXED, "fields/2/type", "i25", 'fields["gyro_y"].type profile.unknown_type'),
        (FIXED, "fields/2/word_order", "big", 'fields["gyro_y"].word_order profile.no_words'),
        (FIXED, "max_size", 20, "fields profile.fields_too_long"),
        (FIXED, "crc", {"kind": "crc", "start": 0}, "crc.width profile.needed_by"),
        (
            FIXED,
            "crc",
            {"kind": "crc", "start": 0, "width": 8, "polynomial": 0x107},
            "crc.polynomial profile.too_many_bits",
        ),
        (FIXED, "crc", {"kind": "crc32", "start": 0, "initial": 1}, "crc.initial profile.belongs_to"),
        (ITEMS, "length", None, "length profile.needed_by"),
        (ITEMS, "fields/0/item", None, 'fields["counter"].item profile.needed_by'),
        (ITEMS, "fields/0/item", "10", 'fields["counter"].item profile.item_id_size'),
        (ITEMS, "items/order", "length", "items.order entry.not_one_of"),
        (VN_TEXT, "sync", "§", "sync profile.text_sync"),
        (VN_TEXT, "tail", "", "tail profile.text_without_end"),
        (VN_TEXT, "fields/2/word_order", "big", 'fields["accel_y"].word_order profile.not_with'),
        (VN_TEXT, "id", {"at": 1, "value": "00"}, "id profile.not_with"),
    ],
)
def test_invalid_frame_is_reported_by_its_entry(base: dict[str, Any], where: str, value: Any, expected: str) -> None:
    first = problems_of(FrameSection, edited(base, {where: value}))[0]
    assert f"{first.name} {first.what.code}" == expected


def test_base_frame_formats_of_these_tests_are_valid() -> None:
    for base in (FIXED, ITEMS, VN_TEXT, VN_BINARY):
        FrameSection.model_validate(base)


# Noise -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("base", [FIXED, ITEMS, VN_TEXT, VN_BINARY])
def test_noise_of_repeated_sync_bytes_is_skipped_and_not_buffered(base: dict[str, Any]) -> None:
    frame = section(**{**base, "crc": {"kind": "crc", "width": 32, "polynomial": 0x04C11DB7, "start": 0}})
    noise = (frame.sync_bytes + b"\x36\xfe") * 20_000
    decoder = FrameDecoder(frame)
    for k in range(0, len(noise), 4096):
        decoder.feed(noise[k : k + 4096])
    assert len(decoder._buffer) <= frame.max_size
    assert decoder.skipped + len(decoder._buffer) == len(noise)
