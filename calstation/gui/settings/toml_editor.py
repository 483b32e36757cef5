"""A TOML text with line numbers, quiet colours, and a mark at every line that something is wrong with."""

import re
from collections.abc import Sequence

from PySide6.QtCore import QEvent, QRect, QRectF, QSize, Qt
from PySide6.QtGui import (
    QColor,
    QFont,
    QFontDatabase,
    QHelpEvent,
    QPainter,
    QPaintEvent,
    QResizeEvent,
    QSyntaxHighlighter,
    QTextCharFormat,
    QTextCursor,
    QTextDocument,
    QTextFormat,
)
from PySide6.QtWidgets import QPlainTextEdit, QTextEdit, QToolTip, QWidget

from calstation.config.editing import Problem
from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import draw_state

#: Width of the column of marks, px.
_MARK = 18


def fixed_font() -> QFont:
    """The system's font of equal widths, at the size of the body."""
    font = QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont)
    font.setFamilies([*font.families(), "Consolas", "DejaVu Sans Mono", "WenQuanYi Micro Hei Mono"])
    font.setPixelSize(theme.BODY)
    return font


class _Colours(QSyntaxHighlighter):
    """Comments step back, headers stand out."""

    def __init__(self, document: QTextDocument) -> None:
        super().__init__(document)
        self.dress()

    def dress(self) -> None:
        """Take the colours of the theme in force."""
        c = theme.colours()
        self._rules = [
            (re.compile(r"^\s*\[[^#\n]*\]"), self._format(c.accent, bold=True)),
            (re.compile(r"^\s*[\w.\"-]+(?=\s*=)"), self._format(c.text, bold=True)),
            (re.compile(r"\"[^\"\n]*\""), self._format(c.good)),
        ]
        self._comment = self._format(c.muted)
        self.rehighlight()

    def highlightBlock(self, text: str) -> None:
        """Colour one line."""
        for pattern, form in self._rules:
            for found in pattern.finditer(text):
                self.setFormat(found.start(), found.end() - found.start(), form)
        quoted = False
        for i, letter in enumerate(text):
            if letter == '"':
                quoted = not quoted
            elif letter == "#" and not quoted:
                self.setFormat(i, len(text) - i, self._comment)
                return

    def _format(self, colour: str, *, bold: bool = False) -> QTextCharFormat:
        made = QTextCharFormat()
        made.setForeground(QColor(colour))
        if bold:
            made.setFontWeight(QFont.Weight.DemiBold)
        return made


