"""Free motion of the bench: rates and accelerations are exact derivatives; at rest it agrees with the table."""

import numpy as np
import pytest

from calstation.bench.truth import (
    Field,
    ManualRig,
    ManualRigStream,
    Mounting,
    SensorStream,
    TableTruth,
    around,
    draw_imu,
    push,
    record,
    rotation,
)
from calstation.bench.truth.free_motion import Course, FreeMotion, Link, Pulse, tremor
from calstation.bench.truth.free_unit import ideal_increments
from calstation.bench.truth.kinematics import JointProfile

ZERO = np.zeros(3)


def attitude_of(motion: FreeMotion, time: float) -> np.ndarray:
    """Return C_b^n at one time, shape (3, 3)."""
    C = np.eye(3)
    for link in motion.links:
        angle = link.course.states(np.array([time]))[0, 0]
        C = C @ link.before @ rotation(np.asarray(link.axis) * angle)
    return C @ motion.mount


@pytest.fixture
def motion() -> FreeMotion:
    random = np.random.default_rng(4)
    axes = [(1.0, 0.0, 0.0), (0.0, 0.6, 0.8), (0.0, 1.0, 0.0)]
    links = tuple(
        Link(
            rotation(random.standard_normal(3)),
            axis,
            Course(
                (
                    Pulse(0.3 + k * 0.2, 1.5, 1.1 - 0.7 * k, tremor(random, 0.02)),
                    Pulse(2.0, 0.7, -0.4, tremor(random, 0.01)),
                ),
                0.3 * k,
            ),
        )
        for k, axis in enumerate(axes)
    )
    shake = tuple(Course((Pulse(0.5, 2.0, 0.1, tremor(random, 0.003)),)) for _ in range(3))
    return FreeMotion(links, rotation(np.array([0.1, 0.2, -0.3])), shake)


def test_pulse_derivatives_match_finite_differences(motion):
    pulse = motion.links[0].course.pulses[0]
    times, h = np.linspace(0.31, 1.79, 200), 1e-6
    states = pulse.states(times)
    for k in range(2):
        numeric = (pulse.states(times + h)[k] - pulse.states(times - h)[k]) / (2.0 * h)
        assert states[k + 1] == pytest.approx(numeric, abs=1e-5 * max(1.0, np.abs(states[k + 1]).max()))
    assert pulse.states(np.array([0.0, 9.0]))[0] == pytest.approx([0.0, 1.1])
    assert np.all(pulse.states(np.array([0.0, 9.0]))[1:] == 0.0)


def test_rate_and_acceleration_match_numerical_derivatives_of_the_attitude(motion):
    times, h = np.linspace(0.1, 3.0, 40), 1e-6
    _, rate, acceleration = motion.states(times, ZERO, ZERO)
    for time, omega in zip(times, rate, strict=True):
        spin = attitude_of(motion, time).T @ (attitude_of(motion, time + h) - attitude_of(motion, time - h)) / (2.0 * h)
        assert omega == pytest.approx([spin[2, 1], spin[0, 2], spin[1, 0]], abs=1e-6)
    later, earlier = (motion.states(times + s, ZERO, ZERO)[1] for s in (h, -h))
    assert acceleration == pytest.approx((later - earlier) / (2.0 * h), abs=1e-4)


def test_specific_force_is_gravity_and_shaking_in_the_body_frame(motion):
    up, h = np.array([0.0, 0.0, 9.8]), 1e-5
    times = np.linspace(0.6, 2.4, 20)
    force, rate, _ = motion.states(times, up, np.array([0.0, 5e-5, 4e-5]))
    for k, time in enumerate(times):
        here = np.array([time - h, time, time + h])
        places = np.array([course.states(here)[0] for course in motion.shake])
        shaken = places @ [1.0, -2.0, 1.0] / h**2
        assert attitude_of(motion, time) @ force[k] == pytest.approx(up + shaken, abs=1e-3)
    _, still, _ = motion.states(times, up, ZERO)
    for k, time in enumerate(times):
        assert attitude_of(motion, time) @ (rate[k] - still[k]) == pytest.approx([0.0, 5e-5, 4e-5], abs=1e-12)


