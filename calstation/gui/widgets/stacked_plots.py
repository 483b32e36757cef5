"""Stacked plots with a common horizontal axis."""

from collections.abc import Sequence

import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QShowEvent
from PySide6.QtWidgets import QWidget

from calstation.gui.widgets import theme
from calstation.gui.widgets.layout import Data, DataView
from calstation.gui.widgets.plot import ThemedPlot

#: Name of a stage, and start and end of its band on the horizontal axis.
Band = tuple[str, float, float]

#: Minimum width per character of the name of a band, as a fraction of the width of the plot.
_MIN_CHARACTER_WIDTH = 0.008


class StackedPlots(QWidget, DataView[Data]):
    """Base class of views with `count` linked plots, whose left axes are `left` px wide.

    `draw` is called for new data and after a change of language or theme, but not while the view is hidden.
    """

    def __init__(self, count: int, left: int) -> None:
        super().__init__()
        self._outdated = True
        self._items: list[tuple[ThemedPlot, pg.GraphicsObject]] = []
        self.plots = tuple(ThemedPlot() for _ in range(count))
        for number, plot in enumerate(self.plots):
            plot.getAxis("left").setWidth(left)
            plot.showGrid(y=True, alpha=0.2)
            if number < count - 1:
                plot.getAxis("bottom").setStyle(showValues=False)
                plot.getAxis("bottom").setHeight(4)
            plot.getViewBox().sig_reset.connect(self._reset)
            if number:
                plot.setXLink(self.plots[0])
        theme.on_appearance_change(self, self.refresh)

    def refresh(self) -> None:
        """Redraw now or, if the view is hidden, when it is next shown."""
        self._outdated = True
        if self.isVisible():
            self._redraw()

    def showEvent(self, event: QShowEvent) -> None:
        """Redraw if anything changed while the view was hidden."""
        super().showEvent(event)
        if self._outdated:
            self._redraw()

    def add(self, plot: ThemedPlot, item: pg.GraphicsObject, *, scaled: bool = True) -> None:
        """Add an item that is removed at the next redraw; it affects the axis range only if `scaled`."""
        plot.addItem(item, ignoreBounds=not scaled)
        self._items.append((plot, item))

    def add_bands(self, bands: Sequence[Band]) -> None:
        """Shade every second stage in all plots, and label the stages at the top if there is enough space."""
        c = theme.colours()
        span = max((end for _, _, end in bands), default=0.0) - min((b for _, b, _ in bands), default=0.0)
        for plot in self.plots:
            for number, (name, begin, end) in enumerate(bands):
                shade = theme.faint(c.text, 16 if number % 2 == 0 else 0)
                region = pg.LinearRegionItem((begin, end), movable=False, brush=shade, pen=theme.pen(c.line))
                region.setZValue(-20)
                self.add(plot, region, scaled=False)
                if plot is self.plots[0] and end - begin > _MIN_CHARACTER_WIDTH * len(name) * span:
                    label = pg.InfLineLabel(region.lines[0], name, position=0.99, anchors=[(0, 0), (0, 0)])
                    label.setColor(QColor(c.muted))
                    label.setFont(theme.font())

    def _reset(self) -> None:
        for plot in self.plots:
            plot.getViewBox().reset()

    def _redraw(self) -> None:
        for plot, item in self._items:
            plot.removeItem(item)
        self._items.clear()
        self._outdated = False
        super().refresh()


def time_unit(duration: float) -> float:
    """Return the unit of the time axis, s, which is 60 for a `duration` of more than three minutes and 1 otherwise."""
    return 60.0 if duration > 180.0 else 1.0


def dashed(colour: str) -> pg.GraphicsObject:
    """Return a thin dashed pen."""
    return theme.pen(colour, 1, Qt.PenStyle.DashLine)
