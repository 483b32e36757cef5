"""A certificate is refused if its log does not give the values or the verdict of the result."""

import json
from pathlib import Path
from typing import Any

import pytest

from calstation.cli.app import run_app
from tests.reports.certificates import make
from tests.shared_runs import SharedRuns


def edited(shared_runs: SharedRuns, folder: Path, kind: str, **changes: Any) -> tuple[Path, dict[str, Any]]:
    """A copy of a run whose result names the log beside it, with other entries, and its content."""
    made = make(shared_runs, folder / "site", kind)
    content = json.loads(made.result_file.read_text(encoding="utf-8"))
    content["log"]["file"] = str(made.result_file.with_suffix(".h5"))
    content.update(changes)
    made.result_file.write_text(json.dumps(content), encoding="utf-8")
    return made.result_file, content


@pytest.mark.parametrize("key", ["value", "sigma"])
def test_another_value_is_refused(
    shared_runs: SharedRuns, tmp_path: Path, capsys: pytest.CaptureFixture[str], key: str
) -> None:
    path, content = edited(shared_runs, tmp_path, "gimbal")
    name, row = next(iter(content["parameters"].items()))
    row[key] += 0.01 * row["sigma"]
    path.write_text(json.dumps(content), encoding="utf-8")
    assert run_app(["report", str(path), "-o", str(tmp_path / "edited.pdf")]) == 2
    assert f"another value of {name} than the result" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "edited.pdf").exists()


@pytest.mark.long
def test_a_verdict_that_the_log_does_not_give_is_refused(
    shared_runs: SharedRuns, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, _ = edited(shared_runs, tmp_path, "failed", outcome="passed", passed=True, checks=[])
    assert run_app(["report", str(path), "-o", str(tmp_path / "edited.pdf")]) == 2
    assert "the log does not meet the limits" in " ".join(capsys.readouterr().err.split())
