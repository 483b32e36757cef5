"""Faults of the computer during a run: full disk, removed folder, killed engine and window."""

import json
import os
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.records import open_log
from calstation.runs import Engine, finish_incomplete
from calstation.sequencer import Event, Fault, Finalized, Message, StageEnded, StepStarted
from calstation.simulation.fault_plan import FaultPlan, load_fault_plan
from tests.faults.conftest import FaultRuns, fault
from tests.helpers import raises_code

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals, limits and open files"),
]


@pytest.mark.parametrize(
    ("kind", "words", "ends"),
    [
        ("disk_full", "The disk is nearly full, less than 32 MB are left. Make room", "fault"),
        ("runs_folder_gone", "cannot be written any more (no such file or folder). Make room", None),
    ],
)
def test_full_disk_is_a_fault_and_recorded_samples_are_kept(
    fault_runs: FaultRuns, kind: str, words: str, ends: str | None
) -> None:
    events: list[Event] = []
    with Engine.start(fault_runs.request(fault(kind, step=4))) as engine:
        events += engine.events()
    (emitted,) = [event for event in events if isinstance(event, Fault)]
    assert words in emitted.text
    assert isinstance(events[-1], Finalized)
    assert events[-1].verdict == "fault"
    report = json.loads((fault_runs.folder / "bench.json").read_text(encoding="utf-8"))
    assert not report["enabled"]
    assert not report["moving"]
    (path,) = fault_runs.folder.glob("runs*/*.h5")
    log = open_log(path)
    assert log.outcome == ends
    assert sum(len(block) for block in log.blocks() if block.stage == "rate") > 200


def test_disk_slower_than_the_watchdog_does_not_stop_the_run(
    fault_runs: FaultRuns, monkeypatch: pytest.MonkeyPatch
) -> None:
    fsync, slow = os.fsync, [0]

    def wait(handle: int) -> None:
        if 0 < slow[0] <= 4:
            slow[0] += 1
            time.sleep(2.5)
        fsync(handle)

    def on_event(event: Event) -> None:
        if isinstance(event, StageEnded | Message) and getattr(event, "id", "") in ("", "registers_transfer"):
            slow[0] = 1

    monkeypatch.setattr(os, "fsync", wait)
    ran = fault_runs.run(on_event=on_event, watchdog_ms=2000)
    assert slow[0] == 5
    assert ran.ended.verdict.passed, ran.ended.result["error"]
    assert ran.ended.result["registers"]["verified"] is True


@pytest.mark.long
def test_killed_engine_leaves_an_incomplete_run_and_a_stopped_table(fault_runs: FaultRuns) -> None:
    with Engine.start(fault_runs.request(fault("engine_killed", step=4), watchdog_ms=1000)) as engine:
        events = engine.events()
        with raises_code(DeviceFaultError, "run.engine_ended"):
            list(events)
    (path,) = (fault_runs.folder / "runs").glob("*.h5")
    assert finish_incomplete(path.parent) == [path]
    result = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    assert (result["outcome"], result["passed"]) == ("incomplete", False)
    assert sum(len(block) for block in open_log(path).blocks()) > 200
    left = final_bench_report(fault_runs)
    assert (left["enabled"], left["moving"], left["fault"]) == (False, False, "WATCHDOG"), "the table stops itself"


def final_bench_report(fault_runs: FaultRuns) -> dict[str, Any]:
    """Wait for the final report of a bench that outlives its engine, after its watchdog has tripped."""
    file = fault_runs.folder / "bench.json"
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        with suppress(OSError, ValueError):
            report: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
            return report
        time.sleep(0.05)
    raise AssertionError("the bench has left no word")


def test_killed_window_causes_a_safe_stop(fault_runs: FaultRuns) -> None:
    engine = Engine.start(fault_runs.request(stages=("rate", "six_position")))
    for event in engine.events():
        if isinstance(event, StepStarted) and event.stage:
            break
    engine.stop_listening()
    engine.process.join(120.0)
    report = json.loads((fault_runs.folder / "bench.json").read_text(encoding="utf-8"))
    assert not report["enabled"]
    assert not report["moving"]
    (path,) = (fault_runs.folder / "runs").glob("SN-*.json")
    assert json.loads(path.read_text(encoding="utf-8"))["outcome"] == "stopped"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            '[[fault]]\nkind = "nonsense"',
            "'nonsense' is not a kind of fault. Choose from: interlock, drive_fault, ",
        ),
        (
            '[[fault]]\nkind = "drop_frame"',
            "'drop_frame' is not a kind of fault. Did you mean 'drop_frames'?",
        ),
        ('[[fault]]\nkind = "wrong_unit"\nstage = "rate"', "exists from the start. Remove stage"),
        ('[[fault]]\nkind = "disk_full"', "needs a stage. Add stage."),
        ('[[fault]]\nkind = "stall"\nstep = 2', "A step needs its stage."),
        ('[[fault]]\nkind = "stall"\ntime_s = [5.0, 1.0]', "earliest, latest"),
    ],
)
def test_invalid_fault_plan_is_reported_with_a_remedy(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "plan.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError) as raised:
        load_fault_plan(path)
    assert str(path) in str(raised.value)
    assert words in str(raised.value)


def test_random_times_are_the_same_for_the_same_seed() -> None:
    plan = FaultPlan.model_validate({"seed": 3, "fault": [{"kind": "stall", "time_s": [1.0, 9.0]}] * 3})
    assert plan.times() == plan.times()
    assert len(set(plan.times())) == 3
    assert all(1.0 <= t <= 9.0 for t in plan.times())
    orders = plan._overrides({"orders": []}, 1)["orders"]
    assert [order["at"] for order in orders] == plan.times()
