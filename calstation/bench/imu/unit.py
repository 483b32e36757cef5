"""The processor of a simulated IMU: registers with a flash image, correction of the output, and stream frames.

All values in a frame are little-endian. The checksum is CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF, not
reflected).

    55 AA | counter u16 | gyro x y z, accel x y z i32 | temperature i16, 0.01 °C | status u16 | CRC
"""

import struct
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np
from fastcrc import crc16 as checks

from calstation.bench.config import BenchConfig
from calstation.bench.table import TableRegisters
from calstation.bench.truth import StreamOutput
from calstation.physics import FloatArray, IntArray

#: Number of calibration registers, float32.
REGISTERS = 30

#: In a unit that corrects its output over temperature, the first registers of the three temperatures and of the
#: coefficients, the number of parameters with coefficients, and the highest power of the temperature.
_TEMPERATURES, _COEFFICIENTS, _CHANGING, _POWERS = REGISTERS, REGISTERS + 3, 27, 6

#: States of the stream: off, raw sensor output, and output corrected by the registers.
OFF, RAW, CORRECTED = 0, 1, 2

#: Device time after power-up or reset during which the unit sends nothing, s.
BOOT_TIME = 0.1


STREAM = np.dtype(
    [
        ("sync", "<u2"),
        ("counter", "<u2"),
        ("channels", "<i4", 6),
        ("temperature", "<i2"),
        ("status", "<u2"),
        ("crc", "<u2"),
    ]
)
STREAM_SYNC = 0xAA55  # 55 AA on the wire

READY, SATURATED = 1, 2


