"""No command leaves for the table unless everything about it is right."""

from dataclasses import replace

import pytest

from calstation.devices.interfaces import UNTOLD
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.physics.motion import Move
from calstation.physics.table import JointLimits
from calstation.sequencer.guard import check_motion, check_move, check_power
from tests.sequencer.fakes import LIMITS, FakeClock, FakeTable

GOOD = Move(1.0, -1.0, 0.5, 1.0)


def status(**changes: object) -> object:
    table = FakeTable(FakeClock(), enabled=True)
    return replace(table.status(), **changes)  # type: ignore[arg-type]


def test_a_proper_move_is_allowed() -> None:
    check_move(status(), LIMITS, GOOD)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"watchdog": 0.0}, "watchdog"),
        ({"interlock_closed": False}, "interlock"),
        ({"fault": "drive"}, "table: fault 'drive' is latched; remove its cause, then reset it"),
        ({"fault": UNTOLD}, "table: fault, it tells no cause; read its display, .*, then reset it"),
    ],
)
def test_power_is_refused(changes: dict[str, object], word: str) -> None:
    with pytest.raises(DeviceFaultError, match=word):
        check_power(status(**changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(("changes", "word"), [({"enabled": False}, "enabled"), ({"homed": False}, "homed")])
def test_motion_is_refused(changes: dict[str, object], word: str) -> None:
    with pytest.raises(DeviceFaultError, match=word):
        check_motion(status(**changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("move", "word"),
    [
        (replace(GOOD, outer=21.0), "outer axis target"),
        (replace(GOOD, inner=-21.0), "inner axis target"),
        (replace(GOOD, inner=float("nan")), "inner axis target"),
        (replace(GOOD, rate=1.1), "rate"),
        (replace(GOOD, rate=0.0), "rate"),
        (replace(GOOD, rate=float("nan")), "rate"),
        (replace(GOOD, acceleration=2.1), "acceleration"),
    ],
)
def test_moves_outside_the_limits_are_refused(move: Move, word: str) -> None:
    with pytest.raises(ConfigurationError, match=word):
        check_move(status(), LIMITS, move)  # type: ignore[arg-type]


def test_the_tables_own_travel_counts_too() -> None:
    narrow = JointLimits((-0.5, -2.0), (0.5, 2.0))
    with pytest.raises(ConfigurationError, match="outer"):
        check_move(status(limits=narrow), LIMITS, GOOD)  # type: ignore[arg-type]
