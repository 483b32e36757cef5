"""Creation of the application and its main window, and the exchange of records while the window is open."""

import sys
from pathlib import Path
from typing import cast

from PySide6.QtCore import QObject, Qt, QTimer
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication

from calstation.database import ExchangeProcess, start_exchange
from calstation.errors import CalstationError
from calstation.gui.shell.garbage import collect_in_this_thread
from calstation.gui.shell.main_window import MainWindow
from calstation.gui.state import AppContext
from calstation.gui.text import language
from calstation.gui.widgets import theme

#: Interval at which the state of the exchange is read, ms.
_READ_MS = 1000


class RecordsExchange(QObject):
    """Runs the exchange process of the current station and runs folder, and reads its state for the pages."""

    def __init__(self, app: AppContext) -> None:
        super().__init__(app)
        self._app = app
        self._process: ExchangeProcess | None = None
        app.station_changed.connect(self._restart)
        app.runs_folder_changed.connect(self._restart)
        app.claim_changed.connect(self._claim)
        app.closing.connect(self._close)
        self._timer = QTimer(self, interval=_READ_MS)
        self._timer.timeout.connect(self._read)
        self._restart()

    def _restart(self) -> None:
        self._end()
        try:
            self._process = start_exchange(self._app.station_path, self._app.runs_folder, self._app.claimed)
        except CalstationError:  # the pages show the error in the station file
            self._process = None
        if self._process is not None:
            self._timer.start()
        else:
            self._timer.stop()
        self._read()

    def _claim(self) -> None:
        if self._process is not None:
            self._process.claim(self._app.claimed)

    def _read(self) -> None:
        state = None if self._process is None else self._process.state()
        if state != self._app.exchange_state:
            self._app.exchange_state = state
            self._app.exchange_changed.emit()

    def _end(self) -> None:
        if self._process is not None:
            self._process.end()
            self._process = None

    def _close(self) -> None:
        self._timer.stop()
        self._end()


def create_window(station: Path | None = None) -> MainWindow:
    """Create the main window, by default for the station that was used last, and the QApplication if there is none."""
    app = cast("QApplication", QApplication.instance() or QApplication(sys.argv[:1]))
    app.setApplicationName("calstation")
    collect_in_this_thread(app)
    if not app.styleSheet():  # setting the style again would slowly polish every widget
        app.setStyle("Fusion")
    app.setFont(theme.font())
    context = AppContext(station)
    RecordsExchange(context)
    dark = QGuiApplication.styleHints().colorScheme() == Qt.ColorScheme.Dark
    theme.apply(str(context.settings.value("theme", "dark" if dark else "light")))
    language.use(str(context.settings.value("language", language.system_language())))
    return MainWindow(context)
