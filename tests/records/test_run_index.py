"""The run index combines filter conditions and lists the available values."""

import math
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import event

from calstation.errors import ConfigurationError
from calstation.records import (
    LATEST_FIRST,
    CheckId,
    IndexedRun,
    RunChoices,
    RunFilter,
    RunIndex,
    RunOrder,
    RunRecord,
    Verdict,
)
from calstation.records.run_index import FILE
from tests.helpers import raises_code

BEGIN = datetime(2026, 11, 1, tzinfo=UTC)


def run(name: str, day: int, **changes: object) -> IndexedRun:
    """Return a run that passed at midnight UTC on a day of November."""
    record = RunRecord(
        serial=name.upper(),
        started_utc=(BEGIN + timedelta(days=day - 1)).isoformat(),
        verdict=Verdict.PASSED,
        attempt=1,
        product="nav-a",
        station="bench 1",
        operator="Li Wei",
        stages=("rate",),
        log=Path(f"{name}.h5"),
        result=None,
        duration=1.0,
    )
    return IndexedRun(name, "stamp", replace(record, **changes), {}, {})  # type: ignore[arg-type]


@pytest.fixture
def index(tmp_path: Path) -> RunIndex:
    """Four runs, a to d, on the first four days of November."""
    made = RunIndex(tmp_path)
    made.update(
        [
            run("a", 1, verdict=Verdict.FAILED, station="bench 2"),
            run("b", 2, verdict=Verdict.PARTIAL, partial=True, operator="Zoë Müller"),
            run("c", 3, product="mems-x", operator=None),
            run("d", 4),
        ]
    )
    return made


def test_search_does_not_find_digits_of_the_time_in_names(index: RunIndex) -> None:
    name, batch = "SN-000042_20261127T101500000001", "B20261127T101501-AB12"
    index.update([run(name, 5, serial="SN-000042", batch=batch)])
    for digits in ("2026", "1015", "20261127"):
        assert index.find(RunFilter(search=digits)) == []
    parts = (name[:14], name[:20], "20261127t1015", "101500", "20261127T101501-AB")
    for text in ("000042", "sn-0000", name, name.lower(), batch, "ab12", *parts):
        assert [each.name for each in index.find(RunFilter(search=text))] == [name], text


@pytest.mark.parametrize(
    ("order", "names"),
    [
        (LATEST_FIRST, "dcba"),
        (RunOrder("started_utc"), "abcd"),
        (RunOrder("serial"), "dbac"),
        (RunOrder("serial", descending=True), "cadb"),
        (RunOrder("attempt"), "badc"),
        (RunOrder("operator"), "cdab"),
    ],
)
@pytest.mark.parametrize("in_memory", [False, True])
def test_records_are_sorted_by_a_field_and_read_in_parts(
    tmp_path: Path, order: RunOrder, names: str, in_memory: bool
) -> None:
    if in_memory:
        (tmp_path / "history.sqlite").mkdir()
    index = RunIndex(tmp_path)
    fields = {"a": ("SN-10", 2, "li"), "b": ("sn-9", 2, "Zoe"), "c": ("SN-100", 12, None), "d": ("SN-9", 3, "Li")}
    for day, (name, (serial, attempt, operator)) in enumerate(fields.items(), 1):
        index.update([run(name, day, serial=serial, attempt=attempt, operator=operator)])
    found = [index.records(RunFilter(), 3, offset, order) for offset in (0, 3)]
    assert "".join(record.log.stem for part in found for record in part) == names


def test_units_of_a_batch_are_found_by_its_id(index: RunIndex) -> None:
    index.update([run("e", 5, batch="B-7", slot="1"), run("f", 6, batch="B-7", slot="2"), run("g", 7, batch="B-70")])
    assert [each.name for each in index.find(RunFilter(batch="B-7"))] == ["f", "e"]
    assert [each.record.slot for each in index.find(RunFilter(batch="B-7"))] == ["2", "1"]
    assert [each.name for each in index.find(RunFilter(search="b-7"))] == ["g", "f", "e"]
    assert index.runs_by_name(["a"])[0].record.batch is None


