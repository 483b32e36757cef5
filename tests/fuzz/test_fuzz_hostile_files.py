"""A command ends with exit code 0, 1 or 2 on every hostile file, in bounded time and memory."""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

hostile_files = pytest.importorskip("hostile_files", reason="limits of processes exist on POSIX only")

#: Files of each kind of the program for the quick tests, recordings of each format for the rehearsals, and all.
SAMPLE, RECORDINGS, ALL = 5, 14, 3000


@pytest.mark.filterwarnings("ignore")  # a warning would be found in the messages
def test_sample_of_hostile_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    files = hostile_files.Files(tmp_path)
    open_here(files, range(SAMPLE))


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
def test_sample_of_hostile_recordings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for library in ("rosbags", "mcap", "nptdms", "pyulog", "pymavlink", "novatel_edie"):
        pytest.importorskip(library, reason=f"{library} is not installed")
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    open_here(hostile_files.Files(tmp_path), range(SAMPLE, RECORDINGS))


def open_here(files: "hostile_files.Files", seeds: range) -> None:
    """Open the files of seeds in this process."""
    for seed in seeds:
        arguments = files.make(seed)
        started = time.process_time()
        wrong = hostile_files.complaint(*hostile_files.run_here(arguments))
        assert not wrong, (seed, arguments)
        assert time.process_time() - started < hostile_files.TIME_LIMIT


@pytest.mark.exhaustive
def test_all_hostile_files(tmp_path: Path) -> None:
    command = [sys.executable, str(Path(__file__).with_name("hostile_files.py")), "0", str(ALL), str(tmp_path)]
    run = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, timeout=3600, check=False
    )
    summary = json.loads(run.stdout.splitlines()[-1])
    assert summary["failures"] == 0, run.stdout[-5000:]
    assert summary["files"] == ALL
