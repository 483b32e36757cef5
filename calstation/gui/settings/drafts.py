"""The drafts of configuration files: the stored text, the edited text, and its problems."""

import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from PySide6.QtCore import QObject, Signal

from calstation.config import Confirmation, editing, library, versions
from calstation.errors import ConfigurationError
from calstation.gui.widgets import FormValues
from calstation.messages import Text
from calstation.parsing import parse_toml
from calstation.schema import KeyPath, Problem, value_at


class Draft(FormValues):
    """The draft of a file of a kind, such as ``stations`` or ``products``, checked after every change.

    A file that is not valid TOML has no data: its fields remain empty until its text is corrected.
    """

    def __init__(self, kind: str, parent: QObject | None = None) -> None:
        super().__init__({}, parent=parent)
        self.kind = kind
        self.path: Path | None = None
        #: The stored and the edited text.
        self.saved = self.text = ""
        #: Whether the library had this file under its name when it was opened.
        self._in_library = False
        self._required: frozenset[KeyPath] = frozenset()
        self._state: tuple[Path | None, str, str, list[Problem]] | None = None

    @property
    def name(self) -> str:
        """The file name without its suffix."""
        return self.path.stem if self.path is not None else ""

    @property
    def dirty(self) -> bool:
        """Whether the text differs from the stored one."""
        return self.text != self.saved

    @property
    def outdated(self) -> bool:
        """Whether another program or window has changed the file since it was opened."""
        return self._in_library and not versions.is_current(self.kind, self.name, self.saved)

    @property
    def file_name(self) -> str:
        """The name under which the file is saved: its own, or an unused one for a file of another folder."""
        name, number = self.name, 1
        while not self._in_library and name in library.names(self.kind):
            number += 1
            name = f"{self.name}-{number}"
        return name

    @property
    def warnings(self) -> list[Problem]:
        """Entries that are probably wrong; [] while the text has problems."""
        return [] if self.problems or self.path is None else editing.warnings(self.kind, self.text)

    @property
    def judges_differently(self) -> bool:
        """Whether entries of `versions.JUDGING` have changed in a product."""
        return self.kind == "products" and any(self.differs((name,)) for name in versions.JUDGING)

    @property
    def model(self) -> BaseModel | None:
        """The validated model of `text`, or None while the text has problems."""
        if self.problems or self.path is None:
            return None
        return editing.MODELS[self.kind].model_validate(self.values)

    def open(self, path: Path) -> None:
        """Read a file and discard unsaved changes."""
        self.path, self._required = path, frozenset()
        self._in_library = self.name in library.names(self.kind) and library.find(self.kind, self.name) == path
        try:
            self.saved = editing.read_text(path)
        except ConfigurationError as error:
            self.saved = ""
            self._show_text("", [Problem((), "file", error.as_text, 1)])
            return
        self.rewrite(self.saved)

    def rewrite(self, text: str) -> None:
        """Replace the whole text."""
        problems = editing.check(self.kind, text, self.path)
        if not any(problem.kind == "toml" for problem in problems):
            values = _parsed(text)
            missing = [key_path for key_path in sorted(self._required) if value_at(values, key_path) is None]
            problems += [Problem(key_path, "missing", Text("entry.missing"), data=values) for key_path in missing]
        self._show_text(text, problems)

    def require(self, key_paths: Iterable[KeyPath], required: bool = True) -> None:
        """Require values that are optional in the model until the file is opened or saved, or stop requiring them."""
        change = self._required.union if required else self._required.difference
        changed = change(key_paths)
        if changed != self._required:
            self._required = changed
            self.rewrite(self.text)

    def requires(self, key_path: KeyPath) -> bool:
        """Return whether a value that the model does not need is required."""
        return key_path in self._required

    def discard(self, *, find: bool = True) -> None:
        """Read the file again, or with `find` the file that another window may have saved in the site's folder."""
        if self.path is not None:
            is_found = self._in_library and self.name in library.names(self.kind)
            self.open(library.find(self.kind, self.name) if find and is_found else self.path)
            self._in_library |= is_found

    def set(self, changes: Mapping[KeyPath, Any]) -> None:
        """Change values; None removes a value. A text that is not valid TOML is not changed."""
        if any(problem.kind in ("toml", "file") for problem in self.problems):
            self.changed.emit()
            return
        text = editing.edit_toml(self.text, changes)
        if text != self.text:
            self.rewrite(text)

    def _show_text(self, text: str, problems: list[Problem]) -> None:
        state = (self.path, self.saved, text, problems)
        if state != self._state:
            self._state = state
            self.text, self.problems = text, problems
            self.values, self.stored = _parsed(text), _parsed(self.saved)
            self.changed.emit()


