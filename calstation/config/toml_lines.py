"""Finds the line of a TOML text on which a value stands, for messages about it."""

import re

Path = tuple[str | int, ...]

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_PLAIN = re.compile(r"[^,\]\}#\n]*")
_STRINGS = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}|' r"'''.*?'{3,5}" r'|"(?:\\.|[^"\\])*"' r"|'[^']*'", re.DOTALL
)


def line_of(text: str, path: Path) -> int:
    """The line (from 1) of the value at `path` in a valid TOML text, or of the innermost table that holds its place.

    Parameters
    ----------
    path : keys, and numbers for elements of arrays, as in pydantic's ``loc``
    """
    lines = _Lines(text).places
    while path and path not in lines:
        path = path[:-1]
    return text.count("\n", 0, lines.get(path, 0)) + 1


class _Lines:
    """One walk over a valid text; `places` is where each value begins."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self.places: dict[Path, int] = {}
        self._elements: dict[Path, int] = {}
        table: Path = ()
        while self._skip() < len(text):
            if text.startswith("[[", self._at):
                table = self._header(2)
            elif text.startswith("[", self._at):
                table = self._header(1)
            else:
                self._pair(table)

    def _skip(self) -> int:
        found = _BLANK.match(self._text, self._at)
        assert found is not None
        self._at = found.end()
        return self._at

    def _header(self, brackets: int) -> Path:
        begin = self._at
        self._at += brackets
        keys = self._keys()
        self._at += brackets
        path: Path = ()
        for i, key in enumerate(keys):
            path = (*path, key)
            self.places.setdefault(path, begin)
            if i == len(keys) - 1 and brackets == 2:
                self._elements[path] = self._elements.get(path, -1) + 1
            if path in self._elements:  # a table below an array of tables belongs to its last element
                path = (*path, self._elements[path])
            self.places.setdefault(path, begin)
        return path

    def _keys(self) -> list[str]:
        keys = []
        while True:
            self._skip()
            found = _STRINGS.match(self._text, self._at) or _BARE.match(self._text, self._at)
            assert found is not None
            self._at = found.end()
            keys.append(found.group().strip("\"'"))
            self._skip()
            if not self._text.startswith(".", self._at):
                return keys
            self._at += 1

    def _pair(self, table: Path) -> None:
        begin = self._at
        path = table
        for key in self._keys():
            path = (*path, key)
            self.places.setdefault(path, begin)
        self._at += 1  # the equals sign
        self._skip()
        self._value(path)

    def _value(self, path: Path) -> None:
        self.places.setdefault(path, self._at)
        opening = self._text[self._at]
        if opening in "[{":
            self._at += 1
            index = 0
            while self._text[self._skip()] not in "]}":
                if opening == "[":
                    self._value((*path, index))
                    index += 1
                else:
                    self._pair(path)
                if self._text[self._skip()] == ",":
                    self._at += 1
            self._at += 1
            return
        found = _STRINGS.match(self._text, self._at) or _PLAIN.match(self._text, self._at)
        assert found is not None
        self._at = found.end()
