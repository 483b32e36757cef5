"""Curves of the parameters over the temperature of the unit, with the values at the measured temperatures."""

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QResizeEvent

from calstation.gui.text import bind, parameter_text, say, with_minus
from calstation.gui.widgets import theme
from calstation.gui.widgets.file_dialog import set_subject
from calstation.gui.widgets.layout import ElidedLabel, column, combo_box, fill_combo, label, row
from calstation.gui.widgets.plot import PlotNote, ThemedPlot, fit_below_note
from calstation.gui.widgets.stacked_plots import StackedPlots, dashed
from calstation.messages import plain_number
from calstation.physics import FloatArray, display, number
from calstation.results import Result, TemperatureResult

#: Symbol in plots, symbol in the legend, and axis whose colour is used, for each direction of temperature change.
_DIRECTIONS = {"up": ("t1", "▲", "y"), "down": ("t", "▼", "x"), "soak": ("o", "●", "z")}
#: Margin of the temperature axis at each end, as a fraction of the range.
_MARGIN = 0.06
_AXIS_WIDTH = 8 * theme.GRID
#: Minimum height at which both plots are shown, px.
_MIN_HEIGHT_FOR_BOTH = 36 * theme.GRID


class TemperatureCurves(StackedPlots[Result]):
    """A parameter over temperature with sigma, limits and points; `differences` adds a plot of points minus curve.

    The temperatures outside the range are shaded. Points after a rise, after a fall and at the start have their own
    symbols and colours; the symbols of points that were held out are hollow.
    """

    def __init__(self, name: str, *, differences: bool = True) -> None:
        super().__init__(2 if differences else 1, _AXIS_WIDTH)
        self._combo = combo_box(name, fit=True, characters=18)
        self._combo.currentIndexChanged.connect(lambda _: self.refresh())
        bind(self._combo.setAccessibleName, "common.parameter")
        self._worst = ElidedLabel("muted")
        self._note = PlotNote(self.plots[0].getViewBox())
        for plot in self.plots:
            bind(plot.setAccessibleName, "common.over_temperature")
            plot.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        caption = label("common.parameter", buddy=self._combo)
        shares = zip(self.plots, (5, 4), strict=False)
        column(row(caption, self._combo, (self._worst, 1)), *shares, on=self, spacing=theme.GRID // 2)
        self.plots[0].getViewBox().sigResized.connect(self._fit)
        self._values: list[FloatArray] = []
        self.has_curves = False  #: Whether the last result was one over temperature.

    def show_result(self, result: Result | None) -> None:
        """Show a result, if it is one over temperature."""
        over = None if result is None else result.temperature
        self.has_curves = over is not None
        if result is None or over is None:
            return
        changing = over.largest_changes
        names = sorted(over.coefficients, key=lambda name: name not in changing)  # temperature-dependent first
        chosen = self._combo.currentData()
        fill_combo(self._combo, [(parameter_text(name), name) for name in names], chosen)
        self.show_data(result)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Show the differences only if there is enough space."""
        super().resizeEvent(event)
        self._arrange()

    def _arrange(self) -> None:
        """Show the plot of differences if there is space, otherwise the temperature axis of the upper plot."""
        both = len(self.plots) > 1 and self.height() >= _MIN_HEIGHT_FOR_BOTH
        for plot in self.plots[1:]:
            plot.setVisible(both)
        axis = self.plots[0].getAxis("bottom")
        axis.setStyle(showValues=not both)
        axis.showLabel(not both)
        axis.setHeight(4 if both else None)

    def draw(self, data: Result) -> None:
        """Draw the chosen parameter."""
        over, name = data.temperature, self._combo.currentData()
        if over is None or name not in over.coefficients:
            return
        self._combo_texts(data)
        set_subject(self, f"{data.serial}_{name}")
        size, unit = display(name, 1.0)
        temperatures = over.temperatures
        values, sigmas = (size * each for each in data.curve(name, temperatures))
        self._show_worst(data, name)
        self._values = [values - sigmas, values + sigmas]
        for plot, middle in zip(self.plots, (values, 0.0 * values), strict=False):
            self._frame(plot, over)
            self._curve(plot, temperatures, middle, sigmas)
        self._points(data, over, name)
        self._limits(data, name)
        self.plots[0].setLabel("left", unit)
        for plot in self.plots:
            plot.getAxis("bottom").setLabel(say("logs.temperature_celsius"))
        self._arrange()
        if len(self.plots) > 1:
            self.plots[1].setLabel("left", say("common.minus_curve", unit=unit))
        low, high = over.range_c
        margin = _MARGIN * (high - low)
        self.plots[0].setXRange(low - margin, high + margin, padding=0.0)
        self._fit()
        self._note.say(self._legend(data, over, name))

    def _combo_texts(self, result: Result) -> None:
        """Show the names of the parameters in the current language."""
        for index in range(self._combo.count()):
            self._combo.setItemText(index, parameter_text(self._combo.itemData(index)))

    def _show_worst(self, result: Result, name: str) -> None:
        worst, at = result.worst(name)
        (value, unit), sigma = display(name, worst.value), display(name, worst.sigma)[0]
        texts = {"value": number(value, sigma), "sigma": number(sigma, sigma), "unit": unit, "at": at}
        code = "common.constant_over_range" if at is None else "common.worst_over_range"
        self._worst.setText(with_minus(say(code, **texts)))

    def _frame(self, plot: ThemedPlot, over: TemperatureResult) -> None:
        """Mark the reference temperature, and shade the temperatures outside the range."""
        c, (low, high) = theme.colours(), over.range_c
        far = 10.0 * (high - low)
        for begin, end in ((low - far, low), (high, high + far)):
            region = pg.LinearRegionItem(
                (begin, end), movable=False, brush=theme.faint(c.text, 26), pen=theme.pen(c.line)
            )
            region.setZValue(-20)
            self.add(plot, region, scaled=False)
        line = pg.InfiniteLine(over.reference_c, 90, pen=theme.pen(c.muted, 1, Qt.PenStyle.DotLine))
        self.add(plot, line, scaled=False)

    def _curve(self, plot: ThemedPlot, x: FloatArray, middle: FloatArray, sigmas: FloatArray) -> None:
        colour = theme.colours().text
        ends = [
            pg.PlotDataItem(x, middle + sign * sigmas, pen=theme.pen(theme.faint(colour, 90))) for sign in (-1.0, 1.0)
        ]
        for end in ends:
            self.add(plot, end)
        band = pg.FillBetweenItem(*ends, brush=theme.faint(colour, 40))
        band.setZValue(-10)
        self.add(plot, band)
        self.add(plot, pg.PlotDataItem(x, middle, pen=theme.pen(colour, 1.5)))

    def _points(self, data: Result, over: TemperatureResult, name: str) -> None:
        size, panel = display(name, 1.0)[0], QColor(theme.colours().panel)
        points = [point for point in over.points if name in point.values]
        at = np.array([point.at_c for point in points])
        values = size * np.array([point.values[name] for point in points])
        sigmas = abs(size) * np.array([point.sigma[name] for point in points])
        self._values += [values - sigmas, values + sigmas]
        curve = size * data.curve(name, at)[0]
        for plot, y in zip(self.plots, (values, values - curve), strict=False):
            for k, point in enumerate(points):
                symbol, _, axis = _DIRECTIONS[point.way]
                colour = QColor(theme.axis_text(axis))
                pen = theme.pen(colour, 1.5)
                bar = pg.ErrorBarItem(x=at[[k]], y=y[[k]], height=2.0 * sigmas[[k]], beam=1.2, pen=pen)
                self.add(plot, bar)
                brush = pg.mkBrush(panel if point.held_out else colour)
                style = {"symbol": symbol, "size": 11, "pen": pen, "brush": brush, "antialias": True}
                self.add(plot, pg.ScatterPlotItem(at[[k]], y[[k]], **style))

    def _limits(self, data: Result, name: str) -> None:
        """Draw the limits of the value in the upper and the limit of the sigma in the lower plot."""
        size = display(name, 1.0)[0]
        pen = dashed(theme.colours().caution)
        for check in data.checks:
            if check.subject == name and check.kind == "within" and isinstance(check.limit, tuple):
                for bound in check.limit:
                    self.add(self.plots[0], pg.InfiniteLine(size * bound, 0, pen=pen), scaled=False)
            if check.subject == name and check.kind == "sigma_below" and len(self.plots) > 1:
                for sign in (-1.0, 1.0):
                    self.add(
                        self.plots[1],
                        pg.InfiniteLine(sign * size * float(np.max(check.limit)), 0, pen=pen),
                        scaled=False,
                    )

    def _legend(self, data: Result, over: TemperatureResult, name: str) -> list[tuple[str, str]]:
        """Return the symbols of the directions that occur, and the meanings of hollow symbols and of the lines."""
        c = theme.colours()
        parts = [
            (f"{letter} {say(f'common.way_{way}')}", theme.axis_text(axis))
            for way, (_, letter, axis) in _DIRECTIONS.items()
            if any(point.way == way for point in over.points)
        ]
        if any(point.held_out for point in over.points):
            parts.append((say("common.held_out_hollow"), c.text))
        parts.append((say("common.reference_temperature", value=over.reference_c), c.muted))
        for check in data.checks:
            if check.subject == name and check.kind == "within" and isinstance(check.limit, tuple):
                low, high = sorted(display(name, bound)[0] for bound in check.limit)
                below, above = (plain_number(bound, ".4g") for bound in (low, high))
                text = f"±{above}" if low == -high else f"{below} … {above}"
                shown_from, shown_to = self.plots[0].getViewBox().viewRange()[1]
                outside = high < shown_from or low > shown_to or (low < shown_from and high > shown_to)
                code = "common.limit_outside" if outside else "common.limit_dashed"
                parts.append((say(code, limit=with_minus(text)), c.caution))
        return parts

    def _fit(self) -> None:
        """Fit the vertical range to curve, points and limits, below the legend."""
        values = np.concatenate([*self._values, np.empty(0)])
        values = values[np.isfinite(values)]
        if len(values):
            low, high = float(values.min()), float(values.max())
            fit_below_note(self.plots[0].getPlotItem(), low, high, 1e-9 + 1e-3 * max(abs(low), abs(high)))
