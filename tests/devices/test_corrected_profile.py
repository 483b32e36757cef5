"""The section `[corrected]` of an IMU profile: valid and refused entries, and the bytes that the drivers exchange."""

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

from calstation.devices.profiles import ImuProfile
from calstation.errors import ConfigurationError
from calstation.schema import validate
from tests.helpers import error_code

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
    ("name", "corrected", "changes", "expected"),
    [
        ("bench_nav", {"stream": 2}, {"stream": {"order": "after_registers"}}, "corrected profile.not_with"),
        ("stim300", {"stream": 2}, {}, "corrected profile.not_with"),
        ("bench_nav", {}, {}, "corrected.stream profile.needed_by"),
        ("bench_nav", {"stream": 2, "start": ["VNWRG,06,0"]}, {}, "corrected.start profile.not_with"),
        ("vectornav_vn100", {"stream": 2}, {}, "corrected.start profile.needed_by"),
        ("vectornav_vn100", {"start": ["$VNWRG,06,0*00"]}, {}, "corrected.start[1] profile.not_a_command_line"),
        ("bench_nav", {"stream": 1}, {}, "corrected.stream profile.stream_value_of_raw"),
        ("bench_nav", {"stream": 256}, {}, "corrected.stream entry.out_of_range"),
        ("dsp_modbus", {"stream": 0}, {}, "corrected.stream profile.stream_value_of_raw"),
        ("dsp_modbus", {"stream": 2}, {"modbus": {"stream": None}}, "modbus.stream profile.needed_by"),
        ("bench_nav", {"stream": 2, "frame": COUNTER_ALONE}, {}, "corrected.frame.fields profile.field_missing"),
    ],
)
def test_incompatible_corrected_sections_are_reported(
    name: str, corrected: dict[str, Any], changes: dict[str, Any], expected: str
) -> None:
    with pytest.raises(ConfigurationError) as error:
        profile(name, corrected, **changes)
    assert error_code(error.value) == expected


def own_frame(name: str, place: str, value: Any) -> dict[str, Any]:
    """Return `[corrected]` of a shipped profile with its own frame, in which one value is changed."""
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
    ("name", "place", "value", "expected"),
    [
        ("bench_nav", "fields", without_status, "status.ready profile.mask_outside_frame"),
        (
            "bench_nav",
            "fields",
            lambda fields: [*({"name": f"spare{i}", "type": "u64"} for i in range(80)), *fields],
            "link.baud profile.baud_too_low",
        ),
        ("bench_nav", "sync", "55 5A", "corrected.frame.sync profile.sync_of_replies"),
        ("bench_nav", "sync", "55", "corrected.frame.sync profile.sync_of_replies"),
        (
            "vectornav_vn100",
            "fields",
            at_half_the_rate,
            'corrected.frame.fields["counter"].per_sample profile.clock_rate',
        ),
    ],
)
def test_corrected_frame_is_validated_like_the_raw_frame(name: str, place: str, value: Any, expected: str) -> None:
    with pytest.raises(ConfigurationError) as error:
        profile(name, own_frame(name, place, value))
    assert error_code(error.value) == expected


def test_corrected_output_is_selected_by_a_byte_on_the_framed_link() -> None:
    pairs = [(request(6, bytes([k])), reply_frame(6, bytes([k]))) for k in (2, 1)]
    with framed(pairs) as (imu, link):
        imu.start(corrected=True)
        imu.start()
        assert link.finished


def test_corrected_output_is_selected_by_a_value_on_modbus() -> None:
    with modbus([write(20, 2), write(20, 1)]) as (imu, link):
        imu.start(corrected=True)
        imu.start()
        assert link.finished


def test_corrected_output_is_selected_by_lines_on_a_vectornav() -> None:
    raw = [pair("VNWRG,06,0"), pair("VNWRG,75,1,4,05,0001,001C")]
    with vectornav([pair("VNWRG,06,0"), pair("VNWRG,75,1,4,05,0001,0610"), *raw]) as (imu, link):
        imu.start(corrected=True)
        imu.start()
        assert link.finished
