"""Interfaces of a table and an IMU as used by the sequencer; all angles are in rad."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from calstation.errors import DeviceFaultError
from calstation.physics import FloatArray, IntArray, JointLimits

#: A table's `fault` under local control, when it accepts commands from its own panel only; not a latched fault.
LOCAL_CONTROL = "local control"

#: A table's `fault` if it reports a fault without a cause.
UNKNOWN_FAULT = "cause not told"


class OtherModelError(DeviceFaultError):
    """The replying device is not of the model that the profile names."""

    @property
    def found(self) -> str:
        """Model that replied."""
        return str(self.values["found"])

    @property
    def expected(self) -> str:
        """Model that the profile names."""
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
    """State of a table, from one poll.

    angles, rates : cumulative angles and rates of joints outer, inner, rad and rad/s, shape (2,); NaN if not measured
    enabled, homed, settled : whether both axes are in this state; moving : whether at least one axis moves
    fault : latched fault, or another reason why the table does not accept commands; None if there is none
    interlock_closed : whether the safety interlock is closed, so that the axes may be powered
    watchdog : timeout of the table's own watchdog, host seconds; 0 if it is off, infinite if there is none
    limits : travel as set in the table, with the rate and acceleration limits of the profile
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
    """A two-axis table. Every call is bounded in time and raises DeviceFaultError if it fails."""

    def identify(self) -> TableIdentity:
        """Return the model and serial number."""

    def status(self) -> TableStatus:
        """Poll the state of the table."""

    def enable(self) -> None:
        """Switch both axes on."""

    def disable(self) -> None:
        """Switch both axes off."""

    def home(self) -> None:
        """Start slow homing; `status` reports when it is done."""

    def move(self, outer: float, inner: float, rate: float, acceleration: float) -> None:
        """Start moving both joints to absolute angles, rad, with limits in rad/s and rad/s²; does not wait."""

    def rate(self, outer: float, inner: float, acceleration: float) -> None:
        """Rotate both joints until stopped, rad/s and rad/s²; does not wait.

        Raises ConfigurationError if the table would not stop automatically after a link loss: no active watchdog and no
        `link_loss_stop_s` in the profile.
        """

    def stop(self) -> None:
        """Decelerate to rest; does not wait."""

    def reset_fault(self) -> None:
        """Clear a latched fault; never restarts motion."""

    def heartbeat(self) -> None:
        """Feed the table's watchdog if it has one."""

    def close(self) -> None:
        """Close the link."""


class Gimbal(Table, Protocol):
    """A three-joint gimbal that stabilises the unit on its corrected rates; `home` returns to zero and locks."""

    def lock(self) -> None:
        """Lock the joints; from then on, the gyro output is averaged as the gyro bias."""

    def stabilise(self) -> None:
        """Hold the unit at rest in space."""

    def turn(self, axis: int, angle: float, rate: float) -> None:
        """Start a turn about a body axis, rad and rad/s, with the others stabilised; does not wait."""


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
    time : IMU clock at the end of each sample, s, shape (n,)
    counts : gyro x y z, accel x y z, shape (n, 6)
    temperature : °C, shape (n,); NaN if the frames do not contain it
    status : status word, shape (n,); 0 if the frames do not contain it
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

    frames, bytes : number received
    crc_errors : frames with a wrong checksum
    skipped : bytes outside frames
    gaps, restarts : interruptions of the counter, and the number of these due to restarts
    """

    frames: int = 0
    bytes: int = 0
    crc_errors: int = 0
    skipped: int = 0
    gaps: int = 0
    restarts: int = 0


class Imu(Protocol):
    """An IMU. Calls raise DeviceFaultError if the link or the unit fails."""

    @property
    def stats(self) -> LinkStats:
        """Counts since the link was opened."""

    def start(self, *, corrected: bool = False) -> None:
        """Start the stream: raw or, if `corrected`, with the registers applied as the profile specifies.

        Only samples of this stream are read from then on. A restart of the unit returns it to the raw stream.
        """

    def wake(self, check_cancelled: Callable[[], None], *, corrected: bool = False) -> ImuIdentity | None:
        """Identify a unit that may have restarted, retrying for as long as a restart may take, then `start` it.

        `check_cancelled` is called between attempts and may raise. Returns None if the unit accepts no commands.
        """

    def read(self) -> SampleBatch:
        """Return all samples decoded since the last call, possibly none; never waits.

        Raises NoFramesError if bytes arrive but none belong to a frame.
        """

    def identify(self) -> ImuIdentity:
        """Return the model, serial number and firmware."""

    def read_registers(self) -> dict[str, float]:
        """Return the calibration registers by contract parameter name, SI."""

    def write_registers(self, values: Mapping[str, float]) -> None:
        """Write calibration registers (volatile until `commit`)."""

    def commit(self) -> None:
        """Store the registers permanently in flash."""

    def reset(self) -> None:
        """Restart the unit and wait until it has restarted; its registers then have the values of its flash."""

    def close(self) -> None:
        """Close the link."""
