"""A unit is restarted only after its commit is complete, and a restart is accepted only on evidence."""

import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager

import pytest
from rtu_server import RtuServer
from test_late_answers import pageless

from calstation.devices.imu import RegisterMap, transfer
from calstation.devices.imu.drivers.modbus import ModbusImu
from calstation.devices.imu.registered_imu import marker_entry, marker_numbers
from calstation.devices.links import SerialLink
from calstation.devices.profiles import RegisterEntry
from calstation.errors import DeviceFaultError
from tests.devices.test_transfer import FakeEntry
from tests.helpers import raises_code

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on Windows")

MODEL, SERIAL, STREAM, COMMIT, RESET = 0, 8, 20, 21, 22
UNIT = "SN-1"


class FlashUnit(RtuServer):
    """RAM and flash; a commit takes `burns` s or never ends (None); a reset follows its reply after `delay` s or never.

    While it writes its flash it reports busy; a reset during that time leaves neither old nor new values.
    """

    def __init__(self, burns: float | None = 0.0, delay: float | None = 0.0) -> None:
        self.burns, self.delay = burns, delay
        self.hurt = False
        self._burnt = self._due = None
        self.flash: dict[int, int] = dict.fromkeys(range(200), 0)
        for address, text in ((MODEL, "bench-dsp"), (SERIAL, UNIT), (16, "2")):
            padded = text.encode().ljust(16, b"\0")
            self.flash |= {address + i: int.from_bytes(padded[2 * i : 2 * i + 2], "big") for i in range(4)}
            if address != 16:
                self.flash |= {address + i: int.from_bytes(padded[2 * i : 2 * i + 2], "big") for i in range(4, 8)}
        super().__init__(words=self.flash)

    def store(self, function: int, address: int, values: Iterable[int]) -> int:
        self._live()
        if address == COMMIT:
            self._burnt = None if self.burns is None else time.monotonic() + self.burns
        elif address == RESET:
            if self._burnt is not None:
                self.hurt, self._burnt = True, None
            self._due = None if self.delay is None else time.monotonic() + self.delay
        elif address != STREAM:
            return super().store(function, address, values)
        return 0

    def value_of(self, address: int) -> int | None:
        self._live()
        if address == COMMIT:
            return None if self._burnt is not None else 0
        return super().value_of(address)

    def _live(self) -> None:
        now = time.monotonic()
        if self._burnt is not None and now >= self._burnt:
            self.flash, self._burnt = dict(self.words), None
        if self._due is not None and now >= self._due:
            self.words, self._due = dict(self.flash), None


@contextmanager
def driver(unit: FlashUnit, **section: float) -> Iterator[ModbusImu]:
    profile = pageless()
    assert profile.modbus is not None
    profile = profile.model_copy(update={"modbus": profile.modbus.model_copy(update=section)})
    imu = ModbusImu(SerialLink(unit.port, profile.link, "imu"), profile)
    try:
        yield imu
    finally:
        imu.close()
        unit.close()


def moved(imu: ModbusImu, transfer_entry: FakeEntry, value: float = 0.5) -> Mapping[str, float]:
    registers = RegisterMap(tuple(pageless().registers))
    return transfer(imu, registers, UNIT, {"gyro_bias_x": value}, transfer_entry.begin).registers_read


@pytest.mark.long
@pytest.mark.parametrize("delay", [0.0, 0.4])
def test_committed_registers_are_read_back_after_the_restart(delay: float) -> None:
    unit, transfer_entry = FlashUnit(delay=delay), FakeEntry(serial=UNIT)
    with driver(unit) as imu:
        assert moved(imu, transfer_entry)["gyro_bias_x"] == 0.5
    assert transfer_entry.steps[-1] == "restarted"
    assert transfer_entry.closing is None


