"""No run is lost and none arrives twice, regardless of which process, connection or server fails and when.

The soak test is accelerated: in a minute, two stations write about 500 runs, their processes are killed 50 times,
connections are cut 20 times and the server is stopped 15 times, and all pauses are 60 times shorter.
``CALSTATION_SOAK_S=3600`` makes it an hour long, with outages of up to 12 s and pauses that are 10 times shorter.
"""

import hashlib
import json
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import pytest
from sqlalchemy import create_engine, select, text
from sqlalchemy.pool import NullPool
from synthetic.many_logs import record_logs

from calstation.database import Exchange, read_state, solutions, upgrade, watch
from calstation.records import acquire_lock
from calstation.results import resolve
from tests.database.killed import is_killed_at
from tests.database.result_files import in_database, in_index, write_result
from tests.helpers import ignore_progress

#: Duration, s.
SOAK_S = float(os.environ.get("CALSTATION_SOAK_S", "30"))
#: Factor by which intervals between actions and outages are longer than in a short soak test.
PACE = max(1.0, SOAK_S / 600.0)
#: Number of real logs that the stations archive and a fleet job solves; the other runs have none.
LOGS = round(12 * SOAK_S / 60.0 / PACE**0.5)
#: Longest time until everything has arrived and is solved after the last outage, s.
MAX_SYNC_S = 300.0

#: SQL that makes the database record everything that arrives.
ARRIVALS = """
CREATE TABLE arrivals (number bigserial, what text, outbox text, name text, attempt int, outcome text);
CREATE FUNCTION note_run() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN
  INSERT INTO arrivals (what, outbox, name, attempt, outcome)
    VALUES ('run', new.outbox, new.name, (new.content::json ->> 'attempt')::int, new.content::json ->> 'outcome');
  RETURN new;
END $$;
CREATE FUNCTION note_copy() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN
  INSERT INTO arrivals (what, outbox, name) VALUES ('copy', new.outbox, new.name);
  RETURN new;
END $$;
CREATE FUNCTION note_solution() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN
  INSERT INTO arrivals (what, name) VALUES ('solution', new.log_sha256);
  RETURN new;
END $$;
CREATE TRIGGER note AFTER INSERT OR UPDATE OF content ON runs FOR EACH ROW EXECUTE FUNCTION note_run();
CREATE TRIGGER note AFTER INSERT OR UPDATE ON log_copies FOR EACH ROW EXECUTE FUNCTION note_copy();
CREATE TRIGGER note AFTER INSERT OR UPDATE OF result ON solutions FOR EACH ROW EXECUTE FUNCTION note_solution();
"""


def work(folder: Path, url: str, archive: Path, exchanges, claimed, number: int) -> None:
    """Exchange a folder with shorter pauses, like the process of a window, until this process is killed."""

    def wait(seconds: float) -> bool:
        exchanges[number] += 1  # without a lock, which a killed process would not release
        time.sleep(seconds * PACE / 60.0)
        return False

    watch(folder, url, folder.name, wait, lambda: {f"SN-{claimed[number]}": "li"}, str(archive))


class Stations:
    """Two folders of runs with their exchange processes, and their archive."""

    def __init__(self, folder: Path, url: str) -> None:
        self._context = multiprocessing.get_context("forkserver")
        preload = ["calstation.database.exchange", "calstation.database.process", "calstation.database.archiver"]
        self._context.set_forkserver_preload(preload)
        self.url, self.archive = url, folder / "archive"
        self.archive.mkdir()
        self.exchanges, self.claimed = (self._context.RawArray("q", 2) for _ in range(2))
        self.folders = [folder / "one", folder / "two"]
        self.processes: list = [None, None]
        for number, made in enumerate(self.folders):
            made.mkdir()
            self.start(number)

    def start(self, number: int) -> None:
        shared = (self.exchanges, self.claimed, number)
        process = self._context.Process(target=work, args=(self.folders[number], self.url, self.archive, *shared))
        process.start()
        self.processes[number] = process

    def kill(self, number: int) -> None:
        """Kill a process with SIGKILL, like a power failure."""
        self.processes[number].kill()
        self.processes[number].join()


