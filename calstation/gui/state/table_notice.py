"""The notice that the table may still move after a safe stop that failed, with the button that resets its fault."""

from PySide6.QtWidgets import QWidget

from calstation.config import load_station
from calstation.connection import LinkTestRequest
from calstation.gui.state.context import AppContext
from calstation.gui.state.reset_bar import ResetBar
from calstation.gui.widgets import NoticeBar, column, theme


class TableNotice(QWidget):
    """Says on every page that the table may still move, until its fault has been reset; `prefix` is of its names."""

    def __init__(self, app: AppContext, prefix: str, parent: QWidget) -> None:
        super().__init__(parent)  # without it, the notice would be shown as a window
        self._app = app
        self._notice = NoticeBar(f"{prefix}table_notice")
        self.reset = ResetBar(app, self._request, f"{prefix}table_reset_button")
        theme.set_kind(self.reset.button, "primary")
        column(self._notice, self.reset, on=self, spacing=theme.GRID, margins=(2 * theme.GRID, 0, 2 * theme.GRID, 0))
        self._notice.ask("bad", "operator.table_unsafe", "operator.table_unsafe_do")
        app.run.stop_incomplete_changed.connect(self._show)
        self._show(app.run.stop_incomplete)

    def _show(self, incomplete: bool) -> None:
        self.reset.clear()
        self.reset.offer(incomplete)
        self.setVisible(incomplete)

    def _request(self) -> LinkTestRequest:
        """Return the request for the table of the station. Raises ConfigurationError if its file cannot be read."""
        return LinkTestRequest(load_station(self._app.station_path)[1], self._app.product_path)
