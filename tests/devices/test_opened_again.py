"""A reopened link resolves its port name again and accepts only the same device."""

import struct
import sys
from types import SimpleNamespace

import pytest
from rtu_server import RtuServer
from serial.tools import list_ports
from test_modbus_table import image, quick

from calstation.devices.profiles import SerialSettings
from calstation.devices.table import ModbusTable
from calstation.errors import DeviceFaultError
from tests.helpers import raises_code

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on Windows")

ADAPTER = "A9XYZ"


def table_at(serial: str) -> RtuServer:
    """A table that reports its identity."""
    texts = ((0, b"bench-table"), (8, serial.encode()))
    words = dict(enumerate(image()))
    for address, text in texts:
        words |= {address + i: word for i, word in enumerate(struct.unpack(">8H", text.ljust(16, b"\0")))}
    return RtuServer(words=words)


@pytest.fixture
def plugged(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Port names that the adapter has had; the last is the current one."""
    had: list[str] = []
    about = {"description": "UART", "manufacturer": "FTDI", "location": "1-2", "serial_number": ADAPTER}
    monkeypatch.setattr(
        list_ports, "comports", lambda: [SimpleNamespace(device=had[-1], name=had[-1], **about)] if had else []
    )
    return had


def test_adapter_that_reappears_under_another_name_is_found(plugged: list[str]) -> None:
    first, second = table_at("T-0001"), table_at("T-0001")
    plugged.append(first.port)
    table = ModbusTable(f"usb:{ADAPTER}", quick(), SerialSettings())
    try:
        assert table.identify().serial == "T-0001"
        first.close()
        plugged.append(second.port)
        table.stop()
        assert second.requests == [(3, 0, 8), (3, 8, 8), (6, 22, 2)], "who it is before what it is to do"
    finally:
        table.close()
        second.close()


def test_different_table_on_the_same_port_is_not_commanded(plugged: list[str]) -> None:
    first, other = table_at("T-0001"), table_at("T-0002")
    plugged.append(first.port)
    table = ModbusTable(f"usb:{ADAPTER}", quick(), SerialSettings())
    try:
        table.identify()
        first.close()
        plugged.append(other.port)
        for order in (table.stop, table.heartbeat, lambda: table.move(0.1, 0.1, 0.1, 0.1)):
            with raises_code(DeviceFaultError, "table.other_table"):
                order()
        assert {function for function, _, _ in other.requests} == {3}
    finally:
        table.close()
        other.close()


def test_missing_adapter_is_reported_as_a_lost_link(plugged: list[str]) -> None:
    first = table_at("T-0001")
    plugged.append(first.port)
    table = ModbusTable(f"usb:{ADAPTER}", quick(), SerialSettings())
    first.close()
    plugged.clear()
    with raises_code(DeviceFaultError, "table.read_unanswered"):
        table.status()
