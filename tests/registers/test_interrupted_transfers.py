"""Recovery of interrupted transfers by a run, the job queue and the command line, on a unit with persistent flash."""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calstation.cli.app import run_app
from calstation.config import load_configuration
from calstation.connection import open_imu_session
from calstation.devices.imu import RegisterMap, transfer
from calstation.errors import DeviceFaultError, InputError
from calstation.registers import UnitRegisters, read_unit
from calstation.registers import journal as register_journal
from calstation.runs import execute
from calstation.sequencer import Command, Control, Event, Fault, Finalized, Message, StageStarted, StepStarted
from tests.helpers import ignore_progress, raises_code
from tests.registers.operations import RegisterOperations
from tests.site_folder import SiteFolder

pytestmark = pytest.mark.long

SERIAL = "SN-000042"
VALUES = {"gyro_bias_x": 2e-6, "accel_scale_y": 3e-4}


class Workbench:
    """A site whose unit has persistent flash, and on which a transfer can be interrupted."""

    def __init__(self, site_folder: SiteFolder) -> None:
        self.site_folder = site_folder
        self.runs = site_folder.folder / "runs"
        self.request = site_folder.request("six_position")
        self.operations = RegisterOperations(site_folder.request())
        self.write_station()

    def write_station(self, **bench: Any) -> None:
        self.site_folder.write(flash_file=str(self.site_folder.folder / "flash.bin"), **bench)

    def interrupt(self, *, committed: bool, values: Mapping[str, float] = VALUES) -> register_journal.Transfer:
        """Simulate a transfer during which the station lost power, before or after the commit."""
        setup = load_configuration(self.request)

        def begin(old: Any, new: Any) -> register_journal.Transfer:
            return register_journal.begin(self.runs, SERIAL, old, new, register_journal.Purpose("li", "run", "a.h5"))

        class PowerFailure(BaseException):
            pass

        with open_imu_session(ignore_progress, setup) as unit:
            commit = unit.imu.commit

            def cut() -> None:
                if committed:
                    commit()
                raise PowerFailure

            unit.imu.commit = cut  # type: ignore[method-assign]
            with pytest.raises(PowerFailure):
                transfer(unit.imu, RegisterMap(tuple(setup.imu.registers)), SERIAL, values, begin)
        entry = register_journal.interrupted(self.runs, SERIAL)
        assert entry is not None
        return entry

    def register_values(self) -> dict[str, float]:
        return read_unit(ignore_progress, self.request, self.runs).values

    def run(self, **changes: Any) -> list[Event]:
        events: list[Event] = []
        execute(replace(self.request, **changes), events.append, Control())
        return events


@pytest.fixture
def bench(site_folder: SiteFolder) -> Workbench:
    return Workbench(site_folder)


def message_values(events: list[Event], ident: str) -> list[Any]:
    return [event.values for event in events if isinstance(event, Message) and event.id == ident]


def test_unit_with_unchanged_registers_is_calibrated_normally(bench: Workbench) -> None:
    bench.interrupt(committed=False)
    events = bench.run()
    assert message_values(events, "transfer_kept")[0]["holds"] == "old"
    assert isinstance(events[-1], Finalized)
    assert events[-1].verdict.passed
    first, second = register_journal.history(bench.runs, SERIAL)
    assert (first.closing, second.closing) == ("kept", "done")


def test_unverified_registers_block_a_run_until_a_decision(bench: Workbench) -> None:
    bench.interrupt(committed=True)
    events = bench.run()
    (offer,) = message_values(events, "transfer_open")
    assert (offer["holds"], offer["offers"], offer["serial"]) == ("new", ["finish", "restore"], SERIAL)
    (fault,) = [event for event in events if isinstance(event, Fault)]
    assert fault.code == "transfer.interrupted"
    assert isinstance(events[-1], Finalized)
    assert events[-1].verdict == "fault"
    with raises_code(DeviceFaultError, "transfer.interrupted"):
        bench.operations.write(VALUES)
    assert bench.operations.moves() == []
    assert register_journal.interrupted(bench.runs, SERIAL) is not None

    events = bench.run(unfinished="restore")
    assert message_values(events, "transfer_settled")[0]["closing"] == "restored"
    assert isinstance(events[-1], Finalized)
    assert events[-1].verdict.passed


@pytest.mark.parametrize(("choice", "committed"), [("finish", False), ("restore", True)])
def test_interrupted_transfer_is_finished_or_restored_without_a_run(
    bench: Workbench, committed: bool, choice: str
) -> None:
    entry = bench.interrupt(committed=committed)
    if choice == "finish":
        settled = bench.operations.do("finish")
        assert settled.closing == "done"
    else:
        settled = bench.operations.do("restore")
        assert settled.closing == "restored"
    assert settled.proof == "turn"
    assert UnitRegisters.of(settled.unit).values == dict(entry.new if choice == "finish" else entry.old)
    assert register_journal.interrupted(bench.runs, SERIAL) is None
    assert register_journal.cycles(bench.runs, SERIAL) == 2
    with raises_code(InputError, "transfer.nothing_to_finish"):
        bench.operations.do("finish")


