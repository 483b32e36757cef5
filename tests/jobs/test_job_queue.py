"""Background jobs: progress, results, errors, cancellation, a killed worker, closing."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from calstation.jobs import Job, JobQueue
from tests.jobs import job_functions as works

TIMEOUT = 120.0


@pytest.fixture
def job_queue() -> Iterator[JobQueue]:
    shop = JobQueue()
    yield shop
    shop.close()


def until(condition: Callable[[], bool]) -> None:
    """Poll like the timer of a window."""
    deadline = time.monotonic() + TIMEOUT
    while not condition():
        assert time.monotonic() < deadline, "nothing came"
        threading.Event().wait(0.01)


def ended(job: Job) -> Job:
    until(lambda: job.poll() not in ("waiting", "running"))
    return job


def test_jobs_run_in_order_with_progress_and_result(job_queue: JobQueue) -> None:
    first, second = job_queue.submit(works.add, 1, b=2), job_queue.submit(works.add, 3)
    assert ended(second).result == 3
    assert (first.state, first.result, first.fraction, first.note) == ("done", 3, 1.0, "adding")
    assert not job_queue.busy


def test_errors_of_jobs_are_reported(job_queue: JobQueue) -> None:
    jobs = [
        job_queue.submit(work) for work in (works.raise_known_error, works.raise_unexpected_error, works.unpicklable)
    ]
    clear, mistake, lost = (ended(job) for job in jobs)
    assert [job.state for job in jobs] == ["failed"] * 3
    assert str(clear.error) == "log.h5: No such file. Give the path of an existing TOML file."
    for job in (mistake, lost):
        assert job.error is not None
        assert job.error.code == "program.internal"
    assert mistake.error is not None
    assert mistake.error.values == {"detail": "ZeroDivisionError: division by zero"}
    assert ended(job_queue.submit(works.add, 1)).result == 1


def test_cancelled_job_is_killed_and_the_next_job_runs(job_queue: JobQueue, tmp_path: Path) -> None:
    started, go = tmp_path / "started", tmp_path / "go"
    long, waiting = job_queue.submit(works.wait, started, go), job_queue.submit(works.add, 1)
    following = job_queue.submit(works.wait, tmp_path / "again", go)
    until(lambda: long.poll() == "running" and started.exists() and bool(started.read_text("utf-8")))
    assert waiting.cancel()
    assert long.cancel()
    assert (long.state, waiting.state) == ("cancelled", "cancelled")
    assert not long.cancel()
    go.touch()
    assert ended(following).state == "done"
    assert following.result != int(started.read_text("utf-8"))


def test_device_job_is_not_cancelled(job_queue: JobQueue, tmp_path: Path) -> None:
    started, go = tmp_path / "started", tmp_path / "go"
    job = job_queue.submit(works.wait, started, go, cancellable=False)
    until(lambda: job.poll() == "running" and started.exists())
    assert not job.cancel()
    assert job.state == "running"
    go.touch()
    assert ended(job).state == "done"


def test_closing_waits_for_a_device_job(tmp_path: Path) -> None:
    job_queue = JobQueue()
    started, go = tmp_path / "started", tmp_path / "go"
    job = job_queue.submit(works.wait, started, go, cancellable=False)
    waiting = job_queue.submit(works.add, 1)
    until(lambda: job.poll() == "running" and started.exists())
    go.touch()
    job_queue.close()
    assert (job.state, waiting.state) == ("done", "cancelled")


def test_progress_gives_the_remaining_time(job_queue: JobQueue, tmp_path: Path) -> None:
    go = tmp_path / "go"
    job = job_queue.submit(works.wait, tmp_path / "started", go)
    assert job.remaining is None
    until(lambda: job.poll() == "running" and job.remaining is not None)
    assert job.fraction == 0.25
    until(lambda: job.remaining is None)  # the job takes longer than estimated at its last report
    go.touch()
    assert ended(job).remaining is None


def test_killed_worker_fails_only_its_job(job_queue: JobQueue) -> None:
    dead, alive = job_queue.submit(works.die), job_queue.submit(works.add, 2)
    assert ended(alive).result == 2
    assert dead.state == "failed"
    assert dead.error is not None
    assert dead.error.code == "program.worker_ended"


def test_idle_worker_that_is_killed_is_replaced(job_queue: JobQueue) -> None:
    ended(job_queue.submit(works.add, 1))
    process = job_queue._worker.process
    assert process is not None
    process.kill()
    process.join(TIMEOUT)
    assert ended(job_queue.submit(works.add, 2)).result == 2


def test_closing_ends_all_jobs_and_the_worker(tmp_path: Path) -> None:
    job_queue = JobQueue()
    running = job_queue.submit(works.wait, tmp_path / "started", tmp_path / "go")
    waiting = job_queue.submit(works.add, 1)
    until(lambda: running.poll() == "running")
    process = job_queue._worker.process
    assert process is not None
    job_queue.close()
    job_queue.close()
    process.join(TIMEOUT)
    assert not process.is_alive()
    assert (running.state, waiting.state) == ("cancelled", "cancelled")
    assert job_queue.submit(works.add, 1).state == "cancelled", "a window that is closing may still ask"


@pytest.mark.parametrize("state", ["idle", "working"])
def test_worker_ends_when_its_window_is_killed(tmp_path: Path, state: str) -> None:
    """A killed window leaves no process, whether busy or idle."""
    started = tmp_path / "started"
    script = tmp_path / "window.py"
    script.write_text(
        "import sys, time\nfrom pathlib import Path\n"
        "from calstation.jobs.queue import JobQueue\nfrom tests.jobs import job_functions as works\n"
        "if __name__ == '__main__':\n"
        "    shop = JobQueue()\n"
        f"    job = shop.submit(works.wait, Path({str(started)!r}), Path({str(tmp_path / 'go')!r}))\n"
        "    while not Path(sys.argv[1]).exists():\n"
        "        job.poll(); time.sleep(0.01)\n"
        f"    if {state!r} == 'idle':\n"
        f"        Path({str(tmp_path / 'go')!r}).touch()\n"
        "        while job.poll() != 'done':\n            time.sleep(0.01)\n"
        "    print('here', shop._worker.process.pid, flush=True)\n"
        "    time.sleep(1000)\n",
        encoding="utf-8",
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[2])}
    window = subprocess.Popen(
        [sys.executable, str(script), str(started)], stdout=subprocess.PIPE, text=True, env=environment
    )
    assert window.stdout is not None
    worker = int(window.stdout.readline().split()[1])
    window.kill()
    window.wait()
    window.stdout.close()
    until(lambda: not _exists(worker))


def _exists(pid: int) -> bool:
    if sys.platform != "linux":
        pytest.skip("looks into /proc")
    try:
        return Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False
