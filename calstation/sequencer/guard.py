"""Checks made before every command to the table; each refusal is a sentence with its mend."""

import math

from calstation.devices.interfaces import LOCAL_CONTROL, UNTOLD, TableStatus
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.physics.motion import Move
from calstation.physics.table import JointLimits

JOINTS = ("outer", "inner")


def check_power(status: TableStatus) -> None:
    """May the axes be enabled? Raises DeviceFaultError where fault, interlock or watchdog say no."""
    if status.fault == LOCAL_CONTROL:
        raise DeviceFaultError(
            "table: it is under local control; switch it to remote control, then start again"
        )
    if status.fault is not None:
        raise latched(status.fault, " is latched")
    if not status.interlock_closed:
        raise DeviceFaultError("table: the interlock is open; close the cover and start again")
    if not status.watchdog > 0.0:
        raise DeviceFaultError(
            "table: the watchdog is off (0); set its timeout in the drive, e.g. 1000 ms, before any run"
        )


def latched(fault: str, how: str = "") -> DeviceFaultError:
    """What is said of a fault that the table has latched."""
    reset = "reset it: 'Reset the fault' in the window, or calstation table reset"
    if fault == UNTOLD:
        return DeviceFaultError(
            "table: fault, it tells no cause; read its display, look at cover, limits and drives, remove the cause,"
            f" then {reset}"
        )
    return DeviceFaultError(f"table: fault '{fault}'{how}; remove its cause, then {reset}")


def check_motion(status: TableStatus) -> None:
    """May the table move now? `check_power`, and the axes enabled and homed. Raises DeviceFaultError."""
    check_power(status)
    if not status.enabled:
        raise DeviceFaultError("table: the axes are not enabled; check the drive's enable input")
    if not status.homed:
        raise DeviceFaultError("table: the axes are not homed; home the table first")


def check_move(status: TableStatus, limits: JointLimits, move: Move) -> None:
    """May the table make this move now? Raises DeviceFaultError or ConfigurationError with the reason."""
    check_motion(status)
    check_limits(limits, move)
    check_travel(status.limits, move)


def check_limits(limits: JointLimits, move: Move) -> None:
    """Does a move lie within travel, rate and acceleration? Raises ConfigurationError where not."""
    for name, value, bounds, unit in (
        ("rate", move.rate, limits.rate, "°/s"),
        ("acceleration", move.acceleration, limits.acceleration, "°/s²"),
    ):
        allowed = min(bounds)
        if not (math.isfinite(value) and 0.0 < value <= allowed * (1.0 + 1e-9)):
            raise ConfigurationError(
                f"schedule: {name} {math.degrees(value):g} {unit} is outside the table's "
                f"0 to {math.degrees(allowed):g} {unit}; change it in the product's schedule"
            )
    check_travel(limits, move)


def check_travel(limits: JointLimits, move: Move) -> None:
    """Do a move's targets lie within the joints' travel? Raises ConfigurationError where not."""
    for joint, (name, target) in enumerate(zip(JOINTS, (move.outer, move.inner), strict=True)):
        if not (math.isfinite(target) and limits.within(joint, target)):
            raise ConfigurationError(
                f"schedule: {name} axis target {math.degrees(target):.1f}° is outside the table's travel "
                f"{math.degrees(limits.low[joint]):.0f}° to {math.degrees(limits.high[joint]):.0f}°; "
                "change the schedule, or the travel in the table profile"
            )