def test_finished_registers_are_verified_before_the_first_stage_of_a_run(bench: Workbench) -> None:
    bench.interrupt(committed=True)
    events = bench.run(unfinished="finish")
    assert isinstance(events[-1], Finalized)
    assert events[-1].verdict.passed
    assert message_values(events, "transfer_settled")[0]["closing"] == "done"
    begun = [i for i, event in enumerate(events) if isinstance(event, StageStarted)]
    turns = [i for i, e in enumerate(events) if isinstance(e, StepStarted) and e.label in (("verify",), ("reference",))]
    assert sum(i < begun[0] for i in turns) == 11, "two revolutions, then the load position"
    assert turns[-1] > begun[-1], "and again after the stages"
    first, second = register_journal.history(bench.runs, SERIAL)
    assert (first.closing, first.steps[-1]) == (second.closing, second.steps[-1]) == ("done", "turned")


def test_registers_that_fail_verification_are_restored_and_the_run_ends(bench: Workbench) -> None:
    entry = bench.interrupt(committed=True, values={"gyro_scale_x": 0.05})
    events = bench.run(unfinished="finish")
    (fault,) = [event for event in events if isinstance(event, Fault)]
    assert fault.code == "verification.wrong"
    assert not [event for event in events if isinstance(event, StageStarted)]
    assert bench.register_values() == dict(entry.old)
    (closed,) = register_journal.history(bench.runs, SERIAL)
    assert closed.closing == "restored"


def test_run_does_not_finish_a_transfer_if_the_table_may_not_move(bench: Workbench) -> None:
    bench.interrupt(committed=True)
    bench.write_station(interlock_closed=False)
    events = bench.run(unfinished="finish")
    (fault,) = [event for event in events if isinstance(event, Fault)]
    assert "interlock" in fault.text
    assert register_journal.cycles(bench.runs, SERIAL) == 1
    assert register_journal.interrupted(bench.runs, SERIAL) is not None


def test_run_stopped_before_verification_reports_an_unverified_transfer(bench: Workbench) -> None:
    bench.interrupt(committed=True)
    control = Control()
    events: list[Event] = []

    def emit(event: Event) -> None:
        events.append(event)
        if isinstance(event, Message) and event.id == "homing":
            control.send(Command.STOP)

    execute(replace(bench.request, unfinished="finish"), emit, control)
    assert isinstance(events[-1], Finalized)
    assert events[-1].verdict == "stopped"
    assert len(message_values(events, "transfer_unproved")) == 1
    assert register_journal.interrupted(bench.runs, SERIAL) is not None


def test_any_earlier_register_set_can_be_restored(bench: Workbench) -> None:
    for value in (1e-6, 2e-6):
        bench.operations.write({"gyro_bias_x": value}, at_rest=True)
    known = register_journal.history(bench.runs, SERIAL)
    settled = bench.operations.do("restore", transfer=known[1].id)
    assert (settled.closing, settled.proof) == ("done", "turn")
    assert bench.register_values()["gyro_bias_x"] == np.float32(1e-6)
    assert [t.why for t in register_journal.history(bench.runs, SERIAL)] == ["hand", "hand", "restore"]
    with raises_code(InputError, "transfer.unknown_id"):
        bench.operations.do("restore", transfer="x")
    with raises_code(InputError, "transfer.none_known_here"):
        RegisterOperations(replace(bench.request, serial="SN-000007")).do("restore")


@pytest.mark.parametrize("at_rest", [False, True])
def test_registers_that_give_wrong_output_are_restored(bench: Workbench, at_rest: bool) -> None:
    before = bench.register_values()
    with raises_code(DeviceFaultError, "verification.wrong"):
        bench.operations.write({"accel_scale_z": 0.05}, at_rest=at_rest)
    assert bench.register_values() == before
    (entry,) = register_journal.history(bench.runs, SERIAL)
    assert entry.closing == "restored"
    assert "refuted" in entry.steps


def test_command_line_lists_finishes_and_restores_transfers(
    bench: Workbench, capsys: pytest.CaptureFixture[str]
) -> None:
    entry = bench.interrupt(committed=True)
    files = [
        "--out",
        str(bench.runs),
        "--station",
        str(bench.site_folder.station),
        "--product",
        str(bench.site_folder.product),
    ]

    def run(*words: str) -> tuple[int, Callable[[], str]]:
        code = run_app(["registers", *words])
        output = capsys.readouterr()
        return code, lambda: output.out + output.err

    code, text = run("list", "--out", str(bench.runs))
    assert code == 0
    assert "OPEN" in text()
    assert "1 flash cycle" in text()
    assert f"  {register_journal.history(bench.runs, SERIAL)[0].id}  OPEN" in text()
    assert run_app(["registers", "finish", SERIAL, *files, "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["registers"] == dict(entry.new)
    code, text = run("restore", SERIAL, *files)
    assert (code, bench.register_values()) == (0, dict(entry.old))
    code, text = run("finish", SERIAL, *files)
    assert code == 2
    assert "nothing to finish" in text()
    code, text = run("list", SERIAL, "--out", str(bench.runs), "--json", "-")
    listed = json.loads(text())[SERIAL]["virtual"]
    assert [t["closing"] for t in listed["transfers"]] == ["done", "done"]
    assert listed["flash_cycles"] == 2
