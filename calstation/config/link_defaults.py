"""Default link settings of device profiles, and manual tables, which have no link."""

from dataclasses import dataclass
from pathlib import Path

from calstation.config import library
from calstation.config.product import load_product
from calstation.devices.profiles import SerialSettings, load_imu_profile, load_table_profile
from calstation.errors import ConfigurationError


@dataclass(frozen=True)
class LinkDefaults:
    """Link settings of a device profile."""

    serial: SerialSettings
    timeout: float | None  #: Host time for a reply, s; None for a device that is never queried.
    unit: int | None  #: Modbus unit number.
    by_hand: bool = False  #: Whether it is a manual table, which has no link.


def table_defaults(profile: str) -> LinkDefaults | None:
    """Return the link settings of a table profile, or None if there is no valid profile with this name."""
    try:
        table = load_table_profile(library.find("tables", profile))
    except ConfigurationError:
        return None
    return LinkDefaults(table.serial, table.timeout_s, table.unit, table.by_hand)


def imu_defaults(product: Path | None, profile: str | None = None) -> LinkDefaults | None:
    """Return the link settings of an IMU profile, by default the product's, or None if it is invalid."""
    try:
        imu = load_imu_profile(library.find("imus", profile or load_product(product)[1].imu))
    except ConfigurationError:
        return None
    return LinkDefaults(imu.link, imu.timeout_s, None)


def is_manual_table(profile: str) -> bool:
    """Return whether a table profile is for a manual rig; False if it cannot be read."""
    defaults = table_defaults(profile)
    return defaults is not None and defaults.by_hand
