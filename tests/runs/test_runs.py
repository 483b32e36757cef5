"""Runs on the real bench process: verdicts, pause, stop, faults, registers, and identical offline results."""

import csv
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from calstation.config import library, versions
from calstation.connection import Devices
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.records import export_csv, open_log
from calstation.results import History, load_finished_run, resolve
from calstation.runs import execute, run
from calstation.sequencer import (
    Command,
    Control,
    Event,
    Fault,
    Finalized,
    Message,
    StageSolved,
    StateChanged,
    StepStarted,
)
from tests.helpers import convert_log, raises_code
from tests.shared_runs import SharedRuns
from tests.site_folder import SiteFolder


def test_short_full_run_passes_and_re_solves_bit_identically(tmp_path: Path, shared_runs: SharedRuns) -> None:
    ended = shared_runs.passed(tmp_path)
    result = ended.result
    assert result["stages"] == ["rate", "six_position", "excitation", "azimuth_flip"]
    assert len(result["parameters"]) == 30
    assert result["registers"]["verified"] is True
    assert result["attempt"] == 1
    assert result["operator"] == "tester"
    assert json.loads(Path(ended.result_file).read_text(encoding="utf-8")) == result
    log = open_log(Path(ended.log))
    assert log.outcome == "passed"
    assert log.results == [result]
    assert any(event["event"] == "OldRegisters" for event in log.events)

    again = resolve(Path(ended.log)).result.to_json()
    assert again["parameters"] == result["parameters"]
    assert again["consistency"] == result["consistency"]
    assert again["log"]["sha256"] == result["log"]["sha256"]
    assert again["outcome"] == "resolved"
    assert again["passed"] is True

    csv, back = tmp_path / "log.csv", tmp_path / "back.h5"
    export_csv(Path(ended.log), csv)
    convert_log(csv, back)
    for path in (csv, back):
        assert resolve(path).result.to_json()["parameters"] == result["parameters"]


@pytest.mark.exhaustive
def test_the_same_seed_gives_the_same_run(tmp_path: Path) -> None:
    first, second = (SiteFolder(folder) for folder in (tmp_path / "first", tmp_path / "second") if not folder.mkdir())
    assert first.run("six_position").result["parameters"] == second.run("six_position").result["parameters"]
    assert first.run("six_position").result["attempt"] == 2


@pytest.mark.long
def test_a_unit_outside_its_limits_keeps_its_registers(site_folder: SiteFolder) -> None:
    site_folder.write(out_of_limits=True)
    ended = site_folder.run("six_position")
    assert ended.verdict == "failed"
    assert ended.result["registers"]["old"]
    assert ended.result["registers"]["new"] is None
    assert any(m.id == "registers_kept" for m in site_folder.events_of(Message))
    failed = [c["name"] for c in ended.result["checks"] if not c["passed"]]
    assert failed == ["accel_scale_y within"]


def test_run_ends_early_on_failure_if_configured(site_folder: SiteFolder) -> None:
    site_folder.write({"end_on_failure": True, "stages": ["six_position", "azimuth_flip"]}, out_of_limits=True)
    ended = site_folder.run()
    assert ended.verdict == "failed"
    assert ended.result["stages"] == ["six_position"]


@pytest.mark.long
def test_run_can_be_paused_and_resumed(site_folder: SiteFolder) -> None:
    pause = site_folder.once(StepStarted, Command.PAUSE, after=2)

    def watch(event: object) -> None:
        pause(event)  # type: ignore[arg-type]
        if isinstance(event, StateChanged) and event.state == "paused":
            site_folder.control.send(Command.RESUME)

    ended = site_folder.run("rate", on_event=watch)
    assert ended.verdict.passed, [c for c in ended.result["checks"] if not c["passed"]]
    assert [e.state for e in site_folder.events_of(StateChanged)].count("paused") == 1
    assert len(site_folder.events_of(StageSolved)[0].parameters) == 3
    assert resolve(Path(ended.log)).result.to_json()["parameters"] == ended.result["parameters"]


