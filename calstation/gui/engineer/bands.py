"""Stages as bands behind plots, named at their tops."""

from collections.abc import Sequence

import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor

from calstation.gui.widgets import theme

#: A name, and where its band begins and ends.
Band = tuple[str, float, float]


#: Share of a plot's width that a character of a name takes, at least.
_PER_CHARACTER = 0.008


class Bands:
    """Draws bands into a plot; every second one is shaded."""

    def __init__(self, plot: pg.PlotWidget, named: bool) -> None:
        self._plot, self._named = plot, named
        self._items: list[pg.GraphicsObject] = []
        self._bands: Sequence[Band] = ()

    def show(self, bands: Sequence[Band]) -> None:
        """Show these bands in place of those before."""
        for item in self._items:
            self._plot.removeItem(item)
        self._items.clear()
        self._bands = bands
        c = theme.colours()
        span = max((end for _, _, end in bands), default=0.0) - min((b for _, b, _ in bands), default=0.0)
        for number, (name, begin, end) in enumerate(bands):
            shade = QColor(c.text)
            shade.setAlpha(16 if number % 2 == 0 else 0)
            region = pg.LinearRegionItem((begin, end), movable=False, brush=shade, pen=pg.mkPen(c.line))
            region.setZValue(-20)
            self._plot.addItem(region, ignoreBounds=True)
            self._items.append(region)
            wide = end - begin > _PER_CHARACTER * len(name) * span  # a name must not run into the next one's
            if self._named and wide:
                label = pg.InfLineLabel(region.lines[0], name, position=0.99, anchors=[(0, 0), (0, 0)])
                label.setColor(QColor(c.muted))
                label.setFont(theme.font())

    def dress(self) -> None:
        """Follow the theme."""
        self.show(self._bands)


def dashed(colour: str) -> pg.GraphicsObject:
    """A thin dashed pen."""
    return pg.mkPen(colour, width=1, style=Qt.PenStyle.DashLine)
