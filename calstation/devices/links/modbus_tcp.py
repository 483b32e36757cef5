"""The one place that knows pymodbus: registers over Modbus TCP, each answer told by its transaction's number."""

import logging

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from calstation.devices.links.modbus_rtu import RefusedError, UnansweredError
from calstation.devices.links.opening import host_and_port
from calstation.devices.links.serial_link import LINK_ERRORS
from calstation.errors import ConfigurationError, DeviceFaultError

logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # its errors reach the user as DeviceFaultError


class TcpConnection:
    """A connection to a Modbus server. What goes wrong ends it: the next request begins on a fresh one.

    Parameters
    ----------
    port : `tcp://host:port`; timeout : host time for an answer, s

    Attributes
    ----------
    heard : the bytes that came last, whether they make sense or not
    open : whether it stands
    """

    def __init__(self, port: str, timeout: float) -> None:
        address = host_and_port(port)
        if address is None:
            raise ConfigurationError(
                f"table: port {port} is not tcp://host:port; correct it in the station file"
            )
        self.heard = b""
        self.open = False
        self._port = port
        self._client = ModbusTcpClient(
            address[0], port=address[1], timeout=timeout, retries=0, trace_packet=self._hear
        )

    def connect(self) -> None:
        """Connect. Raises DeviceFaultError."""
        try:
            self.open = bool(self._client.connect())  # type: ignore[no-untyped-call]
        except LINK_ERRORS:
            self.open = False
        if not self.open:
            raise DeviceFaultError(
                f"table: port {self._port} cannot be opened; check cable, power and the port in the station file"
            )

    def close(self) -> None:
        """Hang up; never raises."""
        self.open = False
        try:
            self._client.close()  # type: ignore[no-untyped-call]
        except LINK_ERRORS:
            return

    def read(self, unit: int, address: int, count: int) -> list[int]:
        """Read holding registers. Raises UnansweredError, RefusedError."""
        try:
            answer = self._client.read_holding_registers(address, count=count, device_id=unit)
        except (ModbusException, *LINK_ERRORS) as exc:
            raise self._unanswered(exc) from exc
        self._check(answer)
        if len(answer.registers) != count:
            self.close()
            raise UnansweredError("an answer of the wrong length")
        return list(answer.registers)

    def write(self, unit: int, address: int, values: list[int], *, repeat: bool, again: bool) -> None:
        """Write holding registers, whether they may be or have been written before. Raises as `read`."""
        try:
            if len(values) == 1:
                answer = self._client.write_register(address, values[0], device_id=unit)
            else:
                answer = self._client.write_registers(address, values, device_id=unit)
        except (ModbusException, *LINK_ERRORS) as exc:
            raise self._unanswered(exc) from exc
        self._check(answer)

    def _check(self, answer: ModbusPDU) -> None:
        if answer.isError():
            raise RefusedError(answer.exception_code)

    def _unanswered(self, exc: BaseException) -> UnansweredError:
        self.close()
        text = str(exc)
        return UnansweredError("no answer" if "No response" in text else text.removeprefix("Modbus Error: "))

    def _hear(self, sending: bool, data: bytes) -> bytes:
        if not sending and data:
            self.heard = data
        return data
