"""Solutions of single logs without workers: a failure affects only its log, and only permanent failures are stored."""

import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import pytest
from botocore.exceptions import EndpointConnectionError
from fsspec.implementations.local import LocalFileSystem
from sqlalchemy import create_engine, select, text

from calstation.database import connect, locations, solutions
from calstation.errors import InputError
from calstation.fleet import Selection, compare, task
from calstation.fleet.changes import Changes
from calstation.fleet.sources import StoredLog
from calstation.fleet.store import KnownFile, SolveSettings, add_version, find_solution, known_files
from calstation.records import LogMeta, open_log, write_log
from tests.helpers import ignore_progress

BEFORE, AFTER = SolveSettings(Changes(label="before")), SolveSettings(Changes(label="after"))


def stored(log: Path, **more: Any) -> StoredLog:
    """Return a log as it is listed."""
    return StoredLog(str(log), "stamp", (log.stat().st_size,), **more)


def solve(url: str, settings: SolveSettings, log: Path, **more: Any) -> task.Status:
    """Solve a log and write the solution."""
    engine = connect(url)
    try:
        return task._LogTask(engine, task.Assignment(url, settings, **more), stored(log), log, {}).solve()
    finally:
        engine.dispose()


def column(url: str, name: str) -> list[Any]:
    """Return a column of all solutions."""
    engine = create_engine(url)
    with engine.connect() as connection:
        found = connection.execute(select(solutions.c[name]).order_by(solutions.c.id)).scalars().all()
    engine.dispose()
    return list(found)


def fails(error: Exception) -> Any:
    """Return a solver that fails."""

    def resolve_log(*arguments: object, **more: object) -> None:
        raise error

    return resolve_log


