"""Stations exchange their runs through the database: each once, in order, and all of them see all."""

import csv
import json
import shutil
import socket
import sqlite3
from pathlib import Path

import pytest
from sqlalchemy import create_engine, delete, select, text, update

from calstation.cli.app import run_app
from calstation.database import Exchange, export_shared_runs, load_shared_results
from calstation.database.outbox import FILE, Outbox
from calstation.database.tables import log_copies, outboxes, revisions, runs
from calstation.errors import ConfigurationError, InputError
from calstation.records import RunFilter, RunIndex
from calstation.results import History, load_results
from tests.database.result_files import in_database, in_index, write_result
from tests.database.test_claims import station_file
from tests.helpers import ignore_progress, raises_code


@pytest.fixture
def stations(tmp_path: Path) -> tuple[Path, Path]:
    """Runs folders of two stations."""
    folders = tmp_path / "one", tmp_path / "two"
    for folder in folders:
        folder.mkdir()
    return folders


def exchange(folder: Path, url: str) -> None:
    """Exchange a folder once, as a process of its own would."""
    made = Exchange(folder, url, folder.name)
    made.exchange()
    assert made.outbox.pending == 0
    made.close()


def test_all_stations_see_all_runs(url: str, stations: tuple[Path, Path]) -> None:
    one, two = stations
    for number in range(60):
        write_result(one, f"a{number:02d}", number)
        write_result(two, f"b{number:02d}", number, outcome="failed", attempt=2)
    for folder in (one, two, one):
        exchange(folder, url)
    names = [f"{letter}{number:02d}" for letter in "ab" for number in range(60)]
    assert in_database(url) == [(name, "one" if name[0] == "a" else "two") for name in names]
    assert in_index(one) == in_index(two)
    assert [row[0] for row in in_index(one)] == names
    history = History(one)
    history.refresh()
    assert (history.attempts("SN-1"), history.count(RunFilter(station="two"))) == (120, 60)
    assert len(history.columns().values["gyro_bias_x"]) == 120
    for folder in (one, two):
        exchange(folder, url)
    assert len(in_database(url)) == 120


def test_a_changed_result_replaces_the_run(url: str, stations: tuple[Path, Path]) -> None:
    one, two = stations
    write_result(one, "a", 1, outcome="failed")
    write_result(one, "b", 2)
    exchange(one, url)
    exchange(two, url)
    released = {"by": "wang", "confirmed_by": None, "why": "known", "utc": "2026-11-02T00:00:00+00:00"}
    write_result(one, "a", 1, outcome="failed", override=released)
    exchange(one, url)
    exchange(two, url)
    assert [row[:3] for row in in_index(two)] == [("a", "one", "released"), ("b", "one", "passed")]
    assert [name for name, _ in in_database(url)] == ["b", "a"]


def test_the_database_has_result_digest_and_place_of_the_log(url: str, stations: tuple[Path, Path]) -> None:
    one, two = stations
    path = write_result(one, "a", 1)
    exchange(one, url)
    outbox = Outbox(one)
    engine = create_engine(url)
    with engine.connect() as connection:
        row = connection.execute(select(runs)).one()
    assert row.outbox == outbox.id
    assert row.log_sha256 == "0" * 64
    assert row.log.endswith(f":{path.with_suffix('.h5')}")
    assert '"gyro_bias_x"' in row.result
    outbox.add_copy("a", "s3://logs/a.h5", "1" * 64, 17)
    exchange(one, url)
    exchange(two, url)
    write_result(one, "a", 2)  # its log remains where it is
    exchange(one, url)
    with engine.connect() as connection:
        assert connection.execute(select(runs.c.log)).scalar_one() == "s3://logs/a.h5"
        copy = connection.execute(select(log_copies)).one()
    engine.dispose()
    assert (copy.url, copy.size, copy.file_sha256) == ("s3://logs/a.h5", 17, "1" * 64)
    assert [run.record.location for run in RunIndex(two).find(RunFilter())] == ["s3://logs/a.h5"]


def test_a_message_whose_arrival_was_not_noticed_is_not_repeated(url: str, stations: tuple[Path, Path]) -> None:
    one, _ = stations
    write_result(one, "a", 1)
    made = Exchange(one, url, "one")
    made.outbox.fill()
    kept = made.outbox.messages()
    made.exchange()
    with sqlite3.connect(one / FILE) as connection:  # as if the process had been killed before it deleted the message
        (number,) = {message.number for message in kept}
        row = (number, "run", '{"name": "a", "serial": "other", "log": ""}', b"")
        connection.execute("INSERT INTO messages VALUES (?, ?, ?, ?)", row)
    connection.close()
    write_result(one, "b", 2)
    made.exchange()
    assert [name for name, _ in in_database(url)] == ["a", "b"]
    assert made.outbox.pending == 0
    made.close()


