"""Runs with fake devices: sequence, pause, stop, faults, repeated steps, stop rules."""

import time
from dataclasses import replace

import numpy as np
import pytest

from calstation.connection import RealClock
from calstation.devices.profiles import ChannelRange
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.estimation import Solution
from calstation.messages import Text
from calstation.physics import Move
from calstation.sequencer import (
    Command,
    Fault,
    LastSample,
    Message,
    Output,
    RunEnd,
    RunInBackground,
    StageEnded,
    StagePlan,
    StageProgress,
    StageStarted,
    State,
    StateChanged,
    StepStarted,
    StopRule,
    TableMoved,
)
from calstation.sequencer.guard import safe_stop
from tests.sequencer.fakes import GRAVITY, MODEL, RATE, FakeClock, FakeTable, Scene, repeated, verdict


def code(ended: RunEnd) -> str:
    assert ended.error is not None
    return ended.error.code


def states(scene: Scene) -> list[str]:
    return [event.state for event in scene.events_of(StateChanged)]


@pytest.fixture(params=[pytest.param(RealClock.tick, marks=pytest.mark.long), FakeClock.tick])
def tick(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> float:
    """The polling interval, s: the interval of hardware and the longer one of all other tests."""
    monkeypatch.setattr(FakeClock, "tick", request.param)
    return float(request.param)


def test_run_passes_and_leaves_the_axes_off(tick: float) -> None:
    scene = Scene()
    assert verdict(scene.run()) == "passed"
    assert states(scene) == ["preparing", "running", "done"]
    assert scene.table.commands[0] == "enable"
    assert scene.table.commands[-1] == "disable"
    assert scene.finalized == 1


def test_samples_have_stage_step_and_angles(tick: float) -> None:
    scene = Scene()
    scene.passes = False  # no turns after the last stage: the fake remembers only its last move
    scene.run()
    blocks = scene.solving.blocks["rate"]
    assert {block.stage for block in blocks} == {"rate"}
    seq = np.concatenate([b.seq for b in scene.journal.blocks])
    assert np.all(np.diff(seq) == 1)
    steps = np.concatenate([b.step for b in blocks])
    assert list(np.unique(np.diff(steps))) == [0, 1]
    assert steps[-1] - steps[0] == 1
    angles = np.concatenate([b.angles for b in blocks])
    polled = ~np.isnan(angles[:, 0])
    assert polled.mean() == pytest.approx(1.0 / (RATE * scene.clock.tick), rel=0.1)
    assert np.all(np.concatenate([b.valid for b in blocks]))
    times = np.concatenate([b.time for b in blocks])
    truth = np.array([scene.table.angles_at(t)[0] for t in times[polled]][-20:])
    assert np.allclose(angles[polled, 0][-20:], truth, atol=1e-9)


def test_each_rest_has_its_duration_in_imu_time(tick: float) -> None:
    scene = Scene()
    scene.run()
    blocks = scene.solving.blocks["rate"]
    last = [b for b in blocks if b.step[0] == blocks[-1].step[0]]
    angles = np.concatenate([b.angles[:, 0] for b in last])
    times = np.concatenate([b.time for b in last])[~np.isnan(angles)]
    resting = times[np.abs(angles[~np.isnan(angles)]) < 1e-9]
    assert 3.0 <= resting[-1] - resting[0] + 0.1 < 3.4


def test_a_unit_outside_its_limits_fails() -> None:
    scene = Scene()
    scene.passes = False
    assert verdict(scene.run()) == "failed"


def test_stop_in_any_state_is_a_safe_stop(tick: float) -> None:
    for moment in (0.05, 1.0, 3.0, 6.0, 9.0, 12.0):
        scene = Scene()
        scene.clock.at(moment, lambda scene=scene: scene.control.send(Command.STOP))
        assert scene.run().state is State.STOPPED
        assert scene.table.commands[-2:] == ["stop", "disable"]
        assert scene.finalized == 0


def test_stop_before_preparation_sends_no_commands() -> None:
    scene = Scene()
    scene.control.send(Command.STOP)
    assert scene.run().state is State.STOPPED
    assert not [command for command in scene.table.commands if command.startswith("move")]


def test_table_is_shown_at_rest_after_a_stop() -> None:
    scene = Scene()
    in_stage(scene, 1.0, lambda: scene.control.send(Command.STOP))
    assert scene.run().state is State.STOPPED
    shown = scene.events_of(TableMoved)[-1]
    assert (shown.moving, shown.outer_rate, shown.inner_rate) == (False, 0.0, 0.0)


def in_stage(scene: Scene, delay: float, action: object) -> None:
    """Call `act` `delay` s after the start of the first step of the stage."""

    def watch(event: object, append=scene.events.append) -> None:
        append(event)
        if isinstance(event, StepStarted) and event.stage and not hasattr(scene, "armed"):
            scene.armed = True  # type: ignore[attr-defined]
            scene.clock.at(scene.clock.time + delay, action)

    scene.events = _Watched(watch, scene.events)  # type: ignore[assignment]


class _Watched(list):  # type: ignore[type-arg]
    def __init__(self, watch: object, events: list[object]) -> None:
        super().__init__(events)
        self._watch = watch
        self.append_plain = super().append

    def append(self, event: object) -> None:
        self._watch(event, self.append_plain)  # type: ignore[operator]


def test_pause_and_resume_repeats_the_step_from_its_start(tick: float) -> None:
    scene = Scene()

    def pause() -> None:
        scene.control.send(Command.PAUSE)
        scene.clock.at(scene.clock.time + 5.0, lambda: scene.control.send(Command.RESUME))

    in_stage(scene, 1.0, pause)
    assert verdict(scene.run()) == "passed"
    assert states(scene)[1:-1] == ["running", "pausing", "paused", "running"]
    commands = scene.table.commands
    i = commands.index("stop")
    assert commands[i - 1] == "move 90 0"
    assert commands[i + 1 : i + 3] == ["move 0 0", "move 90 0"]
    step = np.concatenate([b.step for b in scene.solving.blocks["rate"]])
    valid = np.concatenate([b.valid for b in scene.solving.blocks["rate"]])
    first = step[0]
    assert not valid[step == first].all()
    assert valid[step == first][:10].all()
    assert not valid[step == first + 1].any()
    assert valid[step > first + 1].all()
    assert step[-1] == first + 4


def test_pause_during_a_rest_repeats_the_preceding_move_and_the_rest(tick: float) -> None:
    scene = Scene()

    def pause() -> None:
        scene.control.send(Command.PAUSE)
        scene.clock.at(scene.clock.time + 2.0, lambda: scene.control.send(Command.RESUME))

    in_stage(scene, 5.0, pause)
    assert verdict(scene.run()) == "passed"
    steps = [(s.kind, s.label[:1]) for s in scene.events_of(StepStarted) if s.stage]
    turn, rest = ("move", ("turn",)), ("dwell", ())
    assert steps == [turn, rest, ("move", ("return",)), rest, turn, rest, turn, rest]


@pytest.mark.parametrize("state", ["stopping", "stopped", "done"])
def test_log_failure_at_a_state_change_is_a_fault(state: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene()
    event = scene.journal.event

    def fail(entry: dict[str, object]) -> None:
        if entry.get("state") == state:
            raise ConfigurationError("log.not_written", file="a.h5", reason="")
        event(entry)

    monkeypatch.setattr(scene.journal, "event", fail)
    if state != "done":
        in_stage(scene, 1.0, lambda: scene.control.send(Command.STOP))
    ended = scene.run()
    assert (ended.state, code(ended)) == (State.FAULT, "log.not_written")
    assert states(scene)[-1] == "fault"
    assert scene.table.commands[-2:] == ["stop", "disable"]


def test_log_failure_during_the_safe_stop_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene()

    def fail(block: object) -> None:
        raise ConfigurationError("log.not_written", file="a.h5", reason="")

    def stop() -> None:
        FakeTable.stop(scene.table)
        scene.clock.sleep(0.5)
        monkeypatch.setattr(scene.journal, "append", fail)

    monkeypatch.setattr(scene.table, "stop", stop)
    in_stage(scene, 1.0, lambda: scene.control.send(Command.STOP))
    assert scene.run().state is State.STOPPED
    assert "safe_stop_incomplete" in [m.id for m in scene.events_of(Message)]
    assert scene.table.commands[-2:] == ["stop", "disable"]


def test_lost_samples_repeat_the_step(tick: float) -> None:
    scene = Scene()
    in_stage(scene, 1.0, lambda: setattr(scene.imu, "drop", 2))
    assert verdict(scene.run()) == "passed"
    repeated_steps = [m for m in scene.events_of(Message) if m.id == "step_repeated"]
    assert [m.values["reason"] for m in repeated_steps] == ["gap"]


def test_imu_that_stops_sending_is_a_fault_after_limited_repeats(tick: float) -> None:
    scene = Scene()
    in_stage(scene, 1.0, lambda: setattr(scene.imu, "silent", True))
    ended = scene.run()
    assert ended.state is State.FAULT
    assert code(ended) == "stream.not_started"
    assert scene.table.commands[-2:] == ["stop", "disable"]


def test_saturation_repeats_the_step() -> None:
    scene = Scene()
    in_stage(scene, 1.0, lambda: setattr(scene.imu, "saturated", True))
    assert verdict(scene.run()) == "passed"
    assert [m.values["reason"] for m in scene.events_of(Message) if m.id == "step_repeated"] == ["saturated"]


@pytest.mark.parametrize(
    ("attribute", "value", "expected"),
    [
        ("fault", "drive", "table.latched_drive"),
        ("interlock", False, "motion.interlock_opened"),
        ("enabled", False, "motion.switched_off"),
        ("dead", True, "link.lost"),
    ],
)
def test_table_failure_is_a_fault_with_a_safe_stop(attribute: str, value: object, expected: str) -> None:
    scene = Scene()
    in_stage(scene, 1.0, lambda: setattr(scene.table, attribute, value))
    ended = scene.run()
    assert ended.state is State.FAULT
    assert code(ended) == expected
    assert scene.events_of(Fault)[0].exit_code == 3
    incomplete = [m for m in scene.events_of(Message) if m.id == "safe_stop_incomplete" and m.values.get("table")]
    assert bool(incomplete) == (attribute == "dead")
    if attribute != "dead":
        assert scene.table.commands[-2:] == ["stop", "disable"]


def test_safe_stop_attempts_every_step_after_any_failure() -> None:
    scene = Scene()

    def broken() -> None:
        raise TypeError("no descriptor")

    scene.table.stop = broken  # type: ignore[method-assign]
    assert safe_stop(scene.table, scene.clock) == [Text.of("os.other", words="no descriptor")]
    assert scene.table.commands == ["disable"]


def test_axes_are_not_switched_off_immediately_if_a_decelerating_table_stops_responding(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def silent() -> None:
        raise DeviceFaultError("motion.not_stopped")

    scene = Scene()
    switched_off: list[float] = []
    monkeypatch.setattr(scene.table, "status", silent)
    monkeypatch.setattr(scene.table, "disable", lambda: switched_off.append(scene.clock.now()))
    begun = scene.clock.now()
    assert len(safe_stop(scene.table, scene.clock)) == 1
    (at,) = switched_off
    assert at - begun >= 5.0


def test_stalled_move_times_out() -> None:
    scene = Scene()
    scene.table.stuck = True
    ended = scene.run()
    assert isinstance(ended.error, DeviceFaultError)
    assert ended.error.code == "motion.not_reached"


@pytest.mark.parametrize(
    ("break_it", "expected"),
    [
        (lambda s: setattr(s.imu, "serial", "SN-2"), "preflight.other_unit"),
        (lambda s: setattr(s.table, "watchdog", 0.0), "motion.watchdog_off"),
        (lambda s: setattr(s.table, "interlock", False), "motion.interlock_open"),
        (lambda s: setattr(s.imu, "sign", -1.0), "preflight.turn_size"),
        (lambda s: setattr(s.imu, "upside_down", True), "preflight.gravity_direction"),
        (lambda s: setattr(s.imu, "twist", 0.3), "preflight.turn_axis"),
        (
            lambda s: setattr(s.table, "on_move", lambda: setattr(s.imu, "silent", True)),
            "preflight.no_data_in_turn",
        ),
        (lambda s: setattr(s.imu, "ready_at", 1e6), "preflight.not_ready"),
    ],
)
def test_failed_preflight_check_is_a_fault(break_it: object, expected: str) -> None:
    scene = Scene()
    break_it(scene)  # type: ignore[operator]
    ended = scene.run()
    assert ended.state is State.FAULT
    assert code(ended) == expected
    assert states(scene) == ["preparing", "fault"]


def test_serial_number_that_does_not_match_the_pattern_is_refused() -> None:
    scene = Scene(serial="XX-1")
    scene.imu.serial = "XX-1"
    ended = scene.run()
    assert isinstance(ended.error, ConfigurationError)
    assert ended.error.code == "preflight.serial_pattern"


def test_unhomed_table_is_homed() -> None:
    scene = Scene()
    scene.table.homed = False
    assert verdict(scene.run()) == "passed"
    assert scene.table.commands[:2] == ["enable", "home"]


def test_table_is_prepared_and_checked_during_warm_up() -> None:
    def length(**warm_up: float) -> float:
        scene = Scene(**warm_up)
        assert verdict(scene.run()) == "passed"
        return float(next(e["station_time"] for e in scene.journal.events if e.get("state") == "running"))

    prepared = length()
    assert length(warm_up=0.5 * prepared) == prepared
    assert length(warm_up=prepared + 30.0) == pytest.approx(prepared + 30.0, abs=FakeClock.tick)


def test_temperature_slope_is_measured_at_rest_after_the_checks() -> None:
    scene, cold = Scene(warm_up=10.0, warm_up_slope=0.5), Scene()
    assert verdict(scene.run()) == "passed"
    cold.run()
    assert scene.clock.time > cold.clock.time + 19.0
    ids = [message.id for message in scene.events_of(Message)]
    assert ids.index("checking_mounting") < ids.index("warming_up")


def test_incorrectly_mounted_unit_is_refused_before_warm_up_ends() -> None:
    scene = Scene(warm_up=1000.0)
    scene.imu.upside_down = True
    assert code(scene.run()) == "preflight.gravity_direction"
    assert scene.clock.time < 100.0


def test_plan_outside_the_limits_is_refused_before_any_motion() -> None:
    scene = Scene(StagePlan("rate", lambda: iter([Move(30.0, 0.0, 0.5, 1.0)])))
    ended = scene.run()
    assert isinstance(ended.error, ConfigurationError)
    assert ended.error.code == "motion.target_outside"
    assert scene.table.commands == ["stop", "disable"]


@pytest.mark.parametrize(
    ("rule", "reason", "rounds"),
    [
        (StopRule(rounds=3), "rounds", 3),
        (StopRule(duration=4.5), "duration", 5),
        (StopRule(targets={"gyro_bias": 1e-2, "accel_scale_x": 1e-2}), "targets", None),
    ],
)
def test_repeated_plan_ends_by_its_stop_rule(rule: StopRule, reason: str, rounds: int | None) -> None:
    scene = Scene(repeated(rule))
    assert verdict(scene.run()) == "passed"
    (ended,) = scene.events_of(StageEnded)
    assert ended.reason == reason
    assert rounds is None or ended.rounds == rounds


def test_operator_ends_a_repeated_plan_after_the_current_move_and_rest() -> None:
    scene = Scene(repeated(StopRule(repeated=True)))
    in_stage(scene, 2.5, lambda: scene.control.send(Command.END_STAGE))
    assert verdict(scene.run()) == "passed"
    assert scene.events_of(StageStarted)[0].repeated
    (ended,) = scene.events_of(StageEnded)
    assert ended.reason == "operator"
    steps = [event.kind for event in scene.events_of(StepStarted) if event.stage == "excitation"]
    assert steps[-1] == "dwell"
    assert len(steps) <= 4


def test_plan_without_repetition_is_not_ended_by_the_operator() -> None:
    scene = Scene()
    in_stage(scene, 0.5, lambda: scene.control.send(Command.END_STAGE))
    assert verdict(scene.run()) == "passed"
    assert {event.reason for event in scene.events_of(StageEnded)} == {"plan"}
    assert not any(event.repeated for event in scene.events_of(StageStarted))


def test_progress_increases_to_one() -> None:
    scene = Scene()
    scene.run()
    fractions = [p.fraction for p in scene.events_of(StageProgress)]
    assert fractions == sorted(fractions)
    assert fractions[0] == 0.0
    assert fractions[-1] == pytest.approx(1.0)


def test_log_contains_all_events() -> None:
    scene = Scene()
    scene.run()
    kinds = [event["event"] for event in scene.journal.events]
    assert kinds.index("StageStarted") < kinds.index("StageEnded") < kinds.index("StageSolved")
    assert "TableMoved" not in kinds


def test_resumed_run_executes_only_the_remaining_stages() -> None:
    scene = Scene()
    first = scene.solving.finish()
    scene.run(solved=(first,))
    (started,) = scene.events_of(StageStarted)
    assert (started.index, started.count) == (1, 2)
    assert scene.solutions[0] is first
    assert len(scene.solutions) == 2


def test_step_numbers_of_a_resumed_run_continue() -> None:
    scene = Scene()
    scene.run(solved=(scene.solving.finish(),), after=LastSample(seq=5000, time=123.456, step=7))
    assert scene.journal.blocks[0].step[0] == 8


def test_resumed_run_without_remaining_stages_is_checked_and_finalized() -> None:
    scene = Scene()
    scene.task = replace(scene.task, stages=())
    assert verdict(scene.run(solved=(scene.solving.finish(),))) == "passed"
    assert any(m.id == "checking_mounting" for m in scene.events_of(Message))
    assert scene.finalized == 1


def test_stop_before_the_registers_are_written_stops_the_run() -> None:
    scene = Scene()
    finish = scene.solving.finish

    def solve() -> Solution:
        scene.control.send(Command.STOP)
        return finish()

    scene.solving.finish = solve  # type: ignore[method-assign]
    assert scene.run().state is State.STOPPED
    assert scene.finalized == 0
    assert scene.table.commands[-2:] == ["stop", "disable"]


def test_stop_during_the_transfer_waits_for_its_end_and_skips_verification() -> None:
    scene = Scene()
    transferred: list[bool] = []

    def transfer(run_in_background: RunInBackground) -> None:
        def write() -> None:
            scene.control.send(Command.STOP)
            while not scene.control.stopping:
                time.sleep(0.001)
            transferred.append(True)

        run_in_background(write)

    scene.transfer = transfer  # type: ignore[method-assign]
    assert scene.run().state is State.STOPPED
    assert transferred == [True]
    assert scene.proved == []
    assert "transfer_unproved" in [message.id for message in scene.events_of(Message)]
    assert scene.table.commands[-2:] == ["stop", "disable"]


def test_capture_of_the_restarted_unit_is_not_logged() -> None:
    scene = Scene()
    assert verdict(scene.run()) == "passed"
    (fresh,) = scene.proved
    ups = np.array(fresh.rests)[:, 3:] / GRAVITY
    assert np.allclose(np.abs(ups @ ups.T), [[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 1]], atol=1e-3)
    assert np.allclose(np.array(fresh.rests)[:, :3], 0.0, atol=1e-4)
    axes = np.array([turned.angle for turned in fresh.turns]) / (2.0 * np.pi)
    assert np.allclose(np.abs(axes), [[1, 0, 0], [0, 1, 0], [0, 0, 1]], atol=2e-3)
    assert fresh.reference is None
    assert not fresh.corrected
    logged = sum(len(block) for block in scene.journal.blocks)
    assert scene.clock.time * RATE - logged > 20.0 * RATE


def test_unit_with_corrected_output_is_captured_before_and_after() -> None:
    scene = Scene()
    scene.unit = replace(scene.unit, corrected=Output.ON_COMMAND)
    assert verdict(scene.run()) == "passed"
    (fresh,) = scene.proved
    assert fresh.corrected
    assert np.allclose(fresh.rests[:3], fresh.reference.rests, atol=1e-3)
    for own, before in zip(fresh.turns, fresh.reference.turns, strict=True):
        assert np.allclose(own.angle, before.angle, atol=1e-3)
    assert scene.imu.started[-2:] == [True, False], "the raw stream is on again afterwards"


@pytest.mark.parametrize("spoilt", [1, 2, 3])
def test_rotation_with_a_gap_is_repeated_from_its_start(spoilt: int) -> None:
    scene = Scene()
    moves: list[int] = []

    def drop() -> None:
        """Lose samples in the rotation to 180° and in each of its repetitions."""
        if scene.finalized:
            moves.append(len(scene.table.commands) - 1)
            turning = scene.table.commands[-1] == "move 180 0"
            if turning and scene.table.commands[moves[0] :].count("move 180 0") <= spoilt:
                scene.imu.drop = 2

    scene.table.on_move = drop
    ended = scene.run()
    moved = [words for words in scene.table.commands[moves[0] :] if words.startswith("move")]
    again = ["move 180 0", "move 90 0"] * spoilt
    if spoilt == 3:
        assert code(ended) == "stream.lossy"
        assert moved[1:] == again[:-1]
        assert scene.proved == []
        return
    assert verdict(ended) == "passed"
    assert moved[1 : 1 + len(again) + 1] == [*again, "move 180 0"]
    (fresh,) = scene.proved
    axes = np.array([turned.angle for turned in fresh.turns]) / (2.0 * np.pi)
    assert np.allclose(np.abs(axes), np.eye(3)[[0, 1, 2]], atol=2e-3)


def test_stop_during_the_verification_capture_reports_an_unverified_transfer() -> None:
    scene = Scene()

    def transfer(run_in_background: RunInBackground) -> None:
        scene.clock.scripts.append((scene.clock.time + 3.0, lambda: scene.control.send(Command.STOP)))

    scene.transfer = transfer  # type: ignore[method-assign]
    assert scene.run().state is State.STOPPED
    assert scene.proved == []
    messages = [message.id for message in scene.events_of(Message)]
    assert messages[-2:] == ["verifying", "transfer_unproved"]


def test_unit_without_registers_passes_if_within_limits() -> None:
    scene = Scene()
    scene.writes = False
    assert verdict(scene.run()) == "passed"
    assert scene.proved == []
    assert "verifying" not in [m.id for m in scene.events_of(Message)]
    assert ("verify",) not in [e.label for e in scene.events_of(StepStarted)]


def test_automatic_stop_reports_its_reason() -> None:
    scene = Scene()
    scene.clock.at(4.0, lambda: scene.control.send(Command.STOP, "listener_lost"))
    assert scene.run().state is State.STOPPED
    assert [m.values for m in scene.events_of(Message) if m.id == "stopped_because"] == [{"reason": "listener_lost"}]


def test_non_numeric_samples_are_invalid_and_their_step_is_repeated() -> None:
    scene = Scene()
    scene.clock.at(13.0, lambda: setattr(scene.imu, "nan", True))
    assert verdict(scene.run()) == "passed"
    assert [m.values["reason"] for m in scene.events_of(Message) if m.id == "step_repeated"] == ["invalid"]
    blocks = scene.solving.blocks["rate"]
    bad = [block for block in blocks if np.isnan(block.counts).any()]
    assert len(bad) == 1
    assert not bad[0].valid[np.isnan(bad[0].counts).any(axis=1)].any()


def test_channel_without_noise_is_reported_as_stuck() -> None:
    scene = Scene()
    noisy = replace(MODEL, gyro_arw=1e-7)  # one count of noise at 100 Hz
    scene.unit = replace(scene.unit, model=noisy)
    assert scene.run().state is State.FAULT
    (fault,) = scene.events_of(Fault)
    assert (fault.code, fault.values) == ("stream.stuck", {"channel": "gyro y"})
    assert scene.table.commands[-1] == "disable"


def test_unit_that_is_not_ready_is_not_reported_as_stuck() -> None:
    scene = Scene()
    scene.unit = replace(scene.unit, model=replace(MODEL, gyro_arw=1e-7))
    scene.imu.ready_at = 1e9
    assert scene.run().state is State.FAULT
    (fault,) = scene.events_of(Fault)
    assert fault.code == "preflight.not_ready"


def test_constant_float_channel_is_stuck_regardless_of_its_noise_in_counts() -> None:
    scene = Scene()
    scene.unit = replace(scene.unit, span=ChannelRange(step=np.zeros(6)))
    assert scene.run().state is State.FAULT
    (fault,) = scene.events_of(Fault)
    assert (fault.code, fault.values) == ("stream.stuck", {"channel": "gyro y"})


def test_non_numeric_output_is_reported_before_the_axes_are_switched_on() -> None:
    scene = Scene()
    scene.clock.at(1.0, lambda: setattr(scene.imu, "nan", True))
    assert scene.run().state is State.FAULT
    (fault,) = scene.events_of(Fault)
    assert fault.code == "preflight.non_numeric"
    assert "enable" not in scene.table.commands


def test_output_that_saturates_in_the_preflight_rotations_is_reported() -> None:
    scene = Scene()
    rest = GRAVITY / MODEL.accel_lsb
    turns = np.deg2rad(1.0) / MODEL.gyro_lsb
    scene.unit = replace(scene.unit, span=ChannelRange(high=np.array([turns] * 3 + [2.0 * rest] * 3)))
    assert scene.run().state is State.FAULT
    (fault,) = scene.events_of(Fault)
    assert fault.code == "preflight.saturated"
    assert scene.table.commands[-1] == "disable"


def test_implausible_gyro_rate_is_reported_before_any_rotation() -> None:
    scene = Scene()
    high = np.array([1.0, -0.1, 1.0])
    scene.unit = replace(scene.unit, preflight=replace(scene.unit.preflight, rate_high=high))
    assert scene.run().state is State.FAULT
    (fault,) = scene.events_of(Fault)
    assert (fault.code, fault.values["axis"]) == ("preflight.gyro_rate", "y")
    assert not scene.events_of(StageStarted)


def test_event_whose_log_entry_cannot_be_written_reaches_the_listener(monkeypatch: pytest.MonkeyPatch) -> None:
    """The log fails once, with the first rest; the window shows this step nevertheless, and then the fault."""
    scene, failed = Scene(), list[dict[str, object]]()
    event = scene.journal.event

    def fail_once(entry: dict[str, object]) -> None:
        if entry.get("kind") == "dwell" and entry.get("stage") and not failed:
            failed.append(entry)
            raise ConfigurationError("log.not_written", file="a.h5", reason="")
        event(entry)

    monkeypatch.setattr(scene.journal, "event", fail_once)
    ended = scene.run()
    assert (ended.state, code(ended)) == (State.FAULT, "log.not_written")
    assert [step.kind for step in scene.events_of(StepStarted) if step.stage][-1] == "dwell"
    assert states(scene)[-1] == "fault"
