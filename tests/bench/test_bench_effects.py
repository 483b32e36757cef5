"""Every simulated error outside the 30-parameter model agrees with a closed form at rest and in steady rotation."""

from typing import Any

import numpy as np
import pytest

from calstation.bench import BenchConfig
from calstation.bench.truth import Effects, SensorStream, Simulator, StreamOutput
from calstation.bench.truth.effects import Changes
from calstation.bench.truth.kinematics import JointProfile
from calstation.errors import ConfigurationError
from calstation.physics import COUNT, INDEX, NAMES, Dwell, Move
from calstation.schema import validate
from tests.helpers import error_code, raises_code

G, PPM = 9.80665, 1e-6
DPH = np.deg2rad(1.0) / 3600.0
RATE = np.deg2rad(90.0)
#: Attitude in which all axes sense gravity, and the fraction that each senses.
OBLIQUE = (0.6, 0.8)
PLAIN: dict[str, Any] = {
    "parameters": dict.fromkeys(NAMES, 0.0),
    "instability": False,
    "sample_rate_hz": 100.0,
    "gravity_mps2": G,
    "output": "rate",
    **dict.fromkeys(("azimuth_error_deg", "base_tilt_deg", "non_orthogonality_arcsec", "wobble_arcsec"), 0.0),
    "velocity_sigma": 0.0,
    "mount_deg": (0.0, 0.0),
}
#: Factor that makes counts so small that rounding does not matter.
FINE = 1e-9


def stream(**effects: Any) -> SensorStream:
    """Create a noise-free unit whose only errors are the given effects."""
    truth = BenchConfig(**PLAIN, effects=effects).truth()
    imu = truth.imu
    values = {**vars(imu), "gyro_arw": 0.0, "accel_vrw": 0.0}
    values |= {"gyro_lsb": FINE * imu.gyro_lsb, "accel_lsb": FINE * imu.accel_lsb}
    return SensorStream(type(imu)(**values), truth.table, 1)


def means(source: SensorStream, count: int, outer: JointProfile, inner: JointProfile) -> np.ndarray:
    """Return the output of the next samples, rad/s and m/s², shape (n, 6)."""
    imu = source._imu
    return source.produce(count, outer, inner).counts * np.repeat([imu.gyro_lsb, imu.accel_lsb], 3)


def at_rest(angles: tuple[float, float] = OBLIQUE, count: int = 1, **effects: Any) -> np.ndarray:
    """Return the output at rest."""
    return means(stream(**effects), count, *(JointProfile.rest(angle) for angle in angles))


def rotating(outer: float, sign: float, **effects: Any) -> np.ndarray:
    """Return the output of a sample during a steady rotation about z_b at an outer angle."""
    turn = JointProfile.rest(0.0).move(0.0, sign * 100.0, RATE, 1.0)
    source = stream(**effects)
    means(source, 1000, JointProfile.rest(outer), turn)
    return means(source, 1, JointProfile.rest(outer), turn)[0]


def forces() -> np.ndarray:
    """Return the specific force in the oblique attitude, g."""
    outer, inner = OBLIQUE
    return np.array([np.sin(outer) * np.sin(inner), np.sin(outer) * np.cos(inner), np.cos(outer)])


def test_accelerometer_nonlinearity_and_asymmetry_match_the_closed_form() -> None:
    f, plain = forces(), at_rest()
    assert plain[0, 3:] == pytest.approx(G * f, abs=1e-9)
    added = {
        "accel_cubic_ug_g3": f**3,
        "accel_asymmetry_ppm": np.abs(f),
    }
    for name, expected in added.items():
        got = (at_rest(**{name: 30.0}) - plain)[0, 3:] / (PPM * G)
        assert got == pytest.approx(30.0 * expected, abs=1e-6), name
        single = (at_rest(**{name: [0.0, 30.0, 0.0]}) - plain)[0, 3:] / (PPM * G)
        assert single == pytest.approx([0.0, 30.0 * expected[1], 0.0], abs=1e-6), name
    below = at_rest((OBLIQUE[0] + np.pi, OBLIQUE[1]), accel_asymmetry_ppm=30.0)[0, 3:]
    assert (below / G + f) / PPM == pytest.approx(30.0 * np.abs(f), abs=1e-5)
    matrix = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]
    products = np.array([f[1] * f[2], f[2] * f[0], f[0] * f[1]])
    got = (at_rest(accel_cross_ug_g2=matrix) - plain)[0, 3:] / (PPM * G)
    assert got == pytest.approx(np.array(matrix) @ products, abs=1e-6)


