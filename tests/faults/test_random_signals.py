"""Signals at random moments to every process of a run end it with a result, the right exit code and a table at rest."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="finds processes in /proc")


@pytest.mark.exhaustive
def test_signals_at_random_moments_stop_a_run_safely(tmp_path: Path) -> None:
    command = [sys.executable, str(Path(__file__).with_name("random_signals.py")), "0", "200", str(tmp_path)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    summary = json.loads(done.stdout.splitlines()[-1])
    assert summary["failures"] == 0, done.stdout[-5000:]
