"""Frames and register protocol of the simulated IMU, byte by byte."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.bench import BenchConfig
from calstation.bench.imu.unit import BOOT_TIME, STREAM, crc16, stream_frames
from calstation.bench.imu.units.framed import COMMAND_SYNC, FLASH_TIME, CommandParser, FramedUnit, pack
from calstation.bench.truth import StreamOutput

IDENTIFY, READ, WRITE, COMMIT, RESET, STREAM_OP, ERROR = 1, 2, 3, 4, 5, 6, 255


def unit(**changes):
    return FramedUnit(BenchConfig(**{"serial": "SN-7", "warm_up_c": 0.0, "ambient_c": 21.5, **changes}))


def reply(op, payload):
    body = bytes([op, len(payload)]) + payload
    return b"\x55\x5a" + body + struct.pack("<H", crc16(body))


def output(count, saturated=False):
    counts = np.arange(6.0 * count).reshape(count, 6) - 2.0
    return StreamOutput(counts, np.full(count, saturated))


def test_checksum_is_crc_16_ccitt_false():
    assert crc16(b"123456789") == 0x29B1


def test_a_stream_frame_has_the_documented_34_bytes():
    counts = np.array([[1.0, -2.0, 3.0, 2.0**31, -(2.0**31), 6.0]])
    frame = stream_frames(np.array([65537]), counts, 21.5, np.array([3]))
    body = struct.pack("<H6ihH", 1, 1, -2, 3, 2**31 - 1, -(2**31), 6, 2150, 3)
    assert frame == b"\x55\xaa" + body + struct.pack("<H", crc16(body))
    assert len(frame) == STREAM.itemsize == 34


def test_identify_returns_model_serial_number_and_version():
    assert unit().answer(IDENTIFY, b"", 0.0) == reply(IDENTIFY, b"bench-imu;SN-7;1.0.0")


def test_float32_registers_are_written_and_read_back():
    imu = unit()
    values = struct.pack("<2f", 1.5e-5, -0.25)
    assert imu.answer(WRITE, struct.pack("<HB", 3, 2) + values, 0.0) == reply(WRITE, struct.pack("<HB", 3, 2))
    assert imu.answer(READ, struct.pack("<HB", 3, 2), 0.0) == reply(READ, struct.pack("<HB", 3, 2) + values)


@pytest.mark.parametrize(
    ("op", "payload", "code"),
    [
        (9, b"", 1),
        (READ, struct.pack("<HB", 29, 2), 2),
        (READ, struct.pack("<HB", 0, 0), 2),
        (READ, b"\x00", 2),
        (WRITE, struct.pack("<HB", 30, 1) + bytes(4), 2),
        (WRITE, struct.pack("<HB", 0, 2) + bytes(4), 2),
    ],
)
def test_invalid_command_gets_an_error_reply(op, payload, code):
    assert unit().answer(op, payload, 0.0) == reply(ERROR, bytes([code]))


def test_registers_survive_a_reset_only_after_a_commit_to_flash():
    imu = unit()
    imu.answer(WRITE, struct.pack("<HBf", 0, 1, 2.5), 0.0)
    assert imu.answer(RESET, b"", 1.0) == reply(RESET, b"\x00")
    assert imu.registers[0] == 0.0
    imu.answer(WRITE, struct.pack("<HBf", 0, 1, 2.5), 2.0)
    assert imu.answer(COMMIT, b"", 2.0) == reply(COMMIT, struct.pack("<BI", 0, 1))
    imu.answer(RESET, b"", 3.0)
    assert imu.registers[0] == 2.5


def test_flash_is_busy_for_some_time_after_a_commit():
    imu = unit()
    imu.answer(COMMIT, b"", 1.0)
    busy = reply(ERROR, b"\x03")
    assert imu.answer(COMMIT, b"", 1.0 + FLASH_TIME / 2) == busy
    assert imu.answer(WRITE, struct.pack("<HBf", 0, 1, 1.0), 1.0 + FLASH_TIME / 2) == busy
    assert imu.answer(COMMIT, b"", 1.0 + FLASH_TIME) == reply(COMMIT, struct.pack("<BI", 0, 2))


def test_flash_file_keeps_registers_and_write_cycles_over_a_power_cycle(tmp_path):
    file = tmp_path / "flash.bin"
    first = unit(flash_file=file)
    first.answer(WRITE, struct.pack("<HBf", 29, 1, -1.25), 0.0)
    first.answer(COMMIT, b"", 0.0)
    second = unit(flash_file=file)
    assert second.registers[29] == -1.25
    assert second.flash.cycles == 1


def test_frames_flag_power_up_reset_and_saturation():
    imu = unit(ready_time_s=1.0)
    ends = np.arange(1, 11) * BOOT_TIME / 5
    frames = np.frombuffer(imu.frames(output(10), ends), dtype=STREAM)
    # The unit is silent while booting, then counts from 0 before it is ready.
    assert np.array_equal(frames["counter"], np.arange(5))
    assert np.all(frames["status"] == 0)
    later = np.frombuffer(imu.frames(output(2, saturated=True), np.array([1.0, 1.1])), dtype=STREAM)
    assert np.array_equal(later["counter"], [5, 6])
    assert np.all(later["status"] == 3)
    assert np.all(later["temperature"] == 2150)
    imu.answer(RESET, b"", 2.0)
    assert imu.frames(output(1), np.array([2.05])) == b""
    again = np.frombuffer(imu.frames(output(1), np.array([2.2])), dtype=STREAM)
    assert (again["counter"][0], again["status"][0]) == (0, 0)


def test_counter_continues_while_the_stream_is_off():
    imu = unit()
    assert imu.answer(STREAM_OP, b"\x00", 1.0) == reply(STREAM_OP, b"\x00")
    assert imu.frames(output(3), np.array([1.1, 1.2, 1.3])) == b""
    imu.answer(STREAM_OP, b"\x01", 1.3)
    frames = np.frombuffer(imu.frames(output(1), np.array([1.4])), dtype=STREAM)
    assert frames["counter"][0] == 3


def test_temperature_rises_exponentially():
    imu = unit(warm_up_c=4.0, warm_up_time_s=30.0)
    assert imu.temperature(30.0) == pytest.approx(21.5 + 4.0 * (1.0 - np.exp(-1.0)))


@given(
    commands=st.lists(st.tuples(st.integers(1, 6), st.binary(max_size=40)), max_size=5),
    noise=st.binary(max_size=9).filter(lambda data: b"\x55" not in data),
    cuts=st.lists(st.integers(0, 300), max_size=6),
)
def test_commands_are_recognised_however_the_bytes_are_split(commands, noise, cuts):
    data = noise.join([b"", *(pack(COMMAND_SYNC, op, payload) for op, payload in commands), b""])
    parser, found, last = CommandParser(), [], 0
    for cut in [*sorted(cuts), len(data)]:
        found += parser.feed(data[last:cut])
        last = max(last, cut)
    assert found == commands


def test_command_with_a_wrong_checksum_is_ignored():
    good = pack(COMMAND_SYNC, IDENTIFY)
    spoilt = bytearray(pack(COMMAND_SYNC, COMMIT))
    spoilt[-1] ^= 1
    assert CommandParser().feed(bytes(spoilt) + good) == [(IDENTIFY, b"")]
