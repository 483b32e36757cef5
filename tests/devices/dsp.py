"""A bench unit's processor on a wire in memory, under a supply that can break down at any byte."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TypeVar

from calstation.bench.flash import IMAGE_BYTES
from calstation.bench.imu_frames import CommandParser, crc16
from calstation.bench.imu_unit import COMMIT, ImuUnit
from calstation.devices.framed_imu import FramedImu
from calstation.devices.frames import FrameDecoder
from calstation.devices.imu_profile import ImuProfile, load_imu_profile
from calstation.devices.link import PortLostError
from calstation.devices.registers import RegisterMap
from calstation.devices.streamed_imu import Question
from calstation.station import library

T = TypeVar("T")

SERIAL = "SN-000042"
NAMES = ("gyro_bias_x", "gyro_bias_y", "gyro_bias_z", "accel_bias_x", "accel_bias_y", "accel_bias_z")


class Dark(BaseException):
    """The station itself has no power any more: nothing catches this."""


class Supply:
    """Power for so many bytes on the wire, in flash or in the journal; None for ever."""

    def __init__(self, budget: int | None = None) -> None:
        self.budget = budget
        self.spent = 0

    def take(self, wanted: int) -> int:
        """How many of `wanted` bytes there is power for."""
        given = wanted if self.budget is None else min(wanted, self.budget - self.spent)
        self.spent += given
        return given

    @property
    def dark(self) -> bool:
        """Whether the power has broken down."""
        return self.budget is not None and self.spent >= self.budget


class Wire:
    """The unit's serial line; stands in for `SerialLink`."""

    port, name = "memory", "IMU"

    def __init__(self, unit: ImuUnit, supply: Supply) -> None:
        self._unit, self._supply = unit, supply
        self._parser = CommandParser()
        self._waiting = bytearray()
        self._time = 0.0
        self._ready = threading.Event()

    def write(self, data: bytes) -> None:
        """Commands, carried out as far as there is power."""
        self._check()
        given = self._supply.take(len(data))
        for op, payload in self._parser.feed(data[:given]):
            if op == COMMIT:
                left = self._supply.take(IMAGE_BYTES)
                if left < IMAGE_BYTES:
                    self._unit.fails_committing = left
            self._time += 1.0  # so that its flash is never busy
            answer = self._unit.answer(op, payload, self._time)
            self._waiting += answer[: self._supply.take(len(answer))]
            self._ready.set()
        self._check()

    def read(self, wait: float) -> bytes:
        """What the unit has answered."""
        if not self._waiting:
            self._check()
            self._ready.wait(min(wait, 0.0002))
        self._ready.clear()
        data = bytes(self._waiting)
        self._waiting.clear()
        return data

    def close(self) -> None:
        """Nothing to close."""

    def _check(self) -> None:
        if self._supply.dark:
            raise PortLostError("IMU: port memory was lost (no power); check cable and power")


@cache
def profile(timeout_s: float = 0.5) -> ImuProfile:
    """The bench's navigation profile with the registers of both biases alone."""
    shipped = load_imu_profile(library.shipped_folder() / "imus" / "bench_nav.toml")
    entries = [entry for entry in shipped.registers if entry.parameters[0] in NAMES]
    assert shipped.commands is not None
    commands = shipped.commands.model_copy(update={"timeout_s": timeout_s, "commit_timeout_s": timeout_s})
    return shipped.model_copy(update={"registers": entries, "commands": commands})


MAP = RegisterMap(tuple(profile().registers))


class DirectImu(FramedImu):
    """The driver without its thread: every command is answered, or lost, before the next."""

    def __init__(self, wire: Wire, used: ImuProfile) -> None:
        assert used.commands is not None
        self._wire, self._profile, self._commands = wire, used, used.commands
        self._registers = RegisterMap(tuple(used.registers))
        self._commit_timeout = self._burns_until = 0.0
        self._reset_timeout, self._streaming = used.commands.reset_timeout_s, False
        self._failure = None

    def exchange(self, question: Question[T], *, timeout: float, attempts: int, urgent: bool = False) -> T:
        try:
            self._wire.write(question.request)
            for reply in FrameDecoder(self._profile.frame, self._commands).feed(self._wire.read(0.0)).replies:
                taken = question.take(reply)
                if taken is not None:
                    return taken
        except PortLostError as error:
            self._failure = error
            raise
        raise PortLostError("IMU: no answer")

    def close(self) -> None: ...


class Unit:
    """A unit that keeps its flash in a file; every `powered` is a power-up with a driver on its wire."""

    def __init__(self, flash: Path, banks: int = 2) -> None:
        self._flash, self._banks = flash, banks
        crc16(b"")  # compiled here and not while an answer is waited for

    @contextmanager
    def powered(self, supply: Supply | None = None, timeout_s: float = 0.5) -> Iterator[FramedImu]:
        """The driver on the running unit."""
        self.unit = self._boot()
        imu = FramedImu(Wire(self.unit, supply or Supply()), profile(timeout_s))  # type: ignore[arg-type]
        try:
            yield imu
        finally:
            imu.close()

    @contextmanager
    def directly(self, supply: Supply) -> Iterator[FramedImu]:
        """The same without the driver's thread, for thousands of power-ups."""
        self.unit = self._boot()
        yield DirectImu(Wire(self.unit, supply), profile())

    @property
    def flash(self) -> dict[str, float]:
        """What it would wake up with, by parameter."""
        values = self._boot().registers
        return dict(zip(NAMES, [*values[:3].tolist(), *values[12:15].tolist()], strict=True))

    @property
    def cycles(self) -> int:
        """Times that its flash was burnt."""
        return self._boot().flash_cycles

    def _boot(self) -> ImuUnit:
        return ImuUnit(SERIAL, flash_file=self._flash, flash_banks=self._banks)
