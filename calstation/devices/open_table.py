"""The table of a profile: the driver that speaks its protocol, on its port."""

from calstation.devices.link import SerialSettings
from calstation.devices.modbus_table import ModbusTable
from calstation.devices.table_profile import TableProfile
from calstation.devices.text_table import TextTable


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
    return (
        ModbusTable(port, profile, serial)
        if profile.protocol == "modbus"
        else TextTable(port, profile, serial)
    )
