"""The output of the simulated unit agrees with closed forms at rest, in rotation and after integration."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from table_truth import rotation_states, table_attitude

from calstation.bench import BenchConfig
from calstation.bench.truth import ImuTruth, TableTruth
from calstation.bench.truth.imu import digitise, true_increments
from calstation.bench.truth.kinematics import JointProfile
from calstation.physics import COUNT, INDEX

LATITUDE = np.deg2rad(34.25)
PLAIN = TableTruth(LATITUDE, 400.0)
GRAVITY = PLAIN.up_force_n[2]


def unit(sample_rate=100.0, **parameters):
    values = np.zeros(COUNT)
    for name, value in parameters.items():
        values[INDEX[name]] = value
    return ImuTruth(values, sample_rate, "increment", 1e-9, 1e-9, 0.0, 0.0)


def increments(imu, table, outer, inner, count, first=0, velocity=None):
    interval = 1.0 / imu.sample_rate
    return true_increments(
        imu.error_model(),
        table.chain(),
        np.array([table.up_force_n, table.earth_rate_n]),
        outer.segments,
        outer.rest_time,
        inner.segments,
        inner.rest_time,
        first,
        interval,
        np.zeros((count + 1, 3)) if velocity is None else velocity,
    )


def test_at_rest_a_perfect_unit_measures_gravity_and_earth_rate():
    table = replace(PLAIN, azimuth=0.5, mount=(0.01, 0.0, -0.02))
    rates = increments(unit(), table, JointProfile.rest(0.7), JointProfile.rest(-1.3), 3) * 100.0
    to_body = table_attitude(table, np.array([[0.7, -1.3]]))[0].T
    assert rates[:, :3] == pytest.approx(np.tile(to_body @ table.earth_rate_n, (3, 1)), abs=1e-17)
    # The lever arm is 0, so the earth's rotation affects the accelerometers only through gravity.
    assert rates[:, 3:] == pytest.approx(np.tile(to_body @ [0.0, 0.0, GRAVITY], (3, 1)), abs=1e-13)


def test_thirty_parameters_act_as_the_contract_defines():
    random = np.random.default_rng(3)
    imu = ImuTruth(random.normal(0.0, 1e-3, COUNT), 100.0, "increment", 1e-9, 1e-9, 0.0, 0.0)
    p = {name: imu.parameters[i] for name, i in INDEX.items()}
    table = replace(PLAIN, azimuth=0.5)
    got = increments(imu, table, JointProfile.rest(0.7), JointProfile.rest(-1.3), 1)[0] * 100.0
    to_body = table_attitude(table, np.array([[0.7, -1.3]]))[0].T
    w, g = to_body @ table.earth_rate_n, to_body @ [0.0, 0.0, GRAVITY]
    f = np.empty(3)
    for i, axis in enumerate("xyz"):
        place = np.array([p[f"outer_lever_{a}"] for a in "xyz"])
        place[i] += p[f"inner_lever_{axis}"]
        f[i] = (g + np.cross(w, np.cross(w, place)))[i]
    gyro = [
        w[0] * (1 + p["gyro_scale_x"]) + p["gyro_misalign_xy"] * w[1] + p["gyro_misalign_xz"] * w[2],
        w[1] * (1 + p["gyro_scale_y"]) + p["gyro_misalign_yx"] * w[0] + p["gyro_misalign_yz"] * w[2],
        w[2] * (1 + p["gyro_scale_z"]) + p["gyro_misalign_zx"] * w[0] + p["gyro_misalign_zy"] * w[1],
    ]
    accel = [
        f[0] * (1 + p["accel_scale_x"]),
        f[1] * (1 + p["accel_scale_y"]) + p["accel_misalign_yx"] * f[0],
        f[2] * (1 + p["accel_scale_z"]) + p["accel_misalign_zx"] * f[0] + p["accel_misalign_zy"] * f[1],
    ]
    for i, axis in enumerate("xyz"):
        assert got[i] == pytest.approx(gyro[i] + p[f"gyro_bias_{axis}"], abs=1e-15)
        quadratic = p[f"accel_quadratic_{axis}"] * f[i] ** 2
        assert got[3 + i] == pytest.approx(accel[i] + quadratic + p[f"accel_bias_{axis}"], abs=1e-12)


def test_steady_rotation_gives_the_centripetal_forces_of_the_lever_arms():
    rate = 1.0
    imu = unit(outer_lever_x=0.3, outer_lever_y=-0.2, inner_lever_x=0.05, inner_lever_y=0.02, inner_lever_z=0.4)
    turning = JointProfile.rest(0.0).move(0.0, 20.0 * np.pi, rate, 10.0)
    # Well within the cruise; the earth tilts ω off the vertical by 1e-4 rad.
    forces = increments(imu, PLAIN, JointProfile.rest(0.0), turning, 50, first=1000)[:, 3:] * 100.0
    spin = rate + PLAIN.earth_rate_n[2]
    slack = 2.0 * PLAIN.earth_rate_n[1] * 0.7
    assert forces[:, 0] == pytest.approx(-(spin**2) * 0.35, abs=slack)
    assert forces[:, 1] == pytest.approx(-(spin**2) * -0.18, abs=slack)
    assert forces[:, 2] == pytest.approx(GRAVITY, abs=slack)


def test_accelerating_rotation_gives_the_euler_force_of_the_lever_arms():
    imu = unit(outer_lever_x=0.3, outer_lever_y=-0.2)
    acceleration = 0.5
    turning = JointProfile.rest(0.0).move(0.0, 100.0, 5.0, acceleration)
    # At 5 s the initial oscillation has decayed, and the acceleration of the joint is constant.
    forces = increments(imu, PLAIN, JointProfile.rest(0.0), turning, 1, first=500)[0, 3:] * 100.0
    angle, rate, change = turning.states(np.array([5.005]))[0]
    assert change == pytest.approx(acceleration, abs=1e-9)
    assert forces[0] == pytest.approx(-(rate**2) * 0.3 + acceleration * 0.2, abs=2e-3)
    assert forces[1] == pytest.approx(-(rate**2) * -0.2 + acceleration * 0.3, abs=2e-3)
    square = rate**2 + (acceleration * 0.01) ** 2 / 12.0
    earth = 2.0 * rate * PLAIN.earth_rate_n[2]
    # ω×(ω×r) for ω = (Ω_x, Ω_y, rate): first order in the earth's rotation, exact to 1e-8.
    north_body = np.array([np.sin(angle), np.cos(angle)]) * PLAIN.earth_rate_n[1]
    expected_z = GRAVITY + (rate + PLAIN.earth_rate_n[2]) * (north_body @ [0.3, -0.2])
    expected_x = -(square + earth) * 0.3 + acceleration * 0.2
    assert forces[0] == pytest.approx(expected_x, abs=1e-7)
    # The Euler term due to the rotating earth rate doubles it: ω' = Ω_b × ω_joint.
    assert forces[2] == pytest.approx(expected_z + rate * (north_body @ [0.3, -0.2]), abs=1e-6)


def test_integrated_body_rate_gives_the_closed_form_attitude():
    table = BenchConfig(seed=4, azimuth_error_deg=0.6, mount_deg=(0.6, 1.2), wobble_arcsec=200.0).truth().table
    outer = JointProfile.rest(0.1).move(0.05, 1.9, 0.6, 1.0)
    inner = JointProfile.rest(-0.4).move(0.05, -3.0, 0.9, 1.5)
    count, sample_rate = 6000, 1000.0
    gyro = increments(unit(sample_rate), table, outer, inner, count)[:, :3]
    # SO(3) from increments: two-sample coning correction (Bortz 1971, Miller 1983) over pairs of samples.
    first, second = gyro[::2], gyro[1::2]
    pairs = Rotation.from_rotvec(first + second + (2.0 / 3.0) * np.cross(first, second))
    attitude = Rotation.from_matrix(table_attitude(table, np.array([[0.1, -0.4]]))[0])
    for pair in pairs:
        attitude = attitude * pair
    time = count / sample_rate
    ends = np.array([[outer.states(np.array([time]))[0, 0], inner.states(np.array([time]))[0, 0]]])
    earth = Rotation.from_rotvec(table.earth_rate_n * time)
    # The body rotates in inertial space, while frame n has rotated with the earth.
    got = earth.inv() * attitude
    error = (Rotation.from_matrix(table_attitude(table, ends)[0]).inv() * got).magnitude()
    assert error < 1e-9


def test_integrated_specific_force_gives_the_velocity_at_the_lever_arm():
    imu = unit(1000.0, outer_lever_x=0.25, outer_lever_y=0.1, outer_lever_z=-0.2)
    table = replace(PLAIN, azimuth=0.4, wobble=(1e-3, 1e-3), mount=(0.01, 0.0, 0.01))
    outer = JointProfile.rest(0.0).move(0.1, 1.0, 0.5, 1.0)
    inner = JointProfile.rest(0.0).move(0.1, -2.0, 0.7, 1.5)
    count, h = 3000, 1e-3
    force = increments(imu, table, outer, inner, count)[:, 3:]
    lever = np.array([0.25, 0.1, -0.2])
    middles = (np.arange(count) + 0.5) * h
    attitudes = table_attitude(table, np.column_stack([outer.states(middles)[:, 0], inner.states(middles)[:, 0]]))
    earth = table.earth_rate_n
    velocity, places = np.zeros(3), attitudes @ lever
    velocities = np.gradient(places, h, axis=0)
    # v' = C f − 2 Ω × v + g with g including the centrifugal force at the centre; the lever's own is in f.
    coriolis = -2.0 * np.cross(earth, velocities) - np.cross(earth, np.cross(earth, places))
    velocity = np.einsum("nij,nj->i", attitudes, force) + (coriolis.sum(axis=0) - count * table.up_force_n) * h
    end = np.array([count * h])
    outer_end, inner_end = outer.states(end), inner.states(end)
    rate = rotation_states(table, outer_end, inner_end)[0][0]
    attitude = table_attitude(table, np.array([[outer_end[0, 0], inner_end[0, 0]]]))[0]
    expected = attitude @ np.cross(rate - attitude.T @ earth, lever)
    assert velocity == pytest.approx(expected, abs=2e-6)


def test_base_vibration_adds_its_velocity_changes():
    table = replace(PLAIN, azimuth=1.0)
    velocity = np.random.default_rng(1).normal(0.0, 1e-3, (11, 3))
    still = JointProfile.rest(0.3), JointProfile.rest(0.9)
    difference = increments(unit(), table, *still, 10, velocity=velocity) - increments(unit(), table, *still, 10)
    to_body = table_attitude(table, np.array([[0.3, 0.9]]))[0].T
    assert difference[:, 3:] == pytest.approx(np.diff(velocity, axis=0) @ to_body.T, abs=1e-15)
    assert np.all(difference[:, :3] == 0.0)


def quantise(values, as_rate, limit=1e9):
    nothing = np.zeros((6, 0))
    return digitise(
        values,
        np.zeros_like(values),
        np.zeros(6),
        np.zeros(0),
        nothing,
        nothing,
        np.full(6, 0.5),
        np.full(6, limit),
        0.1,
        as_rate,
        np.zeros(6),
    )


def test_increments_are_rounded_and_carry_the_remainder():
    values = np.random.default_rng(2).normal(0.0, 2.0, (1000, 6))
    counts, saturated = quantise(values, as_rate=False)
    assert not saturated.any()
    assert np.all(counts == np.round(counts))
    # The error of the sum never exceeds half a count.
    assert np.max(np.abs(np.cumsum(counts * 0.5, axis=0) - np.cumsum(values, axis=0))) <= 0.25 + 1e-9


def test_rates_are_sample_means_rounded_independently():
    values = np.random.default_rng(2).normal(0.0, 2.0, (1000, 6))
    counts, _ = quantise(values, as_rate=True)
    assert counts == pytest.approx(np.floor(values / 0.1 / 0.5 + 0.5), abs=0.0)


def test_saturated_counts_are_limited_and_flagged():
    values = np.zeros((3, 6))
    values[1, 4] = -100.0
    counts, saturated = quantise(values, as_rate=False, limit=50.0)
    assert list(saturated) == [False, True, False]
    assert counts[1, 4] == -50.0
    assert counts[2, 4] == 0.0
