"""Exchange of the runs folder with the database that stations share, while the window is open."""

from PySide6.QtCore import QObject

from calstation.database import ExchangeProcess, start_exchange
from calstation.errors import CalstationError
from calstation.gui.shell.context import AppContext


class RecordsExchange(QObject):
    """Keeps the exchange process of the present station and runs folder."""

    def __init__(self, app: AppContext) -> None:
        super().__init__(app)
        self._app = app
        self._process: ExchangeProcess | None = None
        self._ended: list[ExchangeProcess] = []
        app.station_changed.connect(self._restart)
        app.runs_folder_changed.connect(self._restart)
        app.closing.connect(self._close)
        self._restart()

    def _restart(self) -> None:
        self._end()
        try:
            self._process = start_exchange(self._app.station_path, self._app.runs_folder)
        except CalstationError:  # the pages show what is wrong with the station file
            self._process = None

    def _end(self) -> None:
        if self._process is not None:
            self._process.end()
            self._ended.append(self._process)
            self._process = None

    def _close(self) -> None:
        self._end()
        while self._ended:
            self._ended.pop().close()
