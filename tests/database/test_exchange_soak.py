"""Nothing is lost and nothing arrives twice, whatever is cut off at whatever moment.

In the soak a minute stands for an hour: the pauses of the exchange are 60 times shorter, and about 500 runs, 50 killed
processes, 20 cut connections and 15 outages of the server fall into it.
"""

import itertools
import multiprocessing
import os
import random
import time
from pathlib import Path

import pytest
from sqlalchemy import Engine, create_engine, event, text
from sqlalchemy.pool import NullPool

from calstation.database import Exchange, read_state, upgrade, watch
from tests.database.result_files import in_database, in_index, write_result

ACCELERATION = 60.0

#: A record of every run that arrives, kept by the database itself.
ARRIVALS = """
CREATE TABLE arrivals (number bigserial, outbox text, name text, revision bigint, attempt int);
CREATE FUNCTION note_arrival() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN
  INSERT INTO arrivals (outbox, name, revision, attempt)
    VALUES (new.outbox, new.name, new.revision, (new.content::json ->> 'attempt')::int);
  RETURN new;
END $$;
CREATE TRIGGER note_arrival AFTER INSERT OR UPDATE ON runs FOR EACH ROW EXECUTE FUNCTION note_arrival();
"""


def work(folder: Path, url: str, exchanges, number: int) -> None:
    """Exchange a folder with shorter pauses, as the process beside a window does, until it is killed."""

    def wait(seconds: float) -> bool:
        exchanges[number] += 1  # without a lock, which a killed process would keep
        time.sleep(seconds / ACCELERATION)
        return False

    watch(folder, url, folder.name, wait)


class Stations:
    """Two folders of runs with their exchange processes."""

    def __init__(self, folder: Path, url: str) -> None:
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(["calstation.database.exchange", "calstation.database.process"])
        self.url = url
        self.exchanges = self._context.RawArray("q", 2)
        self.folders = [folder / "one", folder / "two"]
        self.processes: list = [None, None]
        for number, made in enumerate(self.folders):
            made.mkdir()
            self.start(number)

    def start(self, number: int) -> None:
        process = self._context.Process(target=work, args=(self.folders[number], self.url, self.exchanges, number))
        process.start()
        self.processes[number] = process

    def kill(self, number: int) -> None:
        """Kill a process with SIGKILL, as a power cut does."""
        self.processes[number].kill()
        self.processes[number].join()


