"""Killed workers, an interrupted or killed coordinator and a cluster: every log is solved once, bit for bit."""

import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import pytest
from sqlalchemy import create_engine, select

from calstation.database import connect, solutions
from calstation.fleet import FleetRequest, FleetSummary, resolve_fleet, solved_results
from calstation.results import resolve

pytestmark = pytest.mark.long

#: Number of logs; `make exhaustive` solves 300, too, while workers are killed.
LOGS = 30
#: A worker is killed after at least this time, s, and this number of logs, so that a slow computer gets on too.
KILLED_EVERY, KILLED_AFTER = 2.0, 4
#: Longest time for anything, s.
WITHIN = 240.0


def workers_of(process: subprocess.Popen[bytes]) -> list[psutil.Process]:
    """Worker processes of a command."""
    found = []
    with suppress(psutil.NoSuchProcess):
        for child in psutil.Process(process.pid).children():
            with suppress(psutil.NoSuchProcess):
                if "spawn_main" in " ".join(child.cmdline()):
                    found.append(child)
    return found


def stored(url: str) -> list[tuple[str, str]]:
    """Location and outcome of all solutions."""
    engine = create_engine(url)
    with engine.connect() as connection:
        rows = connection.execute(select(solutions.c.location, solutions.c.outcome)).all()
    engine.dispose()
    return [(row.location, row.outcome) for row in rows]


@contextmanager
def killing_workers(process: subprocess.Popen[bytes], url: str, killed: list[int]) -> Iterator[None]:
    """Kill a random worker every few seconds, while logs are solved."""
    stop = threading.Event()

    def kill() -> None:
        done = 0
        while not stop.wait(KILLED_EVERY):
            workers, count = workers_of(process), len(stored(url))
            if workers and count - done >= KILLED_AFTER:
                done = count
                with suppress(psutil.NoSuchProcess):
                    worker = random.choice(workers)
                    worker.kill()
                    killed.append(worker.pid)

    thread = threading.Thread(target=kill, daemon=True)
    thread.start()
    yield
    stop.set()
    thread.join()


@contextmanager
def command(folder: Path, url: str) -> Iterator[subprocess.Popen[bytes]]:
    """`calstation fleet resolve` as a process."""
    arguments = ["fleet", "resolve", str(folder), "--database", url, "--scheduler", "local:2"]
    process = subprocess.Popen(
        [sys.executable, "-m", "calstation", *arguments], stderr=subprocess.PIPE, start_new_session=True
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        assert process.stderr is not None
        process.stderr.close()


def wait_for(url: str, count: int) -> None:
    """Wait until the database has that many solutions."""
    deadline = time.monotonic() + WITHIN
    while len(stored(url)) < count:
        assert time.monotonic() < deadline
        time.sleep(0.2)


@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ("url", "count"),
    [
        pytest.param("postgresql", LOGS, marks=pytest.mark.exhaustive),
        pytest.param("sqlite", 300, marks=pytest.mark.exhaustive),
        pytest.param("postgresql", 300, marks=pytest.mark.exhaustive),
    ],
    indirect=["url"],
)
def test_logs_are_solved_once_each_while_workers_are_killed(
    url: str, count: int, made: Callable[[int], list[Path]]
) -> None:
    logs = made(count)
    connect(url).dispose()
    killed: list[int] = []
    with command(logs[0].parent, url) as process, killing_workers(process, url, killed):
        _, errors = process.communicate()
    assert process.returncode == 0, errors
    assert len(killed) >= min(count // 30, 5)
    assert sorted(stored(url)) == [(str(log), "resolved") for log in sorted(logs)]
    summary = resolve_fleet(FleetRequest((str(logs[0].parent),), url, "local:1"))
    assert (summary.solved_now, summary.already_there, summary.failed) == (0, count, 0)
    found = {result["log"]["file"]: result for result in map(json.loads, solved_results(url, summary))}
    for log in logs[:: 1 if url.startswith("sqlite") else 10]:
        assert found[str(log)] == resolve(log).result.to_json(), log


@pytest.mark.exhaustive
@pytest.mark.timeout(600)
@pytest.mark.parametrize("url", ["sqlite"], indirect=True)
def test_interrupted_job_solves_only_remaining_logs_after_a_restart(
    made: Callable[[int], list[Path]], url: str
) -> None:
    logs = made(LOGS)
    folder = logs[0].parent
    connect(url).dispose()
    with command(folder, url) as process:
        wait_for(url, 5)
        begin = time.monotonic()
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        _, errors = process.communicate(timeout=60.0)
        assert process.returncode == 4
        assert b"Stopped with" in errors
        assert b"Traceback" not in errors
        assert time.monotonic() - begin < 20.0
    interrupted = len(stored(url))
    assert 5 <= interrupted < LOGS
    with command(folder, url) as process:
        wait_for(url, interrupted + 5)
        workers = workers_of(process)
        process.kill()
        process.wait()
    deadline = time.monotonic() + 30.0
    while any(worker.is_running() for worker in workers):
        assert time.monotonic() < deadline  # the workers end with the program
        time.sleep(0.1)
    there = len(stored(url))
    assert interrupted + 5 <= there < LOGS
    summary = resolve_fleet(FleetRequest((str(folder),), url, "local:2"))
    assert (summary.already_there, summary.solved_now, summary.failed) == (there, LOGS - there, 0)
    assert summary.processed == LOGS - there
    assert sorted(stored(url)) == [(str(log), "resolved") for log in sorted(logs)]


@pytest.mark.exhaustive
@pytest.mark.timeout(300)
@pytest.mark.parametrize("url", ["postgresql"], indirect=True)
def test_a_cluster_solves_the_logs(made: Callable[[int], list[Path]], url: str, tmp_path: Path) -> None:
    logs = made(LOGS)[:20]
    file = tmp_path / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    common = ["--scheduler-file", str(file), "--no-dashboard"]
    commands = [
        [*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", *common],
        *2 * [[*dask, "worker", *common, "--nthreads", "1", "--local-directory", str(tmp_path)]],
    ]
    processes = [subprocess.Popen(each, stderr=subprocess.DEVNULL) for each in commands]
    try:
        deadline = time.monotonic() + 60.0
        while not (file.is_file() and file.read_text().endswith("}")):  # written completely
            assert time.monotonic() < deadline
            time.sleep(0.1)
        address = json.loads(file.read_text())["address"]
        request = FleetRequest(tuple(map(str, logs)), url, address)
        summary: FleetSummary = resolve_fleet(request)
        assert (summary.solved_now, summary.failed) == (len(logs), 0)
        assert json.loads(next(solved_results(url, summary)))["outcome"] == "resolved"
        assert resolve_fleet(request).already_there == len(logs)
    finally:
        for process in reversed(processes):
            process.terminate()
        for process in processes:
            process.wait(timeout=60.0)
