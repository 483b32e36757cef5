"""Every offline solution of a log is recorded in its folder."""

import json
import multiprocessing
from pathlib import Path

import pytest

from calstation import __version__
from calstation.config import computer_user
from calstation.errors import InputError
from calstation.records import OnlineDifference, ResolveRecord, append_resolve, read_resolves, resolve_file
from calstation.results import History, Result, offline_solve, online_difference, resolve
from tests.cli.conftest import six_position_rows, write_log
from tests.helpers import ignore_progress
from tests.shared_runs import SharedRuns

RECORD = ResolveRecord(
    utc="2026-11-22T08:00:00+00:00",
    by="li",
    log="a.h5",
    log_sha256="0" * 64,
    first_seq=0,
    last_seq=9,
    stages=("rate",),
    states_added=(),
    software="0.1",
    configuration_sha256="1" * 64,
    passed=True,
    difference=OnlineDifference(False, "gyro_bias_x", 0.5),
)


def result(**values: tuple[float, float]) -> Result:
    """Return a result with these values and sigmas."""
    rows = {name: {"value": value, "sigma": sigma} for name, (value, sigma) in values.items()}
    head = {"schema": "calstation.result/1", "unit": {"serial": "SN-1"}, "log": {"file": "a.h5"}}
    return Result.from_json({**head, "stages": ["rate"], "outcome": "passed", "parameters": rows})


def test_solutions_are_recorded_with_their_difference_to_the_run(tmp_path: Path, shared_runs: SharedRuns) -> None:
    ended = shared_runs.passed(tmp_path, "six_position")
    log = Path(ended.log)
    whole = resolve(log).result
    facts = whole.log
    part = offline_solve(ignore_progress, log, None, facts.first_seq, facts.last_seq - 500, ()).result
    first, second = History(log.parent).resolves(log)
    assert (first.by, first.log, first.log_sha256) == (computer_user(), log.name, facts.sha256)
    assert (first.first_seq, first.last_seq, first.stages) == (facts.first_seq, facts.last_seq, ("six_position",))
    assert (first.software, first.configuration_sha256) == (__version__, whole.configuration_sha256)
    assert first.difference is not None
    assert first.difference.identical
    assert first.difference.sigmas == 0.0
    assert second.last_seq == facts.last_seq - 500
    assert second.difference == online_difference(part, Result.from_json(ended.result))
    assert second.difference.identical is False
    assert second.difference.parameter in part.parameters


def test_history_reads_newly_added_solutions(tmp_path: Path) -> None:
    history = History(tmp_path)
    assert history.resolves(tmp_path / "a.h5") == []
    append_resolve(tmp_path, RECORD)
    assert history.resolves(tmp_path / "a.h5") == [RECORD]
    append_resolve(tmp_path, RECORD)
    assert history.resolves(tmp_path / "a.h5") == [RECORD, RECORD]
    assert history.resolves(tmp_path / "b.h5") == []


def test_solution_of_a_log_without_a_result_is_recorded_without_a_difference(tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows())
    resolve(log)
    (record,) = read_resolves(tmp_path)
    assert (record.log, record.difference, record.passed) == (log.name, None, None)


def test_failed_recording_is_a_message_of_the_solution(tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows())
    resolve_file(tmp_path).path.mkdir()
    solved = resolve(log)
    assert solved.result.stages == ["six_position"]
    (key, values) = solved.messages[-1]
    assert key == "resolve_unrecorded"
    assert values["file"] == str(resolve_file(tmp_path).path)


def test_largest_difference_is_measured_in_sigmas() -> None:
    online = result(gyro_bias_x=(1.0, 0.1), gyro_bias_y=(5.0, 2.0), gyro_bias_z=(1.0, 1.0))
    offline = result(gyro_bias_x=(0.5, 0.2), gyro_bias_y=(7.0, 1.0))
    assert online_difference(offline, online) == OnlineDifference(False, "gyro_bias_x", pytest.approx(2.5))
    assert online_difference(online, online).identical
    certain = result(gyro_bias_x=(0.5, 0.0))
    assert online_difference(certain, result(gyro_bias_x=(0.0, 0.0))) == OnlineDifference(False, "gyro_bias_x", None)
    assert online_difference(result(), online) == OnlineDifference(False)


def _append(folder: Path) -> None:
    for _ in range(20):
        append_resolve(folder, RECORD)


def test_two_programs_append_complete_lines(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    programs = [context.Process(target=_append, args=(tmp_path,)) for _ in range(2)]
    for program in programs:
        program.start()
    for program in programs:
        program.join()
        assert program.exitcode == 0
    assert read_resolves(tmp_path) == 40 * [RECORD]


def test_modified_record_is_detected(tmp_path: Path) -> None:
    for _ in range(3):
        append_resolve(tmp_path, RECORD)
    path = resolve_file(tmp_path).path
    path.write_text(path.read_text("utf-8").replace('"li"', '"xu"', 1), "utf-8")
    with pytest.raises(InputError, match=r"resolves\.jsonl, line 1"):
        read_resolves(tmp_path)
    path.write_text(json.dumps({"other": 1}) + "\n", "utf-8")
    with pytest.raises(InputError, match=r"resolves\.jsonl, line 1"):
        read_resolves(tmp_path)
