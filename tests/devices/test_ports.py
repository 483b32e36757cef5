"""Ports are listed with their adapters, and a reconnected adapter is found under its new name."""

import os
import sys
from types import SimpleNamespace

import pytest
from serial.tools import list_ports

from calstation.devices.links import ModbusLink, SerialLink, diagnose_port, list_serial_ports, port_device
from calstation.devices.profiles import SerialSettings
from calstation.errors import DeviceFaultError
from tests.helpers import raises_code


def listed(device: str, number: str | None = None, location: str | None = None, about: str = "n/a") -> object:
    """Return a port as listed by pyserial."""
    return SimpleNamespace(
        device=device,
        name=device.rsplit("/", 1)[-1],
        description=about,
        manufacturer="FTDI" if number else None,
        serial_number=number,
        location=location,
    )


@pytest.fixture
def plugged(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """The ports of this computer, set by the test."""
    ports: list[object] = []
    monkeypatch.setattr(list_ports, "comports", lambda: list(ports))
    return ports


def test_ports_are_listed_adapters_first(plugged: list[object]) -> None:
    plugged += [
        listed("/dev/ttyS0", about="ttyS0"),
        listed("/dev/ttyUSB10", "A10", "1-3", "FT232R USB UART"),
        listed("/dev/ttyUSB9", "A9", "1-2", "FT232R USB UART"),
    ]
    ports = list_serial_ports()
    assert [p.device for p in ports] == ["/dev/ttyUSB9", "/dev/ttyUSB10", "/dev/ttyS0"]
    assert [p.usb for p in ports] == ["usb:A9", "usb:A10", None]
    assert (ports[0].description, ports[0].maker, ports[2].description) == ("FT232R USB UART", "FTDI", "")


def test_adapter_is_found_under_its_current_name(plugged: list[object]) -> None:
    plugged.append(listed("/dev/ttyUSB0", "A9", "1-2"))
    assert port_device("usb:A9", "imu") == "/dev/ttyUSB0"
    plugged[:] = [listed("/dev/ttyUSB0", "B1", "1-1"), listed("/dev/ttyUSB3", "A9", "1-4")]
    assert port_device("usb:A9", "imu") == "/dev/ttyUSB3"
    assert port_device("/dev/ttyUSB0", "imu") == "/dev/ttyUSB0"
    assert port_device("socket://host:1", "imu") == "socket://host:1"


def test_ports_of_one_adapter_have_individual_names(plugged: list[object]) -> None:
    plugged += [listed("/dev/ttyUSB1", "Q4", "1-2:1.1"), listed("/dev/ttyUSB0", "Q4", "1-2:1.0")]
    assert [p.usb for p in list_serial_ports()] == ["usb:Q4/1", "usb:Q4/2"]
    assert port_device("usb:Q4/2", "table") == "/dev/ttyUSB1"
    with raises_code(DeviceFaultError, "link.ambiguous"):
        port_device("usb:Q4", "table")


def test_adapters_with_equal_serial_numbers_are_named_by_bus_location(plugged: list[object]) -> None:
    first, second = listed("/dev/ttyUSB0", "0001", "1-1"), listed("/dev/ttyUSB1", "0001", "1-2")
    dual = [listed("/dev/ttyUSB3", "0001", "1-3:1.1"), listed("/dev/ttyUSB2", "0001", "1-3:1.0")]
    plugged += [first, second, *dual]
    names = ["usb:0001@1-1", "usb:0001@1-2", "usb:0001@1-3/1", "usb:0001@1-3/2"]
    assert [p.usb for p in list_serial_ports()] == names
    assert [port_device(name, "imu")[-1] for name in names] == ["0", "1", "2", "3"]
    with raises_code(DeviceFaultError, "link.ambiguous"):
        port_device("usb:0001/2", "imu")


def test_name_of_a_disconnected_adapter_is_not_reused(plugged: list[object]) -> None:
    plugged += [listed("/dev/ttyUSB0", "0001", "1-2")]  # the adapter at 1-1 was unplugged
    assert port_device("usb:0001@1-2", "table") == "/dev/ttyUSB0"
    for name in ("usb:0001@1-1", "usb:0001/1", "usb:0001/2"):
        with raises_code(DeviceFaultError, "link.not_plugged_in"):
            port_device(name, "table")


def test_adapters_with_equal_serial_numbers_and_no_location_have_no_name(plugged: list[object]) -> None:
    plugged += [listed("COM3", "0001"), listed("COM4", "0001")]
    assert [p.usb for p in list_serial_ports()] == [None, None]
    with raises_code(DeviceFaultError, "link.ambiguous"):
        port_device("usb:0001", "table")


def test_missing_adapter_is_reported_with_the_available_adapters(plugged: list[object]) -> None:
    plugged.append(listed("/dev/ttyUSB0", "B1", "1-1"))
    with raises_code(DeviceFaultError, "link.no_adapter") as imu:
        SerialLink("usb:A9", SerialSettings(), "imu")
    with raises_code(DeviceFaultError, "link.no_adapter") as table:
        ModbusLink("usb:A9", 1, 0.1, SerialSettings())
    found = ["usb:B1 (/dev/ttyUSB0)"]
    assert imu.value.values == {"device": "imu", "port": "usb:A9", "found": found}
    assert table.value.values == {"device": "table", "port": "usb:A9", "found": found}


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on Windows")
def test_both_link_types_open_the_adapter_port_exclusively(plugged: list[object]) -> None:
    master, slave = os.openpty()
    plugged.append(listed(os.ttyname(slave), "A9", "1-2"))
    link = SerialLink("usb:A9", SerialSettings(), "imu")
    os.write(master, b"abc")
    assert link.read(1.0) == b"abc"
    assert diagnose_port("usb:A9", SerialSettings(), 1.0)[0] == "busy"
    with raises_code(DeviceFaultError, "link.in_use"):
        SerialLink("usb:A9", SerialSettings(), "imu")
    link.close()
    ModbusLink("usb:A9", 1, 0.1, SerialSettings()).close()
    os.close(slave)
    os.close(master)
