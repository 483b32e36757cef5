"""Driver of an IMU whose registers are asked over Modbus RTU on the same serial line that carries its stream."""

import struct
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from calstation.devices.checks import check_bytes
from calstation.devices.frames import Reply
from calstation.devices.imu_profile import ImuProfile, TextRegisters, WordCommand
from calstation.devices.interfaces import ImuIdentity
from calstation.devices.link import SerialLink
from calstation.devices.modbus_link import MEANINGS
from calstation.devices.modbus_rtu import READ, REFUSED, WRITE, WRITE_MANY, RtuReply
from calstation.devices.numbers import ByteOrder, WordOrder, number
from calstation.devices.register_profile import RegisterEntry
from calstation.devices.registered_imu import RegisteredImu
from calstation.devices.streamed_imu import ImuRefusalError
from calstation.errors import DeviceFaultError

_ATTEMPTS = 3
_MOST = 120
"""Registers in one transfer."""
_POLL = 0.02
"""Host time between two looks whether a commit is done, s."""


class ModbusImu(RegisteredImu):
    """The IMU of a profile on a link.

    Parameters
    ----------
    link : open port
    profile : what the bytes mean
    """

    def __init__(self, link: SerialLink, profile: ImuProfile) -> None:
        assert profile.modbus is not None
        self._section = profile.modbus
        self._word = 0
        super().__init__(link, profile, RtuReply(self._section.unit), self._section.reset_timeout_s)

    def read_registers(self) -> dict[str, float]:
        """Calibration registers in SI by parameter."""
        with self._quiet():
            return super().read_registers()

    def write_registers(self, values: Mapping[str, float]) -> None:
        """Write calibration registers; parameters not named keep theirs."""
        with self._quiet():
            super().write_registers(values)

    def commit(self) -> None:
        """Write the registers to flash, once: a lost answer is a fault, never a second flash cycle."""
        with self._quiet():
            self._order(self._section.commit, "commit")

    def _switch_on(self, *, corrected: bool) -> None:
        stream, section = self._section.stream, self._profile.corrected if corrected else None
        if stream is not None:
            self._word = stream.on if section is None or section.stream is None else section.stream
            self._write(stream.address, [self._word])

    def _ask_identity(self, attempts: int = _ATTEMPTS) -> ImuIdentity:
        section = self._section
        return ImuIdentity(
            self._text(section.model, attempts),
            self._text(section.serial, attempts),
            self._text(section.firmware, attempts) if section.firmware else "",
        )

    def _restart(self) -> None:
        self._order(self._section.reset, "reset")

    def _read_entry(self, entry: RegisterEntry) -> list[float]:
        self._turn_to(entry.page)
        kind = number(entry.type)
        words: list[int] = []
        total = entry.end - entry.address
        for begin in range(0, total, _MOST):
            words += self._read(entry.address + begin, min(_MOST, total - begin))
        data = struct.pack(f">{len(words)}H", *words)
        return [
            kind.unpack(data[k : k + kind.width], *self._orders(entry))
            for k in range(0, len(data), kind.width)
        ]

    def _write_entry(self, entry: RegisterEntry, numbers: list[float]) -> None:
        self._turn_to(entry.page)
        kind = number(entry.type)
        data = b"".join(kind.pack(value, *self._orders(entry)) for value in numbers)
        words = list(struct.unpack(f">{len(data) // 2}H", data))
        for begin in range(0, len(words), _MOST):
            self._write(entry.address + begin, words[begin : begin + _MOST])

    def _orders(self, entry: RegisterEntry) -> tuple[ByteOrder, WordOrder | None]:
        return entry.byte_order or self._section.byte_order, entry.word_order or self._section.word_order

    def _turn_to(self, page: int) -> None:
        if self._section.page is not None:
            self._write(self._section.page, [page])

    def _text(self, place: TextRegisters, attempts: int) -> str:
        words = self._read(place.address, place.words, attempts)
        raw = b"".join(word.to_bytes(2, "big") for word in words)
        return raw.split(b"\0")[0].decode("ascii", errors="replace").strip()

    def _order(self, command: WordCommand, what: str) -> None:
        """Write a command's value, once, and wait until it is done."""
        self._write(command.address, [command.value], attempts=1, timeout=self._section.commit_timeout_s)
        if command.done is None:
            return
        deadline = time.monotonic() + self._section.commit_timeout_s
        while self._read(command.address, 1) != [command.done]:
            if time.monotonic() > deadline:
                raise DeviceFaultError(
                    f"IMU: the {what} was not done within {self._section.commit_timeout_s:g} s; power the unit off and"
                    " on, try again"
                )
            time.sleep(_POLL)

    @contextmanager
    def _quiet(self) -> Iterator[None]:
        """The stream is off meanwhile, where the unit needs that."""
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

    def _read(self, address: int, count: int, attempts: int = _ATTEMPTS) -> list[int]:
        data = self._ask(READ, struct.pack(">HH", address, count), bytes([2 * count]), attempts)
        return list(struct.unpack(f">{count}H", data[1 : 1 + 2 * count]))

    def _write(
        self, address: int, values: list[int], attempts: int = _ATTEMPTS, timeout: float | None = None
    ) -> None:
        if len(values) == 1:
            payload = struct.pack(">HH", address, values[0])
            self._ask(WRITE, payload, payload, attempts, timeout)
            return
        head = struct.pack(">HH", address, len(values))
        body = struct.pack(f">B{len(values)}H", 2 * len(values), *values)
        self._ask(WRITE_MANY, head + body, head, attempts, timeout)

    def _ask(
        self, function: int, payload: bytes, begins: bytes, attempts: int, timeout: float | None = None
    ) -> bytes:
        """Send a request and wait for its answer, whose data must begin with `begins`."""

        def take(reply: Reply) -> bytes | None:
            if reply.op == function | REFUSED:
                code = reply.payload[0]
                address = int.from_bytes(payload[:2], "big")
                raise ImuRefusalError(
                    f"IMU: register {address} is refused: {MEANINGS.get(code, f'exception {code}')}"
                    f" (Modbus exception {code})"
                )
            return reply.payload if reply.op == function and reply.payload.startswith(begins) else None

        frame = bytes([self._section.unit, function]) + payload
        request = frame + check_bytes("crc16_modbus", frame, "little")
        return self.exchange(request, take, timeout=timeout or self._section.timeout_s, attempts=attempts)