@pytest.mark.parametrize(
    ("conditions", "found"),
    [
        (RunFilter(), "dcba"),
        (RunFilter(verdict="passed"), "dc"),
        (RunFilter(verdict="partial"), "b"),
        (RunFilter(product="nav-a"), "dba"),
        (RunFilter(station="bench 2"), "a"),
        (RunFilter(operator="Li Wei"), "da"),
        (RunFilter(since="2026-11-02T00:00:00"), "dcb"),
        (RunFilter(before="2026-11-03T00:00:00"), "ba"),
        (RunFilter(since="2026-11-02T00:00:00", before="2026-11-04T00:00:00"), "cb"),
        (RunFilter(search="BENCH"), "dcba"),
        (RunFilter(search=" müller "), "b"),
        (RunFilter(search="mems"), "c"),
        (RunFilter(search="%"), ""),
        (RunFilter(search="bench", verdict="passed", product="nav-a", since="2026-11-02T00:00:00"), "d"),
        (RunFilter(verdict="passed", station="bench 2"), ""),
    ],
)
def test_found_and_counted_runs_meet_all_conditions(index: RunIndex, conditions: RunFilter, found: str) -> None:
    assert "".join(each.name for each in index.find(conditions)) == found
    assert index.counts(conditions)[0] == len(found)
    assert [each.name for each in index.find(conditions, 1)] == list(found[:1])


def test_altered_runs_are_found_by_themselves(index: RunIndex) -> None:
    index.update([run("e", 5, altered=True)])
    for altered, names in ((None, "edc"), (False, "dc"), (True, "e")):
        found = index.find(RunFilter(verdict="passed", altered=altered))
        assert "".join(each.name for each in found) == names


def test_choices_are_the_values_of_the_runs(index: RunIndex, tmp_path: Path) -> None:
    expected = RunChoices(
        ("mems-x", "nav-a"), ("bench 1", "bench 2"), ("Li Wei", "Zoë Müller"), "2026-11-01T00:00:00+00:00"
    )
    assert index.choices() == expected
    index.update([run("e", 1, started_utc="")])
    assert index.choices() == expected
    (tmp_path / "empty").mkdir()
    assert RunIndex(tmp_path / "empty").choices() == RunChoices()


def test_values_sigmas_and_failed_checks_are_read_back_exactly(index: RunIndex, tmp_path: Path) -> None:
    kept = replace(
        run("e", 5, verdict=Verdict.FAILED),
        values={"gyro_bias_x": 0.1 + 0.2, "accel_bias_x": -1e-300},
        sigmas={"accel_bias_x": 1 / 3},
        failed_checks=(CheckId("within", "gyro_bias_x"), CheckId("other", "two\nlines"), CheckId("other")),
    )
    index.update([kept])
    (found,) = RunIndex(tmp_path).find(RunFilter(names=("e",)))
    log = tmp_path / kept.record.log.name
    assert found == replace(kept, record=replace(kept.record, log=log))


def test_columns_contain_runs_with_a_start_time_oldest_first(index: RunIndex) -> None:
    both, one = {"gyro_bias_x": 1e-6, "accel_bias_x": 2e-3}, {"gyro_bias_x": 3e-6}
    index.update(
        [
            replace(run("f", 6, verdict=Verdict.PARTIAL, partial=True), values=both, sigmas={"gyro_bias_x": 1e-8}),
            replace(
                run("e", 5, verdict=Verdict.FAILED),
                values=one,
                sigmas=one,
                failed_checks=(CheckId("effects", "rate"), CheckId("change")),
            ),
            run("g", 1, started_utc=""),
            run("h", 1, started_utc="yesterday"),
        ]
    )
    found = index.columns(RunFilter(since="2026-11-04T00:00:00"))
    assert found.names == ("d", "e", "f")
    assert tuple(found.serials) == ("D", "E", "F")
    assert found.started.tolist() == [(BEGIN + timedelta(days=day)).timestamp() for day in (3, 4, 5)]
    assert tuple(found.verdicts) == ("passed", "failed", "partial")
    assert found.partial.tolist() == [False, False, True]
    assert tuple(found.failed_checks) == ((), (("effects", "rate"), ("change", "")), ())
    assert found.values.keys() == found.sigmas.keys() == {"gyro_bias_x", "accel_bias_x"}
    nan = math.nan
    np.testing.assert_array_equal(found.values["gyro_bias_x"], [nan, 3e-6, 1e-6])
    np.testing.assert_array_equal(found.sigmas["gyro_bias_x"], [nan, 3e-6, 1e-8])
    np.testing.assert_array_equal(found.values["accel_bias_x"], [nan, nan, 2e-3])
    np.testing.assert_array_equal(found.sigmas["accel_bias_x"], [nan, nan, nan])
    assert len(index.columns(RunFilter()).names) == 6  # g and h have no start time
    nothing = index.columns(RunFilter(search="zzz"))
    assert (nothing.names, nothing.started.tolist(), nothing.values) == ((), [], {})


