"""Every signal that can be caught stops a run safely, with a result and the exit code of a stop."""

import json
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from calstation.jobs import STOP_SIGNALS, deferred_signals, on_stop_signals
from tests.site_folder import SiteFolder

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no POSIX signals")


#: The command, which says when its own code begins: before, Python itself ends.
_COMMAND = """
import sys
from calstation.cli import main
print("begun", file=sys.stderr, flush=True)
main()
"""


def started(site: SiteFolder, result: Path) -> subprocess.Popen[str]:
    """Start a run as a command, as the leader of a process group like that of a terminal."""
    command = [
        sys.executable,
        "-c",
        _COMMAND,
        "run",
        "--serial",
        "SN-000042",
        "--station",
        str(site.station),
        "--yes",
    ]
    command += ["--product", str(site.product), "--out", str(site.runs), "--json", str(result)]
    environment = {**os.environ, "COLUMNS": "200"}
    default = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # a test in the background ignores Ctrl-C
    return subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, env=environment, process_group=0, preexec_fn=default
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "group"),
    [
        ("SIGTERM", False),
        ("SIGQUIT", True),
        ("SIGINT", True),
        pytest.param("SIGHUP", True, marks=pytest.mark.exhaustive),
        pytest.param("SIGQUIT", False, marks=pytest.mark.exhaustive),
        pytest.param("SIGUSR1", True, marks=pytest.mark.exhaustive),
    ],
)
def test_signal_stops_a_run_safely_and_the_command_waits_for_it(tmp_path: Path, name: str, group: bool) -> None:
    site, result = SiteFolder(tmp_path), tmp_path / "result.json"
    site.write(speed=20.0)
    with started(site, result) as process:
        assert process.stderr is not None
        until_motion(process)
        (os.killpg if group else os.kill)(process.pid, getattr(signal, name))
        process.stderr.read()
        assert process.wait(60.0) == 4
    stored = json.loads(result.read_text(encoding="utf-8"))
    assert stored["outcome"] == "stopped"


@pytest.mark.long
@pytest.mark.parametrize("delay", [0.2, 0.7, 1.2, 1.7, 2.2, 3.0])
def test_ctrl_c_during_the_start_of_a_run_is_not_lost(tmp_path: Path, delay: float) -> None:
    site = SiteFolder(tmp_path)
    site.write(speed=5.0)
    with started(site, tmp_path / "result.json") as process:
        assert process.stderr is not None
        assert process.stderr.readline() == "begun\n"
        time.sleep(delay)
        os.killpg(process.pid, signal.SIGINT)
        begin = time.monotonic()
        assert process.wait(60.0) in (4, 130)
        assert time.monotonic() - begin < 30.0


def until_motion(process: "subprocess.Popen[str]") -> None:
    """Wait until the first stage of a run moves the table."""
    assert process.stderr is not None
    for line in process.stderr:
        if "Rate runs" in line or "rate" in line.lower():
            time.sleep(1.0)
            return
    raise AssertionError("the run ended before a motion")


def test_ctrl_c_while_a_child_process_starts_is_deferred() -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a test in the background ignores Ctrl-C
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012
        with deferred_signals():
            os.kill(os.getpid(), signal.SIGINT)
            reached = True
        raise AssertionError("not interrupted")
    assert reached


def test_handlers_are_restored() -> None:
    before = [signal.getsignal(number) for number in STOP_SIGNALS]
    calls: list[int] = []
    with on_stop_signals(lambda: calls.append(1)):
        for number in STOP_SIGNALS:
            os.kill(os.getpid(), number)
    assert len(calls) == len(STOP_SIGNALS)
    assert [signal.getsignal(number) for number in STOP_SIGNALS] == before
