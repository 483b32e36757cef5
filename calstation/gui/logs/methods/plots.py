"""Plots with a legend at the top, and large numbers that compare values before and after a calibration."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QWidget

from calstation.gui.text import with_minus
from calstation.gui.widgets import LogAxis, PlotNote, ThemedPlot, column, dashed, fit_below_note, label, theme
from calstation.physics import DEGREE_PER_HOUR, MICRO_G, FloatArray

#: Display unit of small rates or specific forces, and its size in SI, by sensor.
SENSOR_UNITS = {"gyro": ("°/h", DEGREE_PER_HOUR), "accel": ("µg", MICRO_G)}


class MethodPlot(ThemedPlot):
    """A plot with a legend at the top; `log` and `log_x` make the vertical and the horizontal axis logarithmic."""

    def __init__(self, *, log: bool = False, log_x: bool = False) -> None:
        super().__init__()
        self._log = log
        logarithmic = [side for side, is_log in (("left", log), ("bottom", log_x)) if is_log]
        if logarithmic:
            self.getPlotItem().setAxisItems({side: LogAxis(side) for side in logarithmic})
            self.setLogMode(x=log_x, y=log)
        self.getAxis("left").setWidth(8 * theme.GRID)
        for side in ("left", "bottom"):
            self.getAxis(side).setStyle(tickFont=theme.font(), hideOverlappingLabels=True)
            self.getAxis(side).enableAutoSIPrefix(False)
        self.getViewBox().setDefaultPadding(0.02)
        self.getPlotItem().setContentsMargins(0, 0, theme.GRID, 0)
        self._note = PlotNote(self.getViewBox())
        self._values: list[FloatArray] = []
        self.getViewBox().sigResized.connect(self._fit)
        self.apply_theme()

    def empty(self) -> None:
        """Clear the plot."""
        self.getPlotItem().clear()
        self._values = []

    def finish(self, note: Sequence[tuple[str, str]]) -> None:
        """Show a legend of pairs of text and colour, and fit the vertical range to the data."""
        self._note.say(note)
        self._fit()

    def line(self, x: FloatArray, y: FloatArray, colour: str, *, faint: bool = False, bold: bool = False) -> None:
        """Draw a line, with a break at each NaN.

        Parameters
        ----------
        x, y
            Coordinates, shape (n,).
        colour
            Colour as ``#rrggbb``.
        faint, bold
            Whether the line is drawn faint, and whether it is drawn bold.
        """
        shade = theme.faint(colour, 110 if faint else 255)
        self._add(x, y, pen=theme.pen(shade, 2.5 if bold else 1), connect="finite")

    def dots(self, x: FloatArray, y: FloatArray, colour: str, *, hollow: bool = False) -> None:
        """Draw filled or hollow dots; hollow dots represent values before the calibration."""
        brush = QColor(theme.colours().panel) if hollow else QColor(colour)
        size = 8 if hollow else 7
        pen = theme.pen(colour, 1.5)
        self._add(x, y, pen=None, symbol="o", symbolSize=size, symbolPen=pen, symbolBrush=brush)

    def limit(self, value: float, colour: str) -> None:
        """Draw a dashed line across the plot."""
        position = np.log10(value) if self._log else value
        self.addItem(pg.InfiniteLine(position, angle=0, pen=dashed(colour)), ignoreBounds=True)
        self._values.append(np.array([value]))

    def span(self, values: FloatArray) -> None:
        """Extend the vertical range to include these values."""
        self._values.append(values)

    @property
    def limits(self) -> tuple[float, float]:
        """The smallest and the largest value of the vertical range."""
        values = np.concatenate(self._values)
        values = values[np.isfinite(values)]
        return float(values.min()), float(values.max())

    def shade(self, begin: float, end: float) -> None:
        """Shade a time range behind the curves."""
        colour = theme.faint(theme.colours().accent, 26)
        region = pg.LinearRegionItem((begin, end), movable=False, brush=colour, pen=pg.mkPen(None))
        region.setZValue(-20)
        self.addItem(region, ignoreBounds=True)

    def _fit(self) -> None:
        values = np.concatenate([*self._values, np.empty(0)])
        values = values[np.isfinite(values) & ((values > 0.0) if self._log else True)]
        if len(values):
            values = np.log10(values) if self._log else values
            low, high = float(values.min()), float(values.max())
            fit_below_note(self.getPlotItem(), low, high, 0.3 if self._log else max(abs(high), 1e-12) * 1e-3)

    def _add(self, x: FloatArray, y: FloatArray, **style: Any) -> None:
        self.addItem(pg.PlotDataItem(np.asarray(x), np.asarray(y), **style))
        self._values.append(np.asarray(y))


class Figure(QWidget):
    """A caption above one large number, or above two numbers with an arrow between them."""

    def __init__(self, size: int = 28) -> None:
        super().__init__()
        self._caption, self.number = label(kind="muted"), label()
        self.number.setFont(theme.font(size, bold=True))
        self.number.setTextFormat(Qt.TextFormat.PlainText)
        column(self._caption, self.number, on=self, spacing=0)

    def show_change(self, caption: str, before: float, after: float, unit: str) -> None:
        """Show the values before and after, each with three significant digits."""
        self.show_text(caption, f"{three_digits(before)} → {three_digits(after)} {unit}")

    def show_text(self, caption: str, text: str) -> None:
        """Show a caption and a text."""
        self._caption.setText(caption)
        self.number.setText(text)


def three_digits(value: float) -> str:
    """Format a number with three significant digits, without an exponent up to 1e15."""
    if value == 0.0 or not abs(value) < 1e15:
        return f"{value:g}"
    digits = 2 - int(f"{abs(value):.2e}".partition("e")[2])
    return with_minus(f"{value:.{max(digits, 0)}f}")
