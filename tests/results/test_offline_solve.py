"""Solving and exporting beside the window: real progress, whole files or none."""

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from calstation.errors import ConfigurationError
from calstation.records.convert import partial_path
from calstation.results.offline import drop_partial, export_log, export_result, in_sigma, offline_solve
from calstation.results.plots.index import log_index
from calstation.results.resolving import resolve
from tests.cli.conftest import six_position_rows, write_log


class Told:
    """Keeps what a work tells."""

    def __init__(self) -> None:
        self.fractions: list[float] = []
        self.notes: list[str] = []

    def __call__(self, fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        self.fractions.append(fraction)
        self.notes.append(note)


RESULT: dict[str, Any] = {
    "parameters": {"gyro_bias_x": {"value": 0.1 + 0.2, "sigma": 1e-8, "unit": "rad/s", "stage": "excitation"}}
}
STORED: dict[str, Any] = {
    "parameters": {"gyro_bias_x": {"value": 0.3, "sigma": 2e-8, "unit": "rad/s", "stage": "excitation"}}
}


def test_a_range_is_solved_as_the_command_line_does(tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows())
    spans = log_index(Told(), log, tmp_path / "picture").spans
    told = Told()
    solved = offline_solve(told, log, None, 10, 2390, spans)
    assert solved.result_json == resolve(log, None, 10, 2390).result_json
    assert told.fractions == sorted(told.fractions)
    assert told.fractions[-1] > 0.4
    assert set(told.notes) == {"six_position"}


def test_a_log_is_exported_with_progress(tmp_path: Path) -> None:
    rows = six_position_rows()
    log = write_log(tmp_path, rows)
    told = Told()
    target = export_log(told, log, tmp_path / "copy.csv", 0, len(rows) - 1)
    assert len(target.read_text(encoding="utf-8").splitlines()) == len(rows) + 1
    assert target.with_suffix(".toml").is_file()
    assert told.fractions == sorted(told.fractions)
    assert told.fractions[-1] > 0.9


def test_nothing_remains_of_a_cancelled_export(tmp_path: Path) -> None:
    target = tmp_path / "copy.csv"
    partial_path(target).write_text("half", encoding="utf-8")
    drop_partial(Told(), target)
    assert list(tmp_path.iterdir()) == []


def test_a_result_is_exported_as_json(tmp_path: Path) -> None:
    target = export_result(Told(), RESULT, STORED, tmp_path / "result.json")
    assert json.loads(target.read_text(encoding="utf-8")) == RESULT
    assert list(tmp_path.iterdir()) == [target]


def test_a_result_is_exported_beside_the_runs_own_as_csv(tmp_path: Path) -> None:
    target = export_result(Told(), RESULT, STORED, tmp_path / "result.csv")
    (row,) = csv.DictReader(target.read_text(encoding="utf-8").splitlines())
    assert float(row["value"]) == 0.1 + 0.2
    assert float(row["online_value"]) == 0.3
    assert row["difference_in_sigma"] == f"{(0.1 + 0.2 - 0.3) / 2e-8:.6g}"


def test_a_place_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="cannot be written"):
        export_result(Told(), RESULT, None, tmp_path / "nowhere" / "result.json")


def test_a_difference_without_sigma_is_nothing_or_endless() -> None:
    exact = {"value": 0.0, "sigma": 0.0}
    assert in_sigma(exact, exact) == 0.0
    assert in_sigma({"value": 1.0, "sigma": 0.0}, exact) == float("inf")
