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
#: Scale factor error of the x gyro, so large that the effect of a wrong sign is unmistakable.
SCALE = 0.02


class OperationSite:
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

    def is_safe(self) -> bool:
        """Return whether the table is at rest with its axes off."""
        return not self.report["enabled"] and not self.report["moving"]


@pytest.fixture
def site(site_folder: SiteFolder) -> OperationSite:
    return OperationSite(site_folder)


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


def test_wrong_sign_that_is_invisible_at_rest_fails_the_rotation_test(site: OperationSite) -> None:
    site.write_station(parameters={"gyro_scale_x": SCALE})
    site.operations.write({"gyro_scale_x": SCALE})
    assert site.entry.steps[-1] == "turned"
    with raises_code(DeviceFaultError, "verification.wrong"):
        site.operations.write({"gyro_scale_x": -SCALE})
    assert (site.entry.closing, "refuted" in site.entry.steps) == ("restored", True)
    assert site.is_safe()
    settled = site.operations.write({"gyro_scale_x": -SCALE}, at_rest=True)
    assert (settled.closing, settled.proof) == ("done", "rest")
    assert site.entry.steps[-1] == "at_rest"
    assert site.operations.moves() == []
    assert UnitRegisters.of(settled.unit).values["gyro_scale_x"] == pytest.approx(-SCALE)


@pytest.mark.parametrize("profile", ["bench", pytest.param("indexing_unit", marks=pytest.mark.exhaustive)])
def test_table_is_prepared_moved_for_verification_and_returned_to_load_position(
    site: OperationSite, profile: str
) -> None:
    site.write_station(profile)
    settled = site.operations.write(VALUES)
    assert (settled.closing, settled.proof) == ("done", "turn")
    ids = site.operations.message_ids()
    order = ["identified", "homing", "checking_mounting", "registers_writing", "verifying", "registers_proved"]
    assert [ident for ident in ids if ident in order] == order
    moves = site.operations.moves()
    assert moves.count("reference") + moves.count("verify") >= 11, "twice around"
    assert set(moves[-12:]) <= {"reference", "verify", "load"}
    assert "verify" not in moves[moves.index("load") :] if "load" in moves else True, "loaded at the end"
    states = [event.state for event in site.operations.events if isinstance(event, StateChanged)]
    assert states == ["preparing", "running", "done"], "an operation that is not a calibration does not pass"
    assert site.is_safe()


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
def test_table_that_cannot_move_is_reported_before_any_write(
    site: OperationSite, bench: dict[str, Any], words: str
) -> None:
    site.write_station(**bench)
    with pytest.raises(CalstationError, match=words) as refused:
        site.operations.write(VALUES)
    assert str(refused.value).endswith(" Or leave the table alone: --at-rest.")
    assert register_journal.history(site.runs, SERIAL) == []
    assert site.report["flash_cycles"] == 0
    assert site.is_safe()
    assert site.operations.write(VALUES, at_rest=True).proof == "rest"


@pytest.mark.long
@pytest.mark.parametrize(
    ("profile", "moment"),
    sampled(
        3,
        ["bench", "indexing_unit"],
        ["identified", "homing", "check", "reference", "registers_writing", "verifying", "verify"],
    ),
)
def test_stop_is_safe_at_every_step(site: OperationSite, profile: str, moment: str) -> None:
    written = moment in ("registers_writing", "verifying", "verify")
    site.write_station(profile)
    site.operations.on_event = stop_at(moment)
    assert site.operations.write(VALUES).closing == "stopped"
    assert site.is_safe()
    assert bool(register_journal.interrupted(site.runs, SERIAL)) is written
    assert ("transfer_unproved" in site.operations.message_ids()) is written
    assert ("transfer_finished" in site.operations.message_ids()) is (moment == "registers_writing")
    if written:
        site.operations.on_event = lambda operations, event: None
        settled = site.operations.do("finish")
        assert (settled.closing, settled.proof) == ("done", "turn")
        assert site.entry.cycles == 1, "what was in flash already is not written again"


@pytest.mark.long
def test_stop_without_a_table_leaves_the_transfer_unverified(site: OperationSite) -> None:
    site.operations.on_event = stop_at("verifying")
    assert site.operations.write(VALUES, at_rest=True).closing == "stopped"
    assert site.operations.message_ids()[-1] == "transfer_unproved"
    site.operations.on_event = lambda operations, event: None
    assert site.operations.do("restore", at_rest=True).closing == "restored"


