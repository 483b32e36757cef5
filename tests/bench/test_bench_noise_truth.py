"""The noise of the simulated stream lies within chi-squared bounds of the configured levels."""

import numpy as np
import pytest
from scipy import stats

from calstation.bench.truth import INSTABILITY_TIMES, ImuTruth, SensorStream, TableTruth, instability_variance
from calstation.bench.truth.kinematics import JointProfile
from calstation.physics import COUNT


def instability_covariance(instability, lag):
    """Return the autocovariance of the bias at `lag`, s."""
    decay = np.exp(-np.abs(np.asarray(lag))[..., None] / np.array(INSTABILITY_TIMES))
    return instability_variance(instability) * decay.sum(axis=-1)


REST = (JointProfile.rest(0.0), JointProfile.rest(0.0))
ARW, VRW = 3e-5, 5e-4


def stream(seed=1, sample_rate=100.0, velocity_sigma=0.0, **noise):
    values = {"gyro_arw": ARW, "accel_vrw": VRW, **noise}
    imu = ImuTruth(np.zeros(COUNT), sample_rate, "increment", 1e-9, 1e-9, **values)
    return SensorStream(imu, TableTruth(0.6, 0.0, velocity_sigma=velocity_sigma), seed)


def assert_variance(samples, expected, probability=1e-5):
    """Assert that sample variances of white columns lie within the two-sided chi-squared bounds."""
    degrees = len(samples) - 1
    ratio = np.var(samples, axis=0, ddof=1) * degrees / expected
    low, high = stats.chi2.ppf([probability / 2, 1 - probability / 2], degrees)
    assert np.all((low < ratio) & (ratio < high))


def test_white_noise_has_the_configured_density():
    increments = stream().produce(50_000, *REST).counts * 1e-9
    assert_variance(increments[:, :3], ARW**2 * 0.01)
    assert_variance(increments[:, 3:], VRW**2 * 0.01)


def test_allan_deviation_falls_with_the_square_root_of_time():
    angles = np.cumsum(stream(seed=2).produce(200_000, *REST).counts[:, 0] * 1e-9)
    for length in (10, 100, 1000):
        means = np.diff(angles[length - 1 :: length]) / (length * 0.01)
        pairs = np.diff(means)[::2]
        # Pairs that share no sample are independent: the Allan variance is chi-squared.
        expected = ARW**2 / (length * 0.01)
        band = stats.chi2.ppf([5e-6, 1 - 5e-6], len(pairs)) / len(pairs)
        assert band[0] < np.mean(pairs**2) / 2 / expected < band[1]


def test_sum_of_gauss_markov_processes_has_the_flicker_floor():
    times = np.array(INSTABILITY_TIMES)
    variance = instability_variance(1.0)
    for tau in (10.0, 30.0, 100.0, 300.0):
        x = tau / times
        # Allan variance of a Gauss-Markov process (IEEE Std 952-1997, C.1.5).
        allan = 2 * variance / x * (1 - (3 - 4 * np.exp(-x) + np.exp(-2 * x)) / (2 * x))
        assert np.sqrt(allan.sum()) == pytest.approx(0.664, rel=0.07)
    assert instability_covariance(1.0, np.zeros(1))[0] == pytest.approx(len(times) * variance)


def test_bias_instability_has_the_autocovariance_of_the_gauss_markov_processes():
    # Slow samples cover many correlation times; they are pooled over six channels and all runs.
    instability, rate, length = 1e-3, 0.5, 4096
    lags = np.array([0, 1, 2, 4])
    found = []
    for seed in range(40):
        one = stream(seed, rate, gyro_arw=0.0, accel_vrw=0.0, gyro_bias_instability=instability)
        earth = stream(seed, rate, gyro_arw=0.0, accel_vrw=0.0).produce(length, *REST).counts
        bias = (one.produce(length, *REST).counts - earth)[:, :3] * 1e-9 * rate
        found.append([np.mean(bias[: length - k] * bias[k:], axis=0) for k in lags])
    covariance = np.array(found)  # (seeds, lags, channels)
    mean = covariance.mean(axis=(0, 2))
    error = covariance.std(axis=(0, 2)) / np.sqrt(40 * 3)
    assert np.all(np.abs(mean - instability_covariance(instability, lags / rate)) < 4.5 * error)


def test_mean_base_velocity_has_its_configured_size_and_is_white():
    sigma, sample_rate = 1e-3, 200.0
    shaken = stream(3, sample_rate, velocity_sigma=sigma, gyro_arw=0.0, accel_vrw=0.0)
    quiet = stream(3, sample_rate, gyro_arw=0.0, accel_vrw=0.0)
    count = 400_000
    changes = (shaken.produce(count, *REST).counts - quiet.produce(count, *REST).counts)[:, 3:] * 1e-9
    velocity = np.cumsum(changes, axis=0)
    velocity -= velocity.mean(axis=0)
    tenths = velocity.reshape(-1, 20, 3).mean(axis=1)
    assert np.var(tenths, axis=0) == pytest.approx(sigma**2, rel=0.03)
    assert np.var(velocity, axis=0) == pytest.approx(4.0 * sigma**2, rel=0.03)
    for lag in (1, 2, 3):
        correlation = np.mean(tenths[:-lag] * tenths[lag:], axis=0) / sigma**2
        assert np.max(np.abs(correlation)) < 4.5 / np.sqrt(len(tenths))


def test_samples_do_not_depend_on_the_request_size():
    noise = {"velocity_sigma": 1e-3, "gyro_bias_instability": 1e-5, "accel_bias_instability": 1e-4}
    joints = (JointProfile.rest(0.0).move(0.333, 1.0, 0.5, 1.0), JointProfile.rest(0.0))
    whole = stream(**noise).produce(500, *joints).counts
    pieces = stream(**noise)
    cut = np.vstack([pieces.produce(n, *joints).counts for n in (1, 9, 40, 200, 250)])
    assert np.array_equal(whole, cut)
