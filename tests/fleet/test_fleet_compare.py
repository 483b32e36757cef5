"""Comparisons agree with a hand-calculated example, also after rows were added and replaced."""

import json
import shutil
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from sqlalchemy import create_engine, delete, func, insert, select, text

from calstation.config import library
from calstation.database import connect, open_database, runs, solutions, versions
from calstation.database.tables import outboxes
from calstation.errors import ConfigurationError
from calstation.fleet import (
    Comparison,
    FleetRequest,
    FleetSummary,
    ParameterShift,
    columns,
    compare,
    export_version,
    resolve_fleet,
    solved_results,
    versions_job,
)
from calstation.fleet.columns import _MAX_FILES, update_columns
from calstation.records import locked
from tests.cli.conftest import Done
from tests.helpers import ignore_progress, raises_code

Run = Callable[..., Done]

#: Unit, product, station, month, and before and after: verdict, gyro_bias_x, its sigma. The moves in sigmas are
#: |2 - 1| / 0.5 = 2, |5 - 2| / 1 = 3 (the sigma after is larger), 0, and |4 - 3| / 0.25 = 4.
UNITS: tuple[tuple[Any, ...], ...] = (
    ("A", "p", "bench 1", "2026-01", (True, 1.0, 0.5), (False, 2.0, 0.25)),
    ("B", "p", "bench 2", "2026-01", (False, 2.0, 0.5), (True, 5.0, 1.0)),
    ("C", "q", "bench 1", "2026-03", (True, 7.0, 0.1), (True, 7.0, 0.1)),
    ("D", "q", "bench 2", "2026-03", (True, 3.0, 0.25), (None, 4.0, 0.25)),
)


@pytest.fixture(autouse=True)
def _home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))


def row(unit: tuple[Any, ...], version: str, which: int, **more: Any) -> dict[str, Any]:
    """Return a row of the table of solutions."""
    serial, product, station, month, *answers = unit
    passed, value, sigma = answers[which]
    return {
        "log_sha256": f"{ord(serial):064x}"[::-1],
        "version": version,
        "configuration_sha256": str(which),
        "first_seq": 0,
        "last_seq": -1,
        "stages": "",
        "changes_sha256": "",
        "location": f"/logs/{serial}.h5",
        "outcome": "resolved",
        "passed": passed,
        "partial": False,
        "serial": serial,
        "product": product,
        "station": station,
        "started_utc": f"{month}-05T00:00:00+00:00",
        "failed_checks": json.dumps([["within", "gyro_bias_x"]] if passed is False else []),
        "parameters": '["gyro_bias_x"]',
        "numbers": np.array([value, sigma]).tobytes(),
        "solved": datetime(2026, 11, 1),
        "result": "{}",
        **more,
    }


def add(url: str, *rows: dict[str, Any]) -> None:
    """Insert solutions and their versions."""
    engine = connect(url)
    same = ("changes_sha256", "first_seq", "last_seq", "stages")
    with engine.begin() as connection:
        known = {*connection.execute(select(versions.c.version)).scalars()}
        for version, each in {each["version"]: each for each in rows}.items():
            if version not in known:
                connection.execute(insert(versions).values(version=version, **{name: each[name] for name in same}))
        connection.execute(insert(solutions), list(rows))
    engine.dispose()


def check(found: Comparison) -> None:
    """Assert all numbers of the comparison of the four units."""
    assert (found.logs, found.only_before, found.only_after) == (4, 0, 0)
    assert found.verdicts == {"passed": {"passed": 1, "failed": 1, "unjudged": 1}, "failed": {"passed": 1}}
    assert [each.serial for each in found.pass_to_fail] == ["A"]
    assert [each.serial for each in found.fail_to_pass] == ["B"]
    assert [each.serial for each in found.changes] == ["A", "B", "D"]
    assert (found.changes[0].failed_before, found.changes[0].failed_after) == ("", "gyro_bias_x within")
    # in order 0, 2, 3, 4: the median is 2.5, and the 95th percentile 3 + 0.85 * (4 - 3)
    assert found.moves == {"gyro_bias_x": ParameterShift(2.5, pytest.approx(3.85), 4.0, "/logs/D.h5", "D")}  # type: ignore[arg-type]
    groups = {
        kind: [(each.name, each.logs, each.pass_to_fail, each.fail_to_pass) for each in each_kind]
        for kind, each_kind in found.groups.items()
    }
    assert groups == {
        "product": [("p", 2, 1, 1), ("q", 2, 0, 0)],
        "station": [("bench 1", 2, 1, 0), ("bench 2", 2, 0, 1)],
        "month": [("2026-01", 2, 1, 1), ("2026-03", 2, 0, 0)],
    }
    largest = {
        kind: [(each.moves["gyro_bias_x"].largest, each.moves["gyro_bias_x"].serial) for each in each_kind]
        for kind, each_kind in found.groups.items()
    }
    assert largest["product"] == [(3.0, "B"), (4.0, "D")]
    assert largest["station"] == [(2.0, "A"), (4.0, "D")]
    assert found.groups["station"][1].moves["gyro_bias_x"].median == 3.5