@pytest.mark.parametrize("error", [InputError("log.altered", file="x"), ZeroDivisionError()])
def test_comparison_includes_a_log_that_newly_fails(
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


def test_modified_log_is_a_different_log(logs: list[Path], tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    damaged = tmp_path / "damaged.h5"
    damaged.write_bytes(logs[0].read_bytes()[:20_000])
    assert solve(url, BEFORE, damaged).outcome == "failed"
    assert solve(url, BEFORE, logs[0]).outcome == "solved"
    assert solve(url, BEFORE, damaged).outcome == "failed"
    assert column(url, "outcome") == ["failed", "resolved"]


def test_solution_rejected_by_postgresql_fails_only_its_log(
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


@pytest.fixture
def on_worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., task.Status]:
    """The task of a worker, run in this process without pauses between attempts."""
    monkeypatch.setattr(task, "get_worker", lambda: type("Worker", (), {"local_directory": str(tmp_path)}))
    monkeypatch.setattr(task, "RETRY_DELAYS", (0.0, 0.0, 0.0))
    task._engine.cache_clear()

    def solve_log(url: str, log: StoredLog, **more: Any) -> task.Status:
        return task.solve_stored_log(task.Assignment(url, BEFORE, **more), log)

    return solve_log


def test_out_of_memory_failure_is_not_stored(
    logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, on_worker: Callable[..., task.Status]
) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    monkeypatch.setattr(task, "resolve_log", fails(MemoryError()))
    status = on_worker(url, stored(logs[0]))
    assert (status.outcome, status.error["error_code"]) == ("unreachable", "fleet.no_memory")
    assert column(url, "outcome") == []


def test_parameters_only_solution_is_never_used_as_a_full_solution(
    logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    assert solve(url, BEFORE, logs[0]).outcome == "solved"
    alone = replace(AFTER, diagnostics=False)
    assert [solve(url, alone, logs[0]).outcome for _ in range(2)] == ["solved", "stored"]
    engine = connect(url)
    assert [add_version(engine, wanted) for wanted in (alone, AFTER, alone)] == [True, False, True]
    assert [add_version(engine, wanted) for wanted in (BEFORE, replace(BEFORE, diagnostics=False))] == [True, False]
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


def test_version_label_is_bound_to_one_range_stages_and_changes(url: str) -> None:
    first = replace(BEFORE, stages=("designed",))
    others = [BEFORE, replace(first, first_seq=5), replace(first, changes=Changes({"site": {}}, "before"))]
    engines = [connect(url) for _ in range(2)]  # of two jobs
    assert [add_version(engine, first) for engine in engines] == [True, True]
    for other in others:
        assert [add_version(engine, other) for engine in engines] == [False, False]
    for engine in engines:
        engine.dispose()


def known(url: str, wanted: SolveSettings) -> dict[tuple[str, str], KnownFile]:
    """Return the files known to the database."""
    engine = connect(url)
    found = known_files(engine, wanted)
    engine.dispose()
    return found


def test_only_selected_logs_are_solved(logs: list[Path], url: str) -> None:
    meta = open_log(logs[1]).meta
    assert meta.run is not None
    assert meta.product is not None
    day = date.fromisoformat(meta.run.started_utc[:10])
    earlier, later = day - timedelta(days=1), day + timedelta(days=1)
    taken = Selection(meta.run.station, meta.product.name, day, day)
    others = [
        replace(taken, station="other"),
        replace(taken, product="other"),
        replace(taken, since=later, until=None),
        replace(taken, since=None, until=earlier),
    ]
    for other in others:
        assert solve(url, BEFORE, logs[1], selection=other).outcome == "not_selected"
    assert column(url, "outcome") == []
    origin = (meta.run.station, meta.product.name, meta.run.started_utc)
    assert known(url, BEFORE) == {(str(logs[1]), "stamp"): KnownFile(origin, None)}
    assert solve(url, BEFORE, logs[1], selection=taken).outcome == "solved"
    assert solve(url, BEFORE, logs[1], selection=others[0]).outcome == "not_selected"


def test_log_without_origin_is_not_selected_and_an_unreadable_log_fails(logs: list[Path], tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    log, path = open_log(logs[0]), tmp_path / "foreign.h5"
    write_log(path, log.meta.model_copy(update={"run": None}), log.blocks())
    for selection in (
        Selection(station="bench 1"),
        Selection(since=date(2000, 1, 1)),
        Selection(until=date(2100, 1, 1)),
    ):
        assert solve(url, BEFORE, path, selection=selection).outcome == "not_selected"
    path.write_bytes(b"no log")
    assert solve(url, BEFORE, path, selection=Selection(station="bench 1")).outcome == "failed"


def test_logs_unaffected_by_the_changes_are_counted(logs: list[Path], tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    meta = open_log(logs[0]).meta
    assert meta.run is not None
    changed = Changes({"site": {"gravity_mps2": 9.81}}, "before")
    same = Changes({"site": {"gravity_mps2": meta.site.gravity_mps2}}, "same")
    stages = tuple(meta.run.stages)
    wanted = [
        replace(BEFORE, changes=changed),
        replace(AFTER, changes=same),
        replace(AFTER, stages=stages),
        replace(AFTER, first_seq=0),
    ]
    assert [solve(url, each, logs[0]).changed for each in wanted] == [True, False, False, True]
    assert solve(url, wanted[1], logs[0]) == task.Status(str(logs[0]), "stored", 2, changed=False)


class Broken(LocalFileSystem):
    """A file system that raises library errors, or delivers wrong bytes, a number of times."""

    protocol = "broken"
    left = 0
    damage: Callable[[bytes], bytes] | None = None

    @classmethod
    def _strip_protocol(cls, path: str) -> str:
        return str(super()._strip_protocol(path.removeprefix("broken://")))

    def get_file(self, rpath: str, lpath: str, **more: Any) -> None:
        if not Broken.left:
            super().get_file(rpath, lpath, **more)
            return
        Broken.left -= 1
        if Broken.damage is None:
            raise EndpointConnectionError(endpoint_url="http://storage")
        Path(lpath).write_bytes(Broken.damage(Path(rpath).read_bytes()))


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch) -> type[Broken]:
    """The file system, registered as ``broken://``."""
    import fsspec

    fsspec.register_implementation("broken", Broken, clobber=True)
    monkeypatch.setattr(Broken, "left", 0)
    monkeypatch.setattr(Broken, "damage", None)
    return Broken


@pytest.mark.parametrize(
    ("damage", "code"),
    [
        (None, "fleet.unreachable"),
        (lambda content: content[:-1], "fleet.copy_damaged"),
        (lambda content: content[:-1] + bytes([content[-1] ^ 1]), "fleet.copy_damaged"),
    ],
)
def test_log_that_cannot_be_downloaded_is_retried_and_not_stored_as_failed(
    logs: list[Path],
    tmp_path: Path,
    broken: type[Broken],
    on_worker: Callable[..., task.Status],
    damage: Callable[[bytes], bytes] | None,
    code: str,
) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    broken.damage = None if damage is None else staticmethod(damage)
    digest = hashlib.sha256(logs[0].read_bytes()).hexdigest()
    log = replace(stored(logs[0], file_sha256=digest), location=f"broken://{logs[0]}")
    broken.left = len(task.RETRY_DELAYS) + 1
    status = on_worker(url, log)
    assert (status.outcome, status.error["error_code"], broken.left) == ("unreachable", code, 0)
    assert "\n" not in status.error["error"]
    connect(url).dispose()
    assert column(url, "outcome") == []
    broken.left = len(task.RETRY_DELAYS)
    assert on_worker(url, log).outcome == "solved"


def test_a_failed_log_is_solved_again_on_request(
    logs: list[Path], url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    solver = task.resolve_log
    engine = connect(url)
    add_version(engine, BEFORE)
    engine.dispose()
    monkeypatch.setattr(task, "resolve_log", fails(InputError("log.altered", file="x")))
    assert [solve(url, BEFORE, logs[0]).outcome for _ in range(2)] == ["failed", "failed"]
    assert solve(url, BEFORE, logs[0], retry_failed=True).outcome == "failed"
    monkeypatch.setattr(task, "resolve_log", solver)
    assert solve(url, BEFORE, logs[0]).outcome == "failed"
    assert [solve(url, BEFORE, logs[0], retry_failed=True).outcome for _ in range(2)] == ["solved", "stored"]
    assert solve(url, BEFORE, logs[0]).outcome == "stored"
    assert column(url, "attempt") == [0, 1, 2]
    assert column(url, "outcome") == ["failed", "failed", "resolved"]
    (found,) = known(url, BEFORE).values()
    assert found.solution is not None
    assert (found.solution.attempt, found.solution.error) == (2, {})
    compared = compare(ignore_progress, url, BEFORE.changes.version, BEFORE.changes.version)
    assert (compared.logs, [*compared.verdicts]) == (1, ["passed"])


def test_unexpected_error_does_not_stop_the_job(
    logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, on_worker: Callable[..., task.Status]
) -> None:
    monkeypatch.setattr(task, "add_solution", fails(ZeroDivisionError("division by zero")))
    status = on_worker(f"sqlite:///{tmp_path / 'shared.sqlite'}", stored(logs[0]))
    assert (status.outcome, status.error["error_code"]) == ("unreachable", "fleet.solving_failed")
    assert "ZeroDivisionError: division by zero" in status.error["error"]


def test_rejected_statement_ends_the_job_with_one_line(
    logs: list[Path], shared_database: str, on_worker: Callable[..., task.Status]
) -> None:
    engine = create_engine(shared_database)
    with engine.begin() as connection:
        connection.execute(text("DROP TABLE locations"))
    engine.dispose()
    status = on_worker(shared_database, stored(logs[0]))
    assert (status.outcome, status.error["error_code"]) == ("refused", "database.refused")
    assert status.error["error"].endswith(
        'refuses a request: relation "locations" does not exist. Check the rights of the user and the free space of '
        "the server, then ask the maintainers of the program."
    )


def test_worker_holds_no_database_connection_while_solving(
    logs: list[Path],
    shared_database: str,
    postgres: Any,
    monkeypatch: pytest.MonkeyPatch,
    on_worker: Callable[..., task.Status],
) -> None:
    name = shared_database.rpartition("/")[2]
    query = f"SELECT count(*) FROM pg_stat_activity WHERE datname = '{name}'"
    counted: list[str] = []
    solver = task.resolve_log

    def resolve_log(log: Any, meta: LogMeta, *arguments: Any, **more: Any) -> Any:
        counted.append(postgres.execute(query))
        return solver(log, meta, *arguments, **more)

    monkeypatch.setattr(task, "resolve_log", resolve_log)
    assert [on_worker(shared_database, stored(log)).outcome for log in logs[:2]] == ["solved", "solved"]
    assert counted == ["0", "0"]


def test_location_of_every_copy_is_stored(logs: list[Path], url: str, tmp_path: Path) -> None:
    copy = Path(shutil.copy(logs[0], tmp_path / "copy.h5"))
    assert [solve(url, BEFORE, log).outcome for log in (logs[0], copy, logs[0])] == ["solved", "stored", "stored"]
    found = known(url, BEFORE)
    assert {location for location, _ in found} == {str(logs[0]), str(copy)}
    assert {each.solution.number for each in found.values() if each.solution is not None} == {1}
    assert column(url, "location") == [str(logs[0])]
    engine = create_engine(url)
    with engine.connect() as connection:
        assert set(connection.execute(select(locations.c.log_sha256)).scalars()) == {open_log(copy).facts().sha256}
    engine.dispose()
