"""Convergence of the sigmas: one line per parameter group, as a multiple of its target, which is dashed."""

import time
from collections.abc import Mapping

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QFrame, QWidget

from calstation.gui.text import on_language_change, term
from calstation.gui.widgets import LineLabel, LineLabels, ThemedPlot, column, label, row, theme
from calstation.physics import DISPLAY

#: Points kept per line; beyond that every other one is dropped.
_KEPT = 2000

#: Least span of the time axis, min.
_SHORTEST = 0.1

#: Host time between two drawings, s.
_DRAW_EVERY = 0.25


class Convergence(QFrame):
    """Plots the sigma of each group over device time as a multiple of its target."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("kind", "panel")
        self._targets: dict[str, float] = {}
        self._times: dict[str, list[float]] = {}
        self._ratios: dict[str, list[float]] = {}
        self._curves: dict[str, pg.PlotCurveItem] = {}
        self._now = 0.0
        self._drawn = 0.0
        self._plot = ThemedPlot()
        self._plot.getPlotItem().setContentsMargins(0, theme.GRID, 0, 0)
        self._plot.getAxis("left").setWidth(7 * theme.GRID)
        self._plot.getViewBox().setMouseEnabled(x=False, y=False)
        box = self._plot.getViewBox()
        box.sigTransformChanged.connect(self._label_lines)
        box.sigResized.connect(self._label_lines)
        self._target = pg.InfiniteLine(0.0, angle=0)
        self._plot.addItem(self._target)
        self._labels = LineLabels(38 * theme.GRID)
        column(
            label(lambda: self.tr("Sigma as a multiple of its target"), "muted"),
            (row((self._plot, 1), self._labels, spacing=0), 1),
            on=self,
            spacing=0,
            margins=(theme.GRID,) * 4,
        )
        on_language_change(self, self._show_labels)
        self._dress()

    def start(self, targets: Mapping[str, float]) -> None:
        """Start a new run with these targets per group, SI."""
        for curve in self._curves.values():
            self._plot.removeItem(curve)
        self._targets = dict(targets)
        self._times = {group: [] for group in targets}
        self._ratios = {group: [] for group in targets}
        self._curves = {}
        for group in targets:
            curve = pg.PlotCurveItem(skipFiniteCheck=True)
            self._plot.addItem(curve)
            self._curves[group] = curve
        self._now = 0.0
        self._dress()
        self.draw()

    def take(self, at: float, sigma: Mapping[str, float]) -> None:
        """Add sigmas per group, SI, at device time `at`, s since the start of the first stage."""
        self._now = max(self._now, at)
        for group, value in sigma.items():
            if group not in self._targets or not value > 0.0:
                continue
            times, ratios = self._times[group], self._ratios[group]
            ratio = value / self._targets[group]
            if len(ratios) > 1 and ratios[-1] == ratios[-2] == ratio:
                times[-1] = self._now
                continue
            times.append(self._now)
            ratios.append(ratio)
            if len(times) > _KEPT:
                del times[1:-1:2], ratios[1:-1:2]
        if time.monotonic() - self._drawn >= _DRAW_EVERY:
            self.draw()

    def arrived(self, group: str) -> bool:
        """Whether the sigma of a group has reached its target."""
        ratios = self._ratios.get(group)
        return bool(ratios) and ratios is not None and ratios[-1] <= 1.0

    def draw(self) -> None:
        """Update the plot."""
        self._drawn = time.monotonic()
        shown = [ratio for ratios in self._ratios.values() for ratio in ratios]
        low = np.log10(min([0.3, *shown])) - 0.1
        high = np.log10(max([30.0, *shown])) + 0.1
        for group, curve in self._curves.items():
            times, ratios = self._times[group], self._ratios[group]
            if times:  # the last value holds until now
                curve.setData(np.array([*times, self._now]) / 60.0, np.log10([*ratios, ratios[-1]]))
        decades = range(int(np.ceil(low)), int(np.floor(high)) + 1)
        self._plot.getAxis("left").setTicks([[(d, f"{10.0**d:g}") for d in decades], []])
        self._plot.setYRange(low, high, padding=0.0)
        self._plot.setXRange(0.0, max(_SHORTEST, self._now / 60.0), padding=0.0)
        self._label_lines()

    def _show_labels(self) -> None:
        self._plot.setLabel("bottom", self.tr("device time, min"))
        self._label_lines()

    def changeEvent(self, event: QEvent) -> None:
        """Follow the theme."""
        if event.type() == QEvent.Type.PaletteChange:
            self._dress()
        super().changeEvent(event)

    def _dress(self) -> None:
        c = theme.colours()
        self._target.setPen(pg.mkPen(c.text, width=1, style=Qt.PenStyle.DashLine))
        for curve in self._curves.values():
            curve.setPen(pg.mkPen(c.muted, width=1))
        self._label_lines()

    def _label_lines(self) -> None:
        c = theme.colours()
        box = self._plot.getViewBox()

        def height(ratio: float) -> float:
            return float(box.mapViewToScene(pg.Point(0.0, float(np.log10(ratio)))).y())

        labels = [LineLabel(height(1.0), self.tr("target"), QColor(c.text), bold=True)]
        for group, ratios in self._ratios.items():
            if not ratios:
                continue
            unit, size = DISPLAY[group]
            words = term("group", group)
            value = f"{_plain(ratios[-1] * self._targets[group] / size)} {unit}"
            if self.arrived(group):
                text = self.tr("{group} {value} reached").format(group=words, value=value)
                labels.append(LineLabel(height(ratios[-1]), text, QColor(c.good), "good"))
            else:
                labels.append(LineLabel(height(ratios[-1]), f"{words} {value}", QColor(c.text)))
        self._labels.show_labels(labels)


def _plain(value: float) -> str:
    """Two digits, without a power of ten."""
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"
