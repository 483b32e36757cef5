"""The chosen range over a plot: edges to drag, and a body to drag where not all of the view lies in it."""

from typing import Any

import pyqtgraph as pg
from PySide6.QtGui import QColor, QPen

from calstation.gui.widgets import theme

#: Width within which an edge is taken hold of, px.
_GRIP = 20


class RangeItem(pg.LinearRegionItem):  # type: ignore[misc]
    """A region in seconds; a drag that could only move it out of sight pans the view instead."""

    def __init__(self) -> None:
        super().__init__(swapMode="block")
        self.setZValue(50)
        self.dress()

    def dress(self) -> None:
        """Take the theme's colours."""
        accent = QColor(theme.colours().accent)
        self.setBrush(_faint(accent, 18))
        self.setHoverBrush(_faint(accent, 30))
        for line in self.lines:
            line.setPen(QPen(accent, 2))
            line.setHoverPen(QPen(_faint(accent, 160), _GRIP))
            line.pen.setCosmetic(True)
            line.hoverPen.setCosmetic(True)

    def mouseDragEvent(self, event: Any) -> None:
        """Move the range, unless it covers the view."""
        if self._covers_view():
            event.ignore()
        else:
            super().mouseDragEvent(event)

    def hoverEvent(self, event: Any) -> None:
        """Show that the body can be dragged, where it can."""
        if not self._covers_view():
            super().hoverEvent(event)

    def _covers_view(self) -> bool:
        left, right = self.getViewBox().viewRange()[0]
        start, stop = self.getRegion()
        reach = 0.03 * (right - left)
        return bool(start <= left + reach and stop >= right - reach)


def _faint(colour: QColor, alpha: int) -> QColor:
    faint = QColor(colour)
    faint.setAlpha(alpha)
    return faint
