"""Stop rules, previews and the assignment of polled angles to samples."""

import math
from dataclasses import replace

import numpy as np
import pytest

from calstation.devices.profiles import ChannelRange, StatusSection
from calstation.estimation.common import SampleBlock
from calstation.physics import COUNT, INDEX, Dwell, Move, RoundEnd, move_time, parameter_indices, targets_reached
from calstation.sequencer import LastSample, StopRule, plan_time, planned
from calstation.sequencer.acquisition import RESUME_GAP, Acquisition, SampleTags
from calstation.sequencer.plan import StageTracker
from tests.sequencer.fakes import MODEL, RATE, UNIT, FakeClock, FakeImu, FakeTable, endless


def test_move_time_matches_trapezoidal_and_triangular_profiles() -> None:
    assert move_time((0.0, 0.0), Move(10.0, 0.0, 1.0, 1.0)) == pytest.approx(11.0)
    assert move_time((0.0, 0.0), Move(0.25, 0.0, 1.0, 1.0)) == pytest.approx(1.0)
    assert move_time((0.0, 5.0), Move(0.25, 0.0, 1.0, 1.0)) == pytest.approx(6.0)


def test_duration_of_a_plan_includes_settling() -> None:
    steps = [Move(1.0, 0.0, 1.0, 1.0), Dwell(5.0)]
    assert plan_time(steps, StopRule(), (0.0, 0.0)) == pytest.approx(2.0 + 1.5 + 5.0)


@pytest.mark.parametrize(
    ("rule", "seconds"),
    [(StopRule(rounds=4), 4.0), (StopRule(duration=6.5), 7.0), (StopRule(targets={"gyro_bias": 1.0}), 1.0)],
)
def test_preview_of_an_unlimited_plan_ends_by_its_stop_rule(rule: StopRule, seconds: float) -> None:
    assert plan_time(endless(), rule, (0.0, 0.0)) == pytest.approx(seconds)
    last = [step for step, _ in planned(endless(), rule, (0.0, 0.0))][-1]
    assert isinstance(last, RoundEnd)


def test_planned_duration_uses_the_usual_rounds_but_all_steps_are_planned() -> None:
    rule = StopRule(rounds=5, targets={"gyro_bias": 1.0}, usual=2)
    assert plan_time(endless(), rule, (0.0, 0.0)) == pytest.approx(2.0)
    assert sum(isinstance(step, RoundEnd) for step, _ in planned(endless(), rule, (0.0, 0.0))) == 5


def test_progress_after_the_planned_duration_is_within_the_longest_one() -> None:
    track = StageTracker("designed", 10.0, 25.0)
    track.begin(0.0, 5.0)
    assert (track.event(5.0, "").fraction, track.event(5.0, "").remaining) == (0.5, 5.0)
    track.end({})
    track.next_round()
    assert track.event(5.0, "").remaining == 5.0
    track.begin(5.0, 5.0)
    track.end({})
    assert track.event(10.0, "").fraction == 1.0, "the targets may have been reached"
    track.next_round()
    assert (track.event(10.0, "").fraction, track.event(10.0, "").remaining) == (0.4, 15.0)


def test_targets_may_be_parameters_or_groups() -> None:
    assert parameter_indices("accel_scale_y") == [INDEX["accel_scale_y"]]
    assert len(parameter_indices("gyro_misalign")) == 6
    assert parameter_indices("nonsense") == []
    sigma = np.full(COUNT, 1.0)
    sigma[INDEX["gyro_bias_x"]] = 1e-6
    assert targets_reached(sigma, {"gyro_bias_x": 1e-5})
    assert not targets_reached(sigma, {"gyro_bias": 1e-5})


@pytest.mark.parametrize("latency", [0.0, 0.004, 0.03])
def test_polled_angles_are_assigned_to_the_sample_of_their_time(latency: float) -> None:
    clock = FakeClock()
    table = FakeTable(clock)
    imu = FakeImu(clock, table)
    blocks: list[SampleBlock] = []
    acquisition = Acquisition(imu, UNIT, clock, SampleTags(), blocks.append, latency=latency)
    table.move(2.0, -2.0, 0.5, 1.0)
    for _ in range(40):
        clock.sleep(0.05)
        late = clock.time - latency
        old = replace(
            table.status(),
            angles=np.array(table.angles_at(late)),
            rates=np.array([0.5, -0.5]) if late > 0.0 else np.zeros(2),
        )
        acquisition.poll(old, clock.time, clock.time)
        acquisition.drain()
    times = np.concatenate([b.time for b in blocks])
    angles = np.concatenate([b.angles for b in blocks])
    polled = ~np.isnan(angles[:, 0])
    assert 35 <= polled.sum() <= 40
    truth = np.array([table.angles_at(t) for t in times])
    assert np.abs(angles[polled] - truth[polled])[2:].max() < 1e-6


