"""The Modbus IMU driver on the line of the stream, tested with request and response bytes."""

import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from fastcrc import crc16
from test_frames import stream_frame

from calstation.devices.imu import ImuBusyError, ImuRefusalError, RegisterMap
from calstation.devices.imu.drivers.modbus import ModbusImu
from calstation.devices.profiles import ImuProfile, load_imu_profile
from calstation.devices.profiles.imu_protocols.modbus import ModbusProtocol
from calstation.errors import DeviceFaultError
from tests.devices.scripted import ScriptedDevice
from tests.helpers import raises_code

PROFILE = load_imu_profile(Path(__file__).parents[2] / "data" / "imus" / "dsp_modbus.toml").with_commands(timeout_s=0.4)
MAP = RegisterMap(tuple(PROFILE.registers))
Pair = tuple[bytes, bytes]


def rtu(*body: int) -> bytes:
    frame = bytes(body)
    return frame + struct.pack("<H", crc16.modbus(frame))


def read(address: int, words: bytes) -> Pair:
    request = rtu(1, 3, *struct.pack(">HH", address, len(words) // 2))
    return request, rtu(1, 3, len(words), *words)


def write(address: int, value: int) -> Pair:
    frame = rtu(1, 6, *struct.pack(">HH", address, value))
    return frame, frame


def write_many(address: int, words: bytes) -> Pair:
    head = struct.pack(">HH", address, len(words) // 2)
    return rtu(1, 16, *head, len(words), *words), rtu(1, 16, *head)


ON, OFF = write(20, 1), write(20, 0)
IDENTITY = [
    read(0, b"bench-dsp".ljust(16, b"\0")),
    read(8, b"SN-000042".ljust(16, b"\0")),
    read(16, b"2.0".ljust(8, b"\0")),
]


def section(profile: ImuProfile) -> ModbusProtocol:
    assert profile.modbus is not None
    return profile.modbus


@contextmanager
def driver(pairs: list[Pair], profile: ImuProfile = PROFILE) -> Iterator[tuple[ModbusImu, ScriptedDevice]]:
    link = ScriptedDevice(pairs)
    imu = ModbusImu(link, profile)  # type: ignore[arg-type]
    try:
        yield imu, link
    finally:
        imu.close()


def wire(values: dict[str, float]) -> dict[tuple[int, int], bytes]:
    """Pack registers by page and address as the comments of the profile describe, independently."""
    numbers = MAP.encode(values)

    def words(data: bytes) -> bytes:
        return b"".join(data[k + 2 : k + 4] + data[k : k + 2] for k in range(0, len(data), 4))

    gyro, offset = numbers[1 << 16 | 100], numbers[1 << 16 | 118]
    matrix, bias = numbers[2 << 16 | 200], numbers[2 << 16 | 212]
    quadratic, lever = numbers[2 << 16 | 218], numbers[2 << 16 | 224]
    return {
        (1, 100): words(struct.pack(">9f", *gyro)),
        (1, 118): struct.pack(">3d", *offset),
        (2, 200): struct.pack(">6i", *(round(v * 2**30) for v in matrix)),
        (2, 212): words(struct.pack(">3i", *(int(v) for v in bias))),
        (2, 218): struct.pack(">3f", *quadratic),
        (2, 224): struct.pack(">3h", *(int(v) for v in lever)),
    }


VALUES = MAP.rounded(
    {n: (-1) ** i * (1e-3 + 1e-4 * i) * (1e-2 if "quadratic" in n else 1.0) for i, n in enumerate(MAP.parameters)}
)


def test_identity_and_samples_are_read() -> None:
    with driver([ON, *IDENTITY]) as (imu, link):
        imu.start()
        identity = imu.identify()
        assert (identity.model, identity.serial, identity.firmware) == ("bench-dsp", "SN-000042", "2.0")
        link.send(stream_frame(7, [1, 2, 3, 4, 5, 6]) + stream_frame(8, [0] * 6)[:20])
        link.send(stream_frame(8, [0] * 6)[20:])
        deadline = time.monotonic() + 5.0
        while imu.stats.frames < 2 and time.monotonic() < deadline:
            time.sleep(0.001)
        assert imu.read().seq.tolist() == [7, 8]
        assert link.finished


def test_registers_are_read_page_by_page_while_the_stream_is_off() -> None:
    pairs = [OFF]
    for (page, address), words in wire(VALUES).items():
        pairs += [write(23, page), read(address, words)]
    # The replies arrive between frames that were sent before.
    pairs = [(request, stream_frame(1, [0] * 6) + reply) for request, reply in pairs]
    with driver([ON, *pairs, ON]) as (imu, link):
        imu.start()
        found = imu.read_registers()
        assert MAP.differing_parameters(VALUES, found) == []
        assert link.finished


def test_registers_are_written_page_by_page() -> None:
    pairs = [OFF]
    for (page, address), words in wire(VALUES).items():
        pairs += [write(23, page), write_many(address, words)]
    with driver(pairs) as (imu, link):
        imu.write_registers(VALUES)
        assert link.finished, "a stream that was never switched on is not switched on behind it"


MARK = struct.pack(">3d", *[-1.0 + 2.0 * 0.381966] * 3)


def marking() -> list[Pair]:
    """Return the requests that set a marker in the gyro offsets before a restart; a matrix must stay invertible."""
    page = write(23, 1)
    idle = read(21, b"\0\0")
    return [OFF, idle, page, read(118, bytes(24)), page, write_many(118, MARK), page, read(118, MARK), ON]


def test_commit_waits_for_completion_and_reset_for_a_response() -> None:
    commit = [OFF, write(21, 0x5A5A), read(21, b"\x5a\x5a"), read(21, b"\0\0"), ON]
    reset = [*marking(), write(22, 0xA5A5), *IDENTITY, OFF, write(23, 1), read(118, bytes(24)), ON, ON]
    with driver([ON, *commit, *reset]) as (imu, link):
        imu.start()
        imu.commit()
        imu.reset()
        assert link.finished


@pytest.mark.parametrize("code", [5, 6])
def test_busy_flash_is_polled_until_it_is_ready(code: int) -> None:
    order, look = write(21, 0x5A5A), read(21, b"\0\0")
    busy = [(look[0], rtu(1, 0x83, code))] * 5
    with driver([OFF, order, *busy, look]) as (imu, link):
        imu.commit()
        assert link.finished


def test_commit_acknowledged_by_an_exception_is_polled_until_complete() -> None:
    order, look = write(21, 0x5A5A), read(21, b"\0\0")
    with driver([OFF, (order[0], rtu(1, 0x86, 5)), (look[0], rtu(1, 0x83, 5)), look]) as (imu, link):
        imu.commit()
        assert link.finished
    plain = section(PROFILE)
    plain = plain.model_copy(update={"commit": plain.commit.model_copy(update={"done": None})})
    name = read(0, b"be")
    pairs = [OFF, (order[0], rtu(1, 0x86, 5)), (name[0], rtu(1, 0x83, 6)), name]
    with driver(pairs, PROFILE.model_copy(update={"modbus": plain})) as (imu, link):
        imu.commit()
        assert link.finished


def test_a_commit_refused_by_a_busy_unit_is_reported() -> None:
    with (
        driver([OFF, (write(21, 0x5A5A)[0], rtu(1, 0x86, 6))]) as (imu, _),
        raises_code(ImuBusyError, "imu.register_refused"),
    ):
        imu.commit()


def test_unfinished_commit_is_reported_and_a_lost_commit_is_not_repeated() -> None:
    quick = PROFILE.model_copy(update={"modbus": section(PROFILE).model_copy(update={"commit_timeout_s": 0.1})})
    busy = [read(21, b"\x5a\x5a")] * 200
    with (
        driver([OFF, write(21, 0x5A5A), *busy], quick) as (imu, _),
        raises_code(DeviceFaultError, "imu.commit_not_done"),
    ):
        imu.commit()
    with driver([OFF], quick) as (imu, link):
        with raises_code(DeviceFaultError, "imu.answer_not_framed"):
            imu.commit()
        assert link.unexpected == [write(21, 0x5A5A)[0]]


@pytest.mark.parametrize(
    ("number", "meaning"),
    [
        (1, "imu.modbus_1"),
        (2, "imu.modbus_2"),
        (3, "imu.modbus_3"),
        (4, "imu.modbus_4"),
        (6, "imu.modbus_6"),
        (8, "imu.modbus_8"),
        (11, "imu.modbus_11"),
        (99, "imu.modbus_other"),
    ],
)
def test_an_exception_is_reported_with_its_meaning(number: int, meaning: str) -> None:
    with driver([(IDENTITY[0][0], rtu(1, 0x83, number))]) as (imu, _):
        with raises_code(ImuRefusalError, "imu.register_refused") as caught:
            imu.identify()
        assert caught.value.values["number"] == number
        assert caught.value.values["reason"].code == meaning


def test_request_with_a_lost_or_damaged_response_is_repeated() -> None:
    request, reply = IDENTITY[0]
    hurt = reply[:5] + bytes([reply[5] ^ 4]) + reply[6:]
    other = rtu(1, 3, 2, 0, 7)
    between = read(16, b"2.0".ljust(8, b"\0"))  # its length differs from that of replies that may still arrive
    lost = [(request, b""), between, (request, hurt), between]
    with driver([*lost, (request, other + reply), *IDENTITY[1:]]) as (imu, link):
        assert imu.identify().model == "bench-dsp"
        assert link.finished
        assert imu.stats.crc_errors >= 1


def test_stream_is_not_stopped_for_a_unit_that_allows_requests_while_streaming() -> None:
    stream = section(PROFILE).stream
    assert stream is not None
    talks = section(PROFILE).model_copy(update={"stream": stream.model_copy(update={"off": None}), "page": None})
    profile = PROFILE.model_copy(update={"modbus": talks})
    pairs = [read(address, words) for (_, address), words in wire(VALUES).items()]
    with driver(pairs, profile) as (imu, link):
        assert MAP.differing_parameters(VALUES, imu.read_registers()) == []
        assert link.finished
