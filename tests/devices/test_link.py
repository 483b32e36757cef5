"""Every way a port can fail becomes one clear error."""

import os
import socket
import sys
import threading

import pytest

from calstation.devices.links.serial_link import SerialLink
from calstation.devices.profiles.serial_settings import SerialSettings
from calstation.errors import CalstationError, DeviceFaultError

SETTINGS = SerialSettings()


def test_bytes_pass_both_ways_over_a_socket() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = SerialLink(f"socket://127.0.0.1:{server.getsockname()[1]}", SETTINGS, "IMU")
        peer, _ = server.accept()
        assert link.read(0.01) == b""
        peer.sendall(b"\x55" * 1000)
        assert link.read(1.0) == b"\x55" * 1000
        link.write(b"hello")
        assert peer.recv(10) == b"hello"
        peer.close()
        with pytest.raises(DeviceFaultError, match=r"IMU: port socket://.* was lost"):
            link.read(1.0)
        link.close()


def test_a_waiting_read_returns_with_the_first_bytes() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = SerialLink(f"socket://127.0.0.1:{server.getsockname()[1]}", SETTINGS, "IMU")
        peer, _ = server.accept()
        timer = threading.Timer(0.05, lambda: peer.sendall(b"x"))
        timer.start()
        assert link.read(5.0) == b"x"
        timer.join()
        peer.close()
        link.close()


def test_a_port_that_does_not_exist_is_told_with_those_that_do() -> None:
    name = "COM250" if sys.platform == "win32" else "/dev/ttyNONE7"
    with pytest.raises(DeviceFaultError) as caught:
        SerialLink(name, SETTINGS, "IMU")
    assert str(caught.value).startswith(f"IMU: port {name} cannot be opened (")
    assert "ports found:" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_refused_connection_is_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(DeviceFaultError, match=f"port socket://127.0.0.1:{port} cannot be opened"):
        SerialLink(f"socket://127.0.0.1:{port}", SETTINGS, "table")


@pytest.mark.parametrize("port", ["nosuch://x", "socket://x", ""])
def test_an_impossible_port_is_told(port: str) -> None:
    with pytest.raises(CalstationError, match="IMU: port") as caught:
        SerialLink(port, SETTINGS, "IMU")
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on Windows")
def test_a_pulled_plug_is_told_on_a_terminal() -> None:
    master, slave = os.openpty()
    link = SerialLink(os.ttyname(slave), SETTINGS, "IMU")
    os.write(master, b"abc")
    assert link.read(1.0) == b"abc"
    os.close(slave)
    os.close(master)
    with pytest.raises(DeviceFaultError, match="was lost"):
        link.read(1.0)
    with pytest.raises(DeviceFaultError, match="was lost"):
        link.write(b"x")
    link.close()
