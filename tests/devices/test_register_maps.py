"""Register maps in profiles: types, byte order, scale, sign, convention and page, with exact conversion."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from calstation.devices.codecs import Convention, from_registers, matrix_elements, offset_elements, to_registers
from calstation.devices.imu import RegisterMap
from calstation.devices.profiles import RegisterEntry, load_imu_profile
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.physics import GROUPS, NAMES, PARAMETERS, compensate, compensation
from tests.devices.editing import edited
from tests.helpers import error_code, raises_code

DATA = Path(__file__).parents[2] / "data" / "imus"
CONVENTIONS = [
    Convention(matrix=m, identity=i, negated=n, offset=o, added=a)  # type: ignore[arg-type]
    for m, i, n, o, a in itertools.product(
        ("correction", "error"), (True, False), (False, True), ("before", "after"), (False, True)
    )
    if not (i and n)
]
small = st.floats(-0.05, 0.05)
vector = st.lists(small, min_size=3, max_size=3).map(np.array)


def parameters(sensor: str, draw: Any) -> dict[str, float]:
    names = [p.name for p in PARAMETERS if p.sensor == sensor and p.group != "accel_quadratic"]
    return {name: draw(small) for name in names}


def device_output(contents: dict[str, float], sensor: str, c: Convention, measured: np.ndarray) -> np.ndarray:
    """Return the corrected output by the formula of the unit, implemented independently."""
    registers = np.array([[contents[f"{sensor}_matrix_{row}{column}"] for column in "xyz"] for row in "xyz"])
    offset = np.array([contents[f"{sensor}_offset_{axis}"] for axis in "xyz"])
    offset = -offset if c.added else offset
    if not c.identity:
        registers = np.eye(3) - registers if c.negated else np.eye(3) + registers
    if c.matrix == "error":
        taken_off = measured - offset if c.offset == "before" else measured
        corrected = np.linalg.solve(registers, taken_off)
        return corrected if c.offset == "before" else corrected - offset
    return registers @ (measured - offset) if c.offset == "before" else registers @ measured - offset


@given(sensor=st.sampled_from(["gyro", "accel"]), c=st.sampled_from(CONVENTIONS), truth=vector, data=st.data())
def test_formula_of_the_unit_gives_the_exact_true_value(
    sensor: str, c: Convention, truth: np.ndarray, data: st.DataObject
) -> None:
    values = parameters(sensor, data.draw)
    vectorised = np.array([values.get(name, 0.0) for name in NAMES])
    model = compensation(vectorised)
    inverse, bias = (
        (model.gyro_inverse, model.gyro_bias) if sensor == "gyro" else (model.accel_inverse, model.accel_bias)
    )
    measured = np.linalg.inv(inverse) @ truth + bias
    contents = to_registers(sensor, values, (*matrix_elements(sensor), *offset_elements(sensor)), c, c)
    np.testing.assert_allclose(device_output(contents, sensor, c, measured), truth, rtol=0, atol=1e-15)
    back = from_registers(sensor, contents, c, c)
    assert set(back) == set(values)
    for name, value in values.items():
        assert back[name] == pytest.approx(value, abs=1e-15)


def test_first_order_inverse_is_not_accurate_enough() -> None:
    """With errors of 5 %, the first-order inverse is wrong by more than 0.2 %."""
    values = {n: 0.05 for n in NAMES if n.startswith("gyro_")}
    contents = to_registers("gyro", values, matrix_elements("gyro"), Convention(), Convention())
    assert abs(contents["gyro_matrix_xx"] - (1.0 - 0.05)) > 2e-3


@pytest.mark.parametrize("pairs", [["xx", "yy", "zz"], ["xx", "yx", "yy", "zx", "zy", "zz"]])
def test_partial_matrix_is_inverted_for_its_elements(pairs: list[str]) -> None:
    elements = [f"accel_matrix_{p}" for p in pairs]
    values = {n: 0.01 * (i + 1) for i, n in enumerate(NAMES) if n.startswith("accel")}
    contents = to_registers("accel", values, elements, Convention(), Convention())
    back = from_registers("accel", contents, Convention(), Convention())
    assert back == {name: pytest.approx(values[name], abs=1e-15) for name in back}
    assert len(back) == len(pairs)


def test_register_values_without_a_valid_calibration_are_refused() -> None:
    erased = dict.fromkeys(matrix_elements("gyro"), 0.0)
    assert all(np.isnan(v) for v in from_registers("gyro", erased, Convention(), Convention()).values())
    full = {**dict.fromkeys(matrix_elements("accel"), 0.0), "accel_matrix_xx": 1.0, "accel_matrix_yy": 1.0}
    full |= {"accel_matrix_zz": 1.0, "accel_matrix_xz": 0.01}
    with raises_code(DeviceFaultError, "imu.matrix_not_triangular"):
        from_registers("accel", full, Convention(), Convention())


# Maps of shipped profiles ----------------------------------------------------------------------------------------


def valid_values(name: str, draw: Any) -> dict[str, float]:
    """Draw parameter values within the limits of a unit of the profile's type."""
    sigmas = load_imu_profile(DATA / f"{name}.toml").prior_sigmas()
    return {n: draw(st.floats(-3 * sigmas[n], 3 * sigmas[n])) for n in map_of(name).parameters}


