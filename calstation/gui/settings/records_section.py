"""The database and the archive that a station shares with others."""

from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFileDialog

from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.fields import EDITOR, Field, Row, Section, WordEdit, panel
from calstation.gui.text import say
from calstation.gui.widgets import button, column, label, row, theme

_ARCHIVE = ("records", "archive")
#: Width of the input of a URL, px.
_URL = EDITOR + 14 * theme.GRID


class RecordsSection(Section):
    """Edits `[records]` in the draft of a station."""

    def __init__(self, draft: Draft) -> None:
        super().__init__()
        self._draft = draft
        about = label(lambda: say("setting.about_password"), "muted", wrap=True)
        about.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        left = column(
            label(lambda: self.tr("Shared records"), "section"),
            Field(draft, ("records", "database"), WordEdit(), width=_URL),
            Field(draft, _ARCHIVE, WordEdit(), width=_URL),
            Row(button("archive_browse_button", lambda: self.tr("Choose a folder"), self._choose_folder)),
            None,
        )
        row(left, (panel(about), 1), on=self, spacing=3 * theme.GRID)

    def _choose_folder(self) -> None:
        present = str(self._draft.value(_ARCHIVE) or "")
        folder = QFileDialog.getExistingDirectory(self, self.tr("Archive of logs"), present)
        if folder:
            self._draft.set({_ARCHIVE: str(Path(folder))})
