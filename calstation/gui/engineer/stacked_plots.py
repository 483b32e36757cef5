"""Plots one above the other over a common horizontal axis, with the stages as shaded bands."""

from collections.abc import Sequence
from typing import Generic, TypeVar

import pyqtgraph as pg
from PySide6.QtCore import QEvent, Qt
from PySide6.QtGui import QColor, QShowEvent
from PySide6.QtWidgets import QWidget

from calstation.gui.text import on_language_change
from calstation.gui.widgets import ThemedPlot, theme

Data = TypeVar("Data")

#: A stage's name, and where its band begins and ends.
Band = tuple[str, float, float]

#: Least share of a plot's width that a character of a band's name takes.
_PER_CHARACTER = 0.008


class StackedPlots(QWidget, Generic[Data]):
    """Base of views of `count` linked plots with left axes `left` px wide.

    `draw` is called for new data, and again in another language or theme, but not while the view is hidden.
    """

    def __init__(self, count: int, left: int) -> None:
        super().__init__()
        self._data: Data | None = None
        self._outdated = True
        self._items: list[tuple[ThemedPlot, pg.GraphicsObject]] = []
        self.plots = tuple(ThemedPlot() for _ in range(count))
        for number, plot in enumerate(self.plots):
            plot.getAxis("left").setWidth(left)
            plot.setMouseEnabled(x=True, y=False)
            plot.showGrid(y=True, alpha=0.2)
            if number < count - 1:
                plot.getAxis("bottom").setStyle(showValues=False)
                plot.getAxis("bottom").setHeight(4)
            if number:
                plot.setXLink(self.plots[0])
        on_language_change(self, self.refresh)

    def show_data(self, data: Data) -> None:
        """Show these data."""
        self._data = data
        self.refresh()

    def draw(self, data: Data) -> None:
        """Draw the present data into empty plots."""
        raise NotImplementedError

    def refresh(self) -> None:
        """Draw again, now or when shown next."""
        self._outdated = True
        if self.isVisible():
            self._redraw()

    def showEvent(self, event: QShowEvent) -> None:
        """Draw what has changed meanwhile."""
        super().showEvent(event)
        if self._outdated:
            self._redraw()

    def changeEvent(self, event: QEvent) -> None:
        """Draw in the colours of another theme."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange:
            self.refresh()

    def add(self, plot: ThemedPlot, item: pg.GraphicsObject, *, scaled: bool = True) -> None:
        """Add an item until the next drawing; one that is not `scaled` does not change the range shown."""
        plot.addItem(item, ignoreBounds=not scaled)
        self._items.append((plot, item))

    def add_bands(self, bands: Sequence[Band]) -> None:
        """Shade every second stage in all plots, and name the stages at the top where there is room."""
        c = theme.colours()
        span = max((end for _, _, end in bands), default=0.0) - min((b for _, b, _ in bands), default=0.0)
        for plot in self.plots:
            for number, (name, begin, end) in enumerate(bands):
                shade = QColor(c.text)
                shade.setAlpha(16 if number % 2 == 0 else 0)
                region = pg.LinearRegionItem((begin, end), movable=False, brush=shade, pen=pg.mkPen(c.line))
                region.setZValue(-20)
                self.add(plot, region, scaled=False)
                if plot is self.plots[0] and end - begin > _PER_CHARACTER * len(name) * span:
                    label = pg.InfLineLabel(region.lines[0], name, position=0.99, anchors=[(0, 0), (0, 0)])
                    label.setColor(QColor(c.muted))
                    label.setFont(theme.font())

    def _redraw(self) -> None:
        for plot, item in self._items:
            plot.removeItem(item)
        self._items.clear()
        self._outdated = False
        if self._data is not None:
            self.draw(self._data)


def name_axis(plot: ThemedPlot, side: str, text: str) -> None:
    """Name an axis, ``left`` or ``bottom``, in the window's font."""
    plot.setLabel(side, text)
    plot.getAxis(side).label.setFont(theme.font())


def dashed(colour: str) -> pg.GraphicsObject:
    """A thin dashed pen."""
    return pg.mkPen(colour, width=1, style=Qt.PenStyle.DashLine)
