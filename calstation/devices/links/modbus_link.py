"""Holding registers of one Modbus unit, over TCP or RTU: bounded transfers, with their errors made into one."""

import time
from collections.abc import Callable
from typing import Protocol, TypeVar

from calstation.devices.links.modbus_rtu import RefusedError, RtuLine, UnansweredError
from calstation.devices.links.modbus_tcp import TcpConnection
from calstation.devices.links.serial_link import PortLostError
from calstation.devices.profiles.serial_settings import SerialSettings
from calstation.errors import CalstationError, DeviceFaultError

#: What Modbus exceptions mean, by their codes.
MEANINGS = {
    1: "the function is not supported",
    2: "no such register",
    3: "the value is refused",
    4: "the device cannot do it in its present state",
    5: "acknowledged, not done yet",
    6: "the device is busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "no answer behind the gateway",
}

#: The exception of a device that does what it was told, but takes its time.
ACKNOWLEDGED = 5

#: Exceptions of a device that is only late.
NOT_YET = (ACKNOWLEDGED, 6)

#: What to do about Modbus exceptions of a table, by their codes.
MENDS = {
    **dict.fromkeys((1, 2, 3), "check the table profile's registers"),
    **dict.fromkeys(NOT_YET, "wait until it is done, then start again"),
    **dict.fromkeys((10, 11), "check the gateway and the unit number"),
}

#: Host time until a device that is busy is asked again, s.
_AGAIN_AFTER = 0.05

_ATTEMPTS = 3
T = TypeVar("T")


class ModbusRefusalError(DeviceFaultError):
    """The device answers with a Modbus exception; `exception` is its number, `unit` who was asked."""

    def __init__(self, what: str, code: int, unit: int) -> None:
        meaning = MEANINGS.get(code, f"exception {code}")
        mend = MENDS.get(code, "look at the drive's display")
        super().__init__(f"table: {what}: {meaning} (Modbus exception {code}); {mend}")
        self.exception = code
        self.unit = unit


class NoAnswerError(DeviceFaultError):
    """The device does not answer, though it was asked as often as it may be.

    Attributes
    ----------
    reason : what came instead of an answer
    unit : who was asked
    """

    def __init__(self, text: str, reason: str, unit: int) -> None:
        super().__init__(text)
        self.reason = reason
        self.unit = unit


class Carrier(Protocol):
    """What carries register transfers.

    Attributes
    ----------
    heard : the bytes that came last, whether they make sense or not
    """

    heard: bytes

    @property
    def open(self) -> bool:
        """Whether it is open."""

    def connect(self) -> None:
        """Open it. Raises ConfigurationError, DeviceFaultError."""

    def close(self) -> None:
        """Close it; never raises."""

    def read(self, unit: int, address: int, count: int) -> list[int]:
        """Read holding registers. Raises UnansweredError, RefusedError, PortLostError."""

    def write(self, unit: int, address: int, values: list[int], *, repeat: bool, again: bool) -> None:
        """Write holding registers, which may be `repeat`-ed, or were just written: `again`. Raises as `read`."""


class ModbusLink:
    """Holding registers of one Modbus unit over TCP or RTU; not for use by two threads at once.

    Parameters
    ----------
    port : `tcp://host:port`, or for RTU a serial port, also as `usb:SERIALNUMBER`
    unit : Modbus unit number
    timeout : host time for an answer, s
    serial : settings of a serial port

    Attributes
    ----------
    greet : called whenever the link was opened anew, before anything else is asked or told: raises
        DeviceFaultError where another device answers there now
    """

    def __init__(self, port: str, unit: int, timeout: float, serial: SerialSettings) -> None:
        self._port = port
        self._unit = unit
        self.greet: Callable[[], None] = lambda: None
        self._greeting = False
        self._carrier: Carrier = (
            TcpConnection(port, timeout) if port.startswith("tcp://") else RtuLine(port, timeout, serial)
        )
        self._carrier.connect()

    @property
    def heard(self) -> bytes:
        """The bytes that came last, whether they make sense or not."""
        return self._carrier.heard

    def read(self, address: int, count: int, unit: int | None = None) -> list[int]:
        """Read `count` registers, of another unit on the line where one is told; repeats a lost transfer.

        Raises DeviceFaultError.
        """
        asked = self._unit if unit is None else unit
        return self._transfer(
            lambda again: self._carrier.read(asked, address, count),
            f"registers {address}-{address + count - 1}{_of(unit)} cannot be read",
            _ATTEMPTS,
            asked,
        )

    def write(self, address: int, values: list[int], repeat: bool = True, unit: int | None = None) -> None:
        """Write registers, as `read`; a lost transfer is repeated only where `repeat`. Raises DeviceFaultError."""
        asked = self._unit if unit is None else unit
        self._transfer(
            lambda again: self._carrier.write(asked, address, values, repeat=repeat, again=again),
            f"register {address}{_of(unit)} cannot be written",
            _ATTEMPTS if repeat else 1,
            asked,
        )

    def close(self) -> None:
        """Hang up; never raises."""
        self._carrier.close()

    def _transfer(self, transfer: Callable[[bool], T], what: str, attempts: int, unit: int) -> T:
        reason = "no answer"
        attempts = 1 if self._greeting else attempts
        for attempt in range(attempts):
            try:
                self._ready()
                return transfer(attempt > 0)
            except (NoAnswerError, PortLostError) as exc:  # the greeting's is told as this one's
                reason = exc.reason
            except (UnansweredError, _GoneError) as exc:
                reason = str(exc)
            except RefusedError as exc:
                if exc.code not in NOT_YET or attempt + 1 == attempts:
                    raise ModbusRefusalError(what, exc.code, unit) from exc
                time.sleep(_AGAIN_AFTER)
        raise NoAnswerError(
            f"table: {what} on {self._port} ({reason}); check cable, power and unit number", reason, unit
        )

    def _ready(self) -> None:
        """An open link to the device that it was opened to."""
        if self._carrier.open:
            return
        try:
            self._carrier.connect()
        except CalstationError as exc:
            raise _GoneError("the link is gone") from exc
        if not self._greeting:
            self._greeting = True
            try:
                self.greet()
            except BaseException:
                self._carrier.close()
                raise
            finally:
                self._greeting = False


def _of(unit: int | None) -> str:
    """Whose registers, where it is not the first unit."""
    return "" if unit is None else f" of unit {unit}"


class _GoneError(Exception):
    """A lost link that cannot be opened again yet."""