@pytest.mark.long
def test_comparison_of_four_units_matches_hand_calculation(url: str, calstation: Run) -> None:
    add(url, *(row(unit, "1", 0) for unit in UNITS), *(row(unit, "2", 1) for unit in reversed(UNITS)))
    found = compare(ignore_progress, url, "1", "2")
    check(found)
    done = calstation("fleet", "compare", "--database", url, "--before", "1", "--after", "2", "--json", "-")
    assert done.code == 0
    assert done.json == json.loads(json.dumps(found.to_json()))
    shown = calstation("fleet", "compare", "--database", url, "--before", "1", "--after", "2").out
    for words in ("4 logs in both", "A", "bench 2", "gyro_bias_x", "2026-03", "3.85"):
        assert words in shown


@pytest.mark.long
def test_columns_include_solutions_whose_numbers_appear_late(url: str) -> None:
    add(url, *(row(unit, "1", 0, id=k) for k, unit in enumerate(UNITS[1:], 10)))
    assert compare(ignore_progress, url, "1", "1").logs == 3
    add(url, row(UNITS[0], "1", 0, id=3), *(row(unit, "2", 1, id=k) for k, unit in enumerate(UNITS, 20)))
    check(compare(ignore_progress, url, "1", "2"))
    other = row(UNITS[2], "2", 0, configuration_sha256="later", id=40)
    add(url, {**other, "passed": False})
    again = compare(ignore_progress, url, "1", "2")
    assert [each.serial for each in again.pass_to_fail] == ["A", "C"]  # the last solution of a log counts
    assert again.logs == 4


