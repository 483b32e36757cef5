"""True attitude and rotation of the table: signs of the contract, directions of table errors, exact rates."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from table_truth import rotation_states, table_attitude

from calstation.bench.truth import TableTruth, normal_gravity
from calstation.bench.truth.table import EARTH_RATE

LATITUDE = np.deg2rad(34.25)
PERFECT = TableTruth(LATITUDE, 400.0, azimuth=np.deg2rad(37.0))


def real_table(**changes):
    values = {
        "azimuth": 0.6,
        "base_tilt": (1e-3, -2e-3, 0.0),
        "non_orthogonality": 3e-4,
        "wobble": (2e-3, 3e-3),
        "wobble_phase": (0.4, 1.9),
        "mount": (0.01, -0.012, 0.008),
    }
    return TableTruth(LATITUDE, 400.0, **{**values, **changes})


def test_normal_gravity_agrees_with_published_values():
    # NIMA TR8350.2: equator 9.7803253359, pole 9.8321849378; at 45° 9.80619777 (Somigliana).
    assert normal_gravity(0.0, 0.0) == pytest.approx(9.7803253359, abs=1e-10)
    assert normal_gravity(np.pi / 2, 0.0) == pytest.approx(9.8321849378, abs=1e-9)
    assert normal_gravity(np.pi / 4, 1000.0) == pytest.approx(9.806197769 - 3.0857e-3, abs=1e-5)


def test_error_free_table_is_the_product_of_rotations_in_the_contract():
    angles = np.array([[0.0, 0.0], [0.7, 0.0], [0.0, -1.1], [2.5, 4.0]])
    for (outer, inner), attitude in zip(angles, table_attitude(PERFECT, angles), strict=True):
        expected = Rotation.from_euler("ZXZ", [-PERFECT.azimuth, outer, inner]).as_matrix()
        assert attitude == pytest.approx(expected, abs=1e-14)


def test_azimuth_turns_body_y_clockwise_from_north():
    y_n = table_attitude(PERFECT, np.zeros((1, 2)))[0] @ [0.0, 1.0, 0.0]
    assert y_n == pytest.approx([np.sin(PERFECT.azimuth), np.cos(PERFECT.azimuth), 0.0], abs=1e-15)


def test_non_orthogonality_tilts_the_inner_axis_towards_the_outer():
    delta = 1e-3
    table = TableTruth(LATITUDE, 0.0, non_orthogonality=delta)
    inner_axis_n = table_attitude(table, np.array([[0.0, 1.0]]))[0] @ [0.0, 0.0, 1.0]
    # A right-handed turn about outer × inner = −y carries z towards −x.
    assert inner_axis_n == pytest.approx([-np.sin(delta), 0.0, np.cos(delta)], abs=1e-12)


def test_wobble_tilts_the_axis_in_a_direction_that_rotates_with_the_joint():
    tilt = 2e-3
    table = TableTruth(LATITUDE, 0.0, wobble=(0.0, tilt))
    angles = np.linspace(0.0, 2.0 * np.pi, 13)
    spins = table_attitude(table, np.column_stack([0.0 * angles, angles])) @ [0.0, 0.0, 1.0]
    assert np.arccos(spins[:, 2]) == pytest.approx(tilt, abs=1e-9)
    directions = np.unwrap(np.arctan2(spins[:, 1], spins[:, 0]))
    assert directions - directions[0] == pytest.approx(2.0 * angles, abs=1e-6)


def test_mounting_error_acts_in_body_axes_and_base_tilt_in_base_axes():
    angles = np.array([[1.1, -0.4]])
    mount, tilt = np.array([0.01, 0.02, -0.015]), np.array([2e-3, -1e-3, 0.0])
    table = TableTruth(LATITUDE, 0.0, azimuth=0.3, base_tilt=tuple(tilt), mount=tuple(mount))
    plain = table_attitude(TableTruth(LATITUDE, 0.0, azimuth=0.3), angles)[0]
    expected = Rotation.from_rotvec(tilt).as_matrix() @ plain @ Rotation.from_rotvec(mount).as_matrix()
    assert table_attitude(table, angles)[0] == pytest.approx(expected, abs=1e-14)


def test_unit_at_rest_measures_only_earth_rate():
    table = real_table()
    outer, inner = np.array([[0.8, 0.0, 0.0]]), np.array([[-2.1, 0.0, 0.0]])
    rate, change = rotation_states(table, outer, inner)
    attitude = table_attitude(table, np.array([[0.8, -2.1]]))[0]
    earth = EARTH_RATE * np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)])
    assert rate[0] == pytest.approx(attitude.T @ earth, abs=1e-19)
    assert np.all(change == 0.0)


def test_rates_are_exact_derivatives_of_the_attitude_including_wobble():
    table = real_table()
    # Smooth joint angles with known derivatives.
    outer = lambda t: np.array([0.9 * np.sin(t), 0.9 * np.cos(t), -0.9 * np.sin(t)])  # noqa: E731
    inner = lambda t: np.array([1.4 * t + 0.2 * t**2, 1.4 + 0.4 * t, 0.4])  # noqa: E731
    for time in (0.0, 0.7, 2.3):
        h = 1e-4
        attitudes = [
            table_attitude(table, np.array([[outer(t)[0], inner(t)[0]]]))[0] for t in time + h * np.arange(-2, 3)
        ]
        slope = (attitudes[0] - 8 * attitudes[1] + 8 * attitudes[3] - attitudes[4]) / (12 * h)
        skew = attitudes[2].T @ slope
        from_earth = attitudes[2].T @ table.earth_rate_n
        expected = np.array([skew[2, 1], skew[0, 2], skew[1, 0]]) + from_earth
        rate, change = rotation_states(table, outer(time)[None], inner(time)[None])
        assert rate[0] == pytest.approx(expected, abs=1e-10)
        around = [rotation_states(table, outer(t)[None], inner(t)[None])[0][0] for t in time + h * np.arange(-2, 3)]
        expected_change = (around[0] - 8 * around[1] + 8 * around[3] - around[4]) / (12 * h)
        assert change[0] == pytest.approx(expected_change, abs=1e-9)
