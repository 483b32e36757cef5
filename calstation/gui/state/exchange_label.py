"""Runs and logs that are pending for the shared database and for the archive."""

from datetime import datetime

from PySide6.QtWidgets import QLabel

from calstation.database import ExchangeState
from calstation.gui.state.context import AppContext
from calstation.gui.text import on_language_change, show
from calstation.gui.widgets import show_text, theme
from calstation.messages import local_time


class ExchangeLabel(QLabel):
    """A line that is hidden unless runs or logs are pending because of an error, which the tooltip shows."""

    def __init__(self, app: AppContext) -> None:
        super().__init__()
        self.setObjectName("exchange_label")
        self._app = app
        theme.set_kind(self, "caution")
        app.exchange_changed.connect(self._refresh)
        on_language_change(self, self._refresh)

    def _refresh(self) -> None:
        state = self._app.exchange_state
        show_text(self, "" if state is None else "  ·  ".join(filter(None, (self._runs(state), self._logs(state)))))
        errors = () if state is None else (state.error_text, state.archive_error_text)
        self.setToolTip("\n".join(show(error) for error in errors if error is not None))

    def _runs(self, state: ExchangeState) -> str:
        count, since = state.pending, state.contact_utc
        if state.error is None or not count:
            return ""
        if since is None:
            text = self.tr("1 run waits for the database") if count == 1 else self.tr("{0} runs wait for the database")
            return text.format(count)
        text = self.tr("{0} runs wait for the database since {1}")
        if count == 1:
            text = self.tr("1 run waits for the database since {1}")
        today = since.astimezone().date() == datetime.now().astimezone().date()
        return text.format(count, f"{since.astimezone():%H:%M}" if today else local_time(since.isoformat()))

    def _logs(self, state: ExchangeState) -> str:
        count = state.logs_pending
        if state.archive_error is None or not count:
            return ""
        text = self.tr("1 log waits for the archive") if count == 1 else self.tr("{0} logs wait for the archive")
        return text.format(count)
