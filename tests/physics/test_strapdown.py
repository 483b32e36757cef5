"""The strapdown kernel agrees with closed forms, finite differences and the motion of the bench."""

from dataclasses import replace

import numpy as np
import pytest
from table_truth import rotation_states, table_attitude

from calstation.bench import BenchConfig
from calstation.bench.truth import SensorStream
from calstation.bench.truth.kinematics import JointProfile
from calstation.physics import (
    COUNT,
    GROUPS,
    PARAMETERS,
    axis_rotation,
    body_rotation,
    compensate,
    compensation,
    dynamics,
    group_indices,
    increments,
    interval_work,
    normal_gravity,
    propagate,
    rotation_matrix,
    rotation_rate,
    rotation_vector,
)

G = 9.8
NO_EARTH = np.zeros(3)
PERFECT = compensation(np.zeros(COUNT))


def navigate(constants, gyro, accel, dt, attitude, velocity=(0.0, 0.0, 0.0), earth=NO_EARTH, gravity=G, span=None):
    """Return the output of the kernel after one interval over `span` of the samples, by default all of them."""
    work = interval_work()
    work.attitude[:] = attitude
    work.velocity[:] = velocity
    start, stop = span or (0, len(gyro))
    motion = increments(constants, dt, gyro, accel)
    propagate(constants, earth, gravity, dt, motion, start, stop, work)
    return work


def still(count, omega=(0.0, 0.0, 0.0), force=(0.0, 0.0, G)):
    return np.tile(np.array(omega, dtype=float), (count, 1)), np.tile(np.array(force, dtype=float), (count, 1))


def test_body_at_rest_on_the_rotating_earth_keeps_its_position():
    earth = rotation_rate(0.6)
    attitude = axis_rotation((0.0, 0.6, 0.8), 1.1)
    gyro, accel = still(200 * 600, attitude.T @ earth, attitude.T @ [0.0, 0.0, G])
    work = navigate(PERFECT, gyro, accel, 0.005, attitude, earth=earth)
    assert np.abs(rotation_vector(work.attitude @ attitude.T)).max() < 1e-11
    assert np.abs(work.velocity).max() < 1e-7
    assert work.force == pytest.approx([0.0, 0.0, G], abs=1e-9)


def test_free_fall_has_gravity_and_coriolis_acceleration():
    earth, seconds, dt = rotation_rate(0.6), 2.0, 0.005
    gyro, accel = still(400, earth, (0.0, 0.0, 0.0))
    work = navigate(PERFECT, gyro, accel, dt, np.eye(3), earth=earth)
    # eastward deflection of a falling body: v = Ω cos φ g t²
    assert work.velocity[0] == pytest.approx(earth[1] * G * seconds**2, rel=6e-3)
    assert work.velocity[2] == pytest.approx(-G * seconds, rel=1e-7)


def turning(omega, dt, count, attitude):
    """Return exact mean rate and specific force of a body in steady rotation without translation."""
    gyro = np.tile(omega, (count, 1))
    nodes, weights = np.polynomial.legendre.leggauss(8)
    accel = np.array(
        [
            sum(
                0.5 * w * (attitude @ rotation_matrix(omega * (k + 0.5 + 0.5 * x) * dt)).T @ [0.0, 0.0, G]
                for x, w in zip(nodes, weights, strict=True)
            )
            for k in range(count)
        ]
    )
    return gyro, accel


@pytest.mark.parametrize("degrees_per_second", [20.0, 200.0])
def test_steady_rotation_under_gravity_gives_no_velocity_and_keeps_its_axis(degrees_per_second):
    omega = np.deg2rad(degrees_per_second) * np.array([0.6, 0.0, 0.8])
    attitude, seconds = axis_rotation((1.0, 0.0, 0.0), 0.4), 8.0
    drifts = []
    for dt in (0.01, 0.005):
        count = round(seconds / dt)
        gyro, accel = turning(omega, dt, count + 1, attitude)
        # the integration begins at the second sample, because the first has no preceding one
        begin = attitude @ rotation_matrix(omega * dt)
        work = navigate(PERFECT, gyro, accel, dt, begin, span=(1, count + 1))
        exact = attitude @ rotation_matrix(omega * dt * (count + 1))
        assert np.abs(rotation_vector(work.attitude @ exact.T)).max() < 1e-10
        beta = np.linalg.norm(omega) * dt
        # gravity normal to the axis is too small by the factor (ω dt)³/24; other errors are of higher order
        assert np.linalg.norm(work.velocity) < 1.1 * G * seconds * beta**3 / 24.0 + 1e-12
        drifts.append(np.linalg.norm(work.velocity))
    assert drifts[1] < drifts[0] / 7.0 or drifts[0] < 1e-9


