"""The parameters of the error model have the names, order, units and matrix elements of the contract."""

import numpy as np
import pytest

from calstation.physics import (
    COUNT,
    DISPLAY,
    GROUPS,
    INDEX,
    NAMES,
    OUTER_LEVER,
    PARAMETER_START,
    PARAMETERS,
    PHI,
    STATES,
    display,
    entry_of,
    group_indices,
    group_matrix,
    group_vector,
    parameters,
)

CONTRACT = """
    gyro_bias         x y z              rad/s
    gyro_scale        x y z              1
    gyro_misalign     xy xz yx yz zx zy  rad
    accel_bias        x y z              m/s²
    accel_scale       x y z              1
    accel_misalign    yx zx zy           rad
    accel_quadratic   x y z              s²/m
    inner_lever       x y z              m
    outer_lever       x y z              m
"""


def contract_rows():
    for line in CONTRACT.strip().splitlines():
        group, *axes, unit = line.split()
        yield from ((group, axis, unit) for axis in axes)


def test_names_order_and_units_equal_the_contract():
    rows = list(contract_rows())
    assert len(rows) == COUNT == 30
    assert [f"{group}_{axis}" for group, axis, _ in rows] == list(NAMES)
    assert [p.unit for p in PARAMETERS] == [unit for _, _, unit in rows]
    assert tuple(dict.fromkeys(group for group, _, _ in rows)) == GROUPS


def test_names_contain_row_and_column():
    for group, axis, _ in contract_rows():
        parameter = PARAMETERS[INDEX[f"{group}_{axis}"]]
        assert parameter.row == "xyz".index(axis[0])
        assert parameter.column == "xyz".index(axis[-1])


def test_matrix_elements_are_at_the_row_and_column_of_their_names():
    values = np.arange(1.0, 31.0)
    gyro = group_matrix(values, "gyro_scale", "gyro_misalign")
    accel = group_matrix(values, "accel_scale", "accel_misalign")
    for i, row in enumerate("xyz"):
        for j, column in enumerate("xyz"):
            name = f"scale_{row}" if i == j else f"misalign_{row}{column}"
            assert gyro[i, j] == values[INDEX[f"gyro_{name}"]]
            assert accel[i, j] == (values[INDEX[f"accel_{name}"]] if j <= i else 0.0)


def test_groups_cover_every_parameter_once():
    values = np.arange(30.0)
    assert sorted(i for group in GROUPS for i in group_indices(group)) == list(range(30))
    assert group_vector(values, "outer_lever").tolist() == [27.0, 28.0, 29.0]


@pytest.mark.parametrize(
    ("name", "entry"),
    [
        ("gyro_bias_x", 1),
        ("gyro_bias_y", 2),
        ("secondary3_gyro_matrix_xy", 3),
        ("time_skew", 4),
        ("accel_bias_x", None),
        ("unknown", None),
    ],
)
def test_parameter_entry_takes_precedence_over_its_group(name, entry):
    entries = {"gyro_bias_x": 1, "gyro_bias": 2, "secondary_gyro_matrix": 3, "time_skew": 4}
    assert entry_of(entries, name) == entry


@pytest.mark.parametrize(
    ("name", "value", "shown", "unit"),
    [
        ("gyro_bias_x", np.deg2rad(1.0) / 3600.0, 1.0, "°/h"),
        ("gyro_scale_y", 25e-6, 25.0, "ppm"),
        ("gyro_misalign_zx", np.deg2rad(10.0 / 3600.0), 10.0, "″"),
        ("accel_bias_z", 9.80665e-3, 1000.0, "µg"),
        ("accel_scale_x", -3e-6, -3.0, "ppm"),
        ("accel_misalign_yx", np.deg2rad(1.0 / 3600.0), 1.0, "″"),
        ("accel_quadratic_x", 1e-6 / 9.80665, 1.0, "µg/g²"),
        ("inner_lever_x", 0.025, 25.0, "mm"),
        ("outer_lever_z", -0.1, -100.0, "mm"),
    ],
)
def test_values_are_converted_to_display_units(name, value, shown, unit):
    assert display(name, value) == (pytest.approx(shown, rel=1e-12), unit)


def test_every_group_has_a_display_unit():
    assert set(DISPLAY) >= set(GROUPS)


def test_order_of_the_states_follows_from_the_parameters() -> None:
    assert (39, 9, slice(0, 3)) == (STATES, PARAMETER_START, PHI)
    for group in GROUPS:
        members = np.arange(COUNT)[getattr(parameters, group.upper())]
        assert members.tolist() == group_indices(group)
    assert PARAMETER_START + OUTER_LEVER.stop == STATES
    others = [i for i, p in enumerate(PARAMETERS) if p.group != "outer_lever"]
    assert np.arange(COUNT)[parameters.SENSORS].tolist() == others
