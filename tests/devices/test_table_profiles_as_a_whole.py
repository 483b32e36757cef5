"""A table profile that could not be obeyed, or not be read, is refused in one sentence that names the entry."""

import copy
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.devices.profiles.table import TableProfile, load_table_profile
from calstation.errors import ConfigurationError

DATA = Path(__file__).parents[2] / "data" / "tables"
BENCH, DRIVES, MN, ATL, ACL = "bench", "cia402_drives", "mn_ascii", "aerosmith_atl", "acutronic_acl"


def edited(name: str, changes: dict[str, Any]) -> dict[str, Any]:
    """A shipped profile with values changed by their places, `None` to take one out."""
    data = copy.deepcopy(tomllib.loads((DATA / f"{name}.toml").read_text(encoding="utf-8")))
    for where, value in changes.items():
        *parents, last = where.split("/")
        place: Any = data
        for part in parents:
            place = place[part]
        if value is None:
            del place[last]
        else:
            place[last] = value
    return data


def load(tmp_path: Path, name: str, changes: dict[str, Any]) -> TableProfile:
    path = tmp_path / "profile.toml"
    path.write_text(tomli_w.dumps(edited(name, changes)), encoding="utf-8")
    return load_table_profile(path)


def told(tmp_path: Path, name: str, changes: dict[str, Any]) -> str:
    with pytest.raises(ConfigurationError) as caught:
        load(tmp_path, name, changes)
    assert str(caught.value).startswith(f"{tmp_path / 'profile.toml'}: ")
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"model": ""}, "model: The entry is empty"),
        ({"model": " "}, "model: is blank, so it tells no table from another"),
        ({"status_bits/fault": 2}, "status_bits.fault and status_bits.enabled are the same bit 2"),
        ({"status_bits/fault": {"always": True}}, "status_bits.fault: always = true is for homed"),
        ({"status_bits/homed": {"always": False}}, "status_bits.homed: always = true is for homed"),
        ({"status_bits/homed": {"word": "status2", "bit": 1}}, "status_bits.homed is a bit of status2; add"),
        ({"status_bits/homed": {}}, "status_bits.homed: needs bit, or always"),
        ({"status_bits/interlock": 8}, "status_bits.interlock and registers.interlock say the same"),
        ({"commands/home": 1}, "commands.move and commands.home write the same"),
        ({"commands/stop": 70000}, "commands.stop = 70000 does not fit registers.command, 0 to 65535"),
        ({"commands/stop": -1}, "commands.stop = -1 does not fit registers.command"),
        ({"commands/stop": [{"comand": 2}]}, "'comand' is no register that a command writes; did you mean"),
        ({"commands/stop": [{"mode": 2}]}, "commands.stop writes mode; add registers.mode"),
        ({"commands/stop": "halt"}, "commands.stop: must be a whole number, or a list"),
        (
            {"registers/outer_target/type": "i16"},
            "registers.outer_target: type i16 × 1e-05 holds -0.32768 to 0.32767 °, but the axis travels -1080 to 1080",
        ),
        (
            {"registers/inner_target/type": "u32"},
            "registers.inner_target: type u32 × 1e-05 holds 0 to 42949.7",
        ),
        ({"registers/outer_position/scale": 1e-7}, "registers.outer_position: type i32 × 1e-07 holds"),
        (
            {"registers/outer_target_rate/type": "i16"},
            "registers.outer_target_rate: type i16 × 0.0001 holds -3.2768 to 3.2767 °/s, but the axis turns at",
        ),
        ({"registers/inner_rate/type": "u16"}, "registers.inner_rate: type u16 × 0.0001 holds"),
        ({"registers/outer_acceleration/type": "u16"}, "registers.outer_acceleration: type u16"),
        ({"registers/outer_low/type": "i16"}, "registers.outer_low: type i16"),
        ({"registers/outer_position/scale": 0.5}, "registers.outer_position: a step of 0.5° is too coarse"),
        (
            {"registers/outer_position": {"address": 30, "type": "text", "words": 2}},
            "registers.outer_position has type 'text', but it is a number",
        ),
        (
            {"registers/model": {"address": 0, "type": "u16"}},
            "registers.model has type 'u16', but it is a text",
        ),
        ({"registers/command/scale": 0.5}, "registers.command is taken as it stands"),
        ({"registers/statusword/type": "q8.8"}, "registers.statusword is taken as it stands"),
        ({"registers/statusword/type": "u8"}, "type 'u8' does not fill registers of 16 bits"),
        (
            {"registers/heartbeat": {"address": 65535, "type": "u32"}},
            "registers.heartbeat: 65535-65536 runs past address 65535",
        ),
        ({"registers/model/word_order": "little"}, "a text has no scale and no word_order"),
        ({"registers/outer_rate/scale": 0.0}, "scale is 0, so every value would be"),
        ({"registers/outer_low": None}, "registers.outer_low and registers.outer_high belong together"),
        ({"registers/statusword": None}, "registers.statusword is missing; add it, or one for each axis"),
        (
            {"registers/outer_fault": {"address": 90, "type": "u16"}},
            "registers.fault and registers.outer_fault are the same twice",
        ),
        (
            {"registers/fault": None, "registers/outer_fault": {"address": 90, "type": "u16"}},
            "registers.inner_fault is missing beside registers.outer_fault",
        ),
        (
            {"modbus/inner_unit": 2},
            "registers.model is one, but modbus.inner_unit gives each axis a drive of its own",
        ),
        ({"modbus/inner_unit": 1}, "unit and inner_unit are both 1"),
        ({"outer/low_deg": 10.0}, "low_deg = 10 to high_deg = 1080 leaves out home, which is 0"),
        ({"outer/low_deg": 1080.0}, "low_deg = 1080 must be below high_deg = 1080; correct one"),
        ({"faults": {"99999": "odd"}}, "faults.99999 is no value of registers.fault"),
        ({"faults": {"\u0663": "odd"}}, "faults.\u0663: must be a number in quotes, in plain digits"),
        ({"faults": {"03": "odd"}}, "faults.03: must be a number in quotes, in plain digits"),
        ({"faults": {"0": "none"}}, "faults.0: says that there is no fault, so its meaning is never told"),
        (
            {"registers/outer_target/scale": -1e-5},
            "registers.outer_target: scale = -1e-05 counts the other way than that of registers.outer_position, 1e-05",
        ),
        (
            {"registers/inner_rate/scale": -1e-4},
            "registers.inner_rate: scale = -0.0001 counts the other way than that of registers.inner_position, 1e-05",
        ),
        (
            {"registers/outer_high/scale": -1e-5},
            "registers.outer_high: scale = -1e-05 counts the other way than that of registers.outer_position",
        ),
        (
            {
                f"registers/outer_{name}/scale": -1e-5
                for name in ("position", "rate", "target", "low", "high")
            },
            "registers.outer_target_rate: scale = 0.0001 counts the other way than that of registers.outer_position,"
            " -1e-05; add registers.outer_turn_rate",
        ),
        (
            {"registers/outer_target_rate/scale": -1e-4},
            "registers.outer_target_rate: scale = -0.0001 is negative, but it tells a move how fast",
        ),
        (
            {"registers/inner_acceleration/scale": -1e-4},
            "registers.inner_acceleration: scale = -0.0001 is negative",
        ),
        (
            {"registers/watchdog/scale": -0.001},
            "registers.watchdog: scale = -0.001 is negative, and so its time would be; make it positive",
        ),
        (
            {"registers/watchdog": None},
            "registers.heartbeat is never written where no register tells the watchdog's time",
        ),
    ],
)
def test_registers_bits_and_commands(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    assert words in told(tmp_path, BENCH, changes)


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        (MN, {"text/commands/stop": ["STP,{angle}"]}, "stop: 'STP,{angle}': '{angle}' is unknown here"),
        (MN, {"text/commands/stop": ["STP,{"]}, "stop: 'STP,{' has a brace alone"),
        (MN, {"text/commands/stop": ["STP,}"]}, "stop: 'STP,}' has a brace alone"),
        (MN, {"text/commands/stop": ["STP,{}"]}, "'{}' is unknown here"),
        (MN, {"text/commands/stop": ["STP,{axis:>9}"]}, "'{axis:>9}' is unknown here"),
        (MN, {"text/commands/stop": ["STP,{axis!r}"]}, "'{axis!r}' is unknown here"),
        (MN, {"text/commands/stop": ["停"]}, "stop: '停' must be one line of ASCII"),
        (MN, {"text/commands/stop": ["STP\r\nCLR"]}, "must be one line of ASCII"),
        (MN, {"text/commands/move": ["VEL,{axis},{rate}", "RUN,{axis}"]}, "move: no line tells {angle}"),
        (MN, {"text/commands/move": ["RUN"]}, "move: no line tells {angle}"),
        (MN, {"text/commands/move": ["POS,{outer_angle}"]}, "move: no line tells {inner_angle}"),
        (MN, {"text/commands/move": ["POS,{angle}"]}, "tells {angle} without {axis}"),
        (MN, {"text/commands/rate": ["RUN,{axis}"]}, "rate: no line tells {rate}"),
        (MN, {"text/commands/rate": ["R,{axis},{angle},{rate}"]}, "'{angle}' is unknown here"),
        (MN, {"text/commands/home": ["STP,{axis}"]}, "home and stop send the same lines"),
        (MN, {"text/queries/state/send": "STS,{foo}"}, "'STS,{foo}': '{foo}' is unknown here"),
        (MN, {"text/axes": ["1", "1"]}, "must be two different names"),
        (MN, {"text/axes": ["1"]}, "must be two different names"),
        (MN, {"text/line_end": ""}, "text.line_end: The entry is empty"),
        (MN, {"text/refused": ""}, "refused matches every reply"),
        (
            MN,
            {"text/silent": "STS"},
            "silent matches queries.position 'STS,0', which would never be answered",
        ),
        (MN, {"text/flags/fault": {"always": False}}, "flags.fault cannot be always the same"),
        (MN, {"text/flags/fault/bit": 0}, "flags.fault and flags.enabled are told by the same"),
        (MN, {"text/decimals": 0}, "text.decimals = 0 tells angles to 1°, too coarse"),
        (
            MN,
            {"text/queries/watchdog": {"send": "WD", "answer": "(?P<x>.*)"}},
            "queries.watchdog: the answer needs a group value",
        ),
        (ACL, {"text/queries/limits/answer": "(?P<low>.*)"}, "queries.limits: the answer needs a group high"),
        (
            MN,
            {"text/commands/heartbeat": ["WDG"]},
            "text: commands.heartbeat is never sent where no query tells the watchdog's time",
        ),
        (MN, {"faults/0": "none"}, "faults.0: says that there is no fault"),
        (ATL, {"text/prompt": ""}, 'protocol = "atl" needs text.prompt; add it'),
        (MN, {"text/prompt": ">"}, 'text.prompt belongs to protocol = "atl", not "mn"; remove it'),
    ],
)
def test_lines_of_text(tmp_path: Path, name: str, changes: dict[str, Any], words: str) -> None:
    assert words in told(tmp_path, name, changes)


def test_axes_that_count_the_other_way_throughout_are_taken(tmp_path: Path) -> None:
    backwards = {
        f"registers/outer_{name}/scale": -1e-5 for name in ("position", "rate", "target", "low", "high")
    }
    load(tmp_path, BENCH, {**backwards, "commands/rate": None})


def test_a_brace_of_the_language_s_own_is_doubled(tmp_path: Path) -> None:
    profile = load(tmp_path, MN, {"text/commands/reset": ["CLR{{1}}"]})
    assert profile.text is not None
    assert profile.text.commands.reset == ["CLR{{1}}"]


def test_a_line_may_tell_both_axes_at_once(tmp_path: Path) -> None:
    load(tmp_path, MN, {"text/commands/move": ["POS,{outer_angle},{inner_angle},{outer_rate}"]})
