"""The solutions of single logs, without workers: failures count for their log, and only lasting ones are stored."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import create_engine, select

from calstation.database import connect, solutions
from calstation.errors import InputError
from calstation.fleet import compare, task
from calstation.fleet.changes import Changes
from calstation.fleet.sources import StoredLog
from calstation.fleet.store import Wanted, find_solution, label_used
from calstation.records import open_log, write_log
from tests.helpers import ignore_progress

BEFORE, AFTER = Wanted(Changes(label="before")), Wanted(Changes(label="after"))


def solve(url: str, wanted: Wanted, log: Path) -> task.Status:
    """Solve a log and write the solution."""
    engine = connect(url)
    try:
        return task._solve(engine, wanted, StoredLog(str(log), "stamp"), log, {})
    finally:
        engine.dispose()


def column(url: str, name: str) -> list[Any]:
    """A column of all solutions."""
    engine = create_engine(url)
    with engine.connect() as connection:
        found = connection.execute(select(solutions.c[name]).order_by(solutions.c.id)).scalars().all()
    engine.dispose()
    return list(found)


def fails(error: Exception) -> Any:
    """A solver that fails."""

    def resolve_log(*arguments: object, **more: object) -> None:
        raise error

    return resolve_log


@pytest.mark.parametrize("error", [InputError("log.altered", file="x"), ZeroDivisionError()])
def test_a_log_that_starts_to_fail_is_compared(
    logs: list[Path], url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    assert solve(url, BEFORE, logs[0]).outcome == "solved"
    monkeypatch.setattr(task, "resolve_log", fails(error))
    assert solve(url, AFTER, logs[0]).outcome == "failed"
    found = compare(ignore_progress, url, BEFORE.changes.version, AFTER.changes.version)
    assert (found.logs, found.only_before, found.only_after) == (1, 0, 0)
    assert [(each.before, each.after) for each in found.changes] == [("passed", "error")]
    assert len(set(column(url, "configuration_sha256"))) == 1
    moved = Path(shutil.copy(logs[0], tmp_path / "moved.h5"))
    again = solve(url, AFTER, moved)
    assert (again.outcome, again.seconds) == ("failed", {})  # found by the digest, and still a failure
    assert again.error["error_code"] == getattr(error, "code", "fleet.solving_failed")


def test_an_altered_log_does_not_count_as_the_one_that_it_was(logs: list[Path], tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    damaged = tmp_path / "damaged.h5"
    damaged.write_bytes(logs[0].read_bytes()[:20_000])
    assert solve(url, BEFORE, damaged).outcome == "failed"
    assert solve(url, BEFORE, logs[0]).outcome == "solved"
    assert solve(url, BEFORE, damaged).outcome == "failed"
    assert column(url, "outcome") == ["failed", "resolved"]


def test_a_solution_that_postgresql_cannot_store_fails_alone(
    logs: list[Path], shared_database: str, tmp_path: Path
) -> None:
    log = open_log(logs[0])
    imu = log.meta.imu.model_copy(update={"serial": "SN\0"})
    path = tmp_path / "zero.h5"
    write_log(path, log.meta.model_copy(update={"imu": imu}), log.blocks())
    status = solve(shared_database, BEFORE, path)
    assert (status.outcome, status.error["error_code"]) == ("failed", "fleet.not_stored")
    assert column(shared_database, "serial") == [None]
    assert column(shared_database, "log_sha256") == [open_log(path).facts().sha256]


def test_lack_of_memory_is_not_stored(logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    monkeypatch.setattr(task, "resolve_log", fails(MemoryError()))
    monkeypatch.setattr(task, "_copied", lambda location, folder: Path(location))
    monkeypatch.setattr(task, "get_worker", lambda: type("Worker", (), {"local_directory": str(tmp_path)}))
    status = task.solve_stored_log(task.Assignment(url, BEFORE), StoredLog(str(logs[0]), "stamp"))
    assert (status.outcome, status.error["error_code"]) == ("unreachable", "fleet.no_memory")
    assert column(url, "outcome") == []


def test_parameters_alone_are_never_taken_for_a_full_solution(
    logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    assert solve(url, BEFORE, logs[0]).outcome == "solved"
    alone = replace(AFTER, diagnostics=False)
    assert [solve(url, alone, logs[0]).outcome for _ in range(2)] == ["solved", "there"]
    engine = connect(url)
    assert label_used(engine, AFTER)
    assert label_used(engine, replace(BEFORE, diagnostics=False))
    key = column(url, "log_sha256")[0], column(url, "configuration_sha256")[0]
    assert find_solution(engine, BEFORE, *key) is not None
    assert find_solution(engine, replace(BEFORE, diagnostics=False), *key) is None
    assert find_solution(engine, AFTER, *key) is None
    engine.dispose()
    results = [json.loads(text) for text in column(url, "result")]
    assert [result.get("tested") for result in results] == [None, False]
    full, alone_passed = column(url, "passed")
    assert full is not None
    assert alone_passed is None
    found = compare(ignore_progress, url, BEFORE.changes.version, AFTER.changes.version)
    assert [set(row) for row in found.verdicts.values()] == [{"unjudged"}]
    assert not found.pass_to_fail
    assert not found.fail_to_pass
    assert {move.largest for move in found.moves.values()} == {0.0}
    assert len(found.moves) == 30


def test_a_label_stands_for_one_range_and_one_set_of_stages(logs: list[Path], tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    assert solve(url, replace(BEFORE, stages=("designed",)), logs[0]).outcome == "solved"
    engine = connect(url)
    used = {
        more: label_used(engine, replace(BEFORE, **dict(more)))
        for more in ((("stages", ("designed",)),), (), (("stages", ("designed",)), ("first_seq", 5)))
    }
    engine.dispose()
    assert list(used.values()) == [False, True, True]
