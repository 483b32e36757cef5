"""Links that receive messages instead of a stream of bytes: UDP datagrams, and CAN messages.

The port `udp://HOST:PORT` receives the datagrams that HOST sends to PORT of this computer; without HOST, those of the
first computer that sends any. The port `can://INTERFACE/CHANNEL/ID,ID,...` receives the messages with these hexadecimal
identifiers on a bus of python-can.
"""

import re
import socket
import struct
import sys
import time
from typing import TYPE_CHECKING, NamedTuple, Protocol

from calstation.devices.links.serial_link import Device, PortLostError, SerialLink, link_reason
from calstation.devices.profiles import SerialSettings
from calstation.errors import ConfigurationError, DeviceFaultError

if TYPE_CHECKING:
    import can

#: Schemes of the ports of these links.
UDP, CAN = "udp://", "can://"
_DATAGRAM, _ANCILLARY = 65536, 64
#: Option and type of the kernel's time stamp in ns (Linux, socket(7)), which Python does not name.
_TIMESTAMPNS = 35
_RECEIVE_BUFFER = 1 << 20
#: Age above which a time stamp is taken to be from another clock, s.
_MAX_AGE = 1.0
_LARGEST_STANDARD_ID, _LARGEST_ID = 0x7FF, 0x1FFFFFFF


class Link(Protocol):
    """An open port from which the bytes of an IMU are read."""

    port: str
    received_at: float  #: Time at which the last bytes were received, by the monotonic clock of the host, s.

    def read(self, wait: float) -> bytes:
        """Return the bytes received, waiting at most `wait` s for the first one. Raises PortLostError."""

    def write(self, data: bytes) -> None:
        """Send bytes. Raises PortLostError."""

    def close(self) -> None:
        """Close the port; this never raises an exception."""


class CanPort(NamedTuple):
    """A bus of python-can, and the identifiers of the messages of a sample, in order."""

    interface: str
    channel: str
    ids: tuple[int, ...]


def udp_address(port: str) -> tuple[str, int] | None:
    """Return host, "" for any, and port number of ``udp://host:port``; None for any other text."""
    host, _, number = port.removeprefix(UDP).rpartition(":")
    return (host, int(number)) if number.isdecimal() and 0 < int(number) < 65536 else None


def can_port(port: str) -> CanPort | None:
    """Return the bus and the identifiers of ``can://interface/channel/ids``; None for any other text."""
    match = re.fullmatch(r"([\w.-]+)/(.+)/([0-9A-Fa-f]{1,8}(?:,[0-9A-Fa-f]{1,8})*)", port.removeprefix(CAN))
    ids = tuple(int(each, 16) for each in match[3].split(",")) if match else (_LARGEST_ID + 1,)
    return CanPort(match[1], match[2], ids) if match and max(ids) <= _LARGEST_ID else None


def _monotonic(stamp: float) -> float:
    """Convert a time stamp of the system clock, s, to the monotonic clock; return now if it is from another clock."""
    age = time.time() - stamp
    return time.monotonic() - (age if 0.0 <= age < _MAX_AGE else 0.0)


class UdpLink:
    """Datagrams that arrive at a port of this computer, with the times at which the kernel received them.

    Raises ConfigurationError if the port is invalid, DeviceFaultError if it cannot be opened.
    """

    def __init__(self, port: str, device: Device) -> None:
        self.port, self.device = port, device
        self.received_at = time.monotonic()
        address = udp_address(port)
        if address is None:
            raise ConfigurationError("link.bad_address", device=device, port=port)
        host, number = address
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._peer = (socket.gethostbyname(host), number) if host else None
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            if sys.platform == "linux":
                self._socket.setsockopt(socket.SOL_SOCKET, _TIMESTAMPNS, 1)
            self._socket.bind(("", number))
        except (OSError, UnicodeError) as exc:
            self._socket.close()
            raise DeviceFaultError("link.nothing_served", device=device, port=port, reason=link_reason(exc)) from exc

    def read(self, wait: float) -> bytes:
        """Return the next datagram, waiting at most `wait` s. Raises PortLostError."""
        self._socket.settimeout(max(wait, 1e-6))
        try:
            data, sender = self._receive()
        except (TimeoutError, BlockingIOError):
            return b""
        except OSError as exc:
            raise self._lost(exc) from exc
        if self._peer is not None and self._peer[0] != sender[0]:
            return b""
        self._peer = sender
        return data

    def _receive(self) -> tuple[bytes, tuple[str, int]]:
        if not hasattr(self._socket, "recvmsg"):  # Windows
            data, sender = self._socket.recvfrom(_DATAGRAM)
            self.received_at = time.monotonic()
            return data, sender
        data, ancillary, _, sender = self._socket.recvmsg(_DATAGRAM, _ANCILLARY)
        self.received_at = time.monotonic()
        for level, kind, content in ancillary:
            if (level, kind) == (socket.SOL_SOCKET, _TIMESTAMPNS) and len(content) >= struct.calcsize("@ll"):
                seconds, nanoseconds = struct.unpack_from("@ll", content)
                self.received_at = _monotonic(seconds + 1e-9 * nanoseconds)
        return data, sender

    def write(self, data: bytes) -> None:
        """Send a datagram to the computer that sent the last one. Raises PortLostError."""
        if self._peer is None:
            return
        try:
            self._socket.sendto(data, self._peer)
        except OSError as exc:
            raise self._lost(exc) from exc

    def close(self) -> None:
        """Close the port."""
        self._socket.close()

    def _lost(self, exc: OSError) -> PortLostError:
        return PortLostError("link.lost", device=self.device, port=self.port, reason=link_reason(exc))


