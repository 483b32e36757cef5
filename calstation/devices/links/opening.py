"""Says why a port cannot be opened: the kinds of reasons that a person can act on."""

import errno
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

import serial

from calstation.devices.links.serial_link import LINK_ERRORS
from calstation.devices.links.serial_ports import resolve
from calstation.devices.profiles.serial_settings import SerialSettings
from calstation.errors import DeviceFaultError

#: No such USB adapter or port, not allowed to this user, in use, settings that the port refuses; host:port misspelt, a
#: name that nobody knows, nothing served at the port, no way there.
Reason = Literal[
    "no_adapter",
    "no_port",
    "no_permission",
    "busy",
    "bad_settings",
    "bad_address",
    "unknown_host",
    "refused",
    "unreachable",
    "other",
]

#: How addresses begin.
SOCKETS = ("tcp://", "socket://")

#: Why a connection does not come about, and the mend.
_WHY = {
    "unknown_host": "nobody knows this host; correct its name in the station file, or give its IP address",
    "refused": "the host is there but serves nothing at this port; correct the port number in the station file, see"
    " that the device's server is on",
    "unreachable": "no answer within {:g} s; check power, network cable and the IP address in the station file",
}

_PERMISSION = {errno.EACCES, errno.EPERM}
_BUSY = {errno.EBUSY, errno.EAGAIN}
_ABSENT = {errno.ENOENT, errno.ENODEV, errno.ENXIO}
_REFUSED_SETTINGS = {errno.EINVAL, errno.ENOTTY}


def host_and_port(url: str) -> tuple[str, int] | None:
    """Host and port of ``tcp://host:port`` or ``socket://host:port``, None where it is neither."""
    for scheme in SOCKETS:
        if url.startswith(scheme):
            host, _, number = url.removeprefix(scheme).partition("/")[0].rpartition(":")
            if host and number.isdecimal() and 0 < int(number) < 65536:
                return host, int(number)
    return None


def why_not(port: str, settings: SerialSettings, timeout: float) -> tuple[Reason, str]:
    """Try to open a port that did not open, and say what is in the way.

    Parameters
    ----------
    port : as in a station file
    timeout : host time for a connection, s

    Returns
    -------
    The kind of reason, and the system's own words for it ("" where the kind says it all). A port that opens
    now after all counts as "other".
    """
    if port.startswith(SOCKETS):
        return _why_no_connection(port, timeout)
    try:
        device = resolve(port, "port")
    except DeviceFaultError as exc:
        return "no_adapter", str(exc)
    try:
        serial.serial_for_url(
            device,
            baudrate=settings.baud,
            bytesize=settings.data_bits,
            parity=settings.parity,
            stopbits=settings.stop_bits,
            timeout=0,
            exclusive=True,
        ).close()
    except ValueError as exc:
        return "bad_settings", str(exc)
    except LINK_ERRORS as exc:
        return _kind(exc), _words(exc)
    return "other", ""


@contextmanager
def explained(name: str, port: str, timeout: float) -> Iterator[None]:
    """While a connection of the network is opened: where there is none, the fault says why.

    Parameters
    ----------
    name : what messages call the device
    timeout : host time for a connection, s
    """
    try:
        yield
    except DeviceFaultError as fault:
        if not port.startswith("tcp://"):
            raise
        reason, _ = _why_no_connection(port, timeout)
        if reason not in _WHY:
            raise
        raise DeviceFaultError(
            f"{name}: port {port} cannot be opened: {_WHY[reason].format(timeout)}"
        ) from fault


def _why_no_connection(port: str, timeout: float) -> tuple[Reason, str]:
    address = host_and_port(port)
    if address is None:
        return "bad_address", ""
    try:
        socket.create_connection(address, timeout=timeout).close()
    except socket.gaierror as exc:
        return "unknown_host", _words(exc)
    except ConnectionRefusedError as exc:
        return "refused", _words(exc)
    except OSError as exc:
        return "unreachable", _words(exc)
    return "other", ""


def _kind(exc: BaseException) -> Reason:
    number, text = getattr(exc, "errno", None), str(exc)
    if isinstance(exc, PermissionError) or number in _PERMISSION or "PermissionError" in text:
        # Windows says "Access is denied" both where a port is in use and where it is forbidden.
        return "busy" if "PermissionError" in text else "no_permission"
    if number in _BUSY or "exclusively lock" in text:
        return "busy"
    if number in _ABSENT or "FileNotFoundError" in text:
        return "no_port"
    if number in _REFUSED_SETTINGS or type(exc).__module__ == "termios":
        return "bad_settings"
    return "other"


def _words(exc: BaseException) -> str:
    return str(getattr(exc, "strerror", None) or exc).rsplit("] ", 1)[-1].split(": '")[0].rstrip(".")
