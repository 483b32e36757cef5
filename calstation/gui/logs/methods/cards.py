"""The methods as cards to choose from: picture, name, and what it is for."""

from PySide6.QtCore import QEvent, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QAbstractButton, QSizePolicy, QVBoxLayout, QWidget

from calstation.gui.logs.methods.kinds import STAGES, words
from calstation.gui.logs.methods.pictures import paint_method
from calstation.gui.widgets import theme

_WIDTH, _HEIGHT = 29 * theme.GRID, 22 * theme.GRID
_PICTURE = 13 * theme.GRID


class MethodCard(QAbstractButton):
    """One method; the chosen one is framed and banded."""

    def __init__(self, stage: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.stage = stage
        self.setObjectName(f"method_card_{stage}")
        self.setCheckable(True)
        self.setAutoExclusive(True)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setCursor(Qt.CursorShape.PointingHandCursor)
        self.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Fixed)
        self.setAttribute(Qt.WidgetAttribute.WA_Hover)
        self.retranslate()

    def sizeHint(self) -> QSize:
        """All cards are alike."""
        return QSize(_WIDTH, _HEIGHT)

    def retranslate(self) -> None:
        """Say it again in the language in force."""
        said = words(self.stage)
        self.setText(said.title)
        self.setAccessibleName(said.title)
        self.setAccessibleDescription(said.summary)
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Frame, picture, words."""
        c = theme.colours()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        marked = self.hasFocus() or self.isChecked() or self.underMouse()
        painter.setPen(QPen(QColor(c.accent if marked else c.line), 2 if self.hasFocus() else 1))
        painter.setBrush(QColor(c.panel if self.isChecked() else c.window))
        painter.drawRoundedRect(QRectF(self.rect()).adjusted(1, 1, -1, -1), 4, 4)
        if self.isChecked():
            painter.fillRect(QRectF(1, 4, 4, self.height() - 8), QColor(c.accent))
        left, width = 2.0 * theme.GRID, self.width() - 3.0 * theme.GRID
        paint_method(painter, self.stage, QRectF(left, 6, width, _PICTURE))
        painter.setPen(QColor(c.text))
        painter.setFont(theme.font(theme.SECTION, bold=True))
        top = _PICTURE + 6.0
        painter.drawText(QRectF(left, top, width, 24), Qt.AlignmentFlag.AlignVCenter, self.text())
        painter.setFont(theme.font())
        painter.setPen(QColor(c.muted))
        painter.drawText(
            QRectF(left, top + 24, width, self.height() - top - 28),
            Qt.AlignmentFlag.AlignTop | Qt.TextFlag.TextWordWrap,
            words(self.stage).summary,
        )


class MethodCards(QWidget):
    """All cards, one chosen. `chosen(stage)`"""

    chosen = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.cards = {stage: MethodCard(stage) for stage in STAGES}
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(theme.GRID)
        for stage, card in self.cards.items():
            card.clicked.connect(lambda _=False, chosen=stage: self.chosen.emit(chosen))
            column.addWidget(card)
        column.addStretch(1)
        self.cards[STAGES[0]].setChecked(True)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        for card in self.cards.values():
            card.retranslate()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)
