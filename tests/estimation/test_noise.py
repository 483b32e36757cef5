"""The noise model of the filters agrees with its definitions and with the bench."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from simulated_stages import block_of, context_of

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator
from calstation.estimation.common import (
    ImuModel,
    RestNoise,
    SampleBlock,
    Site,
    SolveContext,
    TableModel,
    filter_noise,
    rest_mean_variance,
    rest_noise,
    slope_weights,
    stage_data,
)
from calstation.physics import Dwell, group_indices

IMU = ImuModel("S", 200.0, "increment", 1e-7, 1e-6, 1e-6, 1e-4)
CONTEXT = SolveContext(Site(0.6, 0.0, 0.0), IMU, TableModel())


def with_imu(**changes):
    return replace(CONTEXT, imu=replace(IMU, **changes))


def test_white_noise_is_taken_from_the_profile():
    noise = filter_noise(with_imu(gyro_lsb=1e-15, accel_lsb=1e-15))
    assert noise.rate == pytest.approx(1e-12)
    assert noise.force == pytest.approx(1e-8)
    assert noise.velocity == pytest.approx(1e-6)
    assert noise.interval == 0.1


def test_quantisation_adds_a_uniform_error_per_sample_or_observation():
    coarse = {"gyro_arw": 1e-12, "accel_vrw": 1e-12}
    increment = filter_noise(with_imu(**coarse))
    # one count of angle per 0.1 s
    assert increment.rate == pytest.approx(1e-14 / 12.0 / 0.1, rel=1e-3)
    fine = {"gyro_arw": 0.5e-7 / 200.0**0.5, "accel_vrw": 0.5e-6 / 200.0**0.5}
    rate = filter_noise(with_imu(**fine, output="rate"))
    # every sample rounds lsb · dt of angle
    assert rate.rate == pytest.approx(fine["gyro_arw"] ** 2 + (1e-7 / 200.0) ** 2 / 12.0 * 200.0)
    assert rate.force == pytest.approx(fine["accel_vrw"] ** 2 + (1e-6 / 200.0) ** 2 / 12.0 * 200.0)
    exact = filter_noise(with_imu(**fine, output="rate", gyro_quantisation=0.0, accel_quantisation=2e-6))
    assert exact.rate == pytest.approx(fine["gyro_arw"] ** 2)
    assert exact.force > rate.force


@pytest.mark.parametrize("duration", [5.0, 20.0, 60.0])
@pytest.mark.parametrize("step", [0.5, 2.0, 3.0, 10.0, 100.0])
def test_sigma_of_a_rest_is_valid_for_any_rounding_step(duration, step):
    # rests of a unit that outputs rates rounded to `step` sigmas of a sample's noise; their true rates are arbitrary
    random, sigma = np.random.default_rng(3), 1e-6 * 200.0**0.5
    noise = filter_noise(with_imu(output="rate", gyro_lsb=step * sigma))
    count = int(duration * 200.0)
    errors = []
    for true in random.uniform(-50.0, 50.0, 300) * step * sigma:
        samples = true + sigma * random.standard_normal(count)
        errors.append(np.mean(np.rint(samples / (step * sigma)) * step * sigma) - true)
    expected = noise.rate / duration + noise.bias_drift[0] ** 2
    ratio = np.mean(np.square(errors)) / expected
    assert ratio < 1.3
    assert np.max(np.abs(errors)) < 4.0 * expected**0.5
    assert ratio > {0.5: 0.75, 2.0: 0.75, 3.0: 0.0, 10.0: 0.05, 100.0: 0.05}[step]  # steps of 3 sigmas still average


def test_bias_drift_has_the_bias_instability_of_the_profile():
    bias_drift = filter_noise(with_imu(gyro_bias_instability=1e-7, accel_bias_instability=1e-5)).bias_drift
    assert bias_drift == pytest.approx([bias_drift[0]] * 3 + [100.0 * bias_drift[0]] * 3)
    # Allan variance of a Gauss-Markov process (IEEE Std 952, C.1.8) at half its correlation time
    x = 0.5
    shape = 2.0 / x * (1.0 - (3.0 - 4.0 * np.exp(-x) + np.exp(-2.0 * x)) / (2.0 * x))
    assert bias_drift[0] ** 2 * shape == pytest.approx((0.664e-7) ** 2, rel=0.01)
    assert not np.any(filter_noise(CONTEXT).bias_drift)


def scatter(accel, count, stride):
    """Return the variance of the weighted means of rests, and its number of values."""
    weights = slope_weights(count, stride)
    means = np.array([weights @ accel[k : k + count] for k in range(0, len(accel) - count + 1, count)])
    return float(means.var(axis=0, ddof=1).mean()), 3 * (len(means) - 1)


@pytest.mark.parametrize("velocity_sigma", [1e-6, 1e-3])
def test_mean_of_a_rest_has_the_predicted_variance(velocity_sigma):
    random = np.random.default_rng(2)
    context = SolveContext(
        CONTEXT.site,
        replace(IMU, sample_rate=10.0, accel_lsb=1e-15),
        TableModel(velocity_sigma=velocity_sigma),
    )
    velocity = random.normal(0.0, velocity_sigma, (60001, 3))
    accel = np.diff(velocity, axis=0) / 0.1 + random.normal(0.0, 1e-4 / np.sqrt(0.1), (60000, 3))
    measured, degrees = scatter(accel, 200, 1)
    low, high = chi2.ppf([0.0005, 0.9995], degrees) / degrees
    assert low < measured / rest_mean_variance(context, 20.0) < high


def test_mean_of_a_rest_on_a_vibrating_base_has_the_predicted_variance():
    truth = BenchConfig(grade="nav", seed=4, sample_rate_hz=100.0, instability=False).truth()
    samples = Simulator(truth, 4).run([Dwell(2000.0)], "six_position")
    context = context_of(truth)
    measured, degrees = scatter(stage_data([block_of(samples)], context.imu).accel, 1000, 10)
    low, high = chi2.ppf([0.0005, 0.9995], degrees) / degrees
    assert low < measured / rest_mean_variance(context, 10.0) < high


def noise_of(seconds: float = 3000.0, **settings: object) -> RestNoise:
    truth = BenchConfig(grade="tactical", seed=5, sample_rate_hz=100.0, instability=False, **settings).truth()
    plain = BenchConfig(grade="tactical", seed=5, sample_rate_hz=100.0, instability=False).truth()
    samples = Simulator(truth, 5).run([Dwell(seconds)], "six_position")
    context, bias = context_of(plain), truth.parameters[group_indices("gyro_bias")]
    return rest_noise(stage_data([block_of(samples)], context.imu), context, (bias, 1e-4))


@pytest.mark.parametrize("velocity_sigma", [1e-5, 1e-3])
def test_noise_at_rest_matches_the_profile(velocity_sigma):
    measured = noise_of(velocity_sigma=velocity_sigma)
    assert np.all(measured.imu == 1.0)
    assert measured.table == pytest.approx((velocity_sigma / 1e-3) ** 2, abs=0.05)


@pytest.mark.parametrize("velocity_sigma", [1e-5, 1e-3])
def test_sensor_noise_is_separated_from_table_vibration(velocity_sigma):
    measured = noise_of(velocity_sigma=velocity_sigma, effects={"gyro_noise": 3.0, "accel_noise": 10.0})
    assert measured.imu == pytest.approx([3.0] * 3 + [10.0] * 3, rel=0.1)
    assert measured.table <= 1.05


@pytest.mark.parametrize(("velocity_sigma", "quiet"), [(1e-3, False), (1e-5, True)])
def test_low_vibration_of_the_table_is_recognised(velocity_sigma, quiet):
    assert noise_of(100.0, velocity_sigma=velocity_sigma).table_is_quiet == quiet


def test_large_noise_is_detected_in_a_short_rest():
    ratio, channel = noise_of(40.0, effects={"gyro_noise": 4.0}).worst()
    assert channel.startswith("gyro")
    assert ratio == pytest.approx(4.0, rel=0.25)


#: Rates and white noise of a nav and a MEMS unit: ARW, VRW and LSBs.
UNITS = {"nav": (2.9e-7, 4.9e-5, 5e-8, 1e-6), "mems": (4.4e-5, 5.9e-4, 1e-6, 2e-5)}
VIBRATION = 1e-3


def sine(frequency, size):
    """Return a motion with an rms `size` along x and half of it along y."""
    return lambda time, random: (
        size * np.sqrt(2.0) * np.sin(2.0 * np.pi * frequency * time + 0.3)[:, None] * [1.0, 0.5, 0.0]
    )


def moving_mean(duration, size):
    """Return white noise averaged over `duration`, with an rms `size`."""

    def motion(time, random):
        width = round(duration / (time[1] - time[0]))
        total = np.cumsum(random.standard_normal((len(time) + width, 3)), axis=0)
        return (total[width:] - total[:-width]) / np.sqrt(width) * size

    return motion


def creep(time, random):
    """Return 100 µrad that decay within 10 s."""
    return 1e-4 * np.exp(-time / 10.0)[:, None] * [1.0, 0.0, 0.3]


def still(time, random):
    """Return no motion."""
    return np.zeros((len(time), 3))


def measured_at_rest(
    unit, velocity=still, tilt=still, white=1.0, gyro=1.0, accel=1.0, rests=30, duration=15.0, rate=100.0
):
    """Return the noise at rests between moves on a table with white, further and angular motion."""
    arw, vrw, gyro_lsb, accel_lsb = UNITS[unit]
    random, dt, count = np.random.default_rng(1), 1.0 / rate, round(duration * rate)
    imu = ImuModel("S", rate, "increment", gyro_lsb, accel_lsb, arw, vrw)
    parts = []
    for k in range(rests):
        time, up = np.arange(count + 1) * dt, np.roll([0.0, 0.0, 9.8], k % 3)
        # means over 0.1 s with the rms `VIBRATION`, from independent velocities at the samples
        v = white * VIBRATION * np.sqrt(0.1 * rate) * random.standard_normal((count + 1, 3)) + velocity(
            40.0 * k + time, random
        )
        angle = tilt(time, random)
        force = np.diff(v, axis=0) / dt + accel * vrw / np.sqrt(dt) * random.standard_normal((count, 3))
        force += up - np.cross(0.5 * (angle[1:] + angle[:-1]), up)
        omega = np.diff(angle, axis=0) / dt + gyro * arw / np.sqrt(dt) * random.standard_normal((count, 3))
        parts += [np.hstack([omega, force]), np.tile([0.4] * 3 + [3.0] * 3, (50, 1))]
    lsb = np.repeat([gyro_lsb, accel_lsb], 3)
    counts = np.diff(np.round(np.cumsum(np.concatenate(parts) * dt / lsb, axis=0)), axis=0, prepend=0.0)
    n, none = len(counts), np.zeros(len(counts), np.int64)
    samples = SampleBlock(
        "excitation", np.arange(n), (np.arange(n) + 1) * dt, counts, np.full((n, 2), np.nan), none,
        np.ones(n, np.bool_), np.full(n, 25.0),
    )  # fmt: skip
    context = SolveContext(Site(0.6, 1.9, 0.0, azimuth=0.0), imu, TableModel(velocity_sigma=VIBRATION))
    return rest_noise(stage_data([samples], imu), context, (np.zeros(3), 1e-6 if unit == "nav" else 1e-3))


MOTIONS = {
    "sway": {"velocity": sine(8.0, 3e-4)},
    "sway, quiet otherwise": {"velocity": sine(8.03, 3e-4), "white": 0.01},
    "fan": {"velocity": sine(10.03, 3e-4), "white": 0.01},
    "mains": {"velocity": sine(50.02, 5e-4), "white": 0.01, "rate": 200.0},
    "slow": {"velocity": moving_mean(1.0, 5e-4), "white": 0.01},
    "fairly slow": {"velocity": moving_mean(0.3, 5e-4), "white": 0.01},
    "rocking": {"tilt": sine(3.0, 1e-6)},
    "strong rocking": {"tilt": sine(3.0, 2e-5)},
    "creep": {"tilt": creep},
    "short rests": {"velocity": sine(8.0, 3e-4), "white": 0.01, "rests": 10, "duration": 3.0},
}


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("motion", MOTIONS)
def test_motion_of_the_table_is_never_taken_for_noise_of_the_unit(unit, motion):
    measured = measured_at_rest(unit, **MOTIONS[motion])
    assert np.all(measured.imu == 1.0)
    # velocity means over 1 s have √(1 s / 0.1 s) times the noise of white velocity with the same rms
    assert np.sqrt(measured.table) < (1.2 * 0.5 * 10.0**0.5 if motion == "slow" else 1.05)


def test_slow_motion_of_the_table_is_measured_as_white_noise_of_the_same_density():
    measured = measured_at_rest("nav", **MOTIONS["slow"])
    assert measured.table == pytest.approx(0.25 * 10.0, rel=0.35)
    assert measured.slow_variance == pytest.approx(0.25 * 10.0 * VIBRATION**2, rel=0.35)


def test_periodic_motions_of_the_table_are_named():
    sway = measured_at_rest("nav", **MOTIONS["sway, quiet otherwise"]).sway
    assert sway.frequency == pytest.approx(8.03, abs=0.02)
    assert sway.rms == pytest.approx(3e-4 * 1.25**0.5, rel=0.05)
    rocking = measured_at_rest("nav", **MOTIONS["strong rocking"]).rocking
    assert rocking.frequency == pytest.approx(3.0, abs=0.02)
    assert rocking.rms == pytest.approx(2e-5 * 1.25**0.5, rel=0.05)
    sound = measured_at_rest("nav")
    assert sound.sway is None
    assert sound.rocking is None


#: A smaller excess of an accelerometer is not significant beside the motion of the table.
@pytest.mark.parametrize(
    ("unit", "sensor", "ratio"),
    [("nav", "gyro", 1.5), ("nav", "gyro", 4.0), ("mems", "gyro", 1.5), ("mems", "accel", 2.0), ("mems", "accel", 4.0)],
)
def test_noise_of_a_unit_on_a_table_as_in_its_profile_is_measured(unit, sensor, ratio):
    measured = measured_at_rest(unit, **{sensor: ratio})
    channels = slice(0, 3) if sensor == "gyro" else slice(3, 6)
    assert measured.imu[channels] == pytest.approx([ratio] * 3, rel=0.2)
    others = np.ones(6, np.bool_)
    others[channels] = False
    assert np.all(measured.imu[others] == 1.0)
