"""Guidance reports the states still, moving, enough and repeat, in agreement with the solver."""

from dataclasses import replace

import numpy as np
import pytest
from hand_recordings import QUICK, context_of, prior_of, recording, solved, unit

from calstation.estimation.common import compensated_means
from calstation.estimation.positions import PositionGuide
from calstation.estimation.positions.guidance import spread


@pytest.fixture(scope="module")
def mems():
    imu = unit("mems", 3)
    return imu, recording(imu, 3)


def followed(block, imu, wanted=1.0, size=17):
    guide = PositionGuide(context_of(imu).imu, 5.0)
    states = []
    for k in range(0, len(block), size):
        now = guide.feed(block.part(k, min(k + size, len(block))))
        if not states or states[-1] != now.state:
            states.append(now.state)
        if len(now.positions) == 1:
            guide.set_required_rest(wanted)
    return guide, states


@pytest.mark.long
def test_every_rest_and_every_motion_is_reported(mems):
    imu, block = mems
    guide, states = followed(block, imu)
    result = solved(block, context_of(imu), prior_of("mems"))
    assert states[:4] == ["waiting", "still", "enough", "moving"]
    assert "repeat" not in states
    rests = result.details["positions"]
    assert len(guide.now.positions) == pytest.approx(len(rests), abs=1)
    ups = np.array([r["up"] for r in rests])[: len(guide.now.positions)]
    assert np.abs(guide.now.positions[: len(ups)] - ups).max() < 0.05


def test_too_short_rest_requests_a_repetition(mems):
    imu, block = mems
    guide, states = followed(block, imu, wanted=8.0)
    assert states.count("repeat") > 5
    assert len(guide.now.positions) == 1
    assert guide.now.required > 8.0


def test_guidance_does_not_depend_on_the_blocks(mems):
    imu, block = mems
    a, b = (followed(block, imu, size=size)[0].now for size in (7, 1000))
    assert np.array_equal(a.positions, b.positions)


def test_result_applied_to_data_gives_the_magnitude_of_gravity(mems):
    imu, block = mems
    result = solved(block, context_of(imu), prior_of("mems")).posterior.mean
    rate_before, force_before = compensated_means(block.part(0, 900), context_of(imu).imu, prior_of("mems").mean, 50)
    rate_after, force_after = compensated_means(block.part(0, 900), context_of(imu).imu, result, 50)
    assert len(rate_after) == len(force_after) == 18
    before, after = (np.linalg.norm(f, axis=1).mean() - QUICK.field.up_force[2] for f in (force_before, force_after))
    assert np.abs(after) < 0.2 * np.abs(before)
    assert np.abs(rate_after.mean(axis=0)).max() < 1e-4
    assert np.abs(rate_before.mean(axis=0)).max() > 5e-4


def test_shocks_and_gaps_do_not_count_as_positions(mems):
    imu, block = mems
    guide, _ = followed(block.part(0, 800), imu)
    (first,) = guide.now.positions
    knocked = block.part(800, 900)
    noisy = replace(knocked, counts=knocked.counts + np.r_[2e4, 0, 0, 0, 0, 0] * np.sin(np.arange(100.0))[:, None])
    guide.feed(noisy)
    assert guide.now.state == "moving"
    later = block.part(100, 800)
    guide.feed(replace(later, seq=later.seq + 5000))
    assert guide.now.state == "enough"
    assert len(guide.now.positions) == 1
    assert np.array_equal(guide.now.positions[0], first)


def test_positions_are_sufficient_if_well_distributed_and_rotated_about_all_axes(mems):
    imu, block = mems
    guide = PositionGuide(context_of(imu).imu, 1.0)
    begun = []
    for k in range(0, len(block), 500):
        now = guide.feed(block.part(k, min(k + 500, len(block))))
        if now.suffices:
            begun.append(len(now.positions))
    assert begun
    assert 15 < begun[0] < len(guide.now.positions)
    assert spread(guide.now.positions) > 0.15
    assert spread(np.eye(3)) == 0.0
    assert spread(guide.now.positions[:12] * [1, 0, 1]) < 1e-6
