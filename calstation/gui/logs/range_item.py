"""The selected range on the plots of a log, whose edges can be dragged."""

from typing import Any

import pyqtgraph as pg
from PySide6.QtGui import QColor, QPen

from calstation.gui.widgets import theme


class RangeItem(pg.LinearRegionItem):  # type: ignore[misc]
    """A region in seconds with draggable edges; dragging between them zooms."""

    def __init__(self) -> None:
        super().__init__(swapMode="block")
        self.setZValue(50)

    def apply_theme(self) -> None:
        """Apply the colours of the current theme."""
        accent = theme.colours().accent
        self.setBrush(theme.faint(accent, 18))
        for line in self.lines:
            line.setPen(QPen(QColor(accent), 2))
            line.setHoverPen(QPen(theme.faint(accent, 160), 20))  # an edge can be dragged within this width
            line.pen.setCosmetic(True)
            line.hoverPen.setCosmetic(True)

    def mouseDragEvent(self, event: Any) -> None:
        """Ignore the drag, so that the plot handles it."""
        event.ignore()

    def hoverEvent(self, event: Any) -> None:
        """Ignore the mouse, so that the plot handles it."""
