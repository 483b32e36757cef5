"""Both joints' angles against time, stage by stage, with the table's travel."""

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QVBoxLayout, QWidget

from calstation.gui.engineer.bands import Bands, dashed
from calstation.gui.text.messages import term
from calstation.gui.widgets import theme
from calstation.gui.widgets.plot import ThemedPlot
from calstation.results.preview import Preview

#: Width of the axes' numbers, so that both plots' times stand above each other, px.
_LEFT = 9 * theme.GRID


class MotionPlot(QWidget):
    """The outer joint above the inner one."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._forecast: Preview | None = None
        self.plots = (ThemedPlot(), ThemedPlot())
        self._bands = (Bands(self.plots[0], named=True), Bands(self.plots[1], named=False))
        self._lines: list[pg.GraphicsObject] = []
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        for plot in self.plots:
            plot.getAxis("left").setWidth(_LEFT)
            plot.setMouseEnabled(x=True, y=False)
            plot.showGrid(y=True, alpha=0.2)
            plot.getPlotItem().getViewBox().setDefaultPadding(0.1)
            plot.setMinimumHeight(8 * theme.GRID)
            column.addWidget(plot, 1)
        self.plots[0].getAxis("bottom").setStyle(showValues=False)
        self.plots[0].getAxis("bottom").setHeight(4)
        self.plots[1].setXLink(self.plots[0])
        self.retranslate()

    def show_forecast(self, forecast: Preview | None) -> None:
        """Draw this course, or nothing."""
        self._forecast = forecast
        for plot in self.plots:
            for line in self._lines:
                plot.removeItem(line)
        self._lines.clear()
        if forecast is None:
            for bands in self._bands:
                bands.show(())
            return
        c = theme.colours()
        minutes = forecast.time / 60.0
        stages = [(term("stage", s.stage), s.begin / 60.0, s.end / 60.0) for s in forecast.stages]
        for plot, bands, angle, travel in zip(
            self.plots, self._bands, (forecast.outer, forecast.inner), forecast.travel, strict=True
        ):
            bands.show(stages)
            line = pg.PlotDataItem(minutes, np.rad2deg(angle), pen=pg.mkPen(c.accent, width=1))
            plot.addItem(line)
            self._lines.append(line)
            for edge in travel:
                if np.isfinite(edge):
                    limit = pg.InfiniteLine(np.rad2deg(edge), 0, pen=dashed(c.bad))
                    plot.addItem(limit, ignoreBounds=True)
                    self._lines.append(limit)
        self.plots[0].enableAutoRange()
        self.plots[1].enableAutoRange()
        self.plots[0].setXRange(0.0, max(forecast.duration / 60.0, 1e-3), padding=0.01)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self.plots[0].setLabel("left", self.tr("outer, °"))
        self.plots[1].setLabel("left", self.tr("inner, °"))
        self.plots[1].setLabel("bottom", self.tr("time, min"))
        for plot in self.plots:
            plot.getAxis("left").label.setFont(theme.font())
        if self._forecast is not None:
            self.show_forecast(self._forecast)

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language or theme."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        elif event.type() == QEvent.Type.PaletteChange and self._forecast is not None:
            self.show_forecast(self._forecast)
        super().changeEvent(event)
