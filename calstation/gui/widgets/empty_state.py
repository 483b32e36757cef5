"""What an empty page says: what will be here, and how to get it."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QHBoxLayout, QLabel, QVBoxLayout, QWidget

from calstation.gui.widgets import theme

_WIDTH = 70 * theme.GRID


class EmptyState(QWidget):
    """A title, a sentence or two, and below them what `add` puts there; in the middle of its place."""

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
        """Put a widget below the sentences."""
        self._box.insertWidget(self._box.count() - 1, widget, 0, Qt.AlignmentFlag.AlignHCenter)

    def say(self, title: str, text: str) -> None:
        """Say it, in the language in force."""
        self._title.setText(title)
        self._text.setText(text)
        self._text.setVisible(bool(text))
