"""A unit with the protocol of a VectorNav VN-100: binary output 1, lines $VN...*checksum, registers 25 and 84.

Binary output: FA 05 | 0001 001C | time since power-up u64 ns | accel 3 f32 | gyro 3 f32 | temperature f32 |
CRC-16/XMODEM, high byte first; or compensated: FA 05 | 0001 0610 | time | temperature | accel | gyro | CRC. Registers
25 (accelerometer) and 84 (gyro) contain matrix C row by row, then offset B: compensated = C (measured − B); factory
values are I and 0.
"""

from collections.abc import Callable

import numpy as np
from fastcrc import crc16

from calstation.bench.imu.unit import BOOT_TIME, REGISTERS, Correction, ImuUnit, PowerCut
from calstation.bench.truth import StreamOutput
from calstation.physics import FloatArray

MODEL, FIRMWARE = "VN-100T", "2.1.0.0"
SAMPLES = np.dtype([("head", "V6"), ("time", "<u8"), ("values", "<f4", 7), ("crc", ">u2")])
_HEAD = bytes.fromhex("FA 05 01 00 1C 00")
_COMPENSATED_HEAD = bytes.fromhex("FA 05 01 00 10 06")
_OUTPUT, _COMPENSATED_OUTPUT = ["05", "0001", "001C"], ["05", "0001", "0610"]
_IMU_RATE = 800.0

#: Ranges of the sensors, rad/s and m/s²: ±2000 °/s and ±16 g.
_RANGES = np.repeat([np.deg2rad(2000.0), 16.0 * 9.80665], 3)

#: Index in flash of the first of a register's twelve numbers; C is stored there as C − I.
_OFFSETS = {84: 0, 25: 12}
_ONES = (0, 4, 8)

BAD_CHECK, BAD_COMMAND, TOO_FEW, TOO_MANY, BAD_VALUE, BAD_REGISTER, READ_ONLY = 3, 4, 5, 6, 7, 8, 9


def check_line(words: str) -> int:
    """Return the XOR of the characters between $ and *."""
    value = 0
    for byte in words.encode("ascii", "replace"):
        value ^= byte
    return value


