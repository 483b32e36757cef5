"""Registers hold what was meant: encode, decode, and a transfer that trusts nothing it has not read back."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calstation.devices.imu_profile import load_imu_profile
from calstation.devices.interfaces import ImuIdentity, LinkStats, SampleBatch
from calstation.devices.registers import RegisterMap
from calstation.devices.transfer import transfer
from calstation.errors import DeviceFaultError
from calstation.physics.parameters import NAMES

PROFILE = load_imu_profile(Path(__file__).parents[2] / "data" / "imus" / "bench_nav.toml")
MAP = RegisterMap(tuple(PROFILE.registers))
RANGES = {name: entry.range for entry in PROFILE.registers for name in entry.parameters if name}


def test_every_parameter_but_the_outer_lever_has_a_register() -> None:
    assert set(MAP.parameters) == {n for n in NAMES if not n.startswith("outer_lever")}
    assert MAP.address("gyro_misalign_xy") == 4
    assert MAP.address("accel_misalign_zy") == 22
    with pytest.raises(KeyError):
        MAP.address("outer_lever_x")


@settings(deadline=None, max_examples=100)
@given(name=st.sampled_from(MAP.parameters), part=st.floats(0, 1))
def test_values_survive_as_float32(name: str, part: float) -> None:
    low, high = RANGES[name]
    value = low + part * (high - low)
    back = MAP.decode(MAP.encode({**dict.fromkeys(MAP.parameters, 0.0), name: value}))
    assert back == {**dict.fromkeys(MAP.parameters, 0.0), name: float(np.float32(value))}
    assert MAP.rounded(back) == back


def test_a_value_that_does_not_fit_is_told_by_register() -> None:
    with pytest.raises(DeviceFaultError, match=r"gyro_misalign_xy = 0.5 does not fit register 4"):
        MAP.encode({**dict.fromkeys(MAP.parameters, 0.0), "gyro_misalign_xy": 0.5})
    with pytest.raises(DeviceFaultError, match="does not fit"):
        MAP.encode({**dict.fromkeys(MAP.parameters, 0.0), "gyro_bias_x": float("nan")})


class RegisterUnit:
    """A unit with RAM and flash registers; `deaf` names one that takes no value, `forgets` loses one at reset."""

    def __init__(self, deaf: str = "", forgets: str = "") -> None:
        self.deaf, self.forgets = deaf, forgets
        self.ram = {name: float(np.float32(0.001)) for name in MAP.parameters}
        self.flash = dict(self.ram)
        self.calls: list[str] = []

    stats = LinkStats()

    def start(self) -> None: ...

    def close(self) -> None: ...

    def read(self) -> SampleBatch:
        raise NotImplementedError

    def identify(self) -> ImuIdentity:
        return ImuIdentity("m", "s", "f")

    def read_registers(self) -> dict[str, float]:
        self.calls.append("read")
        return dict(self.ram)

    def write_registers(self, values: Mapping[str, float]) -> None:
        self.calls.append("write")
        self.ram.update({k: v for k, v in values.items() if k != self.deaf})

    def commit(self) -> None:
        self.calls.append("commit")
        self.flash = {**self.ram, **({self.forgets: 0.0} if self.forgets else {})}

    def reset(self) -> None:
        self.calls.append("reset")
        self.ram = dict(self.flash)


def test_a_transfer_keeps_the_old_values_first_and_verifies_the_restarted_unit() -> None:
    unit = RegisterUnit()
    kept: list[Mapping[str, float]] = []
    done = transfer(unit, MAP, {"gyro_bias_x": 1.23456789e-6, "outer_lever_x": 9.0}, kept.append)
    assert unit.calls == ["read", "write", "read", "commit", "reset", "read"]
    assert kept == [done.old]
    assert done.verified
    assert done.new["gyro_bias_x"] == float(np.float32(1.23456789e-6))
    assert done.new["gyro_bias_y"] == done.old["gyro_bias_y"]
    assert "outer_lever_x" not in done.new


def test_a_register_that_does_not_read_back_is_never_committed() -> None:
    unit = RegisterUnit(deaf="accel_bias_z")
    with pytest.raises(
        DeviceFaultError, match=r"register 14 \(accel_bias_z\) reads back .* before the commit"
    ):
        transfer(unit, MAP, {"accel_bias_z": 0.01}, lambda old: None)
    assert "commit" not in unit.calls


def test_a_register_that_flash_lost_is_told() -> None:
    unit = RegisterUnit(forgets="gyro_scale_y")
    with pytest.raises(
        DeviceFaultError, match=r"register 7 \(gyro_scale_y\) reads back 0 .* after the restart"
    ):
        transfer(unit, MAP, {"gyro_scale_y": 0.01}, lambda old: None)


def test_nothing_is_written_where_a_value_does_not_fit() -> None:
    unit = RegisterUnit()
    with pytest.raises(DeviceFaultError, match="nothing was written"):
        transfer(unit, MAP, {"gyro_scale_y": 5.0}, lambda old: None)
    assert unit.calls == ["read"]
