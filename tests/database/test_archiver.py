"""The exchange of a station copies closed logs to the archive and publishes their locations to other stations."""

import os
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from uuid import uuid4

import pytest
from sqlalchemy import create_engine, select

from calstation.cli.app import run_app
from calstation.config import library
from calstation.database import (
    Exchange,
    LogArchiver,
    Outbox,
    fetch_log,
    fetch_result,
    log_copies,
    read_state,
    remote,
    watch,
)
from calstation.database.process import ARCHIVE_RETRY_S, MAX_ARCHIVE_RETRY_S, PAUSE_S, _copy_logs
from calstation.errors import ConfigurationError, InputError
from calstation.records import RunFilter, RunIndex, RunRecord, Verdict, acquire_lock
from calstation.results import load_result
from tests.database.result_files import in_database, write_result
from tests.database.test_exchange_process import eventually
from tests.helpers import ignore_progress, raises_code, write_log_of


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Runs folder of a station with two runs."""
    made = tmp_path / "line 1"
    made.mkdir()
    for number, name in enumerate("ab"):
        write_result(made, name, number)
        write_log_of(made / f"{name}.json")
    return made


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """Existing folder of the archive, like a mounted share."""
    made = tmp_path / "archive"
    made.mkdir()
    return made


def station_file(folder: Path, url: str) -> Path:
    """The virtual bench as a station that shares its records."""
    shipped = library.find("stations", "virtual_bench").read_text(encoding="utf-8")
    path = folder.parent / f"{folder.name}.toml"
    path.write_text(f'{shipped}\n[records]\ndatabase = "{url}"\n', encoding="utf-8")
    return path


def until(condition: Callable[[], bool]) -> Callable[[float], bool]:
    """Return a `wait` that ends an exchange when a condition holds."""

    def wait(_: float) -> bool:
        time.sleep(0.05)
        return condition()

    return wait


def received(folder: Path) -> dict[str, RunRecord]:
    return {run.name: run.record for run in RunIndex(folder).find(RunFilter())}


def test_logs_are_archived_and_read_by_another_station_from_the_archive(
    url: str, folder: Path, archive: Path, tmp_path: Path
) -> None:
    outbox = Outbox(folder)
    watch(
        folder,
        url,
        "line 1",
        until(lambda: len(outbox.copies()) == 2 and outbox.pending == 0),
        archive=str(archive),
    )
    eventually(lambda: read_state(folder).logs_pending == 0)
    state = read_state(folder)
    assert (state.pending, state.archive_error) == (0, None)
    assert sorted(path.name for path in (archive / outbox.id).iterdir()) == ["a.h5", "b.h5"]
    other = tmp_path / "line 2"
    other.mkdir()
    exchange = Exchange(other, url, "line 2")
    exchange.exchange()
    exchange.close()
    run = received(other)["a"]
    assert (run.origin, run.location) == (outbox.id, str(archive / outbox.id / "a.h5"))
    assert fetch_log(ignore_progress, run).read_bytes() == (folder / "a.h5").read_bytes()
    assert run.log == other / outbox.id / "a.h5"
    result = fetch_result(ignore_progress, station_file(other, url), run)
    assert load_result(result) == load_result(folder / "a.json")


def test_the_least_recently_used_copies_of_logs_are_deleted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remote, "_MAX_COPIES_SIZE", 25)
    folder, one, other = tmp_path / "runs", str(uuid4()), str(uuid4())
    (folder / "kept").mkdir(parents=True)
    begun, log = "2026-01-01T00:00:00+00:00", folder / "x"
    run = RunRecord("SN-1", begun, Verdict.PASSED, 1, None, "line 2", None, (), log, None, 1.0)

    def fetched(name: str, origin: str, used: float) -> Path:
        source = tmp_path / f"{name}.h5"
        source.write_bytes(b"ten bytes.")
        log = folder / origin / source.name
        fetch_log(ignore_progress, replace(run, log=log, origin=origin, location=str(source)))
        os.utime(log, (used, log.stat().st_mtime))
        return log

    for own in (folder / "own.h5", folder / "kept" / "own.h5"):  # neither is a copy
        own.write_bytes(bytes(100))
        os.utime(own, (0.0, 0.0))
    a, b = fetched("a", one, 1000.0), fetched("b", other, 2000.0)
    assert a.exists()
    a.with_suffix(".json").write_text("{}")
    remote.note_use(a)
    c = fetched("c", one, 3000.0)
    assert (a.exists(), b.exists(), c.exists()) == (True, False, True)
    monkeypatch.setattr(remote, "_MAX_COPIES_SIZE", 5)
    fetched("d", other, 4000.0)  # larger than the bound by itself
    assert sorted(path.name for path in folder.rglob("*.h5")) == ["d.h5", "own.h5", "own.h5"]
    assert a.with_suffix(".json").exists()


def test_fetching_a_result_requires_its_database(folder: Path, tmp_path: Path) -> None:
    write_result(folder, "a", 1)
    exchange = Exchange(folder, f"sqlite:///{tmp_path / 'shared.sqlite'}", "line 1")
    exchange.exchange()
    exchange.close()
    run = replace(received(folder)["a"], origin="other")
    with raises_code(ConfigurationError, "database.not_named"):
        fetch_result(ignore_progress, None, run)
    away = station_file(folder, "postgresql+psycopg://station@127.0.0.1:9/calstation")
    with raises_code(ConfigurationError, "database.unreachable"):
        fetch_result(ignore_progress, away, run)


@pytest.mark.long
def test_exchange_continues_without_the_archive_and_retries_it(url: str, folder: Path, tmp_path: Path) -> None:
    share = tmp_path / "share"
    outbox = Outbox(folder)
    watch(
        folder, url, "line 1", until(lambda: read_state(folder).archive_error is not None), archive=str(share / "logs")
    )
    state = read_state(folder)
    assert (state.pending, state.error, state.logs_pending) == (0, None, 2)
    assert state.archive_error is not None
    assert state.archive_error.code == "database.archive_absent"
    assert not share.exists()
    (share / "logs").mkdir(parents=True)
    watch(folder, url, "line 1", until(lambda: len(outbox.copies()) == 2), archive=str(share / "logs"))
    eventually(lambda: read_state(folder).logs_pending == 0)
    assert read_state(folder).archive_error is None


@pytest.mark.long
def test_unresponsive_archive_delays_no_exchange(
    url: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calstation.database.process._LAST_COPIES_S", 0.1)
    hangs, goes_on = threading.Event(), threading.Event()

    def hang(*_: object) -> None:
        hangs.set()
        goes_on.wait()

    monkeypatch.setattr("calstation.database.archive.archive_log", hang)
    written = []

    def wait(_: float) -> bool:
        hangs.wait()
        names = [name for name, _ in in_database(url)]
        if not written:
            written.append(write_result(folder, "c", 3))
        return "c" in names

    watch(folder, url, "line 1", wait, archive=str(tmp_path / "archive"))
    assert [name for name, _ in in_database(url)] == ["a", "b", "c"]
    goes_on.set()


def test_logs_of_the_last_runs_are_archived_before_the_exchange_ends(url: str, folder: Path, archive: Path) -> None:
    started = until(lambda: len(Outbox(folder).copies()) == 2)

    def wait(pause: float) -> bool:
        ended = started(pause)
        if ended:
            (folder / "c.h5").write_bytes(b"samples of c")
            write_result(folder, "c", 3)
        return ended

    watch(folder, url, "line 1", wait, archive=str(archive))
    assert sorted(Outbox(folder).copies()) == ["a", "b", "c"]
    engine = create_engine(url)
    with engine.connect() as connection:
        assert sorted(connection.execute(select(log_copies.c.name)).scalars()) == ["a", "b", "c"]
    engine.dispose()


def test_archive_error_is_cleared_when_the_archive_is_removed_from_the_settings(
    url: str, folder: Path, tmp_path: Path
) -> None:
    (tmp_path / "share").write_text("not mounted")
    failed = until(lambda: read_state(folder).archive_error is not None)
    watch(folder, url, "line 1", failed, archive=str(tmp_path / "share" / "logs"))
    watch(folder, url, "line 1", lambda _: True)
    state = read_state(folder)
    assert (state.pending, state.logs_pending, state.archive_error) == (0, 0, None)


def test_each_log_is_opened_once_for_all_copies(
    url: str, folder: Path, archive: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = []
    monkeypatch.setattr("calstation.database.archiver.being_written", lambda log: opened.append(log.name))
    Outbox(folder).refresh()
    archiver = LogArchiver(folder, str(archive))
    assert [archiver.copy_next() for _ in range(4)] == [True, True, False, False]
    assert opened == ["a.h5", "b.h5"]
    monkeypatch.setattr(Outbox, "copies", lambda _: pytest.fail("the logs are listed again"))
    assert not archiver.copy_next()
    monkeypatch.undo()
    write_result(folder, "c", 3)
    (folder / "c.h5").write_bytes(b"samples of c")
    Outbox(folder).refresh()
    with (folder / "c.h5").open() as running:
        assert acquire_lock(running.fileno(), 0.0)
        assert not archiver.copy_next()
    assert archiver.copy_next()


def test_pauses_grow_after_repeated_failures(
    url: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pauses: list[float] = []

    class Stop(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            pauses.append(timeout or 0.0)
            if len(pauses) == 10:
                (tmp_path / "share").mkdir()
            if len(pauses) == 11:
                self.set()
            return True

    Outbox(folder).refresh()
    _copy_logs(folder, str(tmp_path / "share"), Stop())
    assert pauses == [ARCHIVE_RETRY_S * 2**k for k in range(7)] + [MAX_ARCHIVE_RETRY_S] * 3 + [PAUSE_S]


def test_uncopyable_log_does_not_delay_other_logs(url: str, folder: Path, archive: Path) -> None:
    exchange = Exchange(folder, url, "line 1")
    exchange.exchange()
    (archive / exchange.outbox.id / "a.h5").mkdir(parents=True)  # prevents the copy of a.h5
    archiver = LogArchiver(folder, str(archive))
    with raises_code(InputError, "database.archive_failed"):
        archiver.copy_next()
    assert archiver.copy_next()
    assert list(exchange.outbox.copies()) == ["b"]
    exchange.close()


def test_archive_command_copies_all_logs_and_reports_a_missing_archive(
    url: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    station, archive = station_file(folder, url), tmp_path / "archive"
    with station.open("a", encoding="utf-8") as file:
        file.write(f'archive = "{archive}"\n')
    command = ["database", "exchange", "--station", str(station), "--out", str(folder)]
    assert run_app(command) == 2
    exchanged = "All runs of the folder are in the shared database."
    assert " ".join(capsys.readouterr().err.split()) == (
        f"{exchanged} Program: The archive {archive} does not exist, so logs wait to be copied into it. "
        "Mount its share or create the folder; a window or a service tries again automatically."
    )
    assert not archive.exists()
    archive.mkdir()
    assert run_app(command) == 0
    outbox = Outbox(folder)
    assert (outbox.pending, sorted(outbox.copies())) == (0, ["a", "b"])
    assert capsys.readouterr().err == f"{exchanged}\n"
