"""A simulated unit of any protocol on an in-memory serial line with a power supply that can fail at any byte."""

import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from calstation.bench import BenchConfig
from calstation.bench.imu import UNITS, ImuUnit
from calstation.config import library
from calstation.devices.imu import RegisteredImu, RegisterMap
from calstation.devices.imu.drivers import driver
from calstation.devices.links import PortLostError, Transaction
from calstation.devices.profiles import ImuProfile, load_imu_profile

T = TypeVar("T")

SERIAL = "SN-000042"
#: Parameters stored in the registers of a framed unit in these tests, for speed.
NAMES = ("gyro_bias_x", "gyro_bias_y", "gyro_bias_z", "accel_bias_x", "accel_bias_y", "accel_bias_z")


def shipped(protocol: str) -> ImuProfile:
    """Return the shipped profile that describes the simulated unit of a protocol."""
    return load_imu_profile(library.shipped_folder() / "imus" / f"{UNITS[protocol].profile}.toml")


class PowerLost(BaseException):
    """Raised if the station itself loses power; never caught by the code under test."""


class Supply:
    """Power for `budget` bytes on the wire, in flash or in the journal; None for unlimited power."""

    def __init__(self, budget: int | None = None) -> None:
        self.budget = budget
        self.spent = 0

    def take(self, wanted: int) -> int:
        """Return the number of bytes, at most `wanted`, for which power is left."""
        given = wanted if self.budget is None else min(wanted, self.budget - self.spent)
        self.spent += given
        return given

    @property
    def exhausted(self) -> bool:
        """Whether the power has failed."""
        return self.budget is not None and self.spent >= self.budget


class Wire:
    """The serial line of the unit; replaces `SerialLink`."""

    port, name = "memory", "IMU"
    received_at = property(lambda link: time.monotonic())

    def __init__(self, unit: ImuUnit, supply: Supply) -> None:
        self._supply = supply
        self._parse = unit.new_parser()
        self._waiting = bytearray()
        self._time = 0.0
        self._ready = threading.Event()
        burn, whole = unit.flash.burn, unit.flash.image_bytes

        def burn_while_powered(content: bytes, power_for: int | None = None) -> None:
            given = supply.take(whole)
            burn(content, given if given < whole else power_for)

        unit.flash.burn = burn_while_powered  # type: ignore[method-assign]

    def write(self, data: bytes) -> None:
        """Execute commands while power is left."""
        self._check()
        given = self._supply.take(len(data))
        self._time += 1.0  # so that the flash is never busy
        for answer in self._parse(data[:given], self._time):
            self._waiting += answer[: self._supply.take(len(answer))]
            self._ready.set()
        self._check()

    def read(self, wait: float) -> bytes:
        """Return the replies of the unit."""
        if not self._waiting:
            self._check()
            self._ready.wait(min(wait, 0.0002))
        self._ready.clear()
        data = bytes(self._waiting)
        self._waiting.clear()
        return data

    def close(self) -> None:
        """Do nothing."""

    def _check(self) -> None:
        if self._supply.exhausted:
            raise PortLostError("link.lost", device="imu", port="memory", reason="no power")


@cache
def profile(timeout_s: float = 0.5, protocol: str = "framed") -> ImuProfile:
    """Return a shipped profile with short timeouts."""
    found = shipped(protocol)
    entries = [entry for entry in found.registers if protocol != "framed" or entry.parameters[0] in NAMES]
    quick = found.with_commands(timeout_s=timeout_s, commit_timeout_s=timeout_s)
    return quick.model_copy(update={"registers": entries})


@cache
def registers(protocol: str = "framed") -> RegisterMap:
    """Return the register map of the unit of a protocol."""
    return RegisterMap(tuple(profile(protocol=protocol).registers))


MAP = registers()


@cache
def direct(protocol: str) -> type[RegisteredImu]:
    """Return a driver class without a thread, in which every command is answered or lost before the next one."""

    class Direct(driver(protocol)):  # type: ignore[misc]
        def _serve(self) -> None: ...

        def exchange(self, transaction: Transaction[T], **more: Any) -> T:
            try:
                self._link.write(transaction.request)
                for reply in self._decoder.feed(self._link.read(0.0)).replies:
                    content = transaction.parse(reply)
                    if content is not None:
                        return content
            except PortLostError as error:
                self._failure = error
                raise
            raise PortLostError("link.lost", device="imu", port="memory", reason="no answer")

    return Direct


def write_directly(unit: ImuUnit, profile: ImuProfile, values: Mapping[str, float]) -> None:
    """Write values to the registers of a unit as a profile describes them, by the commands of its protocol."""
    imu = direct(profile.protocol)(Wire(unit, Supply()), profile)  # type: ignore[arg-type]
    imu.write_registers(values)
    imu.close()


class Unit:
    """A unit with its flash in a file; each `powered` context is a power-up with a driver on its wire."""

    def __init__(self, flash: Path, banks: int = 2, protocol: str = "framed") -> None:
        self._flash, self._banks, self._protocol = flash, banks, protocol

    @contextmanager
    def powered(self, supply: Supply | None = None, timeout_s: float = 0.5) -> Iterator[RegisteredImu]:
        """Power the unit up and yield its driver."""
        with self._driven(driver(self._protocol), supply or Supply(), timeout_s) as imu:
            yield imu

    @contextmanager
    def directly(self, supply: Supply) -> Iterator[RegisteredImu]:
        """Power the unit up with a driver without a thread, which is fast enough for thousands of power-ups."""
        with self._driven(direct(self._protocol), supply, 0.5) as imu:
            yield imu

    @property
    def flash(self) -> dict[str, float]:
        """Return the register values after the next power-up, by parameter."""
        with self.directly(Supply()) as imu:
            return imu.read_registers()

    @property
    def cycles(self) -> int:
        """Return the number of write cycles of its flash."""
        return self._boot().flash.cycles

    @contextmanager
    def _driven(self, kind: Any, supply: Supply, timeout_s: float) -> Iterator[RegisteredImu]:
        unit = self.unit = self._boot()
        imu: RegisteredImu = kind(Wire(unit, supply), profile(timeout_s, self._protocol))
        try:
            yield imu
        finally:
            imu.close()

    def _boot(self) -> ImuUnit:
        return UNITS[self._protocol](BenchConfig(serial=SERIAL, flash_file=self._flash, flash_banks=self._banks))