def test_gyro_g_sensitivity_matches_the_closed_form() -> None:
    matrix = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]
    got = (at_rest(g_sensitivity_dph_g=matrix) - at_rest())[0, :3] / DPH
    assert got == pytest.approx(np.array(matrix) @ forces(), abs=1e-7)


def test_scalar_effect_sets_the_magnitude_of_all_coefficients_with_random_signs() -> None:
    found = [Effects(g_sensitivity_dph_g=0.1).draw(np.random.default_rng(seed)).terms[5:8] / DPH * G for seed in (1, 2)]
    assert np.abs(found) == pytest.approx(0.1)
    assert not np.array_equal(*found)
    others = Effects(accel_off_axis_mm=2.0, accel_cross_ug_g2=3.0).draw(np.random.default_rng(1))
    assert np.abs(others.off_axis) == pytest.approx(2e-3 * (1.0 - np.eye(3)))
    assert np.abs(others.terms[8:11]) == pytest.approx(3.0 * PPM / G * (1.0 - np.eye(3)))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_gyro_nonlinearity_and_asymmetry_match_the_closed_form(sign: float) -> None:
    true = rotating(0.0, sign)[2]
    assert true == pytest.approx(sign * RATE, abs=1e-4)
    share = true / np.deg2rad(100.0)
    for name, expected in (
        ("gyro_asymmetry_ppm", abs(true)),
        ("gyro_square_ppm", true * share),
        ("gyro_cubic_ppm", true * share**2),
    ):
        assert (rotating(0.0, sign, **{name: 50.0})[2] - true) / PPM == pytest.approx(50.0 * expected, abs=1e-6), name


def test_clipped_gyros_raise_no_flag_but_range_overflow_is_flagged() -> None:
    source = stream(gyro_clip_dps=60.0)
    imu = source._imu
    turn = JointProfile.rest(0.0).move(0.0, 100.0, RATE, 1.0)
    output: StreamOutput = source.produce(1000, JointProfile.rest(0.0), turn)
    got = output.counts[:, 2] * imu.gyro_lsb
    true = means(stream(), 1000, JointProfile.rest(0.0), turn)[:, 2]
    assert got == pytest.approx(np.minimum(true, np.deg2rad(60.0)), abs=1e-9)
    assert not output.saturated.any()
    fast = JointProfile.rest(0.0).move(0.0, 1000.0, np.deg2rad(450.0), 100.0)
    far = stream(gyro_clip_dps=420.0).produce(20, JointProfile.rest(0.0), fast)
    assert far.saturated.any() == (imu.gyro_range < np.deg2rad(420.0))


def test_size_effect_of_the_accelerometers_matches_the_closed_form() -> None:
    matrix = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]
    got = rotating(0.0, 1.0, accel_off_axis_mm=matrix)[3:] - rotating(0.0, 1.0)[3:]
    # Off the vertical axis by r, an accelerometer senses −ω² r; the earth's rotation adds 1e-4 of ω.
    assert got == pytest.approx(-(RATE**2) * 1e-3 * np.array([1.0, 5.0, 0.0]), abs=5e-6)


def test_delayed_accelerometers_measure_earlier_motion() -> None:
    outer = JointProfile.rest(0.0).move(0.05, 2.0, RATE, 1.0)
    late = means(stream(accel_delay_ms=20.0), 200, outer, JointProfile.rest(0.0))
    now = means(stream(), 200, outer, JointProfile.rest(0.0))
    assert late[:, :3] == pytest.approx(now[:, :3], abs=0.0)
    assert late[2:, 3:] == pytest.approx(now[:-2, 3:], abs=1e-9)


def test_sample_clock_error_changes_the_true_sample_duration_but_not_the_timestamps() -> None:
    plan = [Dwell(5.0), Move(0.0, 6.0, RATE, 1.0), Dwell(5.0)]
    settings = {**PLAIN, "output": "increment", "encoder_sigma_deg": 0.0}
    plain, fast = (
        Simulator(BenchConfig(**settings, effects={"sample_clock_ppm": ppm}).truth(), 1).run(plan, "rate")
        for ppm in (0.0, 20_000.0)
    )
    assert len(fast.seq) == pytest.approx(1.02 * len(plain.seq), abs=2)
    assert fast.time == pytest.approx((fast.seq + 1) * 0.01)
    # The same angle takes more samples, each of which is shorter and contains less gravity.
    lsb = BenchConfig(**settings).truth().imu
    assert fast.counts[:, 2].sum() * lsb.gyro_lsb == pytest.approx(6.0, abs=2e-3)
    assert fast.counts[:400, 5].mean() * lsb.accel_lsb == pytest.approx(0.01 * G / 1.02, abs=1e-5)
    rate = stream(sample_clock_ppm=20_000.0)
    assert means(rate, 1, *(JointProfile.rest(0.0),) * 2)[0, 5] == pytest.approx(G)


