"""The smoothed reference trajectory consists of rotations and is close to the truth."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from simulated_stages import context_of
from table_truth import table_attitude

from calstation.bench import BenchConfig
from calstation.bench.truth import SensorStream
from calstation.bench.truth.kinematics import JointProfile
from calstation.estimation.common import SampleBlock, filter_noise, stage_data
from calstation.estimation.navigation.navigation_pass import smoothed_reference
from calstation.estimation.navigation.velocity_group import Setting
from calstation.physics import compensation, increments, interval_work, normal_gravity, rotation_rate

STRIDE = 20


@pytest.fixture(scope="module")
def motion():
    """Return three minutes of a MEMS unit that rests, rotates and rests: samples and true attitudes per stride."""
    truth = BenchConfig(grade="mems", seed=8, instability=False).truth()
    stream = SensorStream(truth.imu, truth.table, 8)
    outer = JointProfile.rest(0.3, -1.0).move(60.0, 3.4, 0.35, 0.5)
    inner = JointProfile.rest(-0.5, -1.0).move(60.0, 1.0, 0.35, 0.5)
    counts = stream.produce(36000, outer, inner).counts
    seq = np.arange(36000)
    unknown, ones = np.full((36000, 2), np.nan), np.ones(36000, dtype=bool)
    block = SampleBlock("excitation", seq, (seq + 1) / 200.0, counts, unknown, seq * 0, ones, unknown[:, 0])
    times = np.arange(0, 36001, STRIDE) / 200.0
    angles = np.column_stack([outer.states(times)[:, 0], inner.states(times)[:, 0]])
    return truth, stage_data([block], context_of(truth).imu), table_attitude(truth.table, angles)


def reference(truth, data, attitude, tilt_sigma=0.02):
    gravity = normal_gravity(truth.table.latitude, truth.table.height)
    constants, noise, work = compensation(truth.parameters), filter_noise(context_of(truth)), interval_work()
    earth = rotation_rate(truth.table.latitude)
    setting = Setting(earth, gravity, data.dt, STRIDE, noise.rate, noise.force, noise.velocity)
    motion = increments(constants, data.dt, data.gyro, data.accel)
    work.attitude[:] = attitude
    return smoothed_reference(constants, setting, noise.velocity, motion, (0, len(data)), tilt_sigma, work)


def test_reference_follows_the_effect_of_gyro_noise(motion):
    truth, data, attitudes = motion
    result = reference(truth, data, attitudes[0])
    errors = Rotation.from_matrix(result.attitude @ attitudes.transpose(0, 2, 1)).as_rotvec()
    walked = truth.imu.gyro_arw * np.sqrt(len(data) / 200.0)
    # the velocity, 1 mm/s every 0.1 s, keeps it level; the heading follows the random walk of the gyro noise
    assert np.sqrt(np.mean(errors[:, :2] ** 2)) < 0.3 * walked
    assert np.abs(errors[:, 2]).max() < 4.0 * walked


def test_reference_corrects_a_wrong_start_attitude_without_jumps(motion):
    truth, data, attitudes = motion
    tilted = Rotation.from_rotvec([0.01, -0.02, 0.0]).as_matrix() @ attitudes[0]
    result = reference(truth, data, tilted)
    right = reference(truth, data, attitudes[0])
    off = Rotation.from_matrix(result.attitude @ right.attitude.transpose(0, 2, 1)).as_rotvec()
    assert np.abs(off[:, :2]).max() < 1e-4


@pytest.mark.parametrize("tilt", [0.02, 0.3])
def test_reference_is_a_rotation_for_any_start_attitude(motion, tilt):
    truth, data, attitudes = motion
    tilted = Rotation.from_rotvec([tilt, -tilt, 0.0]).as_matrix() @ attitudes[0]
    result = reference(truth, data, tilted, tilt_sigma=0.2).attitude
    assert result @ result.transpose(0, 2, 1) == pytest.approx(np.tile(np.eye(3), (len(result), 1, 1)), abs=1e-9)
