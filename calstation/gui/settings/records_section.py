"""The database and the archive shared by stations."""

from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.fields import EDITOR, Field, Section, folder_row, panel
from calstation.gui.state import AppContext, ExchangeLabel
from calstation.gui.text import on_language_change, rendered, say
from calstation.gui.widgets import WordEdit, column, label, row, show_text, theme
from calstation.messages import local_time

#: Width of the input of a URL, px.
_URL = EDITOR + 14 * theme.GRID


class RecordsSection(Section):
    """Edits `[records]` in the draft of a station."""

    def __init__(self, app: AppContext, draft: Draft) -> None:
        super().__init__(draft)
        self._app = app
        self._status = label(name="exchange_status_label", wrap=True)
        left = column(
            label("settings.shared_records", "section"),
            Field(draft, ("records", "database"), WordEdit(), width=_URL),
            Field(draft, ("records", "archive"), WordEdit(), width=_URL),
            folder_row("archive_browse_button", draft, ("records", "archive")),
            None,
        )
        waiting = ExchangeLabel(app)
        waiting.setWordWrap(True)
        about = label("setting.about_password", "muted", wrap=True, selectable=True)
        right = panel(about, self._status, waiting, spacing=2 * theme.GRID)
        row(left, (right, 1), on=self, spacing=3 * theme.GRID)
        app.exchange_changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def refresh(self) -> None:
        """Show the time of the last contact with the database, and the errors of the exchange and of the archive."""
        state = self._app.exchange_state
        lines = []
        if state is not None:
            contact = state.contact_utc
            when = "" if contact is None else local_time(contact.isoformat())
            lines.append(say("settings.last_exchange", time=when) if when else say("settings.not_exchanged"))
            for error in (state.error_text, state.refusal_text, state.archive_error_text):
                if error is not None:
                    lines += [rendered(error).text, rendered(error).remedy]
        show_text(self._status, "\n".join(lines))
