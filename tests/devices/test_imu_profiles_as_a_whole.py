"""An IMU profile whose parts contradict each other is refused in one sentence that names the entry."""

import copy
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.devices.profiles.imu import load_imu_profile
from calstation.errors import ConfigurationError

DATA = Path(__file__).parents[2] / "data" / "imus"
DSP, NAV, MIP, VN = "dsp_modbus", "bench_nav", "microstrain_mip", "vectornav_vn100"


def edited(name: str, changes: dict[str, Any]) -> dict[str, Any]:
    """A shipped profile with values changed by their places, `None` to take one out."""
    data = copy.deepcopy(tomllib.loads((DATA / f"{name}.toml").read_text(encoding="utf-8")))
    for where, value in changes.items():
        *parents, last = where.split("/")
        place: Any = data
        for part in parents:
            place = place[int(part)] if isinstance(place, list) else place[part]
        key: Any = int(last) if isinstance(place, list) else last
        if value is None:
            del place[key]
        else:
            place[key] = value
    return data


def told(tmp_path: Path, name: str, changes: dict[str, Any]) -> str:
    path = tmp_path / "profile.toml"
    path.write_text(tomli_w.dumps(edited(name, changes)), encoding="utf-8")
    with pytest.raises(ConfigurationError) as caught:
        load_imu_profile(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"registers/1/address": 8}, "page 1 register 8-19 and modbus.serial (registers 8-15) overlap"),
        ({"modbus/commit/address": 119}, "page 1 register 118-129 and modbus.commit (register 119) overlap"),
        ({"modbus/reset/address": 100}, "and modbus.reset (register 100) overlap"),
        ({"modbus/stream/address": 213}, "and modbus.stream (register 213) overlap"),
        ({"modbus/page": 101}, "page 1 register 100-117 and modbus.page (register 101) overlap"),
        ({"modbus/serial/address": 4}, "modbus.model (registers 0-7) and modbus.serial (registers 4-11)"),
        ({"modbus/page": 21}, "modbus.commit (register 21) and modbus.page (register 21) overlap"),
        (
            {"modbus/commit/address": 22, "modbus/commit/value": 0xA5A5},
            "modbus.commit and modbus.reset write the same to register 22",
        ),
        (
            {"modbus/commit/address": 20, "modbus/commit/value": 0, "modbus/commit/done": 7},
            "modbus.commit and modbus.stream write the same to register 20",
        ),
        ({"modbus/commit/done": 0x5A5A}, "modbus.commit: done = 23130 is what is written"),
        ({"modbus/serial/address": 65530}, "modbus.serial: registers 65530-65537 runs past 65535"),
        ({"registers/1/address": 65530}, "page 1 register 65530-65541 runs past address 65535"),
        ({"registers/0/span": 1}, "span = 1 does not fit type f32, which takes 2 registers of 16 bits"),
        ({"registers/1/span": 8}, "span = 8 does not fit type f64, which takes 4 registers"),
        ({"registers/0/span": 0}, "span = 0 does not fit type f32"),
        ({"registers/0/tolerance": 1e9}, "tolerance = 1e+09 is more than a hundredth of the range"),
        ({"prior/gyro_scale": None}, "gyro_scale_x has a register but no prior"),
        (
            {"registers/3/type": "i16", "registers/3/scale": 1.0, "registers/3/word_order": "big"},
            "a step of type i16 × 1 is more than the prior of accel_bias_x",
        ),
        ({"registers/2/convention/identity": True}, "negated belongs to identity = false"),
        (
            {"registers/0/convention/offset": "before"},
            "page 1 register 100-117: convention.offset = 'before' contradicts page 1 register 118-129",
        ),
        (
            {"registers/1/convention/matrix": "correction"},
            "page 1 register 118-129: convention.matrix = 'correction' contradicts page 1 register 100-117",
        ),
    ],
)
def test_registers_of_a_modbus_unit(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    assert words in told(tmp_path, DSP, changes)


def test_one_command_register_may_take_several_values(tmp_path: Path) -> None:
    path = tmp_path / "profile.toml"
    path.write_text(tomli_w.dumps(edited(DSP, {"modbus/reset/address": 21})), encoding="utf-8")
    profile = load_imu_profile(path)
    assert profile.modbus is not None
    assert profile.modbus.reset.address == profile.modbus.commit.address


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        (NAV, {"model": ""}, "model: The entry is empty"),
        (NAV, {"model": " "}, "model: is blank, so it tells no unit from another"),
        (NAV, {"registers/5/address": 65535}, "register 65535-65537 runs past address 65535"),
        (
            NAV,
            {"frame/fields/8": None},
            "status.ready = 0x0001 looks at bits that no field of the frame holds",
        ),
        (NAV, {"status/failed": 0x10000}, "status.failed = 0x10000 looks at bits"),
        (NAV, {"status/failed": 1}, "status.ready and status.failed look at the same bit"),
        (NAV, {"frame/crc/start": 32}, "crc.start = 32 lies behind what it is to check, bytes 0-31"),
        (NAV, {"frame/fields/1/scale": 0.0}, "frame.fields[1].scale: is 0, so every value would be"),
        (NAV, {"frame/fields/0/scale": 3.0}, "field 'counter' has no scale and no offset; say per_sample"),
        (NAV, {"frame/fields/8/offset": 1.0}, "field 'status' has no scale and no offset; remove"),
        (NAV, {"frame/fields/1/per_sample": 3.0}, "field 'gyro_x' is no counter and has no per_sample"),
        (NAV, {"frame/fields/1/base": 16}, "field 'gyro_x': prefix and base belong to a text frame"),
        (NAV, {"frame/id": {"at": 0, "value": "00 11"}}, "id.at = 0 overlaps sync, bytes 0-1"),
        (NAV, {"frame/length": {"at": 1, "type": "u8", "adds": 0}}, "length.at = 1 overlaps sync, bytes 0-1"),
        (
            NAV,
            {"frame/length": {"at": 2, "type": "u8", "adds": 0}, "frame/max_size": 30},
            "length tells no more than 30 bytes, the fields need 35",
        ),
        (
            NAV,
            {"link/baud": 9600},
            "link.baud = 9600 is too slow for stream.sample_rate_hz = 200 with frames of 34 bytes, which take 68000",
        ),
        (MIP, {"frame/fields/2/at": 2}, "fields 'accel_x' and 'accel_y' overlap at byte 2 of item '04'"),
        (MIP, {"frame/items/at": 3}, "items.at = 3 lies within sync, length and id, which end at byte 3"),
        (MIP, {"link/baud": 9600}, "link.baud = 9600 is too slow for stream.sample_rate_hz = 125"),
        (VN, {"vectornav/start": ["VNWRG,06,0*00\r\n$VNWNV"]}, "must be one line of ASCII"),
        (VN, {"vectornav/start": ["é"]}, "must be one line of ASCII"),
        (VN, {"stream/sample_rate_hz": 100.0}, "per_sample = 5e+06 does not fit stream.sample_rate_hz = 100"),
    ],
)
def test_stream_and_commands(tmp_path: Path, name: str, changes: dict[str, Any], words: str) -> None:
    assert words in told(tmp_path, name, changes)


