"""The table of a profile: the driver that speaks its protocol, on its port."""

from calstation.devices.links.serial_link import SerialSettings
from calstation.devices.profiles.table import TableProfile
from calstation.devices.table.modbus_table import ModbusTable
from calstation.devices.table.text_table import TextTable
from calstation.errors import ConfigurationError


def open_table(port: str, profile: TableProfile, serial: SerialSettings | None) -> ModbusTable | TextTable:
    """The driver on its open port.

    Parameters
    ----------
    port : `tcp://host:port`, or a serial port
    serial : settings of this place's port; the profile's where None

    Raises
    ------
    DeviceFaultError, ConfigurationError
        where the port cannot be opened.
    """
    if profile.protocol == "imu_link":
        raise ConfigurationError(
            f"table: profile '{profile.name}' is of axes behind the IMU's link; they have no port of their own"
        )
    if profile.by_hand:
        raise ConfigurationError(
            f"table: profile '{profile.name}' is of rails turned by hand; they have no port"
        )
    if profile.protocol == "modbus":
        return ModbusTable(port, profile, serial)
    return TextTable(port, profile, serial)
