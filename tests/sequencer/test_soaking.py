"""Soaks and ramps with a fake chamber: the unit's own temperature ends a soak, and the chamber returns to ambient."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calstation.errors import ConfigurationError
from calstation.estimation.common import join_blocks
from calstation.estimation.navigation.temperature_stage import temperature_parts
from calstation.messages import Text
from calstation.sequencer import (
    ChamberChanged,
    ChamberControl,
    ChamberLimits,
    Command,
    Message,
    PointCompleted,
    StageEnded,
    StagePlan,
    StageProgress,
    State,
    StepStarted,
    StopRule,
)
from calstation.sequencer.events import from_json, to_json
from calstation.sequencer.soaking import verification_temperature
from procedures.temperature import Schedule, plan
from tests.helpers import raises_code
from tests.sequencer.fake_chamber import FakeChamber
from tests.sequencer.fakes import GEOMETRY, FakeClock, Scene, verdict
from tests.sequencer.test_sequencer_batch import Batch

MOVES = [(0.0, 0.0, 3.0), (90.0, 0.0, 3.0), (0.0, 0.0, 3.0)]
SOAK = {"unit_rate_below_c_per_min": 0.2, "hold_s": 20.0, "at_most_s": 3600.0}
LIMITS = ChamberLimits({"chamber": (-70.0, 180.0)}, max_rate=0.5, ambient=23.0, dew_point=15.0)


def stage(points: list[float], soak: Any = None, ramp: float | None = None) -> StagePlan:
    """The stage temperature with short moves."""
    schedule = Schedule(
        points_c=points,
        ramp_c_per_min=ramp,
        soak={**SOAK, **(soak or {})},
        moves=MOVES,
        rate_dps=50.0,
        acceleration_dps2=50.0,
    )
    return StagePlan("temperature", lambda: plan(GEOMETRY, schedule), StopRule(rounds=len(points), repeated=True))


@pytest.mark.parametrize(
    ("visited", "temperature"),
    [([26.0, 18.0, 34.0], 23.0), ([21.0, -44.0, 81.0, 21.0], 41.0), ([25.0, 85.0, 25.0], 45.0), ([25.0, 30.0], 23.0)],
    ids=["ambient", "between", "not below all", "no other one"],
)
def test_registers_are_verified_near_ambient_but_not_at_the_last_temperature(
    visited: list[float], temperature: float
) -> None:
    """The chamber returns to ambient afterwards, and a way over the whole range takes half an hour."""
    assert verification_temperature(visited, 23.0) == temperature


class Thermal(Scene):
    """A scene with a chamber and the stage temperature."""

    def __init__(self, points: list[float], soak: Any = None, *, ramp: float | None = None, **chamber: Any) -> None:
        super().__init__(stage(points, soak, ramp))
        self.task = replace(self.task, chamber=LIMITS)
        self.passes = False
        self.chamber = self.imu.chamber = FakeChamber(self.clock.now, **{"rate": 0.5, "lag": 60.0, **chamber})

    def steps(self, kind: str) -> list[StepStarted]:
        return [event for event in self.events_of(StepStarted) if event.kind == kind]

    def messages(self) -> list[str]:
        return [event.id for event in self.events_of(Message)]

    def when(self, kind: str, delay: float, *commands: Command) -> None:
        """Send commands some time after the first step of a kind, one second apart."""

        def watch(event: Any, append: Any = self.events.append) -> None:
            append(event)
            if isinstance(event, StepStarted) and event.kind == kind and not hasattr(self, "armed"):
                self.armed = True
                for k, command in enumerate(commands):
                    self.clock.at(self.clock.time + delay + k, lambda c=command: self.control.send(c))

        self.events = Watched(watch)


class Watched(list):  # type: ignore[type-arg]
    """A list that passes what is appended to a function."""

    def __init__(self, watch: Any) -> None:
        super().__init__()
        self._watch = watch

    def append(self, event: Any) -> None:
        self._watch(event, super().append)


@pytest.fixture(autouse=True)
def tick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeClock, "tick", 1.0)


def test_every_point_is_soaked_by_the_unit_and_moved_then_the_chamber_returns() -> None:
    scene = Thermal([40.0, 10.0])
    scene.run()
    assert [step.label for step in scene.steps("soak")] == [("soak", 40.0, 1.0, 2.0), ("soak", 10.0, 2.0, 2.0)]
    points = scene.events_of(PointCompleted)
    assert [(point.index, point.temperature) for point in points] == [(1, 40.0), (2, 10.0)]
    block = join_blocks(scene.solving.blocks["temperature"])
    parts = temperature_parts(block, 20.0, len(MOVES))
    assert len(parts) == 2
    for (start, stop), target in zip(parts, (40.0, 10.0), strict=True):
        slope = (block.temperature[stop - 1] - block.temperature[start]) / (block.time[stop - 1] - block.time[start])
        assert abs(60.0 * slope) < 0.2
        assert block.temperature[start] == pytest.approx(target, abs=0.5)
        assert len(np.unique(block.step[start:stop])) == 1 + len(MOVES)
    assert [point.step for point in points] == [int(block.step[stop - 1]) for _, stop in parts]
    assert scene.messages()[-2:] == ["chamber_to_ambient", "chamber_may_be_opened"]
    assert scene.chamber.unit == pytest.approx(20.0, abs=8.0)
    assert not scene.chamber.running
    assert scene.table.commands[-1] == "disable"
    assert scene.events_of(StageEnded)[0].reason == "rounds"


def test_a_soak_reports_its_time_left() -> None:
    scene = Thermal([60.0])
    scene.run()
    left = [event.remaining for event in scene.events_of(StageProgress)]
    assert max(left) < 3700.0
    assert left[-1] == pytest.approx(0.0, abs=1.0)
    fractions = [event.fraction for event in scene.events_of(StageProgress)]
    assert fractions[-1] == pytest.approx(1.0)


def test_a_soak_reports_the_rate_of_the_unit_its_limit_and_its_own_time_left() -> None:
    scene = Thermal([60.0])
    scene.run()
    changes = scene.events_of(ChamberChanged)
    soak = [event for event in changes if event.limit is not None]
    assert {event.limit for event in soak} == {0.2}
    rates = [event.rates[""] for event in soak if event.rates]
    assert max(rates) > 0.5
    assert rates[-1] <= 0.25
    assert soak[-1].remaining < 60.0
    assert soak[0].time < soak[-1].time
    assert changes[-1].limit is None  # the chamber returns to ambient
    assert {event.open_c for event in changes} == {(15.0, 43.0)}
    assert from_json(to_json(soak[-1])) == soak[-1]


def test_moves_are_repeated_during_a_ramp() -> None:
    scene = Thermal([30.0, 40.0, 30.0], ramp=5.0)
    scene.run()
    assert [step.label for step in scene.steps("ramp")] == [("ramp", 40.0, 5.0), ("ramp", 30.0, 5.0)]
    block = join_blocks(scene.solving.blocks["temperature"])
    parts = temperature_parts(block, 20.0, len(MOVES), is_ramp=True)
    means = [float(block.temperature[a:b].mean()) for a, b in parts]
    assert len(parts) > 10
    assert max(means) == pytest.approx(40.0, abs=1.0)
    assert min(np.diff(sorted(means))) < 2.0
    assert len(scene.events_of(PointCompleted)) == 3


def test_stop_in_a_soak_rests_the_table_at_once_and_returns_to_ambient() -> None:
    scene = Thermal([-30.0])
    scene.when("soak", 100.0, Command.STOP)
    assert scene.run().state is State.STOPPED
    assert scene.table.commands[-2:] == ["stop", "disable"]
    assert "chamber_returning" in scene.messages()
    assert scene.messages()[-1] == "chamber_may_be_opened"
    assert scene.chamber.goal == 23.0
    assert scene.chamber.unit >= 15.0
    states = [event.state for event in scene.events if hasattr(event, "previous")]
    assert states[-2:] == ["stopping", "stopped"]


def test_a_fault_is_shown_before_the_chamber_has_returned() -> None:
    scene = Thermal([40.0], {"at_most_s": 60.0})
    ended = scene.run()
    assert ended.error is not None
    assert ended.error.code == "temperature.not_steady"
    kinds = [getattr(event, "id", type(event).__name__) for event in scene.events]
    assert kinds.index("Fault") < kinds.index("chamber_may_be_opened")
    assert not scene.chamber.running


def test_a_chamber_that_is_too_slow_is_the_cause_and_not_the_unit() -> None:
    scene = Thermal([80.0], {"at_most_s": 60.0})
    ended = scene.run()
    assert ended.error is not None
    assert ended.error.code == "temperature.not_reached"


def test_a_stuck_sensor_of_the_unit_is_a_fault() -> None:
    scene = Thermal([60.0])
    scene.imu.chamber = None
    ended = scene.run()
    assert ended.error is not None
    assert ended.error.code == "chamber.sensors_disagree"


def test_a_pause_repeats_the_soak_and_keeps_the_temperature() -> None:
    scene = Thermal([40.0])
    scene.when("soak", 60.0, Command.PAUSE, Command.RESUME)
    scene.run()
    assert [step.label[1] for step in scene.steps("soak")] == [40.0, 40.0]
    assert ("set_point", 40.0) in scene.chamber.commands
    block = join_blocks(scene.solving.blocks["temperature"])
    assert len(temperature_parts(block, 20.0, len(MOVES))) == 1


def test_lost_samples_in_a_soak_do_not_repeat_it_and_a_silent_unit_does() -> None:
    scene = Thermal([40.0])
    scene.when("soak", 30.0)
    for moment in range(40, 200, 30):
        scene.clock.at(float(moment), lambda: setattr(scene.imu, "drop", 3))
    scene.run()
    assert len(scene.steps("soak")) == 1
    assert "step_repeated" not in scene.messages()

    scene = Thermal([40.0])
    scene.clock.at(60.0, lambda: setattr(scene.imu, "silent", True))
    scene.clock.at(70.0, lambda: setattr(scene.imu, "silent", False))
    scene.run()
    assert len(scene.steps("soak")) == 2


def test_the_operator_can_end_the_stage_in_a_soak() -> None:
    scene = Thermal([40.0, 10.0])
    scene.when("soak", 30.0, Command.END_STAGE)
    scene.run()
    assert scene.events_of(StageEnded)[0].reason == "operator"
    assert scene.events_of(PointCompleted) == []


def test_temperatures_outside_the_range_are_refused_before_the_table_moves() -> None:
    scene = Thermal([200.0])
    ended = scene.run()
    assert ended.error is not None
    assert ended.error.code == "chamber.target_outside"
    assert not [command for command in scene.table.commands if command.startswith("move")]


def test_a_resumed_stage_continues_with_the_next_point() -> None:
    scene = Thermal([40.0, 10.0])
    (stage,) = scene.task.stages
    scene.task = replace(scene.task, stages=(stage.after(1),))
    scene.solving.start("temperature")
    scene.run()
    assert [step.label[1] for step in scene.steps("soak")] == [10.0]
    assert [point.index for point in scene.events_of(PointCompleted)] == [2]


def test_schedules_without_temperatures_or_with_moves_like_soaks_are_refused() -> None:
    with raises_code(ConfigurationError, "temperature.no_points"):
        list(plan(GEOMETRY, Schedule()))
    with pytest.raises(ValueError, match="hold_s"):
        Schedule(moves=[(0.0, 0.0, 60.0), (90.0, 0.0, 1.0)])
    with pytest.raises(ValueError, match="hold_s"):
        Schedule(moves=[(0.0, 0.0, 1.0), (90.0, 0.0, 1.0)], rate_dps=1.5)


def test_verdict_follows_the_return_of_the_chamber() -> None:
    scene = Thermal([40.0])
    scene.passes, scene.writes = True, False
    assert verdict(scene.run()) == "passed"
    assert not scene.chamber.running


def test_the_temperature_of_the_chamber_is_recorded() -> None:
    scene = Thermal([40.0])
    scene.run()
    block = join_blocks(scene.solving.blocks["temperature"])
    air = block.chamber[~np.isnan(block.chamber)]
    assert air[-1] == pytest.approx(40.0, abs=1.0)
    assert len(air) > 100


@pytest.mark.long
def test_all_units_of_a_batch_must_be_steady_and_one_that_is_not_leaves() -> None:
    batch = Batch(2, stage([40.0], {"at_most_s": 900.0}))
    batch.task = replace(batch.task, chamber=LIMITS)
    batch.chamber = FakeChamber(batch.clock.now, rate=0.5, lag=60.0)
    steady, drifting = batch.units
    steady.imu.chamber = batch.chamber
    drifting.imu.chamber = Drifting(batch.clock)
    batch.run()
    soaked = next(event for event in batch.of(Message) if event.id == "soaked")
    assert soaked.values["minutes"] == pytest.approx(15.0, abs=0.2)
    (ended,) = drifting.ends
    assert ended.error is not None
    assert ended.error.code == "temperature.not_steady"
    assert steady.ends[0].state is State.DONE
    assert len(batch.of(PointCompleted)) == 1


@pytest.mark.long
def test_chamber_waits_for_units_whose_results_are_complete() -> None:
    """Units of a batch leave the run with their results, and still show in the chamber when it may be opened."""
    batch = Batch(2, stage([60.0]))
    batch.task = replace(batch.task, chamber=LIMITS)
    batch.chamber = FakeChamber(batch.clock.now, rate=0.5, lag=300.0)
    for unit in batch.units:
        unit.imu.chamber, unit.passes = batch.chamber, False
    batch.run()
    assert [unit.ends[0].state for unit in batch.units] == [State.DONE, State.DONE]
    returning = [event.values for event in batch.of(Message) if event.id == "chamber_returning"]
    assert returning[1]["unit_c"] > returning[1]["air_c"] + 15.0
    assert len(returning) < 10, "without temperatures, the chamber stays closed for half an hour at ambient"
    opened = next(event.values for event in batch.of(Message) if event.id == "chamber_may_be_opened")
    assert 40.0 < opened["unit_c"] <= 43.0


class Drifting:
    """A unit whose temperature rises by 0.6 K/min."""

    def __init__(self, clock: FakeClock) -> None:
        self._clock = clock

    @property
    def unit(self) -> float:
        return 35.0 + 0.01 * self._clock.now()


def wait_until(condition: Callable[[], bool]) -> None:
    """Wait for at most 5 s of host time."""
    deadline = time.monotonic() + 5.0
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.001)


def test_a_fault_of_the_chamber_while_registers_are_written_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeClock, "idle", lambda clock, _: clock.sleep(1.0))
    scene = Thermal([40.0])
    scene.passes = True

    def transfer(run_in_background: Any) -> None:
        scene.chamber.alarm = "compressor"
        begin = scene.clock.now()
        run_in_background(lambda: wait_until(lambda: scene.clock.now() > begin + 10.0))

    scene.transfer = transfer  # type: ignore[method-assign]
    ended = scene.run()
    assert ended.error is not None
    assert ended.error.code == "chamber.alarm"
    assert scene.chamber.goal == 23.0


@pytest.mark.parametrize("where", ["judge", "safe_stop", "drain"])
def test_the_chamber_returns_to_ambient_after_a_programming_error(where: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Thermal([60.0])

    def fail(*_: Any) -> Any:
        raise RuntimeError(where)

    if where == "safe_stop":
        monkeypatch.setattr("calstation.sequencer.driving.safe_stop", fail)
        scene.when("soak", 100.0, Command.STOP)
    elif where == "drain":
        scene.clock.at(100.0, lambda: monkeypatch.setattr("calstation.sequencer.units.Unit.drain", fail))
    else:
        scene.judge = fail  # type: ignore[method-assign]
    with pytest.raises(RuntimeError, match=where):
        scene.run()
    assert ("set_point", 60.0) in scene.chamber.commands
    assert scene.chamber.goal == 23.0
    assert not scene.chamber.running
    assert scene.messages()[-1] == "chamber_may_be_opened"


def test_a_table_that_may_still_move_is_reported_before_the_chamber_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Thermal([60.0])
    scene.when("soak", 100.0, Command.STOP)
    monkeypatch.setattr("calstation.sequencer.driving.safe_stop", lambda *_: [Text("link.lost")])
    safe, known = ChamberControl.safe, list[list[str]]()
    monkeypatch.setattr(ChamberControl, "safe", lambda control: (known.append(scene.messages()), safe(control))[1])
    scene.run()
    assert "safe_stop_incomplete" in known[0]