def test_a_counter_that_begins_again_too_soon_is_refused(tmp_path: Path) -> None:
    short = {"frame/fields/0/type": "u8", "link/baud": None}
    words = told(tmp_path, NAV, {**short, "stream/sample_rate_hz": 4000.0})
    assert "field 'counter': type u8 begins again every 0.064 s at stream.sample_rate_hz = 4000" in words
    path = tmp_path / "profile.toml"
    path.write_text(tomli_w.dumps(edited(NAV, {**short, "stream/sample_rate_hz": 2000.0})), encoding="utf-8")
    load_imu_profile(path)


def test_a_line_whose_baud_nobody_states_is_not_judged(tmp_path: Path) -> None:
    path = tmp_path / "profile.toml"
    path.write_text(
        tomli_w.dumps(edited(NAV, {"link/baud": None, "stream/sample_rate_hz": 2000.0})), encoding="utf-8"
    )
    assert load_imu_profile(path).stream.sample_rate_hz == 2000.0


def test_a_text_frame_is_checked_from_its_head_on(tmp_path: Path) -> None:
    lines = {
        "frame/format": "text",
        "frame/sync": "$IMU",
        "frame/crc": {"kind": "xor8", "start": 40},
        "frame/byte_order": None,
    }
    assert "crc.start = 40 lies behind sync" in told(tmp_path, NAV, lines)