def coning(angle, frequency, dt, count):
    """Return mean rates of pure coning (Savage 1998, part 1) with half angle `angle` (rad) and `frequency` (rad/s)."""
    ends = np.arange(count + 1) * dt
    along = -2.0 * frequency * np.sin(0.5 * angle) ** 2 * np.ones(count)
    y = np.sin(angle) * np.diff(np.cos(frequency * ends)) / dt
    z = np.sin(angle) * np.diff(np.sin(frequency * ends)) / dt
    return np.column_stack([along, y, z])


def coned(angle, phase):
    """Return the attitude in coning: rotated by `angle` about an axis that revolves in the y-z plane."""
    return rotation_matrix(angle * np.array([0.0, np.cos(phase), np.sin(phase)]))


def test_coning_drift_equals_the_residual_of_the_coning_correction():
    angle, frequency, dt, count = np.deg2rad(2.0), 2.0 * np.pi * 5.0, 0.005, 2000
    gyro = coning(angle, frequency, dt, count)
    accel = np.zeros((count, 3))
    work = navigate(PERFECT, gyro, accel, dt, coned(angle, frequency * dt), gravity=0.0, span=(1, count))
    error = rotation_vector(work.attitude @ coned(angle, frequency * dt * count).T)
    beta, seconds = frequency * dt, dt * (count - 1)
    uncorrected = 0.5 * frequency * np.sin(angle) ** 2 * (1.0 - np.sin(beta) / beta) * seconds
    # sin²(angle) [½ (β − sin β) − ⅓ sin β sin²(β/2)] per sample
    rest = 0.5 * (beta - np.sin(beta)) - np.sin(beta) * np.sin(0.5 * beta) ** 2 / 3.0
    assert abs(error[0]) == pytest.approx(np.sin(angle) ** 2 * rest * (count - 1), rel=0.05)
    assert abs(error[0]) < uncorrected / 100.0
    B = body_rotation(PERFECT, dt, gyro, 1, count)
    assert np.abs(rotation_vector(coned(angle, frequency * dt) @ B @ work.attitude.T)).max() < 1e-12


@pytest.fixture(scope="module")
def motion():
    """Return noise-free samples of a unit on a rotating table, and the truth at their ends."""
    truth = BenchConfig(grade="mems", seed=11, azimuth_deg=40.0).truth()
    perfect = {"gyro_arw": 0.0, "accel_vrw": 0.0, "gyro_bias_instability": 0.0, "accel_bias_instability": 0.0}
    imu = replace(truth.imu, **perfect, gyro_lsb=1e-13, accel_lsb=1e-12)
    table = replace(truth.table, velocity_sigma=0.0)
    stream = SensorStream(imu, table, 0)
    outer, inner = (JointProfile.rest(a, -1.0).move(0.5, b, 0.6, 1.0) for a, b in ((0.2, 4.0), (-0.4, 2.8)))
    counts = stream.produce(2000, outer, inner).counts
    ends = np.arange(1, 2001) * 0.005
    states = np.stack([outer.states(ends), inner.states(ends)], axis=1)
    gyro, accel = counts[:, :3] * (1e-13 / 0.005), counts[:, 3:] * (1e-12 / 0.005)
    return truth, table, np.ascontiguousarray(gyro), np.ascontiguousarray(accel), states


def test_true_parameters_reproduce_the_true_motion(motion):
    truth, table, gyro, accel, states = motion
    earth, gravity = rotation_rate(table.latitude), normal_gravity(table.latitude, table.height)
    constants = compensation(truth.parameters)
    work = interval_work()
    work.attitude[:] = table_attitude(table, states[19, :, 0])[0]
    moved = increments(constants, 0.005, gyro, accel)
    turned, centre, way = [], [], []
    for k in range(20, 2000, 20):
        propagate(constants, earth, gravity, 0.005, moved, k, k + 20, work)
        last, true = table_attitude(table, states[[k - 1, k + 19], :, 0])
        way.append(np.linalg.norm(work.displacement - (true - last) @ constants.outer_lever))
        turned.append(np.linalg.norm(rotation_vector(work.attitude @ true.T)))
        omega = rotation_states(table, states[k + 19, 0][None], states[k + 19, 1][None])[0][0]
        arm = np.cross(omega - true.T @ earth, constants.outer_lever)
        centre.append(np.linalg.norm(work.velocity - true @ arm))
    assert np.linalg.norm(states[-1, :, 0] - states[0, :, 0]) > 4.0
    assert max(turned) < 2e-8
    assert max(centre) < 2e-6
    assert max(way) < 1e-7


