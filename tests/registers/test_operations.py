"""Register operations outside a run: the table is prepared first, moves for verification, and is left at rest."""

import json
import os
import signal
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import pytest
import tomli_w

from calstation.cli.app import run_app
from calstation.config import library
from calstation.errors import CalstationError, DeviceFaultError
from calstation.registers import UnitRegisters
from calstation.registers import journal as register_journal
from calstation.registers import operation as register_errand
from calstation.sequencer import Command, Event, Message, StateChanged, StepStarted
from tests.helpers import raises_code, sampled
from tests.registers.operations import RegisterOperations
from tests.site_folder import STATION, SiteFolder

pytestmark = pytest.mark.long

SERIAL = "SN-000042"
VALUES = {"gyro_bias_x": 1e-6, "accel_scale_y": 3e-4}
#: Of the unit's x gyro, larger than any calibrated one: what a wrong sign makes of it cannot be mistaken.
SCALE = 0.02


class Floor:
    """A site whose unit keeps its flash, with access to the final state of the bench."""

    def __init__(self, site_folder: SiteFolder) -> None:
        self.site_folder = site_folder
        self.runs = site_folder.folder / "runs"
        self.operations = RegisterOperations(site_folder.request())
        self.write_station()

    def write_station(self, profile: str = "bench", **bench: Any) -> None:
        files = {"flash_file": "flash.bin", "report_file": "bench.json"}
        settings = {
            "seed": 5,
            "start_deg": [1.0, -1.0],
            **{name: str(self.site_folder.folder / file) for name, file in files.items()},
            **bench,
        }
        station = {**STATION, "table": {"profile": profile}, "bench": settings}
        self.site_folder.station.write_text(tomli_w.dumps(station), encoding="utf-8")

    @property
    def report(self) -> dict[str, Any]:
        """Return the final state of the bench."""
        found: dict[str, Any] = json.loads((self.site_folder.folder / "bench.json").read_text(encoding="utf-8"))
        return found

    @property
    def entry(self) -> register_journal.Transfer:
        """Return the latest transfer."""
        return register_journal.history(self.runs, SERIAL)[-1]

    def left_alone(self) -> bool:
        """Return whether the table is at rest with its axes off."""
        return not self.report["enabled"] and not self.report["moving"]


@pytest.fixture
def floor(site_folder: SiteFolder) -> Floor:
    return Floor(site_folder)


def verifying(operations: RegisterOperations, event: Event) -> bool:
    """Return whether an event is a verification move of the restarted unit."""
    return isinstance(event, StepStarted) and event.label[:1] == ("verify",) and "verifying" in operations.message_ids()


def stop_at(moment: str) -> Any:
    """Stop at a message, or at the first move with a purpose; for verification, of the restarted unit."""

    def watch(operations: RegisterOperations, event: Event) -> None:
        move = isinstance(event, StepStarted) and event.label[:1] == (moment,)
        if moment == "verify":
            move = verifying(operations, event)
        if move or (isinstance(event, Message) and event.id == moment):
            operations.control.send(Command.STOP)

    return watch


def test_wrong_sign_that_is_invisible_at_rest_fails_the_rotation_test(floor: Floor) -> None:
    floor.write_station(parameters={"gyro_scale_x": SCALE})
    floor.operations.write({"gyro_scale_x": SCALE})
    assert floor.entry.steps[-1] == "turned"
    with raises_code(DeviceFaultError, "verification.wrong"):
        floor.operations.write({"gyro_scale_x": -SCALE})
    assert (floor.entry.closing, "refuted" in floor.entry.steps) == ("restored", True)
    assert floor.left_alone()
    settled = floor.operations.write({"gyro_scale_x": -SCALE}, at_rest=True)
    assert (settled.closing, settled.proof) == ("done", "rest")
    assert floor.entry.steps[-1] == "at_rest"
    assert floor.operations.moves() == []
    assert UnitRegisters.of(settled.unit).values["gyro_scale_x"] == pytest.approx(-SCALE)


@pytest.mark.parametrize("profile", ["bench", pytest.param("indexing_unit", marks=pytest.mark.exhaustive)])
def test_table_is_prepared_moved_for_verification_and_returned_to_load_position(floor: Floor, profile: str) -> None:
    floor.write_station(profile)
    settled = floor.operations.write(VALUES)
    assert (settled.closing, settled.proof) == ("done", "turn")
    ids = floor.operations.message_ids()
    order = ["identified", "homing", "checking_mounting", "registers_writing", "verifying", "registers_proved"]
    assert [ident for ident in ids if ident in order] == order
    moves = floor.operations.moves()
    assert moves.count("verify") >= 11, "twice around"
    assert set(moves[-12:]) <= {"verify", "load"}
    assert "verify" not in moves[moves.index("load") :] if "load" in moves else True, "loaded at the end"
    states = [event.state for event in floor.operations.events if isinstance(event, StateChanged)]
    assert states == ["preparing", "running", "done"], "an operation that is not a calibration does not pass"
    assert floor.left_alone()