@pytest.mark.parametrize("lost", ["index", "all", "some"])
def test_what_the_database_or_an_index_lost_is_sent_or_received_again(
    url: str, stations: tuple[Path, Path], lost: str
) -> None:
    one, two = stations
    for number in range(5):
        write_result(one, f"a{number}", number)
        exchange(one, url)
    write_result(two, "b", 9)
    Outbox(one).add_copy("a1", "s3://logs/a1.h5", "1" * 64, 17)
    for folder in (two, one):
        exchange(folder, url)
    before = in_index(two)
    assert len(before) == 6
    if lost == "index":
        for path in two.glob("history.sqlite*"):
            path.unlink()
    else:  # a backup without the last or without any messages was restored
        engine = create_engine(url)
        with engine.begin() as connection:
            connection.execute(delete(log_copies))
            here = runs.c.outbox == Outbox(one).id
            if lost == "all":
                connection.execute(delete(runs))
                connection.execute(delete(outboxes))
                connection.execute(update(revisions).values(last=0))
            else:
                connection.execute(delete(runs).where(here, runs.c.revision > 2))
                connection.execute(update(outboxes).where(outboxes.c.id == Outbox(one).id).values(last_number=2))
        engine.dispose()
        write_result(one, "c", 10)
        before = sorted([*before, ("c", "one", "passed", {"gyro_bias_x": 1.0})])
    write_result(two, "d", 11)
    before.append(("d", "two", "passed", {"gyro_bias_x": 0.1 * 11}))
    for folder in (one, two, one):
        exchange(folder, url)
    assert in_index(two) == in_index(one) == before
    assert len(in_database(url)) == len(before)
    assert len({name for name, _ in in_database(url)}) == len(before)


@pytest.mark.parametrize("column", ["content", "parameters", "failed_checks", "numbers"])
def test_a_run_that_cannot_be_read_holds_up_no_other(url: str, stations: tuple[Path, Path], column: str) -> None:
    one, two = stations
    for number in range(3):
        write_result(one, f"a{number}", number)
    exchange(one, url)
    engine = create_engine(url)
    with engine.begin() as connection:
        damaged = b"12345" if column == "numbers" else "17"
        connection.execute(update(runs).where(runs.c.name == "a1").values({column: damaged}))
    engine.dispose()
    exchange(two, url)
    assert [row[0] for row in in_index(two)] == ["a0", "a2"]
    write_result(one, "b", 3)
    for folder in stations:
        exchange(folder, url)
    assert [row[0] for row in in_index(two)] == ["a0", "a2", "b"]


def test_a_restored_outbox_loses_no_run(url: str, stations: tuple[Path, Path]) -> None:
    one, two = stations
    write_result(one, "a", 0)
    exchange(one, url)
    backup = (one / FILE).read_bytes()
    for number in range(1, 6):
        write_result(one, f"b{number}", number)
        exchange(one, url)
    (one / FILE).write_bytes(backup)  # with the rest of the folder
    for path in one.glob("b*.json"):
        path.unlink()
    for number in range(6, 9):
        write_result(one, f"c{number}", number)
    Outbox(one).fill()  # while the database was away: numbers that the database has for other runs
    for number in range(9, 12):
        write_result(one, f"d{number}", number)
    for folder in (one, two):
        exchange(folder, url)
    names = ["a", *(f"b{number}" for number in range(1, 6))]
    names += ["c6", "c7", "c8", "d10", "d11", "d9"]
    assert [row[0] for row in in_index(two)] == names
    assert sorted(name for name, _ in in_database(url)) == names
    write_result(one, "e", 12)
    exchange(one, url)
    assert in_database(url)[-1] == ("e", "one")


def test_a_lost_outbox_keeps_its_name(url: str, stations: tuple[Path, Path]) -> None:
    one, _ = stations
    for number in range(3):
        write_result(one, f"a{number}", number)
    exchange(one, url)
    name = Outbox(one).id
    (one / FILE).unlink()
    write_result(one, "b", 3)
    exchange(one, url)
    assert Outbox(one).id == name
    assert len(in_database(url)) == len(in_index(one)) == 4
    history = History(one)
    assert history.attempts("SN-1") == 4


@pytest.mark.parametrize(
    ("copied", "shown"),
    [
        (False, "folder is exchanged at its present place"),
        (True, "copy is exchanged as a folder of its own beside the original"),
    ],
)
def test_a_folder_at_another_place_is_exchanged_when_it_was_adopted(
    url: str, stations: tuple[Path, Path], copied: bool, shown: str, capsys: pytest.CaptureFixture[str]
) -> None:
    one, two = stations
    write_result(one, "a", 1)
    exchange(one, url)
    name = Outbox(one).id
    two.rmdir()
    shutil.copytree(one, two)
    with raises_code(ConfigurationError, "database.folder_moved") as caught:
        Exchange(two, url, "two")
    assert caught.value.values["was"] == f"{socket.gethostname()}:{one.resolve()}"
    assert run_app(["database", "adopt", "--out", str(two), *(["--copy"] if copied else [])]) == 0
    assert capsys.readouterr().err == f"{two}: From now on, this {shown}.\n"
    write_result(two, "b", 2)
    exchange(two, url)
    assert (Outbox(two).id != name) == copied
    assert sorted(name for name, _ in in_database(url)) == (["a", "a", "b"] if copied else ["a", "b"])
    assert run_app(["database", "adopt", "--out", str(two.parent)]) == 2
    assert "were never exchanged, so there is nothing to adopt" in capsys.readouterr().err


