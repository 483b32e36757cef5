"""Processes of two stations that send runs to a database and receive them, while runs end and windows read History.

The database loses connections at any moment, also after a commit whose confirmation does not arrive, and processes are
killed.
"""

import os
import shutil
import sqlite3
import threading
import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from random import Random
from typing import Any

import pytest
from sqlalchemy import create_engine, select

from calstation.database import (
    ArchivedLog,
    Exchange,
    Outbox,
    connect,
    exchange,
    exchange_once,
    log_copies,
    outbox,
    process,
    read_state,
    revisions,
    runs,
)
from calstation.records import RunFilter, files, run_index
from calstation.records.run_index import FILE
from calstation.results import History, history, stated
from tests.database.result_files import in_index, write_result
from tests.interleaving.scheduler import Scheduler, Thread, failing_seed, run_seeds, with_seeds

MODULES = (exchange, outbox, process, run_index, history, files)
DATABASE = "shared.sqlite"
RUNS = 3
SERIAL = "SN-1"
OVERRIDE = {"by": "wang", "confirmed_by": None, "why": "known", "utc": "2026-11-02T00:00:00+00:00"}
CONNECT = sqlite3.connect


class Cursor(sqlite3.Cursor):
    """A cursor that waits in virtual time for a locked file, and may lose its connection."""

    connection: "Connection"

    def execute(self, *arguments: Any) -> Any:
        return self.connection.attempt(super().execute, *arguments)

    def executemany(self, *arguments: Any) -> Any:
        return self.connection.attempt(super().executemany, *arguments)


class Connection(sqlite3.Connection):
    """A connection that waits in virtual time for a locked file, and may be lost."""

    patience = 0.0
    #: Number of statements and commits until the connection is lost, and whether the last one is executed.
    life, executes_last = float("inf"), False

    def cursor(self, factory: Any = Cursor) -> Any:
        return super().cursor(factory)

    def commit(self) -> None:
        self.attempt(super().commit)

    def attempt(self, action: Callable[..., Any], *arguments: Any) -> Any:
        deadline = time.monotonic() + self.patience
        self.life -= 1
        while True:
            try:
                if self.life > 0 or self.executes_last:
                    result = action(*arguments)
                if self.life <= 0:
                    raise sqlite3.OperationalError("the connection is lost")
                return result
            except sqlite3.OperationalError as error:
                code = getattr(error, "sqlite_errorcode", None)
                is_busy = code not in (None, sqlite3.SQLITE_BUSY_SNAPSHOT) and code & 0xFF == sqlite3.SQLITE_BUSY
                if not is_busy or time.monotonic() >= deadline:
                    raise
            time.sleep(0.05)


class Site:
    """Two stations and their database."""

    def __init__(self, seed: int, parent: Path) -> None:
        self.scheduler = Scheduler(seed, MODULES, max_steps=1_000_000)
        self.random: Random = self.scheduler.random
        self.folder = parent / str(seed)
        self.stations = [self.folder / name for name in ("one", "two")]
        for station in self.stations:
            station.mkdir(parents=True)
        shutil.copy(parent / DATABASE, self.folder)
        self.url = f"sqlite:///{self.folder / DATABASE}"
        self.fails = self.random.random() < 0.5
        self.damages = self.random.random() < 0.3
        self.written: dict[str, str] = {}  #: Verdict of each run that has ended.
        self.copied: dict[str, str] = {}

    def connect(self, path: str, timeout: float = 5.0, **options: Any) -> sqlite3.Connection:
        """Connect to a file of SQLite; connections to the database may be lost later."""
        connection = CONNECT(path, timeout=0.0, factory=Connection, **options)
        connection.patience = timeout
        if Scheduler.current() and self.fails and Path(path).name == DATABASE and self.random.random() < 0.5:
            connection.life, connection.executes_last = self.random.randrange(1, 60), self.random.random() < 0.5
        return connection

    def work(self, station: Path) -> None:
        """Write results of a station, override some, and copy some logs, as runs, engineers and the archiver do."""
        for number in range(RUNS):
            name = f"{station.name}{number}"
            self.write(station, name, number)
            self.pause()
            if self.random.random() < 0.3:
                self.write(station, name, number, override=OVERRIDE)
            if self.random.random() < 0.3:
                self.copied[name] = f"s3://logs/{name}.h5"
                Outbox(station).add_copy(ArchivedLog(name, self.copied[name], "1" * 64, 17))

    def write(self, station: Path, name: str, number: int, **more: Any) -> None:
        """Write a result, whose file has a virtual time."""
        log = {"file": f"{name}.h5", "sha256": "0" * 64}
        path = write_result(station, f".{name}", number, SERIAL, log=log, outcome="failed", **more)
        moment = int(1e9 * time.monotonic())
        os.utime(path, ns=(moment, moment))
        path.replace(station / f"{name}.json")
        self.written[name] = "released" if more else "failed"

    def exchange(self, station: Path) -> None:
        """Exchange the runs of a station, as the process of a window or a run does until its owner ends."""
        end = time.monotonic() + self.random.choice((0.0, 5.0, 20.0))

        def wait(pause: float) -> bool:
            time.sleep(pause)
            return time.monotonic() >= end

        process.watch(station, self.url, station.name, wait)

    def read(self, station: Path) -> None:
        """Read History, as a window does: after an update it contains every run that ended before."""
        opened = History(station)
        for _ in range(4):
            before = {name for name in self.written if name.startswith(station.name)}
            opened.refresh()
            found = {record.log.stem for record in opened.runs(RunFilter()) if not record.origin}
            assert before <= found, (before, found)
            assert opened.attempts(SERIAL) >= len(before)
            self.pause()

    def damage(self) -> None:
        """Damage the index of a station."""
        self.pause()
        (self.random.choice(self.stations) / FILE).write_bytes(b"damaged" * 2000)

    def pause(self) -> None:
        """Pause for a moment or for longer than an exchange waits."""
        time.sleep(self.random.choice((0.0, 0.01, 1.0, 10.0)))

    def start(self) -> list[Thread]:
        """Start the processes of both stations, of which one may be killed."""
        actions: list[tuple[Callable[..., None], tuple[Path, ...]]] = []
        for station in self.stations:
            actions += [(self.work, (station,)), (self.exchange, (station,)), (self.read, (station,))]
            if self.random.random() < 0.5:
                actions.append((self.exchange, (station,)))
        if self.damages:
            actions.append((self.damage, ()))
        threads: list[Any] = [threading.Thread(target=target, args=args) for target, args in actions]
        for thread in threads:
            thread.start()
        exchanging = [thread for thread, (target, _) in zip(threads, actions, strict=True) if target == self.exchange]
        if self.random.random() < 0.5:
            self.random.choice(exchanging).task.life = self.random.randrange(1, 2000)
        return threads

    def finish(self) -> None:
        """Exchange what is left without faults, and check that every station and the database have every run once."""
        self.fails = False
        for station in (*self.stations, *self.stations):
            made = Exchange(station, self.url, station.name)
            exchange_once(made, station)
            made.close()
        stored: list[Any] = []
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(exchange, "_store", lambda *arguments: stored.append(arguments))
            for station in self.stations:
                made = Exchange(station, self.url, station.name)
                exchange_once(made, station)
                made.close()
        assert stored == [], "nothing is sent twice"


