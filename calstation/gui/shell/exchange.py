"""Exchange of the runs folder with the shared database while the window is open."""

from PySide6.QtCore import QObject, QTimer

from calstation.database import ExchangeProcess, start_exchange
from calstation.errors import CalstationError
from calstation.gui.state import AppContext

#: Time between two readings of the state of the exchange, ms.
_READ_MS = 1000


class RecordsExchange(QObject):
    """Maintains the exchange process of the current station and runs folder, and reads its state for the pages."""

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