@pytest.mark.exhaustive
def test_many_small_column_files_are_merged(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    connect(url).dispose()
    for k in range(_MAX_FILES + 3):
        add(url, row((chr(65 + k), *UNITS[0][1:]), "1", 0))
        assert compare(ignore_progress, url, "1", "1").logs == k + 1
    engine = create_engine(url)
    with engine.connect() as connection:
        assert len(update_columns(ignore_progress, connection, "1").paths) <= _MAX_FILES
    engine.dispose()


def test_deleted_solutions_are_removed_from_the_columns(url: str) -> None:
    add(url, *(row(unit, "1", 0, id=k) for k, unit in enumerate(UNITS, 1)))
    assert compare(ignore_progress, url, "1", "1").logs == 4
    engine = connect(url)
    with engine.begin() as connection:
        connection.execute(delete(solutions).where(solutions.c.id == 2))
    engine.dispose()
    add(url, row(UNITS[1], "2", 1, id=9))
    found = compare(ignore_progress, url, "1", "2")
    assert (found.logs, found.only_before, found.only_after) == (0, 3, 1)


def test_column_files_merged_by_another_process_can_still_be_read(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    engine = connect(url)
    with engine.connect() as connection:
        for k in range(_MAX_FILES):
            add(url, row((chr(65 + k), *UNITS[0][1:]), "1", 0))
            files = update_columns(ignore_progress, connection, "1")
        add(url, row((chr(65 + _MAX_FILES), *UNITS[0][1:]), "1", 0))
        joined = update_columns(ignore_progress, connection, "1")
        assert len(files.paths) == _MAX_FILES
        assert len(files.read("serial")) == _MAX_FILES
        assert len(joined.paths) == 1
        assert len(update_columns(ignore_progress, connection, "1").read("serial")) == _MAX_FILES + 1
        assert not any(path.exists() for path in files.paths)
    engine.dispose()


def add_outbox(url: str) -> None:
    """Insert the outbox of a station."""
    engine = connect(url)
    with engine.begin() as connection:
        connection.execute(insert(outboxes), [{"id": "x", "station": "bench 1", "revision": 1}])
    engine.dispose()


def put_run(url: str, number: int, unit: tuple[Any, ...], content: Mapping[str, Any] = {}, **more: Any) -> None:
    """Insert or replace a run of the station."""
    solved = row(unit, "", 0)
    outcome = {True: "partial" if content.get("partial") else "passed", False: "failed"}[solved["passed"]]
    content = {"product": solved["product"], "station": solved["station"], "verdict": outcome, **content}
    same = ("serial", "started_utc", "failed_checks", "parameters", "numbers", "log_sha256")
    values = {name: solved[name] for name in same}
    values |= {"outbox": "x", "name": unit[0], "revision": number, "stamp": "", "content": json.dumps(content)}
    values |= {"log": solved["location"], **more}
    engine = connect(url)
    with engine.begin() as connection:
        connection.execute(delete(runs).where(runs.c.name == unit[0]))
        connection.execute(insert(runs), [values])
    engine.dispose()


def test_run_results_are_a_version_with_their_latest_state(url: str) -> None:
    add_outbox(url)
    add(url, *(row(unit, "2", 1) for unit in UNITS))
    put_run(url, 1, UNITS[0], numbers=np.array([9.0, 0.5]).tobytes())
    for number, unit in enumerate(UNITS, 2):
        if number == 3:
            compare(ignore_progress, url, "online", "2")
        put_run(url, number, unit)
    check(compare(ignore_progress, url, "online", "2"))


def test_a_partial_calibration_counts_as_partial(url: str, tmp_path: Path, calstation: Run) -> None:
    add_outbox(url)
    add(url, *(row(unit, "1", 0, partial=unit[0] in "AB") for unit in UNITS))
    for number, unit in enumerate(UNITS, 1):
        put_run(url, number, unit, {"partial": unit[0] in "AB"})
    verdicts = {"passed": {"passed": 2}, "partial": {"partial": 1}, "failed": {"failed": 1}}
    assert compare(ignore_progress, url, "online", "1").verdicts == verdicts
    add(url, *(row(unit, "2", 1) for unit in UNITS))
    found = compare(ignore_progress, url, "1", "2")
    assert [(each.serial, each.before, each.after) for each in found.changes][:1] == [("A", "partial", "failed")]
    assert not found.pass_to_fail
    path = tmp_path / "solutions.parquet"
    calstation("fleet", "export", "--database", url, "--version", "1", "-o", path)
    assert pq.read_table(path).column("verdict").to_pylist() == ["partial", "failed", "passed", "passed"]


def test_only_selected_solutions_are_compared(url: str) -> None:
    add(url, *(row(unit, "1", 0) for unit in UNITS[1:]))
    add(url, *(row(unit, "2", 1, id=k) for k, unit in enumerate(UNITS, 10)))
    found = compare(ignore_progress, url, "1", "2", [10, 11, 13])
    assert (found.logs, found.only_before, found.only_after) == (2, 0, 1)
    assert [each.serial for each in found.changes] == ["B", "D"]
    assert found.moves["gyro_bias_x"].largest == 4.0
    assert [(each.name, each.logs) for each in found.groups["product"]] == [("p", 1), ("q", 1)]
    found = compare(ignore_progress, url, "1", "2", [])
    assert (found.logs, found.only_after, found.moves) == (0, 0, {})


def test_locked_or_damaged_columns_are_reported(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    add(url, *(row(unit, "1", 0) for unit in UNITS))
    export_version(ignore_progress, url, "1", tmp_path / "solutions.parquet")
    (file,) = (tmp_path / "home").rglob("*.parquet")
    monkeypatch.setattr(columns, "_LOCK_TIMEOUT", 0.0)
    for job in (
        lambda: compare(ignore_progress, url, "1", "1"),
        lambda: export_version(ignore_progress, url, "1", file),
    ):
        with locked(file.with_name(".lock"), 0.0), raises_code(ConfigurationError, "fleet.columns_locked") as caught:
            job()
        assert str(file.parent) in str(caught.value)
    with raises_code(ConfigurationError, "csv.not_written"):
        export_version(ignore_progress, url, "1", tmp_path / "none" / "solutions.parquet")
    file.write_bytes(b"damaged")
    with raises_code(ConfigurationError, "fleet.columns_unusable"):
        compare(ignore_progress, url, "1", "1")
    pq.write_table(pa.table({"number": [1]}), file)  # of an earlier version of the program
    assert compare(ignore_progress, url, "1", "1").logs == 4


def test_postgresql_errors_are_reported_in_one_line(shared_database: str, tmp_path: Path) -> None:
    url = shared_database
    station = tmp_path / "station.toml"
    shutil.copy(library.find("stations", "virtual_bench"), station)
    station.write_text(f'{station.read_text("utf-8")}\n[records]\ndatabase = "{url}"\n', "utf-8")
    summary = FleetSummary("1", solutions={1: "a"})
    jobs: list[Callable[[], object]] = [
        lambda: compare(ignore_progress, url, "1", "2"),
        lambda: export_version(ignore_progress, url, "1", tmp_path / "a.parquet"),
        lambda: versions_job(ignore_progress, station),
        lambda: list(solved_results(url, summary)),
        lambda: resolve_fleet(FleetRequest((str(tmp_path),), url)),
    ]
    engine = create_engine(url)
    with engine.begin() as connection:
        connection.execute(text("DROP TABLE solutions"))
    (tmp_path / "a.h5").write_bytes(b"")
    for job in jobs:
        with raises_code(ConfigurationError, "database.refused") as caught:
            job()
        assert 'refuses a request: relation "solutions" does not exist. Check' in str(caught.value)
        assert "\n" not in str(caught.value)
    with (
        raises_code(ConfigurationError, "database.unreachable"),
        open_database(url) as lost,
        lost.connect() as connection,
    ):
        number = connection.execute(select(func.pg_backend_pid())).scalar_one()
        with engine.begin() as other:
            other.execute(select(func.pg_terminate_backend(number)))
        connection.execute(text("SELECT 1"))
    engine.dispose()


def test_runs_without_a_log_cannot_be_compared(url: str) -> None:
    add_outbox(url)
    put_run(url, 1, UNITS[0], log_sha256=None)
    with raises_code(ConfigurationError, "fleet.no_version"):
        compare(ignore_progress, url, "online", "online")


def test_error_for_an_unknown_version_lists_the_existing_versions(url: str) -> None:
    add(url, row(UNITS[0], "0.1.0", 0))
    with raises_code(ConfigurationError, "fleet.no_version") as caught:
        compare(ignore_progress, url, "0.1.0", "0.2.0")
    assert "0.1.0" in str(caught.value)


@pytest.mark.parametrize(
    "command", [("compare", "--before", "1", "--after", "2"), ("export", "--version", "1", "-o", "solutions.parquet")]
)
def test_a_missing_database_is_refused_and_not_created(
    tmp_path: Path, calstation: Run, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    missing = f"sqlite:///{tmp_path / 'flete.sqlite'}"
    done = calstation("fleet", *command, "--database", missing)
    assert (done.code, done.out) == (2, "")
    assert f"{missing}: No such database. Give the URL of an existing one" in done.err
    assert not list(tmp_path.iterdir())


def test_export_is_read_back_by_pyarrow(url: str, tmp_path: Path, calstation: Run) -> None:
    add(url, *(row(unit, "1", 0) for unit in UNITS), row(UNITS[0], "2", 1))
    path = tmp_path / "solutions.parquet"
    done = calstation("fleet", "export", "--database", url, "--version", "1", "-o", path)
    assert done.code == 0
    assert "4" in done.err
    table = pq.read_table(path)
    assert table.column("serial").to_pylist() == ["A", "B", "C", "D"]
    assert table.column("verdict").to_pylist() == ["passed", "failed", "passed", "passed"]
    assert table.column("gyro_bias_x").to_pylist() == [1.0, 2.0, 7.0, 3.0]
    assert table.column("gyro_bias_x_sigma").to_pylist() == [0.5, 0.5, 0.1, 0.25]
    assert np.isnan(table.column("accel_scale_x").to_numpy()).all()
    engine = connect(url)
    with engine.connect() as connection:
        digests = connection.execute(select(solutions.c.log_sha256).where(solutions.c.version == "1")).scalars().all()
    engine.dispose()
    assert table.column("log_sha256").to_pylist() == digests


def test_export_contains_batch_and_slot_of_solutions_and_runs(url: str, tmp_path: Path, calstation: Run) -> None:
    batch = {"batch": "B20260105T000000-ABCD"}
    add(url, *(row(unit, "1", 0, **batch, slot=unit[0].lower()) for unit in UNITS[:2]))
    add(url, row(UNITS[2], "1", 0), row(UNITS[3], "1", 0))
    add_outbox(url)
    put_run(url, 1, UNITS[0], {**batch, "slot": "left"})
    put_run(url, 2, UNITS[1])  # of a program that knew no batches
    path = tmp_path / "solutions.parquet"

    def exported(version: str) -> list[tuple[str, str | None, str | None]]:
        done = calstation("fleet", "export", "--database", url, "--version", version, "-o", path)
        assert done.code == 0
        table = pq.read_table(path, columns=["serial", "batch", "slot"])
        return [(each["serial"], each["batch"], each["slot"]) for each in table.to_pylist()]

    several = batch["batch"]
    assert exported("1") == [("A", several, "a"), ("B", several, "b"), ("C", None, None), ("D", None, None)]
    assert exported("online") == [("A", several, "left"), ("B", None, None)]
