"""The wall clock of all processes is set forward and back by days during a run."""

import shutil
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from calstation.errors import ConfigurationError
from calstation.records import open_log
from calstation.registers import journal as register_journal
from calstation.results import History
from calstation.runs import Engine, finish_incomplete
from calstation.runs.incomplete import close_incomplete
from calstation.sequencer import Event, Finalized, StepStarted
from tests.faults.conftest import SERIAL, FaultRuns
from tests.helpers import raises_code, sampled

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        not sys.platform.startswith("linux") or shutil.which("cc") is None,
        reason="needs a C compiler and ld.so",
    ),
]

DAYS = timedelta(days=3)


class WallClock:
    """The wall clock of processes that are started from now on."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def step(self, by: timedelta) -> None:
        """Set the clock."""
        self._file.write_text(str(round(by.total_seconds())), encoding="ascii")


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    built = tmp_path_factory.mktemp("clock") / "wall_clock.so"
    source = Path(__file__).with_name("wall_clock.c")
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", str(built), str(source)], check=True)
    return built


@pytest.fixture
def wall_clock(library: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> WallClock:
    monkeypatch.setenv("LD_PRELOAD", str(library))
    monkeypatch.setenv("WALL_CLOCK_OFFSET", str(tmp_path / "offset"))
    return WallClock(tmp_path / "offset")


@pytest.mark.parametrize("by", sampled(2, [DAYS, -DAYS]), ids=["forward", "back"])
def test_setting_the_wall_clock_does_not_change_a_run(
    fault_runs: FaultRuns, wall_clock: WallClock, by: timedelta
) -> None:
    runs = fault_runs.folder / "runs"
    begun = datetime.now(UTC)
    steps = 0
    last: Event | None = None
    with Engine.start(fault_runs.request()) as engine:
        for event in engine.events():
            last = event
            if not isinstance(event, StepStarted) or not event.stage:
                continue
            steps += 1
            if steps == 3:
                wall_clock.step(by)
            elif steps == 5:
                (log,) = runs.glob("*.h5")
                assert finish_incomplete(runs) == [], "it does not count as dead"
                assert History(runs).refresh() == 0
                with raises_code(ConfigurationError, "run.still_running"):
                    close_incomplete(log)
    assert isinstance(last, Finalized)
    result = last.result
    assert last.verdict.passed, [check for check in result["checks"] if not check["passed"]]
    assert result["log"]["gaps"] == 0
    assert 0.0 < result["duration_s"] < 600.0
    seq = np.concatenate([block.seq for block in open_log(log).blocks()])
    assert (np.diff(seq) == 1).all()
    (entry,) = register_journal.history(runs, SERIAL)
    assert entry.closing == "done"
    hour = timedelta(hours=1)
    assert abs(datetime.fromisoformat(result["started_utc"]) - begun) < hour
    assert abs(datetime.fromisoformat(entry.utc) - begun - by) < hour, "the clock was set: labels follow it"


@pytest.mark.exhaustive
@pytest.mark.parametrize("by", sampled(2, [-DAYS, DAYS]), ids=["back", "forward"])
def test_killed_run_is_recognised_immediately(fault_runs: FaultRuns, wall_clock: WallClock, by: timedelta) -> None:
    with Engine.start(fault_runs.request()) as engine:
        for event in engine.events():
            if isinstance(event, StepStarted) and event.stage:
                wall_clock.step(by)
                break
        engine.process.kill()
        engine.process.join(30.0)
    (log,) = (fault_runs.folder / "runs").glob("*.h5")
    assert finish_incomplete(log.parent) == [log]