class Drafts(QObject):
    """The drafts of the station, its table, and the files that are open as text.

    `changed` is emitted when a draft changes, and `saved(kind)` after a file of a kind has been stored.
    """

    changed = Signal()
    saved = Signal(str)

    def __init__(self, author: Callable[[], Confirmation], parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._author = author
        self._all: list[Draft] = []
        self.station, self.table = self._new("stations"), self._new("tables")

    def open_draft(self, kind: str, path: Path) -> Draft:
        """Return the draft of a file, which is created if there is none."""
        draft = next((d for d in self._all if (d.kind, d.path) == (kind, path)), None)
        if draft is None:
            draft = self._new(kind)
            draft.open(path)
        return draft

    def switch(self, draft: Draft, path: Path) -> None:
        """Open a file in a draft, which replaces another draft of this file and adopts its unsaved changes."""
        other = next((d for d in self._all if (d.kind, d.path) == (draft.kind, path) and d is not draft), None)
        if other is not None:
            self._all.remove(other)
            other.path = None
        draft.open(path)
        if other is not None and other.dirty:
            draft.saved = other.saved  # the text to which its changes were made
            draft.rewrite(other.text)

    def reload(self, *, find: bool = True) -> None:
        """Read the files of all drafts without unsaved changes again; see `Draft.discard`."""
        for draft in [draft for draft in self._all if not draft.dirty]:
            draft.discard(find=find)

    @property
    def dirty(self) -> list[Draft]:
        """Drafts with unsaved changes."""
        return [draft for draft in self._all if draft.dirty]

    @property
    def outdated(self) -> list[Draft]:
        """Drafts with unsaved changes whose files another program or window has changed."""
        return [draft for draft in self.dirty if draft.outdated]

    @property
    def invalid(self) -> list[Draft]:
        """Drafts with unsaved changes that cannot be saved because they have problems."""
        return [draft for draft in self.dirty if draft.problems]

    @property
    def author(self) -> Confirmation:
        """The author of new versions, who is the current user."""
        return self._author()

    @property
    def needs_reason(self) -> bool:
        """Whether a reason must be given for the unsaved changes."""
        return any(draft.judges_differently for draft in self.dirty)

    def save(self, reason: str = "") -> None:
        """Store all changes in the site folder as new versions, with the station last.

        `reason` is stored with every file that judges differently.

        Raises
        ------
        ConfigurationError
            If a draft cannot be stored; earlier drafts have then been stored, unless a file is `outdated`.
        """
        for draft in self.outdated:
            raise ConfigurationError("versions.changed_meanwhile", file=draft.path)
        for draft in reversed(self.dirty):
            name, why = draft.file_name, reason if draft.judges_differently else ""
            versions.save(draft.kind, name, draft.text, self.author, why, opened=draft.saved)
            draft.open(library.find(draft.kind, name))
            self.saved.emit(draft.kind)

    def create(self, kind: str, name: str, source: Path) -> Path:
        """Copy a file under a new name, and return the path; the copy also states the new name.

        Runs of two products with the same name could not be distinguished.

        Raises
        ------
        ConfigurationError
            If the name is already used or not allowed.
        """
        text = editing.read_text(source)
        if "name" in _parsed(text):
            text = editing.edit_toml(text, {("name",): name})
        versions.save(kind, editing.new_name(kind, name), text, self.author)
        self.saved.emit(kind)
        return library.find(kind, name)

    def _new(self, kind: str) -> Draft:
        draft = Draft(kind, self)
        draft.changed.connect(self.changed)
        self._all.append(draft)
        return draft


def _parsed(text: str) -> dict[str, Any]:
    try:
        return parse_toml(text)
    except tomllib.TOMLDecodeError:
        return {}
