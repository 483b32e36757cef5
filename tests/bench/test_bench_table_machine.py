"""The simulated table controller: CiA 402 states, homing, moves, rejected commands and faults."""

import numpy as np
import pytest

from calstation.bench.table import Fault, OutOfRange, Power, TableLimits, TableMachine
from calstation.bench.table.machine import SETTLING_TIME, NotPermitted
from calstation.bench.truth import EncoderTruth, TableDrive

RATES, ACCELERATIONS = (0.5, 0.5), (1.0, 1.0)
PERFECT = EncoderTruth(0.0, 0.0, (0.0, 0.0), 0.0)


def machine(start=(0.0, 0.0), **changes):
    limits = TableLimits(low=(-2.0, -4.0), high=(2.0, 4.0))
    return TableMachine(TableDrive(PERFECT, start), limits, **changes)


def enabled(**changes):
    table = machine(**changes)
    for word in (0x06, 0x07, 0x0F):
        table.control(word, 0.0, 0.0)
    return table


def homed(**changes):
    table = enabled(**changes)
    table.home(0.0)
    table.advance(100.0)
    assert table.homed
    return table


def test_enabling_passes_through_ready_and_switched_on():
    table = machine()
    assert table.statusword(0.0) & 0x446F == 0x460
    table.control(0x0F, 0.0, 0.0)
    assert table.power is Power.DISABLED
    for word, shown in ((0x06, 0x21), (0x07, 0x23), (0x0F, 0x27)):
        table.control(word, 0.0, 0.0)
        assert table.statusword(0.0) & 0x6F == shown


def test_moves_require_an_enabled_and_homed_table():
    with pytest.raises(NotPermitted):
        machine().home(0.0)
    with pytest.raises(NotPermitted):
        enabled().move(0.0, (0.1, 0.1), RATES, ACCELERATIONS)


def test_homing_finds_zero_from_any_start_angle():
    table = enabled(start=(0.2, -0.1))
    assert table.positions(0.0) == pytest.approx([0.0, 0.0], abs=1e-12)
    table.home(0.0)
    table.advance(1.0)
    assert not table.homed
    table.advance(10.0)
    assert table.homed
    assert table.positions(10.0) == pytest.approx([0.0, 0.0], abs=1e-12)
    assert table.drive.states(10.0)[:, 0] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert np.abs(table.drive.states(1.0)[:, 1]).max() < 1.2 * table.limits.homing_rate


def test_statusword_shows_moving_and_then_target_reached():
    table = homed()
    table.move(100.0, (1.0, -1.0), RATES, ACCELERATIONS)
    assert table.statusword(101.0) & 0x4400 == 0x4000
    done = table.drive.settled + SETTLING_TIME
    assert table.statusword(done - 0.01) & 0x4400 == 0x4000
    assert table.statusword(done) & 0x5400 == 0x1400
    assert table.positions(done) == pytest.approx([1.0, -1.0], abs=1e-5)


@pytest.mark.parametrize(
    ("targets", "rates", "accelerations"),
    [
        ((2.1, 0.0), RATES, ACCELERATIONS),
        ((0.0, -4.1), RATES, ACCELERATIONS),
        ((1.0, 1.0), (0.5, 99.0), ACCELERATIONS),
        ((1.0, 1.0), (0.0, 0.5), ACCELERATIONS),
        ((1.0, 1.0), RATES, (99.0, 1.0)),
    ],
)
def test_commands_outside_the_limits_are_rejected(targets, rates, accelerations):
    table = homed()
    with pytest.raises(OutOfRange):
        table.move(100.0, targets, rates, accelerations)
    assert table.settled(100.0)


def test_second_move_is_rejected_while_moving():
    table = homed()
    table.move(100.0, (1.0, 1.0), RATES, ACCELERATIONS)
    with pytest.raises(NotPermitted):
        table.move(100.5, (0.0, 0.0), RATES, ACCELERATIONS)


def test_repeated_move_has_no_effect():
    table = homed()
    table.move(100.0, (1.0, 1.0), RATES, ACCELERATIONS)
    end = table.drive.end
    table.move(100.5, (1.0, 1.0), RATES, ACCELERATIONS)
    assert table.drive.end == end


def test_halt_and_stop_keep_the_drives_enabled_and_quick_stop_disables_them():
    for act, power in (
        (lambda t: t.stop(101.0), Power.ENABLED),
        (lambda t: t.control(0x10F, 101.0, 0.0), Power.ENABLED),
        (lambda t: t.control(0x0B, 101.0, 0.0), Power.DISABLED),
        (lambda t: t.control(0x00, 101.0, 0.0), Power.DISABLED),
    ):
        table = homed()
        table.move(100.0, (1.5, 3.0), RATES, ACCELERATIONS)
        act(table)
        assert table.drive.end == pytest.approx(101.0 + 0.5 / table.limits.acceleration)
        assert table.power is power


def test_halted_table_rejects_moves():
    table = homed()
    table.control(0x10F, 100.0, 0.0)
    with pytest.raises(NotPermitted):
        table.move(100.0, (1.0, 1.0), RATES, ACCELERATIONS)


def test_watchdog_trips_on_host_time_and_only_while_enabled():
    table = homed(watchdog=1.0)
    table.move(100.0, (1.5, 3.0), RATES, ACCELERATIONS)
    table.feed(10.0)
    table.watch(11.0, 101.0)
    assert table.fault is Fault.NONE
    table.watch(11.1, 101.0)
    assert table.fault is Fault.WATCHDOG
    assert table.statusword(101.0) & 0x6F == 0x28
    assert table.drive.end < 102.0
    idle = machine(watchdog=1.0)
    idle.watch(99.0, 0.0)
    assert idle.fault is Fault.NONE


@pytest.mark.parametrize(("rates", "reason"), [((0.5, 99.0), OutOfRange), ((0.5, -0.5), NotPermitted)])
def test_rejected_rate_command_starts_neither_joint(rates, reason):
    table = homed()
    if reason is NotPermitted:
        table.move_joint(100.0, 1, 3.0, 0.5, 1.0)
    before = table.drive.profiles[0]
    with pytest.raises(reason):
        table.turn(100.5, rates, ACCELERATIONS)
    assert table.drive.profiles[0] is before
    table.turn(200.0, (0.5, 0.0), ACCELERATIONS)
    assert table.drive.profiles[0].target == table.limits.high[0]


def test_watchdog_of_zero_is_disabled():
    table = homed(watchdog=0.0)
    table.watch(1e9, 100.0)
    assert table.fault is Fault.NONE


def test_open_interlock_stops_and_latches_and_reset_does_not_restart_motion():
    table = homed()
    table.move(100.0, (1.5, 3.0), RATES, ACCELERATIONS)
    table.set_interlock(False, 101.0)
    assert (table.fault, table.power) == (Fault.INTERLOCK, Power.DISABLED)
    table.advance(110.0)
    table.control(0x80, 110.0, 0.0)
    assert table.fault is Fault.INTERLOCK
    table.set_interlock(True, 110.0)
    assert table.fault is Fault.INTERLOCK
    table.control(0x00, 111.0, 0.0)
    table.control(0x80, 111.0, 0.0)
    assert table.fault is Fault.NONE
    assert table.power is Power.DISABLED
    assert table.settled(111.0)
    assert table.drive.end < 102.0


def test_first_fault_stays_latched():
    table = homed()
    table.trip(Fault.STALL, 100.0)
    table.trip(Fault.DRIVE, 100.0)
    assert table.fault is Fault.STALL
