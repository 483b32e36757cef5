"""`[corrected]` of an IMU profile: what fits its link and what is refused by the entry; the drivers' byte pairs."""

import tomllib
from pathlib import Path
from typing import Any

import pytest
from test_framed_imu import driver as framed
from test_framed_imu import reply_frame, request
from test_modbus_imu import driver as modbus
from test_modbus_imu import write
from test_vectornav_imu import driver as vectornav
from test_vectornav_imu import pair

from calstation.devices.profiles.imu import ImuProfile
from calstation.errors import ConfigurationError
from calstation.schema import validate

IMUS = Path(__file__).parents[2] / "data" / "imus"


COUNTER_ALONE = {
    "sync": "55 AB",
    "byte_order": "little",
    "fields": [{"name": "counter", "type": "u16"}],
    "crc": {"kind": "crc16_ccitt_false", "start": 2},
}


def profile(name: str, corrected: dict[str, Any] | None, **changes: Any) -> ImuProfile:
    data = tomllib.loads((IMUS / f"{name}.toml").read_text(encoding="utf-8"))
    data |= {"corrected": corrected}
    for section, values in changes.items():
        data[section] = {**data[section], **values} if isinstance(values, dict) else values
    return validate(ImuProfile, data, name)


@pytest.mark.parametrize(
    ("name", "corrected", "changes", "told"),
    [
        ("bench_nav", {"stream": 2}, {"stream": {"order": "after_registers"}}, "follows them; remove it"),
        ("stim300", {"stream": 2}, {}, 'does not belong to protocol = "stream"'),
        ("bench_nav", {}, {}, "takes stream and no start"),
        ("bench_nav", {"stream": 2, "start": ["VNWRG,06,0"]}, {}, "takes stream and no start"),
        ("vectornav_vn100", {"stream": 2}, {}, "takes start and no stream"),
        ("vectornav_vn100", {"start": ["$VNWRG,06,0*00"]}, {}, "without"),
        ("bench_nav", {"stream": 1}, {}, "corrected.stream = 1 is what the raw stream"),
        ("bench_nav", {"stream": 256}, {}, "more than a byte"),
        ("dsp_modbus", {"stream": 0}, {}, "corrected.stream = 0 is what the raw stream"),
        ("dsp_modbus", {"stream": 2}, {"modbus": {"stream": None}}, "needs modbus.stream"),
        (
            "bench_nav",
            {"stream": 2, "frame": COUNTER_ALONE},
            {},
            "'gyro_x' is missing",
        ),
    ],
)
def test_what_does_not_fit_is_told(
    name: str, corrected: dict[str, Any], changes: dict[str, Any], told: str
) -> None:
    with pytest.raises(ConfigurationError) as error:
        profile(name, corrected, **changes)
    assert told in str(error.value)


def own_frame(name: str, place: str, value: Any) -> dict[str, Any]:
    """`[corrected]` of a shipped profile with a frame of its own: the raw one, or the one it has, a value changed."""
    data = tomllib.loads((IMUS / f"{name}.toml").read_text(encoding="utf-8"))
    frame = data["corrected"].get("frame", data["frame"])
    if place == "fields":
        frame["fields"] = value(frame["fields"])
    else:
        frame[place] = value
    return {**data["corrected"], "frame": frame}


def without_status(fields: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [field for field in fields if field["name"] != "status"]


def at_half_the_rate(fields: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{**f, "per_sample": 1e7} if f["name"] == "counter" else f for f in fields]


@pytest.mark.parametrize(
    ("name", "place", "value", "told"),
    [
        (
            "bench_nav",
            "fields",
            without_status,
            "corrected.frame: status.ready = 0x0001 looks at bits that no field of the frame holds",
        ),
        (
            "bench_nav",
            "fields",
            lambda fields: [*({"name": f"spare{i}", "type": "u64"} for i in range(80)), *fields],
            "corrected.frame: link.baud = 921600 is too slow for stream.sample_rate_hz = 200 with frames of 674",
        ),
        ("bench_nav", "sync", "55 5A", "corrected.frame.sync: begins as commands.reply_sync does"),
        ("bench_nav", "sync", "55", "corrected.frame.sync: begins as commands.reply_sync does"),
        (
            "vectornav_vn100",
            "fields",
            at_half_the_rate,
            "corrected.frame: field 'counter': per_sample = 1e+07 does not fit stream.sample_rate_hz = 200",
        ),
    ],
)
def test_a_frame_of_its_own_is_checked_as_the_raw_one(name: str, place: str, value: Any, told: str) -> None:
    with pytest.raises(ConfigurationError) as error:
        profile(name, own_frame(name, place, value))
    assert told in str(error.value)
    assert "; " in str(error.value)


def test_the_framed_link_is_told_by_a_byte() -> None:
    pairs = [(request(6, bytes([k])), reply_frame(6, bytes([k]))) for k in (2, 1)]
    with framed(pairs) as (imu, link):
        imu.start(corrected=True)
        imu.start()
        assert link.finished


def test_the_modbus_link_is_told_by_a_value() -> None:
    with modbus([write(20, 2), write(20, 1)]) as (imu, link):
        imu.start(corrected=True)
        imu.start()
        assert link.finished


def test_the_vectornav_is_told_by_lines() -> None:
    raw = [pair("VNWRG,06,0"), pair("VNWRG,75,1,4,05,0001,001C")]
    with vectornav([pair("VNWRG,06,0"), pair("VNWRG,75,1,4,05,0001,0610"), *raw]) as (imu, link):
        imu.start(corrected=True)
        imu.start()
        assert link.finished
