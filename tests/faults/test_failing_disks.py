"""A disk that refuses or fails any write neither crashes the program nor loses what was written to a unit."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux") or shutil.which("cc") is None, reason="needs a C compiler and ld.so"
)


def ran(name: str, *arguments: object) -> str:
    """Run a program of this folder, which lets writes fail, and return its output."""
    command = [sys.executable, str(Path(__file__).with_name(f"{name}.py")), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    return done.stdout


@pytest.mark.exhaustive
def test_log_ends_with_an_error_whichever_write_fails(tmp_path: Path) -> None:
    assert ran("failing_log", tmp_path).splitlines()[-1].endswith("calls, 0 failures")


@pytest.mark.exhaustive
def test_runs_on_full_and_failing_disks_lose_nothing(tmp_path: Path) -> None:
    summary = json.loads(ran("failing_disks", 1, 100, tmp_path).splitlines()[-1])
    assert (summary["trials"], summary["failures"]) == (100, 0)