def test_a_copy_of_a_log_whose_run_is_not_queued_waits(
    url: str, stations: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    one, _ = stations
    write_result(one, "a", 1)
    outbox = Outbox(one)
    outbox.add_copy("a", "s3://logs/a.h5", "1" * 64, 17)
    with monkeypatch.context() as patch:
        patch.setattr(RunIndex, "own", lambda *_: [])  # the index was recreated in between
        assert outbox.fill() == 0
    exchange(one, url)
    assert Outbox(one).pending == 0
    assert in_database(url) == [("a", "one")]


def test_characters_that_a_database_does_not_have_hold_nothing_up(url: str, stations: tuple[Path, Path]) -> None:
    one, two = stations
    check = {"name": "\ud800\0", "value": 2.0, "limit": 1.0, "unit": "1", "passed": False}
    write_result(one, "a", 1, outcome="failed", checks=[check], operator="li\0", error="no\0answer")
    write_result(one, "b", 2, "SN-\0")
    write_result(one, "c", 3, station="\ud800")
    write_result(one, "d", 4)
    exchange(one, url)
    exchange(two, url)
    assert [row[0] for row in in_index(two)] == ["a", "d"]
    assert RunIndex(two).find(RunFilter(names=("a",)))[0].failed_checks == ("\ud800\0",)


def test_a_folder_with_more_runs_than_an_outbox_holds(
    url: str, stations: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calstation.database.outbox.CAPACITY", 7)
    one, _ = stations
    for number in range(40):
        write_result(one, f"a{number:02d}", number)
    outbox = Outbox(one)
    assert (outbox.fill(), outbox.fill(), outbox.pending) == (7, 0, 40)
    exchange(one, url)
    assert [name for name, _ in in_database(url)] == [f"a{number:02d}" for number in range(40)]


def test_a_run_waits_once_with_its_changes_and_the_copy_of_its_log(stations: tuple[Path, Path]) -> None:
    one, _ = stations
    outbox = Outbox(one)
    for number in range(3):
        write_result(one, "a", number)
        outbox.fill()
    outbox.add_copy("a", "s3://logs/a.h5", "0" * 64, 1)
    outbox.fill()
    assert (len(outbox.messages()), outbox.pending) == (4, 1)


def test_without_the_database_messages_wait(postgres, shared_database: str, stations: tuple[Path, Path]) -> None:
    one, two = stations
    exchange(two, shared_database)
    made = Exchange(one, shared_database, "one")
    made.exchange()
    postgres.stop()
    try:
        for number in range(3):
            write_result(one, f"a{number}", number)
            with raises_code(ConfigurationError, "database.unreachable"):
                made.exchange()
            assert made.outbox.pending == number + 1
    finally:
        postgres.start()
    made.exchange()
    assert made.outbox.pending == 0
    made.close()
    exchange(two, shared_database)
    assert [row[0] for row in in_index(two)] == ["a0", "a1", "a2"]


def test_an_outbox_is_on_disk_before_its_message_is_sent(tmp_path: Path) -> None:
    outbox = Outbox(tmp_path)
    with outbox._transaction() as connection:
        assert connection.execute(text("PRAGMA synchronous")).scalar_one() == 2  # FULL
    (tmp_path / FILE).write_bytes(b"no database at all" * 1000)
    with raises_code(ConfigurationError, "database.outbox_unusable"):
        outbox.fill()


def test_results_of_other_stations_are_exported_and_compared(url: str, stations: tuple[Path, Path]) -> None:
    one, two = stations
    write_result(one, "a", 1, outcome="failed")
    write_result(two, "b", 2)
    for folder in (one, two):
        exchange(folder, url)
    station, target = station_file(two, url), two.parent / "runs.json"
    runs = History(two).runs()
    assert [run.origin == "" for run in runs] == [True, False]
    with raises_code(InputError, "result.elsewhere"):
        load_results(ignore_progress, two, runs)
    found = load_shared_results(ignore_progress, station, two, runs)
    assert [(result.station, result.outcome) for result in found] == [("two", "passed"), ("one", "failed")]
    export_shared_runs(ignore_progress, station, two, RunFilter(), target)
    assert [row["station"] for row in json.loads(target.read_text("utf-8"))] == ["two", "one"]
    table = two.parent / "runs.csv"
    export_shared_runs(ignore_progress, None, two, RunFilter(), table)  # needs no database
    rows = list(csv.DictReader(table.read_text("utf-8").splitlines()))
    assert [(row["station"], float(row["gyro_bias_x"])) for row in rows] == [("two", 0.2), ("one", 0.1)]
    assert History(two).refresh() == 0  # the copies are no runs of this folder
