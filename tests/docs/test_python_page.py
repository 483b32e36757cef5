"""The examples on the page about the Python interface run."""

import re
import shutil
import textwrap
from pathlib import Path

import pytest

import calstation as cs
from calstation.config import library
from tests.shared_runs import SharedRuns


@pytest.mark.long
def test_examples_run(
    shared_runs: SharedRuns, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ended = shared_runs.passed(tmp_path / "runs")
    shutil.copy(ended.log, tmp_path / "SN-000123.h5")
    monkeypatch.chdir(tmp_path)
    page = (library.manual_folder() / "reference" / "python.md").read_text(encoding="utf-8")
    examples = re.findall(r"(?:^ {4}.*\n|^\n(?= {4}))+", page, flags=re.MULTILINE)
    assert len(examples) == 2
    names: dict[str, object] = {"cs": cs}
    for example in examples:
        exec(compile(textwrap.dedent(example), "python.md", "exec"), names)
    assert (tmp_path / "imu.yaml").exists()
    assert "absent.h5" in capsys.readouterr().out