@pytest.mark.parametrize(
    ("seconds", "seed"), [(5.0, 1), pytest.param(60.0, 2, marks=[pytest.mark.long, pytest.mark.timeout(600)])]
)
def test_two_stations_through_random_outages(
    postgres, shared_database: str, tmp_path: Path, seconds: float, seed: int
) -> None:
    database = shared_database.rpartition("/")[2]
    postgres.execute(ARRIVALS, database)
    draw, stations = random.Random(seed), Stations(tmp_path, shared_database)
    written: list[list[tuple[str, int]]] = [[], []]  # name and attempt in the order of the files
    counts = {"runs": 0, "changes": 0, "kills": 0, "cuts": 0, "outages": 0}
    down_until = 0.0
    end = time.monotonic() + seconds
    try:
        while (now := time.monotonic()) < end:
            k = draw.randrange(2)
            action = draw.random()
            if down_until and now >= down_until:
                postgres.start()
                down_until = 0.0
            if action < 0.75:
                name = f"{stations.folders[k].name}{len(written[k]):05d}"
                write_result(stations.folders[k], name, counts["runs"], f"SN-{counts['runs'] % 20}")
                written[k].append((name, 1))
                counts["runs"] += 1
            elif action < 0.80 and written[k]:
                name = draw.choice(written[k])[0]
                attempt = sum(each == name for each, _ in written[k]) + 1
                write_result(stations.folders[k], name, counts["runs"], attempt=attempt, outcome="failed")
                written[k].append((name, attempt))
                counts["changes"] += 1
            elif action < 0.88:
                stations.kill(k)
                stations.start(k)
                counts["kills"] += 1
            elif action < 0.97 and not down_until:
                counts["cuts"] += postgres.cut(database) > 0
            elif not down_until:
                postgres.stop(draw.choice(["immediate", "fast"]))
                down_until = now + draw.uniform(0.0, 2.0)
                counts["outages"] += 1
            time.sleep(draw.uniform(0.0, 0.12))
    finally:
        if down_until:
            postgres.start()
    total = counts["runs"]
    deadline = time.monotonic() + 60.0
    while min(len(in_index(folder)) for folder in stations.folders) < total or any(
        read_state(folder).pending or read_state(folder).error for folder in stations.folders
    ):
        assert time.monotonic() < deadline, [read_state(folder) for folder in stations.folders]
        time.sleep(0.2)
    time.sleep(1.0)  # the last changes are received
    for number in (0, 1):
        stations.kill(number)
    print(
        f"{seconds:g} s stand for {seconds * ACCELERATION / 3600:.2f} h:", counts, sum(stations.exchanges), "exchanges"
    )

    arrived = [line.split("|") for line in _lines(postgres, "SELECT outbox, name, attempt, revision", database)]
    versions = [(name, int(attempt)) for _, name, attempt, _ in arrived]
    assert len(set(versions)) == len(versions)  # nothing twice
    assert len({revision for *_, revision in arrived}) == len(arrived)
    for number, folder in enumerate(stations.folders):
        last = dict(written[number])
        mine = [version for version in versions if version in set(written[number])]
        assert dict(mine) == last  # nothing lost
        order = {version: place for place, version in enumerate(written[number])}
        assert [order[version] for version in mine] == sorted(order[version] for version in mine)
        assert sorted(name for name, station in in_database(shared_database) if station == folder.name) == sorted(last)
    one, two = map(in_index, stations.folders)
    assert one == two
    assert [row[0] for row in one] == sorted(name for number in (0, 1) for name in dict(written[number]))


def _lines(server, query: str, database: str) -> list[str]:
    return str(server.execute(f"{query} FROM arrivals ORDER BY number", database)).splitlines()


def dies_at(number: int, folder: Path, url: str) -> bool:
    """Exchange a folder in a process that dies at the statement or commit with a number, before or after it.

    Returns False if there are fewer.
    """
    pid = os.fork()
    if pid == 0:
        count = itertools.count(1)

        def step(*_: object) -> None:
            if next(count) == number:
                os._exit(9)

        for name in ("before_cursor_execute", "after_cursor_execute", "commit"):
            event.listen(Engine, name, step)
        Exchange(folder, url, folder.name).exchange()
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 9


@pytest.mark.parametrize("stride", [29, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_process_that_dies_at_any_statement_loses_and_repeats_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stride: int
) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    upgrade(url)
    monkeypatch.setattr("calstation.database.exchange.connect", create_engine)  # migrations take a third of a second
    engine = create_engine(url, poolclass=NullPool)
    with engine.begin() as connection:
        connection.execute(text("CREATE TABLE arrivals (number INTEGER PRIMARY KEY, name TEXT)"))
        for kind in ("INSERT", "UPDATE"):
            note = f"AFTER {kind} ON runs BEGIN INSERT INTO arrivals (name) VALUES (new.name); END"
            connection.execute(text(f"CREATE TRIGGER note_{kind} {note}"))
    folders = one, two = tmp_path / "one", tmp_path / "two"
    for folder in folders:
        folder.mkdir()
    step, died = 0, True
    while died:
        step += stride
        for folder in folders:
            write_result(folder, f"{folder.name}{step:04d}", step)
        died = dies_at(step, one, url)
        for folder in (one, two, one):
            exchange = Exchange(folder, url, folder.name)
            exchange.exchange()
            exchange.close()
        assert in_index(one) == in_index(two)
    assert step > 60
    with engine.connect() as connection:
        names = connection.execute(text("SELECT name FROM arrivals ORDER BY number")).scalars().all()
    for station in ("one", "two"):
        assert [name for name in names if name.startswith(station)] == [
            f"{station}{k:04d}" for k in range(stride, step + 1, stride)
        ]
