"""The state of a check standard follows from its latest full run; irregular results are tolerated."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from calstation.config import (
    CheckStandardSection,
    RunRequest,
    library,
    load_configuration,
    load_product,
    load_station,
)
from calstation.devices.profiles import load_imu_profile
from calstation.errors import ConfigurationError, InputError
from calstation.estimation.common import Posterior
from calstation.estimation.positions import TABLE_QUANTITIES
from calstation.judgement import judge_standard
from calstation.physics import COUNT
from calstation.quality import StandardState, judge_result, require_standards, standard_states, station_quality
from calstation.records import RunFilter
from calstation.results import History, Result
from tests.helpers import ignore_progress, raises_code, write_log_of
from tests.results.test_history import refreshed, write
from tests.site_folder import STATION, SiteFolder

NOW = datetime(2026, 11, 23, tzinfo=UTC)
STANDARD = CheckStandardSection.model_validate(
    {
        "serial": "GOLD",
        "interval_days": 7,
        "reference": {name: {"value": 0.0, "sigma": 1.0} for name in ("gyro_bias_x", "gyro_bias_y")},
    }
)
IMU = load_imu_profile(library.find("imus", "bench_nav"))


@pytest.fixture
def runs(site_folder: SiteFolder) -> Path:
    """A folder of runs whose latest run passed and agrees with the reference."""
    site_folder.write({"check_standards": [STANDARD.model_dump(exclude_none=True)]})
    folder = site_folder.folder / "runs"
    folder.mkdir()
    store(folder, "first", 20, "passed")
    return folder


def store(folder: Path, name: str, day: int, outcome: str, **more: Any) -> Path:
    made = {"station": "test bench", "product": "short", "values": {"gyro_bias_x": 0.5}, **more}
    return write(folder, name, "GOLD", outcome, day, **made)


def state(runs: Path) -> StandardState:
    (_, station), (_, product) = load_station(runs.parent / "station.toml"), load_product(runs.parent / "product.toml")
    (found,) = standard_states(station, product, refreshed(runs), NOW)
    return found


def test_failed_latest_run_stops_production_even_if_its_values_agree(runs: Path) -> None:
    assert state(runs).problem is None
    store(runs, "second", 21, "failed")
    found = state(runs)
    assert found.problem is not None
    assert (found.problem.reason, found.problem.since) == ("failed", datetime(2026, 11, 21, 8, tzinfo=UTC))
    assert found.last_passed == datetime(2026, 11, 20, 8, tzinfo=UTC)
    store(runs, "third", 22, "passed")
    assert state(runs).problem is None


@pytest.mark.parametrize("simulated", [True, False])
def test_simulated_run_shows_nothing_about_a_station_with_hardware(runs: Path, simulated: bool) -> None:
    """The runs of the bench are in the same folder, from a station with the same name."""
    (runs / "first.json").unlink()
    table = {name: {"value": 1e-5, "sigma": 1e-6} for name in TABLE_QUANTITIES}
    for day in range(1, 21):
        store(runs, f"run{day}", day, "passed", simulated=simulated, table=table)
    history = refreshed(runs)
    _, product = load_product(runs.parent / "product.toml")
    bench, hardware = runs.parent / "station.toml", runs.parent / "hardware.toml"
    hardware.write_text(
        tomli_w.dumps(
            {
                **STATION,
                "table": {"profile": "bench", "port": "tcp://127.0.0.1:1"},
                "imu": {"port": "socket://127.0.0.1:2"},
            }
        ),
        "utf-8",
    )
    shown = {True: (0, "never"), False: (20, None)}[simulated]
    for path, (count, reason) in ((bench, (20, None)), (hardware, shown)):
        _, station = load_station(path)
        (found,) = standard_states(station, product, History.at(runs, station), NOW)
        assert (None if found.problem is None else found.problem.reason) == reason
        quality = station_quality(ignore_progress, runs, path, runs.parent / "product.toml")
        assert [len(each.names) for each in quality.standards] == [count]
        assert bool(quality.table) == (count > 0)
    assert history.count(RunFilter()) == 20


def test_deleting_the_files_of_a_failed_run_does_not_permit_production(runs: Path) -> None:
    path = store(runs, "second", 21, "failed")
    assert state(runs).problem is not None
    path.unlink()
    found = state(runs)
    assert found.problem is not None
    assert found.problem.reason == "failed"
    store(runs, "third", 22, "passed").unlink()
    assert state(runs).problem == found.problem, "a run without files does not show that the standard agrees"


@pytest.mark.parametrize("log", ["beside", "missing"])
def test_edited_result_of_a_check_standard_does_not_count(runs: Path, log: str) -> None:
    """A run that disagrees is edited so that its values agree; a run that agrees is edited in another entry."""
    path = store(runs, "second", 21, "passed", values={"gyro_bias_x": 50.0})
    write_log_of(path)
    found = state(runs)
    assert found.problem is not None
    assert found.problem.reason == "out"
    if log == "missing":
        path.with_suffix(".h5").unlink()
    store(runs, "second", 21, "passed")
    found = state(runs)
    assert found.problem is not None
    assert (found.problem.reason, found.problem.since) == ("altered", datetime(2026, 11, 21, 8, tzinfo=UTC))
    assert found.last_passed == datetime(2026, 11, 20, 8, tzinfo=UTC), "that of the run before"
    (run,) = [each for each in refreshed(runs).runs() if each.log.stem == "second"]
    with raises_code(InputError, "result.altered" if log == "beside" else "result.altered_without_log"):
        refreshed(runs).result(run)
    store(runs, "third", 22, "passed")
    assert state(runs).problem is None


@pytest.mark.parametrize("outcome", ["passed", "failed"])
def test_latest_run_that_disagrees_is_named_as_such(runs: Path, outcome: str) -> None:
    store(runs, "second", 21, outcome, values={"gyro_bias_x": 50.0})
    found = state(runs)
    assert found.problem is not None
    assert found.problem.reason == "out"


@pytest.mark.parametrize(("chosen", "text"), [("en", "was changed after the run"), ("zh_CN", "结果在标定后被改动")])
def test_refusal_names_the_altered_result(runs: Path, chosen: str, text: str) -> None:
    path = store(runs, "second", 21, "passed", values={"gyro_bias_x": 50.0})
    assert state(runs).problem is not None
    store(runs, "second", 21, "passed")
    assert path.exists()
    files = RunRequest("SN-1", runs.parent / "station.toml", runs.parent / "product.toml", out=runs)
    with raises_code(ConfigurationError, "quality.standard_altered") as caught:
        require_standards(load_configuration(files), refreshed(runs), NOW)
    assert isinstance(caught.value, ConfigurationError)
    assert text in caught.value.render(chosen).text


def test_run_with_a_start_time_in_the_future_is_ignored(runs: Path) -> None:
    store(runs, "second", 21, "failed")
    store(runs, "future", 1, "passed", started_utc="2036-11-22T08:00:00+00:00")
    found = state(runs)
    assert found.problem is not None
    assert found.problem.reason == "failed"


@pytest.mark.parametrize("started", [None, "", "yesterday"])
def test_result_without_a_start_time_does_not_stop_production(runs: Path, started: str | None) -> None:
    path = store(runs, "odd", 21, "failed", started_utc=started)
    assert state(runs).problem is None
    station, product = runs.parent / "station.toml", runs.parent / "product.toml"
    (shown,) = station_quality(lambda *_, **__: None, runs, station, product).standards
    assert shown.names == ("first",)
    result = Result.model_validate_json(path.read_text(encoding="utf-8"))
    with pytest.raises(InputError) as caught:
        judge_result(STANDARD, IMU, result)
    assert caught.value.code == "quality.no_start"


def test_unobservable_parameters_are_not_compared(runs: Path) -> None:
    values = {"gyro_bias_x": 0.5, "gyro_bias_y": 0.0}
    path = store(runs, "second", 21, "passed", values=values, unobservable=["gyro_bias_y"])
    result = Result.model_validate_json(path.read_text(encoding="utf-8"))
    verdict = judge_result(STANDARD, IMU, result)
    alone = judge_standard(STANDARD, IMU, NOW, Posterior(0.5 * np.ones(COUNT), np.eye(COUNT)), ["gyro_bias_x"])
    assert verdict.degrees == 1
    assert verdict.e_n.keys() == {"gyro_bias_x"}
    assert (verdict.e_n_limit, verdict.t_squared_limit) == (alone.e_n_limit, alone.t_squared_limit)
    none = result.model_copy(update={"unobservable": list(values)})
    assert not judge_result(STANDARD, IMU, none).passed
