"""Tooltips explain stages, checks and columns in both languages."""

from collections.abc import Iterator

import pytest
from PySide6.QtCore import QEvent, QPoint
from PySide6.QtGui import QHelpEvent
from PySide6.QtWidgets import QApplication, QListWidget, QToolTip, QWidget
from pytestqt.qtbot import QtBot

from calstation.gui.operator import FiguresTable
from calstation.gui.text import about, language
from calstation.gui.widgets import ChecksTable
from calstation.messages import catalogue
from calstation.results import Result
from tests.check_rows import check_row
from tests.gui.conftest import Operator, result_with

LANGUAGES = ("en", "zh_CN")
CHECKS = [check_row("effects", "excitation", 40.0, 30.0, passed=False)]


@pytest.fixture(autouse=True)
def english(qapp: QApplication) -> Iterator[None]:
    yield
    language.use("en")


def tooltip(widget: QWidget, at: QPoint) -> str:
    """Return the tooltip that appears while the mouse rests on a point of a widget."""
    QToolTip.hideText()
    event = QHelpEvent(QEvent.Type.ToolTip, at, widget.mapToGlobal(at))
    QApplication.sendEvent(widget, event)
    return QToolTip.text()


def result() -> Result:
    return result_with(checks=CHECKS)


@pytest.mark.parametrize(
    ("code", "check", "margin"), [("en", "g-sensitivity", "negative"), ("zh_CN", "灵敏度", "超限")]
)
def test_checks_and_their_columns_are_explained(qtbot: QtBot, code: str, check: str, margin: str) -> None:
    table = ChecksTable()
    qtbot.addWidget(table)
    table.resize(1200, 200)
    table.show()
    language.use(code)
    table.show_checks(result().checks)
    first = table.visualRect(table.model().index(0, 0)).center()
    assert check in tooltip(table.viewport(), first)
    header = table.horizontalHeader()
    at = QPoint(header.sectionViewportPosition(5) + 5, header.height() // 2)
    assert margin in tooltip(header.viewport(), at)


def test_figures_of_a_verdict_are_explained(qtbot: QtBot) -> None:
    figures = FiguresTable()
    qtbot.addWidget(figures)
    figures.show_result(result())
    tips = {label.toolTip() for label in figures.findChildren(QWidget)}
    assert about("check", "effects") in tips


def test_stages_are_explained(operator: Operator) -> None:
    stages = operator.widget("stage_list", QListWidget)
    for code, words in zip(LANGUAGES, ("scale factors of the gyros", "陀螺刻度系数"), strict=True):
        operator.window.app.set_language(code)
        assert words in tooltip(stages.viewport(), stages.visualItemRect(stages.item(0)).center())


def test_every_check_and_every_stage_has_an_explanation() -> None:
    kinds = {code.partition(".")[2] for code in catalogue.family("check_short")} - {"other"}
    stages = {code.partition(".")[2] for code in catalogue.family("stage")}
    missing = [("check", kind) for kind in kinds if not about("check", kind)]
    missing += [("stage", stage) for stage in stages if not about("stage", stage)]
    assert missing == []
