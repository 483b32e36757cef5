"""Several units on one table: each has its own log, result and verdict, independent of the others."""

import json
import sys
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.config import RunConfiguration, RunRequest
from calstation.connection import devices
from calstation.devices import Imu
from calstation.devices.imu import StreamedImu
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.records import open_log
from calstation.results import History, resolve
from calstation.runs import closing, execute
from calstation.runs import run as run_module
from calstation.runs.closing import start_reports
from calstation.runs.preparation import PreparedRun
from calstation.sequencer import (
    Command,
    Control,
    Event,
    Fault,
    Finalized,
    Message,
    StageStarted,
    StateChanged,
    StepStarted,
)
from tests.helpers import raises_code
from tests.site_folder import SiteFolder

SERIALS = ("SN-000001", "SN-000002", "SN-000003")
ORIENTATIONS = ("+x+z", "-y+z", "+z-x")


def batch_of(site: SiteFolder, *stages: str, serials: tuple[str, ...] = SERIALS) -> RunRequest:
    """Return a request for units on one table."""
    first = next(filter(None, serials))
    return replace(site.request(*stages, serial=first), serials=serials, batch="B-1")


def run_batch(
    site: SiteFolder, request: RunRequest, on_event: Callable[[Event], None] = lambda event: None
) -> dict[str, Finalized]:
    """Run a batch in this process and return the verdicts by slot."""

    def emit(event: Event) -> None:
        site.events.append(event)
        on_event(event)

    execute(request, emit, site.control, site.hooks)
    return {ended.slot: ended for ended in site.events_of(Finalized)}


@pytest.mark.long
def test_units_in_three_orientations_pass_and_re_solve_bit_identically(site_folder: SiteFolder) -> None:
    slots = [
        {"name": f"{name}{number}", "orientation": orientation}
        for number, (name, orientation) in enumerate(zip("ABC", ORIENTATIONS, strict=True), 1)
    ]
    site_folder.write_station(slots=slots, bench={"units": 3})
    verdicts = run_batch(site_folder, batch_of(site_folder))
    assert list(verdicts) == ["A1", "B2", "C3"]
    assert [ended.result["unit"]["serial"] for ended in verdicts.values()] == list(SERIALS)
    values = []
    for slot, ended in verdicts.items():
        result = ended.result
        assert ended.verdict.passed, [check for check in result["checks"] if check["passed"] is False]
        assert (result["batch"], result["slot"]) == ("B-1", slot)
        assert result["registers"]["verified"] is True
        assert json.loads(Path(ended.result_file).read_text(encoding="utf-8")) == result
        log = open_log(Path(ended.log))
        assert log.results == [result]
        assert {event.get("slot", slot) for event in log.events} == {slot}
        again = resolve(Path(ended.log)).result.to_json()
        assert again["parameters"] == result["parameters"]
        assert (again["batch"], again["slot"]) == ("B-1", slot)
        values.append(result["parameters"]["gyro_scale_x"]["value"])
    assert len(set(values)) == 3
    assert [record.slot for record in History(site_folder.folder / "runs").of(SERIALS[1])] == ["B2"]


@pytest.mark.exhaustive
def test_result_of_the_first_unit_does_not_depend_on_the_batch(tmp_path: Path) -> None:
    results = []
    for serials in (("SN-000001", "", ""), SERIALS):
        folder = tmp_path / str(len(results))
        folder.mkdir()
        site = SiteFolder(folder)
        site.write(units=3)
        results.append(run_batch(site, batch_of(site, "six_position", serials=serials))["1"].result)
    assert results[0]["parameters"] == results[1]["parameters"]


@pytest.mark.long
def test_unit_that_stops_sending_does_not_affect_the_others(site_folder: SiteFolder) -> None:
    orders = [{"order": "silence_imu", "value": 1e6, "at": 60.0, "unit": 2}]
    site_folder.write(units=3, orders=orders)
    verdicts = run_batch(site_folder, batch_of(site_folder, "six_position"))
    assert {slot: ended.verdict for slot, ended in verdicts.items()} == {"1": "partial", "2": "fault", "3": "partial"}
    (fault,) = site_folder.events_of(Fault)
    assert fault.slot == "2"
    assert [message.slot for message in site_folder.events_of(Message) if message.id == "unit_left"] == ["2"]
    assert verdicts["2"].result["error_code"] == fault.code
    assert open_log(Path(verdicts["2"].log)).outcome == "fault"
    order = [event.slot for event in site_folder.events_of(Finalized)]
    assert order[0] == "2"


def refuse(monkeypatch: pytest.MonkeyPatch, *refused: str) -> None:
    """Make units with these serial numbers unresponsive; the fault reports the serial number as the port."""
    opened = devices.open_imu

    def open_imu(setup: RunConfiguration, port: str) -> StreamedImu:
        if setup.request.serial in refused:
            raise DeviceFaultError("connection.refused", port=setup.request.serial, unit=1, exception=2)
        return opened(setup, port)

    monkeypatch.setattr(devices, "open_imu", open_imu)


