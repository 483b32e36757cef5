"""A label that is cut to its width, and the text of an empty page."""

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QPainter, QPaintEvent
from PySide6.QtWidgets import QHBoxLayout, QLabel, QSizePolicy, QVBoxLayout, QWidget

from calstation.gui.widgets import theme


class ElidedLabel(QLabel):
    """A line of text that ends in an ellipsis where there is no room for all of it; the tooltip has it whole."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)

    def minimumSizeHint(self) -> QSize:
        """No minimum width."""
        return QSize(0, super().minimumSizeHint().height())

    def setText(self, text: str) -> None:
        """Show a text."""
        super().setText(text)
        self.setToolTip(text)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw as much of the text as fits."""
        painter = QPainter(self)
        text = self.fontMetrics().elidedText(self.text(), Qt.TextElideMode.ElideRight, self.width())
        painter.setPen(self.palette().color(self.foregroundRole()))
        painter.drawText(self.rect(), int(self.alignment()), text)


#: Width of the text of an empty page, px.
_WIDTH = 70 * theme.GRID


class EmptyState(QWidget):
    """What will be here and how to get it: a centred title, a sentence or two, and widgets below them."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._title = QLabel()
        self._title.setProperty("kind", "section")
        self._text = QLabel()
        self._text.setProperty("kind", "muted")
        for label in (self._title, self._text):
            label.setWordWrap(True)
            label.setAlignment(Qt.AlignmentFlag.AlignHCenter)
        middle = QWidget()
        middle.setFixedWidth(_WIDTH)
        self._box = QVBoxLayout(middle)
        self._box.setContentsMargins(0, 0, 0, 0)
        self._box.setSpacing(2 * theme.GRID)
        self._box.addStretch(2)
        self._box.addWidget(self._title)
        self._box.addWidget(self._text)
        self._box.addStretch(3)
        row = QHBoxLayout(self)
        row.addStretch(1)
        row.addWidget(middle)
        row.addStretch(1)

    @property
    def title(self) -> str:
        """The title."""
        return self._title.text()

    def add(self, widget: QWidget) -> None:
        """Add a widget below the text."""
        self._box.insertWidget(self._box.count() - 1, widget, 0, Qt.AlignmentFlag.AlignHCenter)

    def say(self, title: str, text: str) -> None:
        """Show a title and a text (may be empty)."""
        self._title.setText(title)
        self._text.setText(text)
        self._text.setVisible(bool(text))
