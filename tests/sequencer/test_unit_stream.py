"""A unit that restarts by itself, in a stage and while its output is looked at, and what is told of it."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calstation.sequencer.control import Command
from calstation.sequencer.events import Event, Message, StageStarted
from calstation.sequencer.states import State
from calstation.sequencer.task import Output
from tests.sequencer.fakes import Scene

#: Of the corrected gyros: a turn that was made of both outputs would be somewhere between.
GAIN = 1.01


def asked() -> Scene:
    """A unit whose corrected output must be asked for."""
    scene = Scene()
    scene.task = replace(scene.task, corrected=Output.ASKED)
    scene.imu.gain = GAIN
    return scene


def behind(scene: Scene, kind: type[Event], delay: float, action: Callable[[], Any], ident: str = "") -> None:
    """Act `delay` s behind the first event of a kind."""

    class Watched(list[Event]):
        armed = False

        def append(self, event: Event) -> None:
            super().append(event)
            if not self.armed and isinstance(event, kind) and getattr(event, "id", "") == ident:
                self.armed = True
                scene.clock.at(scene.clock.time + delay, action)

    scene.events = Watched()


def told(scene: Scene) -> list[str]:
    return [message.id for message in scene.told(Message)]


def turned(data: Any) -> list[float]:
    """Whole turns that were measured, by their size."""
    return [float(np.linalg.norm(t.angle)) / (2.0 * np.pi) for t in data.turns]


@pytest.mark.parametrize("mute", [False, True])
@pytest.mark.parametrize("delay", [0.3, 2.0, 5.0, 9.0, 14.0, 20.0, 26.0, 32.0])
def test_one_that_restarts_while_it_is_looked_at_is_looked_at_from_the_beginning(
    delay: float, mute: bool
) -> None:
    scene = asked()
    scene.imu.mute = mute
    behind(scene, Message, delay, scene.imu.restart, "verifying")
    assert scene.run().state is State.PASSED, scene.events[-3:]
    (fresh,) = scene.proved
    assert turned(fresh) == pytest.approx([GAIN] * 3, abs=2e-4)
    assert turned(fresh.reference) == pytest.approx([1.0] * 3, abs=2e-4)
    assert scene.imu.started[-3:] == [True, True, False]
    assert told(scene).count("look_repeated") <= 1


@pytest.mark.parametrize("mute", [False, True])
def test_one_that_restarts_before_its_registers_are_written_is_looked_at_again(mute: bool) -> None:
    scene = asked()
    scene.imu.mute = mute

    def finalize(*of: Any) -> Any:
        scene.clock.at(scene.clock.time + 9.0, scene.imu.restart)
        return Scene._finalize(scene, *of)

    scene._finalize = finalize  # type: ignore[method-assign]
    assert scene.run().state is State.PASSED, scene.events[-3:]
    (fresh,) = scene.proved
    assert turned(fresh.reference) == pytest.approx([1.0] * 3, abs=2e-4)
    assert told(scene).index("look_repeated") < told(scene).index("verifying")


def test_one_that_restarts_again_and_again_is_told_and_nothing_is_judged() -> None:
    scene = asked()

    def again() -> None:
        scene.imu.restart()
        scene.clock.at(scene.clock.time + 9.0, again)

    behind(scene, Message, 9.0, again, "verifying")
    ended = scene.run()
    assert ended.state is State.FAULT
    assert str(ended.error).startswith("IMU: it restarted while its new registers were looked at; ")
    assert scene.proved == []
    assert told(scene).count("look_repeated") == 3
    assert told(scene)[-1] == "transfer_unproved"
    assert scene.table.told[-2:] == ["stop", "disable"]


def test_one_that_is_never_ready_again_is_told() -> None:
    scene = asked()

    def again() -> None:
        scene.imu.restart()
        scene.clock.at(scene.clock.time + 0.8, again)

    behind(scene, Message, 9.0, again, "verifying")
    assert "it restarts again and again; check its supply" in str(scene.run().error)


def test_frames_lost_in_a_look_cost_no_look_and_its_kind_is_asked_for_again() -> None:
    scene = asked()
    behind(scene, Message, 9.0, lambda: setattr(scene.imu, "drop", 2), "verifying")
    assert scene.run().state is State.PASSED
    assert "look_repeated" not in told(scene)
    assert turned(scene.proved[0]) == pytest.approx([GAIN] * 3, abs=2e-4)
    assert scene.imu.started[-3:] == [True, True, False]


@pytest.mark.parametrize("babble", [False, True])
@pytest.mark.parametrize("delay", [0.5, 4.0, 7.0])
def test_one_that_streams_only_when_told_is_told_again_in_mid_run(delay: float, babble: bool) -> None:
    scene = Scene()
    scene.imu.mute, scene.imu.babble = True, babble
    behind(scene, StageStarted, delay, scene.imu.restart)
    assert scene.run().state is State.PASSED, scene.events[-3:]
    assert [m.values["reason"] for m in scene.told(Message) if m.id == "step_repeated"] == ["no_data"]
    assert scene.imu.started[:1] == [False]


def test_a_step_is_not_repeated_before_the_unit_is_ready() -> None:
    scene = Scene()

    def restart() -> None:
        scene.imu.restart()
        scene.imu.ready_at = scene.clock.time + 30.0

    behind(scene, StageStarted, 1.0, restart)
    assert scene.run().state is State.PASSED
    blocks = scene.solving.blocks["rate"]
    times = np.concatenate([block.time for block in blocks])
    valid = np.concatenate([block.valid for block in blocks])
    assert not valid[(times > scene.imu.ready_at - 29.0) & (times < scene.imu.ready_at)].any()


def test_one_that_was_switched_off_in_a_pause_streams_again_behind_it() -> None:
    scene = Scene()
    scene.imu.mute = True

    def pause() -> None:
        scene.control.send(Command.PAUSE)
        scene.clock.at(scene.clock.time + 20.0, scene.imu.restart)
        scene.clock.at(scene.clock.time + 40.0, lambda: scene.control.send(Command.RESUME))

    behind(scene, StageStarted, 1.0, pause)
    assert scene.run().state is State.PASSED, scene.events[-3:]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"deaf": True}, "no data any more, and the unit does not answer either; check its power"),
        ({"serial": "SN-2"}, "answers to serial number 'SN-2', not 'SN-1'; check the unit"),
        ({"silent": True}, "no data any more though it was told to stream; switch it off and on"),
    ],
)
def test_one_that_does_not_come_back_is_told(change: dict[str, Any], words: str) -> None:
    scene = Scene()
    scene.imu.mute = True

    def restart() -> None:
        scene.imu.restart()
        for name, value in change.items():
            setattr(scene.imu, name, value)

    behind(scene, StageStarted, 1.0, restart)
    ended = scene.run()
    assert ended.state is State.FAULT
    assert words in str(ended.error)
    assert scene.table.told[-2:] == ["stop", "disable"]


def test_a_stop_does_not_wait_for_a_unit_that_does_not_answer() -> None:
    scene = Scene()
    scene.imu.mute = True

    def wake(check_cancelled: Callable[[], None], *, corrected: bool = False) -> None:
        scene.control.send(Command.STOP)
        while True:
            check_cancelled()

    scene.imu.wake = wake  # type: ignore[method-assign, assignment]
    behind(scene, StageStarted, 1.0, scene.imu.restart)
    assert scene.run().state is State.STOPPED
    assert scene.table.told[-2:] == ["stop", "disable"]


def test_a_table_that_fails_meanwhile_does_not_wait_for_it_either() -> None:
    scene = Scene()
    scene.imu.mute = True

    def wake(check_cancelled: Callable[[], None], *, corrected: bool = False) -> None:
        scene.table.dead = True
        while True:
            check_cancelled()

    scene.imu.wake = wake  # type: ignore[method-assign, assignment]
    behind(scene, StageStarted, 1.0, scene.imu.restart)
    ended = scene.run()
    assert ended.state is State.FAULT
    assert "table: no answer" in str(ended.error)
