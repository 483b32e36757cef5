"""The final line of a run states only the completed actions."""

from pathlib import Path
from typing import Any

import pytest

from calstation.cli.run import outcome_text
from calstation.results import Result, load_result
from tests.shared_runs import SharedRuns

STANDARD = {
    "e_n": {"gyro_bias_x": 0.5, "gyro_bias_y": -1.7},
    "e_n_limit": 1.6,
    "t_squared": 9.0,
    "t_squared_limit": 8.0,
    "degrees": 2,
    "false_alarm": 0.01,
}
REGISTERS = {"old": {}, "new": {"gyro_bias_x": 0.0}, "verified": True}


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"registers": REGISTERS}, "passed"),
        ({"registers": None}, "not_written"),
        ({"registers": {**REGISTERS, "new": None, "verified": False}}, "not_written"),
        ({"registers": {**REGISTERS, "proved_on": "read_back"}}, "read_back"),
        ({"registers": REGISTERS, "partial": True}, "partial"),
        ({"registers": None, "partial": True}, "partial_not_written"),
        ({"registers": None, "partial": True, "outcome": "failed", "passed": False}, "partial_failed"),
        ({"check_standard": {**STANDARD, "passed": True}}, "standard_agrees"),
        ({"check_standard": {**STANDARD, "passed": False}, "outcome": "failed", "passed": False}, "standard_differs"),
        ({"check_standard": {**STANDARD, "passed": True}, "outcome": "failed", "passed": False}, "failed"),
    ],
)
def test_outcome_line_matches_the_result(
    tmp_path: Path, shared_runs: SharedRuns, changes: dict[str, Any], code: str
) -> None:
    made = load_result(Path(shared_runs.passed(tmp_path, "six_position").result_file)).to_json()
    result = Result.from_json({**made, "registers": None, "partial": False, **changes})
    text = outcome_text(result)
    assert text.code == f"outcome.{code}"
    if code.startswith("standard"):
        assert (text.values["parameter"], text.values["e_n"]) == ("gyro_bias_y", 1.7)
