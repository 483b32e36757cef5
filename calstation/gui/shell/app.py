"""Starts the window: application, style, language, theme."""

import signal
import sys
from pathlib import Path

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication, QMainWindow

from calstation.gui.shell.context import AppContext
from calstation.gui.shell.main_window import MainWindow
from calstation.gui.text import language
from calstation.gui.widgets import theme

#: Between two chances to hear Ctrl-C, ms.
_HEAR_EVERY = 200


def create_window(station: Path | None = None) -> QMainWindow:
    """The main window for a station file, the virtual bench by default; makes the QApplication where there is none."""
    app = QApplication.instance() or QApplication(sys.argv[:1])
    assert isinstance(app, QApplication)
    app.setApplicationName("calstation")
    if not app.styleSheet():  # else it is dressed already, and dressing every widget anew takes long
        app.setStyle("Fusion")
    app.setFont(theme.font())
    context = AppContext(station)
    dark = QGuiApplication.styleHints().colorScheme() == Qt.ColorScheme.Dark
    theme.apply(str(context.settings.value("theme", "dark" if dark else "light")))
    language.use(str(context.settings.value("language", language.system_language())))
    return MainWindow(context)


def main(station: Path | None = None) -> int:
    """Open the window and return when it is closed. Ctrl-C in its terminal stops a run safely, then closes it."""
    window = create_window(station)
    assert isinstance(window, MainWindow)
    signal.signal(signal.SIGINT, lambda number, frame: window.stop_and_close())
    hearing = QTimer(window)  # Python hears signals only between its own lines
    hearing.timeout.connect(lambda: None)
    hearing.start(_HEAR_EVERY)
    window.show()
    return QApplication.exec()
