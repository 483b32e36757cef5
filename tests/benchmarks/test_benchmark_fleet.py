"""Time to compare two versions of a million solutions, and to solve logs with two workers instead of one."""

from pathlib import Path
from time import perf_counter

import pyarrow.parquet as pq
import pytest
from synthetic.many_logs import record_logs

from calstation.fleet import FleetRequest, compare, export_version, resolve_fleet
from tests.fleet.stored_solutions import add_solutions
from tests.helpers import ignore_progress
from tests.postgres import postgres as postgres
from tests.postgres import shared_database as shared_database
from tests.postgres import url as url

COUNT = 1_000_000
LOGS = 60
#: Size of a result that PostgreSQL keeps outside the row, as those of 75 kB of real logs.
OUTSIDE = 2_600


@pytest.mark.timeout(3600)
def test_two_versions_of_a_million_logs_are_compared_in_seconds(url, tmp_path, monkeypatch, benchmark, figures):
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    size = 2 if url.startswith("sqlite") else OUTSIDE
    for version, moved in (("1", 0.0), ("2", 0.5)):
        add_solutions(url, version, COUNT, moved, 50 if version == "1" else 49, size)
    begin = perf_counter()
    compare(ignore_progress, url, "1", "2")
    filled = perf_counter() - begin
    found = benchmark.pedantic(lambda: compare(ignore_progress, url, "1", "2"), rounds=3)
    took = benchmark.stats["min"]
    begin = perf_counter()
    for path in (tmp_path / "home").rglob("*.parquet"):
        pq.read_table(path)
    read = perf_counter() - begin
    begin = perf_counter()
    exported = export_version(ignore_progress, url, "2", tmp_path / "solutions.parquet")
    export = perf_counter() - begin
    figures(
        first_s=round(filled, 1),
        compared_s=round(took, 2),
        reading_ratio=round(took / read, 2),
        exported_s=round(export, 1),
    )
    assert found.logs == exported == COUNT
    assert took < 2.0


@pytest.mark.timeout(900)
def test_two_workers_solve_logs_almost_twice_as_fast_as_one(tmp_path, benchmark, figures):
    record_logs(ignore_progress, tmp_path / "logs", LOGS, "nav", seed=2)

    def rate(workers: int) -> float:
        """Return logs per second between the first and the last result, without worker startup."""
        times: list[float] = []
        url = f"sqlite:///{tmp_path / f'{workers}.sqlite'}"
        request = FleetRequest((str(tmp_path / "logs"),), url, f"local:{workers}")
        summary = resolve_fleet(request, lambda summary: times.append(perf_counter()))
        assert summary.solved_now == LOGS
        return (LOGS - workers) / (times[-1] - times[workers])

    one = rate(1)
    two = benchmark.pedantic(lambda: rate(2), rounds=1)
    figures(speed_up=round(two / one, 2), logs_per_s=round(two, 2))
    assert Path(tmp_path / "2.sqlite").exists()
    assert two / one > 1.8
