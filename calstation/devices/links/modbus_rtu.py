"""Modbus RTU on a serial line: requests, replies found in the received bytes, and recognition of late replies.

An RTU reply does not identify its request ("Modbus over Serial Line" V1.02, 2.5), so a late one looks like the reply to
the next request. Unanswered requests are therefore recorded, and a request whose reply would look like one that may
still arrive is sent only after a read of another length has been answered.
"""

import struct
import time
from collections.abc import Hashable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import cast

from calstation.devices.codecs import Reply, check_bytes
from calstation.devices.links.serial_link import PortLostError, SerialLink
from calstation.devices.links.unanswered import QUIET, Unanswered
from calstation.devices.profiles import SerialSettings
from calstation.messages import Text

READ, WRITE, WRITE_MANY, REFUSED = 0x03, 0x06, 0x10, 0x80

#: Largest size of a reply frame, bytes.
LARGEST = 260

#: Largest number of received bytes that are searched for late replies.
_MAX_SEARCHED = 16 * LARGEST

#: Silence between two frames, character times.
_FRAME_GAP = 3.5


#: Properties that identify a reply: unit, function, and the beginning of its data.
Signature = tuple[int, int, bytes]


class UnansweredError(Exception):
    """No valid reply arrived in time; `reason` describes what arrived instead."""

    def __init__(self, reason: Text) -> None:
        super().__init__(reason.code)
        self.reason = reason


class RefusedError(Exception):
    """The device replied with a Modbus exception of this number."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


class RtuReply:
    """Reply frames of Modbus RTU; implements `packets.ReplyKind`."""

    def __init__(self, unit: int) -> None:
        self.sync = bytes([unit])

    def size(self, buffer: bytes, start: int) -> int | None:
        if len(buffer) < start + 3:
            return None
        function = buffer[start + 1]
        if function == READ:
            return 5 + buffer[start + 2]
        if function in (WRITE, WRITE_MANY):
            return 8
        return 5 if function & ~REFUSED in (READ, WRITE, WRITE_MANY) else 0

    def is_valid(self, packet: bytes) -> bool:
        return check_bytes("crc16_modbus", packet[:-2], "little") == packet[-2:]

    def reply(self, packet: bytes) -> Reply:
        return Reply(packet[1], packet[2:-2])


@dataclass(frozen=True)
class RtuRequest:
    """A request to a unit; `begins` is the beginning of the data in its reply."""

    unit: int
    function: int
    payload: bytes
    begins: bytes

    @staticmethod
    def read(unit: int, address: int, count: int) -> "RtuRequest":
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
        body = bytes([self.unit, self.function]) + self.payload
        return body + check_bytes("crc16_modbus", body, "little")

    @property
    def signature(self) -> Signature:
        """Signature of the reply, by which it can be mistaken for others."""
        return self.unit, self.function, self.begins

    @property
    def address(self) -> int:
        return int.from_bytes(self.payload[:2], "big")

    def data_of(self, reply: Reply, unanswered: Unanswered) -> bytes | None:
        """Return the reply's data, or None if it belongs to an older request, which is removed; raises RefusedError."""
        if reply.op == self.function and reply.payload.startswith(self.begins):
            unanswered.answered(self.signature)
            return reply.payload
        refused = [signature for signature in unanswered if _refuses(reply, signature)]
        if reply.op == self.function | REFUSED and set(refused) <= {self.signature}:
            unanswered.answered(self.signature)
            raise RefusedError(reply.payload[0])
        mark_answered(reply, unanswered)
        return None


def mark_answered(reply: Reply, unanswered: Unanswered) -> None:
    """Remove the oldest unanswered request to which an unexpected reply can belong, and those before it."""
    unanswered.late(lambda signature: _refuses(reply, signature) or _answers(reply, signature))


def _answers(reply: Reply, signature: Hashable) -> bool:
    _, function, begins = cast(Signature, signature)
    return reply.op == function and reply.payload.startswith(begins)


def _refuses(reply: Reply, signature: Hashable) -> bool:
    return reply.op == cast(Signature, signature)[1] | REFUSED


class Barriers:
    """Reads whose replies differ in length from all replies that may still arrive.

    Lengths that were already read are preferred to shorter parts of the longest one, which a device might refuse.
    """

    def __init__(self) -> None:
        self._asked: dict[int, dict[int, int]] = {}

    def asked(self, unit: int, address: int, count: int) -> None:
        """Record a read of these registers."""
        self._asked.setdefault(unit, {}).setdefault(count, address)

    def next(self, unit: int, unanswered: Unanswered) -> RtuRequest:
        """Return the read to send; if replies of all lengths may still arrive, the oldest one is no longer expected."""
        asked = self._asked.get(unit, {1: 0})
        longest = max(asked)
        counts = [*asked, *(count for count in range(1, max(longest, 2) + 1) if count not in asked)]
        reads = [RtuRequest.read(unit, asked.get(count, asked[longest]), count) for count in counts]
        while True:
            for read in reads:
                if read.signature not in unanswered:
                    return read
            unanswered.forget_oldest()


