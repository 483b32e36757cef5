"""Driver of an IMU with Modbus RTU registers on the serial line of its stream."""

import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager

from calstation.devices.codecs import ByteOrder, ReplyKind, WordOrder, number, register_text
from calstation.devices.imu.registered_imu import ATTEMPTS, POLL_INTERVAL, RegisteredImu
from calstation.devices.imu.streamed_imu import ImuBusyError, ImuRefusalError
from calstation.devices.interfaces import ImuIdentity
from calstation.devices.links import ACKNOWLEDGED, BUSY_EXCEPTIONS, Link, RtuReply, RtuRequest, Transaction
from calstation.devices.profiles import ImuProfile, RegisterEntry
from calstation.devices.profiles.imu_protocols.modbus import ModbusProtocol, TextRegisters, WordCommand
from calstation.errors import DeviceFaultError
from calstation.messages import Text, known

#: Largest number of registers in one transfer.
_MAX_REGISTERS = 120


class ModbusImu(RegisteredImu):
    """Driver of an IMU with Modbus registers."""

    def __init__(self, link: Link, profile: ImuProfile, serial: str = "") -> None:
        section = self._section = profile.section_of(ModbusProtocol)
        self._texts = [text for text in (section.model, section.serial, section.firmware) if text is not None]
        self._word = 0
        super().__init__(link, profile)

    @staticmethod
    def reply_kind(profile: ImuProfile) -> ReplyKind:
        """Return the kind of packets that reply to commands."""
        return RtuReply(profile.section_of(ModbusProtocol).unit)

    def _start_stream(self, *, corrected: bool) -> None:
        stream, section = self._section.stream, self._profile.corrected if corrected else None
        if stream is not None:
            self._word = stream.on if section is None or section.stream is None else section.stream
            self._write(stream.address, [self._word])

    def _ask_identity(self, attempts: int = ATTEMPTS) -> ImuIdentity:
        section = self._section
        return ImuIdentity(
            self._text(section.model, attempts),
            self._text(section.serial, attempts),
            self._text(section.firmware, attempts) if section.firmware else "",
        )

    def _write_flash(self) -> None:
        self._execute(self._section.commit, self._commit_timeout)

    def _is_busy(self) -> bool:
        return not self._done(self._section.commit)

    def _check_idle(self) -> None:
        if self._section.commit.done is not None:
            self._read(self._section.commit.address, 1)

    def _restart(self) -> None:
        self._execute(self._section.reset, self._timeout)

    def _read_entry(self, entry: RegisterEntry) -> list[float]:
        self._select_page(entry.page)
        kind = number(entry.type)
        words: list[int] = []
        total = entry.end - entry.address
        for begin in range(0, total, _MAX_REGISTERS):
            words += self._read(entry.address + begin, min(_MAX_REGISTERS, total - begin))
        data = struct.pack(f">{len(words)}H", *words)
        return [kind.unpack(data[k : k + kind.width], *self._orders(entry)) for k in range(0, len(data), kind.width)]

    def _write_entry(self, entry: RegisterEntry, numbers: list[float]) -> None:
        self._select_page(entry.page)
        kind = number(entry.type)
        data = b"".join(kind.pack(value, *self._orders(entry)) for value in numbers)
        words = list(struct.unpack(f">{len(data) // 2}H", data))
        for begin in range(0, len(words), _MAX_REGISTERS):
            self._write(entry.address + begin, words[begin : begin + _MAX_REGISTERS])

    def _orders(self, entry: RegisterEntry) -> tuple[ByteOrder, WordOrder | None]:
        return entry.byte_order or self._section.byte_order, entry.word_order or self._section.word_order

    def _select_page(self, page: int) -> None:
        if self._section.page is not None:
            self._write(self._section.page, [page])

    def _text(self, registers: TextRegisters, attempts: int) -> str:
        return register_text(self._read(registers.address, registers.words, attempts))

    def _execute(self, command: WordCommand, timeout: float) -> None:
        deadline = time.monotonic() + self._commit_timeout
        try:
            self._write(command.address, [command.value], attempts=1, timeout=timeout)
        except ModbusBusyError as exc:
            if exc.values["number"] != ACKNOWLEDGED:
                raise
        else:
            if command.done is None:
                return
        while not self._done(command):
            if time.monotonic() > deadline:
                code = "imu.reset_not_done" if command == self._section.reset else "imu.commit_not_done"
                raise DeviceFaultError(code, seconds=self._commit_timeout)
            time.sleep(POLL_INTERVAL)

    def _done(self, command: WordCommand) -> bool:
        """Return whether the unit has executed a command; False while it is busy or silent."""
        address = command.address if command.done is not None else self._section.model.address
        try:
            return self._read(address, 1, attempts=1)[0] == command.done or command.done is None
        except ImuRefusalError as exc:
            if not isinstance(exc, ImuBusyError):
                raise
        except DeviceFaultError:
            if self.lost:
                raise
        return False

    @contextmanager
    def _quiet(self) -> Iterator[None]:
        """Switch the stream off within the context if the profile requires this."""
        stream = self._section.stream
        if stream is None or stream.off is None:
            yield
            return
        self._write(stream.address, [stream.off])
        try:
            yield
        finally:
            if self._streaming and not self.lost:
                self._write(stream.address, [self._word])

    def _read(self, address: int, count: int, attempts: int = ATTEMPTS) -> list[int]:
        data = self._send(_transaction(RtuRequest.read(self._section.unit, address, count)), attempts)
        return list(struct.unpack(f">{count}H", data[1 : 1 + 2 * count]))

    def _write(self, address: int, values: list[int], attempts: int = ATTEMPTS, timeout: float | None = None) -> None:
        self._send(_transaction(RtuRequest.write(self._section.unit, address, values)), attempts, timeout)

    def _other_transactions(self) -> Iterator[Transaction[bytes]]:
        """Yield reads of whole and partial text registers, which do not depend on the page."""
        longest = max(self._texts, key=lambda text: text.words)
        for words in (*(text.words for text in self._texts), *range(1, longest.words)):
            address = next((text.address for text in self._texts if text.words == words), longest.address)
            yield _transaction(RtuRequest.read(self._section.unit, address, words))


class ModbusBusyError(ImuBusyError):
    """The unit replied with Modbus exception 5 or 6."""


def _transaction(request: RtuRequest) -> Transaction[bytes]:

    def refusal(number: int) -> ImuRefusalError:
        kind = number if known(f"imu.modbus_{number}") else "other"
        reason = Text.of(f"imu.modbus_{kind}", number=number)
        error = ModbusBusyError if number in BUSY_EXCEPTIONS else ImuRefusalError
        return error("imu.register_refused", address=request.address, number=number, reason=reason)

    return request.transaction(refusal)


DRIVER = ModbusImu
