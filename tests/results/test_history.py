"""The history of runs is built from their files and rebuilt if its index is lost."""

import json
import os
import shutil
import sqlite3
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers import ignore_progress

from calstation.config import load_station, site_folder
from calstation.errors import InputError
from calstation.messages import Language, render
from calstation.records import (
    CheckId,
    IndexedRun,
    LogMeta,
    RawLogWriter,
    RunFilter,
    RunIndex,
    Verdict,
    acquire_lock,
    append_audit,
    audit_path,
)
from calstation.records.run_index import FILE
from calstation.registers import Purpose
from calstation.results import (
    History,
    altered_entry,
    check_runs,
    entry_text,
    load_run_result,
    override_of,
    refresh_history,
    result_doubt,
)
from calstation.results import history as history_module
from calstation.runs import find_resumable, recover_at_startup
from tests.check_rows import check_row
from tests.helpers import exchange_logs, raises_code, write_log_of
from tests.open_transfers import write_open_transfer
from tests.records.records_samples import META, make_block

#: Product of the runs that `write` writes.
PRODUCT = "Navigation grade A"


def write(folder: Path, name: str, serial: str, outcome: str, day: int, **more: Any) -> Path:
    """Write the result of a run without its log."""
    values = more.pop("values", {})
    path = folder / f"{name}.json"
    result = {
        "schema": "calstation.result/1",
        "unit": {"serial": serial},
        "stages": ["rate"],
        "parameters": {key: {"value": value, "sigma": 1.0} for key, value in values.items()},
        "outcome": outcome,
        "attempt": 1,
        "operator": "li",
        "station": "bench 1",
        "product": PRODUCT,
        "log": {"file": f"/elsewhere/{name}.h5"},
        "started_utc": f"2026-11-{day:02d}T08:00:00+00:00",
        "duration_s": 100.0,
        **more,
    }
    path.write_text(json.dumps(result), encoding="utf-8")
    return path


def refreshed(folder: Path) -> History:
    history = History(folder)
    history.refresh()
    return history


@pytest.fixture
def three(tmp_path: Path) -> Path:
    write(tmp_path, "a", "SN-1", "failed", 1, values={"gyro_bias_x": 1.0, "gyro_bias_y": 5.0})
    write(tmp_path, "b", "SN-1", "passed", 2, values={"gyro_bias_x": 2.0})
    write(tmp_path, "c", "SN-2", "stopped", 3, error="no answer")
    return tmp_path


def test_runs_are_found_latest_first(three: Path) -> None:
    history = refreshed(three)
    assert [run.log.stem for run in history.runs()] == ["c", "b", "a"]
    assert [run.log.stem for run in history.runs(RunFilter("sn-1"))] == ["b", "a"]
    assert [run.log.stem for run in history.runs(RunFilter(verdict="stopped"))] == ["c"]
    assert [run.log.stem for run in history.runs(RunFilter("SN-1", "passed"), limit=1)] == ["b"]
    assert history.runs(RunFilter("100%_")) == []
    (run,) = history.runs(RunFilter("SN-2"))
    assert (run.serial, run.verdict, run.stages, run.error) == ("SN-2", "stopped", ("rate",), "no answer")
    assert (run.log, run.result) == (three / "c.h5", three / "c.json")


def test_batch_and_slot_of_a_run_are_found_without_a_result(tmp_path: Path) -> None:
    write(tmp_path, "a", "SN-1", "passed", 1, batch="B-7", slot="A1")
    write(tmp_path, "b", "SN-2", "passed", 1)
    run = {"stages": ["rate"], "software": "0.1", "started_utc": "2026-11-03T08:00:00+00:00"}
    placed = {**META, "run": {**run, "batch": "B-7", "slot": "A2"}}
    writer = RawLogWriter(tmp_path / "x.h5", LogMeta.model_validate(placed))
    writer.append(make_block("rate", 0, 10))
    writer.flush()
    shutil.copyfile(tmp_path / "x.h5", tmp_path / "c.h5")
    writer.close("stopped")
    (tmp_path / "x.h5").unlink()
    output = refreshed(tmp_path).runs(RunFilter(batch="B-7"))
    assert [(each.log.stem, each.batch, each.slot) for each in output] == [("c", "B-7", "A2"), ("a", "B-7", "A1")]


