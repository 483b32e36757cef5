"""Control charts of one parameter over runs: individuals, moving range, and EWMA or CUSUM."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pyqtgraph as pg
from PySide6.QtGui import QColor

from calstation.gui.text import say
from calstation.gui.widgets import ElidedLabel, StackedPlots, ThemedPlot, column, dashed, set_subject, theme
from calstation.physics import FloatArray, IntArray, display, number
from calstation.quality import Charts, EwmaChart, ParameterQuality

#: The kind of the chart at the bottom, which shows slow changes.
SlowChart = Literal["ewma", "cusum"]

#: Maximum number of runs that are drawn as single points, and of marks at runs that signal. If there are more runs, the
#: extremes in each pixel are drawn; if there are more marks, every n-th is drawn.
_MAX_POINTS, _MAX_MARKS = 400, 2000
#: Width of the left axes, px.
_AXIS_WIDTH = 9 * theme.GRID


@dataclass(frozen=True)
class ParameterCharts:
    """The charts of a parameter, and its displayed name and unit."""

    parameter: ParameterQuality
    charts: Charts
    quantity: str
    unit: str
    size: float  #: Factor by which the values of the charts are converted to the displayed unit.


class ControlCharts(StackedPlots[ParameterCharts]):
    """Plots of the individuals, the moving range and, at the bottom, the EWMA or CUSUM chart over the run number."""

    def __init__(self) -> None:
        self._slow: SlowChart = "ewma"
        self._marked_run: int | None = None
        self._titles = tuple(ElidedLabel("muted") for _ in range(3))
        super().__init__(3, _AXIS_WIDTH)
        parts = zip(self._titles, self.plots, (5, 3, 4), strict=True)
        column(*(item for title, plot, share in parts for item in (title, (plot, share))), on=self, spacing=0)

    def show_slow(self, slow: SlowChart) -> None:
        """Select the chart at the bottom."""
        self._slow = slow
        self.refresh()

    def show_data(self, data: ParameterCharts) -> None:
        """Show the charts of another parameter, without a marked run."""
        self._marked_run = None
        set_subject(self, data.parameter.parameter)
        super().show_data(data)

    def choose(self, run: int | None) -> None:
        """Mark the run with this index in all charts; None removes the mark."""
        if run != self._marked_run:
            self._marked_run = run
            self.refresh()

    def draw(self, data: ParameterCharts) -> None:
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
        first = len(chart.values) - len(chart.ranges)
        self._values(middle, size * chart.ranges, chart.range_signals - first, first=first)
        if self._slow == "ewma":
            bottom.setLabel("left", data.unit)
            self._draw_ewma(bottom, ewma, size)
            slow = say("quality.ewma_limits", weight=ewma.weight, width=ewma.width)
        else:
            bottom.setLabel("left", "σ")
            self._lines(bottom, 0.0, [-cusum.decision, cusum.decision])
            self._values(bottom, cusum.upper, cusum.signals_high)
            self._values(bottom, -cusum.lower, cusum.signals_low)
            slow = say("quality.cusum_limits", allowance=cusum.allowance, decision=cusum.decision)
        if 0 < data.parameter.baseline < len(chart.values):
            for plot in self.plots:
                end = pg.InfiniteLine(data.parameter.baseline + 0.5, 90, pen=theme.pen(c.line, 1))
                self.add(plot, end, scaled=False)
        if self._marked_run is not None:
            for plot in self.plots:
                mark = pg.InfiniteLine(self._marked_run + 1, 90, pen=theme.pen(c.accent, 1))
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

    def _lines(self, plot: ThemedPlot, center: float, limits: list[float]) -> None:
        c = theme.colours()
        self.add(plot, pg.InfiniteLine(center, 0, pen=theme.pen(c.line, 1)), scaled=False)
        for limit in limits:
            self.add(plot, pg.InfiniteLine(limit, 0, pen=dashed(c.bad)), scaled=False)
            # the vertical range includes the limits
            self.add(plot, pg.PlotDataItem([1.0], [limit], pen=pg.mkPen(None)))

    def _values(self, plot: ThemedPlot, values: FloatArray, signals: IntArray, first: int = 0) -> None:
        """Draw values that start at run number `first` + 1, and mark the values at the indices `signals`."""
        c = theme.colours()
        run = np.arange(first + 1, first + 1 + len(values))
        symbol = {"symbol": "o", "symbolSize": 5, "symbolBrush": QColor(c.accent), "symbolPen": None}
        line = pg.PlotDataItem(run, values, pen=theme.pen(c.muted, 1), **(symbol if len(values) <= _MAX_POINTS else {}))
        line.setDownsampling(auto=len(values) > _MAX_POINTS, method="peak")
        self.add(plot, line)
        signals = signals[:: max(1, -(-len(signals) // _MAX_MARKS))]
        style = {"symbol": "s", "size": 9, "pen": theme.pen(c.bad, 2), "brush": None}
        self.add(plot, pg.ScatterPlotItem(run[signals], values[signals], **style))
