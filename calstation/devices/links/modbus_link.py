"""Access to the holding registers of a Modbus unit over TCP (by pymodbus) or RTU."""

import logging
import socket
import struct
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Literal, TypeVar

from calstation.devices.links.modbus_rtu import MAX_FRAME_SIZE, READ, RefusedError, RtuLine, UnansweredError
from calstation.devices.links.serial_link import LINK_ERRORS, Device, PortLostError, host_and_port, link_reason
from calstation.devices.profiles import SerialSettings
from calstation.errors import CalstationError, ConfigurationError, DeviceFaultError
from calstation.messages import Text, known

if TYPE_CHECKING:
    from pymodbus.pdu import ModbusPDU

logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # pymodbus errors are raised as DeviceFaultError

#: Modbus exception of a device that is still executing the request.
ACKNOWLEDGED = 5

#: Modbus exceptions of a device that is only busy.
BUSY_EXCEPTIONS = (ACKNOWLEDGED, 6)

#: Delay before a request to a busy device is sent again, host time in s.
_RETRY_DELAY = 0.05

_ATTEMPTS = 3
#: Size of the header of a Modbus TCP frame, bytes.
_MBAP = 7
T = TypeVar("T")


def exception_text(number: int) -> Text:
    """Return the meaning of a Modbus exception and the remedy for a table."""
    kind = number if known(f"modbus.exception_{number}") else "other"
    return Text.of(f"modbus.exception_{kind}", number=number)


class ModbusUnitError(DeviceFaultError):
    """A transfer with a Modbus unit has failed."""

    @property
    def unit(self) -> int:
        """Unit number of the device."""
        return int(self.values["unit"])


class NoAnswerError(ModbusUnitError):
    """The device does not reply, even after repeated requests."""


class ModbusRefusalError(ModbusUnitError):
    """The device replied with a Modbus exception."""

    @property
    def exception(self) -> int:
        """Number of the Modbus exception."""
        return int(self.values["number"])


class ModbusLink:
    """Holding registers of a Modbus unit over TCP or RTU. The class is not thread-safe.

    Raises DeviceFaultError or ConfigurationError if the port cannot be opened. `on_reopen` is called after the link was
    opened again, before any other transfer; it raises DeviceFaultError if another device replies.

    Parameters
    ----------
    port : `tcp://host:port`, or a serial port for RTU, possibly `usb:SERIALNUMBER`
    unit : Modbus unit number
    timeout : host time for a reply in each of at most 3 attempts, s
    serial : settings of a serial port
    device : the device on the port, for errors
    """

    def __init__(self, port: str, unit: int, timeout: float, serial: SerialSettings, device: Device = "table") -> None:
        self._port = port
        self._unit = unit
        self.on_reopen: Callable[[], None] = lambda: None
        self._is_identifying = False
        self._transport: TcpConnection | RtuLine = (
            TcpConnection(port, timeout, device)
            if port.startswith("tcp://")
            else RtuLine(port, timeout, serial, device)
        )
        self._transport.connect()

    @property
    def received(self) -> bytes:
        """Bytes received last, whether valid or not."""
        return self._transport.received

    @property
    def deviation(self) -> str | None:
        """How a Modbus TCP reply differs from its request; see `TcpConnection`."""
        return self._transport.deviation

    def reply_time(self, unit: int, limit: float) -> float | None:
        """Return the reply time of one read, s; None if no reply arrives within `limit` s of host time."""
        return self._transport.reply_time(unit, limit)

    def read(self, address: int, count: int, unit: int | None = None) -> list[int]:
        """Read unsigned 16-bit words; repeat a lost transfer.

        Raises ModbusRefusalError if the device refuses the request, NoAnswerError if it does not reply.

        Parameters
        ----------
        address, count : 0-based address of the first register, and number of registers
        unit : Modbus unit number; by default that of the link
        """
        at = {"unit": self._unit if unit is None else unit, "address": address, "last": address + count - 1}
        with self._explained("read", at):
            return self._transfer(lambda again: self._transport.read(at["unit"], address, count), _ATTEMPTS)

    def write(self, address: int, values: list[int], repeat: bool = True, unit: int | None = None) -> None:
        """Write registers. Raises the errors of `read`.

        Parameters
        ----------
        address, values : 0-based address of the first register, and unsigned 16-bit values
        repeat : whether a lost transfer is repeated
        unit : Modbus unit number; by default that of the link
        """
        at = {"unit": self._unit if unit is None else unit, "address": address}
        attempts = _ATTEMPTS if repeat else 1
        with self._explained("write", at):
            self._transfer(
                lambda again: self._transport.write(at["unit"], address, values, repeat=repeat, again=again), attempts
            )

    def close(self) -> None:
        """Close the link; this never raises an exception."""
        self._transport.close()

    @contextmanager
    def _explained(self, action: Literal["read", "write"], at: Mapping[str, int]) -> Iterator[None]:
        """Convert the errors of a transfer to ModbusRefusalError and NoAnswerError."""
        try:
            yield
        except RefusedError as exc:
            code = "table.read_refused" if action == "read" else "table.write_refused"
            raise ModbusRefusalError(code, **at, number=exc.number, reason=exception_text(exc.number)) from exc
        except UnansweredError as exc:
            code = "table.read_unanswered" if action == "read" else "table.write_unanswered"
            raise NoAnswerError(code, **at, port=self._port, reason=exc.reason) from exc

    def _transfer(self, transfer: Callable[[bool], T], attempts: int) -> T:
        """Execute a transfer. Raises RefusedError, or UnansweredError once all attempts have failed."""
        reason = Text("modbus.no_answer")
        attempts = 1 if self._is_identifying else attempts
        for attempt in range(attempts):
            try:
                self._prepare()
                return transfer(attempt > 0)
            except NoAnswerError as exc:  # `on_reopen` raises this
                reason = exc.values["reason"]
            except PortLostError as exc:
                reason = Text.of("modbus.port_lost", reason=exc.values["reason"])
            except UnansweredError as exc:
                reason = exc.reason
            except RefusedError as exc:
                if exc.number not in BUSY_EXCEPTIONS or attempt + 1 == attempts:
                    raise
                time.sleep(_RETRY_DELAY)
        raise UnansweredError(reason)

    def _prepare(self) -> None:
        """Open the link if necessary, and check that it is connected to the same device as before."""
        if self._transport.open:
            return
        try:
            self._transport.connect()
        except CalstationError as exc:
            raise UnansweredError(Text("modbus.link_gone")) from exc
        if not self._is_identifying:
            self._is_identifying = True
            try:
                self.on_reopen()
            except BaseException:
                self._transport.close()
                raise
            finally:
                self._is_identifying = False


