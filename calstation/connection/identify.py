"""Who answers on a station's ports: asked before a device is told anything; where it is somebody else, found out who.

Nothing here writes: devices are asked for their model, and streams are listened to.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from calstation.config import library
from calstation.devices.imu.frames import FrameDecoder
from calstation.devices.interfaces import Imu, OtherModelError, Table, TableIdentity
from calstation.devices.links.modbus_link import MEANINGS, ModbusRefusalError, NoAnswerError
from calstation.devices.links.serial_link import PortLostError, SerialLink
from calstation.devices.profiles.imu import ImuProfile
from calstation.devices.profiles.serial_settings import SerialSettings
from calstation.devices.profiles.table import TableProfile, load_table_profile
from calstation.devices.table.drivers import open_table
from calstation.errors import CalstationError, ConfigurationError, DeviceFaultError

#: Host time to listen at one setting, s.
LISTEN = 0.4

_GLANCE = 0.02


def listen(link: SerialLink, seconds: float) -> bytes:
    """What comes within some host time. Raises PortLostError."""
    heard = b""
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        heard += link.read(min(left, _GLANCE))
    return heard


def has_frames(port: str, settings: SerialSettings, profile: ImuProfile) -> bool:
    """Whether frames of the profile come on a port with these settings; not where it cannot be opened."""
    try:
        link = SerialLink(port, settings, "IMU")
    except CalstationError:
        return False  # settings that this port cannot do, or no such port
    try:
        return len(FrameDecoder(profile.frame, profile.commands).feed(listen(link, LISTEN)).frames) > 0
    except CalstationError:
        return False
    finally:
        link.close()


#: Modbus unit numbers that are tried where nobody answers as the one set.
NUMBERS = range(1, 11)

#: Modbus exceptions that may mean that the unit number is another's.
OTHER_NUMBER = (4, 10, 11)

#: Host time that each has to answer, s.
_ANSWER_WITHIN = 0.2


@dataclass(frozen=True)
class LinkSettings:
    """How both devices are reached: ports, profiles and settings as at this place."""

    table_port: str
    table: TableProfile
    table_serial: SerialSettings
    imu_port: str
    imu: ImuProfile
    imu_serial: SerialSettings

    @property
    def two_lines(self) -> bool:
        """Whether there are two serial lines, which somebody may have exchanged."""
        lines = not self.table_port.startswith("tcp://") and bool(self.table_port)
        return lines and self.table_port != self.imu_port and self.table.protocol != "imu_link"


def identify(
    table: Table, imu: Imu | None, wires: LinkSettings, check_cancelled: Callable[[], None] = lambda: None
) -> TableIdentity:
    """Have the devices say who they are, the IMU where it is open. Raises DeviceFaultError where one is another.

    What keeps a device from saying it may be looked for on its port, so that both are closed then.

    hear : called while that takes its time, may raise
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
        raise _explained(fault, wires, check_cancelled) from fault
    return identity


def _explained(
    fault: DeviceFaultError, wires: LinkSettings, check_cancelled: Callable[[], None]
) -> DeviceFaultError:
    """What is behind it, where that can be found out."""
    if _exchanged(wires, check_cancelled):
        return DeviceFaultError(
            f"table: it and the IMU are exchanged, its port {wires.table_port} is the IMU's; exchange table.port and"
            " imu.port in the station file"
        )
    refused = fault.exception if isinstance(fault, ModbusRefusalError) else None
    if not isinstance(fault, NoAnswerError | ModbusRefusalError) or refused not in (None, *OTHER_NUMBER):
        return fault
    unit = fault.unit
    other = find_unit_number(wires, lambda share: check_cancelled()) if unit == wires.table.unit else None
    if other is not None:
        return DeviceFaultError(
            f"table: on {wires.table_port} '{other[1]}' answers as unit {other[0]}, not as unit {unit}; correct"
            " table.unit in the station file"
        )
    if refused is not None:
        return DeviceFaultError(
            f"table: asked for its model as unit {unit} on {wires.table_port}, it refuses: {MEANINGS[refused]} (Modbus"
            f" exception {refused}); check the unit number, then look at the drive's display"
        )
    settings = "" if wires.table_port.startswith("tcp://") else ", baud, parity"
    return DeviceFaultError(
        f"table: nothing answers in Modbus on {wires.table_port} as unit {unit}; check cable, power{settings} and unit"
        " number, and whether it is the table that is connected there"
    )


