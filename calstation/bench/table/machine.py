"""The state machine of the table: CiA 402 drive states, homing, moves, limits, interlock, faults and watchdog.

Motion uses device time; the watchdog counts host time. Angles are in rad, rates in rad/s, accelerations in rad/s².
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, IntEnum

import numpy as np

from calstation.bench.truth import TableDrive
from calstation.physics import FloatArray


class Fault(IntEnum):
    """Latched faults."""

    NONE = 0
    INTERLOCK = 1
    WATCHDOG = 2
    LIMIT = 3
    DRIVE = 4
    STALL = 5


class Power(Enum):
    """Drive states, with their statusword bits (CiA 402-2, table 29)."""

    DISABLED = 0x40
    READY = 0x21
    ON = 0x23
    ENABLED = 0x27


@dataclass(frozen=True)
class Clocks:
    """Functions that return device time, host time, and the device time at which a polled position was sampled, s."""

    device: Callable[[], float]
    host: Callable[[], float]
    reading: Callable[[], float]


class Refusal(Exception):  # noqa: N818 - a reply of the protocol, not an error of the program
    """The controller refused a command."""


class OutOfRange(Refusal):
    """The target, rate or acceleration is outside the table's limits."""


class NoSuchRegister(Refusal):
    """The register does not exist or is read-only."""


class NotPermitted(Refusal):
    """The table is not enabled, not homed, in fault, halted or moving."""


@dataclass(frozen=True)
class TableLimits:
    """Travel of outer and inner joint, largest rate and acceleration of both, and homing rate."""

    low: tuple[float, float] = (-6.0 * np.pi, -6.0 * np.pi)
    high: tuple[float, float] = (6.0 * np.pi, 6.0 * np.pi)
    rate: float = np.deg2rad(120.0)
    acceleration: float = np.deg2rad(200.0)
    homing_rate: float = np.deg2rad(5.0)


#: Time for which both joints must be settled before the target is reached, s.
SETTLING_TIME = 0.1

QUICK_STOP_BIT, FAULT_BIT, REMOTE_BIT, REACHED_BIT = 1 << 5, 1 << 3, 1 << 9, 1 << 10
LIMIT_BIT, HOMED_BIT, MOVING_BIT = 1 << 11, 1 << 12, 1 << 14

#: Amplitude, rad, and frequency, Hz, of joints that oscillate about their target.
HUNTING = (np.deg2rad(0.02), 1.3)

#: Distance of the limit switches from the end of travel, rad, so that a move to the end of travel does not trip them.
SWITCH_DISTANCE = np.deg2rad(0.5)


