"""Charts of a repeatability study: shares of all parameters, and values and ranges of the selected parameter."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QWidget

from calstation.gui.text import parameter_text, say
from calstation.gui.widgets import (
    DataView,
    ElidedLabel,
    PlotNote,
    ThemedPlot,
    column,
    dashed,
    row,
    scroll_area,
    set_subject,
    theme,
)
from calstation.physics import FloatArray
from calstation.quality import ACCEPTABLE, MARGINAL, GaugeStudy, range_limits, ranges_beyond

#: Height of a parameter in the chart of all parameters, width of the axis with their names, and height of the axis
#: with the legend, px.
_ROW_HEIGHT, _NAMES_WIDTH, _AXIS_HEIGHT = 4 * theme.GRID, 24 * theme.GRID, 11 * theme.GRID
#: Components by the abbreviation of their name.
_PARTS = {"GRR": "gauge", "EV": "repeatability", "AV": "reproducibility", "PV": "part"}
#: Fraction of a row that its bars fill, and upper end of the horizontal axis in %.
_BARS_HEIGHT, _MAX_SHARE = 0.8, 100.0
#: Distance between the units of two appraisers in the chart of ranges, in units.
_GAP = 1.0


@dataclass(frozen=True)
class StudyValues:
    """The values of a parameter in a study, in the displayed unit, shape (units, appraisers, trials)."""

    parameter: str
    unit: str
    units: tuple[str, ...]  #: Serial numbers.
    appraisers: tuple[str, ...]  #: Operators, stations, or operators at stations.
    values: FloatArray


class ComponentsView(QWidget, DataView[Mapping[str, GaugeStudy]]):
    """The components of variation of all parameters as bars, below a legend and an axis that do not scroll."""

    def __init__(self) -> None:
        super().__init__()
        self.plot, self.axis = ThemedPlot(zoom=False), ThemedPlot(zoom=False)
        for plot in (self.plot, self.axis):
            plot.getAxis("left").setWidth(_NAMES_WIDTH)
        self.plot.getViewBox().invertY(True)
        self.plot.hideAxis("bottom")
        self.axis.getAxis("left").setTicks([[]])
        self.axis.setFixedHeight(_AXIS_HEIGHT)
        self.axis.setXLink(self.plot)
        self._note = PlotNote(self.axis.getViewBox())
        bars = scroll_area(self.plot, wide=False)
        bars.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOn)
        width = bars.verticalScrollBar().sizeHint().width()
        column(row((self.axis, 1), width, spacing=0), (bars, 1), on=self, spacing=0)
        theme.on_appearance_change(self, self.refresh)

    def draw(self, data: Mapping[str, GaugeStudy]) -> None:
        """Draw the shares of the tolerance or, without one, of the variation of the study."""
        c, plot = theme.colours(), self.plot
        plot.getPlotItem().clear()
        plot.getAxis("left").setTicks([[(k, parameter_text(name)) for k, name in enumerate(data)]])
        height, rows, parts = _BARS_HEIGHT / len(_PARTS), np.arange(len(data)), []
        colours = c.text, c.accent, c.partial, c.track
        for number, ((name, part), colour) in enumerate(zip(_PARTS.items(), colours, strict=True)):
            shares = [_share(study, part) for study in data.values()]
            y = rows + (number + 0.5) * height - 0.5 * _BARS_HEIGHT
            style = {"brush": QColor(colour), "pen": pg.mkPen(None)}
            plot.addItem(pg.BarGraphItem(x0=0, y=y, height=height, width=shares, **style))
            parts += [("■", colour), (name, c.text)]
        for limit in (ACCEPTABLE, MARGINAL):
            plot.addItem(pg.InfiniteLine(limit, 90, pen=dashed(c.bad)))
        limits = say("quality.limits_of_verdict", acceptable=ACCEPTABLE, marginal=MARGINAL)
        self._note.say([*parts, (f"┆ {limits}", c.bad)])
        self.axis.setLabel("bottom", say("quality.shares"))
        plot.setXRange(0.0, _MAX_SHARE, padding=0)
        plot.setYRange(-0.5, len(data) - 0.5, padding=0)
        plot.setMinimumHeight(_ROW_HEIGHT * len(data))


class StudyCharts(QWidget, DataView[StudyValues]):
    """Charts of a parameter: its values by unit and by appraiser, and the range of the trials of each appraiser."""

    def __init__(self) -> None:
        super().__init__()
        self.by_unit, self.by_appraiser, self.ranges = ThemedPlot(), ThemedPlot(), ThemedPlot()
        plots = (self.by_unit, self.by_appraiser, self.ranges)
        for plot in plots:
            plot.showGrid(y=True, alpha=0.2)
        self._titles = tuple(ElidedLabel("muted") for _ in plots)
        charts = [column(title, (plot, 1), spacing=0) for title, plot in zip(self._titles, plots, strict=True)]
        column((charts[0], 1), (row((charts[1], 1), (charts[2], 1)), 1), on=self)
        theme.on_appearance_change(self, self.refresh)

    def draw(self, data: StudyValues) -> None:
        """Draw the charts."""
        set_subject(self, data.parameter)
        for title, code in zip(self._titles, ("by_unit", "by_appraiser", "ranges"), strict=True):
            title.setText(say(f"quality.values_{code}"))
        for plot in (self.by_unit, self.by_appraiser, self.ranges):
            plot.getPlotItem().clear()
            plot.setLabel("left", data.unit)
        differing = (k for k, letters in enumerate(zip(*data.units, strict=False)) if len(set(letters)) > 1)
        prefix = data.units[0][: next(differing, 0)]
        units = [serial.removeprefix(prefix) or serial for serial in data.units]
        self.by_unit.setLabel("bottom", f"{say('gauge.unit')} ({prefix}…)" if prefix else say("gauge.unit"))
        _draw_values(self.by_unit, units, data.values.reshape(len(units), -1))
        by_appraiser = np.moveaxis(data.values, 1, 0).reshape(len(data.appraisers), -1)
        _draw_values(self.by_appraiser, _in_lines(data.appraisers), by_appraiser)
        self._draw_ranges(data)

    def _draw_ranges(self, data: StudyValues) -> None:
        """Draw the range of each unit, one line per appraiser, with the mean and the limits of all ranges."""
        c, plot = theme.colours(), self.ranges
        limits = range_limits(data.values)
        for value, pen in zip(limits, (dashed(c.bad), theme.pen(c.line, 1), dashed(c.bad)), strict=True):
            plot.addItem(pg.InfiniteLine(value, 0, pen=pen))
        ranges = np.ptp(data.values, axis=-1)
        count, all_beyond = len(data.units), ranges_beyond(data.values)
        ticks = []
        for number, name in enumerate(_in_lines(data.appraisers)):
            x = np.arange(count, dtype=np.float64) + number * (count + _GAP)
            _draw_points(plot, x, ranges[:, number], joined=True)
            beyond = all_beyond[:, number]
            style = {"symbol": "s", "size": 9, "pen": theme.pen(c.bad, 2), "brush": None}
            plot.addItem(pg.ScatterPlotItem(x[beyond], ranges[beyond, number], **style))
            ticks.append((float(x.mean()), name))
        plot.getAxis("bottom").setTicks([ticks])
        plot.setXRange(-_GAP, len(ticks) * (count + _GAP) - _GAP, padding=0)
        plot.setYRange(0.0, max(limits[2], float(ranges.max())))


def _share(study: GaugeStudy, part: str) -> float:
    """Return the percentage of a component on which the verdict is based."""
    variation = getattr(study, part)
    percent = variation.percent_tolerance
    return float(variation.percent_study if percent is None else percent)


def _in_lines(appraisers: Sequence[str]) -> list[str]:
    """Return the names of appraisers with operator and station in separate lines."""
    return [name.replace(", ", "\n") for name in appraisers]


def _draw_values(plot: ThemedPlot, names: Sequence[str], values: FloatArray) -> None:
    """Draw the values of each name, shape (names, values), and join their means."""
    x = np.arange(len(names))
    _draw_points(plot, np.repeat(x, values.shape[1]), values.ravel(), joined=False)
    means = {"symbol": "d", "symbolSize": 9, "symbolBrush": theme.colours().text, "symbolPen": None}
    plot.addItem(pg.PlotDataItem(x, values.mean(axis=1), pen=theme.pen(theme.colours().line, 1), **means))
    plot.getAxis("bottom").setTicks([list(enumerate(names))])
    plot.setXRange(-0.5, len(names) - 0.5, padding=0)


def _draw_points(plot: ThemedPlot, x: FloatArray, y: FloatArray, *, joined: bool) -> None:
    c = theme.colours()
    points = {"symbol": "o", "symbolSize": 5, "symbolBrush": QColor(c.accent), "symbolPen": None}
    plot.addItem(pg.PlotDataItem(x, y, pen=theme.pen(c.muted, 1) if joined else None, **points))
