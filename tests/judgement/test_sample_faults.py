"""Faults of the samples are named with time and channel, and sound samples raise no alarm."""

import sys
from pathlib import Path

import faulty_samples as faulty
import numpy as np
import pytest

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator
from calstation.estimation.common import stage_data
from calstation.judgement import data_faults, sample_faults
from calstation.judgement.data_tests import clipping_test
from calstation.judgement.sample_faults import sample_test
from calstation.judgement.table_motion import table_motion
from calstation.messages import sentence

sys.path.append(str(Path(__file__).parents[1] / "estimation"))
from simulated_stages import block_of, context_of, prior_of, simulate


@pytest.fixture(scope="module", params=["nav", "mems"])
def unit(request):
    """A rate stage on a quiet table: context, prior and samples."""
    truth = BenchConfig(grade=request.param, seed=8, sample_rate_hz=100.0, velocity_sigma=1e-5).truth()
    return context_of(truth), prior_of(truth), block_of(simulate(Simulator(truth, 8), truth, "rate"))


def fault(unit, block):
    """Return cause, channel, and time of the first and last sample, of the only fault."""
    context, prior, _ = unit
    ((found),) = data_faults(block, context, prior)
    assert sentence(found.text("rate"))
    return found.cause, found.values["channel"], found.values["first"], found.values["last"]


def turning(block, count=4):
    """Return samples in the middle of the turns about x, during which the force of the other axes changes."""
    rate = np.abs(block.counts[:, 0])
    at = np.flatnonzero(rate > 0.95 * rate.max())
    return [int(at[k * len(at) // (count + 1)]) for k in range(1, count + 1)]


@pytest.mark.parametrize("velocity", [1e-5, 1e-3])
@pytest.mark.parametrize("grade", ["nav", "tactical", "mems"])
@pytest.mark.parametrize("stage", ["rate", "six_position", "azimuth_flip"])
def test_sound_samples_raise_no_alarm(grade, stage, velocity):
    truth = BenchConfig(grade=grade, seed=3, sample_rate_hz=100.0, velocity_sigma=velocity).truth()
    block, context = block_of(simulate(Simulator(truth, 3), truth, stage)), context_of(truth)
    data = stage_data([block], context.imu)
    (test,) = sample_test(block, data, context, table_motion(data))
    assert test.passed, test


def test_repeated_samples_are_named(unit):
    block, at = unit[2], turning(unit[2])
    for change in (faulty.double, faulty.repeat):
        cause, _, first, last = fault(unit, change(block, at))
        assert cause in ("samples_repeated", "samples_doubled")
        assert first == pytest.approx(block.time[at[0]], abs=0.1)
        assert last == pytest.approx(block.time[at[-1]], abs=0.1)


def test_lost_samples_are_named(unit):
    cause, _, first, last = fault(unit, faulty.lose(unit[2], turning(unit[2])))
    assert cause == "samples_lost"
    assert first == pytest.approx(unit[2].time[turning(unit[2])[0]], abs=0.1)
    assert last == pytest.approx(unit[2].time[turning(unit[2])[-1]], abs=0.1)


@pytest.mark.parametrize("channel", [0, 2, 4])
def test_single_spikes_are_named(unit, channel):
    context, _, block = unit
    imu = context.imu
    noise = (imu.gyro_arw if channel < 3 else imu.accel_vrw) * imu.sample_rate**0.5 / imu.count_size[channel]
    at = [700, turning(block)[0]]
    found = fault(unit, faulty.spike(block, channel, at, 80.0 * noise + 10.0))
    name = ("gyro_" if channel < 3 else "accel_") + "xyz"[channel % 3]
    assert found == ("spikes", name, pytest.approx(block.time[at[0]]), pytest.approx(block.time[at[1]]))


def test_stuck_channel_is_named(unit):
    block, at = unit[2], turning(unit[2])[1]
    cause, channel, first, _ = fault(unit, faulty.stick(block, 4, at, 8))
    assert (cause, channel) == ("stuck", "accel_y")
    assert first == pytest.approx(block.time[at], abs=0.02)


def test_wraps_of_a_count_are_named(unit):
    context, _, block = unit
    if np.abs(block.counts[:, 0]).max() < 2**15:
        block = faulty.with_columns(block, faulty.offset(0, 2.0**15 - 5.0))
    cause, channel, _, _ = fault(unit, faulty.wrap(block, 0))
    assert (cause, channel) == ("count_wrapped", "gyro_x")
    assert context.imu.gyro_lsb > 0.0


def test_recording_of_joined_rests_has_no_wraps() -> None:
    """The forces of successive rests differ by the range of a counter by chance, but on all channels at once."""
    random = np.random.default_rng(1)
    counts = np.hstack([np.zeros((300, 3)), np.repeat(random.normal(0.0, 1e5, (3, 3)), 100, axis=0)])
    counts[100:, 3] = counts[0, 3] + 2.0**16 + 300.0
    counts += 100.0 * random.standard_normal(counts.shape)
    broken = np.zeros(300, dtype=np.bool_)
    noise = sample_faults._noise_of(counts, 50, np.ones(6))
    assert not list(sample_faults._wraps(counts, broken, noise))
    counts[100:, 4:] = counts[:200, 4:]
    counts[:, 4:] = 100.0 * random.standard_normal((300, 2))
    (wrapped,) = sample_faults._wraps(counts, broken, noise)
    assert wrapped.channel == 3


def test_suppressed_small_rates_are_named(unit):
    context, _, block = unit
    width = np.deg2rad(1.0) / context.imu.count_size[0]
    cause, channel, _, _ = fault(unit, faulty.dead_zone(block, 0, width))
    assert cause in ("dead_zone", "lock_in")
    assert channel == "gyro_x"


def test_stiction_is_named(unit):
    context, _, block = unit
    noise = context.imu.accel_vrw * 10.0 / context.imu.count_size[3]
    cause, channel, _, _ = fault(unit, faulty.stiction(block, 3, 8.0 * noise))
    assert (cause, channel) == ("stiction", "accel_x")


def test_clipped_rate_whose_remainder_is_carried_over_is_named(unit):
    context, _, block = unit
    plateau = np.median(np.abs(block.counts[turning(block), 0]))
    clipped = faulty.clip(block, 0, np.floor(plateau * 29.95 / 30.0))
    result = clipping_test(clipped.counts, clipped.time, context.imu)
    assert not result.passed
    assert result.diagnosis.values["channel"] == "gyro x"
