"""Checks of recorded samples: clipping, sample clock and temperature, in good and faulty recordings."""

from dataclasses import replace

import numpy as np
import pytest

from calstation.bench.chamber import ChamberMachine, ChamberSettings
from calstation.bench.truth import GRADES, GRID, ThermalSettings, UnitThermal
from calstation.estimation import Diagnosis, ModelTest
from calstation.estimation.common import ImuModel, Posterior, RestResiduals, SampleBlock
from calstation.judgement import Check, DataTests
from calstation.judgement.data_tests import (
    MISSING_SAMPLES,
    _missing_samples,
    clipping_test,
    sample_clocks,
    temperature_coefficients,
)
from calstation.messages import Language, Text, sentence
from calstation.records import context_from_meta
from tests.thermal_results import thermal_meta

RATE = 200.0
PEAK = np.deg2rad(20.0)
#: Noise and count of the three grades, as increments.
IMUS = {
    "nav": ImuModel("S", RATE, "increment", 4.848e-8, 1e-6, 2.9e-7, 4.9e-5),
    "tactical": ImuModel("S", RATE, "increment", 2e-7, 4e-6, 5.8e-6, 2e-4),
    "mems": ImuModel("S", RATE, "increment", 1e-6, 2e-5, 4.4e-5, 6e-4),
}


def turns(imu, seed, *, level=PEAK, scale=0.0, noise=1.0):
    """Return counts of rests and rotations about z at exactly the peak rate, rounded with carried remainder."""
    random = np.random.default_rng(seed)
    ramp = np.linspace(0.0, 1.0, 200)
    motion = np.concatenate([np.zeros(2000), ramp, np.ones(700), ramp[::-1]])
    speed = PEAK * (1.0 + scale) * np.concatenate([motion, -motion, motion, np.zeros(2000)])
    angle = np.cumsum(speed) / RATE
    true = np.column_stack(
        [3e-5 + 0 * speed, 2e-5 + 0 * speed, 1e-5 + speed, 9.8 * np.cos(angle), 9.8 * np.sin(angle), 0.1 + 0 * angle]
    )
    white = noise * np.repeat([imu.gyro_arw, imu.accel_vrw], 3) * RATE**0.5
    output = true + white * random.standard_normal(true.shape)
    size = imu.count_size
    if imu.output == "rate":
        counts = np.rint(output / size)
    else:
        counts = np.diff(np.rint(np.cumsum(np.vstack([random.random(6), output / size]), axis=0)), axis=0)
    highest = np.floor(level / size[2])
    counts[:, 2] = np.clip(counts[:, 2], -highest, highest)
    return counts, np.arange(1, len(counts) + 1) / RATE


@pytest.mark.parametrize("noise", [1.0, 0.1])
@pytest.mark.parametrize("output", ["increment", "rate"])
@pytest.mark.parametrize("grade", IMUS)
def test_rotations_at_exactly_the_peak_rate_are_not_reported_as_clipped(grade, output, noise):
    imu = IMUS[grade]
    if output == "rate":
        imu = replace(imu, output="rate", gyro_lsb=imu.gyro_lsb * RATE, accel_lsb=imu.accel_lsb * RATE)
    for seed in range(4):
        # a unit may also be quieter than its profile
        test_result = clipping_test(*turns(imu, seed, level=np.inf, noise=noise), imu)
        assert test_result.value < 0.5 * MISSING_SAMPLES, test_result


@pytest.mark.parametrize("level", [0.9, 0.99, 1.0])
@pytest.mark.parametrize("grade", IMUS)
def test_gyro_that_clips_near_the_peak_rate_is_detected(grade, level):
    imu = IMUS[grade]
    counts, time = turns(imu, 1, level=level * PEAK, scale=2e-5)
    test_result = clipping_test(counts, time, imu)
    assert test_result.value > MISSING_SAMPLES
    values = test_result.diagnosis.values
    assert values["channel"] == "gyro z"
    assert abs(values["level"]) == pytest.approx(20.0 * level, rel=1e-3)
    assert values["count"] == np.sum(counts[:, 2] == np.rint(test_result.diagnosis.size / imu.count_size[2]))
    assert 10.0 < values["first"] < values["last"] < time[-1]


