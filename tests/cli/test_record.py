"""A simulated recording is solved, exported and imported by commands."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.conftest import Done

Run = Callable[..., Done]


@pytest.mark.parametrize(
    ("kind", "stage"),
    [
        pytest.param("hand", "multi_position", marks=pytest.mark.exhaustive),
        pytest.param("pair", "cross_calibration", marks=pytest.mark.long),
        ("gimbal", "gimbal"),
    ],
)
def test_recording_is_simulated_solved_and_compared_with_its_truth(
    calstation: Run, tmp_path: Path, kind: str, stage: str
) -> None:
    log = tmp_path / f"{kind}.h5"
    assert calstation("record", kind, "-o", log, "--seed", 5).code == 0
    truth = json.loads(log.with_suffix(".truth.json").read_text())
    first = calstation("resolve", log, "--json", "-")
    assert first.code == 0
    assert first.json["stages"] == [stage]
    assert first.json["passed"] is None
    parameters = first.json["parameters"]
    assert len(parameters) == {"hand": 21, "pair": 28, "gimbal": 6}[kind]
    for name, row in parameters.items():
        assert abs(row["value"] - truth[name]) < 5.0 * row["sigma"], name
        assert row["stage"] == stage
    table = calstation("resolve", log)
    assert all(name in table.out for name in parameters)
    assert calstation("export", log, "-o", tmp_path / "out.csv").code == 0
    assert calstation("import", tmp_path / "out.csv", "-o", tmp_path / "back.h5").code == 0
    again = calstation("resolve", tmp_path / "back.h5", "--json", "-").json
    assert again["parameters"] == parameters
    assert again["log"]["sha256"] == first.json["log"]["sha256"]


def test_unknown_recording_type_grade_or_file_name_is_refused(calstation: Run, tmp_path: Path) -> None:
    assert "Choose from hand, pair, gimbal" in calstation("record", "foot", "-o", tmp_path / "a.h5").err
    assert "Choose from nav" in calstation("record", "hand", "-o", tmp_path / "a.h5", "--grade", "best").err
    assert "ends in .h5" in calstation("record", "hand", "-o", tmp_path / "a.csv").err
