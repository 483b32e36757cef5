"""Identification of the devices at the ports of a station, and search for other devices there.

Devices are identified before any command is sent. Nothing is written to them: they are only queried for their model,
or their stream is received.
"""

import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass

from calstation.config import library
from calstation.devices import Imu, OtherModelError, Table, TableIdentity
from calstation.devices.imu import FrameDecoder
from calstation.devices.links import (
    UDP,
    Link,
    ModbusRefusalError,
    NoAnswerError,
    PortLostError,
    host_and_port,
    open_link,
)
from calstation.devices.profiles import ImuProfile, SerialSettings, TableProfile, load_table_profile
from calstation.devices.table import open_table
from calstation.errors import CalstationError, ConfigurationError, DeviceFaultError
from calstation.messages import Value

#: Host time for which bytes are received with each set of serial settings, s.
LISTEN_TIME = 0.4

#: Modbus unit numbers that are queried if the configured unit does not reply.
UNIT_NUMBERS = range(1, 11)

#: Modbus exceptions that may be caused by a wrong unit number.
OTHER_UNIT_EXCEPTIONS = (4, 10, 11)

#: Reply timeout for each unit number, host time in s.
_REPLY_TIMEOUT = 0.2

_READ_INTERVAL = 0.02

#: Minimum fraction of printable bytes in received text.
_MOSTLY_TEXT = 0.9
_PRINTABLE = frozenset(b"\r\n\t" + bytes(range(0x20, 0x7F)))


@dataclass(frozen=True)
class LinkSettings:
    """Ports, profiles and serial settings of the table and the IMU of a station."""

    table_port: str
    table: TableProfile
    table_serial: SerialSettings
    imu_port: str
    imu: ImuProfile
    imu_serial: SerialSettings

    @property
    def two_lines(self) -> bool:
        """Whether the devices use two serial lines, which may be swapped."""
        lines = not self.table_port.startswith("tcp://") and bool(self.table_port)
        return lines and self.table_port != self.imu_port and self.table.protocol != "imu_link"


@dataclass(frozen=True)
class DetectedUnit:
    """A Modbus unit that replies; its `model` and the name of its table `profile` are "" if they are unknown."""

    unit: int
    model: str
    profile: str


def identify(
    table: Table, imu: Imu | None, link: LinkSettings, check_cancelled: Callable[[], None] = lambda: None
) -> TableIdentity:
    """Query both devices for their identity; if a device does not reply, close both and search for the cause.

    Raises DeviceFaultError if a device does not reply or is not the expected device.

    Parameters
    ----------
    table, imu : open devices; None for the IMU if several units are identified one by one
    link : ports, profiles and serial settings of both
    check_cancelled : called during the search; may raise
    """
    try:
        identity = table.identify()
        if imu is not None:
            imu.identify()
    except (OtherModelError, PortLostError):
        raise
    except DeviceFaultError as fault:
        table.close()
        if imu is not None:
            imu.close()
        raise _with_cause(fault, link, check_cancelled) from fault
    return identity


def _with_cause(fault: DeviceFaultError, link: LinkSettings, check_cancelled: Callable[[], None]) -> DeviceFaultError:
    """Return a fault that states the cause, or the original fault if the cause cannot be determined."""
    port = link.table_port
    for is_other in (imu_on_table_port, table_on_imu_port) if link.two_lines else ():
        check_cancelled()
        if is_other(link):
            return DeviceFaultError("connection.swapped", port=port)
    refused = fault.exception if isinstance(fault, ModbusRefusalError) else None
    if not isinstance(fault, NoAnswerError | ModbusRefusalError) or refused not in (None, *OTHER_UNIT_EXCEPTIONS):
        return fault
    unit = fault.unit
    if unit == link.table.unit:
        other = find_unit_number(link, lambda share: check_cancelled())
        if other is not None:
            return DeviceFaultError("connection.other_unit", port=port, model=other[1], found=other[0], unit=unit)
    if refused is not None:
        return DeviceFaultError("connection.refused", port=port, unit=unit, exception=refused)
    if port.startswith("tcp://"):
        return DeviceFaultError("connection.silent_tcp", port=port, unit=unit)
    return DeviceFaultError("connection.silent_line", port=port, unit=unit)


