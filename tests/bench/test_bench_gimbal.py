"""Joint kinematics and stabilisation loop of the simulated three-axis gimbal."""

import numpy as np
import pytest

from calstation.bench.truth import GimbalBench, draw_imu
from calstation.bench.truth.gimbal import attitude, joint_rates
from calstation.physics import group_matrix

ORDER = np.array([2, 0, 1])
RATE = np.deg2rad(30.0)


def misaligned(seed: int):
    return draw_imu("tactical", np.random.default_rng(seed), sample_rate=100.0, instability=False)


def rates_of(imu, samples):
    return samples.counts[:, :3] * imu.gyro_lsb * imu.sample_rate


@pytest.mark.long
def test_joint_rates_give_the_requested_body_rate():
    joints, omega, h = np.array([0.4, -0.3, 1.2]), np.array([0.2, -0.5, 0.9]), 1e-6
    rates = joint_rates(ORDER, joints, omega)
    spin = (
        attitude(ORDER, joints).T
        @ (attitude(ORDER, joints + h * rates) - attitude(ORDER, joints - h * rates))
        / (2.0 * h)
    )
    assert omega == pytest.approx([spin[2, 1], spin[0, 2], spin[1, 0]], abs=1e-8)


@pytest.mark.long
def test_gyro_misalignment_appears_in_the_joint_angles_and_not_in_the_stabilised_rates():
    imu = misaligned(1)
    bench = GimbalBench(imu, 1, encoder_sigma=0.0)
    bench.zero_bias(bench.lock(5.0))
    samples = bench.turn(2, np.deg2rad(30.0), RATE, np.zeros((3, 3)))
    shown = rates_of(imu, samples) - bench.bias
    assert np.abs(shown[:, :2].mean(axis=0)).max() < 1e-4
    M = group_matrix(imu.parameters, "gyro_misalign")
    A = np.deg2rad(30.0)
    J = np.array([[np.sin(A), 1.0 - np.cos(A)], [-(1.0 - np.cos(A)), np.sin(A)]])
    assert bench.joints[:2] == pytest.approx(-J @ M[:2, 2], abs=4e-5)
    assert bench.joints[2] == pytest.approx(A, abs=1e-3)


def test_other_joints_stay_still_with_the_true_correction():
    imu = misaligned(2)
    bench = GimbalBench(imu, 2, encoder_sigma=0.0)
    bench.zero_bias(bench.lock(5.0))
    full = group_matrix(imu.parameters, "gyro_scale", "gyro_misalign")
    K = (full - np.diag(np.diag(full))) / (1.0 + np.diag(full))
    bench.turn(0, np.deg2rad(30.0), RATE, K)
    assert np.abs(bench.joints[1:]).max() < 3e-5


def test_gyros_measure_the_commanded_motion_of_locked_joints():
    imu = misaligned(3)
    bench = GimbalBench(imu, 3)
    rest = rates_of(imu, bench.lock(5.0)).mean(axis=0)
    bench.turn(1, np.deg2rad(20.0), RATE, np.zeros((3, 3)))
    way = bench.joints.copy()
    home = bench.home(RATE)
    assert np.abs(bench.joints).max() == 0.0
    seen = ((rates_of(imu, home) - rest).sum(axis=0) * bench.interval)[1]
    assert seen == pytest.approx(-way[1], rel=5e-3)


def test_equal_seeds_give_equal_samples():
    imu = misaligned(4)
    first, again, other = (GimbalBench(imu, seed).lock(1.0).counts for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