@pytest.mark.parametrize(
    ("bench", "words"),
    [
        ({"interlock_closed": False}, "The interlock is open"),
        pytest.param({"watchdog_ms": 0}, "The watchdog is off", marks=pytest.mark.long),
        pytest.param({"orders": [{"order": "drive_fault"}]}, "fault 'drive'", marks=pytest.mark.long),
        pytest.param({"orders": [{"order": "mute_table", "value": 1e6}]}, "no response", marks=pytest.mark.long),
        pytest.param(
            {"low_deg": [-1080.0, -20.0], "high_deg": [1080.0, 20.0]},
            "The inner axis cannot turn by 30°",
            marks=pytest.mark.long,
        ),
    ],
)
def test_table_that_cannot_move_is_reported_before_any_write(floor: Floor, bench: dict[str, Any], words: str) -> None:
    floor.write_station(**bench)
    with pytest.raises(CalstationError, match=words) as refused:
        floor.operations.write(VALUES)
    assert str(refused.value).endswith(" Or leave the table alone: --at-rest.")
    assert register_journal.history(floor.runs, SERIAL) == []
    assert floor.report["flash_cycles"] == 0
    assert floor.left_alone()
    assert floor.operations.write(VALUES, at_rest=True).proof == "rest"


@pytest.mark.long
@pytest.mark.parametrize(
    ("profile", "moment"),
    sampled(
        3,
        ["bench", "indexing_unit"],
        ["identified", "homing", "check", "reference", "registers_writing", "verifying", "verify"],
    ),
)
def test_stop_is_safe_at_every_step(floor: Floor, profile: str, moment: str) -> None:
    written = moment in ("registers_writing", "verifying", "verify")
    floor.write_station(profile)
    floor.operations.on_event = stop_at(moment)
    assert floor.operations.write(VALUES).closing == "stopped"
    assert floor.left_alone()
    assert bool(register_journal.interrupted(floor.runs, SERIAL)) is written
    assert ("transfer_unproved" in floor.operations.message_ids()) is written
    assert ("transfer_finished" in floor.operations.message_ids()) is (moment == "registers_writing")
    if written:
        floor.operations.on_event = lambda operations, event: None
        settled = floor.operations.do("finish")
        assert (settled.closing, settled.proof) == ("done", "turn")
        assert floor.entry.cycles == 1, "what was in flash already is not written again"


@pytest.mark.long
def test_stop_without_a_table_leaves_the_transfer_unverified(floor: Floor) -> None:
    floor.operations.on_event = stop_at("verifying")
    assert floor.operations.write(VALUES, at_rest=True).closing == "stopped"
    assert floor.operations.message_ids()[-1] == "transfer_unproved"
    floor.operations.on_event = lambda operations, event: None
    assert floor.operations.do("restore", at_rest=True).closing == "restored"