def test_slow_poll_gives_no_angle() -> None:
    clock = FakeClock()
    table = FakeTable(clock)
    blocks: list[SampleBlock] = []
    acquisition = Acquisition(FakeImu(clock, table), UNIT, clock, SampleTags(), blocks.append)
    clock.sleep(1.0)
    acquisition.poll(table.status(), clock.time - 0.5, clock.time)
    acquisition.drain()
    assert np.isnan(blocks[0].angles).all()


def test_status_bits_and_gaps_are_detected() -> None:
    clock = FakeClock()
    imu = FakeImu(clock, FakeTable(clock), ready_at=0.2)
    acquisition = Acquisition(
        imu, replace(UNIT, masks=StatusSection(ready=1, saturated=2, failed=4)), clock, SampleTags(), lambda block: None
    )
    assert acquisition.recent is None
    clock.sleep(0.1)
    assert not acquisition.drain().ready
    clock.sleep(0.2)
    imu.drop, imu.saturated = 3, True
    flow = acquisition.drain()
    assert (flow.ready, flow.saturated, flow.failed, flow.missing) == (True, True, False, 3)
    assert acquisition.gaps == 1
    assert acquisition.recent is not None
    mean, temperature = acquisition.recent
    assert mean[5] == pytest.approx(9.8, abs=1e-4)
    assert temperature == 25.0
    assert not any(b for b in [acquisition.drain().count])


def test_channel_at_its_range_limit_invalidates_the_sample_regardless_of_status() -> None:
    clock = FakeClock()
    imu = FakeImu(clock, FakeTable(clock))
    gravity = 9.8 / MODEL.accel_lsb
    blocks: list[SampleBlock] = []
    for high, saturated in ((gravity * 0.999, True), (gravity * 1.001, False)):
        span = ChannelRange(high=np.full(6, high))
        acquisition = Acquisition(imu, replace(UNIT, span=span), clock, SampleTags(), blocks.append)
        clock.sleep(0.1)
        assert acquisition.drain().saturated is saturated
        assert blocks[-1].valid.any() != saturated


def test_displayed_mean_ignores_non_numeric_samples() -> None:
    clock = FakeClock()
    imu = FakeImu(clock, FakeTable(clock))
    blocks: list[SampleBlock] = []
    acquisition = Acquisition(imu, UNIT, clock, SampleTags(), blocks.append)
    imu.nan = True
    clock.sleep(0.1)
    assert acquisition.drain().invalid
    assert not blocks[0].valid.any(), "the first sample is not a number, the others belong to an interrupted step"
    assert acquisition.recent is not None
    assert acquisition.recent[0][5] == pytest.approx(9.8, abs=1e-4)
    imu.nan = True
    clock.sleep(1.0 / RATE)
    assert acquisition.drain().count == 1
    assert np.isnan(acquisition.recent[0]).all()


@pytest.mark.parametrize("value", [math.inf, -math.inf, 1e30])
def test_impossible_values_become_nan_because_no_log_may_contain_them(
    value: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = FakeClock()
    imu = FakeImu(clock, FakeTable(clock))
    blocks: list[SampleBlock] = []
    acquisition = Acquisition(imu, UNIT, clock, SampleTags(), blocks.append)
    clock.sleep(0.1)
    batch = imu.read()
    batch.counts[0, 4] = batch.temperature[1] = value
    monkeypatch.setattr(imu, "read", lambda: batch)
    assert acquisition.drain().invalid
    assert np.isnan(blocks[0].counts[0, 4])
    assert np.isnan(blocks[0].temperature[1])
    assert not blocks[0].valid[0]


def test_increments_are_converted_to_rates() -> None:
    assert replace(MODEL, output="increment").count_size[0] == pytest.approx(MODEL.gyro_lsb * RATE)
    assert math.isclose(MODEL.count_size[5], MODEL.accel_lsb)


def test_sample_numbers_of_a_resumed_run_continue() -> None:
    clock = FakeClock()
    table = FakeTable(clock)
    blocks: list[SampleBlock] = []
    after = LastSample(seq=5000, time=123.456, step=7)
    acquisition = Acquisition(FakeImu(clock, table), UNIT, clock, SampleTags(), blocks.append, after=after)
    for _ in range(3):
        clock.sleep(0.5)
        acquisition.drain()
    seq, time = (np.concatenate([getattr(b, name) for b in blocks]) for name in ("seq", "time"))
    lost = round(RESUME_GAP * RATE)
    assert seq[0] == 5000 + lost + 1
    assert np.all(np.diff(seq) == 1)
    assert time[0] - 123.456 == pytest.approx(RESUME_GAP + 1.0 / RATE)
    assert np.allclose(np.diff(time), 1.0 / RATE)
    assert acquisition.gaps == 0
