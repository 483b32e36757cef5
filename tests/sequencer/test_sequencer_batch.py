"""Several units on one table: a failed unit is removed and the others continue; a table fault ends all."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np
import pytest

from calstation.devices import SampleBatch
from calstation.devices.profiles import StatusSection
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.estimation import Solution
from calstation.messages import Text
from calstation.physics import TableGeometry
from calstation.sequencer import (
    Command,
    Control,
    Event,
    Fault,
    LastSample,
    Message,
    Output,
    PreflightLimits,
    RunContext,
    RunEnd,
    Sequencer,
    Slot,
    StageEnded,
    StagePlan,
    StageProgress,
    StageRanked,
    StageSolved,
    StageStarted,
    State,
    StateChanged,
    StepStarted,
    StopRule,
    Task,
    Trace,
    UnitDecision,
    UnitTask,
    VerificationData,
)
from tests.sequencer.fakes import (
    GEOMETRY,
    GRAVITY,
    MODEL,
    FakeClock,
    FakeImu,
    FakeJournal,
    FakeSolving,
    FakeTable,
    Scene,
    endless,
    judged,
    quarter_turns,
    repeated,
    verdict,
)

LOST = DeviceFaultError("link.lost", device="imu", port="FAKE", reason="no answer")


class Member:
    """A fake unit of a batch, and its evaluation."""

    def __init__(self, batch: "Batch", index: int) -> None:
        self.batch, self.name = batch, f"S{index + 1}"
        self.imu = FakeImu(batch.clock, batch.table, serial=f"SN-{index + 1}")
        self.journal, self.solving = FakeJournal(), FakeSolving()
        self.unit = UnitTask(
            self.imu.serial,
            MODEL,
            PreflightLimits(r"SN-\d+", GRAVITY),
            GEOMETRY,
            StatusSection(ready=1, saturated=2, failed=4),
        )
        self.passes, self.writes = True, True
        self.goes_on = True
        self.done: list[str] = []
        self.proved: list[VerificationData] = []
        self.ends: list[RunEnd] = []

    @property
    def end(self) -> RunEnd:
        (ended,) = self.ends
        return ended

    @property
    def code(self) -> str:
        assert self.end.error is not None
        return self.end.error.code

    def slot(self) -> Slot:
        return Slot(self.imu, self.unit, self.journal, self.solving, None, self.name, self)

    will_fail = False

    def verify_earlier(self) -> None:
        return None

    def continues(self, solution: Solution) -> bool:
        return self.goes_on

    def judge(self, solutions: tuple[Solution, ...]) -> UnitDecision:
        self.done.append("judge")
        return judged(passes=self.passes, writes=self.writes)

    def read_registers(self, run_in_background: Any) -> None:
        self.done.append("read")

    def transfer(self, run_in_background: Any) -> None:
        self.batch.order.append(self.name)
        run_in_background(lambda: self.done.append("transfer"))

    def verify(self, data: VerificationData, run_in_background: Any) -> None:
        self.done.append("verify")
        self.proved.append(data)

    def ended(self, ended: RunEnd) -> None:
        self.ends.append(ended)

    def messages(self) -> list[str]:
        """Return the messages in its log."""
        return [event["id"] for event in self.journal.events if event["event"] == "Message"]

    def samples(self) -> dict[str, np.ndarray]:
        """Return all samples in its log."""
        names = ("seq", "time", "counts", "angles", "step", "valid", "temperature", "station")
        samples = {name: np.concatenate([getattr(b, name) for b in self.journal.blocks]) for name in names}
        return samples | {"stage": np.concatenate([[b.stage] * len(b) for b in self.journal.blocks])}


class Batch:
    """Fake units on one fake table."""

    def __init__(self, count: int, *stages: StagePlan) -> None:
        self.clock = FakeClock()
        self.table = FakeTable(self.clock)
        self.control = Control()
        self.task = Task(stages or (StagePlan("rate", quarter_turns),), GEOMETRY)
        self.chamber: Any = None
        self.order: list[str] = []
        self.events: list[Event] = []
        self._scripts: list[tuple[Callable[[Event], bool], float, Callable[[], Any]]] = []
        self.units = [Member(self, index) for index in range(count)]

    def on(self, kind: type[Event], delay: float, action: Callable[[], Any], ident: str = "") -> None:
        """Call `act` `delay` s after the first event of a type."""
        self._scripts.append((lambda e: isinstance(e, kind) and getattr(e, "id", "") == ident, delay, action))

    def run(self) -> State:
        """Run to the end; assert that every unit ends exactly once."""
        slots = tuple(unit.slot() for unit in self.units)
        context = RunContext(self.task, self.table, slots, self.clock, self._take, self.control, chamber=self.chamber)
        Sequencer(context).run()
        assert [len(unit.ends) for unit in self.units] == [1] * len(self.units)
        return State(self.of(StateChanged)[-1].state)

    def _take(self, event: Event) -> None:
        self.events.append(event)
        for script in list(self._scripts):
            chosen, delay, action = script
            if chosen(event):
                self._scripts.remove(script)
                self.clock.at(self.clock.time + delay, action)

    def of(self, kind: type[Event]) -> list[Any]:
        return [event for event in self.events if isinstance(event, kind)]

    def ids(self, ident: str) -> list[str]:
        """Return the slots of the messages with an id."""
        return [event.slot for event in self.of(Message) if event.id == ident]


def loses_its_port(unit: Member) -> Callable[[], None]:
    def lose() -> None:
        def read() -> Any:
            raise LOST

        unit.imu.read = read  # type: ignore[method-assign]

    return lose


def same(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> bool:
    return one.keys() == other.keys() and all(
        np.array_equal(one[name], other[name], equal_nan=name != "stage") for name in one
    )


def steps(unit: Member) -> dict[int, bool]:
    """Return for each step of the stage whether all samples are valid."""
    samples = unit.samples()
    of_stage = {int(step) for step in samples["step"][samples["stage"] == "rate"]}
    return {step: bool(samples["valid"][samples["step"] == step].all()) for step in sorted(of_stage)}


def alone(*stages: StagePlan) -> Member:
    batch = Batch(1, *stages)
    batch.units[0].name = ""
    assert batch.run() is State.DONE
    return batch.units[0]


def test_units_of_a_batch_get_the_same_samples_as_alone() -> None:
    batch, single = Batch(3), alone()
    assert batch.run() is State.DONE
    assert [verdict(unit.end) for unit in batch.units] == ["passed"] * 3
    for unit in batch.units:
        assert same(unit.samples(), single.samples())
        assert [len(block) for block in unit.solving.blocks["rate"]] == [len(b) for b in single.solving.blocks["rate"]]
        (own,), (one,) = unit.proved, single.proved
        assert np.allclose(own.rests, one.rests, atol=1e-9)
        assert np.allclose([t.integral for t in own.turns], [t.integral for t in one.turns], atol=1e-3)
        assert unit.done == ["judge", "read", "transfer", "verify"]
    assert batch.order == ["S1", "S2", "S3"]
    assert batch.table.commands.count("disable") == 1


def test_events_of_a_unit_have_its_slot_and_are_only_in_its_log() -> None:
    batch = Batch(2)
    assert batch.run() is State.DONE
    for kind in (StageSolved, StageProgress, StageRanked, Trace):
        assert {event.slot for event in batch.of(kind)} == {"S1", "S2"}
    for kind in (StateChanged, StageStarted, StageEnded, StepStarted):
        assert {event.slot for event in batch.of(kind)} == {""}
    assert batch.ids("identified") == ["S1", "S2"]
    for unit in batch.units:
        assert {event.get("slot", "") for event in unit.journal.events} == {"", unit.name}
        kinds = [event["event"] for event in unit.journal.events]
        assert kinds.count("StageSolved") == kinds.count("StageStarted") == 1
    assert {event.slot for event in Batch.of(one_unit(), Event)} == {""}


def one_unit() -> Batch:
    batch = Batch(1)
    batch.units[0].name = ""
    batch.run()
    return batch


def test_unit_with_a_lost_port_is_removed_without_affecting_the_others() -> None:
    batch, single = Batch(3), alone()
    lost = batch.units[1]
    batch.on(StageStarted, 2.0, loses_its_port(lost))
    assert batch.run() is State.DONE
    assert (lost.end.state, lost.code, lost.end.solutions) == (State.FAULT, "link.lost", ())
    assert lost.messages()[-1] == "unit_left"
    assert [event["event"] for event in lost.journal.events][-1] == "Fault"
    assert batch.ids("unit_left") == ["S2"]
    (left,) = (event.values for event in batch.of(Message) if event.id == "unit_left")
    assert left == {"serial": "SN-2", "reason": Text("link.lost", LOST.values)}
    assert [(fault.slot, fault.code) for fault in batch.of(Fault)] == [("S2", "link.lost")]
    assert "step_repeated" not in [event.id for event in batch.of(Message)]
    for unit in (batch.units[0], batch.units[2]):
        assert verdict(unit.end) == "passed"
        assert same(unit.samples(), single.samples())
        assert "unit_left" not in unit.messages()


@pytest.mark.parametrize(("deaf", "code"), [(True, "stream.no_answer"), (False, "stream.not_started")])
def test_silent_unit_is_removed_and_the_others_repeat_the_step(deaf: bool, code: str) -> None:
    batch = Batch(2)
    silent, other = batch.units

    def fall_silent() -> None:
        silent.imu.silent, silent.imu.deaf = True, deaf

    batch.on(StageStarted, 1.0, fall_silent)
    assert batch.run() is State.DONE
    assert (silent.end.state, silent.code) == (State.FAULT, code)
    assert verdict(other.end) == "passed"
    assert batch.ids("step_repeated") == ["S1"]
    stage = np.concatenate([block.step for block in other.solving.blocks["rate"]])
    valid = np.concatenate([block.valid for block in other.solving.blocks["rate"]])
    assert not valid[stage == stage[0]].all()
    assert valid[stage >= stage[-1] - 1].all()
    assert np.all(np.diff(other.samples()["seq"]) == 1)


def test_gap_of_one_unit_repeats_the_step_for_all() -> None:
    batch, single = Batch(3), Batch(1)
    for one in (batch, single):
        one.on(StageStarted, 1.0, lambda one=one: setattr(one.units[0].imu, "drop", 2))
        assert one.run() is State.DONE
    assert batch.ids("step_repeated") == ["S1"]
    (reason,) = (event.values["reason"] for event in batch.of(Message) if event.id == "step_repeated")
    assert reason == "gap"
    for unit in batch.units:
        assert steps(unit) == steps(single.units[0])
        assert (np.diff(unit.samples()["seq"]) != 1).sum() == (unit is batch.units[0])


def test_unit_that_repeatedly_invalidates_a_step_is_removed() -> None:
    batch = Batch(2)
    bad, good = batch.units

    def drop() -> None:
        if good.journal.blocks[-1].stage:
            bad.imu.drop = 2

    batch.table.on_move = drop
    assert batch.run() is State.DONE
    assert (bad.end.state, bad.code) == (State.FAULT, "stream.repeated_gap")
    assert verdict(good.end) == "passed"
    assert batch.ids("step_repeated") == ["S1"] * 3
    valid = np.concatenate([block.valid for block in good.solving.blocks["rate"]])
    assert valid[-300:].all()


def test_stuck_channel_is_a_fault_of_its_unit() -> None:
    batch, single = Batch(2), alone()
    stuck, other = batch.units
    stuck.unit = replace(stuck.unit, model=replace(MODEL, gyro_arw=1e-7))
    assert batch.run() is State.DONE
    assert stuck.code == "stream.stuck"
    assert verdict(other.end) == "passed"
    assert same(other.samples(), single.samples())


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"serial": "SN-9"}, "preflight.other_unit"),
        ({"sign": -1.0}, "preflight.turn_size"),
        ({"upside_down": True}, "preflight.gravity_direction"),
        ({"twist": 0.3}, "preflight.turn_axis"),
        ({"ready_at": 1e6}, "preflight.not_ready"),
        ({"silent": True}, "preflight.not_ready"),
    ],
)
def test_unit_that_fails_preflight_is_removed_and_the_others_are_calibrated(change: dict[str, Any], code: str) -> None:
    batch = Batch(3)
    bad = batch.units[2]
    for name, value in change.items():
        setattr(bad.imu, name, value)
    if "serial" in change:
        bad.unit = replace(bad.unit, serial="SN-3")
    assert batch.run() is State.DONE
    assert (bad.end.state, bad.code) == (State.FAULT, code)
    assert [verdict(unit.end) for unit in batch.units[:2]] == ["passed"] * 2
    assert "StageStarted" not in [event["event"] for event in bad.journal.events]


def test_run_starts_when_every_unit_has_warmed_up() -> None:
    batch = Batch(2)
    for unit, warm_up in zip(batch.units, (5.0, 60.0), strict=True):
        unit.unit = replace(unit.unit, preflight=replace(unit.unit.preflight, warm_up=warm_up))
    assert batch.run() is State.DONE
    running = next(e["station_time"] for e in batch.units[0].journal.events if e.get("state") == "running")
    assert running == pytest.approx(60.0, abs=FakeClock.tick)


def test_unit_with_drifting_temperature_is_removed() -> None:
    batch = Batch(2)
    limits = batch.units[0].unit.preflight
    drifting, other = batch.units
    for unit in batch.units:
        unit.unit = replace(unit.unit, preflight=replace(limits, warm_up_slope=0.5, warm_up_timeout=90.0))
    read = drifting.imu.read

    def drift() -> Any:
        data = read()
        return replace(data, temperature=25.0 + 0.1 * data.time)

    drifting.imu.read = drift  # type: ignore[method-assign]
    assert batch.run() is State.DONE
    assert drifting.code == "preflight.temperature_drift"
    assert verdict(other.end) == "passed"


def test_unit_is_checked_in_its_own_axes() -> None:
    batch = Batch(2)
    mounted = batch.units[1]
    mounted.imu.twist = 0.3
    turn = np.array([[np.cos(0.3), -np.sin(0.3), 0.0], [np.sin(0.3), np.cos(0.3), 0.0], [0.0, 0.0, 1.0]])

    class Turned(TableGeometry):
        def body_to_home(self, outer: float, inner: float) -> np.ndarray:
            return GEOMETRY.body_to_home(outer, inner) @ turn.T

    mounted.unit = replace(mounted.unit, geometry=Turned(limits=GEOMETRY.limits))
    assert batch.run() is State.DONE


def test_unit_outside_its_limits_after_a_stage_is_removed_as_failed() -> None:
    batch = Batch(3, StagePlan("rate", quarter_turns), StagePlan("excitation", quarter_turns))
    out = batch.units[0]
    out.goes_on = out.passes = False
    assert batch.run() is State.DONE
    assert verdict(out.end) == "failed"
    assert [solution.stage for solution in out.end.solutions] == ["rate"]
    assert "excitation" not in out.solving.blocks
    assert out.done == ["judge"]
    assert not batch.of(Fault)
    for unit in batch.units[1:]:
        assert verdict(unit.end) == "passed"
        assert [solution.stage for solution in unit.end.solutions] == ["rate", "excitation"]


def test_run_ends_if_all_units_are_outside_their_limits() -> None:
    batch = Batch(2, StagePlan("rate", quarter_turns), StagePlan("excitation", quarter_turns))
    for unit in batch.units:
        unit.goes_on = unit.passes = False
    assert batch.run() is State.DONE
    assert [event.stage for event in batch.of(StageStarted)] == ["rate"]
    assert [verdict(unit.end) for unit in batch.units] == ["failed"] * 2
    assert batch.table.commands[-1] == "disable"


def test_failed_unit_is_not_written_while_the_others_are() -> None:
    batch = Batch(3)
    batch.units[1].passes = False
    assert batch.run() is State.DONE
    assert [verdict(unit.end) for unit in batch.units] == ["passed", "failed", "passed"]
    assert batch.order == ["S1", "S3"]
    assert [len(unit.proved) for unit in batch.units] == [1, 0, 1]


def test_unit_whose_stage_cannot_be_solved_is_removed() -> None:
    batch = Batch(2)

    def finish() -> Solution:
        raise ConfigurationError("log.not_written", file="a.h5", reason="")

    batch.units[1].solving.finish = finish  # type: ignore[method-assign, assignment]
    assert batch.run() is State.DONE
    assert batch.units[1].end.state is State.FAULT
    assert verdict(batch.units[0].end) == "passed"


def test_targets_end_a_stage_when_every_unit_meets_them() -> None:
    rule = StopRule(targets={"gyro_bias": 1e-2})
    slow = Batch(2, repeated(rule))
    slow.units[1].solving.level = 100.0
    assert slow.run() is State.DONE
    (ended,) = slow.of(StageEnded)
    (single,) = Batch.of(_ran(Batch(1, StagePlan("excitation", endless, rule))), StageEnded)
    assert ended.reason == single.reason == "targets"
    assert ended.rounds > single.rounds


def _ran(batch: Batch) -> Batch:
    batch.run()
    return batch


def test_unit_with_a_failed_transfer_is_removed_and_the_others_verified() -> None:
    batch = Batch(3)
    bad = batch.units[1]

    def transfer(run_in_background: Any) -> None:
        raise LOST

    bad.transfer = transfer  # type: ignore[method-assign]
    assert batch.run() is State.DONE
    assert (bad.end.state, bad.code, bad.proved) == (State.FAULT, "link.lost", [])
    assert "transfer_unproved" not in bad.messages()
    for unit in (batch.units[0], batch.units[2]):
        assert verdict(unit.end) == "passed"
        assert unit.done == ["judge", "read", "transfer", "verify"]
    assert batch.table.commands[-1] == "disable"


def test_unit_that_fails_verification_is_removed_and_the_others_pass() -> None:
    batch = Batch(2)

    def verify(data: Any, run_in_background: Any) -> None:
        raise DeviceFaultError("stream.lossy")

    batch.units[0].verify = verify  # type: ignore[method-assign]
    assert batch.run() is State.DONE
    assert [verdict(unit.end) for unit in batch.units] == ["fault", "passed"]
    assert batch.ids("transfer_unproved") == []


def asked(batch: Batch) -> None:
    for unit in batch.units:
        unit.unit = replace(unit.unit, corrected=Output.ON_COMMAND)


def test_all_units_are_compared_with_one_common_reference() -> None:
    batch, single = Batch(2), Batch(1)
    for one in (batch, single):
        asked(one)
        assert one.run() is State.DONE
    moves = [command for command in batch.table.commands if command.startswith("move")]
    assert moves == [command for command in single.table.commands if command.startswith("move")]
    for unit in batch.units:
        (data,) = unit.proved
        assert data.corrected
        assert data.reference is not None
        assert unit.imu.started[-2:] == [True, False]


def test_unit_lost_during_verification_stays_unverified_and_the_others_are_verified() -> None:
    batch = Batch(3)
    lost = batch.units[2]
    batch.on(Message, 9.0, loses_its_port(lost), "verifying")
    assert batch.run() is State.DONE
    assert lost.end.state is State.FAULT
    assert batch.ids("transfer_unproved") == ["S3"]
    assert [len(unit.proved) for unit in batch.units] == [1, 1, 0]


def test_lost_frames_during_verification_repeat_only_that_rotation() -> None:
    batch, single = Batch(2), alone()
    batch.on(Message, 9.0, lambda: setattr(batch.units[0].imu, "drop", 2), "verifying")
    assert batch.run() is State.DONE
    (own,), (one,) = batch.units[1].proved, single.proved
    for turn, expected in zip(own.turns, one.turns, strict=True):
        assert np.allclose(turn.angle, expected.angle, atol=1e-9)


def test_unit_that_restarts_in_every_verification_is_removed() -> None:
    batch = Batch(2)
    asked(batch)
    bad, good = batch.units

    def again() -> None:
        bad.imu.restart()
        if good.end_pending:
            batch.clock.at(batch.clock.time + 9.0, again)

    good.end_pending = True  # type: ignore[attr-defined]
    batch.on(Message, 9.0, again, "verifying")
    batch.on(Message, 0.0, lambda: setattr(good, "end_pending", False), "unit_left")
    assert batch.run() is State.DONE
    assert bad.code == "stream.restarts_after_write"
    assert batch.ids("look_repeated") == ["S1"] * 3
    assert batch.ids("transfer_unproved") == ["S1"]
    assert verdict(good.end) == "passed"
    assert len(good.proved) == 1


@pytest.mark.parametrize("moment", [0.05, 3.0, 9.0, 12.0, 20.0, 40.0])
def test_a_stop_ends_all_units(moment: float) -> None:
    batch = Batch(2)
    batch.clock.at(moment, lambda: batch.control.send(Command.STOP))
    assert batch.run() is State.STOPPED
    assert [verdict(unit.end) for unit in batch.units] == ["stopped"] * 2
    assert batch.table.commands[-2:] == ["stop", "disable"]


def test_stop_between_two_transfers_leaves_the_written_unit_unverified() -> None:
    batch = Batch(2)
    first, second = batch.units
    write = first.transfer

    def transfer(run_in_background: Any) -> None:
        write(run_in_background)
        batch.control.send(Command.STOP)

    def stopped(run_in_background: Any) -> None:
        batch.control.check_cancelled()

    first.transfer, second.transfer = transfer, stopped  # type: ignore[method-assign]
    assert batch.run() is State.STOPPED
    assert batch.ids("transfer_unproved") == ["S1"]
    assert [verdict(unit.end) for unit in batch.units] == ["stopped"] * 2


@pytest.mark.parametrize(
    ("moment", "delay", "label"),
    [("reference", 9.0, "reference"), ("verifying", 9.0, "verify"), ("finishing", 0.2, "load")],
)
def test_pause_outside_the_stages_stops_the_table_at_once(moment: str, delay: float, label: str) -> None:
    batch = Batch(2)
    asked(batch)
    batch.task = replace(batch.task, load_angle=(1.0, 0.0))
    at_rest: list[bool] = []

    def pause() -> None:
        batch.control.send(Command.PAUSE)
        batch.clock.at(batch.clock.time + 4.0, resume)

    def resume() -> None:
        at_rest.append(batch.table.angles_at(batch.clock.time) == batch.table.target)
        assert [event.state for event in batch.of(StateChanged)][-1] == "paused"
        batch.control.send(Command.RESUME)

    if moment == "finishing":  # the capture before ends at the load position
        for unit in batch.units:
            unit.writes = False
    batch.on(Message, delay, pause, moment)
    assert batch.run() is State.DONE
    assert at_rest == [True]
    assert [verdict(unit.end) for unit in batch.units] == ["passed"] * 2
    assert [len(unit.proved) for unit in batch.units] == [int(moment != "finishing")] * 2
    states = [event.state for event in batch.of(StateChanged)]
    assert states[states.index("pausing") :] == ["pausing", "paused", "running", "done"]
    paused = batch.events.index(StateChanged(State.PAUSING, State.RUNNING))
    steps = [event for event in batch.events[:paused] if isinstance(event, StepStarted)]
    assert steps[-1].label == (label,)


def test_pause_repeats_the_step_for_all_units() -> None:
    batch = Batch(2)

    def pause() -> None:
        batch.control.send(Command.PAUSE)
        batch.clock.at(batch.clock.time + 5.0, lambda: batch.control.send(Command.RESUME))

    batch.on(StageStarted, 1.0, pause)
    assert batch.run() is State.DONE
    assert same(batch.units[0].samples(), batch.units[1].samples())
    assert [event.state for event in batch.of(StateChanged)][1:-1] == ["running", "pausing", "paused", "running"]


@pytest.mark.parametrize(
    ("attribute", "value", "code"),
    [
        ("fault", "drive", "table.latched_drive"),
        ("interlock", False, "motion.interlock_opened"),
        ("enabled", False, "motion.switched_off"),
        ("dead", True, "link.lost"),
        ("stuck", True, "motion.not_reached"),
    ],
)
@pytest.mark.parametrize("silent", [False, True])
def test_a_fault_of_the_table_ends_all_units(attribute: str, value: object, code: str, silent: bool) -> None:
    """This also applies while a silent unit is commanded to stream again."""
    batch = Batch(3)

    def fail() -> None:
        if silent and attribute != "stuck":
            batch.units[0].imu.silent = True
            batch.clock.at(batch.clock.time + 5.0, lambda: setattr(batch.table, attribute, value))
        else:
            setattr(batch.table, attribute, value)

    batch.on(StageStarted, 0.0 if attribute == "stuck" else 1.0, fail)
    if attribute == "stuck":
        batch.table.on_move = lambda: None if not batch.of(StageStarted) else setattr(batch.table, "stuck", True)
    assert batch.run() is State.FAULT
    assert [verdict(unit.end) for unit in batch.units] == ["fault"] * 3
    assert {unit.code for unit in batch.units} == {code}
    assert [(fault.slot, fault.code) for fault in batch.of(Fault)] == [("", code)]
    assert batch.ids("unit_left") == []


def test_fault_of_the_last_unit_is_the_fault_of_the_run() -> None:
    batch = Batch(2)
    for delay, unit in zip((1.0, 2.0), batch.units, strict=True):
        batch.on(StageStarted, delay, loses_its_port(unit))
    assert batch.run() is State.FAULT
    assert batch.ids("unit_left") == ["S1"]
    assert [fault.slot for fault in batch.of(Fault)] == ["S1", ""]
    assert [verdict(unit.end) for unit in batch.units] == ["fault"] * 2
    assert batch.table.commands[-2:] == ["stop", "disable"]


def test_simultaneous_fault_of_all_units_is_the_fault_of_the_run() -> None:
    batch = Batch(3)
    for unit in batch.units:
        batch.on(StageStarted, 1.0, loses_its_port(unit))
    assert batch.run() is State.FAULT
    assert batch.ids("unit_left") == ["S1", "S2"]


@pytest.mark.parametrize("method", ["append", "event", "service"])
def test_log_that_cannot_be_written_is_a_fault_of_its_unit(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    batch, single = Batch(2), alone()
    bad, good = batch.units

    def fail(*arguments: Any) -> None:
        raise ConfigurationError("log.not_written", file="a.h5", reason="")

    batch.on(StageStarted, 1.0, lambda: monkeypatch.setattr(bad.journal, method, fail))
    assert batch.run() is State.DONE
    assert (bad.end.state, bad.code) == (State.FAULT, "log.not_written")
    assert verdict(good.end) == "passed"
    assert same(good.samples(), single.samples())


def test_log_of_a_removed_unit_receives_no_more_data() -> None:
    batch = Batch(2)
    lost = batch.units[0]
    batch.on(StageStarted, 1.0, loses_its_port(lost))
    counts: list[int] = []
    ended = lost.ended

    def end(event: RunEnd) -> None:
        counts.append(len(lost.journal.events))
        ended(event)

    lost.ended = end  # type: ignore[method-assign]
    assert batch.run() is State.DONE
    assert counts == [len(lost.journal.events)]


def test_run_continues_while_the_result_of_a_removed_unit_is_written() -> None:
    batch = Batch(2)
    lost = batch.units[0]
    over, waited = threading.Event(), []

    def end(event: RunEnd) -> None:
        waited.append(over.wait(60.0))
        lost.ends.append(event)

    lost.ended = end  # type: ignore[method-assign]
    batch.on(StageStarted, 1.0, loses_its_port(lost))
    batch.on(StageEnded, 0.0, over.set)
    assert batch.run() is State.DONE
    assert waited == [True]


@pytest.mark.long
def test_batch_of_sixteen_units_passes() -> None:
    batch = Batch(16)
    assert batch.run() is State.DONE
    assert len(batch.order) == 16


def test_failed_result_write_does_not_affect_other_units() -> None:
    batch = Batch(2)
    events: list[RunEnd] = []

    def fail(ended: RunEnd) -> None:
        events.append(ended)
        raise ConfigurationError("log.not_written", file="a.json", reason="")

    batch.units[0].ended = fail  # type: ignore[method-assign]
    with pytest.raises(ConfigurationError):
        batch.run()
    assert len(events) == 1
    assert verdict(batch.units[1].end) == "passed"


def test_single_unit_run_ends_exactly_once() -> None:
    scene = Scene()
    assert verdict(scene.run(after=LastSample(10, 1.0, 2))) == "passed"


def test_watchdog_is_fed_until_a_transfer_ends_despite_a_log_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    batch = Batch(2)
    bad, good = batch.units
    batch.table.watchdog = 1e-3
    beats: list[int] = []

    def fail() -> None:
        raise ConfigurationError("log.not_written", file="a.h5", reason="")

    def write() -> None:
        """Wait until the watchdog was fed twice after the log failure."""
        monkeypatch.setattr(bad.journal, "service", fail)
        for _ in range(2):
            before = batch.table.beats
            deadline = time.monotonic() + 30.0
            while batch.table.beats == before and time.monotonic() < deadline:
                time.sleep(2e-3)
            beats.append(batch.table.beats - before)
        bad.done.append("transfer")

    bad.transfer = lambda run_in_background: run_in_background(write)  # type: ignore[method-assign]
    assert batch.run() is State.DONE
    assert all(beats)
    assert bad.done == ["judge", "read", "transfer"]
    assert (bad.end.state, bad.code) == (State.FAULT, "log.not_written")
    assert verdict(good.end) == "passed"


def test_table_lost_during_a_transfer_is_not_a_fault_of_the_unit() -> None:
    batch = Batch(2)
    first = batch.units[0]
    batch.table.watchdog = 1e-3
    asked: list[int] = []
    heartbeat = batch.table.heartbeat

    def beat() -> None:
        asked.append(1)
        heartbeat()

    def write() -> None:
        batch.table.dead = True
        before = len(asked)
        deadline = time.monotonic() + 30.0
        while len(asked) < before + 3 and time.monotonic() < deadline:
            time.sleep(2e-3)

    batch.table.heartbeat = beat  # type: ignore[method-assign]
    first.transfer = lambda run_in_background: run_in_background(write)  # type: ignore[method-assign]
    assert batch.run() is State.FAULT
    assert [(fault.slot, fault.code) for fault in batch.of(Fault)] == [("", "link.lost")]
    assert [verdict(unit.end) for unit in batch.units] == ["fault"] * 2
    assert batch.ids("unit_left") == []


def test_no_register_is_written_after_a_table_fault() -> None:
    batch = Batch(4)
    first = batch.units[0]
    write = first.transfer

    def transfer(run_in_background: Any) -> None:
        write(run_in_background)
        batch.table.fault = "interlock"

    first.transfer = transfer  # type: ignore[method-assign]
    assert batch.run() is State.FAULT
    assert batch.order == ["S1"]
    assert [verdict(unit.end) for unit in batch.units] == ["fault"] * 4
    assert {unit.code for unit in batch.units} == {"table.latched_interlock"}
    assert batch.ids("transfer_unproved") == ["S1"]
    assert [(fault.slot, fault.code) for fault in batch.of(Fault)] == [("", "table.latched_interlock")]


def test_failed_unit_stays_failed_if_its_port_is_lost_later() -> None:
    batch = Batch(3)
    failed = batch.units[1]
    failed.passes = False
    batch.on(Message, 0.5, loses_its_port(failed), "verifying")
    assert batch.run() is State.DONE
    assert [verdict(unit.end) for unit in batch.units] == ["passed", "failed", "passed"]
    assert [len(unit.proved) for unit in batch.units] == [1, 0, 1]
    assert batch.of(Fault) == []


@pytest.mark.parametrize("writes", [True, False])
def test_passed_unit_stays_passed_if_its_port_is_lost_later(writes: bool) -> None:
    batch = Batch(2)
    batch.task = replace(batch.task, load_angle=(1.0, 0.0))
    for unit in batch.units:
        unit.writes = writes
    batch.on(Message, 0.01, loses_its_port(batch.units[0]), "finishing")
    assert batch.run() is State.DONE
    assert [verdict(unit.end) for unit in batch.units] == ["passed"] * 2
    assert batch.table.commands[-1] == "disable"
    assert batch.of(Fault) == []


def test_table_fault_after_verification_changes_no_verdict() -> None:
    batch = Batch(2)
    batch.task = replace(batch.task, load_angle=(1.0, 0.0))
    batch.on(Message, 0.0, lambda: setattr(batch.table, "fault", "drive"), "finishing")
    for unit in batch.units:
        unit.writes = False
    assert batch.run() is State.FAULT
    assert [verdict(unit.end) for unit in batch.units] == ["passed"] * 2
    assert [(fault.slot, fault.code) for fault in batch.of(Fault)] == [("", "table.latched_drive")]


def test_passed_unit_that_is_removed_later_is_not_counted_as_passed() -> None:
    batch = Batch(2)
    batch.on(Message, 9.0, loses_its_port(batch.units[0]), "verifying")
    assert batch.run() is State.DONE
    assert [verdict(unit.end) for unit in batch.units] == ["fault", "passed"]


def test_result_of_a_removed_unit_is_written_after_its_solver_finishes() -> None:
    batch = Batch(2)
    lost, good = batch.units
    begun, left, done = threading.Event(), threading.Event(), threading.Event()
    seen: list[bool] = []
    finish, ended = lost.solving.finish, lost.ended

    def solve(progress: Any = None) -> Solution:
        begun.set()
        assert left.wait(30.0)
        time.sleep(0.05)
        done.set()
        return finish()

    def let_time_pass(seconds: float) -> None:
        """Drain samples while the unit is solved, as on hardware."""
        if begun.is_set() and not done.is_set():
            loses_its_port(lost)()
            batch.clock.time += 0.05

    def end(event: RunEnd) -> None:
        seen.append(done.is_set())
        ended(event)

    emit = batch._take

    def take(event: Event) -> None:
        emit(event)
        if isinstance(event, Message) and event.id == "unit_left":
            left.set()

    batch._take = take  # type: ignore[method-assign]
    lost.solving.finish, lost.ended, batch.clock.idle = solve, end, let_time_pass  # type: ignore[method-assign]
    assert batch.run() is State.DONE
    assert seen == [True]
    assert (lost.code, verdict(good.end)) == ("link.lost", "passed")


def test_unexpected_error_keeps_the_result_of_a_removed_unit() -> None:
    batch = Batch(2)
    lost, other = batch.units
    mistaken = threading.Event()
    ended = lost.ended

    def end(event: RunEnd) -> None:
        assert mistaken.wait(30.0)
        time.sleep(0.05)
        ended(event)

    def ranking() -> None:
        if batch.ids("unit_left"):
            mistaken.set()
            raise RuntimeError("mistake")

    lost.ended, other.solving.ranking = end, ranking  # type: ignore[method-assign]
    batch.on(StageStarted, 1.0, loses_its_port(lost))
    with pytest.raises(RuntimeError, match="mistake"):
        batch.run()
    assert (lost.end.state, lost.code) == (State.FAULT, "link.lost")
    assert other.ends == []


def test_unit_removed_before_its_solver_is_compiled_does_not_end_the_run() -> None:
    batch = Batch(3)
    first, bad, _ = batch.units
    ended, over = bad.ended, threading.Event()

    def end(event: RunEnd) -> None:
        ended(event)
        over.set()

    bad.imu.upside_down = True
    first.solving.warm = lambda: over.wait(30.0)  # type: ignore[assignment, method-assign, return-value]
    bad.ended = end  # type: ignore[method-assign]
    assert batch.run() is State.DONE
    assert over.is_set()
    assert [verdict(unit.end) for unit in batch.units] == ["passed", "fault", "passed"]


def in_turns(batch: Batch, until: float) -> None:
    """Let the units of a batch send frames alternately, one per tick, until a station time."""

    def alternate(unit: Member, index: int) -> Callable[[], SampleBatch]:
        read, calls = unit.imu.read, count(index)

        def turn() -> SampleBatch:
            if next(calls) % len(batch.units) or batch.clock.time > until:
                return read()
            return SampleBatch(
                np.empty(0, np.int64), np.empty(0), np.empty((0, 6)), np.empty(0), np.empty(0, np.int64), np.empty(0)
            )

        return turn

    for index, unit in enumerate(batch.units):
        unit.imu.read = alternate(unit, index)  # type: ignore[method-assign]


def test_units_with_alternating_frames_all_become_ready() -> None:
    batch = Batch(2)
    for unit in batch.units:
        unit.unit = replace(unit.unit, preflight=replace(unit.unit.preflight, ready_timeout=1.5))
    in_turns(batch, until=2.0)
    assert batch.run() is State.DONE
    assert [verdict(unit.end) for unit in batch.units] == ["passed"] * 2


def test_failed_self_test_is_detected_while_other_units_are_not_ready() -> None:
    batch = Batch(2)
    bad, late = batch.units
    late.imu.ready_at = 5.0
    read = bad.imu.read

    def fail_first() -> SampleBatch:
        data = read()
        return replace(data, status=data.status | (4 if batch.clock.time < 1.0 else 0))

    bad.imu.read = fail_first  # type: ignore[method-assign]
    assert batch.run() is State.DONE
    assert (bad.end.state, bad.code) == (State.FAULT, "preflight.self_test_failed")
    assert verdict(late.end) == "passed"


@pytest.mark.parametrize("name", ["sigma", "judge"])
def test_stop_takes_effect_between_evaluations_of_units(name: str) -> None:
    batch = Batch(3)
    first = batch.units[0]
    begun: list[str] = []

    for unit in batch.units:
        owner = unit.solving if name == "sigma" else unit
        work = getattr(owner, name)

        def noted(*arguments: Any, unit: Member = unit, work: Any = work) -> Any:
            if unit is first:
                batch.control.send(Command.STOP)
            begun.append(unit.name)
            return work(*arguments)

        setattr(owner, name, noted)
    assert batch.run() is State.STOPPED
    assert begun == ["S1"]
    assert [verdict(unit.end) for unit in batch.units] == ["stopped"] * 3
    assert batch.order == []
    assert batch.table.commands[-2:] == ["stop", "disable"]


def moves_of(batch: Batch) -> list[str]:
    return [command for command in batch.table.commands if command.startswith("move")]


def verified_earlier(*outputs: Output | None) -> Batch:
    """Run units written before the run, by output type; None for a unit that was not written."""
    batch = Batch(len(outputs))
    for unit, output in zip(batch.units, outputs, strict=True):
        unit.writes = False
        if output is not None:
            unit.unit = replace(unit.unit, corrected=output)
            unit.verify_earlier = lambda unit=unit: lambda data, _: unit.proved.append(data)  # type: ignore[method-assign]
    assert batch.run() is State.DONE
    return batch


def test_only_verified_units_determine_the_verification_rotations() -> None:
    """Half turns are sufficient if all units are compared; full turns are required without a comparison."""
    batch = verified_earlier(Output.ON_COMMAND, None)
    assert moves_of(batch) == moves_of(verified_earlier(Output.ON_COMMAND))
    (data,) = batch.units[0].proved
    assert not any(turned.turn.is_full for turned in data.turns)


def test_full_turns_are_made_if_a_unit_is_verified_without_a_comparison() -> None:
    batch = verified_earlier(Output.ON_COMMAND, Output.ALWAYS)
    for unit, compared in zip(batch.units, (True, False), strict=True):
        (data,) = unit.proved
        assert (data.reference is not None) == compared
        assert any(turned.turn.is_full for turned in data.turns)