@pytest.mark.long
@pytest.mark.parametrize("delay", [0.0, 0.4])
def test_uncommitted_registers_are_not_taken_as_evidence_of_a_restart(delay: float) -> None:
    unit, transfer_entry = FlashUnit(burns=None, delay=delay), FakeEntry(serial=UNIT)
    with driver(unit) as imu, raises_code(DeviceFaultError, "imu.holds_old"):
        moved(imu, transfer_entry)
    assert "restarted" not in transfer_entry.steps
    assert transfer_entry.closing == "kept"


def test_unit_that_never_restarts_is_reported_before_any_write() -> None:
    unit, transfer_entry = FlashUnit(delay=None), FakeEntry(serial=UNIT)
    with driver(unit, reset_timeout_s=0.3) as imu, raises_code(DeviceFaultError, "imu.not_restarted"):
        moved(imu, transfer_entry)
    assert transfer_entry.steps == []
    assert unit.words == unit.flash, "the mark was taken back"


@pytest.mark.long
def test_a_unit_is_not_restarted_during_a_long_commit() -> None:
    unit, transfer_entry = FlashUnit(burns=0.5), FakeEntry(serial=UNIT)
    with driver(unit) as imu:
        assert moved(imu, transfer_entry)["gyro_bias_x"] == 0.5
    assert not unit.hurt


def test_a_unit_whose_commit_exceeds_its_timeout_is_not_restarted() -> None:
    unit, transfer_entry = FlashUnit(burns=3600.0), FakeEntry(serial=UNIT)
    with driver(unit, commit_timeout_s=0.4) as imu, raises_code(DeviceFaultError, "imu.holds_unknown"):
        moved(imu, transfer_entry)
    commit = unit.requests.index((6, COMMIT, 0x5A5A))
    assert {request[0] for request in unit.requests[commit + 1 :]} == {3}, "neither written nor restarted"
    assert (transfer_entry.steps[-1], transfer_entry.closing) == ("committing", None)


@pytest.mark.long
def test_a_unit_busy_with_another_commit_is_not_restarted() -> None:
    unit, transfer_entry = FlashUnit(burns=0.5), FakeEntry(serial=UNIT)
    unit.store(6, COMMIT, [0x5A5A])
    with driver(unit) as imu:
        moved(imu, transfer_entry)
    assert not unit.hurt
    assert transfer_entry.steps[-1] == "restarted"


def entry(*parameters: str, **more: object) -> RegisterEntry:
    convention = {"matrix": "correction", "identity": True, "offset": "before"}
    slots = any("matrix" in name or "offset" in name for name in parameters)
    return RegisterEntry.model_validate(
        {"address": 0, "parameters": list(parameters), "range": [-0.1, 0.1], **more}
        | ({"convention": convention} if slots else {})
    )


def test_marker_avoids_matrix_elements_if_possible() -> None:
    matrix, bias = entry("gyro_matrix"), entry("gyro_bias")
    assert marker_entry([matrix, bias]) is bias
    assert marker_entry([matrix]) is matrix
    assert marker_entry([]) is None
    whole = entry("gyro_matrix", "gyro_offset")
    before = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    assert marker_numbers(whole, before)[:9] == before[:9]
    assert marker_numbers(matrix, before[:9])[:8] == before[:8]
    assert 0.0 not in marker_numbers(whole, before)[9:]


@pytest.mark.parametrize("kind", ["i16", "f32", "f64", "q2.30"])
@pytest.mark.parametrize("before", [float("nan"), 0.0, -0.1 + 0.2 * 0.381966, 0.0236068])
def test_marker_is_within_its_range_and_differs_from_the_current_value(kind: str, before: float) -> None:
    scale = 1e-5 if kind == "i16" else 1.0
    register = entry("gyro_bias", type=kind, scale=scale)
    numbers = marker_numbers(register, [before / scale if kind == "i16" and before == before else before] * 3)
    assert all(-0.1 < v * scale < 0.1 for v in numbers)
    assert all(abs(v * scale - before) > 0.02 for v in numbers) or before != before
