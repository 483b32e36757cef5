"""What a link is like where the station file does not say: its device's profile says it."""

from dataclasses import dataclass
from pathlib import Path

from calstation.config import library
from calstation.config.station import load_product
from calstation.devices.links.serial_link import SerialSettings
from calstation.devices.profiles.imu import load_imu_profile
from calstation.devices.profiles.table import load_table_profile
from calstation.errors import ConfigurationError


@dataclass(frozen=True)
class LinkDefaults:
    """Settings of a profile.

    Attributes
    ----------
    profile : its file's name
    serial : of its line
    timeout : host time for an answer, s, None for a device that is never asked
    unit : Modbus unit number, None where there is none
    by_hand : rails that hands turn: there is no link at all
    """

    profile: str
    serial: SerialSettings
    timeout: float | None
    unit: int | None
    by_hand: bool = False

    @property
    def line(self) -> str:
        """The serial settings as they are usually written, e.g. ``921600 8N1``."""
        return self.serial.line


def table_defaults(profile: str) -> LinkDefaults | None:
    """Of a table profile; None where there is no sound one of that name."""
    try:
        table = load_table_profile(library.find("tables", profile))
    except ConfigurationError:
        return None
    return LinkDefaults(profile, table.serial, table.timeout_s, table.unit, table.by_hand)


def imu_defaults(product: Path | None) -> LinkDefaults | None:
    """Of the IMU of a product, the default one where None; None where there is no sound one."""
    try:
        _, found = load_product(product)
        profile = load_imu_profile(library.find("imus", found.imu))
    except ConfigurationError:
        return None
    return LinkDefaults(found.imu, profile.link, profile.timeout_s, None)
