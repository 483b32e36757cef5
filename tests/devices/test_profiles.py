"""Profiles are checked as a whole before anything moves, and say which entry is wrong."""

import copy
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from calstation.devices.profiles.imu import ImuProfile, load_imu_profile
from calstation.devices.profiles.table import TableProfile, load_table_profile
from calstation.errors import ConfigurationError

DATA = Path(__file__).parents[2] / "data"
IMUS = sorted((DATA / "imus").glob("*.toml"))
TABLES = sorted((DATA / "tables").glob("*.toml"))


@pytest.mark.parametrize("path", IMUS, ids=lambda p: p.stem)
def test_shipped_imu_profiles_load(path: Path) -> None:
    profile = load_imu_profile(path)
    sigmas = profile.prior_sigmas()
    assert all(sigma > 0 for sigma in sigmas.values())
    assert [e.address for e in profile.registers] == sorted(e.address for e in profile.registers)


@pytest.mark.parametrize("path", TABLES, ids=lambda p: p.stem)
def test_shipped_table_profiles_load(path: Path) -> None:
    profile = load_table_profile(path)
    geometry = profile.geometry()
    assert geometry.limits.high[0] == np.deg2rad(profile.outer.high_deg)
    np.testing.assert_allclose(np.linalg.norm(geometry.outer_axis), 1.0)


def bench(kind: str) -> dict[str, Any]:
    path = DATA / kind / ("bench_nav.toml" if kind == "imus" else "bench.toml")
    return tomllib.loads(path.read_text(encoding="utf-8"))


def edit(data: dict[str, Any], where: str, value: Any) -> None:
    *parents, last = where.split("/")
    place: Any = data
    for part in parents:
        place = place[int(part)] if isinstance(place, list) else place[part]
    if value is None:
        del place[last]
    else:
        place[last] = value


def refused(
    tmp_path: Path, load: Callable[[Path], ImuProfile | TableProfile], kind: str, where: str, value: Any
) -> str:
    data = copy.deepcopy(bench(kind))
    edit(data, where, value)
    path = tmp_path / "profile.toml"
    path.write_text(tomli_w.dumps(data), encoding="utf-8")
    with pytest.raises(ConfigurationError) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("where", "value", "told"),
    [
        ("registers/1/address", 2, "register 0-2 and register 2-10 overlap"),
        ("registers/1/parameters", ["gyro_bias_x"], "'gyro_bias_x' is in register 0-2 and in register 3-3"),
        (
            "registers/1/parameters",
            ["gyro_scal_x"],
            "register 3-3: 'gyro_scal_x' is no parameter; did you mean",
        ),
        ("registers/0/range", [1.0, -1.0], "register 0-2: range"),
        ("registers/0/adress", 3, "registers[0].adress: The entry is unknown. Did you mean 'address'?"),
        ("frame/sync", "5G", "frame.sync: '5G' is not hexadecimal"),
        ("frame/crc/kind", "crc7", "check 'crc7' is unknown"),
        ("frame/fields/0/type", "i16", "field 'counter' has type 'i16'"),
        ("frame/fields/1/name", "gyro_y", "field 'gyro_y' is there twice"),
        ("frame/fields/1/name", "gyrox", "field 'gyrox' is unknown; did you mean 'gyro_x'?"),
        ("commands/reply_sync", "55 AA", "frame.sync: begins as commands.reply_sync does"),
        ("stream/sample_rate_hz", -1.0, "stream.sample_rate_hz: -1.0 is out of range"),
        ("link/parity", "X", "link.parity: 'X' is unknown"),
        ("link/baud", 0, "link.baud: 0 is out of range"),
        ("link/stop_bits", 3, "3 is out of range; it must be 1, 1.5 or 2"),
        ("prior/gyro", {"sigma": 1.0}, "'gyro' is no parameter or group"),
        ("noise/gyro_arw", None, "noise.gyro_arw: The entry is missing. Add it"),
    ],
)
def test_a_wrong_imu_profile_is_told_by_its_entry(tmp_path: Path, where: str, value: Any, told: str) -> None:
    assert told in refused(tmp_path, load_imu_profile, "imus", where, value)


