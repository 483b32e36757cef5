"""Jobs of the offline page: solving with progress, and exports that are complete or absent."""

import csv
import json
from pathlib import Path

import pytest

from calstation.errors import ConfigurationError
from calstation.records import partial_path
from calstation.results import (
    Parameter,
    Result,
    drop_partial,
    export_log,
    export_result,
    in_sigma,
    offline_solve,
    resolve,
)
from calstation.results.plots import log_index
from tests.cli.conftest import six_position_rows, write_log
from tests.helpers import Progress


def result(value: float, sigma: float) -> Result:
    """Return a result with one parameter."""
    resolved = {"gyro_bias_x": {"value": value, "sigma": sigma, "unit": "rad/s", "stage": "excitation"}}
    return Result.from_json(
        {
            "schema": "calstation.result/1",
            "unit": {"serial": "SN-1"},
            "stages": ["excitation"],
            "parameters": resolved,
            "outcome": "resolved",
            "log": {"file": "log.h5"},
        }
    )


RESULT, STORED = result(0.1 + 0.2, 1e-8), result(0.3, 2e-8)


def test_range_is_solved_like_on_the_command_line(tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows())
    spans = log_index(Progress(), log, tmp_path / "picture").spans
    progress = Progress()
    solved = offline_solve(progress, log, None, 10, 2390, spans)
    assert solved.result.to_json() == resolve(log, None, 10, 2390).result.to_json()
    assert progress.fractions == sorted(progress.fractions)
    assert progress.fractions[-1] > 0.4
    assert set(progress.notes) == {"six_position"}


def test_a_log_is_exported_with_progress(tmp_path: Path) -> None:
    rows = six_position_rows()
    log = write_log(tmp_path, rows)
    progress = Progress()
    target = export_log(progress, log, tmp_path / "copy.csv", 0, len(rows) - 1)
    assert len(target.read_text(encoding="utf-8").splitlines()) == len(rows) + 1
    assert target.with_suffix(".toml").is_file()
    assert progress.fractions == sorted(progress.fractions)
    assert progress.fractions[-1] > 0.9


def test_cancelled_export_leaves_no_file(tmp_path: Path) -> None:
    target = tmp_path / "copy.csv"
    partial_path(target).write_text("half", encoding="utf-8")
    drop_partial(Progress(), target)
    assert list(tmp_path.iterdir()) == []


def test_a_result_is_exported_as_json(tmp_path: Path) -> None:
    target = export_result(Progress(), RESULT, STORED, tmp_path / "result.json")
    assert json.loads(target.read_text(encoding="utf-8")) == RESULT.to_json()
    assert list(tmp_path.iterdir()) == [target]


def test_result_is_exported_as_csv_with_the_result_of_the_run(tmp_path: Path) -> None:
    target = export_result(Progress(), RESULT, STORED, tmp_path / "result.csv")
    (row,) = csv.DictReader(target.read_text(encoding="utf-8").splitlines())
    assert float(row["value"]) == 0.1 + 0.2
    assert float(row["online_value"]) == 0.3
    assert row["difference_in_sigma"] == f"{(0.1 + 0.2 - 0.3) / 2e-8:.6g}"


def test_missing_folder_is_reported(tmp_path: Path) -> None:
    for name in ("result.json", "result.csv"):
        with pytest.raises(ConfigurationError, match="cannot be written"):
            export_result(Progress(), RESULT, None, tmp_path / "nowhere" / name)


def test_difference_with_zero_sigma_is_zero_or_infinite() -> None:
    exact = Parameter(value=0.0, sigma=0.0)
    assert in_sigma(exact, exact) == 0.0
    assert in_sigma(Parameter(value=1.0, sigma=0.0), exact) == float("inf")