@pytest.mark.parametrize("moment", [StateChanged, StepStarted])
def test_stop_is_safe_and_leaves_a_result(site_folder: SiteFolder, moment: type) -> None:
    ended = site_folder.run("rate", on_event=site_folder.once(moment, Command.STOP))
    assert ended.verdict == "stopped"
    assert ended.result["passed"] is False
    assert [e.state for e in site_folder.events_of(StateChanged)][-2:] == ["stopping", "stopped"]
    assert open_log(Path(ended.log)).outcome == "stopped"


@pytest.mark.parametrize(
    ("bench", "code"),
    [
        ({"serial": "SN-000043"}, "preflight.other_unit"),
        ({"watchdog_ms": 0}, "motion.watchdog_off"),
        ({"interlock_closed": False}, "motion.interlock_open"),
        ({"mount_deg": [20.0, 21.0]}, "preflight.gravity_direction"),
        ({"ready_time_s": 1000.0}, "preflight.not_ready"),
        ({"orders": [{"order": "drive_fault", "at": 35.0}]}, "table.latched_drive"),
        ({"orders": [{"order": "silence_imu", "value": 500, "at": 35.0}]}, "stream.not_started"),
        ({"orders": [{"order": "hang_up_imu", "at": 35.0}]}, None),
    ],
    ids=lambda v: str(v)[:40],
)
def test_faults_are_reported_and_leave_a_result(
    site_folder: SiteFolder, bench: dict[str, object], code: str | None
) -> None:
    site_folder.write(**bench)
    ended = site_folder.run("rate")
    assert ended.verdict == "fault"
    assert code is None or site_folder.fault().code == code
    assert ended.result["error"] == site_folder.fault().text
    assert [e.state for e in site_folder.events_of(StateChanged)][-1] == "fault"


@pytest.mark.exhaustive
def test_lost_frames_repeat_a_step(site_folder: SiteFolder) -> None:
    site_folder.write(orders=[{"order": "drop_frames", "value": 3, "at": 35.0}])
    ended = site_folder.run("rate")
    assert ended.verdict.passed, [c for c in ended.result["checks"] if not c["passed"]]
    assert [m.values["reason"] for m in site_folder.events_of(Message) if m.id == "step_repeated"] == ["gap"]
    assert ended.result["log"]["gaps"] == 1


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals exist only on POSIX systems")
def test_run_passes_over_modbus_rtu_and_a_serial_line(site_folder: SiteFolder) -> None:
    site_folder.write(table_transport="rtu", imu_transport="pty")
    assert site_folder.run("six_position").verdict.passed


def test_run_requires_limits(site_folder: SiteFolder) -> None:
    site_folder.write({"limits": {}})
    with pytest.raises(ConfigurationError, match="limits"):
        site_folder.run("rate")


@pytest.mark.long
def test_registers_applied_to_the_stream_are_read_and_logged(corrected_site: SiteFolder) -> None:
    ended = corrected_site.run("six_position")
    assert ended.verdict.passed
    assert open_log(Path(ended.log)).meta.registers == ended.result["registers"]["old"]


