"""Selection of the driver of a table by its protocol, and the driver of a manual rig."""

import math

import numpy as np

from calstation.devices.interfaces import Table, TableIdentity, TableStatus
from calstation.devices.profiles import SerialSettings, TableProfile
from calstation.devices.table.register_table import ModbusTable
from calstation.devices.table.text_table import GimbalTable, TextTable
from calstation.errors import ConfigurationError

#: Drivers of tables with a separate port, by the section of the profile.
DRIVERS: dict[str, type[ModbusTable | TextTable]] = {"modbus": ModbusTable, "text": TextTable, "gimbal": GimbalTable}


def open_table(port: str, profile: TableProfile, serial: SerialSettings | None) -> ModbusTable | TextTable:
    """Open a table on its port and return its driver.

    Raises DeviceFaultError or ConfigurationError if the port cannot be opened.

    Parameters
    ----------
    port : port or address of the table
    profile : profile of the table
    serial : settings of the serial port; None for those of the profile
    """
    if profile.protocol == "imu_link":
        raise ConfigurationError("table.behind_imu", profile=profile.name)
    if profile.by_hand:
        raise ConfigurationError("table.rig_without_port", profile=profile.name)
    return DRIVERS[profile.section](port, profile, serial)


class ManualTable(Table):
    """Driver of a manual rig, which the operator turns; it always reports rest at unknown angles."""

    def __init__(self, profile: TableProfile) -> None:
        self._profile = profile
        self._status = TableStatus(
            angles=np.full(2, np.nan),
            rates=np.full(2, np.nan),
            enabled=True,
            homed=True,
            moving=False,
            settled=True,
            fault=None,
            interlock_closed=True,
            watchdog=math.inf,
            limits=profile.geometry().limits,
        )

    def identify(self) -> TableIdentity:
        """Return the model in the profile; a manual rig has no serial number."""
        return TableIdentity(self._profile.model, "by hand")

    def status(self) -> TableStatus:
        """Return the status of a table at rest at unknown angles."""
        return self._status

    def enable(self) -> None:
        """Do nothing, because a manual rig has no drives, faults or link."""

    disable = home = stop = reset_fault = heartbeat = close = enable

    def move(self, outer: float, inner: float, rate: float, acceleration: float) -> None:
        """Raise ConfigurationError, because only the operator moves the rig."""
        raise ConfigurationError("table.rig_cannot_move", profile=self._profile.name)

    def rate(self, outer: float, inner: float, acceleration: float) -> None:
        """Raise ConfigurationError, because only the operator moves the rig."""
        self.move(outer, inner, 0.0, acceleration)