class _Gutter(QWidget):
    """Line numbers and marks."""

    def __init__(self, editor: "TomlEditor") -> None:
        super().__init__(editor)
        self._editor = editor

    def sizeHint(self) -> QSize:
        """As wide as the largest number needs."""
        return QSize(self._editor.gutter_width(), 0)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw what the editor knows of its lines."""
        self._editor.paint_gutter(QPainter(self))

    def event(self, event: QEvent) -> bool:
        """Say at a mark what is wrong."""
        if event.type() == QEvent.Type.ToolTip and isinstance(event, QHelpEvent):
            QToolTip.showText(event.globalPos(), self._editor.said_at(event.pos().y()), self)
            return True
        return super().event(event)


class TomlEditor(QPlainTextEdit):
    """Edits a text; `mark` shows what is wrong with it."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("toml_edit")
        self.setFont(fixed_font())
        self.setLineWrapMode(QPlainTextEdit.LineWrapMode.NoWrap)
        self.setTabChangesFocus(True)
        self._problems: dict[int, str] = {}
        self._gutter = _Gutter(self)
        self._colours = _Colours(self.document())
        self.blockCountChanged.connect(self._widen)
        self.updateRequest.connect(self._follow)
        self._widen()

    def mark(self, problems: Sequence[Problem], said: Sequence[str]) -> None:
        """Mark lines, each with its sentence."""
        self._problems = {}
        for problem, text in zip(problems, said, strict=True):
            before = self._problems.get(problem.line)
            self._problems[problem.line] = f"{before}\n{text}" if before else text
        shade = QTextCharFormat()
        colour = QColor(theme.colours().bad)
        colour.setAlpha(40)
        shade.setBackground(colour)
        shade.setProperty(QTextFormat.Property.FullWidthSelection, True)
        selections = []
        for line in self._problems:
            selection = QTextEdit.ExtraSelection()
            selection.format = shade
            selection.cursor = QTextCursor(self.document().findBlockByNumber(line - 1))
            selections.append(selection)
        self.setExtraSelections(selections)
        self._gutter.update()

    def go_to(self, line: int) -> None:
        """Put the cursor on a line and show it."""
        self.setTextCursor(QTextCursor(self.document().findBlockByNumber(line - 1)))
        self.centerCursor()
        self.setFocus()

    def dress(self) -> None:
        """Take the colours of the theme in force."""
        self._colours.dress()
        self._gutter.update()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Keep the gutter at the left edge."""
        super().resizeEvent(event)
        box = self.contentsRect()
        self._gutter.setGeometry(QRect(box.left(), box.top(), self.gutter_width(), box.height()))

    def gutter_width(self) -> int:
        """Marks, numbers and a little air, px."""
        digits = max(2, len(str(self.blockCount())))
        return _MARK + theme.GRID + self.fontMetrics().horizontalAdvance("9") * digits + theme.GRID

    def paint_gutter(self, painter: QPainter) -> None:
        """Draw numbers and marks of the lines in sight."""
        c = theme.colours()
        painter.fillRect(self._gutter.rect(), QColor(c.window))
        painter.setFont(self.font())
        for line, top, height in self._lines():
            painter.setPen(QColor(c.bad if line in self._problems else c.muted))
            box = QRectF(0, top, self._gutter.width() - theme.GRID, height)
            painter.drawText(box, Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter, str(line))
            if line in self._problems:
                draw_state(painter, "bad", QRectF(4, top + (height - 12) / 2, 12, 12))

    def said_at(self, y: int) -> str:
        """What is wrong with the line at a height of the gutter, px."""
        for line, top, height in self._lines():
            if top <= y < top + height:
                return self._problems.get(line, "")
        return ""

    def _lines(self) -> list[tuple[int, float, float]]:
        """Number, top and height of the lines in sight."""
        block = self.firstVisibleBlock()
        top = self.blockBoundingGeometry(block).translated(self.contentOffset()).top()
        found = []
        while block.isValid() and top <= self.viewport().height():
            height = self.blockBoundingRect(block).height()
            found.append((block.blockNumber() + 1, top, height))
            top += height
            block = block.next()
        return found

    def _widen(self) -> None:
        self.setViewportMargins(self.gutter_width(), 0, 0, 0)

    def _follow(self, rect: QRect, scrolled: int) -> None:
        if scrolled:
            self._gutter.scroll(0, scrolled)
        else:
            self._gutter.update(0, rect.y(), self._gutter.width(), rect.height())


class DiffView(QPlainTextEdit):
    """Two texts compared line by line: a sign before every line that differs, its colour repeats it."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("diff_view")
        self.setReadOnly(True)
        self.setFont(fixed_font())
        self.setLineWrapMode(QPlainTextEdit.LineWrapMode.NoWrap)
        self._lines: Sequence[str] = ()

    def show_lines(self, lines: Sequence[str]) -> None:
        """Show lines of `difflib`, each with its sign."""
        self._lines = lines
        self.setPlainText("\n".join(lines))
        self.dress()

    def dress(self) -> None:
        """Take the colours of the theme in force."""
        c = theme.colours()
        selections = []
        for number, line in enumerate(self._lines):
            if line[:1] not in ("+", "-"):
                continue
            colour = QColor(c.good if line[0] == "+" else c.bad)
            colour.setAlpha(50)
            selection = QTextEdit.ExtraSelection()
            shade = QTextCharFormat()
            shade.setBackground(colour)
            shade.setProperty(QTextFormat.Property.FullWidthSelection, True)
            selection.format = shade
            selection.cursor = QTextCursor(self.document().findBlockByNumber(number))
            selections.append(selection)
        self.setExtraSelections(selections)
