"""Reference logs are solved as stored; another answer, another sample or another solution is found."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from calstation.validation import references
from calstation.validation.lines import Line
from calstation.validation.references import ANSWERS, REFERENCES, reference_lines, references_folder
from procedures import names

QUICK = "gimbal"


def lines() -> dict[str, Line]:
    return {line.check: line for line in reference_lines(lambda: None) if line.subject in (QUICK, ANSWERS)}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the reference log that is solved most quickly."""
    answers = json.loads((references_folder() / ANSWERS).read_text(encoding="utf-8"))
    for name in (f"{QUICK}.csv.gz", f"{QUICK}.toml"):
        shutil.copy(references_folder() / name, tmp_path / name)
    (tmp_path / ANSWERS).write_text(json.dumps({QUICK: answers[QUICK]}), encoding="utf-8")
    monkeypatch.setattr(references, "references_folder", lambda: tmp_path)
    monkeypatch.setattr(references, "REFERENCES", 1)
    return tmp_path


def change(folder: Path, action: Callable[[dict[str, Any]], None]) -> None:
    answers = json.loads((folder / ANSWERS).read_text(encoding="utf-8"))
    action(answers[QUICK])
    (folder / ANSWERS).write_text(json.dumps(answers), encoding="utf-8")


def test_a_reference_log_agrees_with_its_answer(folder: Path) -> None:
    everything = list(reference_lines(lambda: None))
    assert {line.check: line.state for line in everything if line.subject == QUICK} == {
        **dict.fromkeys(("transfer", "solution", "repetition", "truth", "solving"), "ok"),
        "second_opinion": "not_checked",
    }
    assert [line.state for line in everything if line.check == "answers"] == ["ok"]
    other = [line for line in everything if line.subject not in (QUICK, ANSWERS)]
    assert {line.subject for line in other} == {*names()} - {QUICK}
    assert {line.state for line in other} == {"not_checked"}  # methods without a reference log are named


def test_an_altered_answer_is_found(folder: Path) -> None:
    def shift(answer: dict[str, Any]) -> None:
        value, sigma = answer["parameters"]["gyro_misalign_xy"]
        answer["parameters"]["gyro_misalign_xy"] = [value + 0.002 * sigma, sigma]

    change(folder, shift)
    assert lines()["solution"].state == "failed"
    change(folder, lambda answer: answer.update(passed=True))
    assert lines()["solution"].state == "failed"


def test_another_truth_and_another_sample_are_found(folder: Path) -> None:
    change(folder, lambda answer: answer["truth"].update(gyro_misalign_xy=1.0))
    change(folder, lambda answer: answer.update(samples_sha256="0" * 64))
    found = lines()
    assert (found["truth"].state, found["transfer"].state) == ("failed", "failed")


@pytest.mark.parametrize(
    "damage", [lambda a: a.pop("parameters"), lambda a: a["parameters"].update(gyro_misalign_xy=1)]
)
def test_a_damaged_answer_is_found(folder: Path, damage: Callable[[dict[str, Any]], None]) -> None:
    change(folder, damage)
    assert "failed" in {line.state for line in lines().values()}


def test_missing_answers_are_found(folder: Path) -> None:
    for content in ("[]", "{}", "no JSON"):
        (folder / ANSWERS).write_text(content, encoding="utf-8")
        assert lines()["answers"].state == "failed"


def test_a_parameter_that_is_not_a_number_is_found(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answers = json.loads((folder / ANSWERS).read_text(encoding="utf-8"))[QUICK]

    def damaged(result: Any) -> dict[str, Any]:
        parameters = {**answers["parameters"], "gyro_misalign_zy": [float("nan"), 1e-4]}
        return {**answers, "parameters": parameters}

    monkeypatch.setattr(references, "_answer", damaged)
    found = lines()
    assert (found["solution"].state, found["truth"].state) == ("failed", "failed")


@pytest.mark.long
def test_all_reference_logs_agree() -> None:
    """If the estimation was changed on purpose, `make references` writes new answers."""
    found = list(reference_lines(lambda: None))
    assert not [line for line in found if line.state == "failed"]
    assert len([line for line in found if line.check == "transfer"]) == REFERENCES
    assert [line.subject for line in found if line.check == "second_opinion" and line.state == "ok"] == [
        "four_stages", "designed",
    ]  # fmt: skip
