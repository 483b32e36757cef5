"""A label that is cut to its width, and the text of an empty page."""

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QPainter, QPaintEvent
from PySide6.QtWidgets import QLabel, QSizePolicy, QWidget

from calstation.gui.widgets import theme
from calstation.gui.widgets.layout import column, label, row


class ElidedLabel(QLabel):
    """A line of text that ends in an ellipsis if it is too long; the tooltip shows all of it."""

    def __init__(self, kind: str = "") -> None:
        super().__init__()
        if kind:
            self.setProperty("kind", kind)
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

    def __init__(self, *widgets: QWidget) -> None:
        super().__init__()
        self._title, self._text = label(kind="section", wrap=True), label(kind="muted", wrap=True)
        for each in (self._title, self._text):
            each.setAlignment(Qt.AlignmentFlag.AlignHCenter)
        middle = QWidget()
        middle.setFixedWidth(_WIDTH)
        below = [(widget, 0, Qt.AlignmentFlag.AlignHCenter) for widget in widgets]
        box = column(self._title, self._text, *below, on=middle, spacing=2 * theme.GRID)
        box.insertStretch(0, 2)
        box.addStretch(3)
        row(None, middle, None, on=self)

    @property
    def title(self) -> str:
        """The title."""
        return self._title.text()

    def say(self, title: str, text: str) -> None:
        """Show a title and a text (may be empty)."""
        self._title.setText(title)
        self._text.setText(text)
        self._text.setVisible(bool(text))
