"""Registers over Modbus TCP by pymodbus, which matches answers to requests by transaction number."""

import logging
from collections.abc import Callable

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException, ModbusIOException
from pymodbus.pdu import ModbusPDU

from calstation.devices.links.modbus_rtu import RefusedError, UnansweredError
from calstation.devices.links.opening import host_and_port
from calstation.devices.links.serial_link import LINK_ERRORS, link_reason
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.messages import Text

logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # its errors become DeviceFaultError


class TcpConnection:
    """A connection to a Modbus server, `tcp://host:port`. Any error closes it; the next request opens a new one.

    `received` are the bytes received last, valid or not.
    """

    def __init__(self, port: str, timeout: float) -> None:
        address = host_and_port(port)
        if address is None:
            raise ConfigurationError("link.not_an_address", device="table", port=port)
        self.received = b""
        self.open = False
        self._port = port
        self._client = ModbusTcpClient(
            address[0], port=address[1], timeout=timeout, retries=0, trace_packet=self._receive
        )

    def connect(self) -> None:
        """Connect. Raises DeviceFaultError."""
        try:
            self.open = bool(self._client.connect())  # type: ignore[no-untyped-call]
        except LINK_ERRORS:
            self.open = False
        if not self.open:
            raise DeviceFaultError("link.not_connected", device="table", port=self._port)

    def close(self) -> None:
        """Close the connection; never raises."""
        self.open = False
        try:
            self._client.close()  # type: ignore[no-untyped-call]
        except LINK_ERRORS:
            return

    def read(self, unit: int, address: int, count: int) -> list[int]:
        """Read holding registers. Raises UnansweredError, RefusedError."""
        answer = self._request(lambda: self._client.read_holding_registers(address, count=count, device_id=unit))
        if len(answer.registers) != count:
            self.close()
            raise UnansweredError(Text("modbus.wrong_length"))
        return list(answer.registers)

    def write(self, unit: int, address: int, values: list[int], *, repeat: bool, again: bool) -> None:
        """Write holding registers; `repeat` and `again` do not matter here. Raises as `read`."""
        if len(values) == 1:
            self._request(lambda: self._client.write_register(address, values[0], device_id=unit))
        else:
            self._request(lambda: self._client.write_registers(address, values, device_id=unit))

    def _request(self, request: Callable[[], ModbusPDU]) -> ModbusPDU:
        try:
            answer = request()
        except (ModbusException, *LINK_ERRORS) as exc:
            self.close()
            timed_out = isinstance(exc, ModbusIOException)
            raise UnansweredError(Text("modbus.no_answer") if timed_out else link_reason(exc)) from exc
        if answer.isError():
            raise RefusedError(answer.exception_code)
        return answer

    def _receive(self, sending: bool, data: bytes) -> bytes:
        if not sending and data:
            self.received = data
        return data
