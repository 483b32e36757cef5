"""The IMU's processor: identity, calibration registers with a flash image, power-up, stream frames."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from calstation.bench.config import BenchConfig
from calstation.bench.imu.correction import Correction, Requantiser
from calstation.bench.imu.flash import Flash, PowerCut
from calstation.bench.imu.frames import READY, SATURATED, STREAM, stream_frames
from calstation.bench.table import TableRegisters
from calstation.bench.truth import StreamOutput
from calstation.physics import FloatArray

#: Number of calibration registers, float32.
REGISTERS = 30

#: States of the stream: off, raw sensor output, or corrected by the registers.
OFF, RAW, CORRECTED = 0, 1, 2

#: Device time for which the unit is silent after power-up or reset, s.
BOOT_TIME = 0.1


class ImuUnit(ABC):
    """Base of the units of all protocols: replies to commands and converts samples to frames; times in s, device time.

    `scale` is the size of a count, rad/s and m/s², shape (6,). `axes` contains the registers of the table's axes if
    they are accessed over the unit's line. `fails_writing` and `fails_committing` are the numbers of bytes written to
    registers or flash before the power fails briefly; None for no power failure.
    """

    #: Shipped IMU profile that describes a unit of grade mems.
    profile: ClassVar[str]
    #: Size of a frame of the stream, bytes.
    frame_size = STREAM.itemsize
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
        self.streaming = True
        self.restart(0.0)

    def restart(self, time: float) -> None:
        """Reload the registers from flash, restart the counter at 0, and set the ready bit after the ready time."""
        self.registers = np.zeros(REGISTERS, np.float32)
        content = self.flash.load()
        if content is not None:
            self._load_registers(content)
        self._started = time
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
        registers: FloatArray = self.registers.astype(np.float64)
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
    def conversation(self) -> Callable[[bytes, float], list[bytes]]:
        """Return a parser for one connection, which converts received bytes and device time to replies in order."""
