"""The shipped profiles of the simulated devices agree with the bench."""

import tomllib
from pathlib import Path

import pytest

from calstation.bench import BenchConfig
from calstation.bench.imu.units.framed import MODEL
from calstation.bench.live import TABLE_MODEL
from calstation.bench.truth import GRADES

DATA = Path(__file__).resolve().parents[2] / "data"


def load(kind, name):
    return tomllib.loads((DATA / kind / f"{name}.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("grade", list(GRADES))
def test_imu_profile_has_the_scale_and_noise_of_its_grade(grade):
    profile, config = load("imus", f"bench_{grade}"), BenchConfig(grade=grade)
    truth = config.truth().imu
    assert profile["model"] == MODEL
    assert profile["stream"]["sample_rate_hz"] == config.sample_rate_hz
    assert profile["stream"]["output"] == config.output
    for name in ("gyro_lsb", "accel_lsb"):
        assert profile["stream"][name] == pytest.approx(getattr(truth, name), rel=1e-12)
    for name in ("gyro_arw", "accel_vrw", "gyro_bias_instability", "accel_bias_instability"):
        assert profile["noise"][name] == pytest.approx(getattr(truth, name), rel=1e-6)
    for group, sigma in GRADES[grade].repeatability.items():
        assert profile["stability"][group]["power_up"] == pytest.approx(sigma, rel=0.05)


def test_table_profile_has_the_limits_and_errors_of_the_bench():
    profile, config = load("tables", "bench"), BenchConfig()
    assert profile["model"] == TABLE_MODEL
    for joint, name in enumerate(("outer", "inner")):
        assert profile[name]["low_deg"] == config.low_deg[joint]
        assert profile[name]["high_deg"] == config.high_deg[joint]
        assert profile[name]["max_rate_dps"] <= config.rate_deg_s
        assert profile[name]["max_acceleration_dps2"] <= config.acceleration_deg_s2
    accuracy = profile["accuracy"]
    assert accuracy["encoder_sigma_deg"] == config.encoder_sigma_deg
    assert accuracy["velocity_sigma"] == config.velocity_sigma
    assert accuracy["poll_latency_s"] == config.latency_s
    assert accuracy["poll_jitter_s"] == config.jitter_s
    assert (profile["modbus"]["unit"], profile["modbus"]["serial"]["baud"]) == (1, 115200)
