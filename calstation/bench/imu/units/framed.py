"""The protocol "framed", whose commands and replies are little-endian frames with the checksum of the stream frames.

    command  55 A5 | op u8 | n u8 | payload, n bytes | CRC of op to payload
    reply    55 5A | op u8 | n u8 | payload, n bytes | CRC of op to payload

Registers: gyro bias b from 0, gyro matrix M 3, accel bias 12, accel matrix 15, quadratic K 24, inner levers 27. The
corrected stream removes these errors: measured = (I + M) true + b, plus K force² for the accelerometers. A unit that
corrects its output over temperature has reference, lowest and highest temperature from 30, and from 33 the coefficients
of the powers 1 to 6 of the temperature relative to the reference, 27 for each power in the order of registers 0 to 26.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from calstation.bench.imu.unit import CORRECTED, OFF, RAW, ImuUnit, PowerCut, crc16
from calstation.bench.table import NoSuchRegister, OutOfRange, Refusal, TableRegisters

MODEL = "bench-imu"
FIRMWARE = "1.0.0"

IDENTIFY, READ, WRITE, COMMIT, RESET, STREAM, READ_WORDS, WRITE_WORDS, ERROR = 1, 2, 3, 4, 5, 6, 7, 8, 0xFF
BAD_OP, BAD_ADDRESS, FLASH_BUSY, BAD_STATE, BAD_VALUE = 1, 2, 3, 4, 5

#: Device time for which the flash is busy after a commit, s.
FLASH_TIME = 0.2
#: Maximum number of commands that a busy flash refuses, because virtual time may not advance between them.
FLASH_REFUSALS = 3


COMMAND_SYNC = b"\x55\xa5"
REPLY_SYNC = b"\x55\x5a"


def pack(sync: bytes, op: int, payload: bytes = b"") -> bytes:
    """Build the frame of a command or a reply."""
    body = bytes([op, len(payload)]) + payload
    return sync + body + crc16(body).to_bytes(2, "little")


@dataclass
class CommandParser:
    """Finds command frames in the received bytes, regardless of how they are split, and skips all other bytes."""

    _pending: bytearray = field(default_factory=bytearray)

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Return the complete commands (op, payload) with a correct checksum, in order."""
        self._pending += data
        commands: list[tuple[int, bytes]] = []
        while True:
            start = self._pending.find(COMMAND_SYNC)
            if start < 0:
                del self._pending[: max(0, len(self._pending) - 1)]
                return commands
            del self._pending[:start]
            if len(self._pending) < 4 or len(self._pending) < self._pending[3] + 6:
                return commands
            length = self._pending[3] + 6
            frame = bytes(self._pending[:length])
            if crc16(frame[2:-2]) == int.from_bytes(frame[-2:], "little"):
                commands.append((frame[2], frame[4:-2]))
                del self._pending[:length]
            else:
                del self._pending[:2]


class FramedUnit(ImuUnit):
    """A unit with the bench's own commands, which may include access to the table's axes."""

    profile = "bench_mems"

    def restart(self, time: float) -> None:
        """Restart the unit; see `ImuUnit.restart`."""
        super().restart(time)
        self._busy_until, self._refusals = -np.inf, 0

    def new_parser(self) -> Callable[[bytes, float], list[bytes]]:
        """Return a parser for one connection, which converts received bytes and device time to replies in order."""
        parser = CommandParser()
        return lambda data, time: [self.answer(op, payload, time) for op, payload in parser.feed(data)]

    def answer(self, op: int, payload: bytes, time: float) -> bytes:
        """Return the reply frame to one command; empty if the power fails.

        Parameters
        ----------
        op, payload : op code and payload of the command
        time : device time, s
        """
        handlers = {READ: self._read, WRITE: self._write, COMMIT: self._commit, STREAM: self._stream}
        if self.axes is not None:
            axes = self.axes
            handlers |= {
                READ_WORDS: lambda payload, time: _read_words(axes, payload),
                WRITE_WORDS: lambda payload, time: _write_words(axes, payload),
            }
        try:
            if op == IDENTIFY:
                result: bytes | int = f"{MODEL};{self._serial};{FIRMWARE}".encode("ascii", "replace")
            elif op == RESET:
                self.restart(time)
                result = b"\x00"
            else:
                result = handlers[op](payload, time) if op in handlers else BAD_OP
        except PowerCut:
            self.restart(time)
            return b""
        if isinstance(result, int):
            return pack(REPLY_SYNC, ERROR, bytes([result]))
        return pack(REPLY_SYNC, op, result)

    def _read(self, payload: bytes, time: float) -> bytes | int:
        if len(payload) != 3:
            return BAD_ADDRESS
        address, count = struct.unpack("<HB", payload)
        if count == 0 or address + count > self.register_count:
            return BAD_ADDRESS
        return payload + self.registers[address : address + count].astype("<f4").tobytes()

    def _write(self, payload: bytes, time: float) -> bytes | int:
        if len(payload) < 3:
            return BAD_ADDRESS
        address, count = struct.unpack("<HB", payload[:3])
        if count == 0 or address + count > self.register_count or len(payload) != 3 + 4 * count:
            return BAD_ADDRESS
        if self._flash_busy(time):
            return FLASH_BUSY
        self._count_written(len(payload))
        self.registers[address : address + count] = np.frombuffer(payload[3:], dtype="<f4")
        return payload[:3]

    def _flash_busy(self, time: float) -> bool:
        self._refusals -= time < self._busy_until
        return time < self._busy_until and self._refusals >= 0

    def _commit(self, payload: bytes, time: float) -> bytes | int:
        if self._flash_busy(time):
            return FLASH_BUSY
        self._busy_until, self._refusals = time + FLASH_TIME, FLASH_REFUSALS
        self._burn()
        return struct.pack("<BI", 0, self.flash.cycles)

    def _stream(self, payload: bytes, time: float) -> bytes | int:
        if len(payload) != 1:
            return BAD_ADDRESS
        if payload[0] not in (OFF, RAW, CORRECTED):
            return BAD_VALUE
        self.streaming, self.corrected = payload[0] != OFF, payload[0] == CORRECTED
        return payload


def _read_words(axes: TableRegisters, payload: bytes) -> bytes | int:
    if len(payload) != 3 or payload[2] > 126:
        return BAD_ADDRESS
    try:
        words = axes.read(*struct.unpack("<HB", payload))
    except NoSuchRegister:
        return BAD_ADDRESS
    return payload + struct.pack(f"<{len(words)}H", *words)


def _write_words(axes: TableRegisters, payload: bytes) -> bytes | int:
    if len(payload) < 5 or len(payload) != 3 + 2 * payload[2]:
        return BAD_ADDRESS
    address, count = struct.unpack("<HB", payload[:3])
    try:
        axes.write(address, list(struct.unpack(f"<{count}H", payload[3:])))
    except NoSuchRegister:
        return BAD_ADDRESS
    except OutOfRange:
        return BAD_VALUE
    except Refusal:
        return BAD_STATE
    return payload[:3]


UNIT = FramedUnit
