"""Requests and replies of Modbus RTU on a serial line.

An RTU reply does not identify its request ("Modbus over Serial Line" V1.02, 2.5), so a late reply could be mistaken for
the reply to the next request. Only replies to reads of different lengths can be distinguished (see `dialogue`).
"""

import struct
import time
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from typing import cast

from calstation.devices.codecs import Reply, check_bytes
from calstation.devices.links.dialogue import Dialogue, Refusal, Transaction
from calstation.devices.links.serial_link import Device, PortLostError, SerialLink
from calstation.devices.profiles import SerialSettings
from calstation.messages import Text

READ, WRITE, WRITE_MANY, REFUSED = 0x03, 0x06, 0x10, 0x80

#: Largest size of a reply frame, bytes.
MAX_FRAME_SIZE = 260

#: Silence between two frames, in character times.
_FRAME_GAP = 3.5


class UnansweredError(Exception):
    """No valid reply arrived in time; `reason` describes why."""

    def __init__(self, reason: Text) -> None:
        super().__init__(reason.code)
        self.reason = reason


class RefusedError(Refusal):
    """The device replied with the Modbus exception `number`."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


class RtuReply:
    """Reply frames of Modbus RTU."""

    def __init__(self, unit: int) -> None:
        self.sync = bytes([unit])

    def size(self, buffer: bytes, start: int) -> int | None:
        """Return the size of the frame at `start`; see `PacketKind`."""
        if len(buffer) < start + 3:
            return None
        function = buffer[start + 1]
        if function == READ:
            return 5 + buffer[start + 2]
        if function in (WRITE, WRITE_MANY):
            return 8
        return 5 if function & ~REFUSED in (READ, WRITE, WRITE_MANY) else 0

    def is_valid(self, packet: bytes) -> bool:
        """Return whether the checksum of a frame is correct."""
        return check_bytes("crc16_modbus", packet[:-2], "little") == packet[-2:]

    def reply(self, packet: bytes) -> Reply:
        """Return the function code and data of a frame."""
        return Reply(packet[1], packet[2:-2])


@dataclass(frozen=True)
class RtuRequest:
    """A request to a unit; `begins` are the first bytes of the data in its reply."""

    unit: int
    function: int
    payload: bytes
    begins: bytes

    @staticmethod
    def read(unit: int, address: int, count: int) -> "RtuRequest":
        """Return a request that reads holding registers."""
        return RtuRequest(unit, READ, struct.pack(">HH", address, count), bytes([2 * count]))

    @staticmethod
    def write(unit: int, address: int, values: list[int]) -> "RtuRequest":
        """Return a request that writes holding registers in one transfer."""
        if len(values) == 1:
            payload = struct.pack(">HH", address, values[0])
            return RtuRequest(unit, WRITE, payload, payload)
        head = struct.pack(">HH", address, len(values))
        body = struct.pack(f">B{len(values)}H", 2 * len(values), *values)
        return RtuRequest(unit, WRITE_MANY, head + body, head)

    @property
    def frame(self) -> bytes:
        """Bytes to send, including the checksum."""
        body = bytes([self.unit, self.function]) + self.payload
        return body + check_bytes("crc16_modbus", body, "little")

    @property
    def address(self) -> int:
        """Address of the first register."""
        return int.from_bytes(self.payload[:2], "big")

    def transaction(self, refusal: Callable[[int], Refusal]) -> Transaction[bytes]:
        """Return a transaction whose result is the data in the reply; `refusal` creates the error for an exception."""

        def parse(reply: Reply) -> bytes | None:
            if reply.op == self.function | REFUSED:
                raise refusal(reply.payload[0])
            return reply.payload if reply.op == self.function and reply.payload.startswith(self.begins) else None

        return Transaction(self.frame, (self.function, self.begins), parse)


class RtuLine:
    """A serial line with Modbus units. The class is not thread-safe.

    `timeout` is the host time for a reply, s; `received` contains the bytes received last, whether valid or not.
    """

    deviation: str | None = None  #: For TCP only.

    def __init__(self, port: str, timeout: float, settings: SerialSettings, device: Device = "table") -> None:
        self.received = b""
        self._port, self._timeout, self._settings, self._device = port, timeout, settings, device
        self._gap = _FRAME_GAP * (2 + settings.data_bits + settings.stop_bits) / settings.baud
        self._link: SerialLink | None = None
        self._units: dict[int, RtuUnit] = {}
        self._last = 0.0

    @property
    def open(self) -> bool:
        """Whether the port is open."""
        return self._link is not None

    def connect(self) -> None:
        """Open the port. Raises ConfigurationError or DeviceFaultError."""
        self._link = SerialLink(self._port, self._settings, self._device)

    def close(self) -> None:
        """Close the port; this never raises an exception."""
        if self._link is not None:
            self._link.close()
        self._link = None

    def read(self, unit: int, address: int, count: int) -> list[int]:
        """Read holding registers. Raises UnansweredError, RefusedError, or PortLostError after closing the port."""
        self._unit(unit).lengths.setdefault(count, address)
        data = self._ask(RtuRequest.read(unit, address, count))
        return list(struct.unpack(f">{count}H", data[1 : 1 + 2 * count]))

    def write(self, unit: int, address: int, values: list[int], *, repeat: bool, again: bool) -> None:
        """Write holding registers. Raises the errors of `read`.

        Parameters
        ----------
        unit : Modbus unit number
        address, values : 0-based address of the first register, and unsigned 16-bit values
        repeat, again : `urgent` and `again` of `Dialogue.ask`
        """
        self._ask(RtuRequest.write(unit, address, values), urgent=repeat, again=again)

    def reply_time(self, unit: int, limit: float) -> float | None:
        """Discard late replies and return the reply time of one read, s; None without a reply within `limit` s.

        Also returns None if the line is never silent, e.g. because a device sends without requests.
        """
        try:
            end = time.monotonic() + 2.0 * limit
            while self.receive(limit):
                if time.monotonic() > end:
                    return None
            self.send(RtuRequest.read(unit, 0, 1).frame)
            begin, received = time.monotonic(), b""
            while (passed := time.monotonic() - begin) < limit:
                received += self.receive(limit - passed)
                if any(True for _ in replies(unit, received)):
                    return time.monotonic() - begin
        except (PortLostError, UnansweredError):
            pass
        return None

    def receive(self, wait: float) -> bytes:
        """Return the bytes received within `wait` s of host time. Raises PortLostError as `read` does."""
        try:
            data = self._opened().read(wait)
        except PortLostError:
            self.close()
            raise
        if data:
            self.received, self._last = data, time.monotonic()
        return data

    def send(self, data: bytes) -> None:
        """Send a frame after the silence that ends the previous frame. Raises PortLostError as `read` does."""
        time.sleep(max(0.0, self._last + self._gap - time.monotonic()))
        try:
            self._opened().write(data)
        except PortLostError:
            self.close()
            raise
        self._last = time.monotonic()

    def _opened(self) -> SerialLink:
        if self._link is None:
            raise UnansweredError(Text("modbus.link_gone"))
        return self._link

    def _unit(self, number: int) -> "RtuUnit":
        return self._units.setdefault(number, RtuUnit(self, number))

    def _ask(self, request: RtuRequest, *, urgent: bool = False, again: bool = False) -> bytes:
        unit = self._unit(request.unit)
        data = unit.dialogue.ask(request.transaction(RefusedError), self._timeout, urgent=urgent, again=again)
        if data is None:
            raise UnansweredError(Text("modbus.other_answer" if unit.has_replied else "modbus.no_answer"))
        return data


class RtuUnit:
    """The dialogue with one unit on a line.

    lengths : address of the first read of each length, by the number of registers
    has_replied : whether a valid reply has arrived since the last request
    """

    def __init__(self, line: RtuLine, number: int) -> None:
        self._line, self._number = line, number
        self._received = b""
        self.lengths: dict[int, int] = {}
        self.has_replied = False
        self.dialogue = Dialogue(self._send, self._receive, self._other_transactions, self._may_belong)

    def _send(self, data: bytes) -> None:
        self._received, self.has_replied = b"", False
        self._line.send(data)

    def _receive(self, wait: float) -> list[Reply] | None:
        data = self._line.receive(wait)
        if not data:
            return None
        received = self._received + data
        parsed = list(replies(self._number, received))
        end = parsed[-1][1] if parsed else 0
        self._received = received[max(end, len(received) - MAX_FRAME_SIZE) :]
        self.has_replied |= bool(parsed)
        return [reply for reply, _ in parsed]

    def _other_transactions(self) -> Iterator[Transaction[bytes]]:
        """Yield reads of different lengths: first lengths read before, then shorter ones, which may be refused."""
        lengths = self.lengths or {1: 0}
        longest = max(lengths)
        for count in (*lengths, *range(1, max(longest, 2) + 1)):
            yield RtuRequest.read(self._number, lengths.get(count, lengths[longest]), count).transaction(RefusedError)

    @staticmethod
    def _may_belong(reply: Reply, signature: Hashable, refusal: bool) -> bool:
        function, begins = cast(tuple[int, bytes], signature)
        return reply.op == function | REFUSED or (reply.op == function and reply.payload.startswith(begins))


def replies(unit: int, received: bytes) -> Iterator[tuple[Reply, int]]:
    """Yield a unit's valid replies in received bytes, each with the index of the byte after it."""
    kind, start = RtuReply(unit), 0
    while 0 <= (start := received.find(kind.sync, start)) < len(received):
        size = kind.size(received, start)
        packet = received[start : start + size] if size else b""
        if size and len(packet) == size and kind.is_valid(packet):
            start += size
            yield kind.reply(packet), start
        else:
            start += 1
