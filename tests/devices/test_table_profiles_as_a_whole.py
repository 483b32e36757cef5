"""An unusable table profile is refused by an error that names the entry."""

from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.devices.profiles import TableProfile, load_table_profile
from calstation.errors import ConfigurationError
from tests.devices.editing import edited
from tests.helpers import error_code

DATA = Path(__file__).parents[2] / "data" / "tables"
BENCH, DRIVES, MN, ATL, ACL = "bench", "cia402_drives", "mn_ascii", "aerosmith_atl", "acutronic_acl"


def load(tmp_path: Path, name: str, changes: dict[str, Any]) -> TableProfile:
    path = tmp_path / "profile.toml"
    path.write_text(tomli_w.dumps(edited(DATA / f"{name}.toml", changes)), encoding="utf-8")
    return load_table_profile(path)


def refusal(tmp_path: Path, name: str, changes: dict[str, Any]) -> str:
    with pytest.raises(ConfigurationError) as caught:
        load(tmp_path, name, changes)
    assert str(caught.value).startswith(f"{tmp_path / 'profile.toml'}: ")
    assert "\n" not in str(caught.value)
    return error_code(caught.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"model": ""}, "model entry.empty"),
        ({"model": " "}, "model profile.model_blank"),
        ({"status_bits/fault": 2}, "status_bits.fault profile.same_bit"),
        ({"status_bits/fault": {"always": True}}, "status_bits.fault profile.only_homed_is_constant"),
        ({"status_bits/homed": {"always": False}}, "status_bits.homed profile.only_homed_is_constant"),
        ({"status_bits/homed": {"word": "status2", "bit": 1}}, "status_bits.homed profile.needs_register"),
        ({"status_bits/homed": {}}, "status_bits.homed profile.bit_or_always"),
        ({"status_bits/interlock": 8}, "status_bits.interlock profile.interlock_twice"),
        ({"commands/home": 1}, "commands.home profile.same_write"),
        ({"commands/stop": 70000}, "commands.stop profile.value_beyond_register"),
        ({"commands/stop": -1}, "commands.stop profile.value_beyond_register"),
        ({"commands/stop": [{"comand": 2}]}, "commands.stop profile.register_not_written"),
        ({"commands/stop": [{"mode": 2}]}, "commands.stop profile.needs_register"),
        ({"commands/stop": "halt"}, "commands.stop profile.not_writes"),
        ({"registers/outer_target/type": "i16"}, "registers.outer_target profile.narrower_than_travel"),
        ({"registers/inner_target/type": "u32"}, "registers.inner_target profile.narrower_than_travel"),
        ({"registers/outer_position/scale": 1e-7}, "registers.outer_position profile.narrower_than_travel"),
        ({"registers/outer_target_rate/type": "i16"}, "registers.outer_target_rate profile.narrower_than_rate"),
        ({"registers/inner_rate/type": "u16"}, "registers.inner_rate profile.narrower_than_rate"),
        (
            {"registers/outer_acceleration/type": "u16"},
            "registers.outer_acceleration profile.narrower_than_acceleration",
        ),
        ({"registers/outer_low/type": "i16"}, "registers.outer_low profile.narrower_than_travel"),
        ({"registers/outer_position/scale": 0.5}, "registers.outer_position profile.angle_too_coarse"),
        (
            {"registers/outer_position": {"address": 30, "type": "text", "words": 2}},
            "registers.outer_position.type profile.register_is_number",
        ),
        ({"registers/model": {"address": 0, "type": "u16"}}, "registers.model.type profile.register_is_text"),
        ({"registers/command/scale": 0.5}, "registers.command profile.register_is_word"),
        ({"registers/statusword/type": "q8.8"}, "registers.statusword profile.register_is_word"),
        ({"registers/statusword/type": "u8"}, "registers.statusword.type profile.not_whole_registers"),
        ({"registers/heartbeat": {"address": 65535, "type": "u32"}}, "registers.heartbeat profile.past_last_address"),
        ({"registers/model/word_order": "little"}, "registers.model.word_order profile.not_with"),
        ({"registers/outer_rate/scale": 0.0}, "registers.outer_rate.scale profile.scale_zero"),
        ({"registers/outer_low": None}, "registers.outer_low profile.needed_by"),
        ({"registers/statusword": None}, "registers.statusword profile.drive_register_missing"),
        (
            {"registers/outer_fault": {"address": 90, "type": "u16"}},
            "registers.outer_fault profile.same_register_twice",
        ),
        (
            {"registers/fault": None, "registers/outer_fault": {"address": 90, "type": "u16"}},
            "registers.inner_fault profile.needed_by",
        ),
        ({"modbus/inner_unit": 2}, "registers.model profile.one_register_of_two_drives"),
        ({"modbus/inner_unit": 1}, "modbus.inner_unit profile.same_unit"),
        ({"outer/low_deg": 10.0}, "outer profile.travel_without_home"),
        ({"outer/low_deg": 1080.0}, "outer profile.travel_order"),
        ({"faults": {"99999": "odd"}}, "faults.99999 profile.value_beyond_register"),
        ({"faults": {"\u0663": "odd"}}, "faults.٣ profile.not_a_code"),
        ({"faults": {"03": "odd"}}, "faults.03 profile.not_a_code"),
        ({"faults": {"0": "none"}}, "faults.0 profile.fault_zero"),
        ({"registers/outer_target/scale": -1e-5}, "registers.outer_target.scale profile.opposite_sense"),
        ({"registers/inner_rate/scale": -1e-4}, "registers.inner_rate.scale profile.opposite_sense"),
        ({"registers/outer_high/scale": -1e-5}, "registers.outer_high.scale profile.opposite_sense"),
        (
            {f"registers/outer_{name}/scale": -1e-5 for name in ("position", "rate", "target", "low", "high")},
            "registers.outer_target_rate.scale profile.turn_rate_needed",
        ),
        ({"registers/outer_target_rate/scale": -1e-4}, "registers.outer_target_rate.scale profile.negative_magnitude"),
        (
            {"registers/inner_acceleration/scale": -1e-4},
            "registers.inner_acceleration.scale profile.negative_magnitude",
        ),
        ({"registers/watchdog/scale": -0.001}, "registers.watchdog.scale profile.negative_timeout"),
        ({"registers/watchdog": None}, "registers.heartbeat profile.heartbeat_without_watchdog"),
    ],
)
def test_invalid_registers_bits_and_commands_are_refused(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    assert refusal(tmp_path, BENCH, changes) == words


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        (MN, {"text/commands/stop": ["STP,{angle}"]}, "text.commands.stop[1] profile.unknown_brace"),
        (MN, {"text/commands/stop": ["STP,{"]}, "text.commands.stop[1] profile.single_brace"),
        (MN, {"text/commands/stop": ["STP,}"]}, "text.commands.stop[1] profile.single_brace"),
        (MN, {"text/commands/stop": ["STP,{}"]}, "text.commands.stop[1] profile.unknown_brace"),
        (MN, {"text/commands/stop": ["STP,{axis:>9}"]}, "text.commands.stop[1] profile.unknown_brace"),
        (MN, {"text/commands/stop": ["STP,{axis!r}"]}, "text.commands.stop[1] profile.unknown_brace"),
        (MN, {"text/commands/stop": ["停"]}, "text.commands.stop[1] profile.line_not_latin"),
        (MN, {"text/commands/stop": ["STP\r\nCLR"]}, "text.commands.stop[1] profile.line_not_latin"),
        (MN, {"text/commands/move": ["VEL,{axis},{rate}", "RUN,{axis}"]}, "text.commands.move profile.value_not_sent"),
        (MN, {"text/commands/move": ["RUN"]}, "text.commands.move profile.value_not_sent"),
        (MN, {"text/commands/move": ["POS,{outer_angle}"]}, "text.commands.move profile.value_not_sent"),
        (MN, {"text/commands/move": ["POS,{angle}"]}, "text.commands.move[1] profile.value_without_axis"),
        (MN, {"text/commands/rate": ["RUN,{axis}"]}, "text.commands.rate profile.value_not_sent"),
        (MN, {"text/commands/rate": ["R,{axis},{angle},{rate}"]}, "text.commands.rate[1] profile.unknown_brace"),
        (MN, {"text/commands/home": ["STP,{axis}"]}, "text.commands.stop profile.same_lines"),
        (MN, {"text/queries/state/send": "STS,{foo}"}, "text.queries.state.send profile.unknown_brace"),
        (MN, {"text/axes": ["1", "1"]}, "text.axes profile.two_axis_names"),
        (MN, {"text/axes": ["1"]}, "text.axes profile.two_axis_names"),
        (MN, {"text/line_end": ""}, "text.line_end entry.empty"),
        (MN, {"text/refused": ""}, "text.refused profile.refused_matches_all"),
        (MN, {"text/silent": "STS"}, "text.silent profile.silent_matches_query"),
        (MN, {"text/flags/fault": {"always": False}}, "text.flags.fault profile.flag_cannot_be_constant"),
        (MN, {"text/flags/fault/bit": 0}, "text.flags.fault profile.same_flag"),
        (MN, {"text/decimals": 0}, "text.decimals profile.angle_too_coarse"),
        (
            MN,
            {"text/queries/watchdog": {"send": "WD", "answer": "(?P<x>.*)"}},
            "text.queries.watchdog.answer profile.group_missing",
        ),
        (ACL, {"text/queries/limits/answer": "(?P<low>.*)"}, "text.queries.limits.answer profile.group_missing"),
        (MN, {"text/commands/heartbeat": ["WDG"]}, "text.commands.heartbeat profile.heartbeat_without_watchdog"),
        (MN, {"faults/0": "none"}, "faults.0 profile.fault_zero"),
        (ATL, {"text/prompt": ""}, "text.prompt profile.needed_by"),
        (MN, {"text/prompt": ">"}, "text.prompt profile.not_with"),
    ],
)
def test_invalid_text_commands_are_refused(tmp_path: Path, name: str, changes: dict[str, Any], words: str) -> None:
    assert refusal(tmp_path, name, changes) == words


def test_axes_with_inverted_sign_are_accepted(tmp_path: Path) -> None:
    backwards = {f"registers/outer_{name}/scale": -1e-5 for name in ("position", "rate", "target", "low", "high")}
    load(tmp_path, BENCH, {**backwards, "commands/rate": None})


def test_literal_brace_in_a_text_command_is_doubled(tmp_path: Path) -> None:
    profile = load(tmp_path, MN, {"text/commands/reset": ["CLR{{1}}"]})
    assert profile.text is not None
    assert profile.text.commands.reset == ["CLR{{1}}"]


def test_text_command_may_contain_both_axes(tmp_path: Path) -> None:
    load(tmp_path, MN, {"text/commands/move": ["POS,{outer_angle},{inner_angle},{outer_rate}"]})
