"""A synthetic history consists of result files, and its index is rebuilt from them."""

from pathlib import Path

import pytest

from calstation.physics import NAMES
from calstation.quality import COMMON_SCALE, GaugePlan, summarise_quality
from calstation.records import RunFilter
from calstation.records.run_index import FILE
from calstation.results import History, load_result
from synthetic.run_history import synthesise_runs

RUNS = 2000


def ignore(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
    assert 0.0 <= fraction <= 1.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A history of 2000 runs."""
    folder = tmp_path_factory.mktemp("history")
    synthesise_runs(ignore, folder, RUNS, 3)
    return folder


@pytest.mark.long
def test_equal_seeds_give_equal_histories_that_are_rebuilt_from_files(folder: Path, tmp_path: Path) -> None:
    columns = History(folder).columns()
    assert len(columns.names) == RUNS
    assert History(folder).refresh() == 0
    synthesise_runs(ignore, tmp_path, RUNS, 3)
    (tmp_path / FILE).unlink()
    rebuilt = History(tmp_path)
    assert rebuilt.refresh() == RUNS
    again = rebuilt.columns()
    assert again.names == columns.names
    assert again.values["gyro_bias_x"].tolist() == pytest.approx(columns.values["gyro_bias_x"].tolist(), nan_ok=True)
    result = load_result(tmp_path / f"{columns.names[0]}.json")
    assert result.started_utc is not None
    assert result.started_utc.startswith("2025-11-03")


@pytest.mark.long
def test_history_contains_products_stations_operators_failures_and_repeats(folder: Path) -> None:
    history = History(folder)
    choices = history.choices()
    assert (len(choices.products), len(choices.stations), len(choices.operators)) == (3, 4, 6)
    assert {run.verdict for run in history.runs(limit=None)} == {"passed", "failed", "stopped"}
    assert any(run.attempt > 1 for run in history.runs(limit=None))
    assert history.count(RunFilter(search="GOLDEN-NAVA")) > 2


@pytest.mark.long
def test_gauge_study_is_complete_and_check_standard_runs_show_the_drift(folder: Path) -> None:
    plan = GaugePlan.load(folder / "studies" / "gauge.json")
    found = plan.values(History(folder).columns())
    assert len(found) == 30
    assert found["gyro_bias_x"].shape == (10, 3, 3)
    summary = summarise_quality(ignore, folder)
    assert {each.product for each in summary.parameters} == {
        "MEMS grade C",
        "Navigation grade A",
        "Tactical grade B",
    }
    assert len(summary.parameters) == 3 * (len(NAMES) + 1)
    limited = [each.capability for each in summary.parameters if each.parameter != COMMON_SCALE]
    assert all(each is not None and each.ppk.value > 0.7 for each in limited)
    golden = summarise_quality(ignore, folder, serial="GOLDEN-NAVA").single_unit
    strays = {each.parameter: each.process.sigma for each in golden}
    assert strays["gyro_bias_z"] > 3.0 * strays["gyro_bias_x"]
