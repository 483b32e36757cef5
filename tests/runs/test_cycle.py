"""The phases of a run from start to result: complete, in order, by the station clock."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from calstation.errors import DeviceFaultError
from calstation.records import open_log
from calstation.results import SCHEMA, Result, load_result
from calstation.runs.cycle import Cycle
from calstation.sequencer import Command, Event, Finalized, StageEnded, StageSolved, State, StateChanged, StepStarted
from tests.sequencer.fakes import FakeClock, Scene
from tests.shared_runs import SharedRuns

RESULT: dict[str, Any] = {
    "schema": SCHEMA,
    "unit": {"serial": "SN-1"},
    "stages": [],
    "outcome": "passed",
    "parameters": {},
    "log": {"file": "log.h5"},
}


def measured(scene: Scene, watch: Callable[[Event], None] = lambda event: None) -> Result:
    """Return the result of a run with fake devices, with only its cycle."""
    cycle = Cycle()

    class Events(list[Event]):
        def append(self, event: Event) -> None:
            super().append(event)
            cycle.follow(event)
            watch(event)

    scene.events = Events()
    with cycle.using(scene.clock):
        scene.run()
        phases = cycle.phases()
    return Result.from_json({**RESULT, "cycle": [phase.model_dump() for phase in phases]})


def test_phases_of_a_run_are_contiguous_and_add_up_to_its_duration() -> None:
    scene = Scene(warm_up=30.0)
    begin = time.monotonic()
    result = measured(scene)
    host = time.monotonic() - begin
    names = [(phase.phase, phase.stage) for phase in result.cycle]
    assert names == [
        ("opening", ""),
        ("preparation", ""),
        ("warm_up", ""),
        ("stage", "rate"),
        ("solving", "rate"),
        ("files", ""),
        ("proof", ""),  # before the registers are written
        ("proof", ""),
        ("unloading", ""),
        ("files", ""),
    ]
    total = sum(result.cycle_seconds.values())
    assert scene.clock.time - 1e-6 <= total <= scene.clock.time + host
    steps = [e["station_time"] for e in scene.journal.events if e["event"] in ("StageStarted", "StageEnded")]
    assert result.cycle_seconds["stage"] == pytest.approx(steps[1] - steps[0], abs=host)


def test_solving_phase_ends_when_the_last_unit_of_a_batch_is_solved() -> None:
    cycle, clock = Cycle(), FakeClock()
    with cycle.using(clock):
        cycle.follow(StageEnded("rate", "plan", 0))
        for slot in ("A", "B", "C"):
            clock.time += 10.0
            cycle.follow(StageSolved("rate", {}, {}, slot=slot))
        clock.time += 1.0
        cycle.follow(StateChanged(State.DONE, State.RUNNING))
        phases = [(phase.phase, phase.stage) for phase in cycle.phases()]
        seconds = [phase.seconds for phase in cycle.phases()]
    assert phases[1:] == [("solving", "rate"), ("files", ""), ("files", "")]
    assert seconds[1:3] == pytest.approx([30.0, 1.0], abs=0.5)


def test_pause_is_a_separate_phase_and_the_stage_continues_after_it() -> None:
    scene = Scene()

    def watch(event: Event) -> None:
        if isinstance(event, StepStarted) and event.stage and not hasattr(scene, "asked"):
            scene.asked = True  # type: ignore[attr-defined]
            scene.control.send(Command.PAUSE)
        elif isinstance(event, StateChanged) and event.state == State.PAUSED:
            scene.clock.at(scene.clock.time + 100.0, lambda: scene.control.send(Command.RESUME))

    result = measured(scene, watch)
    pause = [(phase.phase, phase.stage) for phase in result.cycle].index(("pause", ""))
    before, paused, after = result.cycle[pause - 1 : pause + 2]
    assert (before.phase, before.stage) == (after.phase, after.stage) == ("stage", "rate")
    assert 100.0 <= paused.seconds <= 100.0 + 10 * FakeClock.tick
    assert sum(result.cycle_seconds.values()) == pytest.approx(scene.clock.time, abs=5.0)


def test_safe_stop_is_a_separate_phase() -> None:
    scene = Scene()

    def watch(event: Event) -> None:
        if isinstance(event, StepStarted) and event.stage:
            scene.control.send(Command.STOP)

    phases = [phase.phase for phase in measured(scene, watch).cycle]
    assert phases[-3:] == ["stage", "stopping", "files"]


def test_terminated_bench_does_not_prevent_the_result() -> None:
    class DeadClock(FakeClock):
        def now(self) -> float:
            if self.time > 5.0:
                raise DeviceFaultError("connection.bench_ended")
            return super().now()

    cycle, clock = Cycle(), DeadClock()
    with cycle.using(clock):
        clock.time = 4.0
        cycle.follow(StateChanged(State.PREPARING, State.IDLE))
        clock.time = 9.0
        cycle.follow(StateChanged(State.FAULT, State.PREPARING))
    seconds = {phase.phase: phase.seconds for phase in cycle.phases()}
    assert seconds["opening"] == pytest.approx(4.0, abs=1.0)
    assert seconds["preparation"] < 1.0


def test_full_run_measures_every_phase_in_device_time(tmp_path: Path, shared_runs: SharedRuns) -> None:
    ended: Finalized = shared_runs.passed(tmp_path)
    result = load_result(Path(ended.result_file))
    seconds = result.cycle_seconds
    assert {"opening", "preparation", "stage", "solving", "files", "transfer", "proof", "unloading"} <= set(seconds)
    assert [p.stage for p in result.cycle if p.phase == "stage"] == result.stages
    assert [p.stage for p in result.cycle if p.phase == "solving"] == result.stages
    times = {
        (entry["event"], entry.get("state", entry.get("stage"))): entry["station_time"]
        for entry in open_log(Path(ended.log)).events
        if entry["event"] in ("StateChanged", "StageStarted", "StageEnded")
    }
    events = [entry for entry in open_log(Path(ended.log)).events if entry["event"] != "OldRegisters"]
    assert all("utc" in entry for entry in events)
    untimed = {entry.get("id", entry["event"]) for entry in events if "station_time" not in entry}
    assert not untimed & {"registers_reading", "registers_transfer", "registers_written"}, untimed
    for phase in result.cycle:
        if phase.phase == "stage":
            driven = times["StageEnded", phase.stage] - times["StageStarted", phase.stage]
            assert phase.seconds == pytest.approx(driven, rel=0.02, abs=0.5)
    device = times["StateChanged", "done"] - times["StateChanged", "preparing"]
    of_host = ("opening", "resuming", "solving", "files", "transfer")
    assert sum(s for name, s in seconds.items() if name not in of_host) == pytest.approx(device, rel=0.01, abs=1.0)


def test_result_of_an_earlier_version_has_no_phases(tmp_path: Path, shared_runs: SharedRuns) -> None:
    data = json.loads(Path(shared_runs.passed(tmp_path).result_file).read_text(encoding="utf-8"))
    del data["cycle"]
    result = Result.from_json(data)
    assert (result.cycle, result.cycle_seconds) == ([], {})
    assert "cycle" not in result.to_json()
