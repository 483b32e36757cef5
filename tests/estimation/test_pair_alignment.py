"""Streams of IMUs on one body with separate clocks are time-aligned online, with consistent sigmas."""

import numpy as np
import pytest

from calstation.bench.truth import BodyMotion, BodyStream, Field, Mounting, draw_imu, draw_mounting
from calstation.estimation.common import ImuModel
from calstation.estimation.pairs import PairAligner
from calstation.estimation.pairs.alignment import LATE, ClockFilter, interpolate, measure

RATE = 200.0
DRIFTS = (1.0 + 20e-6, 1.0 - 35e-6)
POWER_ON = (0.0, 0.3713)
TICK = 0.05


class Pair:
    """Two simulated units on one body whose samples arrive with delay and jitter."""

    def __init__(self, seed: int, delays: tuple[float, float] = (0.004, 0.009)) -> None:
        random = np.random.default_rng(seed)
        imus = [draw_imu(grade, random, sample_rate=RATE) for grade in ("nav", "mems")]
        field = Field(np.array([0.0, 0.0, 9.8]), np.array([0.0, 6e-5, 4e-5]))
        motion = BodyMotion(4.0, 12.0, seed)
        mountings = Mounting(np.eye(3), np.zeros(3)), draw_mounting(random)
        seeds = np.random.SeedSequence(seed).spawn(2)
        self.streams = [
            BodyStream(imu, motion, mounting, field, own, begin, gain, np.empty((0, 2)))
            for imu, mounting, own, begin, gain in zip(imus, mountings, seeds, POWER_ON, DRIFTS, strict=True)
        ]
        models = [ImuModel("", RATE, i.output, i.gyro_lsb, i.accel_lsb, i.gyro_arw, i.accel_vrw) for i in imus]
        self.aligner = PairAligner(models[0], models[1:])
        self.now, self._delays, self._random = 0.0, delays, random
        self.silent = [False, False]
        self.restarts: list[int] = []
        self.blocks = []

    def run(self, seconds: float) -> list[int]:
        """Advance; return the secondaries that were aligned again."""
        aligned = []
        for _ in range(round(seconds / TICK)):
            self.now += TICK
            for k, stream in enumerate(self.streams):
                late = self._delays[k] + self._random.exponential(0.002)
                first = stream.produced
                count = int((self.now - POWER_ON[k] - late) * DRIFTS[k] * RATE) - first
                if count <= 0:
                    continue
                counts = stream.produce(count).counts
                if not self.silent[k]:
                    seq = np.arange(first, first + count)
                    self.aligner.feed(k, seq, counts, np.full(count, self.now))
            block, result = self.aligner.take(self.now)
            self.blocks.append(block)
            aligned += result
        return aligned

    def error(self) -> tuple[float, float]:
        """Return error and sigma of the clock offset at the newest row, s."""
        time = float(next(b for b in reversed(self.blocks) if len(b)).time[-1])
        now = time / DRIFTS[0]
        state = self.aligner.clocks[0].alignment(time)
        return state.offset - (time - (now - POWER_ON[1]) * DRIFTS[1]), state.sigma


def test_interpolation_is_exact_for_polynomials_and_keeps_gaps():
    index = np.arange(60.0)
    counts = np.column_stack([index**3, 2.0 * index])
    at = np.array([10.25, 20.5, 33.0])
    assert interpolate(counts, at) == pytest.approx(np.column_stack([at**3, 2.0 * at]), rel=1e-12)
    counts[30] = np.nan
    result = interpolate(counts, np.array([20.5, 28.5, 3.0, 57.0]))
    assert np.isnan(result).all(axis=1).tolist() == [False, True, True, True]


def test_clock_offset_is_measured_despite_bias_scale_factor_and_misalignment():
    dt, offset = 0.01, 3e-4
    t = np.arange(200) * dt

    def omega(time):
        return np.column_stack([np.sin(5.0 * time), np.cos(3.0 * time), 0.5 * np.sin(8.0 * time + 1.0)])

    C = np.array([[1.01, 0.02, -0.03], [-0.02, 0.98, 0.01], [0.03, 0.0, 1.02]])
    noise = 1e-5 * np.random.default_rng(1).standard_normal((len(t), 3))
    fix = measure(omega(t), omega(t + offset) @ C.T + [0.01, -0.02, 0.03] + noise, dt)
    assert fix is not None
    assert abs(fix.offset - offset) < 5.0 * fix.sigma + 0.01 * offset
    assert fix.sigma < 5e-6


