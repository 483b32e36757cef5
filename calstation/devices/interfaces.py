"""What the sequencer may ask of a table and an IMU, and what they answer; all angles in rad."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from calstation.errors import DeviceFaultError
from calstation.physics.arrays import FloatArray, IntArray
from calstation.physics.table import JointLimits

#: A table's `fault` that is none: it is switched to its own panel and obeys nobody else.
LOCAL_CONTROL = "local control"


#: A table's `fault` where it says that there is one and not which.
UNTOLD = "cause not told"


class OtherModelError(DeviceFaultError):
    """Not the device that the profile is for answers: `found` instead of `expected`."""

    def __init__(self, text: str, found: str, expected: str) -> None:
        super().__init__(text)
        self.found = found
        self.expected = expected


class NoFramesError(DeviceFaultError):
    """Bytes come on the IMU's link, and none of them belong to a frame."""


@dataclass(frozen=True)
class TableIdentity:
    """Who answers on the table's link."""

    model: str
    serial: str


@dataclass(frozen=True)
class TableStatus:
    """A table as polled once.

    Attributes
    ----------
    angles, rates : of the joints outer, inner, cumulative, rad and rad/s, shape (2,); NaN where nothing measures them
    enabled, homed, moving, settled : of both axes
    fault : what is latched or keeps the table from obeying, None where nothing does
    interlock_closed : True where the axes may be powered
    watchdog : timeout of the table's own watchdog, host seconds; 0 where it is off, infinite where it has none
    limits : travel set in the table; its rates and accelerations are the profile's
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
    """A two-axis table. Every call is bounded in time and raises DeviceFaultError where it fails."""

    def identify(self) -> TableIdentity:
        """Model and serial number."""

    def status(self) -> TableStatus:
        """Poll the table."""

    def enable(self) -> None:
        """Switch both axes on."""

    def disable(self) -> None:
        """Switch both axes off."""

    def home(self) -> None:
        """Start slow homing; `status` tells when it is done."""

    def move(self, outer: float, inner: float, rate: float, acceleration: float) -> None:
        """Start both joints towards absolute angles, rad, with rad/s and rad/s² at most; does not wait."""

    def rate(self, outer: float, inner: float, acceleration: float) -> None:
        """Turn both joints endlessly, rad/s and rad/s², until stopped; does not wait.

        Raises ConfigurationError where the table would not stop by itself once the link is lost: where no watchdog
        is on and the profile states no stop of its own.
        """

    def stop(self) -> None:
        """Decelerate to rest; does not wait."""

    def reset_fault(self) -> None:
        """Clear a latched fault; never restarts motion."""

    def heartbeat(self) -> None:
        """Feed the table's watchdog, where it has one."""

    def close(self) -> None:
        """Hang up."""


@dataclass(frozen=True)
class ImuIdentity:
    """Who answers on the IMU's link."""

    model: str
    serial: str
    firmware: str


@dataclass(frozen=True)
class SampleBatch:
    """Samples decoded since the last read.

    Attributes
    ----------
    seq : unwrapped counter, shape (n,)
    time : IMU clock at the end of each sample, s, shape (n,)
    counts : gyro x y z, accel x y z, shape (n, 6)
    temperature : °C, NaN where the frames carry none, shape (n,)
    status : status word, 0 where the frames carry none, shape (n,)
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
    """Counts since the link was opened: frames and bytes read, frames with a wrong check, bytes that belong
    to no frame, interruptions of the counter, and how often it began again."""

    frames: int = 0
    bytes: int = 0
    crc_errors: int = 0
    skipped: int = 0
    gaps: int = 0
    restarts: int = 0


class Imu(Protocol):
    """An IMU. Calls raise DeviceFaultError where the link or the unit fails."""

    @property
    def stats(self) -> LinkStats:
        """Counts so far."""

    def start(self, *, corrected: bool = False) -> None:
        """Begin to stream; `corrected`: with the registers applied, where the profile says how that is told.

        What is read from then on is of that kind alone. A restart falls back to the other.
        """

    def wake(self, check_cancelled: Callable[[], None], *, corrected: bool = False) -> ImuIdentity | None:
        """Find a unit that may have restarted by itself: who answers, asked for as long as that may take, then `start`.

        `hear` : called between two questions, may raise. None where the unit takes no command.
        """

    def read(self) -> SampleBatch:
        """Everything decoded since the last call, possibly nothing; never waits.

        Raises NoFramesError where bytes come and none of them belong to a frame.
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
        """Restart the unit, and return once it has: what it then tells is what its flash holds."""

    def close(self) -> None:
        """Hang up."""
