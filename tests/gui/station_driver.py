"""Drives the Station page as a user does, in the window or alone."""

from typing import Any, TypeVar

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QComboBox, QLabel, QLineEdit, QPushButton, QVBoxLayout, QWidget
from pytestqt.qtbot import QtBot

from calstation.gui.settings import StationPage
from calstation.gui.state import AppContext

PIN = "246813"


class PageDriver:
    """Operate the page as a user does, in the window or alone."""

    def __init__(self, root: QWidget, page: StationPage, qtbot: QtBot) -> None:
        self.root, self.page, self.app, self._bot = root, page, page.app, qtbot

    def find(self, kind: type, name: str) -> Any:
        """Return the widget with a name; of several, the visible one."""
        widgets = self.root.findChildren(kind, name)
        assert widgets, name
        return next((widget for widget in widgets if widget.isVisible()), widgets[0])

    def show_section(self, section: int) -> None:
        """Choose a section."""
        self.page.nav.setCurrentRow(section)

    def show_view(self, title: str) -> None:
        """Click the tab of a form, the text or the comparison of the current file."""
        bar = self.page.profiles.views.tabBar()
        index = next(i for i in range(bar.count()) if bar.tabText(i) == title and bar.isTabVisible(i))
        self._bot.mouseClick(bar, Qt.MouseButton.LeftButton, pos=bar.tabRect(index).center())

    def type(self, name: str, text: str) -> None:
        """Replace the text of an input."""
        edit = self.find(QLineEdit, name)
        edit.setFocus()
        edit.selectAll()
        self._bot.keyClick(edit, Qt.Key.Key_Delete)
        self._bot.keyClicks(edit, text)

    def choose(self, name: str, words: str) -> None:
        """Choose an entry of a combo box, as a click does."""
        box = self.find(QComboBox, name)
        index = box.findText(words, Qt.MatchFlag.MatchStartsWith)
        assert index >= 0, [box.itemText(i) for i in range(box.count())]
        box.setCurrentIndex(index)
        box.activated.emit(index)

    def press(self, name: str) -> None:
        """Press a button."""
        button = self.find(QPushButton, name)
        assert button.isEnabled(), button.toolTip()
        self._bot.mouseClick(button, Qt.MouseButton.LeftButton)

    def copy_station(self, name: str) -> None:
        """Create a station with hardware."""
        self.press("new_station_button")
        self.type("new_name_edit", name)
        self.press("make_file_button")

    def message(self, field: str) -> str:
        """Return the message below an input."""
        label = self.find(QLabel, f"{field}_message")
        return str(label.text())

    def findings(self, device: str) -> list[str]:
        """Wait for a connection test; return the sentences of its findings."""
        links = {"table": self.page.table_link, "chamber": self.page.chamber_link, "imu": self.page.imus.link}
        panel = links[device].test
        self._bot.waitUntil(lambda: panel.report is not None, timeout=60_000)
        labels = panel._lines.findChildren(QLabel)
        return [label.text() for label in labels if label.text()]


Driver = TypeVar("Driver", bound=PageDriver)


def station_page(app: AppContext, site_folder: Any, qtbot: QtBot, driver: type[Driver]) -> Driver:
    """Return a driver of the page alone below its header, in the role of an operator."""
    site_folder.write(surveyed=False)
    page = StationPage(app)
    root = QWidget()
    column = QVBoxLayout(root)
    assert page.header is not None
    column.addWidget(page.header)
    column.addWidget(page, 1)
    qtbot.addWidget(root)
    root.resize(1366, 700)
    root.show()
    qtbot.waitExposed(root)
    return driver(root, page, qtbot)