def test_at_rest_free_motion_agrees_with_the_table():
    imu = draw_imu("tactical", np.random.default_rng(7), sample_rate=100.0, instability=False)
    table = TableTruth(latitude=0.6, height=100.0, mount=(0.3, -0.2, 0.5))
    quiet = draw_imu("tactical", np.random.default_rng(7), sample_rate=100.0, instability=False)
    stream = SensorStream(quiet, table, 1)
    outer, inner = JointProfile.rest(0.7, -1.0), JointProfile.rest(-1.1, -1.0)
    counts = stream.produce(4000, outer, inner).counts.mean(axis=0)
    held = FreeMotion(
        (
            Link(np.eye(3), (1.0, 0.0, 0.0), Course(offset=0.7)),
            Link(np.eye(3), (0.0, 0.0, 1.0), Course(offset=-1.1)),
        ),
        rotation(np.array(table.mount)),
    )
    increments = ideal_increments(
        imu,
        held,
        Mounting(np.eye(3), ZERO),
        Field(table.up_force_n, table.earth_rate_n),
        np.arange(11) / 100.0,
    )
    lsb = np.repeat([imu.gyro_lsb, imu.accel_lsb], 3)
    noise = np.repeat([imu.gyro_arw, imu.accel_vrw], 3) * 0.1 / lsb
    assert np.all(np.abs(increments[0] / lsb - counts) < 5.0 * noise / np.sqrt(4000) + 0.01)
    assert increments == pytest.approx(np.tile(increments[0], (10, 1)))


def test_simulated_operator_stops_near_the_position_and_holds_still():
    rig = ManualRig(rest=4.0)
    poses = around(np.deg2rad(45.0))
    motion, duration = push(rig, poses, np.random.default_rng(2))
    times = np.arange(0.0, duration, 0.05)
    _, rate, _ = motion.states(times, rig.field.up_force, ZERO)
    moving = np.linalg.norm(rate, axis=1) > 1e-9
    starts = np.flatnonzero(np.diff(moving.astype(int)) == 1)
    assert len(starts) == len(poses)
    assert 0.5 < np.mean(~moving) < 0.95
    inner = motion.links[2].course.states(times[~moving])[0]
    away = np.abs(inner - np.round(inner / np.deg2rad(45.0)) * np.deg2rad(45.0))
    assert np.deg2rad(0.5) < away.max() < np.deg2rad(15.0)


@pytest.mark.long
def test_equal_seeds_give_equal_recordings_and_other_seeds_differ():
    imu = draw_imu("mems", np.random.default_rng(1), sample_rate=50.0)
    rig = ManualRig(initial_rest=3.0, rest=2.0)
    poses = around(np.deg2rad(120.0))
    first, again, other = (record(imu, rig, poses, seed)[0].counts for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first[:100], other[:100])


def test_samples_do_not_depend_on_the_request_size():
    imu = draw_imu("mems", np.random.default_rng(3), sample_rate=100.0)
    rig = ManualRig()
    streams = [ManualRigStream(imu, rig, np.random.SeedSequence(5)) for _ in range(2)]
    for stream in streams:
        stream.carry((0.0, 1.0), 2.0, 0.5)
    whole = streams[0].produce(400).counts
    parts = [streams[1].produce(count).counts for count in (1, 9, 90, 300)]
    assert np.array_equal(whole, np.vstack(parts))


def test_simulated_operator_moves_the_unit_near_the_position_and_releases_it():
    imu = draw_imu("mems", np.random.default_rng(3), sample_rate=100.0)
    rig = ManualRig()
    stream = ManualRigStream(imu, rig, np.random.SeedSequence(5))
    per_count = imu.accel_lsb * 100.0
    for pose in ((0.0, 1.0), (0.0, 1.0), (1.5, 1.0), (0.0, 0.0)):
        stream.carry(pose, 5.0, stream.produced / 100.0)
        stream.produce(1500)  # a premature touch has ended by then
        up = stream.produce(200).counts[:, 3:].mean(axis=0) * per_count
        asked = (rotation(np.array([pose[0], 0.0, 0.0])) @ rotation(np.array([0.0, pose[1], 0.0])))[2]
        away = np.arccos(up @ asked / np.linalg.norm(up))
        assert away < np.deg2rad(20.0)
