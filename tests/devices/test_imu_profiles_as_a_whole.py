"""An IMU profile with contradictory sections is refused by an error that names the entry."""

from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.devices.profiles import load_imu_profile
from calstation.errors import ConfigurationError
from tests.devices.editing import edited
from tests.helpers import error_code

DATA = Path(__file__).parents[2] / "data" / "imus"
DSP, NAV, MIP, VN = "dsp_modbus", "bench_nav", "microstrain_mip", "vectornav_vn100"


def refusal(tmp_path: Path, name: str, changes: dict[str, Any]) -> str:
    path = tmp_path / "profile.toml"
    path.write_text(tomli_w.dumps(edited(DATA / f"{name}.toml", changes)), encoding="utf-8")
    with pytest.raises(ConfigurationError) as caught:
        load_imu_profile(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    return error_code(caught.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"registers/1/address": 8}, "registers[2].address profile.registers_overlap"),
        ({"modbus/commit/address": 119}, "registers[2].address profile.registers_overlap"),
        ({"modbus/reset/address": 100}, "registers[1].address profile.registers_overlap"),
        ({"modbus/stream/address": 213}, "registers[4].address profile.registers_overlap"),
        ({"modbus/page": 101}, "registers[1].address profile.registers_overlap"),
        ({"modbus/serial/address": 4}, "modbus.serial profile.registers_overlap"),
        ({"modbus/page": 21}, "modbus.page profile.registers_overlap"),
        ({"modbus/commit/address": 22, "modbus/commit/value": 0xA5A5}, "modbus.reset profile.same_write"),
        (
            {"modbus/commit/address": 20, "modbus/commit/value": 0, "modbus/commit/done": 7},
            "modbus.stream profile.same_write",
        ),
        ({"modbus/commit/done": 0x5A5A}, "modbus.commit.done profile.done_at_once"),
        ({"modbus/serial/address": 65530}, "modbus.serial profile.past_last_address"),
        ({"registers/1/address": 65530}, "registers[2].address profile.past_last_address"),
        ({"registers/0/span": 1}, "registers[1].span profile.span"),
        ({"registers/1/span": 8}, "registers[2].span profile.span"),
        ({"registers/0/span": 0}, "registers[1].span profile.span"),
        ({"registers/0/tolerance": 1e9}, "registers[1].tolerance profile.tolerance_too_large"),
        ({"prior/gyro_scale": None}, "registers[1].parameters profile.no_prior"),
        (
            {"registers/3/type": "i16", "registers/3/scale": 1.0, "registers/3/word_order": "big"},
            "registers[4].scale profile.register_too_coarse",
        ),
        ({"registers/2/convention/identity": True}, "registers[3].convention.negated profile.belongs_to"),
        ({"registers/0/convention/offset": "before"}, "registers[1].convention.offset profile.convention_contradicts"),
        (
            {"registers/1/convention/matrix": "correction"},
            "registers[2].convention.matrix profile.convention_contradicts",
        ),
    ],
)
def test_contradictory_modbus_registers_are_refused(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    assert refusal(tmp_path, DSP, changes) == words


def test_one_register_may_accept_several_commands(tmp_path: Path) -> None:
    path = tmp_path / "profile.toml"
    path.write_text(tomli_w.dumps(edited(DATA / f"{DSP}.toml", {"modbus/reset/address": 21})), encoding="utf-8")
    profile = load_imu_profile(path)
    assert profile.modbus is not None
    assert profile.modbus.reset.address == profile.modbus.commit.address


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        (NAV, {"model": ""}, "model entry.empty"),
        (NAV, {"model": " "}, "model profile.model_blank"),
        (NAV, {"registers/5/address": 65535}, "registers[6].address profile.past_last_address"),
        (NAV, {"frame/fields/8": None}, "status.ready profile.mask_outside_frame"),
        (NAV, {"status/failed": 0x10000}, "status.failed profile.mask_outside_frame"),
        (NAV, {"status/failed": 1}, "status.failed profile.mask_of_ready"),
        (NAV, {"frame/crc/start": 32}, "frame.crc.start profile.check_after_frame"),
        (NAV, {"frame/fields/1/scale": 0.0}, 'frame.fields["gyro_x"].scale profile.scale_zero'),
        (NAV, {"frame/fields/0/scale": 3.0}, 'frame.fields["counter"].scale profile.counter_scaled'),
        (NAV, {"frame/fields/8/offset": 1.0}, 'frame.fields["status"].offset profile.status_scaled'),
        (NAV, {"frame/fields/1/per_sample": 3.0}, 'frame.fields["gyro_x"].per_sample profile.only_of_counter'),
        (NAV, {"frame/fields/1/base": 16}, 'frame.fields["gyro_x"].base profile.belongs_to'),
        (NAV, {"frame/id": {"at": 0, "value": "00 11"}}, "frame.id.at profile.header_overlap"),
        (NAV, {"frame/length": {"at": 1, "type": "u8", "adds": 0}}, "frame.length.at profile.header_overlap"),
        (
            NAV,
            {"frame/length": {"at": 2, "type": "u8", "adds": 0}, "frame/max_size": 30},
            "frame.length profile.length_too_short",
        ),
        (NAV, {"link/baud": 9600}, "link.baud profile.baud_too_low"),
        (MIP, {"frame/fields/2/at": 2}, 'frame.fields["accel_y"].at profile.fields_overlap'),
        (MIP, {"frame/items/at": 3}, "frame.items.at profile.items_in_header"),
        (MIP, {"link/baud": 9600}, "link.baud profile.baud_too_low"),
        (VN, {"vectornav/start": ["VNWRG,06,0*00\r\n$VNWNV"]}, "vectornav.start[1] profile.not_a_command_line"),
        (VN, {"vectornav/start": ["é"]}, "vectornav.start[1] profile.not_a_command_line"),
        (VN, {"stream/sample_rate_hz": 100.0}, 'frame.fields["counter"].per_sample profile.clock_rate'),
    ],
)
def test_contradictory_stream_and_commands_are_refused(
    tmp_path: Path, name: str, changes: dict[str, Any], words: str
) -> None:
    assert refusal(tmp_path, name, changes) == words


def test_counter_with_too_short_a_wrap_period_is_refused(tmp_path: Path) -> None:
    short = {"frame/fields/0/type": "u8", "link/baud": None}
    words = refusal(tmp_path, NAV, {**short, "stream/sample_rate_hz": 4000.0})
    assert words == 'frame.fields["counter"].type profile.counter_too_short'
    path = tmp_path / "profile.toml"
    path.write_text(
        tomli_w.dumps(edited(DATA / f"{NAV}.toml", {**short, "stream/sample_rate_hz": 2000.0})), encoding="utf-8"
    )
    load_imu_profile(path)


def test_missing_baud_rate_is_not_checked(tmp_path: Path) -> None:
    path = tmp_path / "profile.toml"
    path.write_text(
        tomli_w.dumps(edited(DATA / f"{NAV}.toml", {"link/baud": None, "stream/sample_rate_hz": 2000.0})),
        encoding="utf-8",
    )
    assert load_imu_profile(path).stream.sample_rate_hz == 2000.0


def test_checksum_of_a_text_frame_may_include_its_header(tmp_path: Path) -> None:
    lines = {
        "frame/format": "text",
        "frame/sync": "$IMU",
        "frame/crc": {"kind": "xor8", "start": 40},
        "frame/byte_order": None,
    }
    assert refusal(tmp_path, NAV, lines) == "frame.crc.start profile.check_after_sync"
