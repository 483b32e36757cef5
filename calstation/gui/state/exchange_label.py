"""Runs and logs that are pending for the shared database and for the archive."""

from datetime import datetime

from PySide6.QtWidgets import QLabel

from calstation.database import ExchangeState
from calstation.gui.state.context import AppContext
from calstation.gui.text import on_language_change, say
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
        self.setToolTip("\n".join(say(error) for error in errors if error is not None))

    def _runs(self, state: ExchangeState) -> str:
        count, since = state.pending, state.contact_utc
        if state.error is None or not count:
            return ""
        waiting = "one_run" if count == 1 else "runs"
        if since is None:
            return say(f"window.waiting_{waiting}", count=count)
        today = since.astimezone().date() == datetime.now().astimezone().date()
        since_text = f"{since.astimezone():%H:%M}" if today else local_time(since.isoformat())
        return say(f"window.waiting_{waiting}_since", count=count, since=since_text)

    def _logs(self, state: ExchangeState) -> str:
        count = state.logs_pending
        if state.archive_error is None or not count:
            return ""
        return say("window.one_log_waits" if count == 1 else "window.logs_wait", count=count)
