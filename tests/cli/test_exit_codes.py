"""The exit codes of commands after signals and without standard streams."""

import json
import os
import random
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from calstation.cli import process
from calstation.cli.run import engine_events
from calstation.records import append_audit, audit_path, open_log
from calstation.runs import Engine
from tests.cli.conftest import six_position_rows, write_log
from tests.helpers import sampled
from tests.site_folder import SiteFolder

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no POSIX signals")

#: The command, which says when its own code begins: before, Python itself ends.
COMMAND = """
import sys, time
from calstation.cli import main
from calstation.cli.process import prepare
prepare()
print("begun", file=sys.stderr, flush=True)
try:
    main()
finally:
    print("ended", time.monotonic(), file=sys.stderr)
"""

COMMANDS: dict[str, Callable[[Path], list[object]]] = {
    "import": lambda folder: ["import", folder / "log.csv", "-o", folder / "imported.h5"],
    "export": lambda folder: ["export", folder / "log.csv", "-o", folder / "exported.csv"],
    "resolve": lambda folder: ["resolve", folder / "log.csv", "--json", "-"],
    "quality": lambda folder: ["quality", "--out", folder, "--json", "-"],
    "check": lambda folder: ["check"],
    "run": lambda folder: [
        *("run", "--yes", "--serial", "SN-000042", "--station", folder / "station.toml"),
        *("--product", folder / "product.toml", "--out", folder / "runs"),
    ],
    "study": lambda folder: ["study", "--grade", "mems", "--seeds", "4"],
    "watch": lambda folder: ["watch", "--station", "virtual_pair", "--seconds", "20", "--json", "-"],
}
#: Longest time after the start of a command at which a signal arrives, s.
LATEST = {"import": 2.0, "export": 2.0, "resolve": 3.0, "quality": 2.0, "check": 2.0, "run": 8.0, "study": 6.0}


def start(folder: Path, arguments: list[object], **streams: Any) -> "subprocess.Popen[str]":
    """Start a command as the leader of a process group, like a terminal, and wait until its code begins."""
    process = subprocess.Popen(
        [sys.executable, "-c", COMMAND, *map(str, arguments)],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "CALSTATION_HOME": str(folder / "site"), "COLUMNS": "200"},
        process_group=0,
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),  # a test in the background ignores Ctrl-C
        **{"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, **streams},
    )
    assert process.stderr is not None
    assert process.stderr.readline() == "begun\n"
    return process


def interrupt(folder: Path, name: str, delay: float, number: int) -> None:
    """Send a signal to the process group of a command after `delay` s, and check how the command ends."""
    write_log(folder, six_position_rows(3.0))
    SiteFolder(folder).write(speed=20.0)
    with start(folder, COMMANDS[name](folder)) as process:
        time.sleep(delay)
        if process.poll() is not None:
            pytest.skip("the command has already ended")
        sent = time.monotonic()
        os.killpg(process.pid, number)
        try:
            _, errors = process.communicate(timeout=60.0)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    assert "Traceback" not in errors
    if process.returncode in (0, 1):
        assert float(errors.split()[-1]) < sent + 0.05  # only Python itself had not ended yet
        return
    assert process.returncode == 4, errors
    for written in (*folder.glob("*imported.h5"), *folder.glob("*exported.csv")):  # complete, or nothing
        assert open_log(written).facts() == open_log(folder / "log.csv").facts()
    for log in (folder / "runs").glob("*.h5"):
        outcome = json.loads(log.with_suffix(".json").read_text(encoding="utf-8"))["outcome"]
        assert (outcome, open_log(log).outcome) == ("stopped", "stopped")


@pytest.mark.parametrize(
    ("name", "delay", "number"),
    [
        ("import", 0.0, signal.SIGINT),
        ("check", 0.4, signal.SIGTERM),
        pytest.param("resolve", 2.0, signal.SIGINT, marks=pytest.mark.long),
        pytest.param("study", 3.0, signal.SIGINT, marks=pytest.mark.long),
        pytest.param("watch", 3.0, signal.SIGHUP, marks=pytest.mark.long),
    ],
)
def test_signal_stops_a_command_with_exit_code_4(tmp_path: Path, name: str, delay: float, number: int) -> None:
    interrupt(tmp_path, name, delay, number)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(200))
