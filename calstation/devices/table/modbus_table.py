"""Driver of a two-axis table on Modbus, over TCP or RTU."""

from calstation.devices.links import ModbusLink
from calstation.devices.profiles import ModbusSection, SerialSettings, TableProfile
from calstation.devices.table.register_table import RegisterTable
from calstation.errors import DeviceFaultError


class ModbusTable(RegisterTable):
    """Driver of a table on a port, `tcp://host:port` or a serial port for RTU."""

    def __init__(self, port: str, profile: TableProfile, serial: SerialSettings | None = None) -> None:
        modbus = profile.section_of(ModbusSection)
        link = ModbusLink(port, modbus.unit, modbus.timeout_s, serial or modbus.serial)
        inner = None if modbus.inner_unit is None else OtherUnit(link, modbus.inner_unit)
        super().__init__(link, profile, inner)
        self._port = port
        self._texts: dict[str, str] = {}
        link.greet = self._greet

    def _text(self, name: str) -> str:
        self._texts[name] = super()._text(name)
        return self._texts[name]

    def _greet(self) -> None:
        for name, expected in self._texts.items():
            text = super()._text(name)
            if text != expected:
                raise DeviceFaultError("table.other_table", port=self._port, found=text, expected=expected)


class OtherUnit:
    """Registers of a second unit on a line whose port the first unit owns; implements `register_table.RegisterLink`."""

    received = b""

    def __init__(self, link: ModbusLink, unit: int) -> None:
        self._link, self._unit = link, unit

    def read(self, address: int, count: int) -> list[int]:
        return self._link.read(address, count, self._unit)

    def write(self, address: int, values: list[int], repeat: bool = True) -> None:
        self._link.write(address, values, repeat, self._unit)

    def close(self) -> None:
        """Do nothing: the first unit closes the link."""
