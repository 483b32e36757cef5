"""Bound texts follow the language and are removed with their widgets."""

from collections.abc import Iterator

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QGroupBox, QLabel, QPushButton
from pytestqt.qtbot import QtBot

from calstation.gui.text import bind, language, on_language_change
from calstation.gui.widgets import Cell, CellTable, EmptyState, ViewTabs, button, combo_box, label
from calstation.messages import Text


@pytest.fixture(autouse=True)
def english(qapp: QApplication) -> Iterator[None]:
    yield
    language.use("en")


def test_bound_texts_follow_the_language(qtbot: QtBot) -> None:
    text, press, box = QLabel(), QPushButton(), QGroupBox()
    for widget in (text, press, box):
        qtbot.addWidget(widget)
    seen: list[str] = []
    bind(text, language.current)
    bind(press.setToolTip, language.current)
    bind(box, language.current)
    on_language_change(text, lambda: seen.append(language.current()))
    language.use("zh_CN")
    assert (text.text(), press.toolTip(), box.title()) == ("zh_CN",) * 3
    language.use("en")
    assert (text.text(), press.toolTip(), box.title()) == ("en",) * 3
    assert seen == ["en", "zh_CN", "en"]


def test_deleted_widget_is_no_longer_updated(qtbot: QtBot) -> None:
    deleted = QLabel()
    calls: list[str] = []

    def text() -> str:
        calls.append(language.current())
        return language.current()

    bind(deleted, text)
    deleted.deleteLater()
    qtbot.waitUntil(lambda: not __import__("shiboken6").isValid(deleted))
    language.use("zh_CN")
    language.use("en")
    assert calls == ["en"]


def test_labels_with_codes_and_messages_follow_the_language(qtbot: QtBot) -> None:
    save, left = button("save", "common.save", tip="common.copy"), label(Text.of("common.time_left", time="1:15"))
    for widget in (save, left):
        qtbot.addWidget(widget)
    assert (save.text(), save.toolTip(), left.text()) == ("Save", "Copy", "1:15 left")
    language.use("zh_CN")
    assert (save.text(), save.toolTip(), left.text()) == ("保存", "复制", "剩余 1:15")


def test_items_tabs_headings_and_empty_states_follow_the_language(qtbot: QtBot) -> None:
    combo, tabs = (
        combo_box("periods", {None: "history.any_time", 1: "history.today"}),
        ViewTabs("views", "common.cycle"),
    )
    empty, table = EmptyState(title="history.no_runs_yet"), CellTable("cells", columns=(Cell("common.unit", "unit"),))
    for widget in (combo, tabs, empty, table):
        qtbot.addWidget(widget)

    def texts() -> tuple[str, ...]:
        heading = table.parameters.headerData(0, Qt.Orientation.Horizontal)
        return combo.itemText(0), combo.itemText(1), tabs.tabText(0), empty.title, heading

    assert texts() == ("Any time", "Today", "Cycle", "Every run will be listed here", "Unit")
    with qtbot.waitSignal(table.parameters.headerDataChanged):
        language.use("zh_CN")
    assert texts() == ("不限时间", "今天", "节拍", "每次标定都会列在这里", "单位")
    assert [combo.itemData(k) for k in (0, 1)] == [None, 1]


def test_unknown_code_is_an_error_at_once(qtbot: QtBot) -> None:
    with pytest.raises(KeyError, match=r"common\.nonsense"):
        label("common.nonsense")
