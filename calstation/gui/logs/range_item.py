"""The chosen range over a plot: edges to drag, and a body to drag unless it covers the view."""

from typing import Any

import pyqtgraph as pg
from PySide6.QtGui import QColor, QPen

from calstation.gui.widgets import theme

#: Width within which an edge can be dragged, px.
_GRIP = 20


class RangeItem(pg.LinearRegionItem):  # type: ignore[misc]
    """A region in seconds; a drag that could only move it out of sight pans the view instead."""

    def __init__(self) -> None:
        super().__init__(swapMode="block")
        self.setZValue(50)

    def apply_theme(self) -> None:
        """Take the colours of the current theme."""
        colours = {alpha: QColor(theme.colours().accent) for alpha in (18, 30, 160, 255)}
        for alpha, colour in colours.items():
            colour.setAlpha(alpha)
        self.setBrush(colours[18])
        self.setHoverBrush(colours[30])
        for line in self.lines:
            line.setPen(QPen(colours[255], 2))
            line.setHoverPen(QPen(colours[160], _GRIP))
            line.pen.setCosmetic(True)
            line.hoverPen.setCosmetic(True)

    def mouseDragEvent(self, event: Any) -> None:
        """Move the range, unless it covers the view."""
        if self._covers_view():
            event.ignore()
        else:
            super().mouseDragEvent(event)

    def hoverEvent(self, event: Any) -> None:
        """Highlight the body if it can be dragged."""
        if not self._covers_view():
            super().hoverEvent(event)

    def _covers_view(self) -> bool:
        left, right = self.getViewBox().viewRange()[0]
        start, stop = self.getRegion()
        margin = 0.03 * (right - left)
        return bool(start <= left + margin and stop >= right - margin)
