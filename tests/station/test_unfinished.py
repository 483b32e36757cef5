"""Interrupted transfers at the next start: run, workshop and command line, on a unit that keeps its flash."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calstation.cli.app import run_app
from calstation.devices.registers import RegisterMap
from calstation.devices.transfer import transfer
from calstation.errors import DeviceFaultError, InputError
from calstation.sequencer.control import Control
from calstation.sequencer.events import Event, Fault, Message, Verdict
from calstation.station import register_journal
from calstation.station.hand_registers import read_unit, write_unit
from calstation.station.run import execute
from calstation.station.setup import configured
from calstation.station.unfinished import finish_transfer, restore_registers
from calstation.station.unit_alone import unit_alone
from tests.station.conftest import Place

pytestmark = pytest.mark.long

SERIAL = "SN-000042"
VALUES = {"gyro_bias_x": 2e-6, "accel_scale_y": 3e-4}


def tell(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
    """Progress that nobody watches."""


class Workbench:
    """A place whose unit keeps its flash, and a transfer to it that can be cut short."""

    def __init__(self, place: Place) -> None:
        self.place = place
        self.runs = place.folder / "runs"
        self.request = place.request("six_position")
        self.healthy()

    def healthy(self, **bench: Any) -> None:
        self.place.write(flash_file=str(self.place.folder / "flash.bin"), **bench)

    def interrupt(self, *, committed: bool) -> register_journal.Transfer:
        """A transfer whose station lost its power, before or behind the commit."""
        setup, _ = configured(self.request)

        def begin(old: Any, new: Any) -> register_journal.Transfer:
            return register_journal.begin(self.runs, SERIAL, old, new, by="li", why="run", source="a.h5")

        class Cut(BaseException):
            pass

        with unit_alone(tell, setup) as unit:
            commit = unit.imu.commit

            def cut() -> None:
                if committed:
                    commit()
                raise Cut

            unit.imu.commit = cut  # type: ignore[method-assign]
            with pytest.raises(Cut):
                transfer(unit.imu, RegisterMap(tuple(setup.imu.registers)), SERIAL, VALUES, begin)
        entry = register_journal.interrupted(self.runs, SERIAL)
        assert entry is not None
        return entry

    def holds(self) -> dict[str, float]:
        return read_unit(tell, self.request, self.runs).values

    def run(self, **changes: Any) -> list[Event]:
        events: list[Event] = []
        execute(replace(self.request, **changes), events.append, Control())
        return events


@pytest.fixture
def bench(place: Place) -> Workbench:
    return Workbench(place)


def told(events: list[Event], ident: str) -> list[Any]:
    return [event.values for event in events if isinstance(event, Message) and event.id == ident]


def test_a_unit_that_kept_its_registers_is_calibrated_as_if_nothing_had_been(bench: Workbench) -> None:
    bench.interrupt(committed=False)
    events = bench.run()
    assert told(events, "transfer_kept")[0]["holds"] == "old"
    assert isinstance(events[-1], Verdict)
    assert events[-1].outcome == "passed"
    first, second = register_journal.history(bench.runs, SERIAL)
    assert (first.closing, second.closing) == ("kept", "done")


def test_unproved_registers_stop_a_run_until_somebody_decides(bench: Workbench) -> None:
    bench.interrupt(committed=True)
    events = bench.run()
    (offer,) = told(events, "transfer_open")
    assert (offer["holds"], offer["offers"], offer["serial"]) == ("new", ["finish", "restore"], SERIAL)
    (fault,) = [event for event in events if isinstance(event, Fault)]
    assert "calstation registers finish SN-000042, or restore" in fault.text
    assert isinstance(events[-1], Verdict)
    assert events[-1].outcome == "fault"
    with pytest.raises(DeviceFaultError, match="finish or restore it"):
        write_unit(tell, bench.request, SERIAL, VALUES, "x.h5", "wang", bench.runs)
    assert register_journal.interrupted(bench.runs, SERIAL) is not None

    events = bench.run(unfinished="restore")
    assert told(events, "transfer_settled")[0]["closing"] == "restored"
    assert isinstance(events[-1], Verdict)
    assert events[-1].outcome == "passed"


@pytest.mark.parametrize(("choice", "committed"), [("finish", False), ("restore", True)])
def test_finished_or_restored_without_a_run(bench: Workbench, committed: bool, choice: str) -> None:
    entry = bench.interrupt(committed=committed)
    if choice == "finish":
        settled = finish_transfer(tell, bench.request, bench.runs)
        assert settled.closing == "done"
    else:
        settled = restore_registers(tell, bench.request, bench.runs, "wang")
        assert settled.closing == "restored"
    assert dict(settled.registers) == dict(entry.new if choice == "finish" else entry.old)
    assert register_journal.interrupted(bench.runs, SERIAL) is None
    assert register_journal.cycles(bench.runs, SERIAL) == 2
    with pytest.raises(InputError, match="nothing to finish"):
        finish_transfer(tell, bench.request, bench.runs)


def test_any_earlier_set_can_be_restored_by_its_transfer(bench: Workbench) -> None:
    for value in (1e-6, 2e-6):
        write_unit(tell, bench.request, SERIAL, {"gyro_bias_x": value}, "x.h5", "wang", bench.runs)
    known = register_journal.history(bench.runs, SERIAL)
    restore_registers(tell, bench.request, bench.runs, "wang", known[1].id)
    assert bench.holds()["gyro_bias_x"] == np.float32(1e-6)
    assert [t.why for t in register_journal.history(bench.runs, SERIAL)] == ["hand", "hand", "restore"]
    with pytest.raises(InputError, match="has no transfer 'x'"):
        restore_registers(tell, bench.request, bench.runs, "wang", "x")
    with pytest.raises(InputError, match="no transfer to unit 'SN-000007'"):
        restore_registers(tell, replace(bench.request, serial="SN-000007"), bench.runs, "wang")


def test_registers_that_make_the_output_wrong_are_taken_back(bench: Workbench) -> None:
    before = bench.holds()
    with pytest.raises(DeviceFaultError, match=r"gravity measures .* its old registers were put back"):
        write_unit(tell, bench.request, SERIAL, {"accel_scale_z": 0.05}, "x.h5", "wang", bench.runs)
    assert bench.holds() == before
    (entry,) = register_journal.history(bench.runs, SERIAL)
    assert entry.closing == "restored"
    assert "refuted" in entry.steps


def test_the_command_line_lists_finishes_and_restores(
    bench: Workbench, capsys: pytest.CaptureFixture[str]
) -> None:
    entry = bench.interrupt(committed=True)
    place = [
        "--out",
        str(bench.runs),
        "--station",
        str(bench.place.station),
        "--product",
        str(bench.place.product),
    ]

    def run(*words: str) -> tuple[int, Callable[[], str]]:
        code = run_app(["registers", *words])
        output = capsys.readouterr()
        return code, lambda: output.out + output.err

    code, text = run("list", "--out", str(bench.runs))
    assert code == 0
    assert "OPEN" in text()
    assert "1 flash cycles" in text()
    assert f"  {register_journal.history(bench.runs, SERIAL)[0].id}  OPEN" in text()
    code, text = run("finish", SERIAL, *place, "--json", "-")
    assert code == 0
    assert json.loads(text())["registers"] == dict(entry.new)
    code, text = run("restore", SERIAL, *place)
    assert (code, bench.holds()) == (0, dict(entry.old))
    code, text = run("finish", SERIAL, *place)
    assert code == 2
    assert "nothing to finish" in text()
    code, text = run("list", SERIAL, "--out", str(bench.runs), "--json", "-")
    listed = json.loads(text())[SERIAL]
    assert [t["closing"] for t in listed["transfers"]] == ["done", "done"]
    assert listed["flash_cycles"] == 2
