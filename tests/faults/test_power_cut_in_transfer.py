"""Power of station and unit is cut at every byte of a register transfer: on the wire, in flash, in the journal."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calstation.devices.imu import FlashContent, TransferOutcome, finish, read_flash_content, restore, transfer
from calstation.errors import CalstationError
from calstation.records.evidence import chained_lines
from calstation.registers import journal as register_journal
from tests.devices.powered_unit import SERIAL, UNITS, PowerLost, Supply, Unit, registers
from tests.helpers import sampled

pytestmark = pytest.mark.long

SIZES = {"gyro_bias": 1e-5, "accel_bias": 1e-2, "accel_quadratic": 1e-6, "inner_lever": 1e-2}


def values(protocol: str, factor: float) -> dict[str, float]:
    """Return a value for every register of a type of unit, rounded as the unit stores it."""
    names = registers(protocol).parameters
    values = {n: factor * (i + 1) * (-1) ** i * SIZES.get(n.rsplit("_", 1)[0], 1e-5) for i, n in enumerate(names)}
    return registers(protocol).rounded(values)


class Station:
    """The power supply shared by computer and unit."""

    supply = Supply()


@pytest.fixture(autouse=True)
def _journal_under_power(monkeypatch: pytest.MonkeyPatch) -> None:
    write = chained_lines._write

    def write_while_powered(handle: int, data: bytes) -> None:
        given = Station.supply.take(len(data))
        write(handle, data[:given])
        if given < len(data) or Station.supply.exhausted:
            raise PowerLost

    monkeypatch.setattr(chained_lines, "_write", write_while_powered)
    # The cut is at a byte of these files, not of a real disk: nothing need wait for one, nor for a busy flash.
    monkeypatch.setattr("os.fsync", lambda handle: None)
    monkeypatch.setattr("calstation.devices.imu.drivers.modbus.POLL_INTERVAL", 0.0)


class Factory:
    """A unit, a folder of runs, and a common supply that can fail at any byte."""

    def __init__(self, folder: Path, protocol: str) -> None:
        self.unit = Unit(folder / "flash.bin", protocol=protocol)
        self.protocol = protocol
        self.map = registers(protocol)
        self.runs = folder

    def begin(self, old: Mapping[str, float], new: Mapping[str, float]) -> register_journal.Transfer:
        return register_journal.begin(self.runs, SERIAL, old, new, register_journal.Purpose("wang", "run", "a.h5"))

    def write(self, values: Mapping[str, float], budget: int | None = None) -> int:
        """Run a complete transfer with power for `budget` bytes; return the number of bytes used."""
        return self._powered(lambda imu: self._transfer(imu, values), budget)

    def recover(self, choice: str, budget: int | None = None) -> None:
        """Recover an interrupted transfer as at the next start."""
        entry = register_journal.interrupted(self.runs, SERIAL)
        if entry is None:
            return

        def go(imu: Any) -> None:
            if choice == "finish":
                finish(imu, self.map, entry)
                entry.close(TransferOutcome.DONE)
            else:
                restore(imu, self.map, entry)

        self._powered(go, budget)

    def has_registers(self, values: Mapping[str, float]) -> bool:
        """Return whether the unit has these values after a power-up."""
        return not self.map.differing_parameters(values, self.unit.flash)

    def _transfer(self, imu: Any, values: Mapping[str, float]) -> None:
        transfer(imu, self.map, SERIAL, values, self.begin).entry.close(TransferOutcome.DONE)

    def _powered(self, work: Any, budget: int | None) -> int:
        supply = Station.supply = Supply(budget)
        try:
            with self.unit.directly(supply) as imu:
                work(imu)
        except (PowerLost, CalstationError):
            if budget is None:
                raise
        Station.supply = Supply()
        return supply.spent

    def check(self, before: Mapping[str, float]) -> None:
        """Assert the conditions that hold after a power cut at any byte."""
        entry = register_journal.interrupted(self.runs, SERIAL)
        done = [t for t in register_journal.history(self.runs, SERIAL) if t.closing == "done"]
        if entry is None:
            assert self.has_registers(done[-1].new if done else before)
        else:
            with self.unit.directly(Supply()) as imu:
                assert read_flash_content(imu, entry, self.map) in (FlashContent.OLD, FlashContent.NEW)
        assert register_journal.cycles(self.runs, SERIAL) >= self.unit.cycles


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("stride", [61, pytest.param(1, marks=pytest.mark.exhaustive)])
@pytest.mark.parametrize("protocol", UNITS)
def test_power_cut_at_any_byte_is_recovered(tmp_path: Path, protocol: str, stride: int) -> None:
    first, second = values(protocol, 1.0), values(protocol, -2.5)
    start = tmp_path / "start"
    start.mkdir()
    Factory(start, protocol).write(first)
    whole = Factory(_copy(start, "whole"), protocol)
    length = whole.write(second)
    assert whole.has_registers(second)
    assert not whole.has_registers(first)
    assert whole.unit.cycles == register_journal.cycles(whole.runs, SERIAL) == 2
    seen = set()
    for cut in range(0, length, stride):
        factory = Factory(_copy(start, str(cut)), protocol)
        factory.write(second, cut)
        factory.check(first)
        entry = register_journal.interrupted(factory.runs, SERIAL)
        choice = "finish" if cut % 2 else "restore"
        seen.add((choice, entry is not None))
        factory.recover(choice)
        assert register_journal.interrupted(factory.runs, SERIAL) is None
        if entry is not None:
            assert factory.has_registers(second if choice == "finish" else first)
        shutil.rmtree(factory.runs)
    assert seen == {("finish", True), ("finish", False), ("restore", True), ("restore", False)}


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("protocol", sampled(3, UNITS))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    first=st.floats(0.0, 1.0),
    further=st.lists(st.tuples(st.sampled_from(["finish", "restore"]), st.floats(0.0, 1.0)), max_size=4),
    last=st.sampled_from(["finish", "restore"]),
)
def test_repeated_power_cuts_during_recovery_are_recovered(
    tmp_path_factory: pytest.TempPathFactory,
    protocol: str,
    first: float,
    further: list[tuple[str, float]],
    last: str,
) -> None:
    factory = Factory(tmp_path_factory.mktemp("cuts"), protocol)
    before, new = values(protocol, 1.0), values(protocol, -2.5)
    length = factory.write(before)
    factory.write(new, round(first * length))
    for choice, share in further:
        factory.check(before)
        factory.recover(choice, round(0.8 * share * length))
    factory.check(before)
    factory.recover(last)
    assert register_journal.interrupted(factory.runs, SERIAL) is None
    assert factory.has_registers(before) or factory.has_registers(new)
    factory.check(before)


def _copy(start: Path, name: str) -> Path:
    return shutil.copytree(start, start.with_name(name))