def crc16(data: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE of `data`."""
    return int(checks.ibm_3740(data))


def stream_frames(counter: IntArray, counts: FloatArray, temperature: float, status: IntArray) -> bytes:
    """Return the frames of consecutive samples.

    Parameters
    ----------
    counter : sample counter, shape (n,), of which the low 16 bits are sent
    counts : sensor output in counts, shape (n, 6); NaN is sent as the lowest number
    temperature : temperature, °C
    status : status words, shape (n,)
    """
    frames = np.zeros(len(counter), dtype=STREAM)
    frames["sync"] = STREAM_SYNC
    frames["counter"] = counter & 0xFFFF
    frames["channels"] = np.clip(np.nan_to_num(counts, nan=-(2.0**31)), -(2**31), 2**31 - 1)
    frames["temperature"] = round(temperature * 100.0)
    frames["status"] = status
    frames["crc"] = [crc16(frame.tobytes()[2:-2]) for frame in frames]
    return frames.tobytes()


#: Sequence number that precedes the content of an image, and CRC-32 of both, which follows it.
_NUMBER, _CHECK = struct.Struct("<I"), struct.Struct("<I")


def count_flash_cycles(file: Path | None) -> int:
    """Return the number of writes to a flash saved in a file; 0 without a file."""
    return int.from_bytes(file.read_bytes()[:4], "little") if file is not None and file.exists() else 0


class PowerCut(Exception):  # noqa: N818 - an event of the unit, not an error of the program
    """Raised when the power supply of the unit fails."""


class Flash:
    """Flash banks with one image each, which a file preserves between runs.

    If there are two banks, the inactive one is written, and the valid image with the higher number is active at
    power-up; after a power cut, this is the old or the new image. With a single bank, no image is valid after a power
    cut, and the unit starts with its defaults. `cycles` is the number of writes.

    Parameters
    ----------
    size : size of the content, bytes
    banks : number of banks, 1 or 2
    file : file that preserves the images; None to keep them in memory
    """

    def __init__(self, size: int, banks: int = 2, file: Path | None = None) -> None:
        self.cycles = count_flash_cycles(file)
        self.image_bytes = _NUMBER.size + size + _CHECK.size
        self._file = file
        self._erased = b"\xff" * self.image_bytes
        self._banks = [self._erased] * banks
        if file is not None and file.exists():
            content = file.read_bytes()
            self._banks = [content[4 + i * self.image_bytes :][: self.image_bytes] for i in range(banks)]

    def load(self) -> bytes | None:
        """Return the content of the active image, or None if no image is valid."""
        images = [image for image in map(self._read, self._banks) if image is not None]
        return max(images, key=lambda image: image[0])[1] if images else None

    def burn(self, content: bytes, power_for: int | None = None) -> None:
        """Erase the inactive bank and write it. If `power_for` is not None, raises PowerCut after this many bytes."""
        numbers = [image[0] if image is not None else 0 for image in map(self._read, self._banks)]
        bank = int(np.argmin(numbers))
        body = _NUMBER.pack(max(numbers) + 1) + content
        image = body + _CHECK.pack(zlib.crc32(body))
        written = len(image) if power_for is None else min(power_for, len(image))
        self._banks[bank] = image[:written] + self._erased[written:]
        self.cycles += 1
        if self._file is not None:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            self._file.write_bytes(self.cycles.to_bytes(4, "little") + b"".join(self._banks))
        if power_for is not None:
            raise PowerCut

    def _read(self, bank: bytes) -> tuple[int, bytes] | None:
        """Return the number and content of an image, or None if its checksum is wrong."""
        body = bank[: -_CHECK.size]
        if len(bank) != self.image_bytes or _CHECK.pack(zlib.crc32(body)) != bank[-_CHECK.size :]:
            return None
        return _NUMBER.unpack_from(body)[0], body[_NUMBER.size :]


#: Iterations for the second-order term; each reduces its error by a factor of about 10^-5.
_ITERATIONS = 4


@dataclass(frozen=True)
class Correction:
    """The correction of the output by the registers of a unit, as specified in its documentation.

        rate = gyro · (measured − before) + after
        force = accel · (measured − bias − quadratic · force² − cubic · force³) + size effect

    Matrices have shape (3, 3), vectors shape (3,), SI. `levers` are the displacements of the accelerometers along their
    own axes.
    """

    gyro: FloatArray
    before: FloatArray
    after: FloatArray
    accel: FloatArray
    bias: FloatArray
    quadratic: FloatArray
    levers: FloatArray
    cubic: FloatArray = field(default_factory=lambda: np.zeros(3))

    def apply(self, measured: FloatArray) -> FloatArray:
        """Return the corrected rate, rad/s, and force, m/s², shape (n, 6), of measured samples, shape (n, 6)."""
        rate = _times(self.gyro, measured[:, :3] - self.before) + self.after
        straight = measured[:, 3:] - self.bias
        force = _times(self.accel, straight)
        for _ in range(_ITERATIONS):
            force = _times(self.accel, straight - self.quadratic * force * force - self.cubic * force**3)
        # An accelerometer displaced along its own axis senses the centripetal acceleration about the other two axes.
        squares = rate * rate
        outwards = squares[:, [1, 2, 0]] + squares[:, [2, 0, 1]]
        return np.hstack([rate, force + self.levers * outwards])


def _times(matrix: FloatArray, rows: FloatArray) -> FloatArray:
    """Multiply each row by a matrix; unlike with BLAS, the result does not depend on the number of rows."""
    return np.asarray((rows[:, None, :] * matrix).sum(axis=2))


class Requantiser:
    """Converts corrected output to counts; the rounding remainder of an increment is added to the next increment."""

    def __init__(self) -> None:
        self._remainder = np.zeros(6)

    def counts(self, values: FloatArray, scale: FloatArray, *, carry: bool) -> FloatArray:
        """Convert corrected output to whole counts, shape (n, 6).

        Parameters
        ----------
        values : corrected output, shape (n, 6)
        scale : size of a count in the units of `values`, shape (6,)
        carry : whether the rounding remainder is added to the next value, as for increments
        """
        exact = values / scale
        if not carry or not len(exact):
            return np.asarray(np.floor(exact + 0.5))
        finite = np.isfinite(exact)
        numbers = np.where(finite, exact, 0.0)
        base = np.floor(numbers)  # only fractions are summed, because the rounding error of a large sum grows
        total = self._remainder + np.cumsum(numbers - base, axis=0)
        rounded = np.floor(total + 0.5)
        whole = base + np.diff(rounded, axis=0, prepend=0.0)
        self._remainder = total[-1] - rounded[-1]
        return np.where(finite, whole, exact)


class ImuUnit(ABC):
    """Base class of the simulated units of all protocols, which reply to commands and convert samples to frames.

    All times are device times in s. `scale` is the size of a count, rad/s and m/s², shape (6,). `axes` contains the
    registers of the table's axes if they are accessed over the unit's line. `write_power_cut` and `commit_power_cut`
    are the numbers of bytes that are written to registers and flash before a brief power failure; None means that the
    power does not fail.
    """

    #: Shipped IMU profile that describes a unit of grade mems.
    profile: ClassVar[str]
    #: Size of a frame of the stream, bytes.
    frame_size = STREAM.itemsize
    #: Size of the flash content, bytes.
    flash_bytes = 4 * REGISTERS

    def __init__(self, config: BenchConfig, scale: FloatArray | None = None) -> None:
        self._config, self._serial = config, config.serial
        self.register_count = REGISTERS + config.thermal_registers * (3 + _CHANGING * _POWERS)
        size = 4 * self.register_count if config.thermal_registers else self.flash_bytes
        self.flash = Flash(size, config.flash_banks, config.flash_file)
        self.axes: TableRegisters | None = None
        self.scale: FloatArray = np.ones(6) if scale is None else scale
        self.increments = config.output == "increment"
        #: Output of the temperature sensor at a time, °C, if the unit is in a chamber.
        self.sensor_output: Callable[[float], float] | None = None
        self.write_power_cut: int | None = None
        self.commit_power_cut: int | None = None
        self.streaming = True
        self.restart(0.0)

    def restart(self, time: float) -> None:
        """Load the registers from flash, restart the counter at 0, and set the ready bit after the ready time."""
        self.registers = np.zeros(self.register_count, np.float32)
        content = self.flash.load()
        if content is not None:
            self._load_registers(content)
        self._started = self._now = time
        self.counter = 0
        self.corrected = False
        self._requantiser = Requantiser()

    def _load_registers(self, content: bytes) -> None:
        """Load the registers from the content of the flash."""
        self.registers = np.frombuffer(content, "<f4").astype(np.float32)

    def _register_bytes(self) -> bytes:
        """Return the registers in the format of the flash."""
        return self.registers.astype("<f4").tobytes()

    def calibrate(self, model: FloatArray) -> None:
        """Store an `ImuTruth.error_model` in registers and flash if the flash is empty."""
        if self.flash.load() is not None:
            return
        levers = np.diag(model[9:12])
        rows = (model[6], model[0:3] - np.eye(3), model[7], model[3:6] - np.eye(3), model[8], levers)
        self.registers = np.concatenate([np.ravel(row) for row in rows]).astype(np.float32)
        self.flash.burn(self._register_bytes())

    def _burn(self) -> None:
        """Write all registers to flash. Raises PowerCut if the power fails."""
        power_for, self.commit_power_cut = self.commit_power_cut, None
        self.flash.burn(self._register_bytes(), power_for)

    def _count_written(self, written: int) -> None:
        """Count bytes written to registers. Raises PowerCut if the power fails while they are written."""
        if self.write_power_cut is not None:
            self.write_power_cut -= written
            if self.write_power_cut < 0:
                self.write_power_cut = None
                raise PowerCut

    def temperature(self, time: float) -> float:
        """Return the sensor temperature at `time`, °C."""
        config = self._config
        if self.sensor_output is not None:
            return self.sensor_output(time)
        return float(config.ambient_c + config.warm_up_c * -np.expm1(-time / config.warm_up_time_s))

    def frames(self, output: StreamOutput, ends: FloatArray) -> bytes:
        """Return the frames of samples that end at `ends`, s, shape (n,); empty while booting or not streaming."""
        awake = ends > self._started + BOOT_TIME
        counter = self.counter + np.cumsum(awake) - 1
        self.counter += int(awake.sum())
        if not self.streaming or not awake.any():
            return b""
        status = np.where(ends >= self._started + self._config.ready_time_s, READY, 0)
        status |= np.where(output.saturated, SATURATED, 0)
        counts = output.counts[awake]
        if self.corrected or self._config.after_registers:
            self._now = float(ends[-1])
            values = self.correction().apply(counts * self.scale)
            counts = self._requantiser.counts(values, self.scale, carry=self.increments)
        return stream_frames(counter[awake], counts, self.temperature(float(ends[-1])), status[awake])

    def correction(self) -> Correction:
        """Return the correction defined by the current registers, at the temperature of the sensor."""
        registers: FloatArray = self.registers.astype(np.float64)
        if self._config.thermal_registers:
            reference, low, high = registers[_TEMPERATURES:_COEFFICIENTS]
            change = min(max(self.temperature(self._now), low), high) - reference
            powers = change ** np.arange(1, _POWERS + 1)
            registers[:_CHANGING] += powers @ registers[_COEFFICIENTS:].reshape(_POWERS, _CHANGING)
        return Correction(
            gyro=np.asarray(np.linalg.inv(np.eye(3) + registers[3:12].reshape(3, 3))),
            before=registers[0:3],
            after=np.zeros(3),
            accel=np.asarray(np.linalg.inv(np.eye(3) + registers[15:24].reshape(3, 3))),
            bias=registers[12:15],
            quadratic=registers[24:27],
            levers=registers[27:30],
        )

    @abstractmethod
    def new_parser(self) -> Callable[[bytes, float], list[bytes]]:
        """Return a parser for one connection, which converts received bytes and device time to replies in order."""
