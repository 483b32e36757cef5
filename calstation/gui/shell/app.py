"""Creation of the application and its main window, with style, language and theme."""

import signal
import sys
from pathlib import Path
from typing import cast

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication

from calstation.gui.shell.exchange import RecordsExchange
from calstation.gui.shell.main_window import MainWindow
from calstation.gui.state import AppContext
from calstation.gui.text import language
from calstation.gui.widgets import theme


def create_window(station: Path | None = None) -> MainWindow:
    """Create the main window for a station file, by default the last one, and the QApplication if there is none."""
    app = cast("QApplication", QApplication.instance() or QApplication(sys.argv[:1]))
    app.setApplicationName("calstation")
    if not app.styleSheet():  # setting the style again would polish every widget, which is slow
        app.setStyle("Fusion")
    app.setFont(theme.font())
    context = AppContext(station)
    RecordsExchange(context)
    dark = QGuiApplication.styleHints().colorScheme() == Qt.ColorScheme.Dark
    theme.apply(str(context.settings.value("theme", "dark" if dark else "light")))
    language.use(str(context.settings.value("language", language.system_language())))
    return MainWindow(context)


def main(station: Path | None = None) -> int:
    """Open the window and wait until it is closed; Ctrl-C in the terminal stops a run safely, then closes it."""
    window = create_window(station)
    signal.signal(signal.SIGINT, lambda number, frame: window.stop_and_close())
    signal_timer = QTimer(window, interval=200)  # Python runs its signal handlers between events
    signal_timer.timeout.connect(lambda: None)
    signal_timer.start()
    window.show()
    return QApplication.exec()
