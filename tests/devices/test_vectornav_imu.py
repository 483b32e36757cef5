"""The VectorNav driver tested with request and reply bytes between samples."""

import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from fastcrc import crc16

from calstation.devices import OtherModelError
from calstation.devices.imu import ImuRefusalError, RegisterMap
from calstation.devices.imu.drivers.vectornav import VectorNavImu, line
from calstation.devices.profiles import ImuProfile, load_imu_profile
from calstation.errors import DeviceFaultError
from tests.devices.scripted import ScriptedDevice
from tests.helpers import raises_code

PROFILE = load_imu_profile(Path(__file__).parents[2] / "data" / "imus" / "vectornav_vn100.toml").with_commands(
    timeout_s=0.15
)
MAP = RegisterMap(tuple(PROFILE.registers))
PLAIN = "1,0,0,0,1,0,0,0,1,0,0,0"


def checked_line(words: str) -> bytes:
    """Return a line with its independently computed checksum."""
    check = 0
    for byte in words.encode():
        check ^= byte
    return f"${words}*{check:02X}\r\n".encode()


def pair(words: str, reply: str | None = None) -> tuple[bytes, bytes]:
    return checked_line(words), checked_line(words if reply is None else reply)


def sample(nanoseconds: int, *values: float) -> bytes:
    body = b"\x05\x01\x00\x1c\x00" + struct.pack("<Q7f", nanoseconds, *values)
    return b"\xfa" + body + struct.pack(">H", crc16.xmodem(body))


@contextmanager
def driver(
    pairs: list[tuple[bytes, bytes]], profile: ImuProfile = PROFILE
) -> Iterator[tuple[VectorNavImu, ScriptedDevice]]:
    link = ScriptedDevice(pairs)
    imu = VectorNavImu(link, profile)  # type: ignore[arg-type]
    try:
        yield imu, link
    finally:
        imu.close()


IDENTITY = [
    pair("VNRRG,1", "VNRRG,01,VN-100T-CR"),
    pair("VNRRG,3", "VNRRG,03,0100012345"),
    pair("VNRRG,4", "VNRRG,04,2.1.0.0"),
]


def test_lines_match_known_checksums() -> None:
    assert line("VNWNV", "xor8") == b"$VNWNV*57\r\n"
    assert line("VNRST", "xor8") == b"$VNRST*4D\r\n"
    assert line("VNRFS", "xor8") == b"$VNRFS*5F\r\n"
    assert line(f"VNWRG,25,{PLAIN}", "xor8").endswith(b"*70\r\n")
    assert line(f"VNWRG,84,{PLAIN}", "xor8").endswith(b"*7B\r\n")
    assert line("VNRRG,30,0,0,0,0,1,0,1", "xor8").endswith(b"*6C\r\n"), "example of the manual"
    crc = crc16.xmodem(b"VNRRG,1")
    assert line("VNRRG,1", "crc16_xmodem") == f"$VNRRG,1*{crc:04X}\r\n".encode()


def test_stream_starts_and_identity_and_samples_are_read() -> None:
    pairs = [pair("VNWRG,06,0"), pair("VNWRG,75,1,4,05,0001,001C"), *IDENTITY]
    with driver(pairs) as (imu, link):
        imu.start()
        identity = imu.identify()
        assert (identity.model, identity.serial, identity.firmware) == ("VN-100T-CR", "0100012345", "2.1.0.0")
        link.send(b"$VNYMR,1,2*00\r\n" + sample(5_000_000, 1, 2, 3, 4, 5, 6, 25.5)[:30])
        link.send(
            sample(5_000_000, 1, 2, 3, 4, 5, 6, 25.5)[30:] + checked_line("VNYPR,1,2,3") + sample(15_000_000, *range(7))
        )
        deadline = time.monotonic() + 5.0
        while imu.stats.frames < 2 and time.monotonic() < deadline:
            time.sleep(0.001)
        batch = imu.read()
        assert batch.seq.tolist() == [1, 3]
        assert batch.counts[0].tolist() == [4, 5, 6, 1, 2, 3]
        assert batch.temperature.tolist() == [25.5, 6.0]
        assert imu.stats.gaps == 1
        assert link.finished


def test_another_model_is_refused() -> None:
    with (
        driver([pair("VNRRG,1", "VNRRG,01,VN-300"), *IDENTITY[1:]]) as (imu, _),
        raises_code(OtherModelError, "imu.other_model"),
    ):
        imu.identify()


def test_register_requests_match_the_protocol() -> None:
    as_the_unit_prints = ",".join(f"{float(text):+.6E}" for text in PLAIN.split(","))
    read = [
        pair("VNRRG,25", f"VNRRG,25,{as_the_unit_prints}"),
        pair("VNRRG,84", "VNRRG,84,1,0,0,0,1,0,0,0,1,0.001,-2.5E-03,0"),
    ]
    with driver(read) as (imu, link):
        values = imu.read_registers()
        assert values["gyro_bias_y"] == pytest.approx(-2.5e-3)
        assert values["accel_scale_x"] == 0.0
        assert link.finished


