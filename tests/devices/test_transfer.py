"""Register transfers step by step, on a simulated unit and on faulty units."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from calstation.devices import ImuIdentity, LinkStats, SampleBatch
from calstation.devices.imu import (
    FlashContent,
    TransferOutcome,
    TransferStep,
    finish,
    read_flash_content,
    restore,
    transfer,
)
from calstation.errors import ConfigurationError, DeviceFaultError
from tests.devices.powered_unit import MAP, NAMES, SERIAL, Unit
from tests.helpers import raises_code

OLD = float(np.float32(0.001))


@dataclass
class FakeEntry:
    """An in-memory journal entry; `full_at` is the step at which the disk is full."""

    old: Mapping[str, float] = field(default_factory=dict)
    new: Mapping[str, float] = field(default_factory=dict)
    serial: str = SERIAL
    full_at: str = ""
    steps: list[str] = field(default_factory=list)
    closing: str | None = None

    def note(self, step: TransferStep) -> None:
        if step == self.full_at:
            raise ConfigurationError("configuration.unwritable", file="journal", reason="disk full")
        self.steps.append(step)

    def close(self, closing: TransferOutcome) -> None:
        self.closing = closing

    def begin(self, old: Mapping[str, float], new: Mapping[str, float]) -> "FakeEntry":
        self.old, self.new = old, new
        return self


class RegisterUnit:
    """RAM and flash registers; `ignores_writes` and `loses` name a register that ignores writes or loses a commit."""

    def __init__(self, ignores_writes: str = "", loses: str = "", serial: str = SERIAL) -> None:
        self.ignores_writes, self.loses, self.serial = ignores_writes, loses, serial
        self.ram = dict.fromkeys(NAMES, OLD)
        self.flash = dict(self.ram)
        self.calls: list[str] = []
        self.cut = False

    stats = LinkStats()

    def start(self) -> None: ...

    def close(self) -> None: ...

    def read(self) -> SampleBatch:
        raise NotImplementedError

    def identify(self) -> ImuIdentity:
        return ImuIdentity("m", self.serial, "f")

    def read_registers(self) -> dict[str, float]:
        self._alive("read")
        return dict(self.ram)

    def write_registers(self, values: Mapping[str, float]) -> None:
        self._alive("write")
        self.ram.update({k: v for k, v in values.items() if k != self.ignores_writes})

    def commit(self) -> None:
        self._alive("commit")
        self.flash = {**self.ram, **({self.loses: 0.0} if self.loses else {})}

    def reset(self) -> None:
        self._alive("reset")
        self.ram = dict(self.flash)

    def _alive(self, call: str) -> None:
        if self.cut:
            raise DeviceFaultError("link.lost", device="imu", port="memory", reason="no power")
        self.calls.append(call)


def test_transfer_follows_its_steps_and_stays_open_until_verified() -> None:
    unit, entry = RegisterUnit(), FakeEntry()
    done = transfer(unit, MAP, SERIAL, {"gyro_bias_x": 1.23456789e-6, "outer_lever_x": 9.0}, entry.begin)
    assert unit.calls == ["reset", "read", "write", "read", "commit", "reset", "read"]
    assert entry.steps == ["written", "committing", "committed", "restarted"]
    assert entry.closing is None
    assert done.registers_read == entry.new
    assert done.registers_read["gyro_bias_x"] == float(np.float32(1.23456789e-6))
    assert done.registers_read["gyro_bias_y"] == entry.old["gyro_bias_y"] == OLD
    assert "outer_lever_x" not in done.registers_read


def test_different_unit_is_not_accessed() -> None:
    unit = RegisterUnit(serial="SN-7")
    with raises_code(DeviceFaultError, "imu.other_unit"):
        transfer(unit, MAP, SERIAL, {"gyro_bias_x": 0.0}, FakeEntry().begin)
    with raises_code(DeviceFaultError, "imu.other_unit"):
        read_flash_content(unit, FakeEntry(), MAP)
    assert unit.calls == []


def test_uncommitted_values_do_not_count_as_old_registers() -> None:
    unit, entry = RegisterUnit(), FakeEntry()
    unit.ram["gyro_bias_y"] = 0.5
    transfer(unit, MAP, SERIAL, {"gyro_bias_x": 1e-5}, entry.begin)
    assert entry.old == dict.fromkeys(NAMES, OLD)
    assert unit.flash["gyro_bias_y"] == OLD


def test_nothing_is_written_if_a_value_is_out_of_range() -> None:
    unit = RegisterUnit()
    with raises_code(DeviceFaultError, "imu.value_beyond_register"):
        transfer(unit, MAP, SERIAL, {"gyro_bias_x": 5.0}, FakeEntry().begin)
    assert unit.calls == ["reset", "read"]


def test_failed_read_back_is_not_committed_and_the_unit_is_restarted() -> None:
    unit, entry = RegisterUnit(ignores_writes="accel_bias_z"), FakeEntry()
    with raises_code(DeviceFaultError, "imu.holds_old") as caught:
        transfer(unit, MAP, SERIAL, {"accel_bias_z": 0.01, "accel_bias_x": 0.2}, entry.begin)
    cause = caught.value.values["cause"]
    assert (cause.code, caught.value.values["serial"]) == ("imu.reads_back_differently", SERIAL)
    found = {"name": "accel_bias_z", "found": OLD, "wanted": entry.new["accel_bias_z"]}
    assert found.items() <= cause.values.items()
    assert "commit" not in unit.calls
    assert unit.ram == unit.flash == entry.old
    assert entry.closing == "kept"


def test_transfer_stays_open_if_a_register_is_lost_from_flash() -> None:
    unit, entry = RegisterUnit(loses="gyro_bias_y"), FakeEntry()
    with raises_code(DeviceFaultError, "imu.holds_neither") as caught:
        transfer(unit, MAP, SERIAL, {"gyro_bias_y": 0.01}, entry.begin)
    assert caught.value.values["cause"].code == "imu.restarted_differently"
    assert entry.closing is None
    assert read_flash_content(unit, entry, MAP) is FlashContent.NEITHER
    unit.loses = ""
    entry.steps.clear()
    assert restore(unit, MAP, entry) == entry.old == unit.flash
    assert entry.steps == ["restoring", "written", "committing", "committed", "restarted"]
    assert entry.closing == "restored"


@pytest.mark.parametrize("step", ["written", "committing"])
def test_nothing_is_committed_if_the_journal_cannot_be_written(step: str) -> None:
    unit, entry = RegisterUnit(), FakeEntry(full_at=step)
    with raises_code(ConfigurationError, "imu.holds_old"):
        transfer(unit, MAP, SERIAL, {"gyro_bias_x": 0.01}, entry.begin)
    assert "commit" not in unit.calls
    assert unit.ram == entry.old


def test_transfer_stays_open_if_the_link_is_lost_during_the_commit() -> None:
    unit, entry = RegisterUnit(), FakeEntry()
    commit = unit.commit

    def commit_and_lose() -> None:
        commit()
        unit.cut = True
        raise DeviceFaultError("link.lost", device="imu", port="memory", reason="no power")

    unit.commit = commit_and_lose  # type: ignore[method-assign]
    with raises_code(DeviceFaultError, "imu.holds_unknown"):
        transfer(unit, MAP, SERIAL, {"gyro_bias_x": 0.01}, entry.begin)
    assert entry.steps[-1] == "committing"
    assert entry.closing is None
    unit.cut = False
    unit.calls.clear()
    assert finish(unit, MAP, entry).registers_read == entry.new
    assert "commit" not in unit.calls, "its flash held the new values already: no second cycle"
    assert entry.steps[-1] == "restarted"


def test_restoring_unchanged_registers_uses_no_flash_cycle() -> None:
    unit, entry = RegisterUnit(), FakeEntry(old=dict.fromkeys(NAMES, OLD), new=dict.fromkeys(NAMES, 0.5))
    assert restore(unit, MAP, entry) == entry.old
    assert unit.calls == ["reset", "read"]
    assert entry.closing == "kept"


@pytest.mark.parametrize("moment", [0, 64, 127])
def test_brown_out_during_the_commit_is_reported_and_keeps_old_values(tmp_path: Path, moment: int) -> None:
    unit, entry = Unit(tmp_path / "flash.bin"), FakeEntry()
    with unit.powered(timeout_s=0.2) as imu:
        unit.unit.commit_power_cut = moment
        with raises_code(DeviceFaultError, "imu.holds_old"):
            transfer(imu, MAP, SERIAL, {"gyro_bias_x": 1e-5, "accel_bias_z": 0.02}, entry.begin)
    assert entry.closing == "kept"
    assert unit.flash == entry.old


def test_brown_out_between_two_writes_is_detected_by_the_read_back(tmp_path: Path) -> None:
    unit, entry = Unit(tmp_path / "flash.bin"), FakeEntry()
    with unit.powered(timeout_s=0.2) as imu:
        unit.unit.write_power_cut = 31  # after the marker and the first entry
        with raises_code(DeviceFaultError, "imu.holds_old"):
            transfer(imu, MAP, SERIAL, {"gyro_bias_x": 1e-5, "accel_bias_z": 0.02}, entry.begin)
    assert (unit.cycles, entry.closing) == (0, "kept")


def test_brown_out_during_the_first_write_is_recovered_by_a_repeat(tmp_path: Path) -> None:
    unit, entry = Unit(tmp_path / "flash.bin"), FakeEntry()
    with unit.powered(timeout_s=0.2) as imu:
        unit.unit.write_power_cut = 0
        transfer(imu, MAP, SERIAL, {"gyro_bias_x": 1e-5}, entry.begin)
    assert unit.flash == entry.new


def test_brown_out_after_the_commit_leaves_new_values_to_verify(tmp_path: Path) -> None:
    unit, entry = Unit(tmp_path / "flash.bin"), FakeEntry()
    with unit.powered(timeout_s=0.2) as imu:
        unit.unit.commit_power_cut = 128
        with raises_code(DeviceFaultError, "imu.holds_new"):
            transfer(imu, MAP, SERIAL, {"gyro_bias_x": 1e-5}, entry.begin)
        assert entry.closing is None
        assert read_flash_content(imu, entry, MAP) is FlashContent.NEW


def test_unit_without_a_spare_flash_bank_can_be_recovered(tmp_path: Path) -> None:
    unit = Unit(tmp_path / "flash.bin", banks=1)
    with unit.powered() as imu:
        transfer(imu, MAP, SERIAL, {"gyro_bias_x": 1e-5}, FakeEntry().begin)
    for mend in ("finish", "restore"):
        entry = FakeEntry()
        with unit.powered(timeout_s=0.2) as imu:
            unit.unit.commit_power_cut = 60
            with raises_code(DeviceFaultError, "imu.holds_neither"):
                transfer(imu, MAP, SERIAL, {"gyro_bias_x": 2e-5}, entry.begin)
        with unit.powered() as imu:
            assert read_flash_content(imu, entry, MAP) is FlashContent.NEITHER
            if mend == "finish":
                finish(imu, MAP, entry)
                assert unit.flash == entry.new
            else:
                restore(imu, MAP, entry)
                assert unit.flash == entry.old
