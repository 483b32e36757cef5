"""All files being edited: one draft per file, so that a form and a text never tell different stories of it."""

from pathlib import Path

from PySide6.QtCore import QObject, QSettings, Signal

from calstation.config import editing as settings
from calstation.config import library, versions
from calstation.config.user import computer_user
from calstation.gui.settings.draft import Draft


class Drafts(QObject):
    """The station's draft, its table's, and those of the files opened as text.

    `changed` is told when any of them changes; `saved(kind)` when a file of a kind has been stored.
    """

    changed = Signal()
    saved = Signal(str)

    def __init__(self, window_settings: QSettings, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._settings = window_settings
        self.station = self._new("stations")
        self.table = self._new("tables")
        self._others: list[Draft] = []

    def of(self, kind: str, path: Path) -> Draft:
        """The draft of a file, opened where nobody has yet."""
        for draft in (self.station, self.table, *self._others):
            if draft.kind == kind and draft.path == path:
                return draft
        draft = self._new(kind)
        self._others.append(draft)
        draft.open(path)
        return draft

    @property
    def dirty(self) -> list[Draft]:
        """Those with something typed that is not stored."""
        return [draft for draft in (self.station, self.table, *self._others) if draft.dirty]

    @property
    def wrong(self) -> list[Draft]:
        """Those of them that cannot be stored as they are."""
        return [draft for draft in self.dirty if draft.problems]

    def discard(self) -> None:
        """Back to what is stored, everywhere."""
        for draft in self.dirty:
            draft.discard()

    @property
    def author(self) -> str:
        """Who stands in the versions: the name given on this page, else the user of this computer."""
        given = str(self._settings.value("author", "")).strip()
        return given or who_saves()

    def save(self) -> None:
        """Store all that has been typed as the site's own files, each as a new version.

        Raises ConfigurationError with the first reason why one cannot be stored; those before it are.
        """
        for draft in self.dirty:
            name = self.stored_name(draft)
            versions.save(draft.kind, name, draft.text, self.author)
            draft.open(library.find(draft.kind, name))
            self.saved.emit(draft.kind)

    def stored_name(self, draft: Draft) -> str:
        """The name under which a draft is stored in the site's folder.

        A file from elsewhere becomes a file of the site, under a name of its own where its name is taken.
        """
        name = draft.name
        if name not in library.names(draft.kind) or library.find(draft.kind, name) == draft.path:
            return name
        numbered = (f"{name}-{number}" for number in range(2, 1000))
        return next(free for free in numbered if free not in library.names(draft.kind))

    def create(self, kind: str, name: str, source: Path) -> Path:
        """A new file from a copy; a new station is called like its file. Gives its path.

        Raises ConfigurationError where the name is taken or no name.
        """
        text = settings.read_text(source)
        if kind == "stations":
            text = settings.edited(text, {("name",): name})
        versions.save(kind, settings.new_name(kind, name), text, self.author)
        self.saved.emit(kind)
        return library.find(kind, name)

    def _new(self, kind: str) -> Draft:
        draft = Draft(kind, self)
        draft.changed.connect(self.changed)
        return draft


def who_saves() -> str:
    """The user of this computer, "engineer" where it does not tell."""
    return computer_user() or "engineer"
