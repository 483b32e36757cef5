"""Diagnosis of a port that cannot be opened, with a reason that the user can act on."""

import errno
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

from calstation.devices.links.serial_link import LINK_ERRORS, Device, link_reason, open_serial
from calstation.devices.links.serial_ports import resolve
from calstation.devices.profiles import SerialSettings
from calstation.errors import DeviceFaultError
from calstation.messages import Text

#: In order: no such USB adapter, no such port, no permission, in use, unsuitable settings, malformed host:port, host
#: not found, connection refused, host unreachable, other.
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

#: URL schemes of TCP addresses.
SOCKETS = ("tcp://", "socket://")


def host_and_port(url: str) -> tuple[str, int] | None:
    """Return host and port of ``tcp://host:port`` or ``socket://host:port``; None for any other URL."""
    for scheme in SOCKETS:
        if url.startswith(scheme):
            host, _, number = url.removeprefix(scheme).partition("/")[0].rpartition(":")
            if host and number.isdecimal() and 0 < int(number) < 65536:
                return host, int(number)
    return None


def why_not(port: str, settings: SerialSettings, timeout: float) -> tuple[Reason, Text | None]:
    """Try to open a port and return the reason why it cannot be opened, with the system's message if it adds detail.

    If the port can be opened now, the reason is "other". `timeout` is the host time for a network connection, s.
    """
    if port.startswith(SOCKETS):
        return _why_no_connection(port, timeout)
    try:
        device = resolve(port, "imu")
    except DeviceFaultError as exc:
        return "no_adapter", exc.as_text
    try:
        open_serial(device, settings).close()
    except ValueError as exc:
        return "bad_settings", Text.of("os.other", words=str(exc))
    except LINK_ERRORS as exc:
        return _kind(exc), link_reason(exc)
    return "other", None


@contextmanager
def explained(device: Device, port: str, timeout: float) -> Iterator[None]:
    """Raise a fault with the reason if opening a ``tcp://`` port fails in this context; `timeout` is host time, s."""
    try:
        yield
    except DeviceFaultError as fault:
        reason = _why_no_connection(port, timeout)[0] if port.startswith("tcp://") else "other"
        if reason in ("unknown_host", "refused", "unreachable"):
            raise DeviceFaultError(f"link.{reason}", device=device, port=port, seconds=timeout) from fault
        raise


def _why_no_connection(port: str, timeout: float) -> tuple[Reason, Text | None]:
    address = host_and_port(port)
    if address is None:
        return "bad_address", None
    try:
        socket.create_connection(address, timeout=timeout).close()
    except socket.gaierror as exc:
        return "unknown_host", link_reason(exc)
    except ConnectionRefusedError as exc:
        return "refused", link_reason(exc)
    except OSError as exc:
        return "unreachable", link_reason(exc)
    return "other", None


def _kind(exc: BaseException) -> Reason:
    number, text = getattr(exc, "errno", None), str(exc)
    if isinstance(exc, PermissionError) or number in (errno.EACCES, errno.EPERM) or "PermissionError" in text:
        # Windows reports "Access is denied" both for a port in use and for a forbidden one.
        return "busy" if "PermissionError" in text else "no_permission"
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in text:
        return "busy"
    if number in (errno.ENOENT, errno.ENODEV, errno.ENXIO) or "FileNotFoundError" in text:
        return "no_port"
    if number in (errno.EINVAL, errno.ENOTTY) or type(exc).__module__ == "termios":
        return "bad_settings"
    return "other"
