"""Numbers large enough to be read from two metres: before, and after."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QWidget

from calstation.gui.widgets import column, label, theme

_SIZE = 28


class Figure(QWidget):
    """A caption over a number, or over two with an arrow between."""

    def __init__(self, size: int = _SIZE) -> None:
        super().__init__()
        self._caption, self.number = label(kind="muted"), label()
        self.number.setFont(theme.font(size, bold=True))
        self.number.setTextFormat(Qt.TextFormat.PlainText)
        column(self._caption, self.number, on=self, spacing=0)

    def show_change(self, caption: str, before: float, after: float, unit: str) -> None:
        """Show a number before and after, with three digits each."""
        self.show_text(caption, f"{three_digits(before)} → {three_digits(after)} {unit}")

    def show_text(self, caption: str, text: str) -> None:
        """Show any text."""
        self._caption.setText(caption)
        self.number.setText(text)


def three_digits(value: float) -> str:
    """A number with three digits, never as a power of ten."""
    if value == 0.0 or not abs(value) < 1e15:
        return f"{value:g}"
    digits = 2 - int(f"{abs(value):.2e}".partition("e")[2])
    return f"{value:.{max(digits, 0)}f}".replace("-", "−")