@pytest.fixture
def current_clock(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The clock of the current bench, which accepts fault commands."""
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
    site: OperationSite, current_clock: list[Any], order: str, words: str
) -> None:
    def inject(operations: RegisterOperations, event: Event) -> None:
        if verifying(operations, event):
            current_clock[-1].inject({"order": order, "value": 0.0, "after": 0.5})

    site.operations.on_event = inject
    with pytest.raises(DeviceFaultError, match=words) as fault:
        site.operations.write(VALUES)
    assert "--at-rest" not in str(fault.value)
    assert "transfer_unproved" in site.operations.message_ids()
    assert site.is_safe()
    assert register_journal.interrupted(site.runs, SERIAL) is not None
    site.operations.on_event = lambda operations, event: None
    assert site.operations.do("restore").closing == "restored"


@pytest.mark.long
def test_table_fault_before_the_write_leaves_the_registers_unchanged(
    site: OperationSite, current_clock: list[Any]
) -> None:
    def inject(operations: RegisterOperations, event: Event) -> None:
        if isinstance(event, StepStarted) and event.label[:1] == ("reference",):
            current_clock[-1].inject({"order": "drive_fault", "after": 0.5})

    site.operations.on_event = inject
    with pytest.raises(DeviceFaultError, match=r"fault 'drive'.*--at-rest"):
        site.operations.write(VALUES)
    assert "transfer_unproved" not in site.operations.message_ids()
    assert site.is_safe()
    assert register_journal.interrupted(site.runs, SERIAL) is None


@pytest.mark.exhaustive
def test_restored_registers_are_verified(site: OperationSite) -> None:
    site.write_station(parameters={"gyro_scale_x": SCALE})
    site.operations.write({"gyro_scale_x": -SCALE}, at_rest=True)
    site.operations.on_event = stop_at("verifying")
    site.operations.write({"gyro_scale_x": 0.0})
    site.operations.on_event = lambda operations, event: None
    with raises_code(DeviceFaultError, "verification.old_wrong"):
        site.operations.do("restore")
    assert (site.entry.closing, site.entry.steps[-1]) == ("restored", "refuted")

    site.operations.write({"gyro_scale_x": SCALE})
    site.operations.on_event = stop_at("verifying")
    site.operations.write({"gyro_scale_x": 0.0})
    site.operations.on_event = lambda operations, event: None
    settled = site.operations.do("restore")
    assert (settled.closing, settled.proof) == ("restored", "turn")
    assert UnitRegisters.of(settled.unit).values["gyro_scale_x"] == pytest.approx(SCALE)


@pytest.mark.long
def test_unit_with_its_old_registers_needs_no_verification_motion(site: OperationSite) -> None:
    site.operations.on_event = stop_at("verifying")
    site.operations.write(VALUES)
    entry = site.entry
    site.operations.on_event = lambda operations, event: None
    site.operations.do("restore", at_rest=True)
    register_journal.begin(site.runs, SERIAL, entry.old, entry.new, register_journal.Purpose("li", "hand", "y.h5"))
    settled = site.operations.do("restore")
    assert (settled.closing, settled.proof) == ("kept", "")
    assert site.operations.moves() == []
    assert site.entry.closing == "kept"


@pytest.mark.long
def test_manual_rig_needs_no_motion_test(site: OperationSite) -> None:
    site.write_station("hand_rails", parameters={})
    site.operations.request = replace(site.operations.request, product=library.find("products", "mems_hand"))
    settled = site.operations.write({"gyro_bias_x": 1e-4})
    assert (settled.closing, settled.proof) == ("done", "rest")
    assert site.operations.moves() == []


@pytest.mark.long
def test_command_line_reports_motion_and_verification(site: OperationSite, capsys: pytest.CaptureFixture[str]) -> None:
    site.operations.write(VALUES, at_rest=True)
    files = ["--out", str(site.runs), "--station", str(site.site_folder.station)]
    files += ["--product", str(site.site_folder.product)]
    assert run_app(["registers", "restore", SERIAL, *files]) == 0
    shown = capsys.readouterr()
    assert shown.err.index("will move") < shown.err.index("Writing the registers")
    assert "old registers" not in shown.out  # the earlier transfer was closed, and this one is new
    assert "verified with a turn of the table" in shown.out
    assert run_app(["registers", "restore", SERIAL, *files, "--at-rest", "--json", "-"]) == 0
    shown = capsys.readouterr()
    assert "Nothing moves" in shown.err
    assert json.loads(shown.out)["proof"] == "rest"
    assert run_app(["registers", "list", SERIAL, "--out", str(site.runs)]) == 0
    listed = capsys.readouterr().out
    assert listed.count("done, verified at rest, without a turn") == 2
    assert listed.count("done, verified with a turn of the table") == 1
    assert run_app(["registers", "finish", SERIAL, *files]) == 2
    shown = capsys.readouterr()
    assert "nothing to finish" in shown.err
    assert "will move" not in shown.err


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="a console's Ctrl-C cannot be sent to one process there")
def test_ctrl_c_during_verification_stops_the_table(site: OperationSite) -> None:
    site.operations.on_event = stop_at("verifying")
    site.operations.write(VALUES)
    site.write_station(speed=5.0)
    command = [sys.executable, "-m", "calstation", "registers", "finish", SERIAL, "--out", str(site.runs)]
    command += ["--station", str(site.site_folder.station), "--product", str(site.site_folder.product)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, env={**os.environ, "COLUMNS": "200"}) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if b"Checking the output" in line:
                process.send_signal(signal.SIGINT)
                break
        rest = process.stderr.read().decode()
        assert process.wait(120) == 4
    assert "written but not verified" in rest
    assert site.is_safe()
    assert register_journal.interrupted(site.runs, SERIAL) is not None
