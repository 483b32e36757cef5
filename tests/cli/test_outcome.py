"""The final line of a run states only the completed actions."""

from pathlib import Path
from typing import Any

import pytest

from calstation.cli.run import outcome_text
from calstation.messages import sentence
from calstation.results import SCHEMA, Result, load_result
from tests.check_rows import check_row
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
    result = Result.from_json({**made, "registers": None, "partial": False, "not_compared": [], **changes})
    text = outcome_text(result)
    assert text.code == f"outcome.{code}"
    if code.startswith("standard"):
        assert (text.values["parameter"], text.values["e_n"]) == ("gyro_bias_y", 1.7)


@pytest.mark.parametrize(
    ("acceptance", "english", "chinese"),
    [
        (None, "FAILED: outside the limits", "不合格：超出限差"),
        ([-9e-4, 9e-4], "FAILED: outside the acceptance limits", "不合格：超出接受限"),
    ],
)
def test_outcome_line_names_the_limits_that_were_applied(
    acceptance: list[float] | None, english: str, chinese: str
) -> None:
    check = check_row("within", "gyro_scale_x", 9.5e-4, [-1e-3, 1e-3], passed=False, acceptance=acceptance)
    row = {"schema": SCHEMA, "unit": {"serial": "SN-1"}, "stages": [], "outcome": "failed", "parameters": {}}
    text = outcome_text(Result.from_json({**row, "checks": [check], "log": {"file": "log.h5"}}))
    assert sentence(text) == english
    assert sentence(text, "zh_CN") == chinese


@pytest.mark.parametrize("registers", [None, REGISTERS, {**REGISTERS, "proved_on": "read_back"}])
def test_limits_that_were_not_judged_are_named_beside_the_verdict(registers: dict[str, Any] | None) -> None:
    result = passed_result(registers, not_compared=[*(f"gyro_bias_{axis}" for axis in "xyz"), "gyro_scale_x"])
    english, chinese = (sentence(outcome_text(result), language) for language in ("en", "zh_CN"))
    assert "not judged although they have a limit: gyro_bias, gyro_scale_x" in english
    assert "every limit" not in english
    assert "未判定：gyro_bias、gyro_scale_x" in chinese
    assert "全部在限差之内" not in chinese
    assert "within every limit" in sentence(outcome_text(passed_result(registers, not_compared=[])))


def passed_result(registers: dict[str, Any] | None, *, not_compared: list[str]) -> Result:
    """Return the result of a run of all stages that passed."""
    return Result.from_json(
        {
            "schema": SCHEMA,
            "unit": {"serial": "SN-1"},
            "stages": ["six_position"],
            "outcome": "passed",
            "parameters": {},
            "registers": registers,
            "not_compared": not_compared,
            "log": {"file": "SN-1.h5"},
        }
    )


@pytest.mark.parametrize(
    ("kinds", "english", "chinese"),
    [
        (
            ["alternatives"],
            "FAILED: 1 check failed (effect instead of a state)",
            "不合格：1 项检查未通过（可代替状态的效应）",
        ),
        (
            ["effects", "heading"],
            "FAILED: 2 checks failed (effect outside the model, Rate, heading)",
            "不合格：2 项检查",
        ),
        (["effects", "within"], "FAILED: outside the limits", "不合格：超出限差"),
    ],
)
def test_outcome_line_names_the_checks_that_failed_within_the_limits(
    kinds: list[str], english: str, chinese: str
) -> None:
    checks = [check_row(kind, "gyro_scale_x" if kind == "within" else "rate", 9.0, 1.0, passed=False) for kind in kinds]
    row = {"schema": SCHEMA, "unit": {"serial": "SN-1"}, "stages": [], "outcome": "failed", "parameters": {}}
    text = outcome_text(Result.from_json({**row, "checks": checks, "log": {"file": "log.h5"}}))
    assert sentence(text) == english
    assert sentence(text, "zh_CN").startswith(chinese)
