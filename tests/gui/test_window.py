"""The window's frame: pages, names, languages, themes, role."""

import pytest
from PySide6.QtWidgets import QComboBox, QPushButton, QTabWidget, QWidget
from pytestqt.qtbot import QtBot

from calstation.gui.main_window import MainWindow

PAGES = ["operator_page", "engineer_page", "offline_page", "history_page", "station_page"]


def test_pages_stand_in_order_under_their_names(window: MainWindow) -> None:
    tabs = window.findChild(QTabWidget, "page_tabs")
    assert [tabs.widget(i).objectName() for i in range(tabs.count())] == PAGES


@pytest.mark.parametrize("page", PAGES)
def test_stop_is_on_every_page_in_the_same_place(window: MainWindow, qtbot: QtBot, page: str) -> None:
    tabs = window.findChild(QTabWidget, "page_tabs")
    stop = window.findChild(QPushButton, "stop_button")
    before = stop.mapTo(window, stop.rect().topLeft())
    tabs.setCurrentWidget(window.findChild(QWidget, page))
    qtbot.wait(1)
    assert stop.isVisible()
    assert stop.isEnabled()
    assert stop.mapTo(window, stop.rect().topLeft()) == before
    assert window.childAt(stop.mapTo(window, stop.rect().center())) is stop


def test_english_is_the_first_language(window: MainWindow) -> None:
    combo = window.findChild(QComboBox, "language_combo")
    assert combo.itemText(0) == "English"
