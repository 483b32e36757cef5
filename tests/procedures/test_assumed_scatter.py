"""A recording without redundancy does not measure its scatter: an assumed one counts, and nothing is determined."""

import numpy as np
import pytest
from hand_recordings import QUICK, block_of, context_of, prior_of, recording, solved, unit

from calstation.bench.truth import record
from calstation.judgement.limits import unobservable
from calstation.messages import event_text, sentence
from calstation.physics import GYRO_SCALE, INDEX

QUARTER = 0.5 * np.pi
#: Six faces with five turns.
FACES = [(0.0, QUARTER), (0.0, 2 * QUARTER), (0.0, 3 * QUARTER), (QUARTER, 3 * QUARTER), (-QUARTER, 3 * QUARTER)]


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
def test_six_faces_rest_on_the_assumed_scatter(seed: int) -> None:
    """The gyros measure 0.3 % more than the turns, as if a rotation were not rigid; nothing else reveals it."""
    imu, prior = unit("mems", seed), prior_of("mems")
    block = block_of(record(imu, QUICK, FACES, seed)[0])
    block.counts[:, :3] = np.rint(1.003 * block.counts[:, :3])
    solution = solved(block, context_of(imu), prior)
    undetermined = unobservable(prior, [solution])
    (values,) = [values for code, values in solution.messages if code == "scatter_assumed"]
    text = event_text("scatter_assumed", values)
    assert "the force at rests (1020 µg), the scatter of the angles of turns (0.3°)" in sentence(text)
    assert "测不出静止比力的散布（1020 µg）、转角的散布（0.3°）" in sentence(text, "zh_CN")
    for i, name in enumerate(("gyro_scale_x", "gyro_scale_y", "gyro_scale_z")):
        error = solution.posterior.mean[INDEX[name]] - imu.parameters[INDEX[name]]
        assert abs(error) < 4.5 * solution.posterior.sigma[INDEX[name]], i
        assert name in undetermined
    assert {"accel_scale_x", "accel_bias_z"} <= {*undetermined}


def test_many_positions_measure_their_scatter() -> None:
    imu, prior = unit("mems", 1), prior_of("mems")
    solution = solved(recording(imu, 1), context_of(imu), prior)
    assert (solution.assumed, unobservable(prior, [solution])) == ((), [])


def test_assumed_scatter_is_a_setting_of_the_schedule() -> None:
    imu, prior = unit("mems", 1), prior_of("mems", 20.0)
    block = block_of(record(imu, QUICK, FACES, 1)[0])
    wide, narrow = (
        solved(block, context_of(imu), prior, turn_scatter_deg=degrees).posterior.sigma[GYRO_SCALE].min()
        for degrees in (1.0, 0.1)
    )
    assert wide > 3.0 * narrow
