"""A Modbus server, TCP or RTU, which processes the bytes received on a line.

It uses the frames and messages of pymodbus, but not its servers, which do not share their line: a unit also streams on
its line, and the bench delays, corrupts and omits replies.
"""

from collections.abc import Callable, Mapping
from typing import Protocol

from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ModbusIOException
from pymodbus.framer import FramerBase, FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersResponse,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterResponse,
)

from calstation.bench.table import NoSuchRegister, OutOfRange, Refusal

#: Modbus exception for each refusal of a unit; for other refusals, it is DEVICE_FAILURE.
_EXCEPTIONS = {NoSuchRegister: ExcCodes.ILLEGAL_ADDRESS, OutOfRange: ExcCodes.ILLEGAL_VALUE}


class NoReply(Exception):  # noqa: N818 - an event of the unit, not an error of the program
    """Raised when the unit does not reply to a request."""


class ModbusUnit(Protocol):
    """The holding registers of a unit. Both methods raise a `Refusal` or NoReply."""

    def read(self, address: int, count: int) -> list[int]:
        """Return the content of registers."""

    def write(self, address: int, values: list[int]) -> None:
        """Execute one write request."""


class ModbusServer:
    """A server with the registers of each unit number, over `tcp` or RTU.

    `ignored_requests` is the number of requests to ignore, `corrupted_replies` the number of replies in which a bit is
    to be flipped, and `exception` the Modbus exception code of the next reply, or 0.
    """

    def __init__(self, units: Mapping[int, ModbusUnit], *, tcp: bool = False) -> None:
        self.ignored_requests = self.corrupted_replies = self.exception = 0
        self._units, self._tcp = units, tcp

    def new_parser(self) -> Callable[[bytes], list[bytes]]:
        """Return a parser for one connection, which converts received bytes to replies."""
        framer: FramerBase = (FramerSocket if self._tcp else FramerRTU)(DecodePDU(is_server=True))
        pending = b""

        def parse(data: bytes) -> list[bytes]:
            nonlocal pending
            pending += data
            replies: list[bytes] = []
            try:
                while True:
                    used, request = framer.handleFrame(pending, 0, 0)
                    pending = pending[used:]
                    if request is None:
                        return replies
                    reply = self._reply(request)
                    if reply is not None:
                        reply.dev_id, reply.transaction_id = request.dev_id, request.transaction_id
                        replies.append(self._sent(framer.buildFrame(reply)))
            except ModbusIOException:  # a frame without a valid request
                pending = b""
                return replies

        return parse

    def _reply(self, request: ModbusPDU) -> ModbusPDU | None:
        """Return the reply to a request; None for no reply, for example if another unit on an RTU line is addressed."""
        self.ignored_requests, muted = max(0, self.ignored_requests - 1), self.ignored_requests > 0
        unit = self._units.get(request.dev_id)
        if muted or (unit is None and not self._tcp):
            return None
        code, self.exception = self.exception, 0
        if code or unit is None:
            return ExceptionResponse(request.function_code, code or ExcCodes.GATEWAY_NO_RESPONSE)
        try:
            return _execute(unit, request)
        except NoReply:
            return None
        except Refusal as refusal:
            return ExceptionResponse(request.function_code, _EXCEPTIONS.get(type(refusal), ExcCodes.DEVICE_FAILURE))

    def _sent(self, frame: bytes) -> bytes:
        """Return the bytes to send for a reply; a fault changes the transaction number (TCP) or the checksum."""
        if not self.corrupted_replies:
            return frame
        self.corrupted_replies -= 1
        at = 0 if self._tcp else len(frame) - 1
        return frame[:at] + bytes([frame[at] ^ 0x10]) + frame[at + 1 :]


def _execute(unit: ModbusUnit, request: ModbusPDU) -> ModbusPDU:
    kind, address, values = request.function_code, request.address, list(request.registers)
    if kind == ReadHoldingRegistersResponse.function_code:
        return ReadHoldingRegistersResponse(registers=unit.read(address, request.count))
    if kind == WriteSingleRegisterResponse.function_code:
        unit.write(address, values)
        return WriteSingleRegisterResponse(address=address, registers=values)
    if kind == WriteMultipleRegistersResponse.function_code:
        unit.write(address, values)
        return WriteMultipleRegistersResponse(address=address, count=request.count)
    return ExceptionResponse(kind, ExcCodes.ILLEGAL_FUNCTION)
