"""Guided manual runs: the run waits for every rest, drives no axes, and discards no samples."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from calstation.config import library
from calstation.devices import SampleBatch
from calstation.devices.profiles import load_table_profile
from calstation.devices.table import ManualTable
from calstation.physics import ManualMove, Step, rotation_vector
from calstation.sequencer import (
    LOSSY,
    Command,
    Fault,
    Message,
    PositionGuided,
    StageEnded,
    StagePlan,
    StageProgress,
    State,
    StateChanged,
    StepStarted,
    TableMoved,
    from_json,
    to_json,
)
from tests.sequencer.fakes import GEOMETRY, GRAVITY, MODEL, RATE, FakeImu, Scene, verdict

REST = 2.0
QUARTER = 0.5 * math.pi
Pose = tuple[float, float]
FOUR: tuple[Pose, ...] = ((0.0, 0.0), (QUARTER, 0.0), (QUARTER, QUARTER), (0.0, QUARTER))
ROUND = tuple((0.5 * k * QUARTER, 0.0) for k in range(1, 9))
TURNED = tuple((2 * QUARTER + 0.5 * k * QUARTER, QUARTER) for k in range(8))
ON_ITS_SIDE = tuple((QUARTER, QUARTER + 0.5 * k * QUARTER) for k in range(8))
ALL_ROUND = ((0.0, 0.0), *ROUND, *TURNED, *ON_ITS_SIDE, (0.0, 0.0))


class CarriedImu(FakeImu):
    """A unit rotated by an operator, with low noise; every rotation takes one second."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene.clock, scene.table)
        self.way: list[tuple[float, Pose]] = [(0.0, (0.0, 0.0))]
        self.random = np.random.default_rng(1)

    def turn(self, pose: Pose) -> None:
        self.way.append((self.clock.time, pose))

    def pose(self, time: float) -> np.ndarray:
        at = np.zeros(2)
        for (_, before), (begin, pose) in pairwise(self.way):
            if time >= begin:
                at = np.asarray(before) + min(time - begin, 1.0) * np.subtract(pose, before)
        return at

    def read(self) -> SampleBatch:
        batch = super().read()
        return replace(batch, counts=batch.counts + self.random.normal(0.0, 50.0, batch.counts.shape))

    def _rests(self, begin: float, end: float) -> bool:
        return not any(begin < start + 1.0 and start < end for start, _ in self.way)

    def _counts(self, time: float) -> np.ndarray:
        before, now = (GEOMETRY.body_to_home(*self.pose(t)) for t in (time - 1.0 / RATE, time))
        gyro = rotation_vector(before.T @ now) * RATE
        force = now.T @ np.array([0.0, 0.0, GRAVITY])
        return np.concatenate([gyro / MODEL.gyro_lsb, force / MODEL.accel_lsb])


class CarryRequests(list[Any]):
    """Collect events, and call a simulated operator at every request to move the unit."""

    def __init__(self, ask: Callable[[StepStarted], None]) -> None:
        super().__init__()
        self._ask = ask

    def append(self, event: Any) -> None:
        super().append(event)
        if isinstance(event, StepStarted) and event.kind == "carry":
            self._ask(event)


class ManualScene(Scene):
    """A scene with a manual rig, rotated 0.5 s after each request unless `instead` gives another action."""

    def __init__(self, poses: tuple[Pose, ...] = FOUR) -> None:
        def steps() -> Iterator[Step]:
            for index, pose in enumerate(poses, start=1):
                yield ManualMove(*pose, REST, 3.0, index, len(poses))

        super().__init__(StagePlan("multi_position", steps), by_hand=True)
        self.imu = self.hand = CarriedImu(self)
        rails = load_table_profile(library.shipped_folder() / "tables" / "hand_rails.toml")
        self.table = ManualTable(rails)  # type: ignore[assignment]
        self.events = CarryRequests(self.ask)
        self.instead: dict[int, Callable[[Pose], None]] = {}

    def ask(self, event: StepStarted) -> None:
        outer, inner, _, index, _ = (float(value) for value in event.label[1:])
        pose = (math.radians(outer), math.radians(inner))
        act = self.instead.pop(int(index), None) if event.stage else None
        if act is not None:
            act(pose)
        elif pose != self.hand.way[-1][1]:
            self.later(0.5, lambda: self.hand.turn(pose))

    def later(self, seconds: float, act: Callable[[], None]) -> None:
        self.clock.at(self.clock.time + seconds, act)

    def samples(self, name: str) -> np.ndarray:
        return np.concatenate([getattr(b, name) for b in self.solving.blocks["multi_position"]])


