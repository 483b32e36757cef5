"""A Modbus server, TCP or RTU: requests in the received bytes of a line, and their replies."""

import struct
from collections.abc import Callable, Mapping
from typing import Protocol

from fastcrc import crc16

from calstation.bench.table import NoSuchRegister, OutOfRange, Refusal

READ, WRITE, WRITE_MANY = 3, 6, 16

#: Modbus exceptions by the refusal of a unit; DEVICE_FAILURE for any other.
_EXCEPTIONS = {NoSuchRegister: 2, OutOfRange: 3}
_ILLEGAL_FUNCTION, _ILLEGAL_VALUE, _DEVICE_FAILURE, _NO_SUCH_UNIT = 1, 3, 4, 11

#: Sizes of transaction number, protocol and length, which precede a request over TCP.
_HEADER = 6


class NoReply(Exception):  # noqa: N818 - an event of the unit, not an error of the program
    """The unit does not reply to a request."""


class ModbusUnit(Protocol):
    """The holding registers of a unit. Both methods raise a `Refusal` or NoReply."""

    def read(self, address: int, count: int) -> list[int]:
        """Return the content of registers."""

    def write(self, address: int, values: list[int]) -> None:
        """Execute one write request."""


class ModbusServer:
    """A server with the registers of each unit number, over `tcp` or RTU.

    `mute` and `garble` count the requests still to be ignored and the replies still to get a flipped bit; `refuse` is
    the Modbus exception of the next reply, 0 for none.
    """

    def __init__(self, units: Mapping[int, ModbusUnit], *, tcp: bool = False) -> None:
        self.mute = self.garble = self.refuse = 0
        self._units, self._tcp = units, tcp

    def talk(self) -> Callable[[bytes], list[bytes]]:
        """Return a parser for one connection, which converts received bytes to replies."""
        pending = b""

        def answer(data: bytes) -> list[bytes]:
            nonlocal pending
            pending += data
            replies = []
            while (size := self._size(pending)) is not None and size <= len(pending):
                request, pending = pending[: size or 1], pending[size or 1 :]
                if self._tcp:
                    replies.append(self._framed(request[:4], self._reply(request[_HEADER:])))
                elif size and _checksum(request[:-2]) == request[-2:]:
                    replies.append(self._framed(b"", self._reply(request[:-2])))
                else:  # search for a request from the next byte on
                    pending = request[1:] + pending
            return replies

        return answer

    def _size(self, data: bytes) -> int | None:
        """Return the size of the request at the start of `data`; None if not known yet, 0 if there is no request."""
        if self._tcp:
            return None if len(data) < _HEADER else _HEADER + int.from_bytes(data[4:_HEADER], "big")
        if len(data) < 2:
            return None
        if data[0] not in self._units or data[1] not in (READ, WRITE, WRITE_MANY):
            return 0
        if data[1] != WRITE_MANY:
            return 8
        if len(data) < 7:
            return None
        return 9 + data[6] if data[6] == 2 * int.from_bytes(data[4:6], "big") else 0

    def _reply(self, request: bytes) -> bytes:
        """Return the reply to unit number, function code and data; empty without one."""
        number, function = request[:2]
        self.mute, muted = max(0, self.mute - 1), self.mute > 0
        if muted:
            return b""
        code, self.refuse = self.refuse, 0
        try:
            if not code and number in self._units:
                return request[:2] + self._execute(self._units[number], function, request[2:])
        except NoReply:
            return b""
        except Refusal as refusal:
            code = _EXCEPTIONS.get(type(refusal), _DEVICE_FAILURE)
        except (struct.error, KeyError):
            code = _ILLEGAL_FUNCTION
        return bytes([number, function | 0x80, code or _NO_SUCH_UNIT])

    @staticmethod
    def _execute(unit: ModbusUnit, function: int, data: bytes) -> bytes:
        address, second = struct.unpack(">HH", data[:4])
        if function == READ:
            if not 1 <= second <= 125:
                raise OutOfRange
            return struct.pack(f">B{second}H", 2 * second, *unit.read(address, second))
        values = {WRITE: [second], WRITE_MANY: list(struct.unpack(f">{len(data[5:]) // 2}H", data[5:]))}
        unit.write(address, values[function])
        return data[:4]

    def _framed(self, transaction: bytes, reply: bytes) -> bytes:
        """Return a reply as it is sent; a fault changes its transaction number over TCP, or its checksum."""
        if not reply:
            return reply
        sent = transaction + struct.pack(">H", len(reply)) + reply if self._tcp else reply + _checksum(reply)
        if self.garble:
            self.garble -= 1
            at = 0 if self._tcp else len(sent) - 1
            sent = sent[:at] + bytes([sent[at] ^ 0x10]) + sent[at + 1 :]
        return sent


def _checksum(data: bytes) -> bytes:
    """Return the checksum of an RTU frame, low byte first."""
    return int(crc16.modbus(data)).to_bytes(2, "little")
