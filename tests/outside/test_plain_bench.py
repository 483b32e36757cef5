"""The virtual bench and an independent simulator agree, in samples and in calibration results."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calstation.bench import BenchConfig
from calstation.bench.truth import Effects, SensorStream
from calstation.bench.truth.kinematics import JointProfile
from calstation.config import load_configuration
from calstation.physics import INDEX
from calstation.results import load_result
from calstation.simulation import bench_config
from tests.outside.sweep import Case, plain_bench_of, run
from tests.site_folder import SiteFolder

RATE, COUNT = 1000.0, 4000
MATRIX = [[0.0, 0.3, -0.2], [0.5, 0.0, 0.4], [-0.1, 0.6, 0.0]]
#: Every effect that acts without noise, large enough to be seen in one sample.
EFFECTS: dict[str, Any] = {
    "accel_cubic_ug_g3": [1e3, -2e3, 3e3],
    "accel_cross_ug_g2": (1e3 * np.array(MATRIX)).tolist(),
    "accel_asymmetry_ppm": [4e3, -2e3, 1e3],
    "accel_off_axis_mm": (1e1 * np.array(MATRIX)).tolist(),
    "accel_delay_ms": 2.0,
    "gyro_square_ppm": 2e3,
    "gyro_cubic_ppm": -3e3,
    "gyro_asymmetry_ppm": [1e3, 2e3, -3e3],
    "gyro_delay_ms": [0.5, 0.0, -1.0],
    "gyro_fifth_ppm": [1e3, 2e3, -3e3],
    "gyro_flex_urad_g": (1e2 * np.array(MATRIX)).tolist(),
    "gyro_g_square_dph_g2": (1e3 * np.array(MATRIX)).tolist(),
    "gyro_hysteresis_dph": [1e3, -2e3, 3e3],
    "gyro_moving_bias_dph": [2e3, 1e3, 3e3],
    "gyro_scale_hysteresis_ppm": [1e3, -2e3, 3e3],
    "low_pass_ms": 3.0,
    "coning_compensation": 1.0,
    "accel_fifth_ug_g5": [1e3, -2e3, 3e3],
    "accel_moving_bias_ug": [1e3, -2e3, 3e3],
    "accel_rate_square_ug": (1e2 * np.array(MATRIX)).tolist(),
    "gyro_clip_dps": 50.0,
    "g_sensitivity_dph_g": (1e3 * np.array(MATRIX)).tolist(),
    "sample_clock_ppm": 2e3,
    "warm_up_gyro_scale_ppm": 5e3,
    "warm_up_accel_scale_ppm": [1e3, 2e3, 3e3],
    "warm_up_gyro_bias_dph": 1e3,
    "warm_up_accel_bias_ug": 1e3,
    "warm_up_s": 2.0,
    "gyro_jump_dph": [1e3, 2e3, 3e3],
    "accel_jump_ug": -2e3,
    "jump_at_s": 2.0005,
}
OTHERS = {"accel_noise", "gyro_noise", "accel_random_walk_ug_sqrt_h", "gyro_random_walk_dph_sqrt_h"}
#: Effects that change within a sample, of which each simulator takes another fraction.
SWITCHED = ("gyro_moving_bias_dph", "accel_moving_bias_ug", "gyro_hysteresis_dph", "gyro_scale_hysteresis_ppm")
NOISE = {"instability": False, "velocity_sigma": 0.0, "wobble_arcsec": 0.0, "sample_rate_hz": RATE}


class Profile:
    """A joint of the second simulator that moves like one of the virtual bench."""

    def __init__(self, profile: JointProfile) -> None:
        self.states = lambda times: tuple(profile.states(times).T)


@pytest.mark.parametrize(
    "effect", ["all", *(pytest.param(name, marks=[pytest.mark.long]) for name in ("none", *EFFECTS))]
)
def test_simulators_agree_on_every_sample(effect: str) -> None:
    assert {*EFFECTS, *OTHERS} == set(Effects.model_fields)
    constants = {name: EFFECTS[name] for name in ("warm_up_s", "jump_at_s")}
    alone = ("low_pass_ms", "gyro_hysteresis_dph", "gyro_scale_hysteresis_ppm")  # which follow the other effects
    together = {name: value for name, value in EFFECTS.items() if name not in alone}
    effects = {"none": {}, "all": together}.get(effect, {effect: EFFECTS.get(effect), **constants})
    unit = {"base_tilt_deg": 0.5, "mount_deg": (0.6, 1.2), "non_orthogonality_arcsec": 900.0, "azimuth_deg": 40.0}
    unit["axis_offset_mm"] = (20.0, -10.0)
    config = BenchConfig.model_validate({**NOISE, **unit, "seed": 3, "effects": effects})
    truth, plain = config.truth(), plain_bench_of(config)
    values = {**vars(truth.imu), "gyro_arw": 0.0, "accel_vrw": 0.0, "gyro_lsb": 1e-15, "accel_lsb": 1e-13}
    outer = JointProfile.rest(0.3, -1.0).move(0.1, 2.5, 0.9, 1.5)
    inner = JointProfile.rest(-0.5, -1.0).move(0.1, -3.0, 1.1, 2.0)
    stream = SensorStream(type(truth.imu)(**values), truth.table, 0)
    got = stream.produce(COUNT, outer, inner).counts * np.repeat([1e-15, 1e-13], 3)
    plain.joints = (Profile(outer), Profile(inner))
    expected = plain.increments(0, COUNT)
    if "gyro_clip_dps" in effects:
        clip = np.deg2rad(50.0) / RATE / (1.0 + 1e-6 * effects.get("sample_clock_ppm", 0.0))
        expected[:, :3] = np.clip(expected[:, :3], -clip, clip)
    jump = int(EFFECTS["jump_at_s"] / plain.interval)  # during a sample, of which each simulator takes another fraction
    got[jump] = expected[jump]
    if any(name in effects for name in SWITCHED):
        rates = plain.motion(np.arange(COUNT) * plain.interval)[1]
        turning = np.column_stack([np.abs(rates) > np.deg2rad(1.0), np.abs(rates).max(axis=1) > 1.1e-3])
        for k in np.flatnonzero(np.diff(turning, axis=0).any(axis=1)):
            got[k - 6 : k + 7] = expected[k - 6 : k + 7]
    largest = np.abs(got - expected).max(axis=0) * RATE
    kinks = 1.0 if "low_pass_ms" in effects else 0.0  # of the acceleration, during the time constant
    assert largest[:3].max() < 2e-6 + 1.2e-5 * kinks, "rad/s"
    assert largest[3:].max() < 2e-4 + 1e-3 * kinks, "m/s²"
    assert np.abs((got - expected).sum(axis=0)).max() < 2e-7, "rad and m/s in 4 s"
    assert stream.parameters == pytest.approx(list(plain_at(plain, stream.time).values()), rel=1e-9, abs=1e-15)


def plain_at(plain: Any, time: float) -> dict[str, float]:
    """Return the parameters of the second simulator at a time."""
    plain.produced = round(time / plain.interval)
    return dict(plain.parameters)


@pytest.mark.long
@pytest.mark.parametrize("simulator", ["bench", "plain"])
def test_error_free_units_pass_with_both_simulators(simulator: Any) -> None:
    outcome = run(Case(simulator=simulator, seed=3))
    assert outcome.passed, outcome.failed
    assert outcome.worst < 4.0


@pytest.mark.exhaustive
def test_simulators_give_the_same_calibration_error_for_an_effect() -> None:
    case = Case("accel_delay_ms", 1.0, table="quiet", sample_rate_hz=100.0)
    bench, plain = (run(replace(case, simulator=simulator)) for simulator in ("bench", "plain"))
    assert plain.parameter == bench.parameter
    assert plain.worst == pytest.approx(bench.worst, rel=0.1)
    assert plain.cause == bench.cause


@pytest.mark.long
def test_run_through_the_protocols_reports_the_effect(site_folder: SiteFolder) -> None:
    site_folder.write(effects={"accel_cubic_ug_g3": [0.0, 3000.0, 0.0]})
    ended = site_folder.run("rate", "six_position")
    result = load_result(Path(ended.result_file))
    assert result.passed is False
    found = result.parameters
    configured = bench_config(load_configuration(site_folder.request()))
    truth = BenchConfig.model_validate(configured).truth().parameters
    # At the faces, f³ is f times g².
    for axis, expected in (("x", 0.0), ("y", 3e-3), ("z", 0.0)):
        name = f"accel_scale_{axis}"
        assert found[name].value - truth[INDEX[name]] == pytest.approx(expected, abs=5e-4), name
