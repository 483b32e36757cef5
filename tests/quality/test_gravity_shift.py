"""A step of the accelerometer scale factors that is common to all units of a station reveals an error of gravity."""

import numpy as np
import pytest

from calstation.physics import FloatArray, IntArray
from calstation.quality import common_step

PPM = 1e-6


def history(seed: int, spread: float, golden_every: int = 5, count: int = 60) -> tuple[FloatArray, IntArray]:
    """Return mean scale factors of new units, and of one golden unit that is repeated; repeatability 3 ppm."""
    random = np.random.default_rng(seed)
    unit = np.array([0 if k % golden_every == 0 else k for k in range(count)])
    own = spread * random.standard_normal(count)
    return own[unit] + 3.0 * PPM * random.standard_normal(count), np.unique(unit, return_inverse=True)[1]


@pytest.mark.parametrize("spread", [20.0, 500.0])
def test_gravity_profile_with_another_value_is_found(spread: float) -> None:
    """9.8 instead of 9.80665 m/s² moves every scale factor by 679 ppm, more than units differ."""
    values, unit = history(1, spread * PPM)
    values[40:] += 679.0 * PPM
    step = common_step(values, unit)
    assert step is not None
    assert step[0] == 40
    assert step[1] == pytest.approx(679.0 * PPM, abs=4.0 * step[2])


def test_small_step_is_found_from_two_golden_units() -> None:
    random = np.random.default_rng(2)
    unit = np.arange(40) % 2
    values = np.array([2e-3, -1e-3])[unit] + 3.0 * PPM * random.standard_normal(40)
    values[25:] += 50.0 * PPM
    step = common_step(values, unit)
    assert step is not None
    assert step[0] == 25
    assert step[1] == pytest.approx(50.0 * PPM, abs=4.0 * step[2])


def test_change_of_a_single_unit_is_no_error_of_gravity() -> None:
    values, unit = history(3, 100.0 * PPM)
    changed = (unit == 0) & (np.arange(len(values)) >= 30)
    values[changed] += 50.0 * PPM
    assert common_step(values, unit) is None


@pytest.mark.long
def test_sound_histories_raise_no_alarm() -> None:
    alarms = [common_step(*history(seed, spread * PPM)) for seed in range(100) for spread in (20.0, 300.0)]
    assert sum(step is not None for step in alarms) <= 1
