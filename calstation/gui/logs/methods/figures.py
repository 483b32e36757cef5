"""Numbers large enough to be seen from two metres: what it was before, and what it is after."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFrame, QLabel, QScrollArea, QVBoxLayout, QWidget

from calstation.gui.widgets import theme

_SIZE = 28


class Figure(QWidget):
    """A caption over a number, or over two with an arrow between."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._caption, self.number = QLabel(), QLabel()
        self._caption.setProperty("kind", "muted")
        self.number.setFont(theme.font(_SIZE, bold=True))
        self.number.setTextFormat(Qt.TextFormat.PlainText)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self._caption)
        column.addWidget(self.number)

    def show_change(self, caption: str, before: float, after: float, unit: str) -> None:
        """Before and after, with three digits each."""
        self._caption.setText(caption)
        self.number.setText(f"{three_digits(before)} → {three_digits(after)} {unit}")

    def show_text(self, caption: str, text: str) -> None:
        """Any number as it is to be read."""
        self._caption.setText(caption)
        self.number.setText(text)


def three_digits(value: float) -> str:
    """A number with three digits, never as a power of ten."""
    if value == 0.0 or not abs(value) < 1e15:
        return f"{value:g}"
    digits = 2 - int(f"{abs(value):.2e}".partition("e")[2])
    shown = f"{value:.{max(digits, 0)}f}"
    return shown.replace("-", "−")


def scrolled(view: QWidget) -> QScrollArea:
    """The view in an area of its own, which shows a bar only where there is no room."""
    area = QScrollArea()
    area.setWidgetResizable(True)
    area.setFrameShape(QFrame.Shape.NoFrame)
    area.setProperty("kind", "clear")
    area.setWidget(view)
    return area
