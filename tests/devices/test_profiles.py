"""Profiles are validated completely when loaded, and errors name the invalid entry."""

import copy
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from calstation.devices.profiles import ImuProfile, TableProfile, load_imu_profile, load_table_profile
from calstation.errors import ConfigurationError
from tests.helpers import error_code

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
    return error_code(caught.value)


@pytest.mark.parametrize(
    ("where", "value", "expected"),
    [
        ("registers/1/address", 2, "registers[2].address profile.registers_overlap"),
        ("registers/1/parameters", ["gyro_bias_x"], "registers[2].parameters profile.parameter_twice"),
        ("registers/1/parameters", ["gyro_scal_x"], "registers[2].parameters[1] entry.unknown_parameter"),
        ("registers/0/range", [1.0, -1.0], "registers[1].range profile.range_order"),
        ("registers/0/adress", 3, "registers[1].adress entry.unknown"),
        ("frame/sync", "5G", "frame.sync profile.not_hexadecimal"),
        ("frame/crc/kind", "crc7", "frame.crc.kind profile.unknown_check"),
        ("frame/fields/0/type", "i16", 'frame.fields["counter"].type profile.counter_type'),
        ("frame/fields/1/name", "gyro_y", "frame.fields[3] profile.field_twice"),
        ("frame/fields/1/name", "gyrox", 'frame.fields["gyrox"].name entry.unknown_name'),
        ("commands/reply_sync", "55 AA", "frame.sync profile.sync_of_replies"),
        ("stream/sample_rate_hz", -1.0, "stream.sample_rate_hz entry.greater_than"),
        ("link/parity", "X", "link.parity entry.not_one_of"),
        ("link/baud", 0, "link.baud entry.greater_than_equal"),
        ("link/stop_bits", 3, "link.stop_bits profile.stop_bits"),
        ("prior/gyro", {"sigma": 1.0}, "prior.gyro entry.unknown_parameter"),
        ("noise/gyro_arw", None, "noise.gyro_arw entry.missing"),
    ],
)
def test_invalid_imu_profile_is_reported_by_its_entry(tmp_path: Path, where: str, value: Any, expected: str) -> None:
    assert refused(tmp_path, load_imu_profile, "imus", where, value) == expected


@pytest.mark.parametrize(
    ("where", "value", "expected"),
    [
        ("registers/fault/address", 17, "registers.fault.address profile.registers_overlap"),
        ("registers/outer_rate/address", 31, "registers.outer_rate.address profile.registers_overlap"),
        ("registers/outer_rate", None, "registers.outer_rate entry.missing"),
        ("registers/outer_speed", {"address": 90, "type": "i32"}, "registers.outer_speed entry.unknown"),
        ("registers/model/words", None, "registers.model.words profile.needed_by"),
        ("status_bits/moving", 16, "status_bits.moving entry.out_of_range"),
        ("commands/stop", None, "commands.stop entry.missing"),
        ("faults/x", "odd", "faults.x profile.not_a_code"),
        ("outer_axis", [1.0, 0.0, 0.5], "outer_axis profile.not_a_unit_vector"),
        ("inner_axis", [1.0, 0.0, 0.0], "profile.axes_too_close"),
        ("outer/low_deg", 2000.0, "outer profile.travel_order"),
        ("accuracy/velocity_sigma", 0.0, "accuracy.velocity_sigma entry.greater_than"),
        ("status_bits/remot", 9, "status_bits.remot entry.unknown"),
        ("commands/turn", 5, "commands.turn entry.unknown"),
        ("registers/outer_target_rate/type", "u32", "registers.outer_target_rate.type profile.turn_rate_unsigned"),
        ("modbus", None, "modbus profile.needed_by"),
        ("protocol", "atl", "text profile.needed_by"),
        ("link_loss_stop_s", 0.0, "link_loss_stop_s entry.greater_than"),
    ],
)
def test_invalid_table_profile_is_reported_by_its_entry(tmp_path: Path, where: str, value: Any, expected: str) -> None:
    assert refused(tmp_path, load_table_profile, "tables", where, value) == expected


def test_offset_of_the_axes_is_read(tmp_path: Path) -> None:
    data, path = bench("tables"), tmp_path / "table.toml"
    data["accuracy"]["axis_offset_mm"] = [0.1, -0.2]
    path.write_text(tomli_w.dumps(data), encoding="utf-8")
    assert load_table_profile(path).accuracy.axis_offset_mm == (0.1, -0.2)


def text_table(name: str) -> dict[str, Any]:
    return tomllib.loads((DATA / "tables" / f"{name}.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("name", "where", "value", "expected"),
    [
        ("aerosmith_atl", "protocol", "mn", "text.prompt profile.not_with"),
        ("aerosmith_atl", "text/prompt", "", "text.prompt profile.needed_by"),
        ("mn_ascii", "text/checked", None, "text.checked profile.needed_by"),
        ("mn_ascii", "modbus", {"unit": 1, "timeout_s": 1.0}, "modbus profile.not_with"),
        ("mn_ascii", "text/commands/move", ["POS,{axes},{angle}"], "text.commands.move[1] profile.unknown_brace"),
        ("mn_ascii", "text/commands/stop", [], "text.commands.stop entry.empty"),
        ("mn_ascii", "text/queries/state/answer", "(?P<value", "text.queries.state.answer entry.not_a_pattern"),
        ("mn_ascii", "text/queries/state/answer", "[0-9]+", "text.queries.state.answer profile.no_named_group"),
        (
            "mn_ascii",
            "text/queries/position/answer",
            "(?P<outer>.*)",
            "text.queries.position.answer profile.group_missing",
        ),
        (
            "mn_ascii",
            "text/queries/identity/answer",
            "(?P<serial>.*)",
            "text.queries.identity.answer profile.group_missing",
        ),
        ("mn_ascii", "text/queries/rate", None, "text.queries.rate entry.missing"),
        ("mn_ascii", "text/flags/enabled", None, "text.flags.enabled entry.missing"),
        ("mn_ascii", "text/flags/enable", {"always": True}, "text.flags.enable entry.unknown"),
        ("mn_ascii", "text/flags/homed", {"query": "stat", "bit": 0}, "text.flags.homed profile.no_such_query"),
        (
            "mn_ascii",
            "text/flags/homed",
            {"query": "state", "bit": 0, "group": "x"},
            "text.flags.homed profile.no_such_group",
        ),
        ("mn_ascii", "text/flags/homed", {"query": "state"}, "text.flags.homed profile.flag_needs_one_source"),
        ("mn_ascii", "text/flags/homed", {"bit": 0}, "text.flags.homed profile.flag_needs_query"),
        ("aerosmith_atl", "text/flush", "stat", "text.flush profile.no_such_query"),
        ("aerosmith_atl", "text/silent", "JOG(", "text.silent entry.not_a_pattern"),
    ],
)
def test_invalid_text_table_profile_is_reported_by_its_entry(
    tmp_path: Path, name: str, where: str, value: Any, expected: str
) -> None:
    data = text_table(name)
    edit(data, where, value)
    path = tmp_path / "profile.toml"
    path.write_text(tomli_w.dumps(data), encoding="utf-8")
    with pytest.raises(ConfigurationError) as caught:
        load_table_profile(path)
    assert error_code(caught.value) == expected
    assert "\n" not in str(caught.value)