def test_clipping_check_uses_the_resolution_of_the_output():
    imu = ImuModel("S", RATE, "rate", 1.0, 1.0, 4.4e-5, 6e-4, gyro_quantisation=0.0, accel_quantisation=0.0)
    sound, time = turns(replace(imu, gyro_lsb=1e-9, accel_lsb=1e-9), 3, level=np.inf)
    for decimals in (2, 3, 4, 9):
        assert clipping_test(np.round(sound * 1e-9, decimals), time, imu).value < MISSING_SAMPLES
    clipped = sound * 1e-9
    clipped[:, 2] = np.clip(clipped[:, 2], -PEAK, PEAK)
    assert clipping_test(clipped, time, imu).diagnosis.values["channel"] == "gyro z"
    assert clipping_test(clipped, time, imu).value > MISSING_SAMPLES


def block(time, station=None, rate=100.0, seq=None):
    n = len(time)
    station = np.empty((n, 0)) if station is None else station[:, None]
    seq = np.arange(n) if seq is None else seq
    nan = np.full(n, np.nan)
    counts, angles = np.zeros((n, 6)), np.full((n, 2), np.nan)
    return SampleBlock("rate", seq, time, counts, angles, np.zeros(n, int), np.ones(n, bool), nan, station=station)


def test_clock_error_of_800_ppm_is_measured_with_its_sigma():
    random = np.random.default_rng(1)
    errors = []
    for seconds in (60, 300, 900):
        n = seconds * 100
        nominal = np.arange(n) / 100.0
        read = np.full(n, np.nan)
        read[39::40] = (nominal * (1.0 - 8e-4))[39::40] + random.uniform(0.0, 0.01, n // 40) + 5e4
        clocks = sample_clocks(block(nominal, read), 100.0)
        assert list(clocks) == ["station"]  # times that follow from the counter show nothing
        errors.append((clocks["station"].offset - (1.0 / (1.0 - 8e-4) - 1.0)) / clocks["station"].sigma)
        assert clocks["station"].jitter == pytest.approx(0.01 / 12**0.5, rel=0.2)
    assert np.max(np.abs(errors)) < 3.0
    assert clocks["station"].sigma < 5e-6


def test_grouped_arrival_times_are_jitter_and_not_a_clock_error():
    nominal = np.arange(30_000) / 100.0
    arrival = np.ceil(nominal / 0.08) * 0.08 + 1e-5 * np.arange(30_000) % 1e-3
    clock = sample_clocks(block(arrival), 100.0)["time_s"]
    assert abs(clock.offset) < 3.0 * clock.sigma < 1e-3
    assert clock.jitter == pytest.approx(0.08 / 12**0.5, rel=0.1)


def test_gaps_and_short_recordings_give_no_clock_error():
    nominal = np.arange(20_000) / 100.0
    seq = np.arange(20_000)
    seq[8000:] += 500
    late = np.where(seq > 8000, 3.0, 0.0) + 1e-4 * np.random.default_rng(2).standard_normal(20_000)
    clock = sample_clocks(block(seq / 100.0 + late, seq=seq), 100.0)["time_s"]
    assert abs(clock.offset) < 5.0 * clock.sigma < 1e-5
    assert sample_clocks(block(nominal[:1000] * 1.1), 100.0) == {}


def test_clock_that_changes_with_temperature_is_compared_at_the_reference():
    seq, random = np.arange(120_000), np.random.default_rng(3)
    nominal = seq / 10.0
    temperature = 22.5 - 62.5 * np.sin(nominal / 1200.0)
    offset = 5e-6 - 0.035e-6 * (temperature - 25.0) ** 2  # a quartz of a tuning fork
    read = np.cumsum(0.1 / (1.0 + offset)) + random.uniform(0.0, 0.005, len(seq))
    samples = replace(block(nominal, read), seq=seq, temperature=temperature)
    assert sample_clocks(samples, 10.0)["station"].offset < -50e-6
    clock = sample_clocks(samples, 10.0, 25.0)["station"]
    assert clock.offset == pytest.approx(5e-6, abs=4.0 * clock.sigma)
    assert clock.sigma < 1e-6


@pytest.mark.parametrize(("drift", "fails"), [(0.0, False), (3e-8, True)])
def test_a_clock_that_follows_the_temperature_is_good_and_one_that_drifts_is_not(drift: float, fails: bool) -> None:
    """The unit and the chamber are those of the bench; the drift is 300 ppm in the three hours of the run."""
    machine = ChamberMachine(ChamberSettings())
    thermal = UnitThermal(ThermalSettings(clock_ppm=60.0), GRADES["mems"].sigma, 23.0, np.random.default_rng(1))
    machine.start()
    rows = []
    for step in range(round(10_800.0 / GRID)):
        now = step * GRID
        machine.set_point = (25.0, -42.0, 0.0, 45.0, 82.0, 20.0)[int(now // 1800.0)]
        machine.advance(now)
        thermal.step(machine.truth.air, np.array([0.0, 0.0, 1.0]))
        rows.append((now, now - thermal.clock_delay - 0.5 * drift * now**2, thermal.sensor_output(now)))
    station, device, warmth = np.array(rows).T
    seq = np.arange(int(device[-1] * 10.0))
    nominal = seq / 10.0
    read = np.interp(nominal, device, station) + np.random.default_rng(2).uniform(0.0, 0.005, len(seq))
    samples = replace(block(nominal, read), seq=seq, temperature=np.interp(nominal, device, warmth))
    meta = thermal_meta()
    tests = DataTests(meta, context_from_meta(meta), Posterior(np.zeros(30), np.eye(30)))
    (test,) = tests._clock(sample_clocks(samples, 10.0, 25.0))
    assert test.passed != fails
    assert abs(sample_clocks(samples, 10.0)["station"].offset) > 20e-6


def test_temperature_coefficients_are_estimated_from_the_rests():
    random = np.random.default_rng(5)
    k = 40
    up = random.standard_normal((k, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    warmth = 25.0 + 5.0 * random.random(k)
    bias, scale, drift = np.array([1e-4, -2e-4, 3e-4]), np.array([1e-5, 2e-5, -1e-5]), np.array([1e-7, 2e-7, -3e-7])
    force = (up @ bias + 9.8 * up**2 @ scale) * (warmth - 25.0) + 1e-5 * random.standard_normal(k)
    vertical = up @ drift * (warmth - 25.0) + 1e-8 * random.standard_normal(k)
    seq = np.arange(k * 100)
    sigma = np.full(k, 1e-5), np.full(k, 1e-8)
    rests = RestResiduals(seq[::100], seq[99::100], up, up[:, :2], force, vertical, vertical, *sigma)
    samples = replace(block(seq / 100.0), temperature=np.repeat(warmth, 100))
    test_result = temperature_coefficients(rests, samples, 9.8)["per_degree"]
    expected = dict(zip(("x", "y", "z"), zip(bias, scale, drift, strict=True), strict=True))
    for axis, values in expected.items():
        for name, value in zip(("accel_bias", "accel_scale", "gyro_bias"), values, strict=True):
            row = test_result[f"{name}_{axis}"]
            assert row["value"] == pytest.approx(value, abs=4.0 * row["sigma"])
            assert row["sigma"] < abs(value)


@pytest.mark.filterwarnings("error")
def test_values_that_differ_by_almost_nothing_are_no_error():
    counts = np.random.default_rng(1).normal(size=(4000, 6))
    counts[100], counts[101] = 0.0, 1e-310
    assert np.isfinite(_missing_samples(counts, np.ones(6), np.zeros(6), 100)).all()


@pytest.mark.parametrize(
    ("language", "check", "cause"),
    [
        ("en", "has changed little since the first stage", "since the start of the first stage, between 24.0 and 27.0"),
        ("zh_CN", "自第一阶段起温度变化很小", "自第一阶段开始，温度变化了 3.0 °C（24.0 至 27.0 °C）"),
    ],
)
def test_check_of_the_temperature_states_from_when_it_counts(language: Language, check: str, cause: str) -> None:
    diagnosis = Diagnosis("temperature_changed", 3.0, unit="K", values={"low": 24.0, "high": 27.0})
    assert check in sentence(Text.of("check.temperature", stage="azimuth_flip"), language)
    failed = Check.of_model("azimuth_flip", ModelTest("temperature", 3.0, 2.0, "K", diagnosis))
    assert failed.cause_text is not None
    assert cause in sentence(failed.cause_text, language)