@pytest.fixture
def current_clock(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The clock of the current bench, which accepts fault orders."""
    clocks: list[Any] = []
    open_devices = register_errand.open_devices

    @contextmanager
    def watched(*args: Any) -> Any:
        with open_devices(*args) as devices:
            clocks.append(devices.clock)
            yield devices

    monkeypatch.setattr(register_errand, "open_devices", watched)
    return clocks


@pytest.mark.long
@pytest.mark.parametrize(
    ("order", "words"),
    [
        pytest.param("drive_fault", "fault 'drive'", marks=pytest.mark.exhaustive),
        pytest.param("interlock", "interlock", marks=pytest.mark.exhaustive),
        ("jam", "did not reach"),
    ],
)
def test_table_fault_during_verification_leaves_the_transfer_open(
    floor: Floor, current_clock: list[Any], order: str, words: str
) -> None:
    def spoil(operations: RegisterOperations, event: Event) -> None:
        if verifying(operations, event):
            current_clock[-1].inject({"order": order, "value": 0.0, "after": 0.5})

    floor.operations.on_event = spoil
    with pytest.raises(DeviceFaultError, match=words) as fault:
        floor.operations.write(VALUES)
    assert "--at-rest" not in str(fault.value)
    assert "transfer_unproved" in floor.operations.message_ids()
    assert floor.left_alone()
    assert register_journal.interrupted(floor.runs, SERIAL) is not None
    floor.operations.on_event = lambda operations, event: None
    assert floor.operations.do("restore").closing == "restored"


@pytest.mark.long
def test_table_fault_before_the_write_leaves_the_registers_unchanged(floor: Floor, current_clock: list[Any]) -> None:
    def spoil(operations: RegisterOperations, event: Event) -> None:
        if isinstance(event, StepStarted) and event.label[:1] == ("verify",):
            current_clock[-1].inject({"order": "drive_fault", "after": 0.5})

    floor.operations.on_event = spoil
    with pytest.raises(DeviceFaultError, match=r"fault 'drive'.*--at-rest"):
        floor.operations.write(VALUES)
    assert "transfer_unproved" not in floor.operations.message_ids()
    assert floor.left_alone()
    assert register_journal.interrupted(floor.runs, SERIAL) is None


@pytest.mark.exhaustive
def test_restored_registers_are_verified(floor: Floor) -> None:
    floor.write_station(parameters={"gyro_scale_x": SCALE})
    floor.operations.write({"gyro_scale_x": -SCALE}, at_rest=True)
    floor.operations.on_event = stop_at("verifying")
    floor.operations.write({"gyro_scale_x": 0.0})
    floor.operations.on_event = lambda operations, event: None
    with raises_code(DeviceFaultError, "verification.old_wrong"):
        floor.operations.do("restore")
    assert (floor.entry.closing, floor.entry.steps[-1]) == ("restored", "refuted")

    floor.operations.write({"gyro_scale_x": SCALE})
    floor.operations.on_event = stop_at("verifying")
    floor.operations.write({"gyro_scale_x": 0.0})
    floor.operations.on_event = lambda operations, event: None
    settled = floor.operations.do("restore")
    assert (settled.closing, settled.proof) == ("restored", "turn")
    assert UnitRegisters.of(settled.unit).values["gyro_scale_x"] == pytest.approx(SCALE)


@pytest.mark.long
def test_unit_with_its_old_registers_needs_no_verification_motion(floor: Floor) -> None:
    floor.operations.on_event = stop_at("verifying")
    floor.operations.write(VALUES)
    entry = floor.entry
    floor.operations.on_event = lambda operations, event: None
    floor.operations.do("restore", at_rest=True)
    register_journal.begin(floor.runs, SERIAL, entry.old, entry.new, register_journal.Purpose("li", "hand", "y.h5"))
    settled = floor.operations.do("restore")
    assert (settled.closing, settled.proof) == ("kept", "")
    assert floor.operations.moves() == []
    assert floor.entry.closing == "kept"


@pytest.mark.long
def test_manual_rig_needs_no_motion_test(floor: Floor) -> None:
    floor.write_station("hand_rails", parameters={})
    floor.operations.request = replace(floor.operations.request, product=library.find("products", "mems_hand"))
    settled = floor.operations.write({"gyro_bias_x": 1e-4})
    assert (settled.closing, settled.proof) == ("done", "rest")
    assert floor.operations.moves() == []


@pytest.mark.long
def test_command_line_reports_motion_and_verification(floor: Floor, capsys: pytest.CaptureFixture[str]) -> None:
    floor.operations.write(VALUES, at_rest=True)
    files = ["--out", str(floor.runs), "--station", str(floor.site_folder.station)]
    files += ["--product", str(floor.site_folder.product)]
    assert run_app(["registers", "restore", SERIAL, *files]) == 0
    shown = capsys.readouterr()
    assert shown.err.index("will move") < shown.err.index("Writing the registers")
    assert "old registers" not in shown.out  # of a transfer that had been closed: a new one, proved
    assert "verified with a turn of the table" in shown.out
    assert run_app(["registers", "restore", SERIAL, *files, "--at-rest", "--json", "-"]) == 0
    shown = capsys.readouterr()
    assert "Nothing moves" in shown.err
    assert json.loads(shown.out)["proof"] == "rest"
    assert run_app(["registers", "list", SERIAL, "--out", str(floor.runs)]) == 0
    listed = capsys.readouterr().out
    assert listed.count("done, verified at rest, without a turn") == 2
    assert listed.count("done, verified with a turn of the table") == 1
    assert run_app(["registers", "finish", SERIAL, *files]) == 2
    shown = capsys.readouterr()
    assert "nothing to finish" in shown.err
    assert "will move" not in shown.err


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="a console's Ctrl-C cannot be sent to one process there")
def test_ctrl_c_during_verification_stops_the_table(floor: Floor) -> None:
    floor.operations.on_event = stop_at("verifying")
    floor.operations.write(VALUES)
    floor.write_station(speed=5.0)
    command = [sys.executable, "-m", "calstation", "registers", "finish", SERIAL, "--out", str(floor.runs)]
    command += ["--station", str(floor.site_folder.station), "--product", str(floor.site_folder.product)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, env={**os.environ, "COLUMNS": "200"}) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if b"Checking the output" in line:
                process.send_signal(signal.SIGINT)
                break
        rest = process.stderr.read().decode()
        assert process.wait(120) == 4
    assert "written but not verified" in rest
    assert floor.left_alone()
    assert register_journal.interrupted(floor.runs, SERIAL) is not None
