"""Plots of the methods: thin axes, a line of words at their top that names what is drawn, time or turns below."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QWidget

from calstation.gui.widgets import ThemedPlot, theme
from calstation.physics import FloatArray

#: A word and its colour, in the note at the top of a plot.
Part = tuple[str, str]

_NOTE = 3.5 * theme.GRID
_AXIS = 8 * theme.GRID
_PALE = 110
#: Marks of a decade that carry a number.
_LABELLED = (1.0, 2.0, 5.0)


class _PlainLog(pg.AxisItem):  # type: ignore[misc]
    """Powers of ten as people write them: 0.01, 1, 100; beyond that as 10⁵."""

    def logTickStrings(self, values: Sequence[float], scale: float, spacing: float) -> list[str]:
        """One text per tick."""
        return [_plain(value) if _mantissa(value) in _LABELLED else "" for value in values]


def _mantissa(exponent: float) -> float:
    return round(float(10.0 ** (exponent - np.floor(exponent + 1e-9))), 6)


def _plain(exponent: float) -> str:
    whole = round(exponent)
    if abs(exponent - whole) > 1e-6:
        return f"{10.0**exponent:.3g}"
    return f"{10.0**whole:g}" if -4 <= whole <= 5 else f"10{str(whole).translate(_RAISED)}"


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class MethodPlot(ThemedPlot):
    """One plot; `log` : its vertical axis counts decades."""

    def __init__(self, *, log: bool = False, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._log = log
        if log:
            self.getPlotItem().setAxisItems({"left": _PlainLog("left")})
            self.setLogMode(y=True)
        self.getAxis("left").setWidth(_AXIS)
        self.getAxis("left").setStyle(tickFont=theme.font(), hideOverlappingLabels=True)
        self.getAxis("left").enableAutoSIPrefix(False)
        self.setMouseEnabled(x=True, y=False)
        self.getViewBox().setDefaultPadding(0.02)
        self.getPlotItem().setContentsMargins(0, 0, theme.GRID, 0)
        self._note = pg.TextItem(anchor=(0, 0))
        self._note.setFont(theme.font())
        self._note.setParentItem(self.getViewBox())
        self._note.setPos(4, 0)
        self._values: list[FloatArray] = []
        self.getViewBox().sigResized.connect(self.fit)
        self._dress()

    def say(self, parts: Sequence[Part]) -> None:
        """The line at the top, in coloured words."""
        spans = (f'<span style="color:{colour}">{word}</span>' for word, colour in parts)
        self._note.setHtml("&nbsp;&nbsp; ".join(spans))

    def empty(self) -> None:
        """Draw nothing."""
        self.getPlotItem().clear()
        self._values = []

    def line(self, x: FloatArray, y: FloatArray, colour: str, *, pale: bool = False, bold: bool = False) -> None:
        """A thin line, interrupted where `y` is NaN; a `pale` one stays behind what matters, a `bold` one matters."""
        shade = QColor(colour)
        shade.setAlpha(_PALE if pale else 255)
        self._add(x, y, pen=pg.mkPen(shade, width=2.5 if bold else 1), connect="finite")

    def dots(self, x: FloatArray, y: FloatArray, colour: str, *, hollow: bool = False, joined: bool = False) -> None:
        """Dots; hollow ones are what was before."""
        brush = QColor(theme.colours().panel) if hollow else QColor(colour)
        self._add(
            x,
            y,
            pen=pg.mkPen(colour, width=1) if joined else None,
            symbol="o",
            symbolSize=8 if hollow else 7,
            symbolPen=pg.mkPen(colour, width=1.5),
            symbolBrush=brush,
        )

    def limit(self, value: float, colour: str) -> None:
        """A dashed line across the plot."""
        at = np.log10(value) if self._log else value
        pen = pg.mkPen(colour, width=1, style=Qt.PenStyle.DashLine)
        self.addItem(pg.InfiniteLine(at, angle=0, pen=pen), ignoreBounds=True)
        self._values.append(np.array([value]))

    def shade(self, begin: float, end: float) -> None:
        """A stretch of time behind everything."""
        colour = QColor(theme.colours().accent)
        colour.setAlpha(26)
        region = pg.LinearRegionItem((begin, end), movable=False, brush=colour, pen=pg.mkPen(None))
        region.setZValue(-20)
        self.addItem(region, ignoreBounds=True)

    def fit(self) -> None:
        """The vertical range that holds what is drawn, with room for the words at the top."""
        if not self._values:
            return
        shown = np.concatenate(self._values)
        shown = shown[np.isfinite(shown) & ((shown > 0.0) if self._log else True)]
        if not len(shown):
            return
        shown = np.log10(shown) if self._log else shown
        bottom, top = float(shown.min()), float(shown.max())
        span = max(top - bottom, 0.3 if self._log else max(abs(top), 1e-12) * 1e-3)
        height = max(float(self.getViewBox().height()), 3.0 * _NOTE)
        bottom, top = bottom - 0.08 * span, top + 0.08 * span
        self.setYRange(bottom, top + (top - bottom) * _NOTE / (height - _NOTE), padding=0)

    def _add(self, x: FloatArray, y: FloatArray, **looks: Any) -> None:
        self.addItem(pg.PlotDataItem(np.asarray(x), np.asarray(y), **looks))
        self._values.append(np.asarray(y))
