"""A text in a fixed-width font whose lines can be shaded."""

from collections.abc import Iterable

from PySide6.QtGui import QColor, QFontDatabase, QTextCharFormat, QTextCursor, QTextFormat
from PySide6.QtWidgets import QPlainTextEdit, QTextEdit

from calstation.gui.widgets import theme


class TextView(QPlainTextEdit):
    """Shows or edits a text without wrapping its lines."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.setObjectName(name)
        font = QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont)
        font.setFamilies([*font.families(), "Consolas", "DejaVu Sans Mono", "WenQuanYi Micro Hei Mono"])
        font.setPixelSize(theme.BODY)
        self.setFont(font)
        self.setLineWrapMode(QPlainTextEdit.LineWrapMode.NoWrap)
        self.setTabChangesFocus(True)

    def shade(self, lines: Iterable[tuple[int, str]]) -> None:
        """Shade only these whole lines, counted from 1, each in its colour."""
        selections = []
        for number, colour in lines:
            shade = QColor(colour)
            shade.setAlpha(45)
            form = QTextCharFormat()
            form.setBackground(shade)
            form.setProperty(QTextFormat.Property.FullWidthSelection, True)
            selection = QTextEdit.ExtraSelection()
            selection.format = form
            selection.cursor = self._start_of(number)
            selections.append(selection)
        self.setExtraSelections(selections)

    def go_to(self, line: int) -> None:
        """Put the cursor on a line, counted from 1, and show it."""
        self.setTextCursor(self._start_of(line))
        self.centerCursor()
        self.setFocus()

    def _start_of(self, line: int) -> QTextCursor:
        return QTextCursor(self.document().findBlockByNumber(line - 1))
