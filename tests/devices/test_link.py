"""Every port failure gives one clear error."""

import os
import socket
import sys
import threading

import pytest

from calstation.devices.links import SerialLink
from calstation.devices.profiles import SerialSettings
from calstation.errors import CalstationError, DeviceFaultError
from tests.helpers import raises_code

SETTINGS = SerialSettings()


def test_bytes_pass_in_both_directions_over_a_socket() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = SerialLink(f"socket://127.0.0.1:{server.getsockname()[1]}", SETTINGS, "imu")
        peer, _ = server.accept()
        assert link.read(0.01) == b""
        peer.sendall(b"\x55" * 1000)
        assert link.read(1.0) == b"\x55" * 1000
        link.write(b"hello")
        assert peer.recv(10) == b"hello"
        peer.close()
        with raises_code(DeviceFaultError, "link.lost"):
            link.read(1.0)
        link.close()


def test_blocking_read_returns_with_the_first_bytes() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = SerialLink(f"socket://127.0.0.1:{server.getsockname()[1]}", SETTINGS, "imu")
        peer, _ = server.accept()
        timer = threading.Timer(0.05, lambda: peer.sendall(b"x"))
        timer.start()
        assert link.read(5.0) == b"x"
        timer.join()
        peer.close()
        link.close()


def test_missing_port_is_reported_with_the_available_ports() -> None:
    name = "COM250" if sys.platform == "win32" else "/dev/ttyNONE7"
    with raises_code(DeviceFaultError, "link.no_such_port") as caught:
        SerialLink(name, SETTINGS, "imu")
    assert caught.value.values["port"] == name
    assert isinstance(caught.value.values["found"], list)
    assert "\n" not in str(caught.value)


def test_a_refused_connection_is_reported() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with raises_code(DeviceFaultError, "link.nothing_served"):
        SerialLink(f"socket://127.0.0.1:{port}", SETTINGS, "table")


@pytest.mark.parametrize(
    ("port", "code"),
    [("nosuch://x", "link.bad_settings"), ("socket://x", "link.nothing_served"), ("", "link.no_such_port")],
)
def test_invalid_port_is_reported(port: str, code: str) -> None:
    with raises_code(CalstationError, code) as caught:
        SerialLink(port, SETTINGS, "imu")
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on Windows")
def test_disconnected_terminal_is_reported() -> None:
    master, slave = os.openpty()
    link = SerialLink(os.ttyname(slave), SETTINGS, "imu")
    os.write(master, b"abc")
    assert link.read(1.0) == b"abc"
    os.close(slave)
    os.close(master)
    with raises_code(DeviceFaultError, "link.lost"):
        link.read(1.0)
    with raises_code(DeviceFaultError, "link.lost"):
        link.write(b"x")
    link.close()