def test_attempts_and_last_pass_of_a_unit_are_found(three: Path) -> None:
    history = refreshed(three)
    passed = history.passed_before("SN-1")
    assert passed is not None
    assert passed.started_utc == "2026-11-02T08:00:00+00:00"
    assert history.passed_before("SN-2") is None
    assert (history.attempts("SN-1"), history.attempts("SN-2"), history.attempts("SN-3")) == (2, 1, 0)


def test_passed_partial_run_does_not_count_as_a_pass(three: Path) -> None:
    for day, outcome, partial in ((4, "failed", False), (5, "passed", True), (6, "failed", True)):
        write(three, f"n{day}", "SN-1", outcome, day, partial=partial)
    write(three, "p", "SN-2", "passed", 7, partial=True)
    history = refreshed(three)
    passed = history.passed_before("SN-1")
    assert passed is not None
    assert passed.log.stem == "b"
    assert history.passed_before("SN-2") is None
    assert history.failures("SN-1", "Navigation grade A") == 2
    assert [run.log.stem for run in history.runs(RunFilter(verdict="passed"))] == ["b"]
    assert [run.log.stem for run in history.runs(RunFilter(verdict="partial"))] == ["p", "n5"]
    assert [run.verdict for run in history.runs(RunFilter("SN-2"))] == ["partial", "stopped"]
    assert [run.log.stem for run in history.passed("SN-1")] == ["n5", "b"], "a calibration may come from either"


def test_resumed_run_counts_once(three: Path) -> None:
    write(three, "d", "SN-2", "passed", 4, resumed_from="c.h5")
    assert refreshed(three).attempts("SN-2") == 1


def test_failures_are_counted_since_the_last_pass(three: Path) -> None:
    assert refreshed(three).failures("SN-1", "Navigation grade A") == 0
    for day, outcome in ((4, "failed"), (5, "stopped"), (6, "failed")):
        write(three, f"n{day}", "SN-1", outcome, day)
    assert refreshed(three).failures("SN-1", "Navigation grade A") == 2


def test_failures_are_counted_per_product(three: Path) -> None:
    write(three, "n4", "SN-1", "failed", 4)
    write(three, "n5", "SN-1", "passed", 5, product="MEMS grade C")
    history = refreshed(three)
    assert (history.failures("SN-1", "Navigation grade A"), history.failures("SN-1", "MEMS grade C")) == (1, 0)


def test_deleting_a_run_and_the_index_permits_no_further_attempt(tmp_path: Path) -> None:
    for day in (1, 2, 3):
        write(tmp_path, f"n{day}", "SN-1", "failed", day, attempt=day)
    for name in ("n1.json", "n2.json"):
        (tmp_path / name).unlink()
    assert not (tmp_path / FILE).exists()
    history = refreshed(tmp_path)
    assert (history.attempts("SN-1"), history.failures("SN-1", "Navigation grade A")) == (3, 3)
    assert history.absent_attempts("SN-1") == [(1, 2)]
    faults, gaps = check_runs(tmp_path)
    assert (faults, gaps[0].code, gaps[0].values["numbers"]) == ([], "result.attempts_absent", ["1–2"])
    write(tmp_path, "n4", "SN-1", "passed", 4, attempt=4)
    history.refresh()
    assert history.failures("SN-1", "Navigation grade A") == 0, "attempts before the last pass do not count"