def test_warm_up_drift_and_jumps_match_the_closed_form() -> None:
    plain = at_rest(count=2000)[0]
    grown = -np.expm1(-(np.arange(2000) + 0.5) * 0.01 / 8.0)[:, None]
    effects = {"warm_up_accel_scale_ppm": 40.0, "warm_up_gyro_bias_dph": [1.0, 2.0, 3.0], "warm_up_s": 8.0}
    got = at_rest(count=2000, **effects)
    assert got[:, :3] == pytest.approx(plain[:3] + grown * DPH * [1.0, 2.0, 3.0], abs=1e-12)
    assert got[:, 3:] == pytest.approx(plain[3:] * (1.0 + 40.0 * PPM * grown), abs=1e-9)
    late = (np.arange(2000) + 0.5)[:, None] * 0.01 > 7.0
    got = at_rest(count=2000, gyro_jump_dph=2.0, accel_jump_ug=[0.0, 30.0, 0.0], jump_at_s=7.0)
    assert got[:, :3] == pytest.approx(plain[:3] + late * 2.0 * DPH, abs=1e-12)
    assert got[:, 3:] == pytest.approx(plain[3:] + late * 30.0 * PPM * G * [0.0, 1.0, 0.0], abs=1e-9)


def test_random_walk_grows_with_the_square_root_of_time() -> None:
    effects = Effects(gyro_random_walk_dph_sqrt_h=6.0).draw(np.random.default_rng(0))
    ends = []
    for seed in range(300):
        walk = Changes(effects, 1.0, np.random.default_rng(seed), np.zeros(3))
        walk.apply(np.zeros((36, 6)), 0)
        ends.append(walk.parameters(np.zeros(COUNT), 36.0)[:3] / DPH)
    assert np.std(ends) == pytest.approx(6.0 / 10.0, rel=0.1)


def test_reported_final_parameters_match_the_output() -> None:
    effects = {
        "warm_up_gyro_scale_ppm": 70.0,
        "warm_up_accel_bias_ug": 20.0,
        "gyro_jump_dph": [0.0, 5.0, 0.0],
        "jump_at_s": 1.0,
        "accel_random_walk_ug_sqrt_h": 5.0,
        "warm_up_s": 4.0,
    }
    source = stream(**effects)
    still = [JointProfile.rest(angle) for angle in OBLIQUE]
    last = means(source, 1001, *still)[-1]
    found = source.parameters
    grown = -np.expm1(-10.01 / 4.0)
    assert found[INDEX["gyro_scale_x"]] == pytest.approx(70.0 * PPM * grown)
    assert found[INDEX["gyro_bias_y"]] / DPH == pytest.approx(5.0)
    earth = at_rest()[0, :3]
    assert last[:3] == pytest.approx(earth * (1.0 + found[3:6]) + found[:3], abs=1e-12)
    assert last[3:] == pytest.approx(G * forces() + found[[INDEX[f"accel_bias_{a}"] for a in "xyz"]], abs=1e-7)


@pytest.mark.long
def test_time_varying_errors_do_not_depend_on_the_request_size() -> None:
    effects = {"gyro_random_walk_dph_sqrt_h": 6.0, "warm_up_accel_scale_ppm": 9.0, "accel_delay_ms": 3.0}
    truth = BenchConfig(effects=effects).truth()
    still = [JointProfile.rest(0.0)] * 2
    whole, parts = (SensorStream(truth.imu, truth.table, 1) for _ in range(2))
    pieces = [parts.produce(n, *still).counts for n in (1, 30, 69)]
    assert np.array_equal(whole.produce(100, *still).counts, np.vstack(pieces))


def test_noise_effect_scales_the_noise_of_the_grade() -> None:
    plain, noisy = (BenchConfig(effects=e).truth().imu for e in ({}, {"gyro_noise": 3.0, "accel_noise": 0.5}))
    assert noisy.gyro_arw == 3.0 * plain.gyro_arw
    assert noisy.accel_vrw == 0.5 * plain.accel_vrw
    assert np.array_equal(noisy.parameters, plain.parameters)
    assert len(plain.parameters) == COUNT


def test_effects_require_a_motorised_table() -> None:
    config = {"table_protocol": "hand", "effects": {"accel_delay_ms": 1.0}}
    with raises_code(ConfigurationError, "entry.in_file") as caught:
        validate(BenchConfig, config, "bench configuration")
    assert error_code(caught.value) == "effects bench.effects_without_table"
