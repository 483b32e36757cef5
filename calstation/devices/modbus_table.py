"""Driver of a two-axis table behind Modbus, over TCP or RTU."""

from calstation.devices.link import SerialSettings
from calstation.devices.modbus_link import ModbusLink
from calstation.devices.register_table import RegisterTable, decode, encode
from calstation.devices.table_profile import TableProfile

__all__ = ["ModbusTable", "decode", "encode"]


class ModbusTable(RegisterTable):
    """The table of a profile on a port.

    Parameters
    ----------
    port : `tcp://host:port`, or a serial port for RTU
    profile : what the registers mean
    serial : settings of this place's port; the profile's where None
    """

    def __init__(self, port: str, profile: TableProfile, serial: SerialSettings | None = None) -> None:
        modbus = profile.modbus
        assert modbus is not None
        link = ModbusLink(port, modbus.unit, modbus.timeout_s, serial or modbus.serial)
        super().__init__(link, profile, modbus.gap)
