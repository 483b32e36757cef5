"""The Allan deviation agrees with closed forms of white noise, random walk and bias instability."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calstation.errors import InsufficientDataError
from calstation.estimation.common import SampleBlock
from calstation.records import LogMeta, RawLogWriter
from calstation.results.plots import AllanCurve, allan_deviation, longest_rest
from calstation.results.plots.allan import allan_curve

RATE = 100.0
COUNT = 360_000
#: Random walk of the noise, rad/√s.
WALK = 3e-5


def no_progress(*_: object, **__: object) -> None:
    """Ignore progress reports."""


def covered(curve: AllanCurve, expected: np.ndarray) -> float:
    """Return the fraction of confidence intervals that contain the expected deviations."""
    return float(np.mean((curve.low < expected) & (expected < curve.high)))


@pytest.mark.parametrize("seed", range(3))
def test_white_noise_gives_its_angle_random_walk(seed: int) -> None:
    random = np.random.default_rng(seed)
    curve = allan_curve(1.0 + random.normal(0.0, WALK * np.sqrt(RATE), COUNT), RATE)
    assert curve.random_walk == pytest.approx(WALK, rel=0.01)
    assert curve.instability is None
    assert curve.largest_instability > 0.0
    assert covered(curve, WALK / np.sqrt(curve.tau)) > 0.75  # 95 % for each; neighbours depend on each other
    assert np.all(curve.low < curve.deviation)
    assert np.all(curve.deviation < curve.high)
    assert curve.tau[0] == pytest.approx(1.0 / RATE)
    assert curve.tau[-1] == pytest.approx(0.2 * COUNT / RATE, rel=0.01)


def test_rate_random_walk_grows_with_the_square_root_of_time() -> None:
    curve = allan_curve(np.cumsum(np.random.default_rng(4).normal(0.0, 1e-6 / np.sqrt(RATE), COUNT)), RATE)
    expected = 1e-6 * np.sqrt(curve.tau / 3.0)
    middle = (curve.tau > 0.1) & (curve.tau < 60.0)  # below, sampling; above, too few differences
    np.testing.assert_allclose(curve.deviation[middle], expected[middle], rtol=0.1)
    assert covered(curve, expected) > 0.75
    assert curve.random_walk is None
    assert curve.instability is None


def test_bias_instability_is_determined_from_the_flat_minimum() -> None:
    random = np.random.default_rng(5)
    steps = sum(  # one step per octave of time makes flicker noise: a random value held for 2^k samples
        np.repeat(random.normal(0.0, 1.0, -(-COUNT // 2**k)), 2**k)[:COUNT] for k in range(7, 15)
    )
    slow = np.cumsum(random.normal(0.0, 0.3 / np.sqrt(RATE), COUNT))
    curve = allan_curve(random.normal(0.0, WALK * np.sqrt(RATE), COUNT) + WALK * (steps + slow), RATE)
    lowest = int(np.argmin(curve.deviation))
    assert 0 < lowest < len(curve.tau) - 1
    assert curve.instability == pytest.approx(curve.deviation[lowest] / 0.664)
    assert curve.random_walk == pytest.approx(WALK, rel=0.1)


def written(path: Path, change: Callable[[np.ndarray, np.ndarray], None]) -> Path:
    """Write a log of one minute at rest with white gyro noise; `change` modifies the rates and the angles, rad."""
    seq = np.arange(round(60 * RATE))
    output = np.random.default_rng(6).normal(0.0, WALK * np.sqrt(RATE), (len(seq), 6))
    output[:, 5] += 9.8
    angles = np.zeros((len(seq), 2))
    change(output, angles)
    imu = {"serial": "SN-1", "sample_rate_hz": RATE, "output": "rate", "gyro_lsb": 1e-9, "accel_lsb": 1e-9}
    site = {"latitude_deg": 34.0, "longitude_deg": 109.0, "height_m": 400.0, "azimuth_deg": 0.0}
    meta = LogMeta.model_validate({"site": site, "imu": {**imu, "gyro_arw": WALK, "accel_vrw": WALK}})
    writer = RawLogWriter(path, meta)
    no, yes, cold = np.zeros(len(seq), np.int64), np.ones(len(seq), np.bool_), np.full(len(seq), np.nan)
    writer.append(SampleBlock("rate", seq, (seq + 1) / RATE, output / 1e-9, angles, no, yes, cold))
    writer.close("imported")
    return path


def turned(output: np.ndarray, angles: np.ndarray) -> None:
    """Rotate by 10° within one second after 20 s."""
    output[2000:2100, 2] += np.deg2rad(10.0)
    angles[:, 1] = np.deg2rad(np.clip((np.arange(len(angles)) - 2000) / 10.0, 0.0, 10.0))


def turned_unseen(output: np.ndarray, angles: np.ndarray) -> None:
    """Rotate in the same way without encoders."""
    turned(output, angles)
    angles[:] = np.nan


@pytest.mark.parametrize("motion", [turned, turned_unseen])
def test_range_with_table_motion_is_refused(motion: Callable[[np.ndarray, np.ndarray], None], tmp_path: Path) -> None:
    log = written(tmp_path / "log.h5", motion)
    with pytest.raises(InsufficientDataError) as refused:
        allan_deviation(no_progress, log, 0, 5999)
    assert refused.value.code == "solution.allan_moves"
    first, last = longest_rest(no_progress, log)
    assert first >= 2100
    assert last == 5999
    result = allan_deviation(no_progress, log, first, last)
    assert set(result.curves) == {f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz"}
    for curve in result.curves.values():
        assert curve.random_walk == pytest.approx(WALK, rel=0.1)
    assert result.profile is None
    assert result.quantisation == (0.0, 0.0)  # of a rate output it is white noise


def test_range_without_gyros_gives_only_accelerometers_and_a_short_range_none(tmp_path: Path) -> None:
    def without(output: np.ndarray, _: np.ndarray) -> None:
        output[:, :3] = np.nan

    log = written(tmp_path / "log.h5", without)
    assert set(allan_deviation(no_progress, log, 0, 5999).curves) == {"accel_x", "accel_y", "accel_z"}
    with pytest.raises(InsufficientDataError) as refused:
        allan_deviation(no_progress, log, 0, 900)
    assert refused.value.code == "solution.allan_short"
