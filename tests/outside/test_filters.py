"""Filters and coning compensation of a unit: named, and harmless if the profile states them."""

from typing import Any, Literal

import pytest

from tests.outside.sweep import Case, Outcome, run

SIMULATORS = pytest.mark.parametrize("simulator", ["bench", pytest.param("plain", marks=pytest.mark.long)])
Simulator = Literal["bench", "plain"]


def outcome(simulator: Simulator, setting: str, size: float, **imu_entries: Any) -> Outcome:
    """Calibrate a navigation-grade unit at 100 Hz with a designed schedule."""
    case = Case(setting, size, 1, "nav", "profile", simulator, 100.0, product="nav_a_fast", imu_entries=imu_entries)
    return run(case)


@SIMULATORS
@pytest.mark.parametrize(
    ("setting", "size", "cause", "entries"),
    [
        ("low_pass_ms", 5.0, "low_pass", {"bandwidth_hz": 31.8}),
        pytest.param("coning_compensation", 1.0, "coning", {"coning_compensated": True}, marks=pytest.mark.exhaustive),
    ],
)
def test_filter_is_named_unless_the_profile_states_it(
    simulator: Simulator, setting: str, size: float, cause: str, entries: dict[str, Any]
) -> None:
    found = outcome(simulator, setting, size)
    assert (found.passed, found.cause) == (False, f"designed effects: {cause}")
    corrected = outcome(simulator, setting, size, **entries)
    assert "designed effects" not in corrected.failed
    assert corrected.worst < 4.5


@SIMULATORS
@pytest.mark.parametrize("bandwidth", [53.0, pytest.param(24.0, marks=pytest.mark.exhaustive)])
def test_low_pass_with_another_bandwidth_than_stated_is_estimated(simulator: Simulator, bandwidth: float) -> None:
    """What remains of the filter after the stated one is removed is 30 times its sigma."""
    found = outcome(simulator, "low_pass_ms", 5.0, bandwidth_hz=bandwidth)
    assert found.passed
    assert found.worst < 3.5


@SIMULATORS
def test_late_gyro_is_named(simulator: Simulator) -> None:
    found = outcome(simulator, "gyro_delay_ms.y", 0.02)
    assert (found.passed, found.cause) == (False, "designed effects: channel_delay")