def test_simulated_attempts_hide_no_removed_measured_one(tmp_path: Path) -> None:
    for attempt in (1, 2):
        write(tmp_path, f"bench{attempt}", "SN-1", "failed", attempt, attempt=attempt, simulated=True)
    write(tmp_path, "table3", "SN-1", "failed", 3, attempt=3, simulated=False)
    write(tmp_path, "bench6", "SN-1", "failed", 6, attempt=6, simulated=True)
    history, hardware = refreshed(tmp_path), History(tmp_path, measured=True)
    assert hardware.absent_attempts("SN-1") == [(1, 2)]
    assert hardware.failures("SN-1", PRODUCT) == 3
    assert history.absent_attempts("SN-1") == [(1, 2), (4, 5)]
    ((gap,), faults) = check_runs(tmp_path)[::-1]
    assert (faults, gap.values["numbers"]) == ([], ["1–2", "4–5"])


def previous_values(
    history: History, before: str | None = None, product: str = "Navigation grade A"
) -> dict[str, float]:
    return {name: each.value for name, each in history.previous("SN-1", product, before)[0].items()}


def test_previous_value_of_each_parameter_is_the_latest(three: Path) -> None:
    history = refreshed(three)
    assert previous_values(history) == {"gyro_bias_x": 2.0, "gyro_bias_y": 5.0}
    assert previous_values(history, before="2026-11-02T08:00:00+00:00") == {
        "gyro_bias_x": 1.0,
        "gyro_bias_y": 5.0,
    }
    assert history.previous("SN-9", "Navigation grade A") == ({}, "")


def test_previous_values_are_those_of_the_same_product(three: Path) -> None:
    write(three, "d", "SN-1", "passed", 3, values={"gyro_bias_x": 9.0}, product="MEMS grade C")
    write(three, "e", "SN-1", "passed", 4, values={"gyro_bias_x": 3.0})
    history = refreshed(three)
    found, started = history.previous("SN-1", "Navigation grade A", "2026-11-04T08:00:00+00:00")
    assert {name: each.value for name, each in found.items()} == {"gyro_bias_x": 2.0, "gyro_bias_y": 5.0}
    assert started == "2026-11-02T08:00:00+00:00"
    assert previous_values(history, product="MEMS grade C") == {"gyro_bias_x": 9.0}
    assert history.previous("SN-1", "tactical") == ({}, "")
    assert [run.name for run in history.solved("SN-1", "MEMS grade C", 30)] == ["d"]
    assert "d" not in [run.name for run in history.solved("SN-1", "Navigation grade A", 30)]


def test_runs_without_files_are_attempts_and_failures(three: Path) -> None:
    """Deleting the files of failed runs permits no further attempts."""
    for day in (4, 5):
        write(three, f"n{day}", "SN-1", "failed", day)
    history = refreshed(three)
    assert (history.attempts("SN-1"), history.failures("SN-1", "Navigation grade A")) == (4, 2)
    for name in ("n4", "n5", "b"):
        (three / f"{name}.json").unlink()
    history = refreshed(three)
    assert [run.badge for run in history.runs(RunFilter("SN-1", missing=True))] == ["missing"] * 3
    assert (history.attempts("SN-1"), history.failures("SN-1", "Navigation grade A")) == (4, 2)
    passed = history.passed_before("SN-1")
    assert passed is not None
    assert passed.missing
    assert [run.log.stem for run in history.of("SN-1")] == ["a"]


def test_refresh_reads_only_changed_files(three: Path) -> None:
    history = refreshed(three)
    assert history.refresh() == 0
    write(three, "b", "SN-1", "failed", 2)
    (three / "c.json").unlink()
    assert history.refresh() == 2
    assert [run.badge for run in history.runs()] == ["altered", "failed"]


@pytest.mark.parametrize("log", ["beside", "missing", "missing, index removed"])
def test_edited_result_does_not_turn_a_failure_into_a_pass(tmp_path: Path, log: str) -> None:
    """The verdict is that of the log, or that of the index if the log is missing; without both nothing is known."""
    path = write(tmp_path, "a", "SN-1", "failed", 1)
    write_log_of(path)
    history = refreshed(tmp_path)
    (run,) = history.runs()
    assert (run.badge, run.altered) == ("failed", False)
    if log != "beside":
        run.log.unlink()
    if log.endswith("removed"):
        (tmp_path / "history.sqlite").unlink()
    write(tmp_path, "a", "SN-2", "passed", 1, attempt=7, released_by="nobody")
    history = refreshed(tmp_path)
    (run,) = history.runs()
    if log.endswith("removed"):
        assert run.badge == "passed"
        return
    assert (run.badge, run.verdict, run.serial, run.attempt) == ("altered", "failed", "SN-1", 1)
    assert (history.attempts("SN-1"), history.attempts("SN-2"), history.failures("SN-1", "Navigation grade A")) == (
        1,
        0,
        1,
    )
    if log == "beside":
        with raises_code(InputError, "result.altered"):
            history.result(run)
        faults, gaps = check_runs(tmp_path)
        assert ([each.code for each in faults], gaps) == (["result.altered"], [])


