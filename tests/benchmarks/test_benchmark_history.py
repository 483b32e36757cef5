"""Time to filter, chart and count a history of 100,000 runs, relative to reading one page of it."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest

from calstation.config import library, load_product
from calstation.physics import NAMES
from calstation.quality import cusum_chart, ewma_chart, individuals_chart, summarise_quality
from calstation.records import IndexedRun, RunFilter, RunIndex, RunRecord, Verdict

COUNT, LISTED = 100_000, 300
BEGIN = datetime(2020, 1, 1, tzinfo=UTC)


def run(k: int) -> IndexedRun:
    """Return run number k, which starts 20 minutes after the previous run."""
    serial = f"SN-{k % 5000:06d}"
    name = f"{serial}_{k}"
    record = RunRecord(
        serial=serial,
        started_utc=(BEGIN + timedelta(minutes=20 * k)).isoformat(),
        verdict=(Verdict.PASSED, Verdict.FAILED, Verdict.STOPPED, Verdict.FAULT)[k % 4],
        attempt=1,
        product=f"product {k % 7}",
        station=f"station {k % 12}",
        operator=f"operator {k % 30}",
        stages=("rate", "six_position"),
        log=Path(f"{name}.h5"),
        result=Path(f"{name}.json"),
        duration=750.0,
    )
    return IndexedRun(name, "stamp", record, *2 * [dict.fromkeys(NAMES, 1.2345678901e-6)])


@pytest.fixture(scope="module")
def indexes(tmp_path_factory):
    """Create an index of one page of runs, and one of 100,000 runs."""
    made = []
    for count in (LISTED, COUNT):
        index = RunIndex(tmp_path_factory.mktemp("runs"))
        for start in range(0, count, 5000):
            index.update([run(k) for k in range(start, min(start + 5000, count))])
        made.append(index)
    return made


def shortest(action) -> float:
    """Return the shortest of several durations, s."""
    durations = []
    for _ in range(5):
        begin = perf_counter()
        action()
        durations.append(perf_counter() - begin)
    return min(durations)


def test_filtering_100000_runs_takes_little_longer_than_listing_one_page(indexes, benchmark, figures):
    few, many = indexes
    listed = shortest(lambda: few.find(RunFilter(), LISTED))
    filters = {
        "none": RunFilter(),
        "text": RunFilter(search="000123"),
        "nothing_found": RunFilter(search="zzz"),
        "values": RunFilter(verdict="failed", product="product 3", station="station 5"),
        "dates": RunFilter(since="2021-01-01T00:00:00", before="2021-02-01T00:00:00"),
    }
    ratios = {}
    for name, wanted in filters.items():
        both = shortest(lambda wanted=wanted: (many.find(wanted, LISTED), many.count(wanted)))
        ratios[f"{name}_ratio"] = round(both / listed, 2)
    benchmark.pedantic(lambda: many.find(filters["values"], LISTED), rounds=3)
    figures(**ratios)
    assert max(ratios.values()) < 15.0


def test_reading_columns_of_100000_runs_is_much_faster_than_reading_each_run(indexes, benchmark, figures):
    few, many = indexes
    each = shortest(lambda: few.find(RunFilter(), LISTED)) / LISTED
    columns = shortest(lambda: many.columns(RunFilter())) / COUNT
    benchmark.pedantic(lambda: many.columns(RunFilter()), rounds=3)
    figures(columns_ratio=round(columns / each, 3))
    assert columns < 0.4 * each


def test_charts_of_100000_runs_take_less_time_than_reading_their_columns(indexes, benchmark, figures):
    _, many = indexes
    found = many.columns(RunFilter())
    values = np.random.default_rng(1).normal(found.values["gyro_bias_x"], 1e-7)
    center, sigma = float(values.mean()), float(values.std())

    def charts():
        chart = values, center, sigma
        return individuals_chart(*chart), ewma_chart(*chart), cusum_chart(*chart)

    ratio = shortest(charts) / shortest(lambda: many.columns(RunFilter()))
    benchmark.pedantic(charts, rounds=3)
    figures(charts_ratio=round(ratio, 3))
    assert ratio < 1.0


def test_charts_and_yields_of_50000_runs_take_little_longer_than_their_columns(
    indexes, benchmark, figures, tmp_path, monkeypatch
):
    """The Quality page needs this after each selection; about 1 s on one core."""
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    product, random = library.find("products", "nav_a"), np.random.default_rng(1)
    index, name = RunIndex(tmp_path), load_product(product)[1].name
    for start in range(0, COUNT // 2, 5000):
        runs = [run(k) for k in range(start, start + 5000)]
        records = [replace(each.record, serial=each.name, product=name) for each in runs]
        values = [dict(zip(NAMES, row, strict=True)) for row in random.normal(0.0, 1e-6, (5000, len(NAMES))).tolist()]
        index.update(
            replace(each, record=record, values=found)
            for each, record, found in zip(runs, records, values, strict=True)
        )

    def summary():
        return summarise_quality(lambda *_: None, tmp_path, product)

    assert len(summary().parameters) == len(NAMES)
    columns = shortest(lambda: index.columns(RunFilter(product=name)))
    ratio = shortest(summary) / columns
    benchmark.pedantic(summary, rounds=3)
    figures(summary_ratio=round(ratio, 2), columns_s=round(columns, 2))
    assert ratio < 4.0
