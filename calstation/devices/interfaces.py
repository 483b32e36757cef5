"""Interfaces of a table, a chamber and an IMU for the sequencer; all angles are in rad, temperatures in °C."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from calstation.errors import DeviceFaultError
from calstation.physics import FloatArray, IntArray, JointLimits

#: `fault` of a table under local control, which accepts commands only from its own panel; this fault is not latched.
LOCAL_CONTROL = "local control"

#: `fault` of a table that reports a fault without its cause.
UNKNOWN_FAULT = "cause not told"

#: Names of latched faults that have a message of their own.
_LATCHED = ("interlock", "watchdog", "limit", "drive", "stall")


def latched_fault_error(fault: str) -> DeviceFaultError:
    """Return the error for a latched fault of the table, given by its name in the table profile."""
    if fault == UNKNOWN_FAULT:
        return DeviceFaultError("table.latched_unknown")
    return DeviceFaultError(f"table.latched_{fault if fault in _LATCHED else 'other'}", fault=fault)


class OtherModelError(DeviceFaultError):
    """The device that replies is of a different model than the profile."""

    @property
    def found(self) -> str:
        """Model that replied."""
        return str(self.values["found"])

    @property
    def expected(self) -> str:
        """Model in the profile."""
        return str(self.values["expected"])


class NoFramesError(DeviceFaultError):
    """Bytes arrive on the IMU's link, but none belong to a frame."""


@dataclass(frozen=True)
class TableIdentity:
    """Model and serial number that a table reports."""

    model: str
    serial: str


@dataclass(frozen=True)
class TableStatus:
    """State of a table, as returned by one poll.

    angles, rates : cumulative angles and rates of the outer and inner joint, rad and rad/s, shape (2,); NaN if unknown
    enabled, homed, settled : whether both axes are in this state
    moving : whether at least one axis moves
    fault : latched fault, or another reason why the table does not accept commands, or None
    interlock_closed : whether the safety interlock is closed, so that the axes may be powered
    watchdog : timeout of the table's watchdog, host time in s; 0 if it is off, infinite if there is none
    limits : travel as configured in the table, with the rate and acceleration limits of the profile
    joints, joint_rates : angles and rates of a gimbal's joints x, y, z, rad and rad/s, shape (3,); None for a table
    """

    angles: FloatArray
    rates: FloatArray
    enabled: bool
    homed: bool
    moving: bool
    settled: bool
    fault: str | None
    interlock_closed: bool
    watchdog: float
    limits: JointLimits
    joints: FloatArray | None = None
    joint_rates: FloatArray | None = None


class Table(Protocol):
    """A two-axis table. Every call has a time limit and raises DeviceFaultError if it fails."""

    def identify(self) -> TableIdentity:
        """Return the model and serial number."""

    def status(self) -> TableStatus:
        """Poll the state of the table."""

    def enable(self) -> None:
        """Switch both axes on."""

    def disable(self) -> None:
        """Switch both axes off."""

    def home(self) -> None:
        """Start slow homing; `status` reports when it is complete."""

    def move(self, outer: float, inner: float, rate: float, acceleration: float) -> None:
        """Start moving both joints to absolute angles without waiting.

        Parameters
        ----------
        outer, inner : target angles, rad
        rate, acceleration : limits of the motion, rad/s and rad/s²
        """

    def rate(self, outer: float, inner: float, acceleration: float) -> None:
        """Start rotating both joints, without waiting; they rotate until they are stopped.

        Raises ConfigurationError if the table would not stop after a link loss, because it has no active watchdog and
        the profile no `link_loss_stop_s`.

        Parameters
        ----------
        outer, inner : rates, rad/s
        acceleration : acceleration of both joints, rad/s²
        """

    def stop(self) -> None:
        """Start decelerating to rest without waiting."""

    def reset_fault(self) -> None:
        """Clear a latched fault; this never starts a motion."""

    def heartbeat(self) -> None:
        """Feed the table's watchdog if it has one."""

    def close(self) -> None:
        """Close the link."""


