"""No command is sent to the table unless its state and limits permit it."""

from dataclasses import replace

import pytest

from calstation.devices import LOCAL_CONTROL, UNKNOWN_FAULT
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.physics import JointLimits, Move
from calstation.sequencer import check_power
from calstation.sequencer.guard import check_motion, check_move
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
