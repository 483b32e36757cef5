"""Control charts of the table geometry, and their demonstration on the bench."""

import json
from collections.abc import Mapping
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from synthetic import golden
from synthetic.golden import detection, false_alarms, golden_run
from synthetic.production_lock import lock_demo

from calstation.cli.app import run_app
from calstation.config import load_product, load_station, site_folder
from calstation.estimation.positions import TABLE_QUANTITIES
from calstation.messages import event_text, render
from calstation.physics import FloatArray
from calstation.quality import BASELINE, WEIGHT, WIDTH, TableChart, alarms, ewma_chart, table_charts
from calstation.records import RunFilter
from calstation.sequencer import Message
from tests.results.test_history import refreshed, write
from tests.site_folder import BENCH, STATION, SiteFolder


def test_chart_restarts_after_each_alarm() -> None:
    values = np.concatenate([np.zeros(5), np.full(40, 3.0)])
    found = alarms(values, 0.0, 1.0)
    assert found[0] == ewma_chart(values, 0.0, 1.0, weight=WEIGHT, width=WIDTH).signals[0]
    again = ewma_chart(values[found[0] + 1 :], 0.0, 1.0, weight=WEIGHT, width=WIDTH).signals[0]
    assert found[1] == found[0] + 1 + again
    assert alarms(np.zeros(50), 0.0, 1.0) == ()


def test_resampled_alarm_rates_agree_with_simulated_charts() -> None:
    """Vectorised resampling and the chart of a station give the same average run length."""
    random = np.random.default_rng(5)
    rates = false_alarms(random.standard_normal((20_000, 3)), 600, 1)
    count = 0
    for _ in range(300):
        baseline, series = random.standard_normal((BASELINE, 3)), random.standard_normal((600, 3))
        center, sigma = baseline.mean(axis=0), baseline.std(axis=0, ddof=1)
        count += sum(len(alarms(series[:, i], center[i], sigma[i])) for i in range(3))
    assert rates["run_length"] == pytest.approx(600 * 300 / count, rel=0.3)


@pytest.mark.long
def test_axis_shift_on_the_bench_changes_only_its_quantity() -> None:
    """The shifts are 30 standard deviations of a run; equal run numbers have equal noise."""
    for i, name in enumerate(TABLE_QUANTITIES):
        shift = [0.0, 0.0, 0.0]
        shift[i] = 3e-3
        moved = golden_run(1, 2, (shift[0], shift[1], shift[2])).table - golden_run(1, 2).table
        assert moved == pytest.approx(shift, abs=1e-4), name


@pytest.mark.long
def test_charts_have_the_documented_alarm_probabilities() -> None:
    """Normal values with `BASELINE` baseline runs; documented in docs/how-to/check-standards.md."""
    values = np.random.default_rng(11).standard_normal((20_000, 3))
    rates = false_alarms(values, 5 * 370, 3)
    assert rates["run_length"] == pytest.approx(2450, rel=0.25)
    assert rates["few_alarms"] == pytest.approx(0.966, abs=0.02)
    found = detection(values, 50, 1.0, 2)
    alone = detection(values, 10, np.array([1.0, 2.0, 3.0]), 2)["alarmed_in_time"]
    for name in TABLE_QUANTITIES:
        assert found["alarmed_in_time"][name] == pytest.approx(0.953, abs=0.02)
        assert found["median_runs"][name] == pytest.approx(18.0, abs=1.0)
    assert [*alone.values()] == pytest.approx([0.17, 0.93, 1.0], abs=0.04)


def charts(site: SiteFolder, **instrument: object) -> Mapping[str, TableChart]:
    instruments = [{"name": "rate table", "kind": "table", **instrument}]
    site.station.write_text(tomli_w.dumps({**STATION, "bench": BENCH, "instruments": instruments}), encoding="utf-8")
    (_, station), (_, product) = load_station(site.station), load_product(site.product)
    return table_charts(station, refreshed(site.folder).columns(RunFilter(product=product.name)))


def store(site: SiteFolder, first: int, values: FloatArray, folder: Path | None = None) -> None:
    """Store runs one day apart from the first day of the year."""
    for k, value in enumerate(values.tolist(), first):
        started = (datetime(2026, 1, 1, 12, tzinfo=UTC) + timedelta(days=k)).isoformat()
        table = {"orthogonality": {"value": value, "sigma": 1e-5}}
        own = {"station": "test bench", "product": "short", "started_utc": started, "table": table}
        write(folder or site.folder, f"run{k}", "SN-000042", "passed", 1, **own)