class CanLink:
    """Messages of a CAN bus, with the times of the interface; `bitrate` is in bit/s.

    The messages of a sample must arrive in the order of the port's identifiers, or they are dropped. They are read as
    one packet: the first identifier (4 bytes, most significant first), the data of all messages, and their 8-bit sum
    (`sum8`), which replaces the CRC that the interface has checked.

    Raises ConfigurationError if the port is invalid or python-can is missing, DeviceFaultError if it cannot be opened.
    """

    def __init__(self, port: str, bitrate: int, device: Device) -> None:
        self.port, self.device = port, device
        self.received_at = time.monotonic()
        bus = can_port(port)
        if bus is None:
            raise ConfigurationError("link.bad_can_port", device=device, port=port)
        self._ids = bus.ids
        self._parts: list[bytes] = []
        try:
            import can
        except ImportError as exc:
            raise ConfigurationError("link.no_can", device=device, port=port) from exc
        self._errors = (can.CanError, OSError, ValueError)
        filters = [{"can_id": each, "can_mask": _LARGEST_ID} for each in bus.ids]
        try:
            self._bus: can.BusABC = can.Bus(
                channel=bus.channel, interface=bus.interface, bitrate=bitrate, can_filters=filters
            )
        except self._errors as exc:
            raise DeviceFaultError("link.nothing_served", device=device, port=port, reason=link_reason(exc)) from exc

    def read(self, wait: float) -> bytes:
        """Return the next packet, waiting at most `wait` s. Raises PortLostError."""
        end = time.monotonic() + wait
        while True:
            try:
                message = self._bus.recv(max(end - time.monotonic(), 0.0))
            except self._errors as exc:
                raise self._lost(exc) from exc
            if message is None:
                return b""
            if packet := self._packet(message):
                self.received_at = _monotonic(message.timestamp)
                return packet

    def _packet(self, message: "can.Message") -> bytes:
        """Add a message to those of the same sample; return the packet, or b"" while messages are missing."""
        if message.is_remote_frame or message.is_error_frame:
            return b""
        if message.arbitration_id != self._ids[len(self._parts)]:
            self._parts.clear()
        if message.arbitration_id != self._ids[len(self._parts)]:
            return b""
        self._parts.append(bytes(message.data))
        if len(self._parts) < len(self._ids):
            return b""
        packet = self._ids[0].to_bytes(4, "big") + b"".join(self._parts)
        self._parts.clear()
        return packet + bytes([sum(packet) & 0xFF])

    def write(self, data: bytes) -> None:
        """Send a message: identifier (4 bytes, most significant first) and data. Raises PortLostError."""
        import can

        number = int.from_bytes(data[:4], "big")
        is_extended = number > _LARGEST_STANDARD_ID
        try:
            self._bus.send(can.Message(arbitration_id=number, data=data[4:], is_extended_id=is_extended))
        except self._errors as exc:
            raise self._lost(exc) from exc

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()

    def _lost(self, exc: BaseException) -> PortLostError:
        return PortLostError("link.lost", device=self.device, port=self.port, reason=link_reason(exc))


def open_link(port: str, settings: SerialSettings) -> Link:
    """Open the link of an IMU at a port of any kind. Raises DeviceFaultError or ConfigurationError."""
    if port.startswith(UDP):
        return UdpLink(port, "imu")
    if port.startswith(CAN):
        return CanLink(port, settings.baud, "imu")
    return SerialLink(port, settings, "imu")
