"""STOP and Esc while a dialog or a popup is open during a run; `test_desktop` runs this file."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QFileDialog, QLineEdit, QPushButton, QWidget
from pytestqt.qtbot import QtBot

from calstation.gui.shell.main_window import MainWindow
from calstation.gui.widgets import ThemedPlot, proposed_file
from calstation.sequencer import Command
from tests.gui.desktop import click_at, press_key


class RunningEngine:
    """An engine that records commands and does not end."""

    ended, alive = False, True

    def __init__(self) -> None:
        self.commands: list[Command] = []

    def send(self, command: Command) -> None:
        self.commands.append(command)

    def poll(self) -> list[object]:
        return []

    def close(self) -> None:
        pass


class Bystander:
    """Opens dialogs and popups in a window with a run in progress, with real keys and clicks."""

    def __init__(self, window: MainWindow, qtbot: QtBot) -> None:
        self.window, self.qtbot, self.app = window, qtbot, window.app
        self.engine = RunningEngine()
        self.app.role.set_first_pin("246813")

    def run(self) -> None:
        """Continue with a run in progress."""
        self.engine.commands.clear()
        self.app.engine_link._engine = self.engine  # type: ignore[assignment]
        self.app.run.state = "running"
        self.app.run.changed.emit()

    def stopped(self) -> bool:
        """Whether STOP has been sent, once."""
        return self.engine.commands == [Command.STOP] and self.app.run.state == "stopping"

    def until(self, condition: Callable[[], object]) -> None:
        self.qtbot.waitUntil(lambda: bool(condition()), timeout=10_000)

    def click(self, widget: QWidget, button: int = 1) -> None:
        """Click with the mouse on a widget."""
        at = widget.mapToGlobal(widget.rect().center())
        click_at(at.x(), at.y(), button)

    @property
    def dialog(self) -> QFileDialog | None:
        """The open file dialog."""
        return next((d for d in self.window.findChildren(QFileDialog) if d.isVisible()), None)


#: The page and the button of each dialog that a button opens without a log or a run.
BUTTONS = {
    "engineer_page": "open_result_button",
    "offline_page": "log_open_button",
    "quality_page": "study_open_button",
    "station_page": "runs_folder_button",
}


def open_by_button(user: Bystander, page: str) -> None:
    """Open a dialog with its button."""
    user.window.show_page(page)
    button = user.window.findChild(QPushButton, BUTTONS[page])
    assert isinstance(button, QPushButton)
    user.until(button.isEnabled)
    button.click()


@pytest.fixture
def user(window: MainWindow, qtbot: QtBot) -> Iterator[Bystander]:
    made = Bystander(window, qtbot)
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow, timeout=10_000)
    yield made
    made.app.run.state = "idle"
    made.app.engine_link._engine = None


def check_dialog(user: Bystander, page: str, *, by_key: bool) -> None:
    """Open a dialog during a run, stop the run, and close the dialog."""
    user.run()
    if page == "plot":
        plot = user.window.findChild(ThemedPlot)
        assert isinstance(plot, ThemedPlot)
        proposed_file(plot, "plot.png").write_bytes(b"")
        plot.menu._ask_file()
    else:
        open_by_button(user, page)
    user.until(lambda: user.dialog is not None and user.dialog.isActiveWindow())
    dialog = user.dialog
    assert dialog is not None
    assert dialog.windowModality() is Qt.WindowModality.NonModal, page
    if page == "plot":  # its question about the existing file must not block either
        press_key("Return")
        user.until(lambda: any(b.isVisible() for b in dialog.findChildren(QPushButton, "replace_file_button")))
    assert QApplication.activeModalWidget() is None, page
    if by_key:
        press_key("Escape")
    else:
        user.click(user.window.stop_button)
    user.until(user.stopped)
    assert dialog.isVisible(), "the first Esc only stops"
    dialog.activateWindow()
    user.until(dialog.isActiveWindow)
    press_key("Escape")
    user.until(lambda: user.dialog is None)
    assert user.stopped()


def test_stop_and_esc_work_while_any_dialog_is_open(user: Bystander, tmp_path: Path) -> None:
    for page in (*BUTTONS, "plot"):
        check_dialog(user, page, by_key=True)
        check_dialog(user, page, by_key=False)
    assert {plot.read_bytes() for plot in tmp_path.glob("*plot.png")} == {b""}


def test_stop_and_esc_work_while_a_popup_is_open(user: Bystander) -> None:
    user.window.show_page("offline_page")
    log_edit = user.window.findChild(QLineEdit, "log_edit")
    assert isinstance(log_edit, QLineEdit)
    popups: dict[str, Callable[[], object]] = {
        "menu of a field": lambda: user.click(log_edit, 3),
        "list": lambda: user.click(user.window.language_combo),
    }
    for open_popup in popups.values():
        for by_key in (True, False):
            user.run()
            user.qtbot.wait(QApplication.doubleClickInterval() + 50)  # the clicks are single ones
            open_popup()
            user.until(lambda: QApplication.activePopupWidget() is not None)
            user.qtbot.wait(100)
            if by_key:
                press_key("Escape")
            else:
                user.click(user.window.stop_button)
            user.until(user.stopped)
            popup = QApplication.activePopupWidget()
            if popup is not None:
                popup.close()
