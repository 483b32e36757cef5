"""Stations exchange runs through the database: each run once, in order, and every station sees all runs."""

import csv
import json
import random
import shutil
import socket
from collections.abc import Sequence
from pathlib import Path

import pytest
from sqlalchemy import Connection, create_engine, delete, event, select, update
from sqlalchemy.exc import DataError
from sqlalchemy.pool import NullPool

from calstation.cli.app import run_app
from calstation.config import site_folder
from calstation.database import (
    ArchivedLog,
    Exchange,
    LogArchiver,
    Outbox,
    exchange_once,
    export_shared_runs,
    load_shared_results,
    log_copies,
    read_state,
    revisions,
    runs,
)
from calstation.database.exchange import _store
from calstation.database.outbox import COPIES_FILE, OutboxMessage
from calstation.database.tables import outboxes, trail_heads
from calstation.errors import ConfigurationError, InputError
from calstation.records import RunFilter, RunIndex, append_audit
from calstation.records.run_index import FILE
from calstation.results import History, load_result, load_results, override_of
from tests.database.result_files import in_database, in_index, write_result
from tests.database.test_claims import station_file
from tests.helpers import ignore_progress, raises_code, write_log_of


@pytest.fixture
def stations(tmp_path: Path) -> tuple[Path, Path]:
    """Runs folders of two stations."""
    folders = tmp_path / "one", tmp_path / "two"
    for folder in folders:
        folder.mkdir()
    return folders


def exchange(folder: Path, url: str) -> None:
    """Exchange a folder once, as a separate process would."""
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


def test_runs_are_sent_although_the_heads_of_trails_are_refused(url: str, stations: tuple[Path, Path]) -> None:
    one, two = stations
    write_result(one, "a", 1)
    engine = create_engine(url)
    trail_heads.drop(engine)
    engine.dispose()
    for folder in stations:
        with pytest.raises(ConfigurationError, match="trail_heads"):
            exchange(folder, url)
    assert in_database(url) == [("a", "one")]
    assert [row[0] for row in in_index(two)] == ["a"]


def test_run_whose_files_are_removed_during_an_exchange_is_sent_when_they_are_restored(
    url: str, stations: tuple[Path, Path]
) -> None:
    one, _ = stations
    noticed, unnoticed = (write_result(one, name, number) for number, name in enumerate("ab"))
    write_result(one, "c", 2)
    exchanged = Exchange(one, url, "one")
    outbox = exchanged.outbox
    assert outbox.refresh()
    kept = {path: path.with_suffix(".kept") for path in (noticed, unnoticed)}
    noticed.rename(kept[noticed])
    History(one).refresh()
    unnoticed.rename(kept[unnoticed])
    assert [message.columns["name"] for page in outbox.pages() for message in page] == ["c"]
    exchanged.exchange()
    assert in_database(url) == [("c", "one")]
    for path, copy in kept.items():
        copy.rename(path)
    exchanged.exchange()
    exchanged.close()
    assert sorted(in_database(url)) == [(name, "one") for name in "abc"]
    engine = create_engine(url)
    with engine.connect() as connection:
        assert all(connection.execute(select(runs.c.result)).scalars())
        assert not any(
            json.loads(content)["missing"] for content in connection.execute(select(runs.c.content)).scalars()
        )
    engine.dispose()