@pytest.mark.parametrize(
    ("where", "value", "told"),
    [
        ("registers/fault/address", 17, "registers.statusword (17-17) and registers.fault (17) overlap"),
        (
            "registers/outer_rate/address",
            31,
            "registers.outer_position (30-31) and registers.outer_rate (31)",
        ),
        ("registers/outer_rate", None, "registers.outer_rate is missing; add it"),
        ("registers/outer_speed", {"address": 90, "type": "i32"}, "registers.outer_speed is unknown"),
        ("registers/model/words", None, "words belongs to type"),
        ("status_bits/moving", 16, "status_bits.moving = 16 is out of range"),
        ("commands/stop", None, "commands.stop is missing"),
        ("faults/x", "odd", "faults.x: must be a number"),
        ("outer_axis", [1.0, 0.0, 0.5], "outer_axis: [1.0, 0.0, 0.5] has length"),
        ("inner_axis", [1.0, 0.0, 0.0], "less than 60° apart"),
        ("outer/low_deg", 2000.0, "low_deg = 2000 must be below high_deg = 1080"),
        ("accuracy/velocity_sigma", 0.0, "must be greater than 0"),
        ("status_bits/remot", 9, "status_bits.remot is unknown; did you mean 'remote'?"),
        ("commands/turn", 5, "commands.turn is unknown"),
        ("registers/outer_target_rate/type", "u32", "commands.rate: registers.outer_target_rate has no sign"),
        ("modbus", None, 'protocol = "modbus" needs [modbus]'),
        ("protocol", "atl", 'protocol = "atl" needs [text]'),
        ("link_loss_stop_s", 0.0, "link_loss_stop_s: 0.0 is out of range"),
    ],
)
def test_a_wrong_table_profile_is_told_by_its_entry(
    tmp_path: Path, where: str, value: Any, told: str
) -> None:
    assert told in refused(tmp_path, load_table_profile, "tables", where, value)


def text_table(name: str) -> dict[str, Any]:
    return tomllib.loads((DATA / "tables" / f"{name}.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("name", "where", "value", "told"),
    [
        ("aerosmith_atl", "protocol", "mn", 'text.prompt belongs to protocol = "atl", not "mn"'),
        ("aerosmith_atl", "text/prompt", "", 'protocol = "atl" needs text.prompt; add it'),
        ("mn_ascii", "text/checked", None, 'protocol = "mn" needs [text.checked]; add it'),
        ("mn_ascii", "modbus", {"unit": 1, "timeout_s": 1.0}, "[modbus] does not belong to protocol"),
        (
            "mn_ascii",
            "text/commands/move",
            ["POS,{axes},{angle}"],
            "move: 'POS,{axes},{angle}': '{axes}' is unknown here; did you mean 'axis'?",
        ),
        ("mn_ascii", "text/commands/stop", [], "text.commands.stop"),
        ("mn_ascii", "text/queries/state/answer", "(?P<value", "is no regular expression"),
        ("mn_ascii", "text/queries/state/answer", "[0-9]+", "has no named group"),
        (
            "mn_ascii",
            "text/queries/position/answer",
            "(?P<outer>.*)",
            "position: the answer needs a group inner",
        ),
        (
            "mn_ascii",
            "text/queries/identity/answer",
            "(?P<serial>.*)",
            "identity: the answer needs a group model",
        ),
        ("mn_ascii", "text/queries/rate", None, "queries.rate is missing; add it"),
        ("mn_ascii", "text/flags/enabled", None, "flags.enabled is missing; add it"),
        (
            "mn_ascii",
            "text/flags/enable",
            {"always": True},
            "flags.enable is unknown; did you mean 'enabled'?",
        ),
        (
            "mn_ascii",
            "text/flags/homed",
            {"query": "stat", "bit": 0},
            "homed: there is no query 'stat'; did you mean",
        ),
        (
            "mn_ascii",
            "text/flags/homed",
            {"query": "state", "bit": 0, "group": "x"},
            "query 'state' has no group 'x'",
        ),
        ("mn_ascii", "text/flags/homed", {"query": "state"}, "needs one of bit, matches and always"),
        ("mn_ascii", "text/flags/homed", {"bit": 0}, "needs the query that tells it"),
        ("aerosmith_atl", "text/flush", "stat", "flush: there is no query 'stat'; did you mean 'state'?"),
        ("aerosmith_atl", "text/silent", "JOG(", "is no regular expression"),
    ],
)
def test_a_wrong_text_table_is_told_by_its_entry(
    tmp_path: Path, name: str, where: str, value: Any, told: str
) -> None:
    data = text_table(name)
    edit(data, where, value)
    path = tmp_path / "profile.toml"
    path.write_text(tomli_w.dumps(data), encoding="utf-8")
    with pytest.raises(ConfigurationError) as caught:
        load_table_profile(path)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)
