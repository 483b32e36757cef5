"""Serial ports of this computer, links on ports supported by pyserial, and reasons why a port cannot be opened."""

import errno
import re
import select
import socket
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Literal

import serial
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from calstation.devices.profiles import SerialSettings
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.messages import Text, os_reason

try:
    from termios import error as termios_error
except ImportError:  # Windows has no termios
    termios_error = OSError  # type: ignore[assignment, misc]

#: Exceptions that pyserial raises, e.g. OSError for a closed pty and termios.error for a refused parity.
LINK_ERRORS = (serial.SerialException, OSError, termios_error)

#: Device on a port, as a code of the message family `source`.
Device = Literal["table", "chamber", "imu"]

_READ_SIZE = 65536


class PortLostError(DeviceFaultError):
    """An open port was lost, because it was unplugged or the device closed the connection."""


class SerialLink:
    """An open port: `/dev/...`, `COM3`, `usb:SERIALNUMBER`, `socket://host:port` or `rfc2217://host:port`.

    Raises ConfigurationError if the port name is invalid or the settings do not suit the port, DeviceFaultError if the
    port cannot be opened. The class is not thread-safe.
    """

    def __init__(self, port: str, settings: SerialSettings, device: Device) -> None:
        self.port = port
        self.device = device
        self.received_at = time.monotonic()  #: Time of the last read, s.
        name = port_device(port, device)
        try:
            self._serial = open_serial(name, settings)
        except ValueError as exc:
            raise ConfigurationError("link.bad_settings", device=device, port=port, reason=str(exc)) from exc
        except LINK_ERRORS as exc:
            raise self._not_opened(exc) from exc
        try:
            self._fileno: int | None = self._serial.fileno()
        except (AttributeError, OSError, ValueError):
            self._fileno = None

    def read(self, wait: float) -> bytes:
        """Return the bytes received, waiting at most `wait` s for the first one. Raises PortLostError."""
        try:
            if self._fileno is not None:
                ready, _, _ = select.select([self._fileno], [], [], wait)
                data = bytes(self._serial.read(_READ_SIZE)) if ready else b""
            else:
                if self._serial.timeout != wait:
                    self._serial.timeout = wait
                first = self._serial.read(1)
                data = bytes(first + self._serial.read(self._serial.in_waiting)) if first else b""
        except LINK_ERRORS as exc:
            raise self._lost(exc) from exc
        self.received_at = time.monotonic()
        return data

    def write(self, data: bytes) -> None:
        """Send bytes. Raises PortLostError."""
        try:
            self._serial.write(data)
        except LINK_ERRORS as exc:
            raise self._lost(exc) from exc

    def close(self) -> None:
        """Close the port; this never raises an exception."""
        # pyserial does not close a socket that the remote end has closed.
        connection = getattr(self._serial, "_socket", None)
        with suppress(*LINK_ERRORS):
            self._serial.close()
        if connection is not None:
            connection.close()

    def _lost(self, exc: BaseException) -> PortLostError:
        return PortLostError("link.lost", device=self.device, port=self.port, reason=link_reason(exc))

    def _not_opened(self, exc: BaseException) -> DeviceFaultError:
        at = {"device": self.device, "port": self.port, "reason": link_reason(exc)}
        if "://" in self.port:
            return DeviceFaultError("link.nothing_served", **at)
        if "exclusively lock" in str(exc):
            return DeviceFaultError("link.in_use", **at)
        if isinstance(exc, PermissionError) or "Permission" in str(exc):
            return DeviceFaultError("link.no_permission", **at)
        return DeviceFaultError("link.no_such_port", found=[p.device for p in list_serial_ports()], **at)


def link_reason(exc: BaseException) -> Text:
    """Return the reason for an error of the operating system or pyserial, worded as part of a sentence."""
    if isinstance(exc, OSError) and exc.errno is not None:
        return os_reason(exc)
    words = str(exc).rsplit("] ", 1)[-1].split(": '")[0].rstrip(".")
    return Text.of("os.other", words=words)


def open_serial(device: str, settings: SerialSettings) -> serial.Serial:
    """Open a port exclusively for this process. Raises the exceptions of pyserial, ValueError and LINK_ERRORS."""
    port = serial.serial_for_url(
        device,
        baudrate=settings.baud,
        bytesize=settings.data_bits,
        parity=settings.parity,
        stopbits=settings.stop_bits,
        timeout=0,
        write_timeout=settings.write_timeout_s,
        exclusive=True,  # each of two readers of a port would receive only part of the bytes
    )
    try:
        port.parity = settings.parity  # a port without parity may accept the setting first and ignore it later
    except LINK_ERRORS:
        port.close()
        raise
    return port


#: Reason why a port cannot be opened.
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
    """Return the host and port of ``tcp://host:port`` or ``socket://host:port``; None for any other URL."""
    for scheme in SOCKETS:
        if url.startswith(scheme):
            host, _, number = url.removeprefix(scheme).partition("/")[0].rpartition(":")
            if host and number.isdecimal() and 0 < int(number) < 65536:
                return host, int(number)
    return None


