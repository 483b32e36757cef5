"""Residuals at rests are noise with the true parameters; a wrong parameter appears at the affected rests."""

import numpy as np
import pytest
from simulated_stages import block_of, context_of, prior_of, simulate

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator
from calstation.estimation.common import Posterior, rest_residuals, stage_data
from calstation.physics import INDEX


@pytest.fixture(scope="module")
def six():
    """Six positions of a navigation-grade unit with context and prior."""
    truth = BenchConfig(grade="nav", seed=3, sample_rate_hz=100.0, instability=False).truth()
    context = context_of(truth)
    block = block_of(simulate(Simulator(truth, 3), truth, "six_position", dwell_s=20.0))
    return (
        truth,
        context,
        stage_data([block], context.imu),
        Posterior(truth.parameters, 1e-6 * prior_of(truth).covariance),
    )


def test_residuals_with_true_parameters_are_noise(six):
    _, context, data, answer = six
    left = rest_residuals(data, context, answer)
    assert len(left) == 11
    assert np.abs(left.force / left.force_sigma).max() < 4.0
    assert np.abs(left.vertical_rate / left.rate_sigma).max() < 5.0
    assert np.abs(left.horizontal_rate / left.rate_sigma).max() < 5.0
    faces = [int(np.argmax(np.abs(up))) for up in left.up[:6]]
    assert faces == [2, 2, 1, 1, 0, 0]
    assert np.all(np.diff(left.first_seq) > 0)
    assert np.all(left.last_seq > left.first_seq)
    assert np.isfinite(left.angles).all()


def test_wrong_bias_appears_at_the_affected_positions(six):
    truth, context, data, answer = six
    wrong = truth.parameters.copy()
    wrong[INDEX["accel_bias_y"]] += 1e-3
    wrong[INDEX["gyro_bias_y"]] += 1e-6
    right = rest_residuals(data, context, answer)
    left = rest_residuals(data, context, Posterior(wrong, answer.covariance))
    assert (left.force - right.force)[2:4] == pytest.approx([-1e-3, 1e-3], rel=1e-2)
    assert np.abs((left.force - right.force)[[0, 1, 4, 5]]).max() < 5e-5
    assert (left.vertical_rate - right.vertical_rate)[2:4] == pytest.approx([-1e-6, 1e-6], rel=1e-2)


def test_recording_without_rest_has_no_residuals(six):
    _, context, _, answer = six
    assert len(rest_residuals(stage_data([], context.imu), context, answer)) == 0