def test_baseline_is_fixed_and_not_tested(site_folder: SiteFolder) -> None:
    random = np.random.default_rng(3)
    first, later = 1e-4 * random.standard_normal(BASELINE), 1e-4 * (1.5 + random.standard_normal(40))
    assert charts(site_folder) == {}
    store(site_folder, 0, np.append(first[:-1], 9e-4))
    chart = charts(site_folder)["orthogonality"]
    assert (chart.baseline, chart.alarms) == (BASELINE, ())
    (site_folder.folder / f"run{BASELINE - 1}.json").unlink()
    charts(site_folder)  # forgets the run, which would otherwise count as edited
    store(site_folder, BASELINE - 1, np.append(first[-1], later))
    chart = charts(site_folder)["orthogonality"]
    assert (chart.center, chart.sigma) == (first.mean(), first.std(ddof=1))
    assert BASELINE < chart.alarms[0] < BASELINE + 30
    ewma = chart.ewma
    assert chart.alarms == tuple(BASELINE + k for k in ewma.signals)
    after = int(ewma.signals[0]) + 1  # the drawn average begins again after an alarm, as the evaluation does
    step = chart.values[BASELINE + after] - chart.center
    assert ewma.average[after] == pytest.approx(chart.center + WEIGHT * step)


def test_baseline_restarts_after_a_calibration_of_the_table(
    site_folder: SiteFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    values = 1e-4 * np.random.default_rng(4).standard_normal(BASELINE + 20)
    store(site_folder, 0, values)
    day = date(2026, 1, 1) + timedelta(days=BASELINE - 20)
    chart = charts(site_folder, calibrated=day)["orthogonality"]
    assert (len(chart.values), chart.baseline, chart.alarms) == (39, 39, ())
    assert chart.center == values[-39:].mean()
    files = ["--station", str(site_folder.station), "--product", str(site_folder.product)]
    assert run_app(["quality", "standards", *files, "--out", str(site_folder.folder)]) == 0
    assert f"39 of {BASELINE} runs of the baseline, not tested yet" in capsys.readouterr().out


def test_table_alarm_gives_exit_code_1_and_a_remedy(
    site_folder: SiteFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    values = 1e-4 * np.random.default_rng(4).standard_normal(BASELINE + 5)
    store(site_folder, 0, values)
    files = ["--station", str(site_folder.station), "--product", str(site_folder.product)]
    command = ["quality", "standards", *files, "--out", str(site_folder.folder)]
    assert run_app(command) == 0
    assert "Table, angle between the axes" in capsys.readouterr().out
    store(site_folder, len(values), np.full(5, 1e-3))
    assert run_app(command) == 1
    shown = capsys.readouterr().out
    assert "ALARMS" in shown
    assert "Check the axes and the level of the base" in shown
    assert run_app([*command, "--json", "-"]) == 1
    (alarm, *_) = json.loads(capsys.readouterr().out)["table"]["orthogonality"]["alarms"]
    assert alarm["run"] == f"run{len(values)}"


@pytest.mark.long
def test_run_that_causes_a_chart_alarm_reports_it(site_folder: SiteFolder) -> None:
    """The axes of the bench deviate 60″ from a right angle, while the earlier runs measured a right angle."""
    runs = site_folder.folder / "runs"
    runs.mkdir()
    site_folder.write({"stages": ["rate", "six_position"]})
    store(site_folder, 0, 1e-6 * np.random.default_rng(4).standard_normal(BASELINE + 3), runs)
    verdict = site_folder.run()
    (message,) = [event for event in site_folder.events_of(Message) if event.id == "table_moved"]
    assert message.values == {"quantities": ["orthogonality"]}
    assert site_folder.events.index(message) < site_folder.events.index(verdict)
    shown = event_text(message.id, message.values)
    assert (
        "its control chart has an alarm at this run (angle between the axes)" in render(shown.code, shown.values).text
    )


@pytest.mark.exhaustive
def test_demonstration_detects_a_large_shift_without_false_alarms(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(golden, "BASELINE", 30)
    monkeypatch.setattr(golden, "WITHIN", 4)
    monkeypatch.setattr(golden, "_TRIALS", 100)
    counted: list[tuple[int, int]] = []
    found = golden.golden_demo(5, 4.0, 3, "tilt_y", 1, lambda done, count: counted.append((done, count)), workers=1)
    assert counted[-1] == (30 + 5 * 2 + 2 * 4 * 2, 30 + 5 * 2 + 2 * 4 * 2)
    assert found["passed"]
    assert found["within_runs"] == 8
    assert found["alarmed_after_runs"] in (1, 2, 3, 4)
    assert found["axis_error"] == pytest.approx(np.deg2rad(0.1) / np.sqrt(2.0) / found["sigma"]["tilt_y"])
    assert found["axis_alarmed_after_runs"] is not None


@pytest.mark.long
def test_demonstration_locks_and_unlocks_the_station(tmp_path: Path) -> None:
    before = site_folder()
    steps = [*lock_demo(tmp_path, 1)]
    assert [step.code.removeprefix("lock_") for step in steps] == [
        *("first", "agrees", "after", "overdue", "disagrees", "out", "overridden", "corrected", "again")
    ]
    assert all(step.passed for step in steps)
    assert "no run of check standard SN-000001 has passed" in steps[0].values["reason"]
    assert site_folder() == before, "the site's own folder stays as it is"