def test_signal_at_a_random_moment_stops_a_command(tmp_path: Path, seed: int) -> None:
    rng = random.Random(seed)
    name = [*COMMANDS][seed % len(COMMANDS)]
    number = rng.choice((signal.SIGINT, signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT))
    interrupt(tmp_path, name, rng.uniform(0.0, LATEST.get(name, 4.0)), number)


def test_interruption_that_python_ignored_starts_no_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "_interruptions", [SimpleNamespace(received=True)])
    monkeypatch.setattr(Engine, "start", lambda *_: pytest.fail("a run was started"))
    with pytest.raises(KeyboardInterrupt):
        next(engine_events(SiteFolder(tmp_path).request()))


INTERRUPTED_DESTRUCTOR = """
import os, signal, time
from calstation.cli.process import prepare

signal.signal(signal.SIGINT, signal.SIG_IGN)  # as in a process in the background

class Interrupted:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.1)

prepare().command_begins()
try:
    Interrupted()
    time.sleep(20.0)
except KeyboardInterrupt:
    print("stopped")
"""


def test_signal_that_arrives_in_a_destructor_is_not_lost() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED_DESTRUCTOR], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "stopped\n", "")


def ended(
    folder: Path, redirection: str, *arguments: object, limit: str = "unlimited"
) -> "subprocess.CompletedProcess[str]":
    """Run a command with a redirection of a shell and a limit for the size of files, kB."""
    command = shlex.join([sys.executable, "-m", "calstation", *map(str, arguments)])
    line = f"ulimit -f {limit}; {command} {redirection}"
    return subprocess.run(["bash", "-c", line], capture_output=True, text=True, cwd=folder, check=False)


@pytest.mark.parametrize("redirection", ["2>&-", "2>/dev/full", "0<&- 1>&- 2>&-"])
def test_error_that_cannot_be_shown_does_not_change_the_exit_code(tmp_path: Path, redirection: str) -> None:
    assert ended(tmp_path, redirection, "nonsense").returncode == 2


@pytest.mark.parametrize(("redirection", "reason"), [(">/dev/full", "the disk is full"), (">&-", "cannot be written")])
def test_output_that_cannot_be_written_is_an_error(tmp_path: Path, redirection: str, reason: str) -> None:
    done = ended(tmp_path, redirection, "--help")
    assert done.returncode == 2
    assert "Standard output" in done.stderr
    assert reason in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.long
def test_output_that_its_reader_closed_is_no_error_of_python(tmp_path: Path) -> None:
    append_audit(tmp_path, "pin_set", "")
    for arguments in (["audit", "--file", audit_path(tmp_path)], ["--help"]):
        done = ended(tmp_path, "| true; exit ${PIPESTATUS[0]}", *arguments)
        assert (done.returncode, done.stderr) == (2, "")


@pytest.mark.long
@pytest.mark.parametrize(
    "redirection", sampled(4, ["--json - >/dev/full", "--json - >&-", "2>&-", ">/dev/full 2>/dev/full"])
)
def test_exit_code_of_a_run_is_its_verdict_whatever_becomes_of_its_output(tmp_path: Path, redirection: str) -> None:
    SiteFolder(tmp_path)
    done = ended(tmp_path, redirection, *COMMANDS["run"](tmp_path))
    assert done.returncode == 0, done.stderr
    (result,) = (tmp_path / "runs").glob("SN-*.json")
    assert json.loads(result.read_text(encoding="utf-8"))["passed"]
    assert ("Standard output" in done.stderr) == ("2>" not in redirection)


@pytest.mark.long
@pytest.mark.parametrize("limit", sampled(2, ["3", "300", "1000", "1100", "1300"]))
def test_import_beyond_the_largest_size_of_a_file_leaves_nothing(tmp_path: Path, limit: str) -> None:
    write_log(tmp_path, six_position_rows())
    done = ended(tmp_path, "", "import", "log.csv", "-o", "out.h5", limit=limit)
    assert (done.returncode, (tmp_path / "out.h5").exists()) == (2, False)
    assert len(done.stderr.splitlines()) == 1
    assert "the largest permitted size of a file is reached" in done.stderr
