"""The summary of a folder contains charts, capability and yield of the selected runs."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from calstation.config import library, load_product
from calstation.quality import SimulatedRuns, judged_runs, last_of_each_unit, limit_interval, summarise_quality
from calstation.results import History
from tests.results.test_history import write
from tests.results.test_shift import VERDICT

NAV = "Navigation grade A"
BEGIN = datetime(2026, 11, 1, tzinfo=UTC)


def ignore(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
    assert 0.0 <= fraction <= 1.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """30 units, one of them run twice, a check standard of 15 runs with a step, and runs without a verdict."""
    folder = tmp_path_factory.mktemp("runs")
    random = np.random.default_rng(1)

    def add(k: int, serial: str, outcome: str, value: float, **more: object) -> None:
        started = (BEGIN + timedelta(hours=k)).isoformat()
        values = {"gyro_bias_x": value, "accel_bias_x": 1e-3}
        write(folder, f"{serial}_{k}", serial, outcome, 1, values=values, started_utc=started, **more)

    for k in range(30):
        add(k, f"SN-{k}", "failed" if k == 4 else "passed", 1e-6 * random.normal())
        if k % 2:
            add(100 + k, "GOLD", "passed", 2e-6 + 1e-8 * random.normal() + (1e-7 if k > 20 else 0.0))
    add(40, "SN-4", "passed", 5e-6)
    add(41, "SN-5", "stopped", 9e-6)
    add(42, "SN-6", "passed", 9e-6, partial=True)
    add(43, "SN-7", "passed", 9e-6, product="unknown")
    History(folder).refresh()
    return folder


def test_every_unit_is_represented_by_its_last_judged_full_run(folder: Path) -> None:
    history = History(folder)
    history.refresh()
    runs = history.columns()
    judged = judged_runs(runs)
    judged = judged[runs.products.isin((NAV,))[judged]]
    index = last_of_each_unit(runs, judged)
    names = [runs.names[k] for k in index.tolist()]
    assert (len(judged), len(names)) == (46, 31)
    assert {"SN-4_40", "SN-5_5", "SN-6_6", "SN-7_7", "GOLD_129"} <= {*names}
    assert np.all(np.diff(runs.started[index]) > 0)


def test_mean_of_the_accelerometer_scale_factors_is_charted(tmp_path: Path) -> None:
    """Gravity 100 ppm wrong is a step of the mean, half of the scatter of a single factor between units."""
    random = np.random.default_rng(2)
    for k in range(60):
        x, y, z = (200e-6 * random.normal() - (100e-6 if k >= 40 else 0.0) for _ in range(3))
        values = {"accel_scale_x": x, "accel_scale_y": y, "accel_scale_z": z}
        started = (BEGIN + timedelta(hours=k)).isoformat()
        write(tmp_path, f"SN-{k}", f"SN-{k}", "passed", 1, values=values, started_utc=started)
    History(tmp_path).refresh()
    charts = {each.parameter: each for each in summarise_quality(ignore, tmp_path).parameters}
    mean = charts["accel_scale"]
    parts = np.array([charts[f"accel_scale_{axis}"].values for axis in "xyz"])
    assert mean.values == pytest.approx(parts.mean(axis=0))
    assert mean.capability is None
    (only,) = summarise_quality(ignore, tmp_path, parameter="accel_scale").parameters
    assert only.parameter == "accel_scale"


def test_summary_contains_charts_and_capability_of_a_product(folder: Path) -> None:
    found = summarise_quality(ignore, folder, library.find("products", "nav_a"))
    assert [each.parameter for each in found.parameters] == ["gyro_bias_x"]  # the other is the same in every run
    (bias,) = found.parameters
    assert bias.capability is not None
    assert (bias.capability.low, bias.capability.high) == (-1.5e-5, 1.5e-5)
    assert bias.capability.count == 31
    assert found.yields.overall is not None
    assert (found.yields.overall.passed, found.yields.overall.count) == (45, 46)
    assert found.yields.products.keys() == {NAV}
    every = summarise_quality(ignore, folder)
    assert every.yields.products.keys() == {NAV, "unknown"}
    assert every.parameters[0].capability == bias.capability  # the limits of the product file of that name
    json.dumps(every.to_json(), allow_nan=False)


def test_former_check_standard_is_excluded(tmp_path: Path) -> None:
    for k in range(12):
        values = {"gyro_bias_x": 1e-6 * (k % 5)}
        write(tmp_path, f"SN-{k}", f"SN-{k}", "passed", 1, values=values)
        write(tmp_path, f"G_{k}", "GOLD", "failed", 2, values=values, check_standard=VERDICT)
    History(tmp_path).refresh()
    for product in (None, library.find("products", "nav_a")):
        found = summarise_quality(ignore, tmp_path, product)
        assert found.yields.overall is not None
        assert (found.yields.overall.passed, found.yields.overall.count) == (12, 12)
        assert [len(each.names) for each in found.parameters] == [12]
    (golden,) = summarise_quality(ignore, tmp_path, serial="GOLD").single_unit
    assert len(golden.names) == 12


def test_step_in_the_runs_of_one_unit_is_detected(folder: Path) -> None:
    found = summarise_quality(ignore, folder, serial="GOLD")
    (bias,) = found.single_unit
    assert (len(bias.names), bias.capability) == (15, None)
    assert bias.alarms["ewma"] > 0
    shown = found.to_json()["golden"]
    assert shown["serial"] == "GOLD"
    assert shown["parameters"][0]["ewma_signals"][-1] == "GOLD_129"
    assert shown["parameters"][0]["signals"][0].keys() == {"run", "rule"}
    assert "GOLD_129" not in found.parameters[0].names
    assert found.yields.overall is not None
    assert found.yields.overall.count == 32


def test_summary_is_filtered_by_parameter_and_date(folder: Path) -> None:
    assert summarise_quality(ignore, folder, parameter="accel_bias_x").parameters == ()
    later = summarise_quality(ignore, folder, since=BEGIN + timedelta(hours=25))
    assert later.yields.overall is not None
    assert later.yields.overall.count == 5 + 1 + 15 + 1
    assert summarise_quality(ignore, folder, since=BEGIN + timedelta(days=99)).yields.overall is None


def test_units_that_are_calibrated_again_change_neither_limits_nor_signals(tmp_path: Path) -> None:
    """The charts contain the first run of each unit, the capability the last one."""
    random = np.random.default_rng(5)

    def add(k: int, serial: int, value: float) -> None:
        started = (BEGIN + timedelta(hours=k)).isoformat()
        write(
            tmp_path,
            f"SN-{serial}_{k}",
            f"SN-{serial}",
            "passed",
            1,
            values={"gyro_bias_x": value},
            started_utc=started,
        )

    for k in range(130):
        add(k, k, 1e-6 * random.normal() + (8e-6 if k in (30, 110) else 0.0))
    product = library.find("products", "nav_a")
    History(tmp_path).refresh()
    (before,) = summarise_quality(ignore, tmp_path, product).parameters
    assert before.alarms["nelson_1"] == 2
    for k in (*range(60), 110):
        add(200 + k, k, 3e-6)
    History(tmp_path).refresh()
    (after,) = summarise_quality(ignore, tmp_path, product).parameters
    assert (after.process, after.names, after.alarms) == (before.process, before.names, before.alarms)
    assert np.array_equal(after.values, before.values)
    assert after.capability is not None
    assert after.capability.mean == pytest.approx(np.mean(after.last_values)) != pytest.approx(np.mean(after.values))
    assert np.count_nonzero(after.last_values == 3e-6) == 61


def test_limits_of_a_parameter_take_precedence_over_its_group() -> None:
    _, product = load_product(library.find("products", "nav_a"))
    assert limit_interval(product, "gyro_bias_x") == (-1.5e-5, 1.5e-5)
    limit = product.limits["gyro_bias"].model_copy(update={"within": [0.0, 1.0]})
    own = product.model_copy(update={"limits": {**product.limits, "gyro_bias_x": limit}})
    assert limit_interval(own, "gyro_bias_x") == (0.0, 1.0)
    assert limit_interval(own, "clock_offset") is None


def test_signals_do_not_depend_on_the_earliest_start(tmp_path: Path) -> None:
    """A drift and two jumps: average, sums, patterns and moving range of a shown run include the runs not shown."""
    random = np.random.default_rng(4)
    for k in range(60):
        drift = 0.3e-6 * max(0, k - 20) + (6e-6 if k in (30, 45) else 0.0)
        values = {"gyro_bias_x": 1e-6 * random.normal() + drift}
        started = (BEGIN + timedelta(hours=k)).isoformat()
        write(tmp_path, f"SN-{k}", f"SN-{k}", "passed", 1, values=values, started_utc=started)
    History(tmp_path).refresh()
    (whole,) = summarise_quality(ignore, tmp_path).parameters
    expected = {code: {whole.names[k] for k in found} for code, found in whole.charts().signals().items()}
    assert all(expected[code] for code in ("nelson_2", "range", "ewma", "cusum"))
    for first in (1, 25, 30, 31, 45, 50):
        (part,) = summarise_quality(ignore, tmp_path, since=BEGIN + timedelta(hours=first)).parameters
        charts = part.charts()
        assert part.names == whole.names[first:]
        for code, found in charts.signals().items():
            assert {part.names[k] for k in found} == expected[code] & {*part.names}, code
            assert part.alarms[code] == len(found)
        assert charts.ewma.average == pytest.approx(whole.charts().ewma.average[first:], abs=0.0)
        assert charts.individuals.ranges == pytest.approx(np.abs(np.diff(whole.values[first - 1 :])))


@pytest.mark.parametrize("real", [True, False])
def test_simulated_runs_are_left_out_unless_all_are_simulated(tmp_path: Path, real: bool) -> None:
    for k in range(24):
        started, simulated = (BEGIN + timedelta(hours=k)).isoformat(), k % 2 == 0 or not real
        values = {"gyro_bias_x": 1e-6 * (k // 2 % 5)}
        write(tmp_path, f"N-{k}", f"N-{k}", "passed", 1, values=values, started_utc=started, simulated=simulated)
    History(tmp_path).refresh()
    summary = summarise_quality(ignore, tmp_path)
    assert summary.yields.overall is not None
    assert (summary.yields.overall.count, summary.chartable) == ((12, 12) if real else (24, 24))
    assert [len(each.values) for each in summary.parameters] == [12 if real else 24]
    assert summary.simulated == (SimulatedRuns(12) if real else SimulatedRuns(24, only=True))


@pytest.mark.parametrize("real", [True, False])
def test_simulated_runs_are_counted_in_the_chosen_period(tmp_path: Path, real: bool) -> None:
    for k in range(6):
        started, simulated = (BEGIN + timedelta(hours=k)).isoformat(), k > 0 or not real
        write(tmp_path, f"N-{k}", f"N-{k}", "passed", 1, started_utc=started, simulated=simulated)
    History(tmp_path).refresh()
    for hours, count in ((2, 4), (5, 1), (6, 0)):
        summary = summarise_quality(ignore, tmp_path, since=BEGIN + timedelta(hours=hours))
        assert summary.simulated == SimulatedRuns(count, only=not real)


def test_folder_without_simulated_runs_says_nothing_about_them(folder: Path) -> None:
    assert summarise_quality(ignore, folder).simulated.text is None
