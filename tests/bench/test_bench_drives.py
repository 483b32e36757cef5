"""Two CiA 402 drives, described only by a profile, with floats, the low word first, a negative scale, no watchdog."""

import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from calstation.bench.table import Clocks, Fault, OutOfRange, TableLimits, TableMachine, drives
from calstation.bench.table.machine import NotPermitted
from calstation.bench.truth import EncoderTruth, TableDrive
from calstation.devices.profiles import load_table_profile
from calstation.devices.table import ModbusTable, RegisterTable
from calstation.errors import ConfigurationError, DeviceFaultError
from tests.helpers import raises_code

PROFILE = load_table_profile(Path(__file__).parents[2] / "data" / "tables" / "cia402_drives.toml")


class Pair:
    """Both drives of an error-free simulated table."""

    def __init__(self, start=(0.0, 0.0)):
        limits = TableLimits(low=(-20.0, -20.0), high=(20.0, 20.0))
        self.machine = TableMachine(TableDrive(EncoderTruth(0.0, 0.0, (0.0, 0.0), 0.0), start), limits)
        self.time = 0.0
        clocks = Clocks(*[lambda: self.time] * 3)
        self.drives = list(drives(self.machine, clocks, "T-").values())

    def pass_time(self, seconds):
        self.time += seconds
        self.machine.advance(self.time)


class Unit:
    """In-memory link of one drive; `unplugged` simulates a disconnected cable."""

    def __init__(self, drive):
        self.drive, self.unplugged, self.writes = drive, False, []

    def read(self, address, count):
        if self.unplugged:
            raise DeviceFaultError("link.lost", device="table", port="memory", reason="no power")
        self.drive.refresh()
        return self.drive.words[address : address + count]

    def write(self, address, values, repeat=True):
        if self.unplugged:
            raise DeviceFaultError("link.lost", device="table", port="memory", reason="no power")
        self.writes.append((address, list(values), repeat))
        self.drive.write(address, values)


class Line:
    """In-memory link of a register table with both drives."""

    def __init__(self, units):
        self.units = dict(zip((None, PROFILE.modbus.inner_unit), units, strict=True))

    def read(self, address, count, unit=None):
        return self.units[unit].read(address, count)

    def write(self, address, values, repeat=True, unit=None):
        self.units[unit].write(address, values, repeat)


@pytest.fixture
def pair():
    drives = Pair()
    drives.units = [Unit(drive) for drive in drives.drives]
    drives.table = RegisterTable(Line(drives.units), PROFILE)
    return drives


def ready(pair):
    pair.table.enable()
    pair.table.home()
    pair.pass_time(5.0)
    return pair.table


def test_registers_written_for_a_move_and_a_rate_match_the_profile(pair):
    table = ready(pair)
    for unit in pair.units:
        unit.writes.clear()
    table.move(*np.deg2rad([-90.0, 100.0, 20.0, 40.0]))

    def low_first(kind, *values):
        return [w for v in values for w in struct.unpack(">HH", struct.pack(kind, v))[::-1]]

    def targets(counts):
        return low_first(">i", counts) + low_first(">I", 200_000, 400_000)

    begin = [(23, [1], True), (20, [0x0F], True), (20, [0x3F], True)]
    assert pair.units[0].writes == [(34, targets(-9_000_000), True), *begin]
    assert pair.units[1].writes == [(34, targets(-10_000_000), True), *begin], "its counts fall"
    pair.pass_time(30.0)
    np.testing.assert_allclose(table.status().angles, np.deg2rad([-90.0, 100.0]), atol=1e-6)


def test_status_combines_both_drives(pair):
    table = pair.table
    identity = table.identify()
    assert identity.model == "bench-drive"
    assert identity.serial == "T-A + T-B"
    assert not table.status().enabled
    table.enable()
    status = table.status()
    assert status.enabled
    assert not status.homed
    assert status.interlock_closed
    assert status.watchdog == np.inf
    np.testing.assert_allclose(status.limits.low, [-20.0, -20.0])
    np.testing.assert_allclose(status.limits.high, [20.0, 20.0])
    pair.units[1].drive.write(20, [0x06])
    assert not table.status().enabled, "one axis is off"