def map_of(name: str) -> RegisterMap:
    return RegisterMap(tuple(load_imu_profile(DATA / f"{name}.toml").registers))


@pytest.mark.parametrize("name", ["bench_nav", "vectornav_vn100", "dsp_modbus"])
@given(data=st.data())
def test_valid_values_survive_encoding_within_register_resolution(name: str, data: st.DataObject) -> None:
    entries = map_of(name)
    values = valid_values(name, data.draw)
    contents = entries.rounded(values)
    assert set(contents) == set(values)
    for parameter, value in values.items():
        assert contents[parameter] == pytest.approx(value, abs=2e-4 if "lever" in parameter else 2e-7)
    again = entries.rounded(contents)
    assert entries.differing_parameters(contents, again) == []
    assert entries.differing_parameters(contents, entries.decode(entries.encode(contents))) == []


def test_vectornav_identity_matrix_is_a_zero_calibration() -> None:
    entries = map_of("vectornav_vn100")
    plain = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    assert entries.encode(dict.fromkeys(entries.parameters, 0.0)) == {25: plain, 84: plain}
    assert set(entries.decode({25: plain, 84: plain}).values()) == {0.0}
    assert entries.address("gyro_misalign_xy") == entries.address("gyro_bias_z") == 84
    assert set(entries.parameters) == {p.name for p in PARAMETERS if p.sensor != "lever" and "quadratic" not in p.name}


def test_read_back_tolerates_only_rounding() -> None:
    entries = map_of("vectornav_vn100")
    wanted = entries.rounded({**dict.fromkeys(entries.parameters, 0.0), "gyro_scale_x": 1.2345678e-3})
    seven_digits = {k: [float(f"{v:.6E}") for v in row] for k, row in entries.encode(wanted).items()}
    assert entries.differing_parameters(wanted, entries.decode(seven_digits)) == []
    seven_digits[84][0] += 2e-6
    assert entries.differing_parameters(wanted, entries.decode(seven_digits)) == ["gyro_scale_x"]
    seven_digits[84][0] = float("nan")
    assert "gyro_scale_x" in entries.differing_parameters(wanted, entries.decode(seven_digits))


def test_read_back_without_a_tolerance_compares_every_bit() -> None:
    entries = map_of("bench_nav")
    zero = dict.fromkeys(entries.parameters, 0.0)
    one_step = float(np.nextafter(np.float32(1e-5), np.float32(1)))
    assert entries.differing_parameters(
        {**zero, "gyro_bias_x": float(np.float32(1e-5))}, {**zero, "gyro_bias_x": one_step}
    ) == ["gyro_bias_x"]
    assert entries.differing_parameters(zero, {**zero, "accel_bias_z": -0.0}) == ["accel_bias_z"]
    nan = {**zero, "accel_bias_z": float("nan")}
    assert entries.differing_parameters(nan, nan) == []
    assert entries.differing_parameters({"gyro_bias_x": 0.0}, {}) == ["gyro_bias_x"]


def test_matrix_can_be_stored_in_column_major_order() -> None:
    rows = RegisterEntry(address=0, parameters=["gyro_matrix"], range=[-1.0, 1.0])
    columns = RegisterEntry(address=0, parameters=["gyro_matrix"], major="column", range=[-1.0, 1.0])
    assert [n[-2:] for n in rows.names] == ["xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"]
    assert [n[-2:] for n in columns.names] == ["xx", "yx", "zx", "xy", "yy", "zy", "xz", "yz", "zz"]


def test_negative_scale_inverts_the_sign() -> None:
    entry = RegisterEntry(address=7, parameters=["gyro_bias"], scale=-1e-6, type="i16", range=[-0.01, 0.01])
    entries = RegisterMap((entry,))
    contents = entries.encode({"gyro_bias_x": 1e-3, "gyro_bias_y": -0.01, "gyro_bias_z": 0.0})
    assert contents == {7: [-1000.0, 10000.0, 0.0]}
    assert entries.decode(contents)["gyro_bias_y"] == pytest.approx(-0.01)
    with raises_code(DeviceFaultError, "imu.value_beyond_register"):
        entries.encode({"gyro_bias_x": 0.0, "gyro_bias_y": 0.0, "gyro_bias_z": 0.02})


def test_stored_register_values_are_shown_as_hexadecimal() -> None:
    rows = map_of("bench_nav").hex_contents({"gyro_bias_y": 1.0 / 64})
    assert rows == [(1, "gyro_bias_y", "3C800000")]
    stored = {name: raw for _, name, raw in map_of("dsp_modbus").hex_contents({"accel_bias_x": -1e-7})}
    assert stored == {"accel_bias_x": "FFFFFFFF"}


