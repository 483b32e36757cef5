"""A tile for a unit, and the grid of tiles, with the same arrangement before, during and after a run."""

from collections.abc import Sequence

from PySide6.QtCore import Qt
from PySide6.QtGui import QPaintEvent
from PySide6.QtWidgets import (
    QAbstractButton,
    QGridLayout,
    QSizePolicy,
    QStyle,
    QStyleOption,
    QStylePainter,
    QWidget,
)

from calstation.gui.widgets import clear, theme

#: Largest number of tiles in a row.
COLUMNS = 4


class Tile(QAbstractButton):
    """A button that contains widgets, which do not take clicks; it expands vertically if there is room."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.setObjectName(name)
        self.setProperty("kind", "tile")
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the background and the border of the style sheet."""
        option = QStyleOption()
        option.initFrom(self)
        QStylePainter(self).drawPrimitive(QStyle.PrimitiveElement.PE_Widget, option)

    def show_chosen(self, chosen: bool) -> None:
        """Show whether this is the tile of the unit to which scans or traces belong."""
        kind = "tile_chosen" if chosen else "tile"
        if self.property("kind") != kind:
            theme.set_kind(self, kind)


def pass_clicks(*widgets: QWidget) -> None:
    """Let clicks on widgets reach the tile that contains them."""
    for widget in widgets:
        widget.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)


def arrange(layout: QGridLayout, tiles: Sequence[QWidget]) -> None:
    """Put tiles into a grid in order, replacing the current ones."""
    clear(layout)
    for index in range(COLUMNS):
        layout.setColumnStretch(index, index < len(tiles))
    for index, tile in enumerate(tiles):
        layout.addWidget(tile, index // COLUMNS, index % COLUMNS)
