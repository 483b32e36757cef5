"""Several units on one table: each has its own log, result and verdict, and none is held up by another."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from calstation.config.request import RunRequest
from calstation.errors import ConfigurationError
from calstation.records.log import open_log
from calstation.results.history import History
from calstation.results.resolving import resolve
from calstation.runs.run import execute
from calstation.sequencer.control import Command
from calstation.sequencer.events import Event, Fault, Message, StepStarted, Verdict
from tests.helpers import raises_code
from tests.site_folder import SiteFolder

SERIALS = ("SN-000001", "SN-000002", "SN-000003")
ORIENTATIONS = ("+x+z", "-y+z", "+z-x")


def batch_of(site: SiteFolder, *stages: str, serials: tuple[str, ...] = SERIALS) -> RunRequest:
    """A request for units on one table."""
    first = next(filter(None, serials))
    return replace(site.request(*stages, serial=first), serials=serials, batch="B-1")


def run_batch(
    site: SiteFolder, request: RunRequest, on_event: Callable[[Event], None] = lambda event: None
) -> dict[str, Verdict]:
    """Run a batch in this process; the verdicts by slot."""

    def emit(event: Event) -> None:
        site.events.append(event)
        on_event(event)

    execute(request, emit, site.control, site.hooks)
    return {verdict.slot: verdict for verdict in site.events_of(Verdict)}


@pytest.mark.long
def test_units_in_three_orientations_pass_and_solve_again_to_the_same_bits(site_folder: SiteFolder) -> None:
    slots = [
        {"name": f"{name}{number}", "orientation": orientation}
        for number, (name, orientation) in enumerate(zip("ABC", ORIENTATIONS, strict=True), 1)
    ]
    site_folder.write_station(slots=slots, bench={"units": 3})
    verdicts = run_batch(site_folder, batch_of(site_folder))
    assert list(verdicts) == ["A1", "B2", "C3"]
    assert [verdict.result["unit"]["serial"] for verdict in verdicts.values()] == list(SERIALS)
    values = []
    for slot, verdict in verdicts.items():
        result = verdict.result
        assert verdict.outcome == "passed", [check for check in result["checks"] if check["passed"] is False]
        assert (result["batch"], result["slot"]) == ("B-1", slot)
        assert result["registers"]["verified"] is True
        assert json.loads(Path(verdict.result_file).read_text(encoding="utf-8")) == result
        log = open_log(Path(verdict.log))
        assert log.results == [result]
        assert {event.get("slot", slot) for event in log.events} == {slot}
        again = resolve(Path(verdict.log)).result.to_json()
        assert again["parameters"] == result["parameters"]
        assert (again["batch"], again["slot"]) == ("B-1", slot)
        values.append(result["parameters"]["gyro_scale_x"]["value"])
    assert len(set(values)) == 3
    assert [record.slot for record in History(site_folder.folder / "runs").of(SERIALS[1])] == ["B2"]


def test_the_first_unit_of_a_batch_has_the_result_that_it_has_alone(tmp_path: Path) -> None:
    results = []
    for serials in (("SN-000001", "", ""), SERIALS):
        folder = tmp_path / str(len(results))
        folder.mkdir()
        site = SiteFolder(folder)
        site.write(units=3)
        results.append(run_batch(site, batch_of(site, "six_position", serials=serials))["1"].result)
    assert results[0]["parameters"] == results[1]["parameters"]


def test_a_unit_that_falls_silent_leaves_the_others_alone(site_folder: SiteFolder) -> None:
    orders = [{"order": "silence_imu", "value": 1e6, "at": 60.0, "unit": 2}]
    site_folder.write(units=3, orders=orders)
    verdicts = run_batch(site_folder, batch_of(site_folder, "six_position"))
    assert {slot: verdict.outcome for slot, verdict in verdicts.items()} == {"1": "passed", "2": "fault", "3": "passed"}
    (fault,) = site_folder.events_of(Fault)
    assert fault.slot == "2"
    assert [message.slot for message in site_folder.events_of(Message) if message.id == "unit_left"] == ["2"]
    assert verdicts["2"].result["error_code"] == fault.code
    assert open_log(Path(verdicts["2"].log)).outcome == "fault"
    order = [event.slot for event in site_folder.events_of(Verdict)]
    assert order[0] == "2"


def test_a_unit_that_does_not_answer_leaves_at_once(site_folder: SiteFolder) -> None:
    orders = [{"order": "hang_up_imu", "value": 1e6, "at": 0.0, "unit": 3}]
    site_folder.write(units=3, orders=orders)
    verdicts = run_batch(site_folder, batch_of(site_folder, "six_position"))
    assert {slot: verdict.outcome for slot, verdict in verdicts.items()} == {"1": "passed", "2": "passed", "3": "fault"}


def test_stop_ends_all_units(site_folder: SiteFolder) -> None:
    site_folder.write(units=2)
    stop = site_folder.once(StepStarted, Command.STOP, after=2)
    verdicts = run_batch(site_folder, batch_of(site_folder, "six_position", serials=SERIALS[:2]), stop)
    assert [verdict.outcome for verdict in verdicts.values()] == ["stopped", "stopped"]


def test_a_fault_of_the_table_ends_all_units(site_folder: SiteFolder) -> None:
    site_folder.write(units=2, orders=[{"order": "drive_fault", "at": 60.0}])
    verdicts = run_batch(site_folder, batch_of(site_folder, "six_position", serials=SERIALS[:2]))
    assert [verdict.outcome for verdict in verdicts.values()] == ["fault", "fault"]
    assert [fault.slot for fault in site_folder.events_of(Fault)] == [""]


@pytest.mark.parametrize(
    ("serials", "code"),
    [
        (("SN-000001", "SN-000001"), "batch.serial_twice"),
        (("SN-000001", "SN-000002", "SN-000003", "SN-000004"), "batch.more_than_slots"),
        (("SN-000001", "nonsense"), "product.serial_mismatch"),
    ],
)
def test_what_cannot_be_run_together_is_refused(site_folder: SiteFolder, serials: Any, code: str) -> None:
    site_folder.write(units=3)
    with raises_code(ConfigurationError, code):
        run_batch(site_folder, batch_of(site_folder, serials=serials))
    assert site_folder.events == []
