"""Protection of the table: checks before every command, and the safe stop."""

import logging
import math
import time
from collections.abc import Callable

from calstation.devices import LOCAL_CONTROL, Table, TableStatus, latched_fault_error
from calstation.errors import CalstationError, ConfigurationError, DeviceFaultError
from calstation.messages import Text, os_reason
from calstation.physics import AXES, JOINTS, FloatArray, GimbalJoints, JointLimits, Move
from calstation.sequencer.context import Clock

#: Maximum station time and host time for stopping, s.
_STOP_TIMEOUT = 30.0

#: Station time allowed for stopping if the table does not respond, s.
_UNRESPONSIVE_WAIT = 5.0

_TICK = 0.05

logger = logging.getLogger(__name__)


def check_power(status: TableStatus) -> None:
    """Check that the axes may be enabled.

    Raises DeviceFaultError if the table has a fault, its interlock is open or its watchdog is off.
    """
    if status.fault == LOCAL_CONTROL:
        raise DeviceFaultError("motion.local_control")
    if status.fault is not None:
        raise latched_fault_error(status.fault)
    if not status.interlock_closed:
        raise DeviceFaultError("motion.interlock_open")
    if not status.watchdog > 0.0:
        raise DeviceFaultError("motion.watchdog_off")


def check_motion(status: TableStatus) -> None:
    """Check that the table may move now.

    Raises DeviceFaultError for the reasons of `check_power`, or if the table is not enabled or not homed.
    """
    check_power(status)
    if not status.enabled:
        raise DeviceFaultError("motion.not_enabled")
    if not status.homed:
        raise DeviceFaultError("motion.not_homed")


def check_move(status: TableStatus, limits: JointLimits, move: Move) -> None:
    """Check that the table may move now, and that the move is within the limits of the profile and the table.

    Raises DeviceFaultError or ConfigurationError.
    """
    check_motion(status)
    check_limits(limits, move)
    check_travel(status.limits, move)


def check_limits(limits: JointLimits, move: Move) -> None:
    """Check travel, rate and acceleration of a move. Raises ConfigurationError."""
    for code, value, limit in (
        ("motion.rate_outside", move.rate, min(limits.rate)),
        ("motion.acceleration_outside", move.acceleration, min(limits.acceleration)),
    ):
        if not (math.isfinite(value) and 0.0 < value <= limit * (1.0 + 1e-9)):
            raise ConfigurationError(code, value=math.degrees(value), allowed=math.degrees(limit))
    check_travel(limits, move)


def check_travel(limits: JointLimits, move: Move) -> None:
    """Check that a move's targets are within the joints' travel. Raises ConfigurationError."""
    for joint, (axis, target) in enumerate(zip(JOINTS, (move.outer, move.inner), strict=True)):
        if not (math.isfinite(target) and limits.within(joint, target)):
            raise ConfigurationError(
                "motion.target_outside",
                axis=axis,
                target_deg=math.degrees(target),
                low_deg=math.degrees(limits.low[joint]),
                high_deg=math.degrees(limits.high[joint]),
            )


def check_joints(gimbal: GimbalJoints, joints: FloatArray) -> None:
    """Check that no joint angle x, y or z (rad, shape (3,)) is beyond its travel. Raises DeviceFaultError."""
    joint = gimbal.outside(joints)
    if joint is not None:
        low, high = gimbal.travel[joint]
        values = {"angle_deg": float(joints[joint]), "low_deg": low, "high_deg": high}
        degrees = {name: math.degrees(value) for name, value in values.items()}
        raise DeviceFaultError("motion.joint_outside", axis=AXES[joint], **degrees)


def safe_stop(table: Table, clock: Clock) -> list[Text]:
    """Bring the table to rest and switch its axes off; return any failures instead of raising them.

    A table that no longer responds is stopped by its watchdog, which was on when the axes were enabled. A table without
    a watchdog receives only moves to fixed angles; its axes are switched off after `_UNRESPONSIVE_WAIT`.
    """
    failures: list[Text] = []
    attempt(table.stop, failures)
    if not failures:
        attempt(lambda: _wait_for_rest(table, clock), failures)
    if failures:  # the axes may still turn, so they must not be switched off immediately
        attempt(lambda: clock.sleep(_UNRESPONSIVE_WAIT), failures)
    attempt(table.disable, failures)
    return failures


def _wait_for_rest(table: Table, clock: Clock) -> None:
    deadline, host_deadline = clock.now() + _STOP_TIMEOUT, time.monotonic() + _STOP_TIMEOUT
    while table.status().moving and clock.now() < deadline and time.monotonic() < host_deadline:
        table.heartbeat()
        clock.sleep(_TICK)


def attempt(action: Callable[[], None], failures: list[Text]) -> None:
    """Call an action of a safe stop, and append its failure instead of raising it."""
    try:
        action()
    except Exception as exc:  # the next action must be attempted after any failure
        logger.warning("safe stop: a command failed", exc_info=True)
        failures.append(reason_of(exc))


def reason_of(error: Exception) -> Text:
    """Return the message of an error for use in another message."""
    if isinstance(error, CalstationError):
        return error.as_text
    if isinstance(error, OSError):
        return os_reason(error)
    return Text.of("os.other", words=str(error) or type(error).__name__)
