"""Multi-position recordings of low-grade units: coarse outputs, suppressed small rates, short rests."""

from dataclasses import replace

import numpy as np
import pytest
from hand_recordings import QUICK, context_of, prior_of, recording, solved, unit

from calstation.errors import InputError, InsufficientDataError
from calstation.estimation.common import SampleBlock, SolveContext
from calstation.physics import NAMES
from procedures.multi_position import ESTIMATED
from tests.helpers import raises_code

MASK = np.array([name in ESTIMATED for name in NAMES])


@pytest.fixture(scope="module")
def mems():
    imu = unit("mems", 3, output="rate")
    return imu, recording(imu, 3)


def rounded(
    block: SampleBlock, context: SolveContext, columns: slice, noise: float
) -> tuple[SampleBlock, SolveContext]:
    """Return the block with a step of the sensors in `columns` of their noise over `noise`, and its context."""
    counts, gyro = block.counts.copy(), columns.start == 0
    density = context.imu.gyro_arw if gyro else context.imu.accel_vrw
    lsb = density * context.imu.sample_rate**0.5 / noise
    old = context.imu.gyro_lsb if gyro else context.imu.accel_lsb
    counts[:, columns] = np.rint(counts[:, columns] * old / lsb)
    imu = replace(context.imu, gyro_lsb=lsb) if gyro else replace(context.imu, accel_lsb=lsb)
    return replace(block, counts=counts), replace(context, imu=imu)


@pytest.mark.parametrize("columns", [slice(0, 3), slice(3, 6)], ids=["gyros", "accelerometers"])
def test_coarse_unit_is_calibrated_with_its_rounding_error(mems, columns):
    imu, block = mems
    coarse, context = rounded(block, context_of(imu), columns, 0.08)
    fine = solved(block, context_of(imu), prior_of("mems"))
    solution = solved(coarse, context, prior_of("mems"))
    errors = (solution.posterior.mean - imu.parameters) / solution.posterior.sigma
    assert np.abs(errors[MASK]).max() < 4.0
    bias = NAMES.index("gyro_bias_x" if columns.start == 0 else "accel_bias_x")
    assert solution.posterior.sigma[bias] > 2.0 * fine.posterior.sigma[bias]


def test_coarse_channel_that_is_stuck_is_refused(mems):
    imu, block = mems
    coarse, context = rounded(block, context_of(imu), slice(3, 6), 0.08)
    coarse.counts[3000:9000, 4] = coarse.counts[3000, 4]
    with raises_code(InputError, "recording.frozen") as caught:
        solved(coarse, context, prior_of("mems"))
    assert "accel_y is frozen: one value from sample 30" in str(caught.value)


@pytest.mark.parametrize("channels", [[0, 1, 2], [0, 2], [1]])
@pytest.mark.parametrize("threshold", ["in_rests", "of_samples"])
def test_unit_that_suppresses_small_rates_is_named(mems, channels, threshold):
    imu, block = mems
    rests = solved(block, context_of(imu), prior_of("mems")).details["positions"]
    counts = block.counts.copy()
    if threshold == "in_rests":
        for rest in rests:
            counts[rest["first_seq"] : rest["last_seq"] + 1, channels] = 0.0
    else:
        small = np.abs(counts * imu.gyro_lsb) < np.deg2rad(1.0)
        counts[:, channels] = np.where(small[:, channels], 0.0, counts[:, channels])
    with raises_code(InputError, "recording.small_rates_suppressed") as caught:
        solved(replace(block, counts=counts), context_of(imu), prior_of("mems"))
    assert ", ".join(f"gyro_{'xyz'[c]}" for c in channels) in str(caught.value)


@pytest.mark.parametrize("has_gyros", [True, False])
def test_rests_that_are_too_short_are_counted(mems, has_gyros):
    imu, _ = mems
    for rest in (3.0, 2.3):
        block = recording(imu, 5, replace(QUICK, rest=rest))
        if not has_gyros:
            block.counts[:, :3] = np.nan
        solution = solved(block, context_of(imu), prior_of("mems"))
        short = [values for code, values in solution.messages if code == "short_rests_left_out"]
        assert len(solution.details["positions"]) + sum(v["count"] for v in short) == 38
        assert bool(short) == (rest < 3.0)
        assert all(v["needed"] == 1.6 for v in short)
    with raises_code(InsufficientDataError, "recording.rests_too_short") as caught:
        solved(block, context_of(imu), prior_of("mems"), shortest_rest_s=4.0)
    assert "a position needs a rest of 4.6 s" in str(caught.value)
