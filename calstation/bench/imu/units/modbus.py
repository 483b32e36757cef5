"""A unit with Modbus RTU registers on the line on which it streams the frames of the bench.

Holding registers, 0-based, unit 1, high byte first:

    0 model, 8 serial, 16 firmware (text)   20 stream: 0 off, 1 raw, 2 corrected
    21 commit (0x5A5A)   22 reset (0xA5A5)   23 page
    page 1: 100 gyro matrix, 9 f32, low word first   118 gyro offset, 3 f64
    page 2: 200 accelerometer matrix, 6 i32, 2^-30   212 bias, 3 i32, low word first, 1e-7 m/s²
            218 quadratic, 3 f32                     224 levers, 3 i16, 5e-5 m
    page 3: 300 third-order terms of the accelerometers, 3 f32, s⁴/m²

The gyro registers contain E column by column: rate = (I + E)⁻¹ measured + offset. The accelerometer registers contain
the lower triangle of I − C: force = C (measured − bias − quadratic · force² − cubic · force³), with the effect of the
levers added.
"""

import struct
from collections.abc import Callable

import numpy as np

from calstation.bench.imu.unit import CORRECTED, OFF, RAW, Correction, ImuUnit, PowerCut
from calstation.bench.links import ModbusServer, NoReply
from calstation.bench.table import NoSuchRegister, OutOfRange

MODEL, FIRMWARE = "bench-dsp", "2.0"
UNIT_NUMBER = 1
STREAM, COMMIT, RESET, PAGE = 20, 21, 22, 23
COMMIT_WORD, RESET_WORD = 0x5A5A, 0xA5A5

#: Calibration registers of each page, as (first, count).
PAGES = {1: (100, 30), 2: (200, 27), 3: (300, 6)}

#: Number of reads of the commit register until it reports the end of a commit.
_BUSY_READS = 2


class DspUnit(ImuUnit):
    """A unit with Modbus registers; see the module docstring."""

    profile = "dsp_modbus"
    flash_bytes = 2 * sum(count for _, count in PAGES.values())

    def restart(self, time: float) -> None:
        """Restart the unit; see `ImuUnit.restart`."""
        self._words = {page: [0] * count for page, (_, count) in PAGES.items()}
        super().restart(time)
        self._page = 0
        self._busy = 0

    def _load_registers(self, content: bytes) -> None:
        words = list(struct.unpack(f"<{len(content) // 2}H", content))
        for page, (_, count) in PAGES.items():
            self._words[page], words = words[:count], words[count:]

    def _register_bytes(self) -> bytes:
        words = [word for page in PAGES for word in self._words[page]]
        return struct.pack(f"<{len(words)}H", *words)

    def new_parser(self) -> Callable[[bytes, float], list[bytes]]:
        """Return a parser for one connection; see `ImuUnit.new_parser`."""
        parse = ModbusServer({UNIT_NUMBER: self}).new_parser()

        def answer_at(data: bytes, time: float) -> list[bytes]:
            self._time = time
            return parse(data)

        return answer_at

    def read(self, address: int, count: int) -> list[int]:
        """Return the content of registers. Raises NoSuchRegister."""
        return [self._get(address + i) for i in range(count)]

    def write(self, address: int, values: list[int]) -> None:
        """Execute a command or write registers. Raises a `Refusal`, or NoReply if the power fails."""
        try:
            self._put(address, values)
        except PowerCut:
            self.restart(self._time)
            raise NoReply from None

    def _get(self, address: int) -> int:
        for first, text in ((0, MODEL), (8, self._serial), (16, FIRMWARE)):
            size = 8 if first < 16 else 4
            if first <= address < first + size:
                padded = text.encode("ascii", "replace").ljust(16, b"\0")
                at = 2 * (address - first)
                return int.from_bytes(padded[at : at + 2], "big")
        if address == STREAM:
            return (CORRECTED if self.corrected else RAW) if self.streaming else OFF
        if address == COMMIT:
            self._busy = max(0, self._busy - 1)
            return COMMIT_WORD if self._busy else 0
        if address == PAGE:
            return self._page
        first, count = PAGES.get(self._page, (0, 0))
        if not first <= address < first + count:
            raise NoSuchRegister
        return self._words[self._page][address - first]

    def _put(self, address: int, words: list[int]) -> None:
        if address in (STREAM, COMMIT, RESET, PAGE) and len(words) == 1:
            self._command(address, words[0])
            return
        first, count = PAGES.get(self._page, (0, 0))
        if not first <= address or address + len(words) > first + count:
            raise NoSuchRegister
        self._count_written(2 * len(words))
        self._words[self._page][address - first : address - first + len(words)] = words

    def _command(self, address: int, word: int) -> None:
        if address == STREAM and word in (OFF, RAW, CORRECTED):
            self.streaming, self.corrected = word != OFF, word == CORRECTED
        elif address == PAGE:
            self._page = word
        elif address == COMMIT and word == COMMIT_WORD:
            self._burn()
            self._busy = _BUSY_READS
        elif address == RESET and word == RESET_WORD:
            self.restart(self._time)
        else:
            raise OutOfRange

    def correction(self) -> Correction:
        """Return the correction defined by the registers; the module docstring contains formulas and addresses."""
        gyros, accels = (np.array(self._words[page], dtype=">u2") for page in (1, 2))
        cubic = np.array(self._words[3], dtype=">u2").tobytes()
        columns = gyros[:18].reshape(9, 2)[:, ::-1].tobytes()
        error = np.frombuffer(columns, ">f4").astype(np.float64).reshape(3, 3).T
        less = np.zeros((3, 3))
        less[np.tril_indices(3)] = np.frombuffer(accels[:12].tobytes(), ">i4") / 2.0**30
        bias = accels[12:18].reshape(3, 2)[:, ::-1].tobytes()
        return Correction(
            gyro=np.asarray(np.linalg.inv(np.eye(3) + error), dtype=np.float64),
            before=np.zeros(3),
            after=np.frombuffer(gyros[18:].tobytes(), ">f8").astype(np.float64),
            accel=np.eye(3) - less,
            bias=1e-7 * np.frombuffer(bias, ">i4"),
            quadratic=np.frombuffer(accels[18:24].tobytes(), ">f4").astype(np.float64),
            cubic=np.frombuffer(cubic, ">f4").astype(np.float64),
            levers=5e-5 * accels[24:].astype(np.int16).astype(np.float64),
        )


UNIT = DspUnit
