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


def test_noise_at_rest_matches_the_profile():
    measured = noise_of()
    for ratio in (*measured.gyro, *measured.accel, measured.velocity):
        assert ratio.excess == pytest.approx(1.0)
        assert np.all(np.abs(ratio.value - 1.0) < ratio.limit - 1.0)


@pytest.mark.parametrize("velocity_sigma", [1e-5, 1e-3])
def test_sensor_noise_is_separated_from_table_vibration(velocity_sigma):
    measured = noise_of(velocity_sigma=velocity_sigma, effects={"gyro_noise": 3.0, "accel_noise": 10.0})
    for ratio, factor in ((measured.gyro[0], 3.0), (measured.accel[0], 10.0)):
        assert ratio.excess == pytest.approx(factor, rel=0.15)
    assert measured.velocity.excess == pytest.approx(1.0)


def test_low_frequency_noise_is_detected_at_the_longer_averaging_time():
    measured = noise_of(effects={"gyro_random_walk_dph_sqrt_h": 500.0})
    assert np.all(measured.gyro[1].value > 1.5 * measured.gyro[0].value)
    assert measured.worst()[1:] in [("gyro_x", 4.0), ("gyro_y", 4.0), ("gyro_z", 4.0)]


@pytest.mark.parametrize(("velocity_sigma", "quiet"), [(1e-3, False), (1e-5, True)])
def test_low_vibration_of_the_table_is_recognised(velocity_sigma, quiet):
    assert noise_of(100.0, velocity_sigma=velocity_sigma).table_is_quiet == quiet


@pytest.mark.parametrize(("seconds", "factor"), [(15.0, 6.0), (40.0, 4.0)])
def test_large_noise_is_detected_in_a_short_rest(seconds, factor):
    ratio, channel, _ = noise_of(seconds, effects={"gyro_noise": factor}).worst()
    assert channel.startswith("gyro")
    assert 0.6 * factor < ratio < 1.7 * factor