class VectorNavUnit(ImuUnit):
    """A unit with the VN-100 protocol, see the module docstring; its output must be a rate."""

    profile = "vectornav_vn100"
    frame_size = SAMPLES.itemsize

    def restart(self, time: float) -> None:
        """Restart the unit; see `ImuUnit.restart`."""
        super().restart(time)
        self.streaming = bool(self.registers[REGISTERS - 1])

    def frames(self, output: StreamOutput, ends: FloatArray) -> bytes:
        """Return the frames of samples; see `ImuUnit.frames`."""
        awake = ends > self._started + BOOT_TIME
        if not self.streaming or not awake.any():
            return b""
        frames = np.zeros(int(awake.sum()), dtype=SAMPLES)
        frames["head"] = np.void(_COMPENSATED_HEAD if self.corrected else _HEAD)
        nanoseconds = 1e9 + 1e3 * self._config.effects.sample_clock_ppm
        frames["time"] = np.rint((ends[awake] - self._started) * nanoseconds).astype(np.uint64)
        values = np.clip(output.counts[awake] * self.scale, -_RANGES, _RANGES)
        heat = np.full((len(values), 1), self.temperature(float(ends[-1])))
        if self.corrected:
            values = self.correction().apply(values)
            frames["values"] = np.hstack([heat, values[:, 3:], values[:, :3]])
        else:
            frames["values"] = np.hstack([values[:, 3:], values[:, :3], heat])
        frames["crc"] = [crc16.xmodem(frame.tobytes()[1:-2]) for frame in frames]
        return frames.tobytes()

    def correction(self) -> Correction:
        """Return the correction defined by the registers; the module docstring contains the formula."""
        gyro, accel = (np.array(self._numbers(register)) for register in (84, 25))
        return Correction(
            gyro=gyro[:9].reshape(3, 3),
            before=gyro[9:],
            after=np.zeros(3),
            accel=accel[:9].reshape(3, 3),
            bias=accel[9:],
            quadratic=np.zeros(3),
            levers=np.zeros(3),
        )

    def new_parser(self) -> Callable[[bytes, float], list[bytes]]:
        """Return a parser for one connection; see `ImuUnit.new_parser`."""
        pending = b""

        def answer(data: bytes, time: float) -> list[bytes]:
            nonlocal pending
            *lines, pending = (pending + data).split(b"\n")
            pending = pending[-1000:]
            return [self._line(line.decode("ascii", "replace").strip(), time) for line in lines]

        return answer

    def _line(self, line: str, time: float) -> bytes:
        words, _, check = line[line.find("$") + 1 :].rpartition("*")
        if "$" not in line or not words.startswith("VN"):
            return b""
        try:
            valid = check == "XX" or int(check, 16) == check_line(words)
        except ValueError:
            valid = False
        try:
            reply: str | int = self._execute(words.split(","), time) if valid else BAD_CHECK
        except PowerCut:
            self.restart(time)
            return b""
        except ValueError:
            reply = BAD_VALUE
        text = f"VNERR,{reply:02X}" if isinstance(reply, int) else reply
        return f"${text}*{check_line(text):02X}\r\n".encode()

    def _execute(self, words: list[str], time: float) -> str | int:
        command, *arguments = words
        if command == "VNWNV":
            self.registers[REGISTERS - 1] = float(self.streaming)
            self._burn()
            return "VNWNV"
        if command == "VNRST":
            self.restart(time)
            return "VNRST"
        if command not in ("VNRRG", "VNWRG"):
            return BAD_COMMAND
        if not arguments:
            return TOO_FEW
        return (
            self._read_register(int(arguments[0]))
            if command == "VNRRG"
            else self._write_register(int(arguments[0]), arguments)
        )

    def _read_register(self, register: int) -> str | int:
        texts = {1: MODEL, 3: self._serial, 4: FIRMWARE, 6: "0"}
        if register in texts:
            return f"VNRRG,{register:02d},{texts[register]}"
        if register not in _OFFSETS:
            return BAD_REGISTER
        return f"VNRRG,{register:02d}," + ",".join(f"{value:+.6E}" for value in self._numbers(register))

    def _numbers(self, register: int) -> list[float]:
        numbers = self.registers[_OFFSETS[register] :][:12].copy()
        numbers[list(_ONES)] += np.float32(1.0)
        return [float(value) for value in numbers]

    def _write_register(self, register: int, words: list[str]) -> str | int:
        fields = words[1:]
        if register == 6:
            return "VNWRG," + ",".join(words) if fields == ["0"] else BAD_VALUE
        if register == 75:
            return self._set_output(words)
        if register in (1, 3, 4):
            return READ_ONLY
        if register not in _OFFSETS:
            return BAD_REGISTER
        if len(fields) != 12:
            return TOO_FEW if len(fields) < 12 else TOO_MANY
        numbers = np.array([float(field) for field in fields], dtype=np.float32)
        if not np.all(np.isfinite(numbers)):
            return BAD_VALUE
        self._count_written(sum(map(len, fields)))
        numbers[list(_ONES)] -= np.float32(1.0)
        self.registers[_OFFSETS[register] : _OFFSETS[register] + 12] = numbers
        return "VNWRG," + ",".join(words)

    def _set_output(self, words: list[str]) -> str | int:
        if len(words) < 4:
            return TOO_FEW
        mode, divisor = int(words[1]), int(words[2])
        if mode not in (0, 1) or divisor <= 0 or (mode == 1 and _IMU_RATE / divisor != self._config.sample_rate_hz):
            return BAD_VALUE
        output = [word.upper().zfill(len(known)) for word, known in zip(words[3:], _OUTPUT, strict=False)]
        if output not in (_OUTPUT, _COMPENSATED_OUTPUT):
            return BAD_VALUE
        self.streaming, self.corrected = mode == 1, output == _COMPENSATED_OUTPUT
        return "VNWRG," + ",".join(words)


UNIT = VectorNavUnit
