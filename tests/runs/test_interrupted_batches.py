"""Interrupted runs of a batch are resumed together, in their slots, after what all of them have completed."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from calstation.bench import BenchConfig
from calstation.bench.live import LiveBench
from calstation.config import RunRequest, load_configuration
from calstation.devices.imu import TransferOutcome, TransferStep
from calstation.errors import ConfigurationError, InputError
from calstation.messages import Language, sentence
from calstation.records import Verdict, open_log
from calstation.registers import journal
from calstation.results import History, load_result
from calstation.runs import RunStart, find_interrupted, find_resumable, finish_incomplete
from calstation.runs import run as run_module
from calstation.runs.incomplete import close_incomplete
from calstation.runs.interrupted import Interrupted
from calstation.runs.resume import Completed, Continuation, Resumable, completed_by_all
from calstation.sequencer import LastSample, State, StopRequested
from calstation.simulation import bench_config
from tests.dead_logs import NOW, write_dead_log
from tests.helpers import ignore_progress, raises_code
from tests.open_transfers import write_open_transfer
from tests.runs.test_batch_runs import SERIALS, batch_of
from tests.site_folder import SiteFolder

STATION = "test bench"


@pytest.fixture
def batch(site_folder: SiteFolder) -> SiteFolder:
    """A station with three slots, and the logs of a batch of three units that were killed in the second stage."""
    site_folder.write(units=3)
    write_batch(site_folder, {"1": 1, "2": 1, "3": 1})
    return site_folder


def write_batch(site_folder: SiteFolder, solved: Mapping[str, int]) -> dict[str, Path]:
    """Write the logs of a batch with the number of solved stages by slot; return them by slot."""
    run = {"batch": "B-7", "batch_units": list(SERIALS), "station": STATION, "seed": 5}
    logs = {
        slot: write_dead_log(site_folder.runs, f"SN-00000{slot}", count, slot=slot, **run)
        for slot, count in solved.items()
    }
    finish_incomplete(site_folder.runs)
    History(site_folder.runs).refresh()
    return logs


def offered(site_folder: SiteFolder) -> list[tuple[list[str], dict[str, str]]]:
    """Return the units that can be resumed together and the reasons of the others, for every offer."""
    found = find_interrupted(ignore_progress, site_folder.runs, STATION)
    return [([run.serial for run in each.runs], dict(each.others)) for each in found]


def test_units_of_a_killed_batch_are_offered_together(batch: SiteFolder) -> None:
    assert offered(batch) == [(list(SERIALS), {})]
    (closed,) = batch.runs.glob("SN-000002*.h5")
    close_incomplete(closed)
    assert offered(batch) == [([SERIALS[0], SERIALS[2]], {SERIALS[1]: "closed"})]
    assert find_interrupted(ignore_progress, batch.runs, "another") == []


def test_units_that_did_not_get_as_far_are_named(site_folder: SiteFolder) -> None:
    """The process may die between the solutions of a stage of two units."""
    site_folder.write(units=3)
    write_batch(site_folder, {"1": 2, "2": 1, "3": 0})
    assert offered(site_folder) == [(list(SERIALS[:2]), {SERIALS[2]: "nothing_completed"})]


def test_units_that_have_passed_since_are_named_with_this_verdict(site_folder: SiteFolder) -> None:
    """Whatever their runs in the batch had completed."""
    site_folder.write(units=3)
    write_batch(site_folder, {"1": 0, "2": 2, "3": 1})
    for serial in SERIALS[:2]:
        log = write_dead_log(site_folder.runs, serial, 2, hours_ago=0.5, station=STATION)
        finish_incomplete(site_folder.runs)
        file = log.with_suffix(".json")
        file.write_text(json.dumps({**json.loads(file.read_text("utf-8")), "outcome": "passed"}), "utf-8")
        log.unlink()
    History(site_folder.runs).refresh()
    assert offered(site_folder) == [([SERIALS[2]], dict.fromkeys(SERIALS[:2], "passed"))]


UNIT = SERIALS[0]


def write_transfer(
    site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch, hours_ago: float, *steps: TransferStep, closing: str = ""
) -> None:
    """Write a transfer to a unit into the journal of its registers."""
    utc = (NOW - timedelta(hours=hours_ago)).isoformat()
    with monkeypatch.context() as context:
        context.setattr(journal, "_now", lambda: utc)
        entry = write_open_transfer(site_folder.runs, UNIT, *steps)
    if closing:
        entry.close(TransferOutcome(closing))


@pytest.mark.parametrize(
    ("hours_ago", "steps", "closing", "resumed"),
    [
        (0.5, (TransferStep.WRITTEN, TransferStep.COMMITTING), "", False),
        (
            0.5,
            (TransferStep.WRITTEN, TransferStep.COMMITTING, TransferStep.COMMITTED, TransferStep.RESTARTED),
            "done",
            False,
        ),
        (
            0.5,
            (TransferStep.COMMITTING, TransferStep.RESTORING, TransferStep.COMMITTED, TransferStep.RESTARTED),
            "restored",
            False,
        ),
        (0.5, (TransferStep.WRITTEN, TransferStep.COMMITTING), "kept", True),
        (2.0, (TransferStep.WRITTEN, TransferStep.COMMITTING), "", True),
    ],
    ids=["interrupted", "done", "restored", "kept", "before the run"],
)
def test_run_is_not_resumed_after_registers_were_written_since_its_start(
    site_folder: SiteFolder,
    monkeypatch: pytest.MonkeyPatch,
    hours_ago: float,
    steps: Sequence[TransferStep],
    closing: str,
    *,
    resumed: bool,
) -> None:
    log = write_dead_log(site_folder.runs, UNIT, solved=2, station=STATION, seed=5)
    write_transfer(site_folder, monkeypatch, hours_ago, *steps, closing=closing)
    finish_incomplete(site_folder.runs)
    assert load_result(log.with_suffix(".json")).advice == ("resume" if resumed else "repeat")
    assert [run.log for run in find_resumable(ignore_progress, site_folder.runs)] == [log] * resumed
    start = RunStart(replace(site_folder.request(serial=UNIT), product=None), "operator")
    asked = []
    while (question := start.next_question()) is not None:
        asked.append(question.subject)
        start.answer(question, question.answers[-1])
    assert ("resume" in asked) is resumed
    if resumed:
        assert Continuation.of(site_folder.request(serial=UNIT), log).finished
    else:
        with raises_code(ConfigurationError, "run.registers_changed"):
            Continuation.of(site_folder.request(serial=UNIT), log)


def test_latest_run_that_can_be_resumed_is_offered(site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    """An earlier run may have completed more, but the unit has new registers since, or was taken out of its slot."""
    runs = site_folder.runs
    write_dead_log(runs, UNIT, solved=2, hours_ago=5.0)
    write_transfer(site_folder, monkeypatch, 4.5, TransferStep.COMMITTING, closing="restored")
    first = write_dead_log(runs, UNIT, hours_ago=4.0)
    assert [run.log for run in find_resumable(ignore_progress, runs)] == [first]
    more = write_dead_log(runs, UNIT, solved=2, hours_ago=3.0)
    again = write_dead_log(runs, UNIT, hours_ago=2.0)
    assert [run.log for run in find_resumable(ignore_progress, runs)] == [again]
    again.unlink()
    write_dead_log(runs, UNIT, hours_ago=2.0, resumed_from=more.name)
    assert [run.log for run in find_resumable(ignore_progress, runs)] == [more], "its log was being copied"


def test_units_in_whose_place_another_was_calibrated_later_are_known(batch: SiteFolder) -> None:
    def unloaded() -> set[str]:
        (found,) = [each for each in find_interrupted(ignore_progress, batch.runs, STATION) if len(each.runs) == 3]
        assert [run.serial for run in found.on_table.runs] == [s for s in SERIALS if s not in found.unloaded]
        assert found.on_table.others == tuple((s, "not_loaded") for s in SERIALS if s in found.unloaded)
        return set(found.unloaded)

    for hours_ago, station in ((2.0, STATION), (0.5, "another")):
        write_dead_log(batch.runs, "SN-000009", 0, hours_ago=hours_ago, slot="2", station=station)
    assert unloaded() == set()
    write_dead_log(batch.runs, "SN-000009", 0, hours_ago=0.2, slot="2", station=STATION)
    assert unloaded() == {SERIALS[1]}


def test_scanned_units_of_an_interrupted_batch_are_resumed_in_the_order_of_their_slots(batch: SiteFolder) -> None:
    start = RunStart(batch_of(batch), "operator")
    question = start.next_question()
    assert question is not None
    assert (question.text.code, question.answers) == ("question.units_resume", ("resume", "anew"))
    assert str(question.refusal).count("--resume ") == 3
    start.answer(question, "resume")
    request = start.request
    assert (request.serials, request.batch) == (SERIALS, "B-7")
    assert [log.name[:9] for log in request.resumes] == list(SERIALS)
    assert request.resume == request.resumes[0]
    units = Continuation.of_all(request)
    assert [(unit.request.serial, unit.request.slot, unit.finished) for unit in units] == [
        (serial, slot, ("rate",)) for serial, slot in zip(SERIALS, "123", strict=True)
    ]
    assert {unit.request.batch_units for unit in units} == {SERIALS}


def test_unit_in_another_slot_is_not_resumed_and_named(batch: SiteFolder) -> None:
    start = RunStart(batch_of(batch, serials=(SERIALS[0], "SN-000009", SERIALS[1])), "operator")
    question = start.next_question()
    assert question is not None
    text = str(question.text)
    assert "SN-000001 was interrupted in stage 2" in text
    assert "Is this unit still in slot 1, untouched?" in text
    assert "这台产品还在装夹位 1 上，没有动过吗？" in sentence(question.text, "zh_CN")
    for words in (
        "SN-000002 (in another slot before)",
        "SN-000003 (not in the slot now)",
        "SN-000009 (not in the inter",
    ):
        assert words in text
    start.answer(question, "resume")
    assert start.request.serials == (SERIALS[0], "", "")
    request = start.request
    swapped = replace(request, serial=SERIALS[0], serials=("", SERIALS[0]))
    with raises_code(ConfigurationError, "run.other_slot"):
        Continuation.of_all(swapped)


def test_units_that_were_all_moved_are_not_resumed(batch: SiteFolder) -> None:
    start = RunStart(batch_of(batch, serials=(SERIALS[1], SERIALS[0])), "operator")
    question = start.next_question()
    assert question is not None
    assert (question.text.code, question.answers) == ("question.units_in_other_slots", ("anew",))
    start.answer(question, "anew")
    assert start.next_question() is None
    assert start.request.resumes == ()


def test_logs_name_the_units_and_slots_of_a_batch(batch: SiteFolder) -> None:
    logs = sorted(batch.runs.glob("*.h5"), reverse=True)
    request = RunRequest("", batch.station, batch.product, resume=logs[0], resumes=tuple(logs))
    assert RunStart(request, "engineer").request.serials == SERIALS
    with raises_code(ConfigurationError, "run.same_slot"):
        RunStart(replace(request, resumes=(logs[0], logs[0])), "engineer")
    for serials in (SERIALS[:2], (*SERIALS[:2], "SN-000009")):
        with raises_code(ConfigurationError, "batch.resume"):
            RunStart(replace(request, serials=serials), "engineer")
    with raises_code(ConfigurationError, "batch.resume"):
        RunStart(replace(request, serials=SERIALS[:2], resumes=()), "engineer")
    assert (
        RunStart(replace(request, serials=SERIALS[1:2], resumes=logs[1:2]), "engineer").request.serials[1] == SERIALS[1]
    )
    batch.write(units=2)
    with raises_code(ConfigurationError, "run.no_slot"):
        RunStart(request, "engineer")


def test_logs_of_different_batches_are_not_resumed_together(batch: SiteFolder) -> None:
    run = {"batch": "B-8", "batch_units": ["SN-000009"], "station": STATION, "seed": 5, "slot": "2"}
    other = write_dead_log(batch.runs, "SN-000009", **run)
    (first,) = batch.runs.glob("SN-000001*.h5")
    with raises_code(ConfigurationError, "run.other_batch"):
        RunStart(RunRequest("", batch.station, batch.product, resume=first, resumes=(first, other)), "engineer")


def test_noise_of_the_bench_differs_in_every_part_of_a_run(site_folder: SiteFolder) -> None:
    """The same noise in two parts would count twice, and fail the tests of the fit."""
    site_folder.write(units=1)
    run = {"batch": "B-7", "batch_units": [SERIALS[0]], "station": STATION, "seed": 5, "slot": "1"}
    log = write_dead_log(site_folder.runs, SERIALS[0], **run)
    earlier = log.rename(log.with_stem("earlier"))
    write_dead_log(site_folder.runs, SERIALS[0], resumed_from=earlier.name, **run)
    for path, interruptions in ((earlier, 1), (log, 2)):
        setup = load_configuration(replace(site_folder.request(serial=SERIALS[0]), resume=path, seed=5))
        assert bench_config(setup)["interruptions"] == interruptions
    first, second = (LiveBench(BenchConfig(interruptions=count, flash_file=None), lambda: 0.0) for count in (0, 1))
    np.testing.assert_array_equal(first.truth.imu.parameters, second.truth.imu.parameters)
    assert first._random.random() != second._random.random()


PLANNED = ("temperature",)


def completed(*temperatures: int, stages: tuple[str, ...] = ()) -> Completed:
    return Completed(PLANNED, stages, {"temperature": frozenset(temperatures)})


def test_units_continue_after_the_last_temperature_that_all_have_completed() -> None:
    first, second = completed(1, 2, 3), completed(1, 2)
    assert second.is_near(first)
    assert completed_by_all([first, second]).amount == (0, 2)
    assert not completed(1).is_near(first)
    solved = completed(1, 2, 3, stages=PLANNED)
    assert first.is_near(solved)
    assert completed_by_all([solved, first]).amount == (0, 3)
    assert not completed(1).is_near(solved)


def evaluation(serial: str) -> Any:
    """Return a mock of the evaluation of a unit whose run is open."""
    run = Mock(serial=serial, chain=Mock(solutions=[]))
    return Mock(run=run)


@pytest.fixture
def evaluations(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Evaluations of three units whose runs are resumed."""
    monkeypatch.setattr(run_module, "unit_task", Mock())
    return [evaluation(serial) for serial in SERIALS]