def words(scene: Scene, index: int) -> list[str]:
    """Return the reported states of a position, each once."""
    states = [e.state for e in scene.events_of(PositionGuided) if e.stage and e.index == index]
    return [state for k, state in enumerate(states) if k == 0 or states[k - 1] != state]


def test_run_waits_for_every_rest_and_drives_no_axes() -> None:
    scene = ManualScene()
    assert verdict(scene.run()) == "passed", scene.events_of(Fault)
    assert words(scene, 1) == ["waiting", "still", "enough"]
    for index in (2, 3, 4):
        assert words(scene, index) == ["enough", "moving", "still", "enough"]
    asked = [e for e in scene.events_of(StepStarted) if e.stage]
    assert {e.kind for e in asked} == {"carry"}
    assert [e.label[4] for e in asked] == [1.0, 2.0, 3.0, 4.0]
    assert list(np.unique(scene.samples("step"))) == [e.step for e in asked]
    assert scene.samples("valid").all()
    assert np.isnan(scene.samples("angles")).all()
    assert np.array_equal(np.diff(scene.samples("seq")), np.ones(len(scene.samples("seq")) - 1))
    assert not scene.events_of(TableMoved)


def test_guidance_shows_gravity_and_completed_and_requested_positions() -> None:
    scene = ManualScene()
    scene.run()
    last = [e for e in scene.events_of(PositionGuided) if e.stage][-1]
    assert (last.index, last.count, last.state) == (4, 4, "enough")
    assert (last.outer, last.inner) == FOUR[3]
    assert (last.outer_before, last.inner_before) == FOUR[2]
    done = np.reshape(last.done, (-1, 3))
    expected = [GEOMETRY.body_to_home(*pose)[2] for pose in FOUR]
    assert np.abs(done - expected).max() < 0.01
    assert np.abs(np.array(last.up) - expected[3]).max() < 0.01
    assert not last.suffices
    assert from_json(to_json(last)) == last
    assert isinstance(last, LOSSY)


def test_progress_counts_every_position() -> None:
    scene = ManualScene()
    scene.run()
    fractions = [e.fraction for e in scene.events_of(StageProgress)]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert scene.events_of(StageProgress)[-1].remaining == 0.0


def test_late_release_repeats_the_request_and_loses_no_samples() -> None:
    scene = ManualScene()

    def touched(pose: Pose) -> None:
        scene.later(0.5, lambda: scene.hand.turn(pose))
        scene.later(3.0, lambda: scene.hand.turn((pose[0] + 0.2, pose[1])))

    scene.instead[2] = touched
    assert verdict(scene.run()) == "passed"
    assert words(scene, 2) == ["enough", "moving", "still", "repeat", "still", "enough"]
    assert scene.samples("valid").all()
    assert not [m for m in scene.events_of(Message) if m.id == "step_repeated"]


def test_gap_during_a_manual_move_requests_the_position_again() -> None:
    scene = ManualScene()

    def cut(pose: Pose) -> None:
        scene.later(0.5, lambda: scene.hand.turn(pose))
        scene.later(2.5, lambda: setattr(scene.imu, "drop", 3))

    scene.instead[3] = cut
    assert verdict(scene.run()) == "passed"
    (repeated,) = [m for m in scene.events_of(Message) if m.id == "step_repeated"]
    assert repeated.values["reason"] == "gap"
    asked = [e for e in scene.events_of(StepStarted) if e.stage]
    assert [e.label[4] for e in asked] == [1.0, 2.0, 3.0, 3.0, 4.0]
    assert {e.kind for e in asked} == {"carry"}
    assert len(np.reshape(scene.events_of(PositionGuided)[-1].done, (-1, 3))) == 2  # of the check after the stage