class Gimbal(Table, Protocol):
    """A three-joint gimbal, which stabilises the unit with its corrected rates; `home` moves to zero and locks."""

    def lock(self) -> None:
        """Lock the joints and start to average the gyro output, which gives the gyro bias."""

    def stabilise(self) -> None:
        """Hold the unit at rest in space."""

    def turn(self, axis: int, angle: float, rate: float) -> None:
        """Start a turn about a body axis with the other axes stabilised, without waiting.

        Parameters
        ----------
        axis : index of the body axis
        angle, rate : angle and rate of the turn, rad and rad/s
        """


@dataclass(frozen=True)
class ChamberStatus:
    """State of a thermal chamber, as returned by one poll.

    air_c, set_point_c : air temperature measured by the chamber, and its set point, °C
    running : whether the chamber controls its temperature
    door_open : whether the door is open; None if the chamber does not report it
    alarm : name of the alarm, or None
    """

    air_c: float
    set_point_c: float
    running: bool
    door_open: bool | None = None
    alarm: str | None = None


class Chamber(Protocol):
    """A thermal chamber. Every call has a time limit and raises DeviceFaultError if it fails."""

    def identify(self) -> str:
        """Return the identity that the chamber reports, or the model in the profile if it reports none."""

    def status(self) -> ChamberStatus:
        """Poll the state of the chamber."""

    def set_point(self, temperature_c: float) -> None:
        """Set the temperature of the air, °C, without waiting; this does not start the chamber."""

    def start(self) -> None:
        """Start controlling the temperature at the set point."""

    def stop(self) -> None:
        """Stop controlling the temperature, after which it drifts."""

    def close(self) -> None:
        """Close the link; the chamber keeps its state."""


@dataclass(frozen=True)
class ImuIdentity:
    """Model, serial number and firmware that a unit reports."""

    model: str
    serial: str
    firmware: str


@dataclass(frozen=True)
class SampleBatch:
    """Samples decoded since the last read.

    seq : unwrapped counter, shape (n,)
    time : IMU time at the end of each sample, s, shape (n,)
    counts : counts of gyro x, y, z and accel x, y, z, shape (n, 6)
    temperature : temperature, °C, shape (n,); NaN if the frames have none
    status : status word, shape (n,); 0 if the frames have none
    arrival : host monotonic time at which each sample's bytes were read, s, shape (n,)
    """

    seq: IntArray
    time: FloatArray
    counts: FloatArray
    temperature: FloatArray
    status: IntArray
    arrival: FloatArray

    def __len__(self) -> int:
        return len(self.seq)


@dataclass(frozen=True)
class LinkStats:
    """Counts since the link was opened.

    frames, bytes : number of frames and bytes received
    crc_errors : number of frames with a wrong checksum
    skipped : number of bytes outside frames
    gaps, restarts : number of interruptions of the counter, and number of interruptions by a restart of the unit
    """

    frames: int = 0
    bytes: int = 0
    crc_errors: int = 0
    skipped: int = 0
    gaps: int = 0
    restarts: int = 0


class Imu(Protocol):
    """An IMU, whose methods raise DeviceFaultError if the link or the unit fails."""

    @property
    def stats(self) -> LinkStats:
        """Counts since the link was opened."""

    def start(self, *, corrected: bool = False) -> None:
        """Start the raw stream or, if `corrected`, the stream with the registers applied.

        `read` then returns only samples of this stream. After a restart, the unit sends the raw stream again.
        """

    def wake(self, check_cancelled: Callable[[], None], *, corrected: bool = False) -> ImuIdentity | None:
        """Wait for a unit that may be restarting, `start` its stream and return its identity.

        The unit is identified repeatedly for as long as a restart may take; `check_cancelled` is called between the
        attempts and may raise an exception. Returns None if the unit accepts no commands.
        """

    def read(self) -> SampleBatch:
        """Return all samples decoded since the last call, possibly none, without waiting.

        Raises NoFramesError if bytes arrive but none belong to a frame.
        """

    def identify(self) -> ImuIdentity:
        """Return the model, serial number and firmware."""

    def read_registers(self) -> dict[str, float]:
        """Return the calibration registers by parameter name, SI."""

    def write_registers(self, values: Mapping[str, float]) -> None:
        """Write calibration registers by parameter, SI, which are volatile until `commit` is called."""

    def commit(self) -> None:
        """Store the registers permanently in flash."""

    def reset(self) -> None:
        """Restart the unit and wait until its registers have the values of its flash."""

    def close(self) -> None:
        """Close the link."""