@pytest.mark.exhaustive
def test_uncommitted_registers_are_not_applied_to_the_stream(
    corrected_site: SiteFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    def left_by_another_program(devices: Devices, *rest: Any) -> None:
        devices.imu.write_registers({"gyro_bias_x": 1e-3})

    monkeypatch.setattr(run, "recover_interrupted", left_by_another_program)
    ended = corrected_site.run("six_position")
    assert ended.result["registers"]["old"]["gyro_bias_x"] == 0.0
    assert open_log(Path(ended.log)).meta.registers == ended.result["registers"]["old"]


@pytest.mark.long
def test_advice_depends_on_the_number_of_failures_until_attempts_are_used_up(site_folder: SiteFolder) -> None:
    site_folder.write({"attempts_allowed": 3, "advice": ["reseat", "repeat"]}, out_of_limits=True)
    advice = []
    for attempt in (1, 2, 3):
        ended = site_folder.run("six_position")
        assert (ended.verdict, ended.result["attempt"]) == ("failed", attempt)
        advice.append(ended.result["advice"])
        site_folder.events.clear()
    assert advice == ["reseat", "repeat", "set_aside"]
    with raises_code(ConfigurationError, "run.attempts_used"):
        site_folder.run("six_position")
    request = replace(site_folder.request("six_position"), beyond_attempts=True)
    execute(request, site_folder.events.append, site_folder.control)
    assert site_folder.events[-1].result["advice"] == "set_aside"  # type: ignore[union-attr]


@pytest.mark.exhaustive
def test_result_lists_its_files_and_omitted_comparisons(
    site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(site_folder.folder / "home"))
    text = library.find("products", "nav_a").read_text("utf-8")
    version = versions.save("products", "nav_a", text.replace("time_s = 10.0", "time_s = 1.0"), "wang")
    site_folder.product = library.find("products", "nav_a")
    result = site_folder.run("six_position").result
    product = {"name": "nav_a", "version": version.number, "sha256": version.sha256}
    assert result["configuration"]["product"] == product
    assert set(result["configuration"]) == {"station", "product", "table", "imu"}
    assert result["configuration"]["imu"]["version"] is None
    assert "gyro_misalign_xy" in result["not_compared"]
    assert "accel_scale_x" not in result["not_compared"]
    assert "accel_bias_x within" in [check["name"] for check in result["checks"]]


@pytest.mark.long
def test_every_outcome_is_delivered_and_listed(site_folder: SiteFolder) -> None:
    site_folder.run("six_position")
    site_folder.run("rate", on_event=site_folder.once(StepStarted, Command.STOP))
    site_folder.control, site_folder.events = Control(), []
    site_folder.write(watchdog_ms=0)
    site_folder.run("rate")
    site_folder.write(out_of_limits=True)
    site_folder.run("six_position")
    outcomes = ["passed", "stopped", "fault", "failed"]
    verdicts = ["partial", *outcomes[1:]]
    with (site_folder.folder / "handover" / "handover.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["outcome"] for row in rows] == verdicts
    for row, outcome in zip(rows, outcomes, strict=True):
        handed = json.loads((site_folder.folder / "handover" / row["result"]).read_text("utf-8"))
        assert (handed["outcome"], handed["partial"]) == (outcome, True)
    history = History(site_folder.folder / "runs")
    assert [run.verdict for run in history.runs()] == verdicts[::-1]
    assert [run.attempt for run in history.runs()] == [4, 3, 2, 1]


@pytest.mark.exhaustive
def test_missing_delivery_folder_does_not_fail_a_run(site_folder: SiteFolder) -> None:
    station = site_folder.station.read_text("utf-8")
    site_folder.station.write_text(f'{station}\n[handover]\nfolder = "share"\n', encoding="utf-8")
    execute(site_folder.request("six_position"), site_folder.events.append, site_folder.control)
    ended, said = site_folder.events[-2:]
    assert isinstance(ended, Finalized)
    assert ended.verdict.passed
    assert isinstance(said, Message)
    assert said.id == "handover_waiting"
    (site_folder.folder / "share").mkdir()
    site_folder.events.clear()
    execute(site_folder.request("six_position"), site_folder.events.append, site_folder.control)
    assert site_folder.events[-1] == Message("handover_done", {"folder": str(site_folder.folder / "share"), "count": 2})


def test_stop_before_the_first_register_write_stops_the_run(site_folder: SiteFolder) -> None:
    ended = site_folder.run("six_position", on_event=site_folder.once(StageSolved, Command.STOP))
    assert ended.verdict == "stopped"
    assert ended.result["registers"]["old"]
    assert ended.result["registers"]["new"] is None
    assert not [m for m in site_folder.events_of(Message) if m.id == "registers_transfer"]


@pytest.mark.long
def test_a_stop_during_the_transfer_waits_for_its_end(site_folder: SiteFolder) -> None:
    def watch(event: Event) -> None:
        if isinstance(event, Message) and event.id == "registers_transfer":
            site_folder.control.send(Command.STOP)

    ended = site_folder.run("six_position", on_event=watch)
    messages = [m.id for m in site_folder.events_of(Message)]
    assert (
        messages.index("registers_transfer") < messages.index("transfer_finished") < messages.index("transfer_unproved")
    )
    registers = ended.result["registers"]
    assert (ended.verdict, registers["verified"]) == ("stopped", False)
    assert registers["new"] != registers["old"]
    assert [e.state for e in site_folder.events_of(StateChanged)][-2:] == ["stopping", "stopped"]


@pytest.mark.parametrize(
    ("out_of_limits", "outcome"), [(True, "failed"), pytest.param(False, "passed", marks=pytest.mark.long)]
)
def test_a_stop_while_unloading_leaves_the_verdict(site_folder: SiteFolder, out_of_limits: bool, outcome: str) -> None:
    def watch(event: Event) -> None:
        if isinstance(event, Message) and event.id == "finishing":
            site_folder.control.send(Command.STOP)

    site_folder.write(out_of_limits=out_of_limits)
    ended = site_folder.run("six_position", on_event=watch)
    assert (ended.result["outcome"], ended.result.get("stop_reason")) == (outcome, None)
    assert bool((ended.result["registers"] or {}).get("verified")) is not out_of_limits
    assert [e.state for e in site_folder.events_of(StateChanged)][-2:] == ["stopping", "stopped"]
    assert "unloading_stopped" in [m.id for m in site_folder.events_of(Message)]


def test_a_fault_of_the_table_while_unloading_leaves_the_verdict(
    site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise DeviceFaultError("motion.switched_off")

    monkeypatch.setattr("calstation.sequencer.driving.RunDriver.finish", fail)
    site_folder.write(out_of_limits=True)
    ended = site_folder.run("six_position")
    assert (ended.result["outcome"], ended.result.get("error")) == ("failed", None)
    assert [fault.code for fault in site_folder.events_of(Fault)] == ["motion.switched_off"]
    assert "unloading_failed" in [m.id for m in site_folder.events_of(Message)]


def test_stop_while_devices_are_opened_leaves_a_result(site_folder: SiteFolder) -> None:
    site_folder.control.send(Command.STOP)
    ended = site_folder.run("rate")
    assert (ended.verdict, ended.result["stages"]) == ("stopped", [])
    assert (ended.result["advice"], ended.result["stop_reason"]) == ("repeat", "operator")
    assert open_log(Path(ended.log)).outcome == "stopped"
    assert not site_folder.events_of(StateChanged)


@pytest.mark.parametrize(("turns", "expected"), [(1, []), (2, [["rate"]])])
def test_schedule_that_differs_from_the_product_is_an_event_of_the_run(
    site_folder: SiteFolder, turns: int, expected: list[list[str]]
) -> None:
    """The same values are no difference: a resumed run is given the whole schedule of its log."""
    stop = site_folder.once(StateChanged, Command.STOP)

    def emit(event: Event) -> None:
        site_folder.events.append(event)
        stop(event)

    execute(replace(site_folder.request("rate"), schedule={"rate": {"turns": turns}}), emit, site_folder.control)
    log = Path(site_folder.events_of(Finalized)[0].log)
    assert [e["values"]["stages"] for e in open_log(log).events if e.get("id") == "schedule_changed"] == expected
    finished = load_finished_run(lambda _: None, log, site_folder.runs)
    assert finished.changed_schedules == (("rate",) if expected else ())