# An invalid map is reported by its entry ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "where", "value", "expected"),
    [
        ("dsp_modbus", "registers/1/address", 117, "registers[2].address profile.registers_overlap"),
        ("dsp_modbus", "registers/1/type", "i24", "registers[2].type profile.not_whole_registers"),
        ("dsp_modbus", "registers/1/type", "i12", "registers[2].type profile.unknown_type"),
        ("dsp_modbus", "registers/4/page", 0, None),
        ("dsp_modbus", "modbus/page", None, "registers[1].page profile.no_pages"),
        ("dsp_modbus", "registers/2/range", [-3.0, 3.0], "registers[3].range profile.range_beyond_type"),
        ("dsp_modbus", "registers/5/scale", 1e-6, "registers[6].range profile.range_beyond_type"),
        ("dsp_modbus", "registers/3/range", [-0.3, 0.3], "registers[4].range profile.range_too_narrow"),
        ("dsp_modbus", "registers/0/range", [-0.01, 0.01], "registers[1].range profile.range_too_narrow"),
        ("dsp_modbus", "registers/3/scale", 0.0, "registers[4].scale profile.scale_zero"),
        ("dsp_modbus", "registers/4", None, "registers profile.parameter_without_register"),
        ("dsp_modbus", "without_register", ["gyro_bias"], "without_register[1] profile.has_register"),
        ("dsp_modbus", "without_register", ["gyro_bia"], "without_register[1] entry.unknown_parameter"),
        ("dsp_modbus", "registers/0/parameters", ["gyro_matrix_xx"], "registers[1] profile.matrix_incomplete"),
        ("dsp_modbus", "registers/1/parameters", ["gyro_offset_x"], "registers[1] profile.offset_incomplete"),
        (
            "dsp_modbus",
            "registers/4/convention",
            {"offset": "after"},
            "registers[5].convention profile.convention_without_matrix",
        ),
        ("dsp_modbus", "registers/4/word_order", "fraction_first", "registers[5].word_order profile.fraction_first"),
        ("dsp_modbus", "registers/5/parameters", ["accel_misalign"], "registers[3] profile.parameter_and_matrix"),
        ("dsp_modbus", "registers/4/parameters", ["gyro_matrx"], "registers[5].parameters[1] entry.unknown_parameter"),
        ("dsp_modbus", "modbus", None, "modbus profile.needed_by"),
        ("vectornav_vn100", "modbus", {}, "modbus.timeout_s entry.missing"),
        ("vectornav_vn100", "vectornav/digits", 6, "vectornav.digits entry.greater_than_equal"),
        ("vectornav_vn100", "vectornav/check", "crc32", "vectornav.check entry.not_one_of"),
        ("vectornav_vn100", "registers/1/address", 84, "registers[2].address profile.registers_overlap"),
        ("vectornav_vn100", "without_register", None, "registers profile.parameter_without_register"),
        ("vectornav_vn100", "registers/0/range", [-1.0, 1.0], "registers[1].range profile.range_too_narrow"),
        (
            "stim300",
            "registers",
            [{"address": 0, "parameters": ["gyro_bias"], "range": [-1.0, 1.0]}],
            "registers profile.not_with",
        ),
        ("bench_nav", "commands/ops", {"reed": 2}, "commands.ops.reed entry.unknown"),
        ("bench_nav", "commands/ops", {"read": 3}, "commands.ops profile.same_op_twice"),
        ("bench_nav", "commands/ops", {"read": 256}, "commands.ops.read entry.out_of_range"),
        ("bench_nav", "commands/errors", {"x": "odd"}, "commands.errors.x profile.not_a_code"),
        ("bench_nav", "commands", None, "commands profile.needed_by"),
    ],
)
def test_invalid_register_map_is_reported_by_its_entry(
    tmp_path: Path, name: str, where: str, value: Any, expected: str | None
) -> None:
    path = tmp_path / "profile.toml"
    path.write_text(tomli_w.dumps(edited(DATA / f"{name}.toml", {where: value})), encoding="utf-8")
    if expected is None:
        load_imu_profile(path)
        return
    with pytest.raises(ConfigurationError) as caught:
        load_imu_profile(path)
    assert error_code(caught.value) == expected
    assert "\n" not in str(caught.value)


def test_group_name_expands_to_its_parameters() -> None:
    for group in GROUPS:
        entry = RegisterEntry(address=0, parameters=[group], range=[-1.0, 1.0])
        assert list(entry.names) == [p.name for p in PARAMETERS if p.group == group]


def test_offline_compensation_equals_the_correction_by_the_unit() -> None:
    """The unit with these registers and the offline compensation give the same output."""
    random = np.random.default_rng(7)
    entries = map_of("vectornav_vn100")
    values = {n: float(random.uniform(-0.01, 0.01)) for n in entries.parameters}
    contents = entries.rounded(values)
    row = entries.encode(contents)[84]
    measured = random.uniform(-1, 1, (5, 3))
    unit = (measured - row[9:]) @ np.array(row[:9]).reshape(3, 3).T
    vectorised = np.array([contents.get(name, 0.0) for name in NAMES])
    ours, _ = compensate(compensation(vectorised), measured, np.zeros((5, 3)))
    np.testing.assert_allclose(unit, ours, atol=2e-7)