def test_a_changed_result_replaces_the_run(
    url: str, stations: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    one, two = stations
    monkeypatch.setenv("CALSTATION_HOME", str(one.parent / "home"))
    failed = load_result(write_result(one, "a", 1, outcome="failed"))
    write_result(one, "b", 2)
    exchange(one, url)
    exchange(two, url)
    event = append_audit(site_folder(), "override", "wang", "known", log_sha256=failed.log.sha256)
    write_result(one, "a", 1, outcome="failed", override=override_of(event).model_dump())
    exchange(one, url)
    exchange(two, url)
    assert [row[:3] for row in in_index(two)] == [("a", "one", "released"), ("b", "one", "passed")]
    assert [name for name, _ in in_database(url)] == ["b", "a"]


def test_database_contains_the_result_digest_and_the_log_location(url: str, stations: tuple[Path, Path]) -> None:
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
    write_result(one, "b", 2)
    for name in "ba":
        outbox.add_copy(ArchivedLog(name, f"s3://logs/{name}.h5", "1" * 64, 17))
    exchange(one, url)
    exchange(two, url)
    write_result(one, "a", 2)  # the log remains at its location
    exchange(one, url)
    locations = ["s3://logs/a.h5", "s3://logs/b.h5"]
    with engine.connect() as connection:
        assert connection.execute(select(runs.c.log).order_by(runs.c.name)).scalars().all() == locations
        copy = connection.execute(select(log_copies).order_by(log_copies.c.name)).first()
    engine.dispose()
    assert copy is not None
    assert (copy.url, copy.size, copy.file_sha256) == ("s3://logs/a.h5", 17, "1" * 64)
    assert sorted(run.record.location or "" for run in RunIndex(two).find(RunFilter())) == locations


def test_message_without_an_acknowledgement_is_not_stored_twice(
    url: str, stations: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    one, _ = stations
    write_result(one, "a", 1)
    made = Exchange(one, url, "one")
    with monkeypatch.context() as patch:  # as if the process had been killed before it noted the acknowledgement
        patch.setattr(Outbox, "acknowledge", lambda *_, **__: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            made.exchange()
    assert in_database(url) == [("a", "one")]
    stored: list[str] = []

    def store(connection: Connection, outbox: str, messages: Sequence[OutboxMessage]) -> int:
        stored.extend(message.columns["name"] for message in messages)
        return _store(connection, outbox, messages)

    monkeypatch.setattr("calstation.database.exchange._store", store)
    write_result(one, "b", 2)
    made.exchange()
    assert stored == ["b"]
    assert [name for name, _ in in_database(url)] == ["a", "b"]
    assert made.outbox.pending == 0
    made.close()


def test_messages_are_not_stored_if_another_process_has_sent_some(url: str, stations: tuple[Path, Path]) -> None:
    one, _ = stations
    write_result(one, "a", 1)
    made = Exchange(one, url, "one")
    engine = made._connected()
    made._synchronise(engine)
    assert made.outbox.refresh()
    (page,) = [messages for messages in made.outbox.pages() if messages]
    exchange(one, url)  # another process, which does not wait for this one
    made.outbox.acknowledge(0, [], replace=True)  # this process does not know the acknowledgement yet
    made._deliver(engine, page)
    made.close()
    assert in_database(url) == [("a", "one")]
    with create_engine(url, poolclass=NullPool).connect() as connection:
        assert connection.execute(select(runs.c.revision)).scalar_one() == made.outbox.revision


@pytest.mark.long
@pytest.mark.parametrize("lost", ["index", "all", "some"])
def test_runs_lost_by_the_database_or_an_index_are_restored(url: str, stations: tuple[Path, Path], lost: str) -> None:
    one, two = stations
    for number in range(5):
        write_result(one, f"a{number}", number)
        exchange(one, url)
    write_result(two, "b", 9)
    Outbox(one).add_copy(ArchivedLog("a1", "s3://logs/a1.h5", "1" * 64, 17))
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
                second = select(runs.c.revision).where(here).order_by(runs.c.revision).offset(1).limit(1)
                connection.execute(delete(runs).where(here, runs.c.revision > connection.execute(second).scalar_one()))
                connection.execute(update(outboxes).where(outboxes.c.id == Outbox(one).id).values(revision=2))
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
def test_unreadable_run_does_not_delay_other_runs(url: str, stations: tuple[Path, Path], column: str) -> None:
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


@pytest.mark.parametrize("at_c", ["before", "after"])
def test_database_restored_from_a_backup_loses_no_run(
    request: pytest.FixtureRequest, url: str, tmp_path: Path, at_c: str
) -> None:
    a, b, c = folders = [tmp_path / name for name in "abc"]
    for number, folder in enumerate(folders):
        folder.mkdir()
        write_result(folder, f"{folder.name}0", number)
        exchange(folder, url)
    restored = backup(request, url)
    for number in range(1, 4):
        write_result(a, f"a{number}", number)
    for folder in (a, b) if at_c == "before" else (a, b, c):
        exchange(folder, url)
    assert [row[0] for row in in_index(b) if row[0].startswith("a")] == ["a0", "a1", "a2", "a3"]

    # the database is restored, which loses three runs of station `a`, which is off
    for number in range(1, 6):
        write_result(c, f"c{number}", number)
    for folder in (c, b):
        exchange(folder, restored)
    assert [row[0] for row in in_index(b) if row[0].startswith("c")] == [f"c{number}" for number in range(6)]
    for folder in (a, b, c):
        exchange(folder, restored)
    assert in_index(a) == in_index(b) == in_index(c)
    assert len(in_index(a)) == len(in_database(restored)) == 11


def backup(request: pytest.FixtureRequest, url: str) -> str:
    """Copy a database, and return the URL of the copy."""
    if url.startswith("sqlite"):
        path = Path(url.removeprefix("sqlite:///"))
        return f"sqlite:///{shutil.copyfile(path, path.with_name('restored.sqlite'))}"
    server = request.getfixturevalue("postgres")
    return str(server.url(server.new_database(url.rpartition("/")[2])))


def test_folder_restored_from_a_backup_loses_no_run(url: str, stations: tuple[Path, Path]) -> None:
    one, two = stations
    write_result(one, "a", 0)
    exchange(one, url)
    backup = (one / FILE).read_bytes()
    for number in range(1, 6):
        write_result(one, f"b{number}", number)
        exchange(one, url)
    for path in one.glob(f"{FILE}*"):
        path.unlink()
    (one / FILE).write_bytes(backup)
    for path in one.glob("b*.json"):
        path.unlink()
    for number in range(6, 9):
        write_result(one, f"c{number}", number)
    for folder in (one, two):
        exchange(folder, url)
    names = ["a", *(f"b{number}" for number in range(1, 6)), "c6", "c7", "c8"]
    assert [row[0] for row in in_index(two)] == names
    assert sorted(name for name, _ in in_database(url)) == names
    write_result(one, "e", 12)
    exchange(one, url)
    assert in_database(url)[-1] == ("e", "one")


def test_folder_without_its_index_keeps_its_id(url: str, stations: tuple[Path, Path]) -> None:
    one, _ = stations
    for number in range(3):
        write_result(one, f"a{number}", number)
    exchange(one, url)
    name = Outbox(one).id
    for path in one.glob(f"{FILE}*"):
        path.unlink()
    write_result(one, "b", 3)
    exchange(one, url)
    assert Outbox(one).id == name
    assert len(in_database(url)) == len(in_index(one)) == 4
    history = History(one)
    assert history.attempts("SN-1") == 4


@pytest.mark.parametrize(
    ("copied", "shown"),
    [
        (False, "folder is exchanged at its new location"),
        (True, "copy is exchanged as a separate folder, in addition to the original"),
    ],
)
def test_moved_folder_is_exchanged_only_after_adoption(
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


def test_log_copy_waits_until_its_run_is_sent(
    url: str, stations: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    one, _ = stations
    write_result(one, "a", 1)
    outbox = Outbox(one)
    outbox.add_copy(ArchivedLog("a", "s3://logs/a.h5", "1" * 64, 17))
    with monkeypatch.context() as patch:
        patch.setattr(RunIndex, "runs_by_name", lambda *_: [])  # as if the index had been recreated in the meantime
        assert outbox.refresh()
        assert [messages for messages in outbox.pages() if messages] == []
    exchange(one, url)
    assert Outbox(one).pending == 0
    assert in_database(url) == [("a", "one")]


def test_characters_invalid_in_the_database_do_not_block_the_exchange(url: str, stations: tuple[Path, Path]) -> None:
    one, two = stations
    check = {"name": "\ud800\0", "value": 2.0, "limit": 1.0, "unit": "1", "passed": False}
    write_result(one, "a", 1, outcome="failed", checks=[check], operator="li\0", error="no\0answer")
    write_result(one, "b", 2, "SN-\0")
    write_result(one, "c", 3, station="\ud800")
    write_result(one, "d", 4)
    exchange(one, url)
    exchange(two, url)
    assert [row[0] for row in in_index(two)] == ["a", "d"]
    assert RunIndex(two).find(RunFilter(names=("a",)))[0].failed_checks == (("other", "\ud800\0"),)


#: Runs that PostgreSQL refuses: too long for a column, or for an index.
REFUSED = {
    "value too long": {"log": {"file": "b.h5", "sha256": "0" * 100}},
    "index row": {"serial": "".join(random.Random(1).choices("0123456789ABCDEF", k=9000))},
}


@pytest.mark.parametrize("reason", REFUSED)
def test_run_rejected_by_the_database_does_not_delay_other_runs(
    shared_database: str, stations: tuple[Path, Path], capsys: pytest.CaptureFixture[str], reason: str
) -> None:
    one, two = stations
    for number, name in enumerate("abc"):
        write_result(one, name, number, **REFUSED[reason] if name == "b" else {})
        Outbox(one).add_copy(ArchivedLog(name, f"s3://logs/{name}.h5", "1" * 64, 17))
    command = ["database", "exchange", "--station", str(station_file(one, shared_database)), "--out", str(one)]
    assert run_app(command) == 2
    shown = capsys.readouterr().err
    assert "Runs of this folder that the shared database refuses: 1; the last one is b: " in shown
    assert reason in shown
    assert "All runs" not in shown
    assert run_app(["database", "status", "--out", str(one)]) == 0
    assert "the last one is b: " in capsys.readouterr().out
    state = read_state(one)
    assert (state.pending, state.error) == (0, None)
    write_result(one, "d", 3)
    for folder in stations:
        exchange(folder, shared_database)
    assert [row[0] for row in in_index(two)] == ["a", "c", "d"]
    assert [run.record.location for run in RunIndex(two).find(RunFilter(names=("c",)))] == ["s3://logs/c.h5"]

    write_result(one, "b", 1)  # a corrected result, whose log has been restored
    write_log_of(one / "b.json")
    assert run_app(command) == 0
    assert "All runs of the folder are in the shared database." in capsys.readouterr().err
    exchange(two, shared_database)
    assert [row[0] for row in in_index(two)] == ["a", "b", "c", "d"]
    locations = {run.name: run.record.location for run in RunIndex(two).find(RunFilter())}
    assert [locations[name] for name in "abc"] == [f"s3://logs/{name}.h5" for name in "abc"]


def test_rejected_runs_are_counted_while_they_exist(
    stations: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def store(connection: Connection, outbox: str, messages: Sequence[OutboxMessage]) -> int:
        if any(message.columns["name"].startswith("b") for message in messages):
            raise DataError("", None, Exception("too long"))
        return _store(connection, outbox, messages)

    monkeypatch.setattr("calstation.database.exchange._store", store)
    one, _ = stations
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    for number, name in enumerate(["a", "b1", "b2", "c"]):
        write_result(one, name, number)
    made = Exchange(one, url, "one")
    for count, run in ((2, "b2"), (1, "b1")):
        state = exchange_once(made, one)
        assert state.refusal is not None
        assert state.refusal.values == {"count": count, "run": run, "reason": "too long"}
        (one / f"{run}.json").unlink()
    assert exchange_once(made, one).refusal is None
    made.close()
    assert [name for name, _ in in_database(url)] == ["a", "c"]


def test_error_unrelated_to_a_run_skips_no_run(postgres, shared_database: str, stations: tuple[Path, Path]) -> None:
    one, _ = stations
    write_result(one, "a", 1)
    name = shared_database.rpartition("/")[2]
    postgres.execute("ALTER TABLE runs ADD CONSTRAINT closed CHECK (false)", name)
    made = Exchange(one, shared_database, "one")
    with raises_code(ConfigurationError, "database.refused"):
        made.exchange()
    postgres.execute("ALTER TABLE runs DROP CONSTRAINT closed", name)
    made.exchange()
    made.close()
    assert [name for name, _ in in_database(shared_database)] == ["a"]


def test_page_of_runs_needs_few_statements(url: str, stations: tuple[Path, Path]) -> None:
    one, _ = stations
    for number in range(50):
        write_result(one, f"a{number:02d}", number)
        Outbox(one).add_copy(ArchivedLog(f"a{number:02d}", f"s3://logs/a{number:02d}.h5", "1" * 64, 17))
    made = Exchange(one, url, "one")
    engine = made._connected()
    made._synchronise(engine)
    assert made.outbox.refresh()
    statements: list[str] = []
    event.listen(engine, "before_cursor_execute", lambda *args: statements.append(args[2].split()[1:3]))
    for messages in made.outbox.pages():
        made._send(engine, messages)
    made.close()
    begin = [["now()", "AS"], ["revisions", "SET"]][url.startswith("sqlite") :]
    end = [["outboxes", "SET"]]
    copies = [["INTO", "log_copies"], ["runs", "SET"]]
    assert statements == [*begin, ["INTO", "runs"], *end, *begin, *copies, *end]
    assert len(in_database(url)) == 50


@pytest.mark.long
def test_claims_are_exchanged_before_a_backlog_of_runs(url: str, stations: tuple[Path, Path]) -> None:
    one, two = stations
    for number in range(170):
        write_result(one, f"a{number:03d}", number)
    there = Exchange(two, url, "two", {"SN-1": "li"})
    there.exchange()
    made = Exchange(one, url, "one", {"SN-1": None})
    pending = []
    while not made.complete:
        assert [claim.station for claim in made.exchange(0.0)] == ["two"]
        assert [claim.station for claim in there.exchange()] == ["one"]
        pending.append(made.outbox.pending)
    assert pending[:2] == [0, 0]  # the runs are read, 100 at a time
    assert pending[2:6] == [120, 70, 20, 0]
    made.close()
    there.close()


def test_an_exchange_without_changes_reads_no_rows(
    url: str, stations: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    one, _ = stations
    write_result(one, "a", 1)
    made = Exchange(one, url, "one")
    made.exchange()
    made.exchange()  # with the revision of its own run
    monkeypatch.setattr("calstation.records.run_index._rows", lambda *_: pytest.fail("rows of the index are read"))
    monkeypatch.setattr("calstation.database.exchange._indexed_run", lambda *_: pytest.fail("rows are received"))
    monkeypatch.setattr("calstation.database.outbox._file_time", lambda *_: pytest.fail("runs are compared"))
    made.exchange()
    monkeypatch.undo()
    other = Exchange(one, url, "one")  # a service that exchanges the same folder
    write_result(one, "b", 2)
    other.exchange()
    made.exchange()
    write_result(one, "c", 3)
    made.exchange()
    for each in (made, other):
        each.close()


def test_run_with_changes_and_a_log_copy_is_pending_once(stations: tuple[Path, Path]) -> None:
    one, _ = stations
    outbox = Outbox(one)
    for number in range(3):
        write_result(one, "a", number)
        outbox.refresh()
    outbox.add_copy(ArchivedLog("a", "s3://logs/a.h5", "0" * 64, 1))
    outbox.refresh()
    assert outbox.pending == 1


def test_messages_stay_pending_without_the_database(
    postgres, shared_database: str, stations: tuple[Path, Path]
) -> None:
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


def test_damaged_record_of_copies_is_reported_and_blocks_no_run(url: str, stations: tuple[Path, Path]) -> None:
    one, _ = stations
    write_result(one, "a", 1)
    outbox = Outbox(one)
    outbox.add_copy(ArchivedLog("a", "s3://logs/a.h5", "0" * 64, 1))
    path = one / COPIES_FILE
    path.write_text(path.read_text("utf-8").replace("a.h5", "b.h5"), "utf-8")
    exchange(one, url)
    assert in_database(url) == [("a", "one")]
    with raises_code(InputError, "database.copies_damaged"):
        LogArchiver(one, str(one)).copy_next()


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
    assert [(row["station"], float(row["gyro_bias_x [rad/s]"])) for row in rows] == [("two", 0.2), ("one", 0.1)]
    assert History(two).refresh() == 0  # the copies are not runs of this folder


@pytest.mark.parametrize("content", [None, b"", b"{", b"[]", b"\0" * 60])
@pytest.mark.parametrize("damaged", [".outbox.json", ".outbox-copy.json"])
def test_damaged_outbox_is_restored_from_its_copy(tmp_path: Path, damaged: str, content: bytes | None) -> None:
    name, file = Outbox(tmp_path).id, tmp_path / damaged
    intact = file.read_bytes()
    if content is None:
        file.unlink()
    else:
        file.write_bytes(content)
    assert Outbox(tmp_path).id == name
    assert file.read_bytes() == intact
