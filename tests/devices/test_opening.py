"""The reasons why a port does not open, as categories that a user can act on."""

import errno
import socket

import pytest
import serial

from calstation.devices.links import diagnose_port, host_and_port
from calstation.devices.profiles import SerialSettings

SETTINGS = SerialSettings()


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("tcp://plc.local:502", ("plc.local", 502)),
        ("socket://10.0.0.7:4001/logging=debug", ("10.0.0.7", 4001)),
        ("tcp://plc", None),
        ("tcp://plc:0", None),
        ("tcp://plc:70000", None),
        ("tcp://:502", None),
        ("/dev/ttyUSB0", None),
    ],
)
def test_addresses_are_parsed(url: str, address: tuple[str, int] | None) -> None:
    assert host_and_port(url) == address


def test_port_without_a_server_is_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    assert diagnose_port(f"tcp://127.0.0.1:{port}", SETTINGS, 1.0)[0] == "refused"
    assert diagnose_port("socket://x", SETTINGS, 1.0)[0] == "bad_address"


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (socket.gaierror(-2, "Name or service not known"), "unknown_host"),
        (TimeoutError("timed out"), "unreachable"),
        (OSError(errno.EHOSTUNREACH, "No route to host"), "unreachable"),
    ],
)
def test_unreachable_host_is_reported_with_its_reason(
    monkeypatch: pytest.MonkeyPatch, error: OSError, reason: str
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(socket, "create_connection", fail)
    assert diagnose_port("tcp://plc:502", SETTINGS, 1.0)[0] == reason


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (serial.SerialException(errno.ENOENT, "could not open port /dev/ttyUSB7: No such file"), "no_port"),
        (serial.SerialException("could not open port 'COM9': FileNotFoundError(2, '')"), "no_port"),
        (serial.SerialException(errno.EACCES, "could not open port: Permission denied"), "no_permission"),
        (serial.SerialException("could not open port 'COM3': PermissionError(13, '')"), "busy"),
        (serial.SerialException(errno.EBUSY, "Device or resource busy"), "busy"),
        (serial.SerialException(errno.EAGAIN, "Could not exclusively lock port"), "busy"),
        (ValueError("Not a valid baudrate: -1"), "bad_settings"),
        (OSError(errno.EINVAL, "Invalid argument"), "bad_settings"),
        (serial.SerialException("something else"), "other"),
    ],
)
def test_serial_port_that_does_not_open_is_reported_with_its_reason(
    monkeypatch: pytest.MonkeyPatch, error: Exception, reason: str
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(serial, "serial_for_url", fail)
    assert diagnose_port("/dev/ttyUSB7", SETTINGS, 1.0)[0] == reason


def test_missing_adapter_is_reported() -> None:
    assert diagnose_port("usb:NONE", SETTINGS, 1.0)[0] == "no_adapter"
