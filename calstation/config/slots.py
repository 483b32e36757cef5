"""The links of a station with their defaults, and its slots, which are the mounting positions of units on a table."""

import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field, field_validator

from calstation.config import library
from calstation.config.product import load_product
from calstation.devices.links import CAN, SOCKETS, UDP, can_port, host_and_port, udp_address
from calstation.devices.profiles import (
    ChamberModbusSection,
    SerialSettings,
    TableProfile,
    load_chamber_profile,
    load_imu_profile,
    load_table_profile,
)
from calstation.errors import ConfigurationError
from calstation.schema import EntryError, StrictModel

#: Largest number of units on one table.
MAX_UNITS = 16

#: Largest component of a lever arm, m.
_MAX_LEVER = 5.0

#: Orientation of a unit aligned with the platform axes.
PLATFORM_AXES = "+x+z"

#: Entries of `[bench]` in a station file that are not settings of the bench itself.
STATION_ENTRIES = ("faults", "units")


class DeviceSection(StrictModel):
    """The link of a device at a station; its serial settings replace those of the profile."""

    #: ``tcp://host:port`` (tables), ``socket://host:port`` for a serial server, the name of a serial port, or
    #: ``usb:SERIALNUMBER`` for its adapter; an IMU also ``udp://host:port`` or ``can://interface/channel/ids``.
    port: str | None = None
    serial: SerialSettings | None = None
    timeout_s: float | None = Field(default=None, gt=0, le=60)  #: Reply timeout, host time; default from the profile.

    @field_validator("port")
    @classmethod
    def _check_port(cls, port: str | None) -> str | None:
        if port is not None and port.startswith(SOCKETS) and host_and_port(port) is None:
            raise EntryError("station.not_an_address", port=port, scheme=port.split("://")[0])
        if port is not None and port.startswith(UDP) and udp_address(port) is None:
            raise EntryError("station.not_an_address", port=port, scheme="udp")
        if port is not None and port.startswith(CAN) and can_port(port) is None:
            raise EntryError("station.not_a_bus", port=port)
        return port


class SlotSection(DeviceSection):
    """`[[slots]]` of a station: a mounting position on the table, with the link of its unit."""

    name: str
    imu: str | None = None  #: Name of the IMU profile; None for the product's.
    product: str | None = None  #: Name of the product; None for the run's.
    #: Body axes along x and z of the platform at home, for example ``-y+z``.
    orientation: str = PLATFORM_AXES
    #: Nominal lever arm in the body frame.
    lever_m: list[float] = Field(default=[0.0, 0.0, 0.0], min_length=3, max_length=3)

    @field_validator("name")
    @classmethod
    def _check_name(cls, name: str) -> str:
        if re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,15}", name) is None:
            raise EntryError("station.slot_name", name=name)
        return name

    @field_validator("lever_m")
    @classmethod
    def _check_lever(cls, lever: list[float]) -> list[float]:
        for component, value in enumerate(lever):
            if abs(value) > _MAX_LEVER:
                raise EntryError("station.lever_too_long", component, value=value, most=_MAX_LEVER)
        return lever

    @field_validator("orientation")
    @classmethod
    def _check_orientation(cls, orientation: str) -> str:
        if re.fullmatch(r"[+-][xyz][+-][xyz]", orientation) is None:
            raise EntryError("station.not_an_orientation", orientation=orientation)
        if orientation[1] == orientation[3]:
            raise EntryError("station.one_axis_twice", orientation=orientation)
        return orientation


def profile_takes_single_unit(profile: str) -> bool:
    """Return whether a table with this profile holds a single unit; False if the profile cannot be read."""
    with suppress(ConfigurationError):
        return takes_single_unit(load_table_profile(library.find("tables", profile)))
    return False


def takes_single_unit(table: TableProfile) -> bool:
    """Return whether a table holds a single unit."""
    return table.by_hand or table.gimbal is not None or table.protocol == "imu_link"


@dataclass(frozen=True)
class LinkDefaults:
    """Link settings of a device profile."""

    serial: SerialSettings
    timeout: float | None  #: Reply timeout, host time in s; None for a device that is never queried.
    unit: int | None  #: Modbus unit number.
    by_hand: bool = False  #: Whether the table is a manual rig, which has no link.


def table_defaults(profile: str) -> LinkDefaults | None:
    """Return the link settings of a table profile; None if there is no valid profile with this name."""
    try:
        table = load_table_profile(library.find("tables", profile))
    except ConfigurationError:
        return None
    return LinkDefaults(table.serial, table.timeout_s, table.unit, table.by_hand)


def chamber_defaults(profile: str) -> LinkDefaults | None:
    """Return the link settings of a chamber profile; None if there is no valid profile with this name."""
    try:
        section = load_chamber_profile(library.find("chambers", profile)).section
    except ConfigurationError:
        return None
    unit = section.unit if isinstance(section, ChamberModbusSection) else None
    return LinkDefaults(section.serial, section.timeout_s, unit)


def imu_defaults(product: Path | None, profile: str | None = None) -> LinkDefaults | None:
    """Return the link settings of an IMU profile, by default the product's; None if the profile is invalid."""
    try:
        imu = load_imu_profile(library.find("imus", profile or load_product(product)[1].imu))
    except ConfigurationError:
        return None
    return LinkDefaults(imu.link, imu.timeout_s, None)


def is_manual_table(profile: str) -> bool:
    """Return whether a table profile describes a manual rig; False if it cannot be read."""
    defaults = table_defaults(profile)
    return defaults is not None and defaults.by_hand
