"""Control charts of one quantity over runs: individuals, moving range, and EWMA or CUSUM."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pyqtgraph as pg
from PySide6.QtGui import QColor

from calstation.gui.text import say
from calstation.gui.widgets import ElidedLabel, StackedPlots, ThemedPlot, column, dashed, theme
from calstation.physics import FloatArray, IntArray, display, number
from calstation.quality import Charts, CusumChart, EwmaChart, ParameterQuality

#: The chart at the bottom.
Slow = Literal["ewma", "cusum"]

#: Largest number of runs whose points are drawn individually, and of marks at runs that signal. For more runs, the
#: extremes in each pixel are drawn; for more marks, every n-th.
_MAX_POINTS, _MAX_MARKS = 400, 2000
#: Width of the left axes, px.
_AXIS = 9 * theme.GRID


@dataclass(frozen=True)
class Shown:
    """A parameter with its charts, and the name and the unit in which they are displayed."""

    parameter: ParameterQuality
    charts: Charts
    quantity: str
    unit: str
    size: float  #: Factor from the values of the charts to the displayed unit.


class ControlCharts(StackedPlots[Shown]):
    """Individuals, moving range, and below them EWMA or CUSUM against the run number."""

    def __init__(self) -> None:
        self._slow: Slow = "ewma"
        self._chosen: int | None = None
        self._titles = tuple(ElidedLabel("muted") for _ in range(3))
        super().__init__(3, _AXIS)
        parts = zip(self._titles, self.plots, (5, 3, 4), strict=True)
        column(*(item for title, plot, share in parts for item in (title, (plot, share))), on=self, spacing=0)

    def show_slow(self, slow: Slow) -> None:
        """Show another chart at the bottom."""
        self._slow = slow
        self.refresh()

    def show_data(self, data: Shown) -> None:
        """Show the charts of another parameter, without a marked run."""
        self._chosen = None
        super().show_data(data)

    def choose(self, run: int | None) -> None:
        """Mark a run by its index in all charts; None for no mark."""
        if run != self._chosen:
            self._chosen = run
            self.refresh()

    def draw(self, data: Shown) -> None:
        """Draw the charts."""
        c, size = theme.colours(), data.size
        chart, ewma, cusum = data.charts.individuals, data.charts.ewma, data.charts.cusum
        process = data.parameter.process
        top, middle, bottom = self.plots
        top.setLabel("left", data.unit)
        middle.setLabel("left", data.unit)
        bottom.setLabel("bottom", say("quality.axis_run"))
        self._lines(top, size * chart.center, [size * chart.low, size * chart.high])
        self._values(top, size * chart.values, chart.signals.index)
        self._lines(middle, size * chart.range_center, [size * chart.range_high])
        self._values(middle, size * chart.ranges, chart.range_signals - 1, first=1)
        if self._slow == "ewma":
            bottom.setLabel("left", data.unit)
            self._draw_ewma(bottom, ewma, size)
            slow = say("quality.ewma_limits", weight=ewma.weight, width=ewma.width)
        else:
            self._draw_cusum(bottom, cusum)
            slow = say("quality.cusum_limits", allowance=cusum.allowance, decision=cusum.decision)
        if 0 < process.baseline < len(chart.values):
            for plot in self.plots:
                end = pg.InfiniteLine(process.baseline + 0.5, 90, pen=pg.mkPen(c.line, width=1))
                self.add(plot, end, scaled=False)
        if self._chosen is not None:
            for plot in self.plots:
                mark = pg.InfiniteLine(self._chosen + 1, 90, pen=pg.mkPen(c.accent, width=1))
                self.add(plot, mark, scaled=False)
        about = [say(f"chart.limits_{process.source}", count=process.baseline)]
        if data.parameter.declared:
            about.append(say("chart.center_reference"))
        if (effects := data.parameter.effects) is not None:
            (mean, unit), (between, _) = (display(data.parameter.parameter, x) for x in (effects.mean, effects.between))
            words = {"mean": number(mean, between), "between": number(between, between), "unit": unit}
            about.append(say("chart.effects", **words))
        limits = say("quality.semicolon").join(about)
        width = process.widths.individuals
        individuals = say("quality.individuals", quantity=data.quantity, width=width, slow=limits)
        texts = individuals, say("quality.moving_range"), slow
        for title, text in zip(self._titles, texts, strict=True):
            title.setText(text)

    def _draw_ewma(self, plot: ThemedPlot, chart: EwmaChart, size: float) -> None:
        c = theme.colours()
        run = np.arange(1, len(chart.average) + 1)
        self._lines(plot, size * chart.center, [])
        for limit in (chart.low, chart.high):
            line = pg.PlotDataItem(run, size * limit, pen=dashed(c.bad))
            line.setDownsampling(auto=True, method="peak")
            self.add(plot, line)
        self._values(plot, size * chart.average, chart.signals)

    def _draw_cusum(self, plot: ThemedPlot, chart: CusumChart) -> None:
        plot.setLabel("left", "σ")
        self._lines(plot, 0.0, [-chart.decision, chart.decision])
        self._values(plot, chart.upper, chart.signals_high)
        self._values(plot, -chart.lower, chart.signals_low)

    def _lines(self, plot: ThemedPlot, center: float, limits: list[float]) -> None:
        c = theme.colours()
        self.add(plot, pg.InfiniteLine(center, 0, pen=pg.mkPen(c.line, width=1)), scaled=False)
        for limit in limits:
            self.add(plot, pg.InfiniteLine(limit, 0, pen=dashed(c.bad)), scaled=False)
            # include the limits in the vertical range
            self.add(plot, pg.PlotDataItem([1.0], [limit], pen=pg.mkPen(None)))

    def _values(self, plot: ThemedPlot, values: FloatArray, signals: IntArray, first: int = 0) -> None:
        """Draw values starting at run number `first` + 1, and mark the `signals`."""
        c = theme.colours()
        run = np.arange(first + 1, first + 1 + len(values))
        line = pg.PlotDataItem(run, values, pen=pg.mkPen(c.muted, width=1))
        if len(values) <= _MAX_POINTS:
            line.setSymbol("o")
            line.setSymbolSize(5)
            line.setSymbolBrush(QColor(c.accent))
            line.setSymbolPen(None)
        else:
            line.setDownsampling(auto=True, method="peak")
        self.add(plot, line)
        signals = signals[:: max(1, -(-len(signals) // _MAX_MARKS))]
        mark = pg.ScatterPlotItem(run[signals], values[signals], symbol="s", size=9, pen=pg.mkPen(c.bad, width=2))
        mark.setBrush(None)
        self.add(plot, mark)
