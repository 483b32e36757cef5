"""Text of a configuration file with its wrong lines marked, and the differences between two texts."""

from collections.abc import Iterable, Sequence

from PySide6.QtGui import QColor, QFont, QFontDatabase, QTextCharFormat, QTextCursor, QTextFormat
from PySide6.QtWidgets import QPlainTextEdit, QTextEdit

from calstation.gui.widgets import theme


class TomlEditor(QPlainTextEdit):
    """Edits a text; `mark` shades lines."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("toml_edit")
        self.setFont(_fixed_font())
        self.setLineWrapMode(QPlainTextEdit.LineWrapMode.NoWrap)
        self.setTabChangesFocus(True)

    def mark(self, lines: Iterable[int]) -> None:
        """Shade these lines, counted from 1, as wrong."""
        _shade(self, ((line - 1, theme.colours().bad) for line in lines))

    def go_to(self, line: int) -> None:
        """Put the cursor on a line, counted from 1, and show it."""
        self.setTextCursor(QTextCursor(self.document().findBlockByNumber(line - 1)))
        self.centerCursor()
        self.setFocus()


class DiffView(QPlainTextEdit):
    """The lines that differ between two texts: a sign before each, which its colour repeats."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("diff_view")
        self.setReadOnly(True)
        self.setFont(_fixed_font())
        self.setLineWrapMode(QPlainTextEdit.LineWrapMode.NoWrap)
        self._lines: Sequence[str] = ()

    def show_lines(self, lines: Sequence[str]) -> None:
        """Show lines of `difflib`, each with its sign."""
        self._lines = lines
        self.setPlainText("\n".join(lines))
        self.apply_theme()

    def apply_theme(self) -> None:
        """Use the colours of the current theme."""
        colours = {"+": theme.colours().good, "-": theme.colours().bad}
        _shade(
            self,
            ((i, colours[line[0]]) for i, line in enumerate(self._lines) if line[:1] in colours and line),
        )


def _shade(view: QPlainTextEdit, lines: Iterable[tuple[int, str]]) -> None:
    """Shade whole lines, counted from 0, each in a colour."""
    selections = []
    for number, colour in lines:
        shade = QColor(colour)
        shade.setAlpha(45)
        form = QTextCharFormat()
        form.setBackground(shade)
        form.setProperty(QTextFormat.Property.FullWidthSelection, True)
        selection = QTextEdit.ExtraSelection()
        selection.format = form
        selection.cursor = QTextCursor(view.document().findBlockByNumber(number))
        selections.append(selection)
    view.setExtraSelections(selections)


def _fixed_font() -> QFont:
    """The system's fixed-width font in the size of the body."""
    font = QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont)
    font.setFamilies([*font.families(), "Consolas", "DejaVu Sans Mono", "WenQuanYi Micro Hei Mono"])
    font.setPixelSize(theme.BODY)
    return font