def test_pause_is_not_a_rest_and_the_position_is_requested_again() -> None:
    scene = ManualScene()

    def pause(pose: Pose) -> None:
        scene.later(0.5, lambda: scene.hand.turn(pose))
        scene.later(2.0, lambda: scene.control.send(Command.PAUSE))
        scene.later(9.0, lambda: scene.control.send(Command.RESUME))

    scene.instead[2] = pause
    assert verdict(scene.run()) == "passed"
    assert [e.state for e in scene.events_of(StateChanged)][1:-1] == ["running", "pausing", "paused", "running"]
    valid, time = scene.samples("valid"), scene.samples("time")
    assert 6.5 < (~valid).sum() / RATE < 8.0
    assert time[-1] - time[np.flatnonzero(~valid)[-1]] > 3 * REST


def test_stage_can_be_ended_once_the_positions_are_well_distributed() -> None:
    scene = ManualScene(ALL_ROUND)
    scene.instead[2] = lambda pose: (
        scene.control.send(Command.END_STAGE),
        scene.later(0.5, lambda: scene.hand.turn(pose)),
    )
    assert verdict(scene.run()) == "passed"
    (ended,) = scene.events_of(StageEnded)
    assert ended.reason == "operator"
    last = [e for e in scene.events_of(PositionGuided) if e.stage][-1]
    assert last.suffices
    assert 12 < last.index < len(ALL_ROUND)


def test_verification_begins_at_the_last_completed_position_of_a_stage_ended_before_the_next() -> None:
    scene = ManualScene(ALL_ROUND)
    scene.instead[26] = lambda _: scene.control.send(Command.END_STAGE)
    assert verdict(scene.run()) == "passed"
    guided = scene.events_of(PositionGuided)
    assert [e for e in guided if e.stage][-1].index == 26
    check = next(e for e in guided if not e.stage)
    assert (check.outer, check.inner) == ALL_ROUND[24]


def test_stop_ends_the_wait_for_the_operator() -> None:
    scene = ManualScene()
    scene.instead[2] = lambda pose: scene.later(30.0, lambda: scene.control.send(Command.STOP))
    assert scene.run().state is State.STOPPED
    assert scene.finalized == 0


def test_manual_rig_skips_power_homing_and_motion_checks() -> None:
    scene = ManualScene()
    scene.hand.way[0] = (0.0, (math.pi, 0.0))  # upside down: no direction is declared
    scene.hand.pose = lambda time, own=scene.hand.pose: own(time) + np.array([math.pi, 0.0])  # type: ignore[method-assign]
    assert verdict(scene.run()) == "passed"
    messages = [m.id for m in scene.events_of(Message)]
    assert "checking_gravity" in messages
    assert not {"homing", "checking_mounting", "finishing"} & set(messages)


def test_wrong_gravity_magnitude_is_a_fault_before_any_position() -> None:
    scene = ManualScene()
    scene.unit = replace(scene.unit, preflight=replace(scene.unit.preflight, gravity=9.0))
    assert scene.run().state is State.FAULT
    assert scene.events_of(Fault)[0].code == "preflight.gravity_size"
    assert not scene.events_of(StepStarted)


def test_restarted_unit_is_turned_over_between_two_rests() -> None:
    scene = ManualScene()
    scene.run()
    (data,) = scene.proved
    first, second = data.rests
    assert np.abs(first[3:] + second[3:]).max() < 0.05
    assert data.turns == ()
    turned = (data.carried[:, :3] * data.period).sum(axis=0)
    assert abs(np.linalg.norm(turned) - math.pi) < 0.05
    checks = [e for e in scene.events_of(PositionGuided) if not e.stage]
    assert {(e.index, e.count) for e in checks} == {(1, 2), (2, 2)}
