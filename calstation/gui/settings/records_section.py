"""The database and the archive shared by stations."""

from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFileDialog

from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.fields import EDITOR, Field, Row, Section, WordEdit, panel
from calstation.gui.state import AppContext, ExchangeLabel
from calstation.gui.text import on_language_change, rendered, say
from calstation.gui.widgets import button, column, label, row, show_text, theme
from calstation.messages import local_time

_ARCHIVE = ("records", "archive")
#: Width of the input of a URL, px.
_URL = EDITOR + 14 * theme.GRID


class RecordsSection(Section):
    """Edits `[records]` in the draft of a station."""

    def __init__(self, app: AppContext, draft: Draft) -> None:
        super().__init__()
        self._app, self._draft = app, draft
        self._status = label(name="exchange_status_label", wrap=True)
        about = label("setting.about_password", "muted", wrap=True)
        about.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        left = column(
            label("settings.shared_records", "section"),
            Field(draft, ("records", "database"), WordEdit(), width=_URL),
            Field(draft, _ARCHIVE, WordEdit(), width=_URL),
            Row(button("archive_browse_button", "settings.choose_folder", self._choose_folder)),
            None,
        )
        waiting = ExchangeLabel(app)
        waiting.setWordWrap(True)
        right = panel(about, self._status, waiting, spacing=2 * theme.GRID)
        row(left, (right, 1), on=self, spacing=3 * theme.GRID)
        app.exchange_changed.connect(self._show_status)
        on_language_change(self, self._show_status)

    def _show_status(self) -> None:
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

    def _choose_folder(self) -> None:
        present = str(self._draft.value(_ARCHIVE) or "")
        folder = QFileDialog.getExistingDirectory(self, say("setting.archive"), present)
        if folder:
            self._draft.set({_ARCHIVE: str(Path(folder))})
