"""The samples of a stage: scaling, segments and rests."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.estimation.common import (
    ImuModel,
    SampleBlock,
    blocks_from,
    find_rests,
    mean_angles,
    slope_weights,
    snap_angles,
    stage_data,
)
from calstation.estimation.common.stage import _median

RATE_IMU = ImuModel("S", 100.0, "rate", 1e-9, 1e-9, 1e-9, 1e-9)
NO_BIAS = np.zeros(3)


def block(count, first=0, gyro=None, time_shift=0.0, spoilt=(), angles=None, stage="rate"):
    """Return samples at 100 Hz; gyro in rad/s."""
    seq = np.arange(first, first + count)
    counts = np.zeros((count, 6))
    if gyro is not None:
        counts[:, :3] = np.round(gyro / RATE_IMU.gyro_lsb)
    valid = np.ones(count, dtype=bool)
    valid[list(spoilt)] = False
    nowhere = np.full((count, 2), np.nan)
    return SampleBlock(
        stage,
        seq,
        (seq + 1) / 100.0 + time_shift,
        counts,
        nowhere if angles is None else angles,
        np.zeros(count, dtype=np.int64),
        valid,
        np.full(count, np.nan),
    )


def test_counts_of_both_output_types_become_mean_rates():
    counts = np.arange(12.0).reshape(2, 6)
    samples = block(2)
    samples = SampleBlock("rate", samples.seq, samples.time, counts, *[getattr(samples, n) for n in (
        "angles", "step", "valid", "temperature")])  # fmt: skip
    rate = stage_data([samples], ImuModel("S", 100.0, "rate", 2.0, 3.0, 1.0, 1.0))
    increment = stage_data([samples], ImuModel("S", 100.0, "increment", 2.0, 3.0, 1.0, 1.0))
    assert rate.gyro == pytest.approx(counts[:, :3] * 2.0)
    assert rate.accel == pytest.approx(counts[:, 3:] * 3.0)
    assert increment.gyro == pytest.approx(counts[:, :3] * 200.0)
    assert increment.accel == pytest.approx(counts[:, 3:] * 300.0)


def test_consecutive_blocks_form_one_segment():
    data = stage_data([block(30), block(1, first=30), block(20, first=31)], RATE_IMU)
    assert data.segments == ((0, 51),)
    assert data.gaps == 0


def test_missing_sample_splits_the_stage():
    data = stage_data([block(30), block(20, first=31)], RATE_IMU)
    assert data.segments == ((0, 30), (30, 50))
    assert data.gaps == 1


def test_jump_in_time_splits_the_stage_without_a_counter_gap():
    data = stage_data([block(30), block(20, first=30, time_shift=0.4)], RATE_IMU)
    assert data.segments == ((0, 30), (30, 50))
    assert data.gaps == 1


def test_invalid_samples_are_excluded_and_split_the_stage():
    data = stage_data([block(50, spoilt=range(20, 25))], RATE_IMU)
    assert data.segments == ((0, 20), (20, 45))
    assert data.gaps == 1
    assert data.seq[20] == 25


def test_every_gap_is_counted_and_an_empty_stage_has_no_data():
    data = stage_data([block(10), block(10, first=12), block(10, first=40, spoilt=[5])], RATE_IMU)
    assert data.segments == ((0, 10), (10, 20), (20, 25), (25, 29))
    assert data.gaps == 3
    empty = stage_data([], RATE_IMU)
    assert (len(empty), empty.segments, empty.gaps) == (0, (), 0)


def moving(count, *turns):
    """Return the gyro x signal at rest except for rotations at 20 °/s from sample a to b."""
    gyro = np.zeros((count, 3))
    for a, b in turns:
        gyro[a:b, 0] = np.deg2rad(20.0)
    return gyro


def assert_rests(rests, true, shortest=100):
    """Assert that every rest is found without motion and with at most `shortest` samples missing."""
    assert len(rests) == len(true)
    for (a, b), (c, d) in zip(rests, true, strict=True):
        assert c <= a <= c + shortest
        assert d - shortest <= b <= d


def test_rests_lie_between_the_rotations():
    data = stage_data([block(1200, gyro=moving(1200, (300, 500), (800, 900)))], RATE_IMU)
    assert_rests(find_rests(data, RATE_IMU, (NO_BIAS, 0.0), [(0, 1200)]), [(0, 300), (500, 800), (900, 1200)])


def test_rest_extends_to_the_end_of_its_segment():
    data = stage_data([block(1200, gyro=moving(1200, (300, 500)))], RATE_IMU)
    rests = find_rests(data, RATE_IMU, (NO_BIAS, 0.0), [(0, 1200)])
    assert (rests[0][0], rests[-1][1]) == (0, 1200)


def test_rests_do_not_extend_across_segments():
    data = stage_data([block(1200, gyro=moving(1200, (300, 500)))], RATE_IMU)
    assert_rests(find_rests(data, RATE_IMU, (NO_BIAS, 0.0), [(100, 400)]), [(100, 300)])
    assert find_rests(data, RATE_IMU, (NO_BIAS, 0.0), [(310, 490)]) == []
    assert find_rests(data, RATE_IMU, (NO_BIAS, 0.0), [(0, 20)]) == []


def test_only_an_unexpectedly_large_bias_hides_rests():
    bias = np.deg2rad(0.8)
    data = stage_data([block(1200, gyro=moving(1200, (300, 500)) + bias)], RATE_IMU)
    true = [(0, 300), (500, 1200)]
    assert_rests(find_rests(data, RATE_IMU, (NO_BIAS, bias), [(0, 1200)]), true)
    assert_rests(find_rests(data, RATE_IMU, (np.full(3, bias), 0.0), [(0, 1200)]), true)
    assert find_rests(data, RATE_IMU, (NO_BIAS, 0.0), [(0, 1200)]) == []


def test_slowly_moving_table_is_not_at_rest():
    gyro = moving(2000, (300, 500))
    gyro[500:900, 0] = np.deg2rad(0.08)
    data = stage_data([block(2000, gyro=gyro)], RATE_IMU)
    assert_rests(find_rests(data, RATE_IMU, (NO_BIAS, 0.0), [(0, 2000)]), [(0, 300), (900, 2000)])


def test_noise_does_not_break_a_rest():
    noisy = ImuModel("S", 100.0, "rate", 1e-9, 1e-9, 1e-4, 1e-3)
    gyro = moving(3000, (1000, 1200)) + np.random.default_rng(1).normal(0.0, 1e-4 * 10.0, (3000, 3))
    data = stage_data([block(3000, gyro=gyro)], RATE_IMU)
    assert_rests(find_rests(data, noisy, (NO_BIAS, 0.0), [(0, 3000)]), [(0, 1000), (1200, 3000)])


@given(st.integers(2, 400), st.integers(1, 30), st.integers(0, 29))
def test_slope_weights_give_the_slope_of_the_mean_velocity(blocks, stride, rest):
    count = blocks * stride + rest % stride
    weights = slope_weights(count, stride)
    assert weights.sum() == pytest.approx(1.0)
    assert np.all(weights >= 0.0)
    assert not weights[blocks * stride :].any()
    force = np.random.default_rng(blocks).standard_normal(count)
    velocity = np.concatenate([[0.0], np.cumsum(force)])[: blocks * stride].reshape(blocks, stride).mean(axis=1)
    slope = np.polyfit(np.arange(blocks) * stride, velocity, 1)[0]
    assert weights @ force == pytest.approx(slope, rel=1e-6, abs=1e-9)


def test_slope_weights_have_the_variance_of_the_least_squares_slope():
    count, dt, sigma = 1000, 0.01, 1e-3
    weights = slope_weights(count, 1)
    # velocity noise white at the samples' borders: acceleration noise is its difference over dt
    on_velocity = np.diff(np.concatenate([[0.0], weights, [0.0]])) / dt
    assert sigma**2 * np.sum(on_velocity**2) == pytest.approx(12.0 * sigma**2 / (count * (count * dt) ** 2), rel=5e-3)
    # white acceleration noise: 6/5 of the plain mean's
    assert np.sum(weights**2) * count == pytest.approx(1.2, rel=1e-3)


def test_mean_angles_use_only_polled_samples():
    angles = np.full((100, 2), np.nan)
    angles[10::20] = [[1.0, 2.0], [1.2, 2.0], [1.4, 2.0], [1.0, 2.0], [1.4, 2.0]]
    data = stage_data([block(100, angles=angles)], RATE_IMU)
    assert mean_angles(data, 0, 100) == pytest.approx([1.2, 2.0])
    assert mean_angles(data, 11, 30) is None


@given(st.floats(-1e3, 1e3))
def test_snapped_angles_survive_a_file_in_degrees(angle):
    snapped = snap_angles(np.array([angle]))
    assert abs(snapped[0] - angle) <= 2.0**-41
    assert snap_angles(np.deg2rad(float(repr(float(np.rad2deg(snapped[0])))))) == snapped[0]


@pytest.mark.parametrize(("seq", "left"), [(0, 50), (7, 43), (30, 20), (45, 5), (50, 0)])
def test_since_returns_unconsumed_blocks(seq, left):
    kept = blocks_from([block(30), block(20, first=30)], seq)
    assert sum(len(b) for b in kept) == left
    assert left == 0 or kept[0].seq[0] == seq


@pytest.mark.parametrize("count", [1, 2, 9, 10])
def test_median_agrees_with_numpy(count):
    values = np.random.default_rng(count).normal(size=count)
    assert _median(values) == np.median(values)