def diagnose_port(port: str, settings: SerialSettings, timeout: float) -> tuple[Reason, Text | None]:
    """Try to open a port; return the reason why it cannot be opened, with the system's message if that adds detail.

    If the port can be opened now, the reason is "other".

    Parameters
    ----------
    port : name or address of the port
    settings : settings of a serial port
    timeout : host time for a network connection, s
    """
    if port.startswith(SOCKETS):
        return _diagnose_connection(port, timeout)
    if port.startswith(("udp://", "can://")):
        return "other", None
    try:
        device = port_device(port, "imu")
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
def with_connection_reason(device: Device, port: str, timeout: float) -> Iterator[None]:
    """Add the reason to the fault if a ``tcp://`` port cannot be opened in this context; `timeout` is host time, s."""
    try:
        yield
    except DeviceFaultError as fault:
        reason = _diagnose_connection(port, timeout)[0] if port.startswith("tcp://") else "other"
        if reason in ("unknown_host", "refused", "unreachable"):
            raise DeviceFaultError(f"link.{reason}", device=device, port=port, seconds=timeout) from fault
        raise


def _diagnose_connection(port: str, timeout: float) -> tuple[Reason, Text | None]:
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


#: Prefix of a port named by its adapter: `usb:SERIALNUMBER`, or `usb:SERIALNUMBER/2` for its second port. If several
#: adapters have the same serial number, the location on the bus is appended: `usb:SERIALNUMBER@1-4`.
USB = "usb:"


@dataclass(frozen=True)
class SerialPortInfo:
    """A serial port listed by the system, e.g. `/dev/ttyUSB0` or `COM3`; unknown attributes are empty.

    usb : name of the port derived from its adapter, which does not change with `device`; None if the adapter has no
        unique serial number and its location is unknown
    """

    device: str
    description: str
    maker: str
    serial_number: str | None
    location: str
    usb: str | None


def list_serial_ports() -> tuple[SerialPortInfo, ...]:
    """Return all serial ports of this computer, USB adapters first."""
    listed = _list_ports()
    ports = []
    for p in listed:
        description = "" if p.description in (None, "n/a", p.name) else p.description
        usb = next(iter(_names(p, listed)), None)
        ports.append(
            SerialPortInfo(p.device, description, p.manufacturer or "", p.serial_number or None, p.location or "", usb)
        )
    return tuple(sorted(ports, key=lambda port: (port.usb is None, _natural_key(port.device))))


def port_device(port: str, device: str) -> str:
    """Return the current device name of a port `usb:...`; any other port is returned unchanged.

    Raises DeviceFaultError, with `device` as its source, unless exactly one such adapter is plugged in.
    """
    if not port.startswith(USB):
        return port
    listed = _list_ports()
    for p in listed:
        if port in _names(p, listed):
            return str(p.device)
    number = port.removeprefix(USB).partition("@")[0]
    ports = list_serial_ports()
    same_serial = [p for p in ports if p.serial_number in (number, number.rpartition("/")[0])]
    if same_serial:
        choice = [f"{p.usb} ({p.device})" if p.usb else p.device for p in same_serial]
        if len(same_serial) > 1 and "@" not in port:
            raise DeviceFaultError("link.ambiguous", device=device, port=port, count=len(same_serial), choice=choice)
        raise DeviceFaultError("link.not_plugged_in", device=device, port=port, choice=choice)
    adapters = [f"{f.usb} ({f.device})" for f in ports if f.usb]
    raise DeviceFaultError("link.no_adapter", device=device, port=port, found=adapters)


def _list_ports() -> list[ListPortInfo]:
    return sorted(list_ports.comports(), key=lambda p: (_natural_key(p.location or ""), _natural_key(p.device)))


def _names(port: ListPortInfo, listed: Sequence[ListPortInfo]) -> tuple[str, ...]:
    """Return the names of a port derived from its adapter, starting with the preferred name.

    A serial number shared by several adapters is not a name, because its meaning would change if one were unplugged.
    """
    same_serial = [p for p in listed if p.serial_number and p.serial_number == port.serial_number]
    location = _location(port)
    ports = [p for p in same_serial if _location(p) == location]
    # All ports of an adapter appear and disappear together, so their order identifies them.
    which = f"/{ports.index(port) + 1}" if len(ports) > 1 else ""
    names = []
    if ports and len(ports) == len(same_serial) and (location or len(ports) == 1):
        names.append(f"{USB}{port.serial_number}{which}")
    if ports and location:
        names.append(f"{USB}{port.serial_number}@{location}{which}")
    return tuple(names)


def _location(port: ListPortInfo) -> str:
    """Return the location of an adapter on the bus without its interface; "" if it is unknown."""
    return (port.location or "").partition(":")[0]


def _natural_key(text: str) -> list[tuple[int, str]]:
    """Return a sort key that places ttyUSB10 after ttyUSB9."""
    return [(int(p), "") if p.isdecimal() else (-1, p) for p in re.split(r"(\d+)", text)]