def test_homing_is_commanded_once_and_motion_is_detected_without_a_motion_bit(pair):
    table = ready(pair)
    assert [repeat for address, _, repeat in pair.units[0].writes if address == 23] == [False]
    assert table.status().homed
    table.move(*np.deg2rad([10.0, 0.0, 20.0, 40.0]))
    pair.pass_time(0.2)
    status = table.status()
    assert status.moving
    assert not status.settled
    assert status.rates[0] > 0.0


def test_stop_is_sent_to_the_drive_that_still_responds(pair):
    table = ready(pair)
    table.move(*np.deg2rad([300.0, 300.0, 20.0, 40.0]))
    pair.pass_time(2.0)
    pair.units[0].unplugged = True
    with raises_code(DeviceFaultError, "link.lost"):
        table.stop()
    assert (40, [0, 0], True) in pair.units[1].writes
    pair.units[0].unplugged = False
    pair.pass_time(2.0)
    assert not table.status().moving


def test_table_stays_stopped_until_the_next_command(pair):
    table = ready(pair)
    table.move(*np.deg2rad([300.0, 0.0, 20.0, 40.0]))
    pair.pass_time(2.0)
    table.stop()
    pair.pass_time(2.0)
    stood = table.status().angles
    table.enable()
    pair.pass_time(5.0)
    np.testing.assert_array_equal(table.status().angles, stood)


def test_continuous_rotation_requires_a_stop_time_on_link_loss_in_the_profile(pair):
    table = ready(pair)
    with raises_code(ConfigurationError, "table.would_not_stop"):
        table.rate(0.1, 0.0, 0.5)
    stated = PROFILE.model_copy(update={"link_loss_stop_s": 1.0})
    table = RegisterTable(Line(pair.units), stated)
    table.rate(*np.deg2rad([0.0, -15.0, 40.0]))
    pair.pass_time(3.0)
    np.testing.assert_allclose(table.status().rates, np.deg2rad([0.0, -15.0]), atol=1e-6)
    table.heartbeat()  # there is no watchdog, so nothing is sent


def test_fault_is_reported_and_cleared_on_both_drives(pair):
    table = ready(pair)
    pair.machine.trip(Fault.DRIVE, pair.time)
    assert table.status().fault == "drive"
    pair.pass_time(1.0)
    table.reset_fault()
    status = table.status()
    assert status.fault is None
    assert not status.enabled


def test_nan_in_a_register_is_a_fault(pair):
    def refresh():
        pair.drives[0].words[32:34] = [0, 0x7FC0]

    pair.drives[0].refresh = refresh
    with raises_code(DeviceFaultError, "table.register_not_a_number") as caught:
        pair.table.status()
    assert caught.value.values == {"name": "outer_rate", "addresses": "32-33"}


def test_rejected_command_changes_nothing():
    pair = Pair()
    outer, inner = pair.drives
    for drive in (outer, inner):
        drive.write(20, [0x0F])
    with pytest.raises(NotPermitted):
        outer.write(20, [0x1F])  # not homed yet
    pair.machine.set_zero()
    outer.write(20, [0x0F])
    outer.write(34, [0xFFFF, 0x7FFF])
    with pytest.raises(OutOfRange):
        outer.write(20, [0x1F])
    assert pair.machine.drive.profiles[0].target == 0.0


@pytest.mark.parametrize(
    "transport",
    [
        "tcp",
        pytest.param("rtu", marks=pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals")),
    ],
)
def test_each_drive_has_its_own_modbus_unit_number(start_bench, transport):
    settings = {"table_protocol": "drives", "table_transport": transport, "start_deg": [2.0, -1.0], "speed": 0.0}
    with start_bench(**settings) as bench:
        port = bench.endpoints["table"] if transport == "rtu" else f"tcp://{bench.endpoints['table']}"
        table = ModbusTable(port, PROFILE.at_station(2.0, None))
        try:
            assert table.identify().serial == "T-0001A + T-0001B"
            table.enable()
            table.home()
            bench.advance(10.0)
            assert table.status().homed
            table.move(*np.deg2rad([30.0, -40.0, 20.0, 40.0]))
            bench.advance(10.0)
            status = table.status()
            np.testing.assert_allclose(status.angles, np.deg2rad([30.0, -40.0]), atol=np.deg2rad(0.3))
            assert status.settled
            assert not status.moving
            table.disable()
            assert not table.status().enabled
        finally:
            table.close()
