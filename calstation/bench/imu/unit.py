"""The IMU's processor: identity, calibration registers with a flash image, power-up, stream frames."""

import struct
from collections.abc import Callable

import numpy as np

from calstation.bench.config import BenchConfig
from calstation.bench.imu.correction import Correction, Requantiser
from calstation.bench.imu.flash import Flash, PowerCut
from calstation.bench.imu.frames import READY, REPLY_SYNC, SATURATED, CommandParser, pack, stream_frames
from calstation.bench.table import SIZE, WRITABLE, OutOfRange, Refusal, TableRegisters
from calstation.bench.truth import StreamOutput
from calstation.physics import FloatArray

MODEL = "bench-imu"
FIRMWARE = "1.0.0"

#: Number of calibration registers, float32.
REGISTERS = 30

# Registers: gyro bias b from 0, gyro matrix M 3, accel bias 12, accel matrix 15, quadratic K 24, inner levers 27. The
# corrected stream removes these errors: measured = (I + M) true + b, plus K force² for the accelerometers.

IDENTIFY, READ, WRITE, COMMIT, RESET, STREAM, READ_WORDS, WRITE_WORDS, ERROR = 1, 2, 3, 4, 5, 6, 7, 8, 0xFF
BAD_OP, BAD_ADDRESS, FLASH_BUSY, BAD_STATE, BAD_VALUE = 1, 2, 3, 4, 5

#: States of the stream: off, raw sensor output, or corrected by the registers.
OFF, RAW, CORRECTED = 0, 1, 2

#: Device time for which the flash is busy after a commit, s.
FLASH_TIME = 0.2
#: Largest number of commands that a busy flash refuses, because virtual time may not advance between them.
FLASH_REFUSALS = 3
#: Device time for which the unit is silent after power-up or reset, s.
BOOT_TIME = 0.1


