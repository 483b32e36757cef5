"""A Modbus server for the table's controller: TCP, or RTU over a pseudo-terminal.

Only this module uses pymodbus's server classes, because they change in minor releases.
"""

import asyncio
import logging
import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from functools import partial

from pymodbus.constants import ExcCodes
from pymodbus.pdu import ModbusPDU
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from calstation.bench.links.lines import open_raw
from calstation.bench.table import OutOfRange, Refusal, RegisterBank

#: Modbus unit number of a table with one controller.
UNIT = 1
READ = 3
BAUD = 115200


class TableLink:
    """A Modbus server with the registers of each unit number.

    `mute` and `garble` count the requests still to be ignored and the replies still to get a flipped bit; `slow` are
    the delays of the next replies, host time, s; `refuse` is the Modbus exception of the next reply, 0 for none.
    """

    def __init__(self, units: Mapping[int, RegisterBank]) -> None:
        self.endpoint = ""
        self.mute = self.garble = self.refuse = 0
        self.slow: list[float] = []
        self._units = units
        self._server: ModbusTcpServer | ModbusSerialServer | None = None
        self._terminals: list[int] = []
        # The server logs protocol exceptions as errors.
        logging.getLogger("pymodbus").setLevel(logging.CRITICAL)

    async def serve_tcp(self) -> None:
        """Listen on a free port of 127.0.0.1."""
        server = ModbusTcpServer(
            self._devices(),
            address=("127.0.0.1", 0),
            trace_pdu=self._trace,
            trace_packet=self._corrupt,
            ignore_missing_devices=False,
        )
        await server.serve_forever(background=True)
        self._server = server
        listening = server.transport.sockets[0].getsockname()  # type: ignore[attr-defined]
        self.endpoint = f"{listening[0]}:{listening[1]}"

    async def serve_rtu(self) -> None:
        """Serve RTU on a new pseudo-terminal (POSIX)."""
        # Server and client each open their own terminal; bytes are copied between them.
        (near, near_slave, near_path), (far, far_slave, far_path) = open_raw(), open_raw()
        self._terminals = [near, near_slave, far, far_slave]
        loop = asyncio.get_running_loop()
        loop.add_reader(near, _copy_bytes, near, far)
        loop.add_reader(far, _copy_bytes, far, near)
        server = ModbusSerialServer(
            self._devices(), port=near_path, baudrate=BAUD, trace_pdu=self._trace, trace_packet=self._corrupt
        )
        await server.serve_forever(background=True)
        self._server = server
        self.endpoint = far_path

    async def close(self) -> None:
        """Stop serving."""
        if self._server is not None:
            await self._server.shutdown()  # type: ignore[no-untyped-call]
        loop = asyncio.get_running_loop()
        for terminal in self._terminals:
            if sys.platform != "win32":
                loop.remove_reader(terminal)
            os.close(terminal)
        self._terminals = []

    def _devices(self) -> list[SimDevice]:
        devices = []
        for number, unit in self._units.items():
            writable = {first + i for first, count in unit.writable for i in range(count)}
            blocks = [
                SimData(i, values=0, datatype=DataType.REGISTERS, readonly=i not in writable)
                for i in range(len(unit.words))
            ]
            devices.append(SimDevice(id=number, simdata=blocks, action=partial(self._act, unit)))
        return devices

    async def _act(
        self,
        registers: RegisterBank,
        function_code: int,
        start_address: int,
        address: int,
        count: int,
        current: list[int],
        values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        """Process a request within the register map; called by the server before it accesses its copy `current`."""
        if self.slow:
            await asyncio.sleep(self.slow.pop(0))
        if self.refuse:
            code, self.refuse = self.refuse, 0
            return ExcCodes(code)
        if values is not None:
            try:
                registers.write(address, [int(value) for value in values])
            except OutOfRange:
                return ExcCodes.ILLEGAL_VALUE
            except Refusal:
                return ExcCodes.DEVICE_FAILURE
            # The server stores `values`; the next read shows the registers after the command.
            return None
        # The reply to a single write is read from the registers as well: refresh them only for a read.
        if function_code == READ:
            registers.refresh()
            current[: len(registers.words)] = registers.words
        return None

    def _corrupt(self, sending: bool, data: bytes) -> bytes:
        """Flip a bit of the checksum, or of the transaction number over TCP, if replies are to be corrupted."""
        if sending and self.garble > 0:
            self.garble -= 1
            at = 0 if isinstance(self._server, ModbusTcpServer) else len(data) - 1
            return data[:at] + bytes([data[at] ^ 0x10]) + data[at + 1 :]
        return data

    def _trace(self, sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        if not sending and self.mute > 0:
            self.mute -= 1
            return None  # type: ignore[return-value]  # the server ignores the request
        return pdu


def _copy_bytes(source: int, target: int) -> None:
    with suppress(OSError):
        os.write(target, os.read(source, 4096))