class FleetJob:
    """`calstation fleet resolve` for the logs in the archive, started again whenever it has ended."""

    def __init__(self, url: str, output: Path) -> None:
        arguments = ["fleet", "resolve", "archive", "--database", url, "--scheduler", "local:1"]
        self._command = [sys.executable, "-m", "calstation", *arguments]
        self._output, self._due = output, 0.0
        self._process: subprocess.Popen | None = None
        self.ended: list[int] = []  #: Exit codes.

    def restart_if_ended(self) -> None:
        """Record the end of the job, and start it again after a pause."""
        if self._process is not None and self._process.poll() is not None:
            self.ended.append(self._process.returncode)
            self._process, self._due = None, time.monotonic() + 2.0 * PACE
        if self._process is None and time.monotonic() >= self._due:
            with self._output.open("ab") as output:
                self._process = subprocess.Popen(self._command, stdout=output, stderr=output, start_new_session=True)

    def kill(self) -> None:
        """Kill the job and its worker with SIGKILL."""
        if self._process is not None:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()


@pytest.mark.exhaustive
@pytest.mark.timeout(2 * SOAK_S + 1200)
def test_two_stations_and_a_fleet_job_survive_random_outages(postgres, shared_database: str, tmp_path: Path) -> None:
    database = shared_database.rpartition("/")[2]
    postgres.execute(ARRIVALS, database)
    logs = record_logs(ignore_progress, tmp_path / "logs", LOGS, seed=4)
    draw, stations = random.Random(2), Stations(tmp_path, shared_database)
    job = FleetJob(shared_database, tmp_path / "job")
    written: list[list[tuple[str, int]]] = [[], []]  # name and attempt in the order of the files
    digests: list[dict[str, str]] = [{}, {}]  # digests of the log files by name
    counts = dict.fromkeys(("runs", "logs", "claims", "kills", "job kills", "cuts", "outages"), 0)
    down_until = 0.0
    begin = time.monotonic()
    try:
        while (now := time.monotonic()) < begin + SOAK_S:
            k = draw.randrange(2)
            action = draw.random()
            folder = stations.folders[k]
            if down_until and now >= down_until:
                postgres.start()
                down_until = 0.0
            job.restart_if_ended()
            if counts["logs"] < LOGS * min(1.0, 1.2 * (now - begin) / SOAK_S):
                log = logs[counts["logs"]]
                digests[k][log.stem] = hashlib.sha256(log.read_bytes()).hexdigest()
                with log.open("rb") as running:
                    assert acquire_lock(running.fileno(), 0.0, shared=True)  # as a run does until its result is written
                    log.rename(folder / log.name)
                    write_result(folder, log.stem, counts["runs"], outcome="failed")  # a log without a result
                written[k].append((log.stem, 1))
                counts["logs"] += 1
                counts["runs"] += 1
            elif action < 0.75:
                name = f"{folder.name}{len(written[k]):05d}"
                write_result(folder, name, counts["runs"], f"SN-{counts['runs'] % 20}")
                written[k].append((name, 1))
                counts["runs"] += 1
            elif action < 0.80:
                stations.claimed[k] = draw.randrange(4)
                counts["claims"] += 1
            elif action < 0.88:
                stations.kill(k)
                stations.start(k)
                counts["kills"] += 1
            elif action < 0.89:
                job.kill()
                counts["job kills"] += 1
            elif action < 0.97 and not down_until:
                counts["cuts"] += postgres.cut(database)
            elif not down_until:
                postgres.stop(draw.choice(["immediate", "fast"]))
                down_until = now + PACE * draw.uniform(0.0, 2.0)
                counts["outages"] += 1
            time.sleep(PACE * draw.uniform(0.0, 0.12))
    finally:
        if down_until:
            postgres.start()
    stations.claimed[:] = [77, 77]
    one, two = stations.folders
    deadline = time.monotonic() + MAX_SYNC_S
    while not (is_synchronised(one, two, counts["runs"]) and is_synchronised(two, one, counts["runs"])) or job.ended[
        -1:
    ] != [0]:
        assert time.monotonic() < deadline, [read_state(folder) for folder in stations.folders]
        job.restart_if_ended()
        time.sleep(0.5)
    time.sleep(1.0)  # the last changes are received
    jobs = len(job.ended)
    while len(job.ended) < jobs + 2 or job.ended[-1]:  # a job that begins now
        assert time.monotonic() < deadline
        job.restart_if_ended()
        time.sleep(0.5)
    for number in (0, 1):
        stations.kill(number)
    job.kill()
    print(f"{time.monotonic() - begin:.0f} s:", counts, sum(stations.exchanges), "exchanges; fleet jobs:", job.ended)

    arrived = _rows(postgres, database, "name, attempt, outcome FROM arrivals WHERE what = 'run' ORDER BY number")
    # no run arrives twice; it may arrive as incomplete if its log is found while its result is written
    assert {row: count for row, count in Counter(map(tuple, arrived)).items() if count > 1} == {}
    versions = [(name, int(attempt)) for name, attempt, _ in arrived]
    for number, folder in enumerate(stations.folders):
        last = dict(written[number])
        mine = [version for version in versions if version in set(written[number])]
        assert dict(mine) == last  # no run is lost
        order = {version: place for place, version in enumerate(written[number])}
        assert [order[version] for version in mine] == sorted(order[version] for version in mine)
        assert sorted(name for name, station in in_database(shared_database) if station == folder.name) == sorted(last)
    assert in_index(one) == in_index(two)
    assert [row[0] for row in in_index(one)] == sorted(name for number in (0, 1) for name in dict(written[number]))

    copies = _rows(postgres, database, "name, file_sha256, url FROM log_copies")
    assert {name: digest for name, digest, _ in copies} == {**digests[0], **digests[1]}
    assert all(hashlib.sha256(Path(url).read_bytes()).hexdigest() == digest for _, digest, url in copies)
    assert len(_rows(postgres, database, "name FROM arrivals WHERE what = 'copy'")) == len(copies) == counts["logs"]
    assert len(_rows(postgres, database, "name FROM arrivals WHERE what = 'solution'")) == len(copies)
    engine = create_engine(shared_database)
    with engine.connect() as connection:
        found = {row.location: row.result for row in connection.execute(select(solutions))}
    engine.dispose()
    assert found.keys() == {url for *_, url in copies}
    for location, result in found.items():
        assert json.loads(result) == resolve(Path(location)).result.to_json()


def is_synchronised(folder: Path, other: Path, runs: int) -> bool:
    """Whether a station has all runs, nothing is pending, and the other station's claim has been reported once."""
    state = read_state(folder)
    stations = [claim.station for claim in state.claims if claim.serial == "SN-77"]
    waits = (state.pending, state.logs_pending, state.error, state.archive_error, state.refusal)
    return waits == (0, 0, None, None, None) and stations == [other.name] and len(in_index(folder)) == runs


def _rows(server, database: str, query: str) -> list[list[str]]:
    lines = str(server.execute(f"SELECT {query}", database)).splitlines()
    return [line.split("|") for line in lines]


@pytest.mark.parametrize(
    "stride", [29, pytest.param(7, marks=pytest.mark.long), pytest.param(1, marks=pytest.mark.exhaustive)]
)
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_process_killed_at_any_statement_loses_and_repeats_no_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stride: int
) -> None:
    url = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    upgrade(url)
    monkeypatch.setattr("calstation.database.exchange.connect", create_engine)  # saves the time of the migrations
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
        died = is_killed_at(step, lambda: Exchange(one, url, one.name).exchange())
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
