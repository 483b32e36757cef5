"""docs/reference/profiles.md documents every profile entry, and its examples are valid."""

import re
import tomllib
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Union, get_args, get_origin

import pytest
from pydantic import BaseModel

from calstation.devices.codecs import CHECK_WIDTHS, CRC_WIDTHS
from calstation.devices.imu import FrameDecoder, RegisterMap
from calstation.devices.imu.drivers.framed import command_frame
from calstation.devices.profiles import ImuProfile, ModbusRegister, TableProfile, load_imu_profile
from calstation.devices.profiles.imu_protocols.framed import OPS
from calstation.devices.profiles.table_registers import (
    COMMAND_REGISTERS,
    DRIVE_REGISTERS,
    JOINT_REGISTERS,
    OPTIONAL_DRIVE_REGISTERS,
)

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "reference" / "profiles.md").read_text(encoding="utf-8")
GUIDE = (ROOT / "docs" / "how-to" / "connect.md").read_text(encoding="utf-8")
DOCUMENTED = {word for span in re.findall(r"`([^`\n]+)`", TEXT) for word in re.findall(r"\w+", span)}


def models(kind: Any, seen: set[type]) -> Iterator[type[BaseModel]]:
    """Yield a model and all models of its fields."""
    if get_origin(kind) in (Annotated, Union, types.UnionType, list, dict, tuple):
        for part in get_args(kind):
            yield from models(part, seen)
    elif isinstance(kind, type) and issubclass(kind, BaseModel) and kind not in seen:
        seen.add(kind)
        yield kind
        for field in kind.model_fields.values():
            yield from models(field.annotation, seen)


@pytest.mark.parametrize("profile", [ImuProfile, TableProfile])
def test_every_entry_is_documented(profile: type[BaseModel]) -> None:
    found = list(models(profile, set()))
    assert len(found) > 8
    missing = [f"{m.__name__}.{name}" for m in found for name in m.model_fields if name not in DOCUMENTED]
    assert missing == []


def test_every_permitted_name_is_documented() -> None:
    names = {*OPS, *CHECK_WIDTHS, *COMMAND_REGISTERS, *DRIVE_REGISTERS, *OPTIONAL_DRIVE_REGISTERS, *JOINT_REGISTERS}
    assert sorted(names - DOCUMENTED) == []
    assert set(CRC_WIDTHS) <= DOCUMENTED


def test_example_request_matches_the_sent_bytes() -> None:
    profile = load_imu_profile(ROOT / "data" / "imus" / "bench_nav.toml")
    assert profile.commands is not None
    sent = command_frame(profile.commands, profile.frame, OPS["read"], bytes([0, 0, 3]))
    (shown,) = re.findall(r"    55 A5 \|.*", TEXT)
    assert bytes.fromhex(shown.replace("|", "")) == sent


def test_example_line_decodes_with_the_shipped_profile() -> None:
    path = ROOT / "data" / "imus" / "text_lines.toml"
    (shown,) = re.findall(r"    (\$IMU,.*)", TEXT)
    assert f"#   {shown}\n" in path.read_text(encoding="utf-8")
    decoder = FrameDecoder(load_imu_profile(path).frame)
    counter, counts, temperature, status = decoder.samples(decoder.feed(shown.encode() + b"\r\n").frames)
    assert counter.tolist() == [17]
    assert counts.tolist() == [[0.0123, -0.0045, 0.0002, 0.011, -0.032, 9.806]]
    assert temperature.tolist() == [25.4]
    assert status.tolist() == [1]


def test_example_unit_profile_in_the_guide_is_valid() -> None:
    (shown,) = [t for t in re.findall(r"```toml\n(.*?)```", GUIDE, re.DOTALL) if "[frame]" in t]
    profile = ImuProfile.model_validate(tomllib.loads(shown))
    assert profile.frame.min_size() == 34
    gyro, accel = RegisterMap(tuple(profile.registers)).entries
    assert gyro.names[:3] == ("gyro_matrix_xx", "gyro_matrix_yx", "gyro_matrix_zx")
    assert accel.names[-1] == "accel_offset_z"
    assert (gyro.address_of(9), accel.address_of(9)) == (0x49, 0x59)


def test_example_registers_in_the_guide_are_valid() -> None:
    shown = re.findall(r"`(\w+) = (\{ address.*?\})`", GUIDE)
    assert len(shown) == 6
    for name, entry in shown:
        register = ModbusRegister.model_validate(tomllib.loads(f"{name} = {entry}")[name])
        assert register.count in (1, 2)
