"""Register values are encoded and decoded."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.devices.imu import RegisterMap
from calstation.devices.profiles import load_imu_profile
from calstation.errors import DeviceFaultError
from calstation.physics import NAMES
from tests.helpers import raises_code

PROFILE = load_imu_profile(Path(__file__).parents[2] / "data" / "imus" / "bench_nav.toml")
MAP = RegisterMap(tuple(PROFILE.registers))
RANGES = {name: entry.range for entry in PROFILE.registers for name in entry.parameters if name}


def test_every_parameter_except_the_outer_lever_arm_has_a_register() -> None:
    assert set(MAP.parameters) == {n for n in NAMES if not n.startswith("outer_lever")}
    assert MAP.address("gyro_misalign_xy") == 4
    assert MAP.address("accel_misalign_zy") == 22
    with pytest.raises(KeyError):
        MAP.address("outer_lever_x")


@given(name=st.sampled_from(MAP.parameters), part=st.floats(0, 1))
def test_values_survive_encoding_as_float32(name: str, part: float) -> None:
    low, high = RANGES[name]
    value = low + part * (high - low)
    back = MAP.decode(MAP.encode({**dict.fromkeys(MAP.parameters, 0.0), name: value}))
    assert back == {**dict.fromkeys(MAP.parameters, 0.0), name: float(np.float32(value))}
    assert MAP.rounded(back) == back


def test_a_value_out_of_range_is_reported_with_its_register() -> None:
    with raises_code(DeviceFaultError, "imu.value_beyond_register"):
        MAP.encode({**dict.fromkeys(MAP.parameters, 0.0), "gyro_misalign_xy": 0.5})
    with raises_code(DeviceFaultError, "imu.value_beyond_register"):
        MAP.encode({**dict.fromkeys(MAP.parameters, 0.0), "gyro_bias_x": float("nan")})
