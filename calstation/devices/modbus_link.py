"""The one place that knows pymodbus: bounded register transfers, with its errors made into one."""

import logging
import time
from collections.abc import Callable
from typing import TypeVar

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from calstation.devices.link import LINK_ERRORS, SerialSettings
from calstation.devices.ports import resolve
from calstation.errors import ConfigurationError, DeviceFaultError

MEANINGS = {
    1: "the function is not supported",
    2: "no such register",
    3: "the value is refused",
    4: "the device cannot do it in its present state",
    5: "acknowledged, not done yet",
    6: "the device is busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "no answer behind the gateway",
}
"""What Modbus exceptions mean, by their codes."""

_MENDS = {
    **dict.fromkeys((1, 2, 3), "check the table profile's registers"),
    **dict.fromkeys((5, 6), "wait until it is done, then start again"),
    **dict.fromkeys((10, 11), "check the gateway and the unit number"),
}
_NOT_YET = (5, 6)
"""Exceptions of a device that is only late."""

_AGAIN_AFTER = 0.05
"""Host time until a device that is busy is asked again, s."""

_ATTEMPTS = 3
T = TypeVar("T")

logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # its errors reach the user as DeviceFaultError


class ModbusRefusalError(DeviceFaultError):
    """The device answers with a Modbus exception; `code` is its number."""

    def __init__(self, what: str, code: int) -> None:
        meaning = MEANINGS.get(code, f"exception {code}")
        mend = _MENDS.get(code, "look at the drive's display")
        super().__init__(f"table: {what}: {meaning} (Modbus exception {code}); {mend}")
        self.code = code


class ModbusLink:
    """Holding registers of one Modbus unit over TCP or RTU; not for use by two threads at once.

    Parameters
    ----------
    port : `tcp://host:port`, or for RTU a serial port, also as `usb:SERIALNUMBER`
    unit : Modbus unit number
    timeout : host time for an answer, s
    serial : settings of a serial port

    Attributes
    ----------
    heard : the bytes that came last, whether they make sense or not
    """

    def __init__(self, port: str, unit: int, timeout: float, serial: SerialSettings) -> None:
        self._port = port
        self._unit = unit
        self.heard = b""
        self._client: ModbusTcpClient | ModbusSerialClient
        if port.startswith("tcp://"):
            host, _, number = port.removeprefix("tcp://").rpartition(":")
            if not host or not number.isdecimal() or not 0 < int(number) < 65536:
                raise ConfigurationError(
                    f"table: port {port} is not tcp://host:port; correct it in the station file"
                )
            self._client = ModbusTcpClient(
                host, port=int(number), timeout=timeout, retries=0, trace_packet=self._hear
            )
        else:
            self._client = ModbusSerialClient(
                resolve(port, "table"),
                baudrate=serial.baud,
                bytesize=serial.data_bits,
                parity=serial.parity,
                stopbits=serial.stop_bits,  # type: ignore[arg-type]  # pyserial takes 1.5 too
                timeout=timeout,
                retries=0,
                trace_packet=self._hear,
            )
        if not self._connect():
            raise DeviceFaultError(
                f"table: port {port} cannot be opened; check cable, power and the port in the station file"
            )

    def read(self, address: int, count: int) -> list[int]:
        """Read `count` registers; repeats a lost transfer. Raises DeviceFaultError."""
        return self._transfer(
            lambda: self._client.read_holding_registers(address, count=count, device_id=self._unit),
            lambda answer: list(answer.registers) if len(answer.registers) == count else None,
            f"registers {address}-{address + count - 1} cannot be read",
            _ATTEMPTS,
        )

    def write(self, address: int, values: list[int], repeat: bool = True) -> None:
        """Write registers; a lost transfer is repeated only where `repeat`. Raises DeviceFaultError."""
        request: Callable[[], ModbusPDU]
        if len(values) == 1:

            def request() -> ModbusPDU:
                return self._client.write_register(address, values[0], device_id=self._unit)
        else:

            def request() -> ModbusPDU:
                return self._client.write_registers(address, values, device_id=self._unit)

        what = f"register {address} cannot be written"
        self._transfer(request, lambda _: True, what, _ATTEMPTS if repeat else 1)

    def close(self) -> None:
        """Hang up; never raises."""
        try:
            self._client.close()  # type: ignore[no-untyped-call]
        except LINK_ERRORS:
            return

    def _hear(self, sending: bool, data: bytes) -> bytes:
        if not sending and data:
            self.heard = data
        return data

    def _connect(self) -> bool:
        try:
            return bool(self._client.connect())
        except LINK_ERRORS:
            return False

    def _transfer(
        self,
        request: Callable[[], ModbusPDU],
        take: Callable[[ModbusPDU], T | None],
        what: str,
        attempts: int,
    ) -> T:
        reason = "no answer"
        for attempt in range(attempts):
            if attempt and not self._connect():
                reason = "the link is gone"
                continue
            try:
                answer = request()
            except (ModbusException, *LINK_ERRORS) as exc:
                reason = "no answer" if "No response" in str(exc) else str(exc).removeprefix("Modbus Error: ")
                # A late answer must not be taken for the next request's: that begins on a fresh link.
                self.close()
                continue
            if answer.isError() and answer.exception_code in _NOT_YET and attempt + 1 < attempts:
                time.sleep(_AGAIN_AFTER)
                continue
            if answer.isError():
                raise ModbusRefusalError(what, answer.exception_code)
            taken = take(answer)
            if taken is not None:
                return taken
            reason = "an answer of the wrong length"
            self.close()
        raise DeviceFaultError(
            f"table: {what} on {self._port} ({reason}); check cable, power and unit number"
        )
