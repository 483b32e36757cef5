"""Interfaces of a table and an IMU, as the sequencer uses them; all angles in rad."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from calstation.errors import DeviceFaultError
from calstation.physics import FloatArray, IntArray, JointLimits

#: A table's `fault` while it is under local control and obeys its own panel only; not a latched fault.
LOCAL_CONTROL = "local control"

#: A table's `fault` if it reports a fault without its cause.
UNKNOWN_FAULT = "cause not told"


class OtherModelError(DeviceFaultError):
    """Another device than the profile's answers."""

    @property
    def found(self) -> str:
        return str(self.values["found"])

    @property
    def expected(self) -> str:
        return str(self.values["expected"])


class NoFramesError(DeviceFaultError):
    """Bytes arrive on the IMU's link, but none of them belong to a frame."""


@dataclass(frozen=True)
class TableIdentity:
    model: str
    serial: str


@dataclass(frozen=True)
class TableStatus:
    """State of a table, from one poll.

    angles, rates : of the joints outer, inner, cumulative, rad and rad/s, shape (2,); NaN if not measured
    enabled, homed, moving, settled : of both axes
    fault : latched fault, or another reason why the table does not obey; None if there is none
    interlock_closed : whether the axes may be powered
    watchdog : timeout of the table's own watchdog, host seconds; 0 if it is off, infinite if there is none
    limits : travel set in the table; rates and accelerations are the profile's
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


class Table(Protocol):
    """A two-axis table. Every call is bounded in time and raises DeviceFaultError if it fails."""

    def identify(self) -> TableIdentity:
        """Model and serial number."""

    def status(self) -> TableStatus:
        """Poll the table."""

    def enable(self) -> None:
        """Switch both axes on."""

    def disable(self) -> None:
        """Switch both axes off."""

    def home(self) -> None:
        """Start slow homing; `status` reports when it is done."""

    def move(self, outer: float, inner: float, rate: float, acceleration: float) -> None:
        """Start both joints towards absolute angles, rad, with rad/s and rad/s² at most; does not wait."""

    def rate(self, outer: float, inner: float, acceleration: float) -> None:
        """Turn both joints endlessly, rad/s and rad/s², until stopped; does not wait. Raises ConfigurationError if the
        table would not stop by itself after a lost link: no active watchdog, and no stop of its own in the profile.
        """

    def stop(self) -> None:
        """Decelerate to rest; does not wait."""

    def reset_fault(self) -> None:
        """Clear a latched fault; never restarts motion."""

    def heartbeat(self) -> None:
        """Feed the table's watchdog if it has one."""

    def close(self) -> None:
        """Close the link."""


@dataclass(frozen=True)
class ImuIdentity:
    model: str
    serial: str
    firmware: str


@dataclass(frozen=True)
class SampleBatch:
    """Samples decoded since the last read.

    seq : unwrapped counter, shape (n,)
    time : IMU clock at the end of each sample, s, shape (n,)
    counts : gyro x y z, accel x y z, shape (n, 6)
    temperature : °C, shape (n,); NaN if the frames carry none
    status : status word, shape (n,); 0 if the frames carry none
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

    frames, bytes : received
    crc_errors : frames with a wrong check
    skipped : bytes that belong to no frame
    gaps, restarts : interruptions of the counter, and restarts among them
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
        """Counts so far."""

    def start(self, *, corrected: bool = False) -> None:
        """Begin to stream; `corrected`: with the registers applied, if the profile states how.

        What is read from then on is of that kind alone. A restart returns to the raw stream.
        """

    def wake(self, check_cancelled: Callable[[], None], *, corrected: bool = False) -> ImuIdentity | None:
        """Identify a unit that may have restarted by itself, for as long as a restart may take, then `start`.

        `check_cancelled` is called between two attempts and may raise. Returns None if the unit takes no command.
        """

    def read(self) -> SampleBatch:
        """Everything decoded since the last call, possibly nothing; never waits.

        Raises NoFramesError if bytes arrive and none of them belong to a frame.
        """

    def identify(self) -> ImuIdentity:
        """Model, serial number and firmware."""

    def read_registers(self) -> dict[str, float]:
        """Calibration registers by the contract's parameter names, SI."""

    def write_registers(self, values: Mapping[str, float]) -> None:
        """Write calibration registers (volatile until `commit`)."""

    def commit(self) -> None:
        """Make the registers permanent."""

    def reset(self) -> None:
        """Restart the unit and return once it has; its registers are then those of its flash."""

    def close(self) -> None:
        """Close the link."""