class TcpConnection:
    """A connection to a Modbus server, `tcp://host:port`; an error closes it, and the next request opens a new one.

    `timeout` is the host time for a reply, s; pymodbus matches replies to requests by transaction number.
    """

    def __init__(self, port: str, timeout: float, device: Device = "table") -> None:
        from pymodbus.client import ModbusTcpClient  # slow to import, because it loads asyncio

        self._device: Device = device
        address = host_and_port(port)
        if address is None:
            raise ConfigurationError("link.not_an_address", device=device, port=port)
        self.received = self._reply = b""
        self.open = False
        self._sent = b""
        #: Whether a valid reply was received, and whether the connection was closed after that.
        self._has_replied = self._was_closed = False
        self._port, self._address = port, address
        self._client = ModbusTcpClient(
            address[0], port=address[1], timeout=timeout, retries=0, trace_packet=self._receive
        )

    def connect(self) -> None:
        """Open the connection. Raises DeviceFaultError."""
        try:
            self.open = bool(self._client.connect())  # type: ignore[no-untyped-call]
        except LINK_ERRORS:
            self.open = False
        if not self.open:
            raise DeviceFaultError("link.not_connected", device=self._device, port=self._port)

    def close(self) -> None:
        """Close the connection; this never raises an exception."""
        self.open = False
        with suppress(*LINK_ERRORS):
            self._client.close()  # type: ignore[no-untyped-call]

    def read(self, unit: int, address: int, count: int) -> list[int]:
        """Read holding registers. Raises UnansweredError, RefusedError."""
        response = self._request(lambda: self._client.read_holding_registers(address, count=count, device_id=unit))
        if len(response.registers) != count:
            self.close()
            raise UnansweredError(Text("modbus.wrong_length"))
        return list(response.registers)

    def write(self, unit: int, address: int, values: list[int], *, repeat: bool, again: bool) -> None:
        """Write holding registers; `repeat` and `again` have no effect over TCP. Raises the errors of `read`."""
        if len(values) == 1:
            self._request(lambda: self._client.write_register(address, values[0], device_id=unit))
        else:
            self._request(lambda: self._client.write_registers(address, values, device_id=unit))

    def _request(self, request: "Callable[[], ModbusPDU]") -> "ModbusPDU":
        from pymodbus.exceptions import ModbusException, ModbusIOException

        try:
            response = request()
        except (ModbusException, *LINK_ERRORS) as exc:
            self.close()
            timed_out = isinstance(exc, ModbusIOException)
            self._was_closed = not timed_out and self._has_replied
            raise UnansweredError(Text("modbus.no_answer") if timed_out else link_reason(exc)) from exc
        self._has_replied = True
        if response.isError():
            raise RefusedError(response.exception_code)
        return response

    def _receive(self, sending: bool, data: bytes) -> bytes:
        if sending:
            self._sent, self._reply = data, b""
        elif data:
            self.received = self._reply = data
        return data

    @property
    def deviation(self) -> str | None:
        """How the last reply differs from its request: "transaction", "unit" or "closed"; None if it does not."""
        if self._was_closed:
            return "closed"
        reply, request = self._reply, self._sent
        is_reply = len(reply) > _MBAP and reply[2:4] == b"\0\0" and len(reply) >= _MBAP - 1 + reply[5]
        if not is_reply or len(request) <= _MBAP or reply[_MBAP] & 0x7F != request[_MBAP]:
            return None
        if reply[6] != request[6]:
            return "unit"
        return "transaction" if reply[:2] != request[:2] else None

    def reply_time(self, unit: int, limit: float) -> float | None:
        """Return the reply time of one read over a separate connection, s; None without a reply within `limit` s."""
        request = struct.pack(">HHHBBHH", 1, 0, 6, unit, READ, 0, 1)
        try:
            with socket.create_connection(self._address, timeout=limit) as connection:
                begin = time.monotonic()
                connection.sendall(request)
                reply = connection.recv(MAX_FRAME_SIZE)
        except OSError:
            return None
        is_reply = len(reply) > _MBAP and reply[:4] == request[:4] and reply[6] == unit
        return time.monotonic() - begin if is_reply else None
