"""Bound texts follow the language and are removed with their widgets."""

from PySide6.QtWidgets import QGroupBox, QLabel, QPushButton
from pytestqt.qtbot import QtBot

from calstation.gui.text import language
from calstation.gui.text.binding import bind, on_language_change


def test_bound_texts_follow_the_language(qtbot: QtBot) -> None:
    label, button, box = QLabel(), QPushButton(), QGroupBox()
    for widget in (label, button, box):
        qtbot.addWidget(widget)
    seen: list[str] = []
    bind(label, language.current)
    bind(button.setToolTip, language.current)
    bind(box, language.current)
    on_language_change(label, lambda: seen.append(language.current()))
    try:
        language.use("zh_CN")
        assert (label.text(), button.toolTip(), box.title()) == ("zh_CN",) * 3
    finally:
        language.use("en")
    assert (label.text(), button.toolTip(), box.title()) == ("en",) * 3
    assert seen == ["en", "zh_CN", "en"]


def test_deleted_widget_is_no_longer_updated(qtbot: QtBot) -> None:
    label = QLabel()
    calls: list[str] = []

    def text() -> str:
        calls.append(language.current())
        return language.current()

    bind(label, text)
    label.deleteLater()
    qtbot.waitUntil(lambda: not __import__("shiboken6").isValid(label))
    try:
        language.use("zh_CN")
    finally:
        language.use("en")
    assert calls == ["en"]
