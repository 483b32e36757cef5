"""The simulator without protocols: timestamps, continuity between stages, grades."""

from dataclasses import fields
from itertools import count

import numpy as np
import pytest

from calstation.bench import BenchConfig
from calstation.bench.truth import GRADES, Simulator
from calstation.physics import COUNT, PARAMETERS, Dwell, Move, RoundEnd

RATE, ACCELERATION = np.deg2rad(30.0), np.deg2rad(60.0)


def unlimited_plan():
    for number in count(1):
        yield Move(0.0, np.pi, RATE, ACCELERATION)
        yield Dwell(1.0)
        yield Move(0.0, 0.0, RATE, ACCELERATION)
        yield Dwell(1.0)
        yield RoundEnd(number)


def test_time_counter_step_and_joint_angles_continue_across_stages():
    simulator = Simulator(BenchConfig(grade="nav", seed=1).truth(), 1)
    first = simulator.run([Dwell(2.0), Move(np.pi / 2, 0.0, RATE, ACCELERATION), Dwell(3.0)], "rate")
    second = simulator.run([Dwell(1.0), Move(0.0, 0.0, RATE, ACCELERATION)], "six_position")
    assert np.array_equal(first.step[:401], [0] * 400 + [1])
    seq = np.concatenate([first.seq, second.seq])
    assert np.array_equal(seq, np.arange(len(seq)))
    assert np.concatenate([first.time, second.time]) == pytest.approx((seq + 1) / 200.0, abs=1e-12)
    assert (second.step[0], second.step[-1]) == (1, 2)
    assert second.angles[9] == pytest.approx([np.pi / 2, 0.0], abs=np.deg2rad(0.25))


def test_angles_are_nan_between_polls():
    result = Simulator(BenchConfig().truth(), 1).run([Dwell(1.0)], "rate")
    polled = np.flatnonzero(np.isfinite(result.angles[:, 0]))
    assert np.array_equal(polled, np.arange(9, 200, 10))


def test_unlimited_plan_ends_after_the_requested_rounds():
    result = Simulator(BenchConfig(grade="mems", seed=1).truth(), 1).run(unlimited_plan(), "azimuth_flip", rounds=3)
    assert result.step[-1] == 6


def test_equal_seeds_give_equal_samples_and_other_seeds_differ():
    results = [Simulator(BenchConfig(grade="nav", seed=2).truth(), s).run([Dwell(1.0)], "rate") for s in (1, 1, 2)]
    for field in fields(results[0]):
        a, b = (getattr(r, field.name) for r in results[:2])
        assert a == b if isinstance(a, str) else np.array_equal(a, b, equal_nan=True)
    assert not np.array_equal(results[0].counts, results[2].counts)


@pytest.mark.parametrize("grade", list(GRADES))
def test_units_of_a_grade_have_its_standard_deviations(grade):
    drawn = np.array([BenchConfig(grade=grade, seed=seed).truth().parameters for seed in range(200)])
    assert drawn.shape == (200, COUNT)
    sigma = np.array([GRADES[grade].sigma[p.group] for p in PARAMETERS])
    assert drawn.std(axis=0) / sigma == pytest.approx(1.0, abs=0.25)


def test_fixed_lever_arm_is_zero_and_out_of_limits_bias_is_20_sigma():
    fixed = BenchConfig(grade="nav", seed=3, outer_lever="fixed").truth().parameters
    assert np.all(fixed[-3:] == 0.0)
    assert np.all(fixed[:27] == BenchConfig(grade="nav", seed=3).truth().parameters[:27])
    bad = BenchConfig(grade="nav", seed=3, out_of_limits=True).truth().parameters
    assert bad[0] == pytest.approx(20.0 * GRADES["nav"].sigma["gyro_bias"])


def test_mounting_angle_lies_within_its_range():
    mounts = [BenchConfig(seed=seed, mount_deg=(0.1, 0.3)).truth().table.mount for seed in range(50)]
    angles = np.rad2deg([np.linalg.norm(mount) for mount in mounts])
    assert min(angles) >= 0.1
    assert max(angles) <= 0.3