def test_unit_whose_log_cannot_be_continued_leaves_the_resumed_batch(
    evaluations: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def resume(run: Any) -> LastSample:
        if run.serial == SERIALS[1]:
            raise InputError("run.samples_missing", path="x.h5", stage="rate")
        return LastSample(10, 0.1, 3)

    monkeypatch.setattr(run_module, "_resume", resume)
    slots = run_module._slots(evaluations)
    assert [slot.evaluation for slot in slots] == [evaluations[0], evaluations[2]]
    for slot in slots:
        slot.imu.read.assert_called_once()  # the samples received meanwhile
    (end,) = evaluations[1].ended.call_args.args
    assert (end.state, end.error.code) == (State.FAULT, "run.samples_missing")
    left = evaluations[1].run.emit.call_args_list[0].args[0]
    assert (left.id, left.values["serial"]) == ("unit_left", SERIALS[1])


def test_stop_while_logs_are_copied_ends_all_units(evaluations: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def resume(run: Any) -> LastSample:
        if run.serial == SERIALS[1]:
            raise StopRequested
        return LastSample(10, 0.1, 3)

    monkeypatch.setattr(run_module, "_resume", resume)
    assert run_module._slots(evaluations) == []
    assert [each.ended.call_args.args[0].state for each in evaluations] == [State.STOPPED] * 3


@pytest.mark.parametrize(("language", "transfer"), [("en", "stage 3, transfer"), ("zh_CN", "第 3 阶段（写入寄存器）")])
def test_question_names_the_stage_after_the_completed_ones(language: Language, transfer: str) -> None:
    planned = ("rate", "azimuth_flip")
    begun = ("SN-1", Path("a.h5"), "2026-01-01T08:00:00+00:00", 1, None, None, None)
    for count, stage in ((0, "rate"), (1, "azimuth_flip"), (2, "transfer")):
        run = Resumable(*begun, Completed(planned, planned[:count], {}), Verdict.STOPPED, "")
        question = Interrupted((run,)).question(())
        assert question.values["stage"] == stage
    assert transfer in sentence(question, language).lower()


@pytest.mark.parametrize("slot", [None, "A"])
@pytest.mark.parametrize(
    ("language", "text"),
    [("en", " as MEMS grade C, Tight. Is this unit"), ("zh_CN", "，产品型号“MEMS grade C、Tight”。这台产品")],
)
def test_question_names_products_that_are_not_chosen(language: Language, text: str, slot: str | None) -> None:
    begun = ("SN-1", Path("a.h5"), "2026-01-01T08:00:00+00:00", 1)
    run = Resumable(*begun, "MEMS grade C", None, None, Completed(PLANNED, (), {}), Verdict.STOPPED, "", slot=slot)
    asked = Interrupted((run, replace(run, product="Tight")) if slot is None else (run,))
    if slot is not None:
        text = text.replace(", Tight", "").replace("、Tight", "")
    assert text in sentence(asked.question(["Short"]), language)
    assert "MEMS" not in sentence(asked.question(["Short", "Tight", "MEMS grade C"]), language)


def test_simulated_run_is_not_offered_at_a_station_with_hardware(site_folder: SiteFolder) -> None:
    log = write_dead_log(site_folder.runs, station=STATION, seed=5)
    finish_incomplete(site_folder.runs)
    assert open_log(log).meta.is_simulated
    assert [run.log for each in find_interrupted(ignore_progress, site_folder.runs, STATION) for run in each.runs] == [
        log
    ]
    assert find_interrupted(ignore_progress, site_folder.runs, STATION, measured=True) == []
    assert find_resumable(ignore_progress, site_folder.runs, STATION, measured=True) == []
