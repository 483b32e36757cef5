"""A file as it is being edited: its saved text, what has been typed since, and what is wrong with it."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from PySide6.QtCore import QObject, Signal

from calstation.config import editing as settings
from calstation.config.editing import Place, Problem
from calstation.errors import ConfigurationError


class Draft(QObject):
    """One file of a kind; every change checks it again.

    `changed` is told after every change of the text or of the file. A file that is no TOML has no data: its text
    can be mended, its fields stay empty.

    Attributes
    ----------
    kind : ``stations``, ``tables``, ``imus`` or ``products``
    path : the file, None before the first is opened
    saved : its text as it is stored
    text : as it is now
    data : what `text` says
    problems : what is wrong with it
    """

    changed = Signal()

    def __init__(self, kind: str, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.kind = kind
        self.path: Path | None = None
        self.saved = self.text = ""
        self.data: Mapping[str, Any] = {}
        self._stored: Mapping[str, Any] = {}
        self.problems: list[Problem] = []

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return self.path.stem if self.path is not None else ""

    @property
    def dirty(self) -> bool:
        """Whether something has been typed that is not stored."""
        return self.text != self.saved

    @property
    def model(self) -> BaseModel | None:
        """What `text` says, checked; None while something is wrong with it."""
        return (
            None
            if self.problems or self.path is None
            else settings.MODELS[self.kind].model_validate(self.data)
        )

    def open(self, path: Path) -> None:
        """Take up another file, or the same one as it is stored now; typed changes are gone."""
        self.path = path
        try:
            self.saved = settings.read_text(path)
        except ConfigurationError as error:
            self.saved = ""
            self._take("", [Problem((), "file", str(error), 1)])
            return
        self.rewrite(self.saved)

    def rewrite(self, text: str) -> None:
        """Put another text in place of the present one."""
        self._take(text, settings.check(self.kind, text))

    def discard(self) -> None:
        """Back to what is stored."""
        if self.path is not None:
            self.open(self.path)

    def value(self, place: Place) -> Any:
        """The value at a place, None where there is none."""
        return _at(self.data, place)

    def differs(self, place: Place) -> bool:
        """Whether the value at a place is not as it is stored."""
        return self.dirty and _at(self._stored, place) != self.value(place)

    def set(self, changes: Mapping[Place, Any]) -> None:
        """Change values; None takes one away. A text that is no TOML is mended as a text: it stays as it is."""
        if any(problem.kind in ("toml", "file") for problem in self.problems):
            self.changed.emit()
            return
        text = settings.edited(self.text, changes)
        if text != self.text:
            self.rewrite(text)

    def _take(self, text: str, problems: list[Problem]) -> None:
        self.text, self.problems = text, problems
        self.data = _parsed(text)
        self._stored = self.data if text == self.saved else _parsed(self.saved)
        self.changed.emit()


def _parsed(text: str) -> Mapping[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return {}


def _at(data: Mapping[str, Any], place: Place) -> Any:
    found: Any = data
    for key in place:
        try:
            found = found[key]
        except (KeyError, IndexError, TypeError):
            return None
    return found
