"""A run that will fail is announced on the operator page with its reason, and can be ended there."""

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFrame, QLabel, QPushButton

from calstation.messages import Text
from calstation.sequencer import Command, Message, StageEnded, StageStarted, StateChanged
from tests.gui.conftest import Operator
from tests.gui.test_operator_events import end_run, simulated_run

__all__ = ["simulated_run"]  # fixture
WHY = Text.of("event.inconsistent", stage="rate", value=3.2, limit=1.1)


@pytest.fixture
def sent(simulated_run: Operator, monkeypatch: pytest.MonkeyPatch) -> list[Command]:
    """Commands that the window sends to the engine."""
    commands: list[Command] = []
    monkeypatch.setattr(simulated_run.window.app.engine_link, "send", commands.append)
    return commands


def fail(operator: Operator) -> None:
    """Emit the events of a run whose first stage is inconsistent."""
    for event in (
        StateChanged("running", "preparing"),
        StageStarted("six_position", 1, 4, 60.0),
        Message("will_fail", {"why": WHY}),
    ):
        operator.window.app.engine_link.event.emit(event)
    operator.until(lambda: operator.widget("failing_notice", QFrame).isVisible())


@pytest.mark.long
def test_reason_is_stated_and_the_run_is_ended(simulated_run: Operator, sent: list[Command]) -> None:
    operator = simulated_run
    fail(operator)
    notice = "\n".join(text.text() for text in operator.widget("failing_notice").findChildren(QLabel))
    assert "even if every sigma reaches its target; “Events” shows why." in notice
    assert "residuals" not in notice + operator.message, "figures for experts"
    operator.window.app.set_language("zh_CN")
    assert "本次标定将判为不合格" in operator.says()
    assert "即使标准差全部达标，以后的阶段也无法改变；原因见“事件”。" in operator.says()
    operator.window.app.set_language("en")
    operator.qtbot.keyClick(operator.window.focusWidget() or operator.window, Qt.Key.Key_Return)
    assert sent == []  # Enter of a scan ends nothing
    operator.press("end_failing_choice")
    assert sent == [Command.END_FAILING]
    operator.window.app.engine_link.event.emit(StageEnded("six_position", "failing", 0))
    operator.until(lambda: operator.run.stage is None)
    end_run(operator, "failed")
    assert not operator.widget("failing_notice", QFrame).isVisible()


def test_run_is_continued_and_not_asked_again(simulated_run: Operator, sent: list[Command]) -> None:
    fail(simulated_run)
    assert simulated_run.widget("stay_choice", QPushButton).text() == "Do not end"
    simulated_run.press("stay_choice")
    assert simulated_run.window.focusWidget() is simulated_run.window.operator_page
    simulated_run.window.app.engine_link.event.emit(StageStarted("excitation", 2, 4, 60.0))
    simulated_run.qtbot.wait(50)
    assert not simulated_run.widget("failing_notice", QFrame).isVisible()
    assert sent == []
