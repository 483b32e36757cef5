"""How a method is done: its picture, numbered steps, what is needed and what is found."""

from PySide6.QtCore import QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent
from PySide6.QtWidgets import QFrame, QGridLayout, QHBoxLayout, QLabel, QScrollArea, QVBoxLayout, QWidget

from calstation.gui.logs.methods.kinds import words
from calstation.gui.logs.methods.pictures import MethodPicture
from calstation.gui.text import on_language_change
from calstation.gui.widgets import theme

_DISC = 28


class _Number(QWidget):
    """A step's number on a disc."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self._number = number
        self.setFixedSize(QSize(_DISC, _DISC))

    def paintEvent(self, event: QPaintEvent) -> None:
        """Disc and figure."""
        c = theme.colours()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(c.accent))
        painter.drawEllipse(QRectF(self.rect()).adjusted(1, 1, -1, -1))
        painter.setPen(QColor(c.on_accent))
        painter.setFont(theme.font(bold=True))
        painter.drawText(self.rect(), Qt.AlignmentFlag.AlignCenter, str(self._number))


class Guidance(QScrollArea):
    """Also what a method shows before it has a recording."""

    def __init__(self, stage: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._stage = stage
        self.setWidgetResizable(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setProperty("kind", "clear")
        count = len(words(stage).steps)
        self._steps = [QLabel() for _ in range(count)]
        self._heads = QLabel(), QLabel()
        self._texts = QLabel(), QLabel()
        steps = QGridLayout()
        steps.setHorizontalSpacing(2 * theme.GRID)
        steps.setVerticalSpacing(2 * theme.GRID)
        steps.setColumnStretch(1, 1)
        for row, label in enumerate(self._steps):
            label.setWordWrap(True)
            label.setFont(theme.font(theme.BODY + 1))
            steps.addWidget(_Number(row + 1), row, 0, Qt.AlignmentFlag.AlignTop)
            steps.addWidget(label, row, 1)
        foot = QGridLayout()
        foot.setHorizontalSpacing(3 * theme.GRID)
        foot.setVerticalSpacing(theme.GRID)
        foot.setColumnStretch(1, 1)
        for row, (head, text) in enumerate(zip(self._heads, self._texts, strict=True)):
            head.setProperty("kind", "muted")
            text.setWordWrap(True)
            foot.addWidget(head, row, 0, Qt.AlignmentFlag.AlignTop)
            foot.addWidget(text, row, 1)
        left = QVBoxLayout()
        left.setSpacing(3 * theme.GRID)
        left.addLayout(steps)
        left.addLayout(foot)
        left.addStretch(1)
        picture = MethodPicture(stage)
        body = QWidget()
        sides = QHBoxLayout(body)
        sides.setContentsMargins(theme.GRID, 2 * theme.GRID, theme.GRID, theme.GRID)
        sides.setSpacing(4 * theme.GRID)
        sides.addLayout(left, 11)
        sides.addWidget(picture, 9)
        self.setWidget(body)
        on_language_change(self, self.retranslate)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        said = words(self._stage)
        for label, text in zip(self._steps, said.steps, strict=True):
            label.setText(text)
        for head, text in zip(self._heads, (self.tr("Needs"), self.tr("Finds")), strict=True):
            head.setText(text)
        for label, text in zip(self._texts, (said.needs, said.finds), strict=True):
            label.setText(text)