def test_values_are_written_with_full_precision() -> None:
    values = MAP.rounded({n: 1.23456789e-4 * (i + 1) for i, n in enumerate(MAP.parameters)})
    numbers = MAP.encode(values)
    pairs = []
    for address in (25, 84):
        values_text = ",".join(f"{v:.9G}" for v in numbers[address])
        pairs.append(pair(f"VNWRG,{address},{values_text}"))
    with driver(pairs) as (imu, link):
        imu.write_registers(values)
        assert link.finished
    for request, _ in pairs:
        back = [float(text) for text in request.decode().split("*")[0].split(",")[2:]]
        packed = struct.pack("<12f", *back)
        assert list(struct.unpack("<12f", packed)) in list(numbers.values()), "float32 exactly as meant"


def test_commit_is_sent_once_and_the_stream_restarts_after_a_reset() -> None:
    start = [pair("VNWRG,06,0"), pair("VNWRG,75,1,4,05,0001,001C")]
    shown = f"VNRRG,25,{PLAIN}"
    mark = ",".join(f"{v:.9G}" for v in np.float32([1, 0, 0, 0, 1, 0, 0, 0, 1, *[-10.0 + 20.0 * 0.381966] * 3]))
    marking = [pair("VNRRG,25", shown), pair(f"VNWRG,25,{mark}"), pair("VNRRG,25", f"VNRRG,25,{mark}")]
    restart = [pair("VNRST"), *IDENTITY, pair("VNRRG,25", shown)]
    with driver([*start, pair("VNWNV"), *marking, *restart, *start]) as (imu, link):
        imu.start()
        imu.commit()
        imu.reset()
        assert link.finished


def test_commit_is_never_repeated() -> None:
    section = PROFILE.vectornav
    assert section is not None
    quick = PROFILE.model_copy(update={"vectornav": section.model_copy(update={"commit_timeout_s": 0.15})})
    with driver([], quick) as (imu, link):
        with raises_code(DeviceFaultError, "imu.silent"):
            imu.commit()
        assert link.unexpected == [checked_line("VNWNV")]


@pytest.mark.parametrize(
    ("reply", "meaning"),
    [
        ("VNERR,01", "imu.vectornav_1"),
        ("VNERR,03", "imu.vectornav_3"),
        ("VNERR,08", "imu.vectornav_8"),
        ("VNERR,09", "imu.vectornav_9"),
        ("VNERR,0C", "imu.vectornav_12"),
        ("VNERR,FF", "imu.vectornav_255"),
        ("VNERR,77", "imu.vectornav_other"),
        ("VNERR,", "imu.vectornav_other"),
        ("VNERR", "imu.vectornav_other"),
    ],
)
def test_error_reply_is_reported_with_its_meaning(reply: str, meaning: str) -> None:
    with driver([pair("VNRRG,25", reply)]) as (imu, _):
        with raises_code(ImuRefusalError, "imu.line_refused") as caught:
            imu.read_registers()
        assert caught.value.values["line"] == "VNRRG,25"
        assert caught.value.values["reason"].code == meaning


@pytest.mark.parametrize("reply", ["VNRRG,25,1,2,3", "VNRRG,25,a,b,c,d,e,f,g,h,i,j,k,l", "VNRRG,25"])
def test_invalid_reply_is_reported(reply: str) -> None:
    with driver([pair("VNRRG,25", reply)]) as (imu, _), raises_code(DeviceFaultError, "imu.answer_numbers"):
        imu.read_registers()


def test_unrelated_lines_and_wrong_checksums_are_skipped() -> None:
    request, reply = pair("VNRRG,1", "VNRRG,01,VN-100")
    noise = checked_line("VNRRG,2,other") + b"$VNRRG,01,VN-300*00\r\n" + b"$VN" + checked_line("VNYPR,1,2,3")
    with driver([(request, noise + reply), *IDENTITY[1:]]) as (imu, _):
        assert imu.identify().model == "VN-100"
        assert imu.stats.crc_errors >= 1


def test_sixteen_bit_checksum_is_supported() -> None:
    section = PROFILE.vectornav
    assert section is not None
    profile = PROFILE.model_copy(update={"vectornav": section.model_copy(update={"check": "crc16_xmodem"})})

    def crc_line(words: str) -> bytes:
        return f"${words}*{crc16.xmodem(words.encode()):04X}\r\n".encode()

    pairs = [(crc_line("VNWNV"), crc_line("VNWNV"))]
    with driver(pairs, profile) as (imu, link):
        imu.commit()
        assert link.finished
