"""The button that resets a latched fault of the table, and the notice that it must be reset."""

from collections.abc import Callable

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QSizePolicy, QWidget

from calstation.config import load_station
from calstation.connection import LinkTestRequest, TableReset, reset_table
from calstation.errors import CalstationError
from calstation.gui.state.context import AppContext
from calstation.gui.text import fault_text, on_language_change, say, term
from calstation.gui.widgets import NoticeBar, StateIcon, button, column, enable, label, row, show_text, theme
from calstation.messages import Rendered
from calstation.sequencer import Fault


class ResetBar(QWidget):
    """A bar with a button that resets a latched fault of the table, and with the result of the reset.

    `request` returns the link of the table, or None if there is none, and `name` is the object name of the button.
    Signals: `changed()` when a reset starts and after it has ended; `ended(result)` with a `TableReset`.
    """

    changed = Signal()
    ended = Signal(object)

    def __init__(self, app: AppContext, request: Callable[[], LinkTestRequest | None], name: str) -> None:
        super().__init__()
        self._app, self._request = app, request
        self.offered = False  #: Whether the button is shown.
        self.result: TableReset | None = None
        self._error: CalstationError | None = None
        self.button = button(name, "window.reset_fault", self._start)
        self.button.setSizePolicy(QSizePolicy.Policy.Maximum, QSizePolicy.Policy.Fixed)
        self._icon, self.result_label = StateIcon(18), label(name=f"{name}_result", wrap=True)
        done, failed = self._finish, lambda error: self._finish(error=error)
        self.watch = app.job(self, reset_table, done, failed=failed, cancelled=done, cancellable=False)
        column(self.button, row(self._icon, (self.result_label, 1)), on=self)
        app.engine_link.running_changed.connect(self._running_changed)
        on_language_change(self, self._show)

    def offer(self, offered: bool) -> None:
        """Show or hide the button; the result of the last reset remains visible."""
        self.offered = offered
        self._show()

    def clear(self) -> None:
        """Clear the result of the last reset."""
        self.result = self._error = None
        self._show()

    def _start(self) -> None:
        self.clear()
        try:
            request = self._request()
        except CalstationError as error:
            self._finish(error=error)
            return
        if request is None or self._app.engine_link.running or self.watch.busy:
            return
        self.watch.start(request)
        self._show()
        self.changed.emit()

    def _running_changed(self, running: bool) -> None:
        """Cancel a waiting reset when a run starts."""
        if running:
            self.watch.cancel()
        self._show()

    def _finish(self, result: TableReset | None = None, error: CalstationError | None = None) -> None:
        self.result, self._error = result, error
        if result is not None:
            self.offered = not result.clear
            if result.clear:
                self._app.run.set_stop_incomplete(False)
                self._app.run.set_unreset(None)
        self._show()
        self.changed.emit()
        if result is not None:
            self.ended.emit(result)

    def _show(self) -> None:
        running = self._app.engine_link.running
        self.button.setVisible(self.offered)
        enable(self.button, say("window.reset_after_run") if running else "", say("window.reset_tip"))
        self.button.setEnabled(not (running or self.watch.busy))
        kind, text = self._result_text()
        self._icon.setVisible(bool(kind))
        self._icon.set_kind(kind)
        show_text(self.result_label, text)
        self.setVisible(self.offered or bool(text))

    def _result_text(self) -> tuple[str, str]:
        """Return the badge shape and the text of the reset in progress or, if there is none, of the last one."""
        if self.watch.busy:
            return "", say("window.asking_table")
        if self._error is not None:
            return "bad", say(self._error.as_text)
        if (result := self.result) is None:
            return "", ""
        return "good" if result.clear else "bad", say(
            f"reset.{result.outcome}",
            latched=term("latched", result.latched or ""),
            left=term("latched", result.left or ""),
            words=result.words,
        )


class TableNotice(QWidget):
    """Says on every page that the fault of the table must be reset, or that the table may still move until then.

    `prefix` is the beginning of the object names.
    """

    def __init__(self, app: AppContext, prefix: str, parent: QWidget) -> None:
        super().__init__(parent)  # without a parent, the notice would be shown as a window
        self._app = app
        self._notice = NoticeBar(f"{prefix}table_notice")
        self.reset = ResetBar(app, self._request, f"{prefix}table_reset_button")
        theme.set_kind(self.reset.button, "primary")
        column(self._notice, self.reset, on=self, spacing=theme.GRID, margins=(2 * theme.GRID, 0, 2 * theme.GRID, 0))
        self._shown: tuple[bool, Fault | None] = (False, None)
        self.hide()
        app.run.changed.connect(self._refresh)
        app.role.changed.connect(self._notice.refresh)
        self._refresh()

    def _refresh(self) -> None:
        run = self._app.run
        state = run.stop_incomplete, run.unreset
        if state == self._shown:
            return
        self._shown = state
        self.reset.clear()
        self.reset.offer(any(state))
        if run.stop_incomplete:
            self._notice.ask("bad", "operator.table_unsafe", "operator.table_unsafe_do")
        elif (fault := run.unreset) is not None:
            self._notice.ask("caution", lambda: self._text(fault).text, lambda: self._text(fault).remedy)
        self.setVisible(any(state))

    def _text(self, fault: Fault) -> Rendered:
        return fault_text(fault, engineer=self._app.role.engineer)

    def _request(self) -> LinkTestRequest:
        """Return the request for the table of the station. Raises ConfigurationError if its file cannot be read."""
        return LinkTestRequest(load_station(self._app.station_path)[1], self._app.product_path)