def test_clock_filter_estimates_offset_and_drift_and_rejects_outliers():
    random, clock = np.random.default_rng(2), ClockFilter()
    clock.restart(0.0, 0.2)
    for time in np.arange(0.0, 400.0, 4.0):
        assert clock.update(time, 0.21 + 40e-6 * time + 2e-5 * random.standard_normal(), 2e-5)
    state = clock.alignment(400.0)
    assert abs(state.offset - 0.21 - 40e-6 * 400.0) < 4.0 * state.sigma
    assert abs(state.drift - 40e-6) < 2e-7
    assert not clock.update(404.0, 0.3, 2e-5)
    assert clock.alignment(404.0).measured


def test_inconsistent_measurements_keep_the_offset_and_enlarge_its_sigma():
    clock = ClockFilter()
    clock.restart(0.0, 0.2)
    for time in np.arange(0.0, 100.0, 4.0):
        clock.update(time, 0.21, 2e-6)
    before = clock.alignment(110.0)
    for time in (102.0, 104.0, 106.0):
        assert not clock.update(time, 0.21003, 2e-6)
    state = clock.alignment(110.0)
    assert not state.measured
    assert not clock.arrival
    assert state.offset == before.offset
    assert 2e-5 < state.sigma < 1e-4
    assert clock.update(108.0, 0.21003, 2e-6)
    assert clock.alignment(110.0).measured
    assert abs(clock.alignment(110.0).offset - 0.21003) < 5e-6


def test_clock_with_inconsistent_measurements_does_not_follow_arrival_times():
    pair = Pair(4)
    pair.run(16.0)
    clock = pair.aligner.clocks[0]
    time = float(next(b for b in reversed(pair.blocks) if len(b)).time[-1])
    for _ in range(3):
        clock.update(time, float(clock.offset(time)) + 3e-4, 1e-6)
    assert not clock.locked
    pair.run(0.2)
    assert abs(pair.error()[0]) < 1e-4


def test_streams_that_arrive_independently_are_aligned_to_microseconds():
    pair = Pair(1)
    assert pair.run(4.0) == []
    error, sigma = pair.error()
    assert abs(error) < 0.02 < sigma  # known from arrival times until the body moves
    assert pair.run(20.0) == [0]
    ratios = []
    for _ in range(8):
        pair.run(2.0)
        error, sigma = pair.error()
        ratios.append(error / sigma)
        assert abs(error) < 2e-5
    assert np.sqrt(np.mean(np.square(ratios))) < 2.5
    whole = np.concatenate([b.seq for b in pair.blocks])
    assert (np.diff(whole) == 1).all()
    others = np.concatenate([b.others for b in pair.blocks])
    assert np.isfinite(others[round(RATE) :]).all()


@pytest.mark.long
def test_rows_continue_while_the_primary_is_silent():
    pair = Pair(2)
    pair.run(12.0)
    pair.silent[0] = True
    count = len(pair.blocks)
    pair.run(5.0)
    pair.silent[0] = False
    rows = pair.blocks[count:]
    counts, others = (np.concatenate([getattr(b, name) for b in rows]) for name in ("counts", "others"))
    missing = np.isnan(counts).all(axis=1)
    assert np.count_nonzero(missing) > (5.0 - 2.0 * LATE) * RATE
    assert np.isfinite(others[missing]).all()
    assert not np.concatenate([b.valid for b in rows])[missing].any()
    pair.run(6.0)
    assert abs(pair.error()[0]) < 1e-4
    assert pair.aligner.clocks[0].locked


def test_restarted_unit_is_aligned_again():
    pair = Pair(3)
    pair.run(12.0)
    stream = pair.streams[1]
    # its counter begins again at 0
    counts = stream.produce(100).counts
    pair.now += 0.5
    pair.aligner.feed(1, np.arange(100), counts, np.full(100, pair.now), restarted=True)
    block, _ = pair.aligner.take(pair.now)
    assert len(block)
    state = pair.aligner.clocks[0].alignment(float(block.time[-1]))
    assert not state.measured
    assert state.sigma > 0.01
    assert abs(state.offset - POWER_ON[1]) < 0.05