def exchange_runs(seed: int, parent: Path) -> None:
    """Let two stations work and exchange, and check what the database and both indexes contain at the end."""
    site = Site(seed, parent)

    def main() -> None:
        for thread in site.start():
            thread.join()
        site.finish()

    with pytest.MonkeyPatch.context() as patch:
        for name in ("index", "_history"):  # Python 3.11 computes them in one process under one lock of all instances
            patch.setattr(vars(Outbox)[name], "lock", nullcontext(), raising=False)
        patch.setattr(sqlite3.dbapi2, "connect", site.connect)
        patch.setattr(time, "thread_time", lambda: 0.0)
        patch.setattr(os, "fsync", lambda handle: None)
        patch.setattr(stated, "is_release_recorded", lambda result: True)
        patch.setattr(exchange, "_PAGE_SIZE", site.random.choice((2, 500)))
        patch.setattr(outbox, "_MAX_MESSAGES", site.random.choice((1, 50)))
        patch.setattr(process, "_SLICE_S", site.random.choice((0.0, 3.0)))
        site.scheduler.run(main)
    names = sorted(f"{station.name}{number}" for station in site.stations for number in range(RUNS))
    expected = [(name, name[:-1], site.written[name]) for name in names]
    for station in site.stations:
        assert [row[:3] for row in in_index(station)] == expected, station.name
        assert read_state(station).pending == 0
        assert read_state(station).error is None
    engine = create_engine(site.url)
    with engine.connect() as connection:
        rows = connection.execute(select(runs).order_by(runs.c.name)).all()
        last = connection.execute(select(revisions.c.last)).scalar_one()
        copies = {row.name: row.url for row in connection.execute(select(log_copies))}
    engine.dispose()
    assert [row.name for row in rows] == names
    assert len({row.revision for row in rows}) == len(rows)
    assert max(row.revision for row in rows) <= last
    assert copies == site.copied
    assert {row.name: row.log for row in rows if row.name in copies} == copies
    shutil.rmtree(site.folder)


@pytest.fixture
def site_folder(tmp_path: Path) -> Path:
    """A folder with a new database."""
    connect(f"sqlite:///{tmp_path / DATABASE}").dispose()
    return tmp_path


@pytest.mark.long
@with_seeds(3)
def test_every_run_reaches_the_database_and_all_stations_once(seeds: range, site_folder: Path) -> None:
    run_seeds(seeds, lambda seed: exchange_runs(seed, site_folder))


#: Faults in the exchange, each of which some seed finds.
PLANTED: dict[str, tuple[object, str, Callable[..., Any]]] = {
    "a folder is named twice": (outbox, "locked", lambda path, timeout: nullcontext()),
    "a lost confirmation is not noticed": (Exchange, "_synchronise", lambda self, engine: None),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", PLANTED)
def test_seeds_find_a_fault_of_the_exchange(name: str, site_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(*PLANTED[name])
    assert failing_seed(range(60), lambda seed: exchange_runs(seed, site_folder)) is not None
