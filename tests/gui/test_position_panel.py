"""The position guide for a manual rig: state symbol, instruction, position count, and progress ring during a rest."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from PySide6.QtGui import QImage
from pytestqt.qtbot import QtBot

from calstation.config import RunRequest, library
from calstation.gui.operator import OperatorPage
from calstation.gui.operator.live.live_view import Preparation
from calstation.gui.operator.live.position_panel import PositionPanel
from calstation.gui.shell.main_window import MainWindow
from calstation.gui.text import language
from calstation.gui.widgets import theme
from calstation.physics import axis_rotation
from calstation.runs import RunSummary, run_summary
from calstation.sequencer import Command, PositionGuided, StageStarted, StateChanged, StepStarted
from tests.gui.conftest import Operator

X, Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
SIXTY = float(np.deg2rad(60.0))


@pytest.fixture(scope="module")
def planned() -> RunSummary:
    request = RunRequest("SN-1", library.find("stations", "virtual_hand"), library.find("products", "mems_hand"))
    return run_summary(request)


@pytest.fixture
def panel(qtbot: QtBot, planned: RunSummary) -> Iterator[PositionPanel]:
    theme.apply("light")
    made = PositionPanel()
    qtbot.addWidget(made)
    made.resize(1000, 520)
    made.set_run(planned)
    made.show()
    yield made
    language.use("en")


def guided(
    state: str, index: int = 4, rest: float = 0.0, *, suffices: bool = False, stage: str = "multi_position"
) -> PositionGuided:
    """Return an event of a unit rotated about the inner rail in 60° steps; positions before `index` are complete."""
    poses = [(0.0, k * SIXTY) for k in range(index)]
    ups = [(axis_rotation(X, outer) @ axis_rotation(Y, inner))[2] for outer, inner in poses]
    at = ups[-2] if state == "enough" else ups[-1]
    return PositionGuided(
        stage,
        index,
        38,
        state,
        rest,
        7.0,
        *poses[-1],
        *poses[-2],
        tuple(map(float, at)),
        tuple(float(v) for up in ups[:-1] for v in up),
        suffices,
    )


def picture(panel: PositionPanel) -> QImage:
    return panel.picture.grab().toImage()


def painted(image: QImage, colour: str) -> int:
    """Return the number of pixels of exactly this colour."""
    wanted = int(colour.removeprefix("#"), 16) | 0xFF000000
    pixels = np.frombuffer(image.convertToFormat(QImage.Format.Format_RGB32).constBits(), np.uint32)
    return int(np.count_nonzero((pixels | 0xFF000000) == wanted))


@pytest.mark.parametrize(
    ("state", "word", "chinese"),
    [
        ("waiting", "Waiting", "等待中"),
        ("moving", "Moving", "转动中"),
        ("still", "At rest", "静止中"),
        ("enough", "Next position", "下一个位置"),
        ("repeat", "Moved too soon", "动得太早"),
    ],
)
def test_every_state_has_a_text_in_both_languages(
    panel: PositionPanel, qtbot: QtBot, state: str, word: str, chinese: str
) -> None:
    panel.show_position(guided(state))
    assert panel.badge.text() == word
    assert panel.count_label.text() == "position 4 of 38"
    language.use("zh_CN")
    qtbot.waitUntil(lambda: panel.badge.text() == chinese, timeout=30_000)
    assert panel.count_label.text() == "第 4 个位置，共 38 个"


def test_every_state_has_a_distinct_shape(panel: PositionPanel) -> None:
    shapes = set()
    for state in ("waiting", "moving", "still", "enough", "repeat"):
        panel.show_position(guided(state))
        shapes.add(panel.badge._icon._kind)
    assert len(shapes) == 5


def test_instruction_states_the_rail_to_rotate_and_the_waiting_time(panel: PositionPanel) -> None:
    panel.show_position(guided("enough"))
    assert panel.task_label.text() == "Turn the inner rail to about 180°."
    panel.show_position(guided("still", rest=4.2))
    assert panel.task_label.text() == "Hands off. 3 s left."
    panel.show_position(guided("repeat"))
    assert panel.task_label.text() == "Hands off for 7 s."


def test_rails_are_rotated_one_at_a_time(panel: PositionPanel) -> None:
    def take(outer: float) -> str:
        event = guided("moving", 2)
        up = tuple(map(float, axis_rotation(X, outer)[2]))
        panel.show_position(PositionGuided(**{**event.__dict__, "outer": SIXTY, "up": up}))
        return panel.task_label.text()

    assert take(0.0) == "Turn the outer rail to about 60°."
    assert take(0.9 * SIXTY) == "Turn the inner rail to about 60°."


def test_progress_ring_fills_during_a_rest(panel: PositionPanel) -> None:
    accent, good = theme.colours().accent, theme.colours().good
    ring = []
    for rest in (0.0, 3.5, 7.0):
        panel.show_position(guided("still", rest=rest))
        ring.append(painted(picture(panel), accent))
    assert ring[0] < ring[1] < ring[2]
    assert ring[2] - ring[1] == pytest.approx(ring[1] - ring[0], rel=0.1)
    assert painted(picture(panel), good) == 0
    panel.show_position(guided("enough"))
    assert painted(picture(panel), good) > ring[2] - ring[0] - 500


def test_drawn_attitude_follows_gravity(panel: PositionPanel) -> None:
    panel.show_position(guided("enough", 2))
    for share in np.linspace(0.0, 1.0, 7):
        event = guided("moving", 2)
        up = axis_rotation(Y, share * SIXTY)[2]
        panel.show_position(PositionGuided(**{**event.__dict__, "up": tuple(map(float, up))}))
    attitude = panel.picture._attitude
    assert attitude @ up == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert attitude == pytest.approx(axis_rotation(Y, SIXTY), abs=1e-9)


def test_no_instruction_is_shown_between_last_position_and_verification(panel: PositionPanel) -> None:
    panel.show_position(guided("enough", suffices=True))
    panel.finish_stage()
    assert panel.badge.text() == "All positions done"
    assert "Leave the unit alone" in panel.task_label.text()
    assert not panel.finish_button.isVisible()
    panel.show_position(guided("enough", 2, stage=""))
    assert panel.task_label.text() == "Turn the inner rail to about 60°."


@pytest.mark.parametrize(
    ("code", "keep", "done"),
    [
        ("en", "Leave both rails where they are.", "All positions done"),
        ("zh_CN", "两个导轨都保持原位。", "全部位置已完成"),
    ],
)
def test_verification_requests_no_completed_rotation(panel: PositionPanel, code: str, keep: str, done: str) -> None:
    language.use(code)
    turn = replace(guided("enough", 2, stage=""), count=2)
    panel.show_position(replace(turn, index=1, state="waiting", inner=0.0, done=()))
    assert panel.task_label.text() == keep
    panel.show_position(turn)
    assert "60°" in panel.task_label.text()
    panel.show_position(replace(turn, done=(*X, *Y)))
    assert panel.badge.text() == done


def test_upside_down_unit_is_drawn(panel: PositionPanel) -> None:
    event = guided("moving", 2)
    panel.show_position(PositionGuided(**{**event.__dict__, "up": (0.0, 0.0, -1.0)}))
    assert panel.picture._attitude[2] == pytest.approx([0.0, 0.0, -1.0])
    assert not picture(panel).isNull()


def test_stage_can_be_finished_after_enough_positions(panel: PositionPanel, qtbot: QtBot) -> None:
    panel.show_position(guided("moving"))
    assert not panel.finish_button.isEnabled()
    assert "not sufficient" in panel.finish_button.toolTip()
    panel.show_position(guided("moving", suffices=True))
    with qtbot.waitSignal(panel.finish_requested):
        panel.finish_button.click()
    assert not panel.finish_button.isEnabled()
    panel.show_position(guided("moving", 2, stage=""))
    assert not panel.finish_button.isVisible()
    assert panel.count_label.text() == "check 2 of 38"


def test_operator_page_shows_the_guide_on_a_manual_rig(
    operator: Operator, window: MainWindow, planned: RunSummary, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = window.findChild(OperatorPage)
    assert page is not None
    page._loading.set_next_run(planned)
    assert page._loading.rails.isVisibleTo(page._loading)
    assert "operator are simulated" in operator.says()
    run, link = window.app.run, window.app.engine_link
    monkeypatch.setattr(type(link), "running", property(lambda self: True))
    sent: list[Command] = []
    monkeypatch.setattr(link, "send", sent.append)
    run.run_summary = planned
    page._live.position.set_run(planned)
    link.event.emit(StateChanged("preparing", "idle"))
    operator.until(lambda: any(shown.isVisible() for shown in window.findChildren(Preparation)))
    assert "Homing" not in operator.says()
    assert "The unit is identified." in operator.says()
    link.event.emit(StateChanged("running", "preparing"))
    link.event.emit(StageStarted("multi_position", 0, 1, 400.0))
    link.event.emit(guided("enough", suffices=True))
    operator.until(lambda: page._live.position.isVisible())
    assert "Turn the inner rail to about 180°." in operator.says()
    link.event.emit(StepStarted("multi_position", 3, "carry", ("carry", 0.0, 180.0)))
    operator.until(lambda: operator.message == "Multi-position")
    assert not page._live.table.isVisible()
    operator.press("finish_positions_button")
    assert sent == [Command.END_STAGE]


@pytest.mark.parametrize(
    ("code", "state", "badge", "task"),
    [
        ("en", "paused", "PAUSED", "Paused."),
        ("zh_CN", "paused", "已暂停", "已暂停。"),
        ("en", "stopping", "STOPPING", "Stopping."),
        ("en", "stopped", "STOPPING", "Stopping."),  # until the result is stored
        ("zh_CN", "stopped", "正在停止", "正在停止。"),
    ],
)
def test_paused_or_stopped_run_commands_no_rotation(
    panel: PositionPanel, code: str, state: str, badge: str, task: str
) -> None:
    language.use(code)
    panel.show_position(guided("moving"))
    moving = panel.task_label.text()
    panel.show_state(state)
    panel.show_position(guided("moving"))
    assert panel.badge.text() == badge
    assert panel.task_label.text().startswith(task)
    assert not panel.finish_button.isVisible()
    panel.show_state("running")
    assert panel.task_label.text() == moving
