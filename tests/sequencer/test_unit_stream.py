"""A unit restarts unexpectedly in a stage and during a capture of its output."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calstation.sequencer import Command, Event, Message, Output, StageStarted, State
from tests.helpers import sampled
from tests.sequencer.fakes import Scene, verdict

#: Gain of the corrected gyros: a turn measured partly with each output would lie between.
GAIN = 1.01


def asked() -> Scene:
    """Return a scene with a unit that streams corrected output on command."""
    scene = Scene()
    scene.unit = replace(scene.unit, corrected=Output.ON_COMMAND)
    scene.imu.gain = GAIN
    return scene


def after(scene: Scene, kind: type[Event], delay: float, action: Callable[[], Any], ident: str = "") -> None:
    """Call `act` `delay` s after the first event of a type."""

    class Watched(list[Event]):
        armed = False

        def append(self, event: Event) -> None:
            super().append(event)
            if not self.armed and isinstance(event, kind) and getattr(event, "id", "") == ident:
                self.armed = True
                scene.clock.at(scene.clock.time + delay, action)

    scene.events = Watched()


def messages(scene: Scene) -> list[str]:
    return [message.id for message in scene.events_of(Message)]


def turned(data: Any) -> list[float]:
    """Return the measured rotations as fractions of the commanded rotations."""
    return [float(np.linalg.norm(t.angle) / abs(t.turn.amount)) for t in data.turns]


@pytest.mark.parametrize("mute", [False, True])
@pytest.mark.parametrize(
    "delay",
    [*(pytest.param(delay, marks=pytest.mark.exhaustive) for delay in (0.3, 2.0, 9.0, 14.0, 26.0, 32.0)), 5.0, 20.0],
)
def test_restart_during_the_capture_repeats_the_capture(delay: float, mute: bool) -> None:
    scene = asked()
    scene.imu.mute = mute
    after(scene, Message, delay, scene.imu.restart, "verifying")
    assert verdict(scene.run()) == "passed", scene.events[-3:]
    (fresh,) = scene.proved
    assert turned(fresh) == pytest.approx([GAIN] * 3, abs=2e-4)
    assert turned(fresh.reference) == pytest.approx([1.0] * 3, abs=2e-4)
    assert scene.imu.started[-3:] == [True, True, False]
    assert messages(scene).count("look_repeated") <= 1


@pytest.mark.parametrize("mute", [False, True])
def test_a_restart_before_the_transfer_repeats_the_capture(mute: bool) -> None:
    scene = asked()
    scene.imu.mute = mute

    def read_registers(run_in_background: Any) -> None:
        scene.clock.at(scene.clock.time + 9.0, scene.imu.restart)

    scene.read_registers = read_registers  # type: ignore[method-assign]
    assert verdict(scene.run()) == "passed", scene.events[-3:]
    (fresh,) = scene.proved
    assert turned(fresh.reference) == pytest.approx([1.0] * 3, abs=2e-4)
    assert messages(scene).index("look_repeated") < messages(scene).index("verifying")


def test_repeated_restarts_are_a_fault_without_a_verification() -> None:
    scene = asked()

    def again() -> None:
        scene.imu.restart()
        scene.clock.at(scene.clock.time + 9.0, again)

    after(scene, Message, 9.0, again, "verifying")
    ended = scene.run()
    assert ended.state is State.FAULT
    assert ended.error.code == "stream.restarts_after_write"
    assert scene.proved == []
    assert messages(scene).count("look_repeated") == 3
    assert messages(scene)[-1] == "transfer_unproved"
    assert scene.table.commands[-2:] == ["stop", "disable"]


def test_unit_that_is_not_ready_after_a_restart_is_a_fault() -> None:
    scene = asked()

    def again() -> None:
        scene.imu.restart()
        scene.clock.at(scene.clock.time + 0.8, again)

    after(scene, Message, 9.0, again, "verifying")
    assert scene.run().error.code == "stream.restarts"


def test_frames_lost_in_a_capture_do_not_repeat_the_capture() -> None:
    scene = asked()
    after(scene, Message, 9.0, lambda: setattr(scene.imu, "drop", 2), "verifying")
    assert verdict(scene.run()) == "passed"
    assert "look_repeated" not in messages(scene)
    assert turned(scene.proved[0]) == pytest.approx([GAIN] * 3, abs=2e-4)
    assert scene.imu.started[-3:] == [True, True, False]


@pytest.mark.parametrize(("delay", "babble"), sampled(3, [0.5, 4.0, 7.0], [False, True]))
def test_unit_that_streams_on_command_is_commanded_again_after_a_restart(delay: float, babble: bool) -> None:
    scene = Scene()
    scene.imu.mute, scene.imu.babble = True, babble
    after(scene, StageStarted, delay, scene.imu.restart)
    assert verdict(scene.run()) == "passed", scene.events[-3:]
    assert [m.values["reason"] for m in scene.events_of(Message) if m.id == "step_repeated"] == ["no_data"]
    assert scene.imu.started[:1] == [False]


def test_step_is_not_repeated_before_the_unit_is_ready() -> None:
    scene = Scene()

    def restart() -> None:
        scene.imu.restart()
        scene.imu.ready_at = scene.clock.time + 30.0

    after(scene, StageStarted, 1.0, restart)
    assert verdict(scene.run()) == "passed"
    blocks = scene.solving.blocks["rate"]
    times = np.concatenate([block.time for block in blocks])
    valid = np.concatenate([block.valid for block in blocks])
    assert not valid[(times > scene.imu.ready_at - 29.0) & (times < scene.imu.ready_at)].any()


def test_unit_power_cycled_during_a_pause_streams_again_after_it() -> None:
    scene = Scene()
    scene.imu.mute = True

    def pause() -> None:
        scene.control.send(Command.PAUSE)
        scene.clock.at(scene.clock.time + 20.0, scene.imu.restart)
        scene.clock.at(scene.clock.time + 40.0, lambda: scene.control.send(Command.RESUME))

    after(scene, StageStarted, 1.0, pause)
    assert verdict(scene.run()) == "passed", scene.events[-3:]


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"deaf": True}, "stream.no_answer"),
        ({"serial": "SN-2"}, "preflight.other_unit"),
        ({"silent": True}, "stream.not_started"),
    ],
)
def test_unit_that_does_not_respond_after_a_restart_is_a_fault(change: dict[str, Any], code: str) -> None:
    scene = Scene()
    scene.imu.mute = True

    def restart() -> None:
        scene.imu.restart()
        for name, value in change.items():
            setattr(scene.imu, name, value)

    after(scene, StageStarted, 1.0, restart)
    ended = scene.run()
    assert ended.state is State.FAULT
    assert ended.error.code == code
    assert scene.table.commands[-2:] == ["stop", "disable"]


def test_stop_does_not_wait_for_an_unresponsive_unit() -> None:
    scene = Scene()
    scene.imu.mute = True

    def wake(check_cancelled: Callable[[], None], *, corrected: bool = False) -> None:
        scene.control.send(Command.STOP)
        while True:
            check_cancelled()

    scene.imu.wake = wake  # type: ignore[method-assign, assignment]
    after(scene, StageStarted, 1.0, scene.imu.restart)
    assert scene.run().state is State.STOPPED
    assert scene.table.commands[-2:] == ["stop", "disable"]


def test_table_fault_does_not_wait_for_an_unresponsive_unit() -> None:
    scene = Scene()
    scene.imu.mute = True

    def wake(check_cancelled: Callable[[], None], *, corrected: bool = False) -> None:
        scene.table.dead = True
        while True:
            check_cancelled()

    scene.imu.wake = wake  # type: ignore[method-assign, assignment]
    after(scene, StageStarted, 1.0, scene.imu.restart)
    ended = scene.run()
    assert ended.state is State.FAULT
    assert "Port FAKE was lost (no answer)" in str(ended.error)