def imu_on_table_port(link: LinkSettings) -> bool:
    """Return whether frames of the IMU arrive at the port of the table."""
    return has_frames(link.table_port, link.imu_serial, link.imu)


def table_on_imu_port(link: LinkSettings) -> bool:
    """Return whether the table reports its model at the port of the IMU."""
    try:
        with closing(open_table(link.imu_port, link.table, link.table_serial)) as table:
            table.identify()
    except CalstationError:
        return False
    return True


def find_unit_number(
    link: LinkSettings, progress: Callable[[float], None] = lambda share: None
) -> tuple[int, str] | None:
    """Search for the table of the profile under other unit numbers; return its number and model, or None."""
    modbus = link.table.modbus
    if modbus is None:
        return None
    for i, number in enumerate(UNIT_NUMBERS):
        if number == link.table.unit:
            continue
        progress(i / len(UNIT_NUMBERS))
        with suppress(CalstationError):
            profile = link.table.at_station(min(_REPLY_TIMEOUT, modbus.timeout_s), number)
            with closing(open_table(link.table_port, profile, link.table_serial)) as table:
                return number, table.identify().model
    return None


def find_units(link: LinkSettings, progress: Callable[[float], None] = lambda share: None) -> list[DetectedUnit]:
    """Find all Modbus units at the port of the table, and match their models with the profiles of this site."""
    profiles: dict[str, TableProfile] = {}
    for name in library.names("tables") if link.table.modbus is not None else ():
        with suppress(ConfigurationError):
            profile = load_table_profile(library.find("tables", name))
            if profile.modbus is not None and profile.model not in {known.model for known in profiles.values()}:
                profiles[name] = profile
    units = []
    for i, number in enumerate(UNIT_NUMBERS):
        progress(i / len(UNIT_NUMBERS))
        units.append(_detect_unit(link, profiles, number))
    return [unit for unit in units if unit is not None]


def _detect_unit(link: LinkSettings, profiles: dict[str, TableProfile], number: int) -> DetectedUnit | None:
    unknown = None
    for name, profile in profiles.items():
        try:
            profile_at_number = profile.at_station(_REPLY_TIMEOUT, number)
        except ConfigurationError:  # the profile uses this unit number for its inner drive
            continue
        try:
            table = open_table(link.table_port, profile_at_number, link.table_serial)
        except CalstationError:
            return unknown
        try:
            return DetectedUnit(number, table.identify().model, name)
        except OtherModelError as exc:
            unknown = DetectedUnit(number, exc.found, "")
        except NoAnswerError as exc:
            if exc.unit == number:
                return unknown
        except ModbusRefusalError as exc:
            if exc.unit == number and exc.exception not in OTHER_UNIT_EXCEPTIONS:
                unknown = unknown or DetectedUnit(number, "", "")
        except CalstationError:
            continue
        finally:
            table.close()
    return unknown


def listen(link: Link, seconds: float) -> bytes:
    """Return the bytes received within `seconds` of host time. Raises PortLostError."""
    received = b""
    end = time.monotonic() + seconds
    while (remaining := end - time.monotonic()) > 0:
        received += link.read(min(remaining, _READ_INTERVAL))
    return received


def has_frames(port: str, settings: SerialSettings, profile: ImuProfile) -> bool:
    """Return whether frames of a profile arrive at a port; return False if the port cannot be opened."""
    try:
        with closing(open_link(port, settings)) as link:
            return len(FrameDecoder(profile.frame).feed(listen(link, LISTEN_TIME)).frames) > 0
    except CalstationError:
        return False


def is_text(received: bytes) -> bool:
    """Return whether most of the received bytes are printable."""
    return sum(byte in _PRINTABLE for byte in received) >= _MOSTLY_TEXT * len(received)


def line_values(port: str, settings: SerialSettings) -> dict[str, Value]:
    """Return the serial settings as values for a finding, or no values for a serial server with its own settings."""
    if host_and_port(port) is not None or port.startswith(UDP):
        return {}
    return {"baud": settings.baud, "parity": settings.parity, "stop_bits": settings.stop_bits}