def test_edited_result_stays_altered_after_its_log_has_been_removed(tmp_path: Path) -> None:
    path = write(tmp_path, "a", "SN-1", "failed", 1)
    original = path.read_bytes()
    write_log_of(path)
    write(tmp_path, "a", "SN-1", "passed", 1)
    (run,) = refreshed(tmp_path).runs()
    assert (run.badge, run.verdict) == ("altered", "failed")
    run.log.unlink()
    for content, badge in ((path.read_bytes() + b"\n", "altered"), (original, "failed")):
        path.write_bytes(content)
        (run,) = refreshed(tmp_path).runs()
        assert (run.badge, run.verdict) == (badge, "failed")


def test_result_that_a_log_without_a_result_contradicts_is_altered(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    meta = LogMeta.model_validate(META)
    writer = RawLogWriter(path, meta)
    writer.append(make_block("rate", 0, 10))
    writer.close("incomplete")
    write(tmp_path, "a", "SN-1", "passed", 1)
    (run,) = refreshed(tmp_path).runs()
    assert (run.badge, run.verdict, run.serial) == ("altered", "incomplete", meta.imu.serial)


def test_passed_result_is_unconfirmed_if_its_log_was_not_closed(tmp_path: Path) -> None:
    """The disk failed when the run ended: the log has neither a result nor an end."""
    writer = RawLogWriter(tmp_path / "x.h5", LogMeta.model_validate(META))
    writer.append(make_block("rate", 0, 10))
    writer.flush()
    (tmp_path / "runs").mkdir()
    shutil.copyfile(tmp_path / "x.h5", tmp_path / "runs" / "a.h5")
    writer.close("stopped")
    write(tmp_path / "runs", "a", "SN-1", "passed", 1)
    history = refreshed(tmp_path / "runs")
    (run,) = history.runs()
    assert (run.badge, run.verdict) == ("unconfirmed", "incomplete")
    with raises_code(InputError, "result.unconfirmed"):
        history.result(run)
    run.log.unlink()
    assert [each.badge for each in refreshed(tmp_path / "runs").runs()] == ["unconfirmed"]


def test_exchanged_logs_are_named_instead_of_the_unchanged_result_files(tmp_path: Path) -> None:
    paths = [write(tmp_path, name, f"SN-{name}", "failed", day) for day, name in enumerate(("a", "b"), 1)]
    for path in paths:
        write_log_of(path)
    history = refreshed(tmp_path)
    exchange_logs(*paths)
    history.refresh()
    history.compare_logs()
    assert [run.badge for run in history.runs()] == ["altered", "altered"]
    faults, _ = check_runs(tmp_path)
    assert [(each.code, each.values["log"], each.values["serial"], each.values["run"]) for each in faults] == [
        ("result.log_of_other", tmp_path / "a.h5", "SN-b", "b"),
        ("result.log_of_other", tmp_path / "b.h5", "SN-a", "a"),
    ]
    with raises_code(InputError, "result.log_of_other"):
        load_run_result(paths[0])
    exchange_logs(*paths)
    history.compare_logs()
    assert [run.badge for run in history.runs()] == ["failed", "failed"]


@pytest.mark.parametrize("log", [None, 3, {}, {"file": "/b.h5"}])
def test_stored_result_without_the_path_of_its_log_is_compared(log: Any) -> None:
    stored = {"outcome": "failed", "log": {"file": "/a.h5"}}
    other = {"outcome": "failed"} if log is None else {"outcome": "failed", "log": log}
    expected = None if isinstance(log, dict) else "log"
    assert (altered_entry(stored, other), altered_entry(other, stored)) == (expected, expected)


@pytest.mark.parametrize(
    ("language", "said"),
    [
        ("en", "(entry passed: false in the log, true in the file)."),
        ("zh_CN", "（条目 passed：数据记录中为 false，文件中为 true）。"),
    ],
)
def test_changed_entry_is_named_with_its_values(tmp_path: Path, language: Language, said: str) -> None:
    path = write(tmp_path, "a", "SN-1", "failed", 1, passed=False)
    write_log_of(path)
    write(tmp_path, "a", "SN-1", "failed", 1, passed=True)
    with raises_code(InputError, "result.altered") as caught:
        load_run_result(path)
    assert said in render("result.altered", caught.value.values, language).text
    assert entry_text("parameters.gyro_bias_x", {}, {"parameters": {"gyro_bias_x": [1]}}).code == "result.entry"


def test_decision_not_to_resume_does_not_alter_a_result(tmp_path: Path) -> None:
    path = write(tmp_path, "a", "SN-1", "failed", 1)
    write_log_of(path)
    write(tmp_path, "a", "SN-1", "failed", 1, closed_utc="2026-11-02")
    (run,) = refreshed(tmp_path).runs()
    assert (run.altered, run.closed) == (False, True)


@pytest.mark.parametrize("with_log", [True, False])
def test_release_that_the_audit_trail_does_not_record_is_no_release(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, with_log: bool
) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    path = write(tmp_path, "a", "SN-1", "failed", 1)
    if with_log:
        write_log_of(path)
    assert [run.badge for run in refreshed(tmp_path).runs()] == ["failed"]
    forged = {"by": "B0002", "why": "forged", "utc": "2026-11-02T00:00:00+00:00"}
    write(tmp_path, "a", "SN-1", "failed", 1, override=forged)
    history = refreshed(tmp_path)
    (run,) = history.runs()
    assert (run.badge, run.verdict, run.released) == ("altered", "failed", False)
    assert history.runs(RunFilter(altered=True)) == [run]
    with raises_code(InputError, "result.release_unknown"):
        history.result(run)
    doubt = result_doubt(run)
    assert doubt is not None
    assert (doubt.code, doubt.values["by"]) == ("result.release_unknown", "B0002")
    faults, _ = check_runs(tmp_path)
    assert faults == [doubt]
    event = append_audit(site_folder(), "override", "B0002", "scratch", log_sha256="")
    write(tmp_path, "a", "SN-1", "failed", 1, override=override_of(event).model_dump())
    trail = audit_path(site_folder())
    trail.rename(tmp_path / "trail")
    (run,) = refreshed(tmp_path).runs()
    assert run.badge == "altered"
    (tmp_path / "trail").rename(trail)
    history.read_again(run)
    assert [run.badge for run in history.runs()] == ["released"]
    assert check_runs(tmp_path)[0] == []


def test_simulated_runs_of_a_unit_do_not_count_at_a_station_with_hardware(tmp_path: Path) -> None:
    for attempt in (1, 2, 3):
        write(tmp_path, f"bench{attempt}", "SN-1", "passed", attempt, attempt=attempt, simulated=True)
    history, hardware = refreshed(tmp_path), History(tmp_path, measured=True)
    assert (history.attempts("SN-1"), hardware.attempts("SN-1")) == (3, 0)
    assert (history.passed_units(), hardware.passed_units()) == ({"SN-1"}, set())
    assert (hardware.passed_before("SN-1"), hardware.passed("SN-1"), hardware.of("SN-1")) == (None, [], [])
    assert history.passed_before("SN-1") is not None
    write(tmp_path, "bench4", "SN-1", "failed", 4, attempt=4, simulated=True)
    write(tmp_path, "table1", "SN-1", "passed", 5, simulated=False, values={"gyro_bias_x": 0.5})
    write(tmp_path, "bench5", "SN-1", "failed", 6, attempt=5, simulated=True, values={"gyro_bias_x": 9.0})
    history.refresh()
    assert (history.attempts("SN-1"), hardware.attempts("SN-1")) == (5, 1), "each is one more than the last of its kind"
    assert history.absent_attempts("SN-1") == hardware.absent_attempts("SN-1") == []
    assert (history.failed_last("SN-1"), hardware.failed_last("SN-1")) == (True, False)
    assert (history.failures("SN-1", PRODUCT), hardware.failures("SN-1", PRODUCT)) == (1, 0)
    assert hardware.previous("SN-1", PRODUCT)[0]["gyro_bias_x"].value == 0.5
    assert [run.simulated for run in history.runs()] == [True, False, True, True, True, True]
    assert [run.log.stem for run in hardware.runs()] == ["table1"]


@pytest.mark.parametrize("seed", [None, 5])
def test_log_of_an_earlier_version_states_whether_its_run_was_simulated(tmp_path: Path, seed: int | None) -> None:
    path = write(tmp_path, "a", "SN-1", "passed", 1)
    run = {"stages": ["rate"], "software": "0.1", "started_utc": "2026-11-03T08:00:00+00:00", "seed": seed}
    writer = RawLogWriter(path.with_suffix(".h5"), LogMeta.model_validate({**META, "run": run}))
    writer.add_result(json.loads(path.read_text("utf-8")))
    writer.close("passed")
    assert [run.simulated for run in refreshed(tmp_path).runs()] == [seed is not None]
    path.unlink()
    assert [run.simulated for run in refreshed(tmp_path).runs()] == [seed is not None]


@pytest.mark.parametrize("damage", ["delete", "garbage", "other version"])
def test_lost_index_is_rebuilt(three: Path, damage: str) -> None:
    history = refreshed(three)
    path = three / FILE
    if damage == "delete":
        path.unlink()
    elif damage == "garbage":
        path.write_bytes(b"no database at all" * 1000)
    else:
        with sqlite3.connect(path) as connection:
            connection.execute("PRAGMA user_version=99")
        connection.close()
        history = refreshed(three)
    assert len(history.runs()) == 3
    assert len(refreshed(three).runs()) == 3


def test_read_only_folder_uses_an_index_in_memory(three: Path) -> None:
    (three / FILE).mkdir()
    (three / FILE / "in the way").touch()
    assert len(refreshed(three).runs()) == 3


def test_other_files_are_ignored(three: Path) -> None:
    (three / "copy.json").write_text((three / "a.json").read_text("utf-8"), encoding="utf-8")
    write(three, "solved", "SN-1", "resolved", 9)
    (three / "list.json").write_text("[1, 2]", encoding="utf-8")
    (three / "broken.json").write_text("{", encoding="utf-8")
    (three / "broken.h5").write_bytes(b"no log")
    assert len(refreshed(three).runs()) == 3


@pytest.mark.parametrize(
    "damage",
    [
        {"parameters": 7},
        {"parameters": {"gyro_bias_x": {"value": "much"}}},
        {"attempt": float("inf")},
        {"operator": 2**70},
        {"station": "\ud800"},
        {"stages": [None, {}]},
        {"unit": "SN-1"},
        {"unit": {"serial": "SN-1\0"}},
        {"log": 3},
    ],
)
def test_damaged_result_hides_no_other_run(three: Path, damage: dict[str, Any]) -> None:
    write(three, "d", "SN-1", "passed", 4, **damage)
    history = refreshed(three)
    assert [run.log.stem for run in history.runs()] == ["c", "b", "a"]
    assert history.attempts("SN-1") == 2


def test_non_finite_values_are_ignored(three: Path) -> None:
    write(three, "d", "SN-1", "passed", 4, values={"gyro_bias_x": float("nan"), "gyro_bias_y": 7.0})
    history = refreshed(three)
    assert len(history.runs()) == 4
    assert previous_values(history) == {"gyro_bias_x": 2.0, "gyro_bias_y": 7.0}


def test_a_closed_log_without_a_result_is_an_incomplete_run(tmp_path: Path) -> None:
    log = tmp_path / "x.h5"
    writer = RawLogWriter(log, LogMeta.model_validate(META))
    writer.append(make_block("rate", 0, 100))
    writer.flush()
    history = refreshed(tmp_path)
    os.utime(log, (0.0, 0.0))
    history.refresh()
    assert history.runs() == []
    shutil.copyfile(log, tmp_path / "y.h5")
    history.refresh()
    (run,) = history.runs(RunFilter(verdict="incomplete"))
    assert (run.serial, run.log, run.result) == ("SN-7", tmp_path / "y.h5", None)
    writer.close("stopped")
    history.refresh()
    assert [run.log.stem for run in history.runs()] == ["y"]


def test_incomplete_log_with_unstorable_text_hides_no_other_run(three: Path) -> None:
    meta = LogMeta.model_validate({**META, "imu": {**META["imu"], "serial": "SN\0"}})
    writer = RawLogWriter(three / "x.h5", meta)
    writer.append(make_block("rate", 0, 10))
    writer.flush()
    shutil.copyfile(three / "x.h5", three / "d.h5")
    writer.close("stopped")
    (three / "x.h5").unlink()
    assert [run.log.stem for run in refreshed(three).runs()] == ["c", "b", "a"]


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux only")
def test_undecodable_file_name_hides_no_run(three: Path) -> None:
    write(three, "d\udcff", "SN-1", "passed", 4)
    assert len(refreshed(three).runs()) == 3


def test_refresh_without_changes_reads_no_rows(three: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    history = refreshed(three)
    mark = RunIndex(three).change_token
    other = History(three)
    other.refresh()
    monkeypatch.setattr("calstation.records.run_index._rows", lambda *_: pytest.fail("rows are read"))
    assert other.refresh() == 0
    assert RunIndex(three).change_token == mark
    monkeypatch.undo()
    write(three, "d", "SN-4", "passed", 4)
    assert history.refresh() == 1  # by another program than the one below
    assert RunIndex(three).change_token != mark
    assert other.refresh() == 0


def test_refresh_does_not_wait_for_logs_being_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writers = [RawLogWriter(tmp_path / f"u{number}.h5", LogMeta.model_validate(META)) for number in range(3)]
    writers[0].append(make_block("rate", 0, 100))
    writers[0].flush()
    shutil.copyfile(tmp_path / "u0.h5", tmp_path / "incomplete.h5")
    monkeypatch.setattr("calstation.records.files.time.sleep", lambda seconds: pytest.fail("the refresh waits"))
    history = refreshed(tmp_path)
    assert {run.log.stem for run in history.runs()} == {"incomplete"}
    with (tmp_path / "incomplete.h5").open() as tested:  # as another program does that tests the lock
        assert acquire_lock(tested.fileno(), 0.0)
        assert history.refresh() == 0
    assert {run.log.stem for run in history.runs()} == {"incomplete"}
    monkeypatch.undo()
    for writer in writers:
        writer.close("stopped")


def test_history_is_refreshed_by_a_background_job(three: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history_module, "_BATCH", 2)
    fractions: list[float] = []
    assert refresh_history(lambda fraction, *_: fractions.append(fraction), three) == 3
    assert fractions == [pytest.approx(2 / 3), 1.0]


def test_two_programs_can_share_an_index(three: Path) -> None:
    first, second = refreshed(three), History(three)
    write(three, "d", "SN-4", "passed", 4)
    assert second.refresh() == 1
    assert [run.serial for run in first.runs(limit=1)] == ["SN-4"]


def test_missing_folder_has_no_runs(tmp_path: Path) -> None:
    history = refreshed(tmp_path / "none")
    assert history.runs() == []
    assert find_resumable(ignore_progress, tmp_path / "none") == []
    assert not (tmp_path / "none").exists()


def test_startup_closes_incomplete_runs_and_delivers_results(tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    writer = RawLogWriter(runs / "x.h5", LogMeta.model_validate(META))
    writer.append(make_block("rate", 0, 100))
    writer.flush()
    (runs / "x.h5").rename(tmp_path / "going.h5")
    shutil.copyfile(tmp_path / "going.h5", runs / "x.h5")
    fractions: list[float] = []
    tidied = recover_at_startup(lambda fraction, *_: fractions.append(fraction), runs, None)
    assert tidied.incomplete == (runs / "x.h5",)
    assert (tidied.delivery.folder, tidied.delivery.done) == (tmp_path / "handover", 1)
    assert (tmp_path / "handover" / "x.json").is_file()
    assert [run.verdict for run in History(runs).runs()] == ["incomplete"]
    assert fractions == sorted(fractions)
    assert recover_at_startup(lambda *_: None, tmp_path / "none", None).incomplete == ()


def test_failed_checks_are_listed_only_for_judged_runs(tmp_path: Path) -> None:
    checks = [
        check_row("consistency", "rate", 2.0, 1.0, passed=False, unit="1"),
        check_row("agreement", "rate", 2.0, 1.0, passed=True, unit="1"),
    ]
    write(tmp_path, "a", "SN-1", "failed", 1, values={"gyro_bias_x": 1.5}, checks=checks)
    write(tmp_path, "b", "SN-1", "stopped", 2, checks=checks)
    output = refreshed(tmp_path).columns()
    assert [output.failed_checks[k] for k in (0, 1)] == [(CheckId("consistency", "rate"),), ()]
    assert output.values["gyro_bias_x"].tolist()[0] == 1.5
    assert output.sigmas["gyro_bias_x"].tolist()[0] == 1.0


def test_runs_count_for_all_stations_but_resume_only_where_the_log_is(three: Path) -> None:
    history = refreshed(three)
    (own,) = history.indexed(RunFilter(names=("b",)))
    there = replace(
        own.record, started_utc="2026-11-05T08:00:00+00:00", verdict=Verdict.FAILED, origin="o", station="bench 2"
    )
    RunIndex(three).receive([IndexedRun("far", "", there, {"gyro_bias_x": 7.0}, {})], "db", 1)
    assert history.refresh() == 0
    assert (history.attempts("SN-1"), history.failures("SN-1", "Navigation grade A")) == (3, 1)
    assert previous_values(history)["gyro_bias_x"] == 7.0
    assert [run.station for run in history.of("SN-1")] == ["bench 2", "bench 1", "bench 1"]
    with raises_code(InputError, "result.elsewhere"):
        history.result(history.of("SN-1")[0])
    assert find_resumable(ignore_progress, three) == []


@pytest.mark.parametrize("case", ["left", "in_progress", "other_station"])
def test_startup_names_only_transfers_that_were_left_at_this_station(tmp_path: Path, case: str) -> None:
    station = "elsewhere" if case == "other_station" else load_station(None)[1].name
    meta = {**META, "run": {**META.get("run", {}), "station": station}}
    writer = RawLogWriter(tmp_path / "a.h5", LogMeta.model_validate(meta))
    writer.append(make_block("rate", 0, 100))
    writer.flush()
    if case != "in_progress":
        (tmp_path / "a.h5").rename(tmp_path / "going.hdf")
        shutil.copyfile(tmp_path / "going.hdf", tmp_path / "a.h5")
    write_open_transfer(tmp_path, "SN-7")
    recovery = recover_at_startup(lambda *_: None, tmp_path, None)
    assert recovery.unverified == (("SN-7",) if case == "left" else ())
    del writer


@pytest.mark.parametrize(("station", "named"), [(None, True), ("here", True), ("elsewhere", False)])
def test_startup_names_a_transfer_by_hand_only_at_its_station(tmp_path: Path, station: str | None, named: bool) -> None:
    name = load_station(None)[1].name if station == "here" else station
    write_open_transfer(tmp_path, "SN-7", purpose=Purpose("Li Na", "hand", "a.h5", station=name))
    recovery = recover_at_startup(lambda *_: None, tmp_path, None)
    assert recovery.unverified == (("SN-7",) if named else ())