START_VELOCITY = np.array([0.1, -0.2, 0.05])
# the parameters act on the force without the size effect, 0.002 g, and the angular acceleration of the arm, 0.01 g
INTERVALS = {
    "rest": ((40, 60), 5e-3),
    "speeding up": ((105, 125), 0.2),
    "turning": ((600, 620), 8e-3),
    "slowing down": ((1240, 1260), 0.2),
}


def difference(one, other):
    """Return errors φ and δv of the navigation solution `one` relative to the true `other`, shape (6,)."""
    return np.concatenate([rotation_vector(other.attitude @ one.attitude.T), other.velocity - one.velocity])


@pytest.mark.parametrize(("span", "accuracy"), INTERVALS.values(), ids=INTERVALS.keys())
def test_transition_blocks_are_the_derivatives_of_the_navigation(motion, span, accuracy):
    truth, table, gyro, accel, states = motion
    point = truth.parameters
    earth, gravity = rotation_rate(table.latitude), normal_gravity(table.latitude, table.height)
    attitude = table_attitude(table, states[span[0] - 1, :, 0])[0]

    def run(parameters, C=attitude, v=START_VELOCITY):
        return navigate(compensation(parameters), gyro, accel, 0.005, C, v, earth, gravity, span)

    F = run(point).transition.copy()
    numeric = np.zeros((6, 39))
    for i in range(6):
        small = np.zeros(6)
        small[i] = 1e-5
        plus, minus = (
            run(point, rotation_matrix(s * small[:3]) @ attitude, START_VELOCITY + s * small[3:]) for s in (1.0, -1.0)
        )
        numeric[:, i] = difference(minus, plus) / 2e-5
    for i, parameter in enumerate(PARAMETERS):
        step = np.zeros(COUNT)
        step[i] = parameter.prior_sigma * 1e-3
        # the error of a parameter is the true minus the assumed value
        numeric[:, 9 + i] = difference(run(point - step), run(point + step)) / (2.0 * step[i])
    columns = {"attitude": [0, 1, 2], "velocity": [3, 4, 5]}
    columns |= {group: [9 + i for i in group_indices(group)] for group in GROUPS}
    identity = np.eye(6, 39)
    for group, chosen in columns.items():
        for rows in (slice(0, 3), slice(3, 6)):
            change = numeric[rows][:, chosen] - identity[rows][:, chosen]
            result = F[rows][:, chosen] - identity[rows][:, chosen]
            assert np.linalg.norm(result - change) < accuracy * np.linalg.norm(change) + 1e-5, group


def test_position_rows_are_the_integral_of_the_velocity_rows(motion):
    _, table, gyro, accel, _ = motion
    earth, dt, start, stop = rotation_rate(table.latitude), 0.005, 600, 640
    whole = navigate(PERFECT, gyro, accel, dt, np.eye(3), earth=earth, span=(start, stop)).transition
    integral = np.zeros((3, 39))
    velocity_rows = np.zeros((3, 39))
    velocity_rows[:, 3:6] = np.eye(3)
    for k in range(start, stop):
        last = velocity_rows.copy()
        work = navigate(PERFECT, gyro, accel, dt, np.eye(3), earth=earth, span=(start, k + 1))
        velocity_rows = work.transition[3:6]
        integral += 0.5 * (last + velocity_rows) * dt
    columns = [*range(6), *range(9, 36)]
    size = np.abs(integral[:, columns]).max(axis=0)
    assert np.all(np.abs(whole[6:9, columns] - integral[:, columns]).max(axis=0) < 2e-3 * size + 1e-6)
    assert whole[6:9, 6:9] == pytest.approx(np.eye(3))


@pytest.mark.long
def test_instantaneous_rate_and_force_derivatives_agree_with_compensation(motion):
    truth, _, gyro, accel, _ = motion
    omega, force = compensate(compensation(truth.parameters), gyro[600:601], accel[600:601])
    constants = compensation(truth.parameters)
    sensed = force[0] - constants.inner_lever * (omega[0] @ omega[0] - omega[0] ** 2)
    rate_jacobian, force_jacobian = dynamics(constants, omega[0], sensed)
    for i, parameter in enumerate(PARAMETERS[:27]):
        step = np.zeros(COUNT)
        step[i] = parameter.prior_sigma * 1e-3
        high = compensate(compensation(truth.parameters + step), gyro[600:601], accel[600:601])
        low = compensate(compensation(truth.parameters - step), gyro[600:601], accel[600:601])
        for result, a, b in ((rate_jacobian, high[0], low[0]), (force_jacobian, high[1], low[1])):
            exact = (a - b)[0] / (2.0 * step[i])
            assert result[:, i] == pytest.approx(exact, abs=2e-4 * max(np.linalg.norm(exact), 1e-4)), parameter.name
