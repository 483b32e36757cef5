"""A Modbus server, TCP or RTU, for requests in the received bytes of a line.

The frames and messages of pymodbus are used, but not its servers, because they own their line: a unit also streams on
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

#: Modbus exceptions by the refusal of a unit; other refusals are DEVICE_FAILURE.
_EXCEPTIONS = {NoSuchRegister: ExcCodes.ILLEGAL_ADDRESS, OutOfRange: ExcCodes.ILLEGAL_VALUE}


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

    `mute` is the number of next requests that are ignored, and `garble` the number of next replies with a flipped bit.
    `refuse` is the Modbus exception of the next reply, or 0.
    """

    def __init__(self, units: Mapping[int, ModbusUnit], *, tcp: bool = False) -> None:
        self.mute = self.garble = self.refuse = 0
        self._units, self._tcp = units, tcp

    def talk(self) -> Callable[[bytes], list[bytes]]:
        """Return a parser for one connection, which converts received bytes to replies."""
        framer: FramerBase = (FramerSocket if self._tcp else FramerRTU)(DecodePDU(is_server=True))
        pending = b""

        def answer(data: bytes) -> list[bytes]:
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

        return answer

    def _reply(self, request: ModbusPDU) -> ModbusPDU | None:
        """Return the reply to a request, or None, e.g. if the request is for another unit on an RTU line."""
        self.mute, muted = max(0, self.mute - 1), self.mute > 0
        unit = self._units.get(request.dev_id)
        if muted or (unit is None and not self._tcp):
            return None
        code, self.refuse = self.refuse, 0
        if code or unit is None:
            return ExceptionResponse(request.function_code, code or ExcCodes.GATEWAY_NO_RESPONSE)
        try:
            return _execute(unit, request)
        except NoReply:
            return None
        except Refusal as refusal:
            return ExceptionResponse(request.function_code, _EXCEPTIONS.get(type(refusal), ExcCodes.DEVICE_FAILURE))

    def _sent(self, frame: bytes) -> bytes:
        """Return the bytes sent for a reply, in which a fault changes the transaction number (TCP) or the checksum."""
        if not self.garble:
            return frame
        self.garble -= 1
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