def _exchanged(wires: LinkSettings, check_cancelled: Callable[[], None]) -> bool:
    """Whether the IMU streams on the table's line, or the table says its model on the IMU's."""
    if not wires.two_lines:
        return False
    for looked in (imu_on_table_port, table_on_imu_port):
        check_cancelled()
        if looked(wires):
            return True
    return False


def imu_on_table_port(wires: LinkSettings) -> bool:
    """Whether frames of the IMU come on the table's line."""
    return has_frames(wires.table_port, wires.imu_serial, wires.imu)


def table_on_imu_port(wires: LinkSettings) -> bool:
    """Whether the table says its model on the IMU's line."""
    try:
        table = open_table(wires.imu_port, wires.table, wires.table_serial)
    except CalstationError:
        return False
    try:
        table.identify()
    except CalstationError:
        return False
    finally:
        table.close()
    return True


def find_unit_number(
    wires: LinkSettings, asked: Callable[[float], None] = lambda share: None
) -> tuple[int, str] | None:
    """Number and model of a Modbus unit that is the profile's, on the table's port but under another number.

    asked : told the share of the numbers that have been tried
    """
    modbus = wires.table.modbus
    if modbus is None:
        return None
    for i, number in enumerate(NUMBERS):
        if number == wires.table.unit:
            continue
        asked(i / len(NUMBERS))
        with suppress(CalstationError):
            place = wires.table.at_place(min(_ANSWER_WITHIN, modbus.timeout_s), number)
            table = open_table(wires.table_port, place, wires.table_serial)
            try:
                return number, table.identify().model
            finally:
                table.close()
    return None


@dataclass(frozen=True)
class FoundUnit:
    """A Modbus unit that answers: its number, its model where it tells one, and the name of the table profile whose it
    is, "" where none is known."""

    unit: int
    model: str
    profile: str


def find_units(wires: LinkSettings, asked: Callable[[float], None] = lambda share: None) -> list[FoundUnit]:
    """Who answers on the table's port, by the models of all Modbus profiles of this site.

    asked : told the share of the numbers that have been tried
    """
    profiles, heard = _modbus_profiles(wires), []
    for i, number in enumerate(NUMBERS):
        asked(i / len(NUMBERS))
        found = _heard_as(wires, profiles, number)
        if found is not None:
            heard.append(found)
    return heard


def _modbus_profiles(wires: LinkSettings) -> dict[str, TableProfile]:
    """The site's profiles behind Modbus by their file's name, one for each model."""
    found: dict[str, TableProfile] = {}
    for name in library.names("tables") if wires.table.modbus is not None else ():
        with suppress(ConfigurationError):
            profile = load_table_profile(library.find("tables", name))
            if profile.modbus is not None and profile.model not in {known.model for known in found.values()}:
                found[name] = profile
    return found


def _heard_as(wires: LinkSettings, profiles: dict[str, TableProfile], number: int) -> FoundUnit | None:
    """Who a unit number is, None where nobody answers to it."""
    somebody = None
    for name, profile in profiles.items():
        try:
            table = open_table(wires.table_port, profile.at_place(_ANSWER_WITHIN, number), wires.table_serial)
        except CalstationError:
            return somebody
        try:
            return FoundUnit(number, table.identify().model, name)
        except OtherModelError as exc:
            somebody = FoundUnit(number, exc.found, "")
        except NoAnswerError as exc:
            if exc.unit == number:
                return somebody
        except ModbusRefusalError as exc:
            if exc.unit == number and exc.exception not in OTHER_NUMBER:
                somebody = somebody or FoundUnit(number, "", "")
        except CalstationError:
            continue
        finally:
            table.close()
    return somebody