class TableMachine:
    """The state of the controller and its joints; `watchdog` is the timeout in host time, s, or 0.

    Faults can be injected: the joints are blocked while `jammed`, do not settle until `unsettled_until` (device time,
    s), and exceed the target of the next move by `overshoot`, rad.
    """

    def __init__(
        self, drive: TableDrive, limits: TableLimits, *, interlock_closed: bool = True, watchdog: float = 2.0
    ) -> None:
        self.drive = drive
        self.limits = limits
        self.watchdog = watchdog
        self.fault = Fault.NONE
        self.power = Power.DISABLED
        self.homed = False
        self.interlock_closed = interlock_closed
        self._controlword = 0
        self._homing = False
        self.jammed = False
        self.unsettled_until = -np.inf
        self.overshoot = 0.0
        self._fed: float | None = None
        # Encoder angles are relative to the angles at power-on until homing.
        self._zero = drive.states(0.0)[:, 0]

    def set_interlock(self, closed: bool, time: float) -> None:
        """Open or close the interlock; opening causes a fault."""
        self.interlock_closed = closed
        if not closed:
            self.trip(Fault.INTERLOCK, time)

    def trip(self, fault: Fault, time: float) -> None:
        """Decelerate, disable the axes and latch the fault, unless another fault is already latched."""
        self.stop(time)
        self.power = Power.DISABLED
        if self.fault is Fault.NONE:
            self.fault = fault

    def feed(self, host_time: float) -> None:
        """Feed the watchdog at `host_time`, s."""
        self._fed = host_time

    def watch(self, host_time: float, time: float) -> None:
        """Trip the watchdog fault if the axes are enabled and the watchdog was not fed in time."""
        if self.power is not Power.ENABLED or self.watchdog == 0.0 or self._fed is None:
            return
        if host_time - self._fed > self.watchdog:
            self.trip(Fault.WATCHDOG, time)

    def advance(self, time: float) -> None:
        """Finish homing once the joints have settled at home."""
        if self._homing and self.settled(time):
            self._homing = False
            self.set_zero()

    def set_zero(self) -> None:
        """Set the zero of the encoder angles to home, after homing or with absolute encoders."""
        self.homed = True
        self._zero = np.zeros(2)

    def jam(self, time: float) -> None:
        """Block the joints until a reset; the controller does not detect this."""
        self.stop(time)
        self.jammed = True

    def settled(self, time: float) -> bool:
        """Return whether both joints have been at rest for the settling time."""
        return not self.jammed and time >= max(self.drive.settled + SETTLING_TIME, self.unsettled_until)

    def control(self, word: int, time: float, host_time: float) -> None:
        """Process a controlword (0x06 ready, 0x07 on, 0x0F enable; b2 = 0 quick stop, b7 reset, b8 halt).

        Parameters
        ----------
        word : controlword
        time, host_time : device time and host time, s
        """
        reset = bool(word & 0x80) and not self._controlword & 0x80
        self._controlword = word
        self.jammed &= not reset
        if reset and self.interlock_closed and self.settled(time):
            self.fault = Fault.NONE
        if self.fault is not Fault.NONE:
            return
        command = word & 0x0F
        if not command & 0x02 or not command & 0x04:
            # "Disable voltage" and "quick stop" decelerate the joints and switch the axes off.
            self.stop(time)
            self.power = Power.DISABLED
        elif command & 0x07 == 0x06:
            self.stop(time)
            self.power = Power.READY
        elif command == 0x07:
            self.stop(time)
            if self.power is not Power.DISABLED:
                self.power = Power.ON
        elif command == 0x0F and self.power in (Power.READY, Power.ON) and self.interlock_closed:
            self.power = Power.ENABLED
            self.feed(host_time)
        if word & 0x100:
            self.stop(time)

    def home(self, time: float) -> None:
        """Start moving to home at the homing rate. Raises NotPermitted."""
        self._check_permitted(time)
        rate = self.limits.homing_rate
        self.drive.move(time, (0.0, 0.0), (rate, rate), (self.limits.acceleration / 10.0,) * 2)
        self._homing = True

    def move(
        self, time: float, targets: tuple[float, float], rates: tuple[float, float], accelerations: tuple[float, float]
    ) -> None:
        """Start moving both joints, unless the same move is in progress. Raises a `Refusal`.

        Parameters
        ----------
        time : device time, s
        targets : target angles of outer and inner joint, rad
        rates, accelerations : limits of the motion of each joint, rad/s and rad/s²
        """
        for joint in (0, 1):
            self._check_limits(joint, targets[joint], rates[joint], accelerations[joint])
        if not self.homed:
            raise NotPermitted
        going = time < self.drive.end and targets == tuple(p.target for p in self.drive.profiles)
        if going and self.power is Power.ENABLED:
            return
        self._check_permitted(time)
        beyond, self.overshoot = self.overshoot, 0.0
        if not self.jammed:
            self.drive.move(time, (targets[0] + beyond, targets[1] + beyond), rates, accelerations)

    def move_joint(self, time: float, joint: int, target: float, rate: float, acceleration: float) -> None:
        """Start moving one joint alone, unless the same move is in progress. Raises a `Refusal`.

        Parameters
        ----------
        time : device time, s
        joint : 0 for the outer joint, 1 for the inner one
        target : target angle, rad
        rate, acceleration : limits of the motion, rad/s and rad/s²
        """
        if self._may_start(time, joint, target, rate, acceleration):
            beyond, self.overshoot = self.overshoot, 0.0
            if not self.jammed:
                self.drive.move_joint(time, joint, target + beyond, rate, acceleration)

    def _may_start(self, time: float, joint: int, target: float, rate: float, acceleration: float) -> bool:
        """Check a move of a joint; return False if it is already moving to `target`. Raises a `Refusal`."""
        self._check_limits(joint, target, rate, acceleration)
        if not self.homed:
            raise NotPermitted
        profile = self.drive.profiles[joint]
        if time < profile.end and profile.target == target and self.power is Power.ENABLED:
            return False
        self._check_permitted(time, profile.end)
        return True

    def turn(self, time: float, rates: tuple[float, float], accelerations: tuple[float, float]) -> None:
        """Turn both joints at these rates until they are stopped or reach the end of travel. Raises a `Refusal`.

        Parameters
        ----------
        time : device time, s
        rates, accelerations : rate and acceleration of each joint, rad/s and rad/s²
        """
        turns = [(joint, rates[joint], accelerations[joint]) for joint in (0, 1)]
        for turn in turns:  # both are checked before either starts
            self._end_of_turn(time, *turn)
        for turn in turns:
            self.turn_joint(time, *turn)

    def turn_joint(self, time: float, joint: int, rate: float, acceleration: float) -> None:
        """Turn one joint independently of the other. Raises a `Refusal`.

        Parameters
        ----------
        time : device time, s
        joint : 0 for the outer joint, 1 for the inner one
        rate, acceleration : rate and acceleration, rad/s and rad/s²
        """
        end = self._end_of_turn(time, joint, rate, acceleration)
        if end is not None and not self.jammed:
            self.drive.move_joint(time, joint, end, abs(rate), acceleration)

    def _end_of_turn(self, time: float, joint: int, rate: float, acceleration: float) -> float | None:
        """Return the end of travel to which a joint starts to turn, or None if it does not. Raises a `Refusal`."""
        if rate == 0.0:
            self._check_permitted(time, self.drive.profiles[joint].end)
            return None
        end = (self.limits.high if rate > 0.0 else self.limits.low)[joint]
        return end if self._may_start(time, joint, end, abs(rate), acceleration) else None

    def positions(self, time: float) -> FloatArray:
        """Return the encoder angles of the joints, rad, shape (2,)."""
        angles = np.asarray(self.drive.readings(np.array([time]))[0] - self._zero)
        if time < self.unsettled_until:
            angles += HUNTING[0] * np.sin(2.0 * np.pi * HUNTING[1] * time)
        return angles

    def statusword(self, time: float) -> int:
        """Return the CiA 402 statusword with the table's own bits."""
        word = REMOTE_BIT | (self.power.value if self.fault is Fault.NONE else FAULT_BIT)
        # Active low: 0 means that a quick stop (b1 set, b2 not) is active.
        word = word & ~QUICK_STOP_BIT if self._controlword & 0x06 == 0x02 else word | QUICK_STOP_BIT
        word |= REACHED_BIT if self.settled(time) else MOVING_BIT
        word |= HOMED_BIT * self.homed
        angles = self.drive.states(time)[:, 0]
        beyond = angles - np.clip(angles, self.limits.low, self.limits.high)
        if np.any(np.abs(beyond) > SWITCH_DISTANCE):
            word |= LIMIT_BIT
        return word

    def _check_limits(self, joint: int, target: float, rate: float, acceleration: float) -> None:
        limits = self.limits
        inside = limits.low[joint] <= target <= limits.high[joint]
        if not (inside and 0.0 < rate <= limits.rate and 0.0 < acceleration <= limits.acceleration):
            raise OutOfRange

    def _check_permitted(self, time: float, end: float | None = None) -> None:
        """Raise NotPermitted unless a motion may start after `end`, by default the end of the motion of both joints."""
        halted = bool(self._controlword & 0x100)
        ready = self.power is Power.ENABLED and self.fault is Fault.NONE and self.interlock_closed
        if not ready or halted or time < (self.drive.end if end is None else end):
            raise NotPermitted

    def stop(self, time: float) -> None:
        """Decelerate to rest; the axes stay enabled."""
        self._homing = False
        self.drive.stop(time, (self.limits.acceleration,) * 2)