class RtuLine:
    """A serial line with Modbus units; not thread-safe.

    `timeout` is the host time for a reply, s; `received` are the bytes received last, valid or not.
    """

    def __init__(self, port: str, timeout: float, settings: SerialSettings) -> None:
        self.received = b""
        self._port, self._timeout, self._settings = port, timeout, settings
        self._gap = _FRAME_GAP * (2 + settings.data_bits + settings.stop_bits) / settings.baud
        self._link: SerialLink | None = None
        self._unanswered: dict[int, Unanswered] = {}
        self._barriers = Barriers()
        self._last = 0.0

    @property
    def open(self) -> bool:
        return self._link is not None

    def connect(self) -> None:
        """Open the port. Raises ConfigurationError, DeviceFaultError."""
        self._link = SerialLink(self._port, self._settings, "table")

    def close(self) -> None:
        """Close the port; never raises."""
        if self._link is not None:
            self._link.close()
        self._link = None

    def read(self, unit: int, address: int, count: int) -> list[int]:
        """Read holding registers. Raises UnansweredError, RefusedError, or PortLostError after closing the port."""
        self._barriers.asked(unit, address, count)
        data = self._ask(RtuRequest.read(unit, address, count))
        return list(struct.unpack(f">{count}H", data[1 : 1 + 2 * count]))

    def write(self, unit: int, address: int, values: list[int], *, repeat: bool, again: bool) -> None:
        """Write holding registers. Raises like `read`.

        repeat : the write, e.g. a stop, may be sent twice; it is sent immediately even if late replies may still arrive
        again : the same write was sent just before; the reply to either one confirms it
        """
        request = RtuRequest.write(unit, address, values)
        unanswered = self._unanswered.setdefault(unit, Unanswered())
        if repeat and not again and request.signature in unanswered:
            self._send(request.frame)
            unanswered.add(request.signature)
        self._ask(request, again)

    def _ask(self, request: RtuRequest, again: bool = False) -> bytes:
        unanswered = self._unanswered.setdefault(request.unit, Unanswered())
        if request.signature in unanswered and not again:
            self._listen_until_quiet(request.unit, unanswered)
        if request.signature in unanswered and not again:
            with suppress(RefusedError):  # a refusal is also a reply
                self._exchange(self._barriers.next(request.unit, unanswered), unanswered)
        return self._exchange(request, unanswered)

    def _exchange(self, request: RtuRequest, unanswered: Unanswered) -> bytes:
        self._listen_until_quiet(request.unit, unanswered, 0.0)
        self._send(request.frame)
        deadline = time.monotonic() + self._timeout
        received, start, others = b"", 0, False
        while (left := deadline - time.monotonic()) > 0:
            received += self._receive(left)
            for reply, end in replies(request.unit, received, start):
                start, others = end, True
                data = request.data_of(reply, unanswered)
                if data is not None:
                    return data
            received, start = received[max(start, len(received) - LARGEST) :], 0
        unanswered.add(request.signature)
        raise UnansweredError(Text("modbus.other_answer" if others else "modbus.no_answer"))

    def _listen_until_quiet(self, unit: int, unanswered: Unanswered, quiet: float = QUIET) -> None:
        """Receive late replies until the line is quiet, for at most the reply timeout."""
        deadline = time.monotonic() + self._timeout
        received = b""
        while time.monotonic() < deadline and (data := self._receive(quiet)):
            received = (received + data)[-_MAX_SEARCHED:]
        for reply, _ in replies(unit, received, 0):
            mark_answered(reply, unanswered)

    def _receive(self, wait: float) -> bytes:
        assert self._link is not None
        try:
            data = self._link.read(wait)
        except PortLostError:
            self.close()
            raise
        if data:
            self.received, self._last = data, time.monotonic()
        return data

    def _send(self, data: bytes) -> None:
        assert self._link is not None
        time.sleep(max(0.0, self._last + self._gap - time.monotonic()))
        try:
            self._link.write(data)
        except PortLostError:
            self.close()
            raise
        self._last = time.monotonic()


def replies(unit: int, received: bytes, start: int) -> Iterator[tuple[Reply, int]]:
    """Yield a unit's valid replies in the bytes from `start` on, each with the index after it."""
    kind = RtuReply(unit)
    while 0 <= (start := received.find(kind.sync, start)) < len(received):
        size = kind.size(received, start)
        packet = received[start : start + size] if size else b""
        if size and len(packet) == size and kind.is_valid(packet):
            start += size
            yield kind.reply(packet), start
        else:
            start += 1
