"""Identifies the devices on a station's ports before anything is commanded, and finds out what else answers there.

Nothing here writes: devices are asked for their model, and streams are listened to.
"""

import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass

from calstation.config import library
from calstation.devices import Imu, OtherModelError, Table, TableIdentity
from calstation.devices.imu import FrameDecoder
from calstation.devices.links import ModbusRefusalError, NoAnswerError, PortLostError, SerialLink, host_and_port
from calstation.devices.profiles import ImuProfile, SerialSettings, TableProfile, load_table_profile
from calstation.devices.table import open_table
from calstation.errors import CalstationError, ConfigurationError, DeviceFaultError
from calstation.messages import Value

#: Host time to listen with one setting, s.
LISTEN = 0.4

#: Modbus unit numbers that are tried if none answers at the configured one.
NUMBERS = range(1, 11)

#: Modbus exceptions that may mean that the unit number belongs to another device.
OTHER_NUMBER = (4, 10, 11)

#: Host time that each unit number has to answer, s.
_ANSWER_WITHIN = 0.2

_READ_INTERVAL = 0.02

#: Share of printable bytes from which received bytes count as text.
_MOSTLY_TEXT = 0.9
_PRINTABLE = frozenset(b"\r\n\t" + bytes(range(0x20, 0x7F)))


@dataclass(frozen=True)
class LinkSettings:
    """How both devices are reached: ports, profiles and settings of the station."""

    table_port: str
    table: TableProfile
    table_serial: SerialSettings
    imu_port: str
    imu: ImuProfile
    imu_serial: SerialSettings

    @property
    def two_lines(self) -> bool:
        """Whether there are two serial lines, which may be swapped."""
        lines = not self.table_port.startswith("tcp://") and bool(self.table_port)
        return lines and self.table_port != self.imu_port and self.table.protocol != "imu_link"


@dataclass(frozen=True)
class FoundUnit:
    """A Modbus unit that answers: number, model if it reports one, name of its table profile if one is known."""

    unit: int
    model: str
    profile: str


def identify(
    table: Table, imu: Imu | None, link: LinkSettings, check_cancelled: Callable[[], None] = lambda: None
) -> TableIdentity:
    """Ask both devices for their identity; if one does not answer, close both and search their ports for the cause.

    Raises DeviceFaultError: a device does not answer, or is another one.
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
        raise _explained(fault, link, check_cancelled) from fault
    return identity


def _explained(fault: DeviceFaultError, link: LinkSettings, check_cancelled: Callable[[], None]) -> DeviceFaultError:
    """A fault that names the cause, if it can be found out."""
    port = link.table_port
    for is_other in (imu_on_table_port, table_on_imu_port) if link.two_lines else ():
        check_cancelled()
        if is_other(link):
            return DeviceFaultError("connection.swapped", port=port)
    refused = fault.exception if isinstance(fault, ModbusRefusalError) else None
    if not isinstance(fault, NoAnswerError | ModbusRefusalError) or refused not in (None, *OTHER_NUMBER):
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
    """Whether frames of the IMU come on the table's line."""
    return has_frames(link.table_port, link.imu_serial, link.imu)


def table_on_imu_port(link: LinkSettings) -> bool:
    """Whether the table reports its model on the IMU's line."""
    try:
        with closing(open_table(link.imu_port, link.table, link.table_serial)) as table:
            table.identify()
    except CalstationError:
        return False
    return True


def find_unit_number(link: LinkSettings, tried: Callable[[float], None] = lambda share: None) -> tuple[int, str] | None:
    """Number and model of the profile's table under another Modbus unit number, or None; `tried` reports the share."""
    modbus = link.table.modbus
    if modbus is None:
        return None
    for i, number in enumerate(NUMBERS):
        if number == link.table.unit:
            continue
        tried(i / len(NUMBERS))
        with suppress(CalstationError):
            profile = link.table.at_place(min(_ANSWER_WITHIN, modbus.timeout_s), number)
            with closing(open_table(link.table_port, profile, link.table_serial)) as table:
                return number, table.identify().model
    return None


def find_units(link: LinkSettings, tried: Callable[[float], None] = lambda share: None) -> list[FoundUnit]:
    """All Modbus units on the table's port, with the models of every Modbus profile of this site."""
    profiles: dict[str, TableProfile] = {}
    for name in library.names("tables") if link.table.modbus is not None else ():
        with suppress(ConfigurationError):
            profile = load_table_profile(library.find("tables", name))
            if profile.modbus is not None and profile.model not in {known.model for known in profiles.values()}:
                profiles[name] = profile
    units = []
    for i, number in enumerate(NUMBERS):
        tried(i / len(NUMBERS))
        units.append(_unit_at(link, profiles, number))
    return [unit for unit in units if unit is not None]


def _unit_at(link: LinkSettings, profiles: dict[str, TableProfile], number: int) -> FoundUnit | None:
    unknown = None
    for name, profile in profiles.items():
        try:
            table = open_table(link.table_port, profile.at_place(_ANSWER_WITHIN, number), link.table_serial)
        except CalstationError:
            return unknown
        try:
            return FoundUnit(number, table.identify().model, name)
        except OtherModelError as exc:
            unknown = FoundUnit(number, exc.found, "")
        except NoAnswerError as exc:
            if exc.unit == number:
                return unknown
        except ModbusRefusalError as exc:
            if exc.unit == number and exc.exception not in OTHER_NUMBER:
                unknown = unknown or FoundUnit(number, "", "")
        except CalstationError:
            continue
        finally:
            table.close()
    return unknown


def listen(link: SerialLink, seconds: float) -> bytes:
    """The bytes that come within some host time, s. Raises PortLostError."""
    received = b""
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        received += link.read(min(left, _READ_INTERVAL))
    return received


def has_frames(port: str, settings: SerialSettings, profile: ImuProfile) -> bool:
    """Whether frames of a profile come on a port with these settings; false if it cannot be opened."""
    try:
        with closing(SerialLink(port, settings, "imu")) as link:
            return len(FrameDecoder(profile.frame, profile.commands).feed(listen(link, LISTEN)).frames) > 0
    except CalstationError:
        return False


def is_text(received: bytes) -> bool:
    """Whether received bytes are mostly printable."""
    return sum(byte in _PRINTABLE for byte in received) >= _MOSTLY_TEXT * len(received)


def line_values(port: str, settings: SerialSettings) -> dict[str, Value]:
    """Serial settings as values of a finding; empty for a serial server, which has settings of its own."""
    if host_and_port(port) is not None:
        return {}
    return {"baud": settings.baud, "parity": settings.parity, "stop_bits": settings.stop_bits}
