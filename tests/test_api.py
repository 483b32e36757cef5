"""The Python interface: `import calstation` is cheap, and its functions do what the commands do."""

import _thread
import inspect
import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import calstation as cs
from calstation.cli.app import run_app
from calstation.physics import NAMES
from tests.cli.conftest import META, six_position_rows, write_log
from tests.helpers import Progress, raises_code
from tests.site_folder import SiteFolder

CHEAP = """
import sys
import calstation as cs
assert "numpy" not in sys.modules and [m for m in sys.modules if m.startswith("calstation")] == ["calstation"]
assert {"open", "resolve", "apply", "export", "run", "design", "simulate", "Log", "Result"} <= set(dir(cs))
cs.CalstationError
assert "numpy" not in sys.modules
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_log(tmp_path, six_position_rows(), meta=META.replace("accel_lsb = 1e-6", "accel_lsb = 1.001e-6"))


def test_import_loads_nothing_else() -> None:
    subprocess.run([sys.executable, "-c", CHEAP], check=True, timeout=60)


def test_functions_take_the_arguments_that_the_contract_names() -> None:
    contract = (Path(__file__).parents[1] / "docs" / "contract.md").read_text(encoding="utf-8")
    python = contract.partition("## Python")[2].partition("## ")[0]
    calls = re.findall(r"cs\.(\w+)\((.*?)\)(?=  | ->|$)", python, re.MULTILINE)
    assert {name for name, _ in calls} == {"open", "resolve", "apply", "export", "run", "design", "simulate"}
    for name, arguments in calls:
        given = [argument.partition("=") for argument in arguments.split(", ")]
        by_name = {argument: None for argument, equals, _ in given if equals}
        inspect.signature(getattr(cs, name)).bind(*(None for _, equals, _ in given if not equals), **by_name)


def test_result_has_the_entries_that_the_contract_names(path: Path) -> None:
    entries = cs.resolve(path).to_json()
    names = "schema unit stages passed parameters checks consistency outcome attempt operator station product partial"
    names += " configuration_sha256 temperature_c registers log software started_utc duration_s unobservable"
    assert set(names.split()) <= entries.keys()
    assert entries["schema"] == "calstation.result/1"
    assert entries["parameters"]["accel_bias_x"].keys() == {"value", "sigma", "unit", "stage"}
    assert entries["log"].keys() == {"file", "sha256", "first_seq", "last_seq", "gaps"}
    assert all({"name", "value", "limit", "unit", "passed"} <= check.keys() for check in entries["checks"])
    (consistency,) = entries["consistency"].values()
    assert consistency.keys() == {"nis_mean", "nis_low", "nis_high", "passed", "warning"}
    assert (entries["passed"], entries["outcome"]) == (None, "resolved")


def test_unknown_name_is_refused() -> None:
    with pytest.raises(AttributeError, match="no attribute 'calibrate'"):
        cs.calibrate  # noqa: B018


def test_log_gives_its_samples_in_si(path: Path) -> None:
    log = cs.open(path)
    assert (log.serial, log.product, log.stages, log.sample_rate) == ("SN-7", None, ("six_position",), 50.0)
    assert (len(log), log.first_seq, log.last_seq) == (2400, 0, 2399)
    rows = np.loadtxt(path, delimiter=",", skiprows=1, usecols=range(10))
    np.testing.assert_allclose(log.gyro, rows[:, 2:5] * 1e-7)
    np.testing.assert_allclose(log.accel, rows[:, 5:8] * 1.001e-6)
    np.testing.assert_allclose(np.stack([log.outer, log.inner], axis=1), np.deg2rad(rows[:, 8:10]), atol=1e-12)
    np.testing.assert_allclose(log.time_s, rows[:, 1])
    assert log.seq.tolist() == list(range(2400))
    assert log.step[[0, -1]].tolist() == [0, 5]
    assert set(log.stage) == {"six_position"}
    assert np.isnan(log.temp_c).all()
    assert log.valid.all()
    assert log.gyro.shape == log.accel.shape == (2400, 3)


def test_solution_is_that_of_the_command(path: Path, tmp_path: Path) -> None:
    progress = Progress()
    result = cs.resolve(cs.open(path), progress=progress)
    assert run_app(["resolve", str(path), "--json", str(tmp_path / "result.json")]) == 0
    assert result.to_json()["parameters"] == json.loads((tmp_path / "result.json").read_text())["parameters"]
    assert all(0.0 <= fraction <= 1.0 for fraction in progress.fractions)
    assert set(progress.notes) == {"six_position"}


def test_covariance_and_corrected_samples(path: Path) -> None:
    log = cs.open(path)
    result = cs.resolve(log)
    estimated = np.array([name in result.parameters for name in NAMES])
    assert result.covariance.shape == (30, 30)
    np.testing.assert_array_equal(np.isfinite(np.diag(result.covariance)), estimated)
    sigma = [result.parameters[name].sigma for name in NAMES if name in result.parameters]
    np.testing.assert_allclose(np.sqrt(np.diag(result.covariance)[estimated]), sigma)
    gyro, accel = cs.apply(result, log.gyro, log.accel)
    lengths = np.linalg.norm(accel.reshape(6, -1, 3).mean(axis=1), axis=1)
    assert np.ptp(lengths) < 1e-3
    assert gyro.shape == (2400, 3)
    with raises_code(cs.CalstationError, "api.sample_shape"):
        cs.apply(result, log.gyro[:5], log.accel)


def test_temperatures_are_one_or_one_per_sample(path: Path) -> None:
    content = cs.resolve(path).to_json()
    content["temperature"] = {"reference_c": 25.0, "range_c": [0.0, 50.0], "coefficients": {}}
    content["temperature"] |= {"covariance": [], "worst": {}, "points": []}
    result, samples = cs.Result.from_json(content), np.ones((2, 3))
    np.testing.assert_array_equal(cs.apply(result, samples, samples, 20.0)[0], samples)
    with raises_code(cs.CalstationError, "api.temperature_shape"):
        cs.apply(result, samples, samples, np.full(3, 20.0))


def test_range_stages_and_errors(path: Path) -> None:
    result = cs.resolve(path, stages=["six_position"], first=0, last=2399)
    assert (result.log.first_seq, result.log.last_seq) == (0, 2399)
    with raises_code(cs.CalstationError, "solution.range_reversed"):
        cs.resolve(path, first=9, last=3)
    with raises_code(cs.CalstationError, "cli.unknown_choice"):
        cs.resolve(path, states=["wind"])
    with pytest.raises(cs.CalstationError) as caught:
        cs.open("absent.h5")
    assert "absent.h5" in str(caught.value)
    assert caught.value.values["file"] == Path("absent.h5")


def test_export_writes_file_and_check(path: Path, tmp_path: Path) -> None:
    log = cs.open(path)
    check = cs.export(cs.resolve(log), "c", tmp_path / "imu.h", log=log)
    assert check.samples == 2400
    assert (tmp_path / "imu.h.check.json").is_file()


def test_simulated_log_is_solved_to_its_truth(site_folder: SiteFolder) -> None:
    site_folder.write(product={"stages": ["six_position"]})
    log, truth = cs.simulate(site_folder.product, seed=3, station=site_folder.station)
    assert tuple(truth) == NAMES
    assert log.stages == ("six_position",)
    result = cs.resolve(log)
    for name, row in result.parameters.items():
        assert abs(row.value - truth[name]) < 5.0 * row.sigma, name
    again, same = cs.simulate(site_folder.product, seed=3, station=site_folder.station)
    np.testing.assert_array_equal(again.accel, log.accel)
    assert same == truth
    assert cs.simulate(site_folder.product, seed=4, station=site_folder.station)[1] != truth


def test_table_moves_only_after_a_confirmation(site_folder: SiteFolder) -> None:
    station = site_folder.station.read_text(encoding="utf-8").partition("[bench]")[0]
    ports = 'imu = { port = "socket://localhost:1" }\n'
    site_folder.station.write_text(
        ports + station.replace('profile = "bench"', 'profile = "bench"\nport = "socket://localhost:2"'),
        encoding="utf-8",
    )
    with raises_code(cs.CalstationError, "run.table_moves"):
        cs.run(site_folder.station, site_folder.product, "SN-000042", out=site_folder.runs)


@pytest.mark.long
def test_run_returns_the_stored_result(site_folder: SiteFolder) -> None:
    site_folder.write(product={"stages": ["six_position"]})
    progress = Progress()
    (result,) = cs.run(site_folder.station, site_folder.product, "SN-000042", progress, out=site_folder.runs)
    (stored,) = site_folder.runs.glob("*.json")
    assert result.to_json() == json.loads(stored.read_text(encoding="utf-8"))
    assert result.verdict.passed
    assert progress.fractions == sorted(progress.fractions)
    assert set(progress.notes) == {"six_position"}


@pytest.mark.long
def test_ctrl_c_stops_a_run(site_folder: SiteFolder) -> None:
    def interrupt(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        _thread.interrupt_main()

    signal.signal(signal.SIGINT, signal.default_int_handler)  # a test in the background ignores Ctrl-C
    with pytest.raises(KeyboardInterrupt):
        cs.run(site_folder.station, site_folder.product, "SN-000042", interrupt, out=site_folder.runs)
    (stored,) = site_folder.runs.glob("*.json")
    assert json.loads(stored.read_text(encoding="utf-8"))["outcome"] == "stopped"


def test_progress_receives_all_three_values(path: Path, site_folder: SiteFolder) -> None:
    calls = []

    def progress(fraction: float, remaining_s: float | None, note: str) -> None:
        calls.append((fraction, remaining_s, note))

    cs.resolve(path, progress=progress)
    site_folder.write(product={"stages": ["six_position"]})
    cs.simulate(site_folder.product, station=site_folder.station, progress=progress)
    assert calls[0][1:] == (None, "six_position")
    assert calls[-1] == (1.0, None, "")


def test_progress_can_interrupt_a_solution(path: Path) -> None:
    def interrupt(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cs.resolve(path, progress=interrupt)


def test_frame_needs_pandas(path: Path) -> None:
    result = cs.resolve(path)
    try:
        import pandas  # noqa: F401
    except ImportError:
        with raises_code(cs.CalstationError, "api.no_package"):
            result.to_frame()
        return
    frame = result.to_frame()
    assert list(frame.columns) == ["value", "sigma", "unit", "stage"]
    assert frame.loc["accel_bias_x", "value"] == result.parameters["accel_bias_x"].value