class ImuUnit:
    """Replies to commands and converts samples to frames; all times are device time, s.

    `scale` is the size of a count, rad/s and m/s², shape (6,). `axes` contains the registers of the table's axes if
    they are accessed over the unit's line. `fails_writing` and `fails_committing` are the numbers of bytes written to
    registers or flash before the power fails briefly; None for no power failure.
    """

    #: Size of the flash content, bytes.
    flash_bytes = 4 * REGISTERS

    def __init__(self, config: BenchConfig, scale: FloatArray | None = None) -> None:
        self._config, self._serial = config, config.serial
        self.flash = Flash(self.flash_bytes, config.flash_banks, config.flash_file)
        self.axes: TableRegisters | None = None
        self.scale: FloatArray = np.ones(6) if scale is None else scale
        self.increments = config.output == "increment"
        self.fails_writing: int | None = None
        self.fails_committing: int | None = None
        self._busy_until, self._refusals = -np.inf, 0
        self.streaming = True
        self._start(0.0)

    def _start(self, time: float) -> None:
        self.registers = np.zeros(REGISTERS, np.float32)
        held = self.flash.load()
        if held is not None:
            self._load_registers(held)
        self._started = time
        self.counter = 0
        self.corrected = False
        self._requantiser = Requantiser()

    def _load_registers(self, held: bytes) -> None:
        """Load the registers from the content of the flash."""
        self.registers = np.frombuffer(held, "<f4").astype(np.float32)

    def _register_bytes(self) -> bytes:
        """Return the registers in the format of the flash."""
        return self.registers.astype("<f4").tobytes()

    def calibrate(self, model: FloatArray) -> None:
        """Store an `ImuTruth.error_model`, shape (12, 3), in registers and flash unless the flash has other values."""
        if self.flash.load() is not None:
            return
        levers = np.diag(model[9:12])
        rows = (model[6], model[0:3] - np.eye(3), model[7], model[3:6] - np.eye(3), model[8], levers)
        self.registers = np.concatenate([np.ravel(row) for row in rows]).astype(np.float32)
        self.flash.burn(self._register_bytes())

    def _burn(self) -> None:
        """Write all registers to flash. Raises PowerCut if the power fails."""
        power_for, self.fails_committing = self.fails_committing, None
        self.flash.burn(self._register_bytes(), power_for)

    def _draw_power(self, written: int) -> None:
        """Count register bytes as they are written; raises PowerCut if the power fails while writing them."""
        if self.fails_writing is not None:
            self.fails_writing -= written
            if self.fails_writing < 0:
                self.fails_writing = None
                raise PowerCut

    def temperature(self, time: float) -> float:
        """Return the sensor temperature at `time`, °C."""
        config = self._config
        return float(config.ambient_c + config.warm_up_c * -np.expm1(-time / config.warm_up_time_s))

    def restart(self, time: float) -> None:
        """Reload the registers from flash, restart the counter at 0, and set the ready bit after the ready time."""
        self._busy_until = -np.inf
        self._start(time)

    def frames(self, output: StreamOutput, ends: FloatArray) -> bytes:
        """Return the frames of samples that end at `ends`, s, shape (n,); none while booting or with the stream off."""
        awake = ends > self._started + BOOT_TIME
        counter = self.counter + np.cumsum(awake) - 1
        self.counter += int(awake.sum())
        if not self.streaming or not awake.any():
            return b""
        status = np.where(ends >= self._started + self._config.ready_time_s, READY, 0)
        status |= np.where(output.saturated, SATURATED, 0)
        counts = output.counts[awake]
        if self.corrected or self._config.behind_registers:
            values = self.correction().applied(counts * self.scale)
            counts = self._requantiser.counts(values, self.scale, carry=self.increments)
        return stream_frames(counter[awake], counts, self.temperature(float(ends[-1])), status[awake])

    def correction(self) -> Correction:
        """Return the correction defined by the current registers."""
        held: FloatArray = self.registers.astype(np.float64)
        return Correction(
            gyro=np.asarray(np.linalg.inv(np.eye(3) + held[3:12].reshape(3, 3))),
            before=held[0:3],
            after=np.zeros(3),
            accel=np.asarray(np.linalg.inv(np.eye(3) + held[15:24].reshape(3, 3))),
            bias=held[12:15],
            quadratic=held[24:27],
            levers=held[27:30],
        )

    def conversation(self) -> Callable[[bytes, float], list[bytes]]:
        """Return a parser for one connection, which converts received bytes and device time to replies in order."""
        parser = CommandParser()
        return lambda data, time: [self.answer(op, payload, time) for op, payload in parser.feed(data)]

    def answer(self, op: int, payload: bytes, time: float) -> bytes:
        """Return the reply frame to one command at `time`, s; empty if the power fails."""
        handlers = {READ: self._read, WRITE: self._write, COMMIT: self._commit, STREAM: self._stream}
        if self.axes is not None:
            handlers |= {READ_WORDS: self._read_words, WRITE_WORDS: self._write_words}
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
        if count == 0 or address + count > REGISTERS:
            return BAD_ADDRESS
        return payload + self.registers[address : address + count].astype("<f4").tobytes()

    def _write(self, payload: bytes, time: float) -> bytes | int:
        if len(payload) < 3:
            return BAD_ADDRESS
        address, count = struct.unpack("<HB", payload[:3])
        if count == 0 or address + count > REGISTERS or len(payload) != 3 + 4 * count:
            return BAD_ADDRESS
        if self._burning(time):
            return FLASH_BUSY
        self._draw_power(len(payload))
        self.registers[address : address + count] = np.frombuffer(payload[3:], dtype="<f4")
        return payload[:3]

    def _burning(self, time: float) -> bool:
        self._refusals -= time < self._busy_until
        return time < self._busy_until and self._refusals >= 0

    def _read_words(self, payload: bytes, time: float) -> bytes | int:
        assert self.axes is not None
        if len(payload) != 3:
            return BAD_ADDRESS
        address, count = struct.unpack("<HB", payload)
        if count == 0 or count > 126 or address + count > SIZE:
            return BAD_ADDRESS
        self.axes.refresh()
        return payload + struct.pack(f"<{count}H", *self.axes.words[address : address + count])

    def _write_words(self, payload: bytes, time: float) -> bytes | int:
        assert self.axes is not None
        if len(payload) < 5:
            return BAD_ADDRESS
        address, count = struct.unpack("<HB", payload[:3])
        writable = {first + i for first, size in WRITABLE for i in range(size)}
        if len(payload) != 3 + 2 * count or not writable.issuperset(range(address, address + count)):
            return BAD_ADDRESS
        try:
            self.axes.write(address, list(struct.unpack(f"<{count}H", payload[3:])))
        except OutOfRange:
            return BAD_VALUE
        except Refusal:
            return BAD_STATE
        return payload[:3]

    def _commit(self, payload: bytes, time: float) -> bytes | int:
        if self._burning(time):
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