def test_runs_of_other_folders_are_found_with_local_runs(index: RunIndex, tmp_path: Path) -> None:
    there = run(
        "a", 5, verdict=Verdict.FAILED, station="bench 9", serial="A", origin="other", location="bench9:/runs/a.h5"
    )
    index.receive([there], "db", 1)
    assert index.received() == ("db", 1)
    assert [each.name for each in index.find(RunFilter(), 3)] == ["a", "d", "c"]
    assert index.counts(RunFilter(names=("a",)))[0] == 2
    assert index.attempts("A") == 2
    assert index.choices().stations == ("bench 1", "bench 2", "bench 9")
    assert index.columns(RunFilter(verdict="failed")).names == ("a", "a")
    found = index.runs_of_unit("A")[0].record
    assert (found.origin, found.location, found.log) == ("other", "bench9:/runs/a.h5", tmp_path / "other" / "a.h5")
    assert index.stamps().keys() == set("abcd")
    assert [each.record.station for each in index.runs_by_name(["a"])] == ["bench 2"]
    index.update([], ["a"])
    assert [each.record.station for each in index.runs_of_unit("A")] == ["bench 9"]
    index.receive([replace(there, record=replace(there.record, released=True))], "db", 2)
    assert [each.record.badge for each in index.runs_of_unit("A")] == ["released"]
    assert RunIndex(tmp_path).received() == ("db", 2)


def test_runs_of_another_database_replace_received_runs(index: RunIndex) -> None:
    index.receive([run("x", 5, origin="other")], "db", 7)
    index.receive([run("y", 6, origin="third")], "restored", 3)
    assert [each.name for each in index.find(RunFilter(), 2)] == ["y", "d"]
    assert index.received() == ("restored", 3)


@contextmanager
def busy(folder: Path) -> Iterator[None]:
    """Lock the file of an index as another program would."""
    with closing(sqlite3.connect(folder / FILE, isolation_level=None)) as other:
        other.execute("PRAGMA locking_mode=EXCLUSIVE")
        other.execute("BEGIN EXCLUSIVE")
        yield
        other.execute("ROLLBACK")


def test_locked_index_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calstation.records.run_index._BUSY_S", 0.05)
    monkeypatch.setattr("calstation.records.run_index._RETRY_S", 0.0)
    index = RunIndex(tmp_path)
    index.update([run("a", 1)])
    index.receive([run("x", 5, origin="other")], "db", 7)
    with busy(tmp_path):
        index.update([run("b", 2)])  # a run continues
        assert [each.name for each in index.find(RunFilter())] == ["b"]
        assert index.may_lack_runs
        index.may_lack_runs = False
        with raises_code(ConfigurationError, "database.index_unusable"):
            index.received()
        with raises_code(ConfigurationError, "database.index_unusable"):
            index.receive([run("y", 6, origin="other")], "db", 8)
    assert [each.name for each in index.find(RunFilter())] == ["x", "a"]
    assert index.may_lack_runs  # b is missing until the next refresh
    assert index.received() == ("db", 7)


def test_full_disk_loses_no_received_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calstation.records.run_index._RETRY_S", 0.0)
    index = RunIndex(tmp_path)
    index.receive([run("x", 5, origin="other")], "db", 7)

    @event.listens_for(index._engine, "connect")
    def _full(connection: sqlite3.Connection, _: object) -> None:
        pages = connection.execute("PRAGMA page_count").fetchone()[0]
        connection.execute(f"PRAGMA max_page_count={pages}")

    index.update([run("b" * 100_000, 2)])
    event.remove(index._engine, "connect", _full)
    assert [each.name for each in index.find(RunFilter())] == ["x"]
    assert index.received() == ("db", 7)


def test_many_runs_of_another_database_are_removed(index: RunIndex, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calstation.records.run_index._MAX_REMOVED", 2)
    index.receive([run(f"x{k}", 5, origin="other") for k in range(5)], "db", 7)
    index.receive((), "", 0)
    assert [each.name for each in index.find(RunFilter())] == list("dcba")
    assert index.received() == ("", 0)
