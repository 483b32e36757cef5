"""Escaping of untrusted text, such as a serial number or a table cell, for each output that could interpret it.

Typst and JSON need no escaping: texts reach a Typst template as data. In the window, labels show plain text
(`gui.widgets.PlainLabel`), and `gui.widgets.plain_tip` escapes tooltips, because Qt detects rich text by itself.
"""

import csv
import io
import re
import unicodedata
from collections.abc import Iterable

#: First characters of a cell by which a spreadsheet recognises a formula.
_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")
_NOT_IN_FILE_NAMES = re.compile(r"[^A-Za-z0-9.-]")
#: Largest number of characters of a text in a file name, which may have 255 bytes.
_MAX_NAME = 100
#: Characters that begin a ZPL command.
_ZPL_COMMANDS = str.maketrans("^~", "  ")
#: Categories of characters that a terminal interprets as commands, or that reorder or hide text.
_INVISIBLE = ("Cc", "Cf", "Cs", "Zl", "Zp")


def for_terminal(text: str) -> str:
    r"""Return the text with control characters, except the line break, as escapes such as ``\x1b``."""
    if text.isprintable():
        return text
    return "".join(
        _escape(char) if char != "\n" and unicodedata.category(char) in _INVISIBLE else char for char in text
    )


def for_sentence(text: str) -> str:
    """Return the text on one line, otherwise escaped like `for_terminal`."""
    return text if text.isprintable() else for_terminal(re.sub(r"[\t\n\v\f\r\x85\u2028\u2029]+", " ", text))


def for_csv(rows: Iterable[Iterable[object]]) -> str:
    """Return rows as CSV in which no cell is a formula; None is an empty cell.

    A text that a spreadsheet would take for a formula is preceded by an apostrophe; numbers are unchanged.
    """
    stream = io.StringIO(newline="")
    csv.writer(stream, lineterminator="\n").writerows([_cell(cell) for cell in row] for row in rows)
    return stream.getvalue()


def surrogates(text: str) -> bool:
    """Return whether a text, such as a path that is not UTF-8, contains characters that no UTF-8 file can store."""
    return any("\ud800" <= char <= "\udfff" for char in text)


def for_zpl(text: str) -> str:
    """Return the text without control characters and those that begin a command of a label printer."""
    return "".join(" " if unicodedata.category(char) in _INVISIBLE else char for char in text.translate(_ZPL_COMMANDS))


def for_file_name(text: str) -> str:
    """Return the text as a part of a file name: at most 100 letters, digits, points and hyphens."""
    return _NOT_IN_FILE_NAMES.sub("-", text)[:_MAX_NAME]


def _escape(char: str) -> str:
    code = ord(char)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def _cell(value: object) -> object:
    if not isinstance(value, str) or not value.startswith(_FORMULA):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value
