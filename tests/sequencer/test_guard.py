"""No command is sent to the table unless its state and limits permit it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from calstation.devices import LOCAL_CONTROL, UNKNOWN_FAULT
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.messages import Text, os_reason
from calstation.physics import GimbalJoints, JointLimits, Move
from calstation.sequencer import check_power
from calstation.sequencer.guard import check_joints, check_motion, check_move, reason_of, safe_stop
from tests.helpers import raises_code
from tests.sequencer.fakes import LIMITS, FakeClock, FakeTable

GOOD = Move(1.0, -1.0, 0.5, 1.0)


def status(**changes: object) -> object:
    table = FakeTable(FakeClock(), enabled=True)
    return replace(table.status(), **changes)  # type: ignore[arg-type]


def test_valid_move_is_allowed() -> None:
    check_move(status(), LIMITS, GOOD)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"watchdog": 0.0}, "motion.watchdog_off"),
        ({"interlock_closed": False}, "motion.interlock_open"),
        ({"fault": "drive"}, "table.latched_drive"),
        ({"fault": "code 17"}, "table.latched_other"),
        ({"fault": UNKNOWN_FAULT}, "table.latched_unknown"),
        ({"fault": LOCAL_CONTROL}, "motion.local_control"),
    ],
)
def test_axes_are_not_enabled_in_an_unsafe_state(changes: dict[str, object], code: str) -> None:
    with raises_code(DeviceFaultError, code):
        check_power(status(**changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "code"),
    [({"enabled": False}, "motion.not_enabled"), ({"homed": False}, "motion.not_homed")],
)
def test_motion_requires_an_enabled_and_homed_table(changes: dict[str, object], code: str) -> None:
    with raises_code(DeviceFaultError, code):
        check_motion(status(**changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("move", "code"),
    [
        (replace(GOOD, outer=21.0), "motion.target_outside"),
        (replace(GOOD, inner=-21.0), "motion.target_outside"),
        (replace(GOOD, inner=float("nan")), "motion.target_outside"),
        (replace(GOOD, rate=1.1), "motion.rate_outside"),
        (replace(GOOD, rate=0.0), "motion.rate_outside"),
        (replace(GOOD, rate=float("nan")), "motion.rate_outside"),
        (replace(GOOD, acceleration=2.1), "motion.acceleration_outside"),
    ],
)
def test_moves_outside_the_limits_are_refused(move: Move, code: str) -> None:
    with raises_code(ConfigurationError, code):
        check_move(status(), LIMITS, move)  # type: ignore[arg-type]


def test_travel_limits_reported_by_the_table_are_checked() -> None:
    narrow = JointLimits((-0.5, -2.0), (0.5, 2.0))
    with raises_code(ConfigurationError, "motion.target_outside") as caught:
        check_move(status(limits=narrow), LIMITS, GOOD)  # type: ignore[arg-type]
    assert caught.value.values["axis"] == "outer"
    low, high = (math.degrees(limit) for limit in (-0.5, 0.5))
    assert caught.value.values == {"axis": "outer", "target_deg": math.degrees(1.0), "low_deg": low, "high_deg": high}


def test_travel_limits_of_the_profile_are_checked_on_a_table_with_more_travel() -> None:
    with raises_code(ConfigurationError, "motion.target_outside") as caught:
        check_move(status(), replace(LIMITS, low=(-20.0, -0.5)), GOOD)  # type: ignore[arg-type]
    assert caught.value.values["axis"] == "inner"


def test_move_may_use_the_limits_exactly_but_not_exceed_them() -> None:
    rate, acceleration = min(LIMITS.rate), min(LIMITS.acceleration)
    for factor in (1.0, 1.0 + 1e-9):  # after a conversion from degrees
        check_move(status(), LIMITS, replace(GOOD, rate=rate * factor, acceleration=acceleration * factor))  # type: ignore[arg-type]
    for changes, code in (
        ({"rate": rate * (1.0 + 1e-8)}, "motion.rate_outside"),
        ({"acceleration": acceleration * (1.0 + 1e-8)}, "motion.acceleration_outside"),
        ({"acceleration": 0.0}, "motion.acceleration_outside"),
        ({"acceleration": -0.1}, "motion.acceleration_outside"),
    ):
        with raises_code(ConfigurationError, code) as caught:
            check_move(status(), LIMITS, replace(GOOD, **changes))  # type: ignore[arg-type]
        (name, value), limit = *changes.items(), rate if "rate" in changes else acceleration
        assert caught.value.values == {"value": math.degrees(value), "allowed": math.degrees(limit)}, name


def test_motion_is_refused_for_the_reasons_of_the_axes_before_its_own() -> None:
    with raises_code(DeviceFaultError, "motion.interlock_open"):
        check_motion(status(interlock_closed=False, enabled=False))  # type: ignore[arg-type]
    with raises_code(DeviceFaultError, "motion.not_enabled"):
        check_move(status(enabled=False), LIMITS, GOOD)  # type: ignore[arg-type]


def test_joint_beyond_its_travel_is_named() -> None:
    gimbal = GimbalJoints("zyx", ((-1.0, 1.0), (-2.0, 2.0), (-3.0, 3.0)), 1.0)
    check_joints(gimbal, np.array([1.0, -2.0, 3.0]))
    with raises_code(DeviceFaultError, "motion.joint_outside") as caught:
        check_joints(gimbal, np.array([0.0, 2.5, 0.0]))
    degrees = {name: math.degrees(value) for name, value in (("angle", 2.5), ("low", -2.0), ("high", 2.0))}
    assert caught.value.values == {"axis": "y", **{f"{name}_deg": value for name, value in degrees.items()}}


class Turning(FakeTable):
    """A table that needs 2 s to stop, or forever if `stuck`."""

    def status(self) -> object:  # type: ignore[override]
        return replace(super().status(), moving=self.stuck or self.clock.time < 2.0)

    def heartbeat(self) -> None:
        self.beats += 1

    def disable(self) -> None:
        super().disable()
        self.commands[-1] += f" at {self.clock.time:.0f}"


@pytest.mark.parametrize(("stuck", "seconds"), [(False, 2), (True, 30)])
def test_axes_are_switched_off_at_rest_or_after_30_s_while_the_watchdog_is_fed(stuck: bool, seconds: int) -> None:
    table = Turning(clock := FakeClock(), enabled=True, stuck=stuck)
    assert safe_stop(table, clock) == []
    assert table.commands == ["stop", f"disable at {seconds}"]
    assert table.beats == pytest.approx(20 * seconds, abs=2)


@pytest.mark.parametrize("method", ["stop", "status", "heartbeat"])
def test_axes_of_a_table_that_does_not_respond_are_switched_off_after_5_s(
    method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(self: object) -> None:
        raise DeviceFaultError("link.lost", device="table", port="FAKE", reason="no answer")

    monkeypatch.setattr(Turning, method, fail)
    table = Turning(clock := FakeClock(), enabled=True)
    (reason,) = safe_stop(table, clock)
    assert reason.code == "link.lost"
    assert table.commands[-1] == "disable at 5"


def test_reason_of_an_error_is_its_message() -> None:
    assert reason_of(DeviceFaultError("motion.not_homed")) == Text("motion.not_homed")
    assert reason_of(error := OSError(28, "No space left on device")) == os_reason(error)
    assert reason_of(ValueError("odd")) == Text.of("os.other", words="odd")
    assert reason_of(ValueError()) == Text.of("os.other", words="ValueError")
