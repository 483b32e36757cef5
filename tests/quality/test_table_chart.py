"""Charts of the table's geometry, and their demonstration on the bench."""

from pathlib import Path

import numpy as np
import pytest

from calstation.cli.app import run_app
from calstation.config import resolve_configuration
from calstation.estimation.positions import TABLE_QUANTITIES
from calstation.quality import WEIGHT, WIDTH, alarms, ewma_chart, table_charts
from calstation.quality.table_chart import LEAST_BASELINE
from calstation.results import History
from calstation.simulation import golden
from calstation.simulation.golden import BASELINE, golden_run, resampled
from tests.site_folder import SiteFolder


def test_a_chart_starts_again_after_each_alarm() -> None:
    values = np.concatenate([np.zeros(5), np.full(40, 3.0)])
    found = alarms(values, 0.0, 1.0)
    assert found[0] == ewma_chart(values, weight=WEIGHT, width=WIDTH, center=0.0, sigma=1.0).signals[0]
    again = ewma_chart(values[found[0] + 1 :], weight=WEIGHT, width=WIDTH, center=0.0, sigma=1.0).signals[0]
    assert found[1] == found[0] + 1 + again
    assert alarms(np.zeros(50), 0.0, 1.0) == ()


def test_resampled_probabilities_of_normal_values_are_those_of_the_charts_themselves() -> None:
    """The side-by-side charts of the resampling and the chart of a station give the same average run length."""
    random = np.random.default_rng(5)
    rates = resampled(random.standard_normal((20_000, 3)), runs=600, after=50, shift=1.0, seed=1)
    count = 0
    for _ in range(300):
        baseline, series = random.standard_normal((BASELINE, 3)), random.standard_normal((600, 3))
        center, sigma = baseline.mean(axis=0), baseline.std(axis=0, ddof=1)
        count += sum(len(alarms(series[:, i], center[i], sigma[i])) for i in range(3))
    assert rates["run_length"] == pytest.approx(600 * 300 / count, rel=0.3)
    assert min(rates["alarmed_in_time"].values()) > 0.97


@pytest.mark.long
def test_a_shift_of_an_axis_on_the_bench_moves_its_quantity_alone() -> None:
    """The shifts are 30 times the standard deviations of a run; equal numbers have equal noise."""
    for i, name in enumerate(TABLE_QUANTITIES):
        shift = [0.0, 0.0, 0.0]
        shift[i] = 3e-3
        moved = golden_run(1, 2, (shift[0], shift[1], shift[2])).table - golden_run(1, 2).table
        assert moved == pytest.approx(shift, abs=1e-4), name


def test_a_station_with_few_runs_has_no_chart(site_folder: SiteFolder) -> None:
    setup = resolve_configuration(site_folder.request())
    assert LEAST_BASELINE == 20
    assert table_charts(setup.station, setup.product, History(Path(site_folder.folder))) == {}


@pytest.mark.long
def test_the_demonstration_finds_a_large_shift_and_nothing_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(golden, "BASELINE", 30)
    monkeypatch.setattr(golden, "WITHIN", 4)
    counted: list[tuple[int, int]] = []
    found = golden.golden_demo(5, 4.0, 3, "tilt_y", 1, lambda done, count: counted.append((done, count)), workers=1)
    assert counted[-1] == (30 + 5 * 2 + 4 * 2, 30 + 5 * 2 + 4 * 2)
    assert found["passed"]
    assert found["alarmed_after"] in (1, 2)
    assert found == golden.golden_demo(5, 4.0, 3, "tilt_y", 1, workers=1)


def test_the_demonstration_refuses_an_unknown_quantity(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(["quality", "golden-demo", "--quantity", "azimuth"]) == 2
    assert "tilt_y" in capsys.readouterr().err