@pytest.mark.long
def test_unresponsive_unit_is_removed_immediately(site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    site_folder.write(units=3)
    refuse(monkeypatch, SERIALS[2])
    verdicts = run_batch(site_folder, batch_of(site_folder, "six_position"))
    assert {slot: ended.verdict for slot, ended in verdicts.items()} == {"1": "partial", "2": "partial", "3": "fault"}
    kinds = [type(event) for event in site_folder.events]
    assert kinds.index(Finalized) < kinds.index(StateChanged)  # before anything is driven
    (fault,) = site_folder.events_of(Fault)
    assert (fault.slot, fault.code) == ("3", "connection.refused")
    assert [message.slot for message in site_folder.events_of(Message) if message.id == "unit_left"] == ["3"]


def test_each_unit_has_its_own_fault_if_none_responds(site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    site_folder.write(units=2)
    refuse(monkeypatch, *SERIALS)
    verdicts = run_batch(site_folder, batch_of(site_folder, "six_position", serials=SERIALS[:2]))
    assert [ended.verdict for ended in verdicts.values()] == ["fault", "fault"]
    faults = [(fault.slot, fault.values["port"]) for fault in site_folder.events_of(Fault)]
    assert faults == [("1", SERIALS[0]), ("2", SERIALS[1])]
    for ended, serial in zip(verdicts.values(), SERIALS, strict=False):
        assert serial in ended.result["error"]


def test_stop_ends_a_batch_while_its_units_are_opened(site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    site_folder.write(units=3)
    opened, read = [], run_module._registers

    def registers(imu: Imu, setup: RunConfiguration) -> dict[str, float]:
        opened.append(setup.request.serial)
        site_folder.control.send(Command.STOP)
        return read(imu, setup)

    monkeypatch.setattr(run_module, "_registers", registers)
    verdicts = run_batch(site_folder, batch_of(site_folder, "six_position"))
    assert opened == [SERIALS[0]]
    assert {slot: ended.verdict for slot, ended in verdicts.items()} == dict.fromkeys("123", "stopped")
    assert all(open_log(Path(ended.log)).outcome == "stopped" for ended in verdicts.values())
    assert site_folder.events_of(Fault) == []


@pytest.mark.long
def test_configuration_error_affects_only_its_unit(site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    site_folder.write(units=2)
    read = run_module._registers

    def registers(imu: Imu, setup: RunConfiguration) -> dict[str, float]:
        if setup.request.serial == SERIALS[1]:
            raise ConfigurationError("log.not_created", file="x.h5", reason="no space")
        return read(imu, setup)

    monkeypatch.setattr(run_module, "_registers", registers)
    verdicts = run_batch(site_folder, batch_of(site_folder, "six_position", serials=SERIALS[:2]))
    assert {slot: ended.verdict for slot, ended in verdicts.items()} == {"1": "partial", "2": "fault"}
    assert verdicts["2"].result["error_code"] == "log.not_created"


@pytest.mark.long
@pytest.mark.parametrize("error", [ConfigurationError("log.not_created", file="x.h5", reason="no space"), ValueError()])
def test_open_logs_are_closed_if_another_log_cannot_be_created(
    site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    site_folder.write(units=3)
    open_run = PreparedRun.open

    def open_one(unit: PreparedRun, *args: Any) -> Any:
        if unit.slot == "2":
            raise error
        return open_run(unit, *args)

    monkeypatch.setattr(PreparedRun, "open", open_one)
    with pytest.raises(type(error)):
        run_batch(site_folder, batch_of(site_folder, "six_position"))
    (ended,) = site_folder.events_of(Finalized)
    assert (ended.slot, ended.verdict) == ("1", "fault")
    assert ended.result["error_code"] == getattr(error, "code", "program.internal")
    assert open_log(Path(ended.log)).outcome == "fault"


@pytest.mark.long
def test_similar_serial_numbers_have_separate_logs(site_folder: SiteFolder) -> None:
    site_folder.write({"serial_pattern": "SN[-_]1"}, units=2)
    verdicts = run_batch(site_folder, batch_of(site_folder, "six_position", serials=("SN-1", "SN_1")))
    assert [ended.verdict for ended in verdicts.values()] == ["partial", "partial"]
    assert {Path(ended.log).stem.rpartition("_")[0] for ended in verdicts.values()} == {"SN-1_1", "SN-1_2"}


@pytest.mark.long
def test_reports_of_a_batch_are_made_sequentially_after_the_run(
    site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    site_folder.write(units=2)
    station = tomllib.loads(site_folder.station.read_text(encoding="utf-8"))
    station["report"] = {"folder": "reports"}
    site_folder.station.write_text(tomli_w.dumps(station), encoding="utf-8")
    (site_folder.station.parent / "reports").mkdir()
    started: list[tuple[list[list[str]], int]] = []

    def start(commands: Iterable[list[str]]) -> None:
        started.append((list(commands), len(site_folder.events_of(Finalized))))

    monkeypatch.setattr(run_module, "start_reports", start)
    verdicts = run_batch(site_folder, batch_of(site_folder, "six_position", serials=SERIALS[:2]))
    ((commands, verdicts_before),) = started
    assert verdicts_before == 2
    assert [command[4] for command in commands] == [ended.result_file for ended in verdicts.values()]


def test_failed_report_does_not_prevent_the_next_one(tmp_path: Path) -> None:
    written = tmp_path / "written"
    second = [sys.executable, "-c", f"import pathlib; pathlib.Path({str(written)!r}).write_text('x')"]
    start_reports([[sys.executable, "-c", "raise SystemExit(2)"], [], second])
    process = closing._started.pop()
    assert process.wait(60) == 0
    assert written.exists()


def test_stop_ends_all_units(site_folder: SiteFolder) -> None:
    site_folder.write(units=2)
    stop = site_folder.once(StepStarted, Command.STOP, after=2)
    verdicts = run_batch(site_folder, batch_of(site_folder, "six_position", serials=SERIALS[:2]), stop)
    assert [ended.verdict for ended in verdicts.values()] == ["stopped", "stopped"]


@pytest.mark.long
def test_unit_of_a_stopped_batch_is_resumed_alone_in_its_slot(site_folder: SiteFolder) -> None:
    slots = [{"name": "A"}, {"name": "B", "orientation": "-y+z"}]
    site_folder.write_station(slots=slots, bench={"units": 2})
    stages, serials = ("rate", "six_position"), SERIALS[:2]
    at_second_stage = site_folder.once(StageStarted, Command.STOP, after=1)
    stopped = run_batch(site_folder, batch_of(site_folder, *stages, serials=serials), at_second_stage)
    assert [ended.verdict for ended in stopped.values()] == ["stopped", "stopped"]
    site_folder.events.clear()
    site_folder.control = Control()
    resumed = replace(site_folder.request(*stages, serial=serials[1]), resume=Path(stopped["B"].log))
    (ended,) = run_batch(site_folder, resumed).values()
    assert ended.verdict.passed, [check for check in ended.result["checks"] if check["passed"] is False]
    assert (ended.result["slot"], ended.result["batch"]) == ("B", "B-1")
    assert resolve(Path(ended.log)).result.to_json()["parameters"] == ended.result["parameters"]


@pytest.mark.exhaustive
def test_lever_arms_in_different_slots_are_not_compared(site_folder: SiteFolder) -> None:
    slots = [{"name": name, "lever_m": [lever, 0.0, 0.0]} for name, lever in (("A", 0.15), ("B", -0.15))]
    site_folder.write_station(slots=slots, bench={"units": 2})
    product = tomllib.loads(site_folder.product.read_text(encoding="utf-8"))
    product["checks"] = {"previous": {"change_within": {"outer_lever": 0.01, "gyro_scale": 1e-3}}}
    site_folder.product.write_text(tomli_w.dumps(product), encoding="utf-8")
    compared, levers = [], []
    for serials in ((SERIALS[0], ""), ("", SERIALS[0])):
        site_folder.events.clear()
        (ended,) = run_batch(site_folder, batch_of(site_folder, "excitation", serials=serials)).values()
        checks = {check["name"]: check["passed"] for check in ended.result["checks"]}
        compared.append({name: passed for name, passed in checks.items() if name.startswith("previous")})
        levers.append(ended.result["parameters"]["outer_lever_x"]["value"])
    assert levers[0] - levers[1] == pytest.approx(0.3, abs=0.01)
    assert compared == [{}, {"previous gyro_scale": True}]


@pytest.mark.long
def test_a_fault_of_the_table_ends_all_units(site_folder: SiteFolder) -> None:
    site_folder.write(units=2, orders=[{"order": "drive_fault", "at": 60.0}])
    verdicts = run_batch(site_folder, batch_of(site_folder, "six_position", serials=SERIALS[:2]))
    assert [ended.verdict for ended in verdicts.values()] == ["fault", "fault"]
    assert [fault.slot for fault in site_folder.events_of(Fault)] == [""]


@pytest.mark.parametrize(
    ("serials", "code"),
    [
        (("SN-000001", "SN-000001"), "batch.serial_twice"),
        (("SN-000001", "SN-000002", "SN-000003", "SN-000004"), "batch.more_than_slots"),
        (("SN-000001", "nonsense"), "product.serial_mismatch"),
    ],
)
def test_incompatible_units_are_refused_as_a_batch(site_folder: SiteFolder, serials: Any, code: str) -> None:
    site_folder.write(units=3)
    with raises_code(ConfigurationError, code):
        run_batch(site_folder, batch_of(site_folder, serials=serials))
    assert site_folder.events == []
