"""The view of a gimbal solution: drift in each turn, drift predicted from the gain, and range of stable gains."""

import numpy as np
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QFrame, QWidget

from calstation.gui.logs.methods.plots import MethodPlot, three_digits
from calstation.gui.text import say
from calstation.gui.widgets import (
    DataView,
    StateBadge,
    box,
    clear,
    column,
    label,
    panel,
    row,
    scroll_area,
    theme,
)
from calstation.physics import ARCSECOND
from calstation.results.plots import GimbalAxis, GimbalPlotData


class GimbalView(QWidget, DataView[GimbalPlotData]):
    """Plots of the drift in each turn: measured (dots), predicted (thin line), and its threshold (dashed line)."""

    def __init__(self) -> None:
        super().__init__()
        self.badges: list[StateBadge] = []
        self.plot = MethodPlot(log=True)
        self.plot.getAxis("bottom").setTickSpacing(1.0, 1.0)
        self._panels = column()
        parts = (self.plot, 11), (scroll_area(box(self._panels)), 8)
        row(*parts, on=self, spacing=2 * theme.GRID, margins=(0, theme.GRID, 0, 0))
        theme.on_appearance_change(self, self.refresh)

    def draw(self, data: GimbalPlotData) -> None:
        """Draw a solution."""
        c = theme.colours()
        clear(self._panels)
        self.badges = []
        self.plot.empty()
        note = [(say("logs.drift_of_turn"), c.text)]
        for axis in data.axes:
            self._panels.addWidget(self._axis_panel(axis))
            colour = theme.AXIS_COLOURS[axis.axis]
            turn = np.arange(1.0, len(axis.drift) + 1.0)
            above_noise = axis.predicted > 0.2 * axis.drift.min()
            predicted = np.where(above_noise, axis.predicted, np.nan)
            self.plot.line(turn, predicted / ARCSECOND, colour)
            self.plot.dots(turn, axis.drift / ARCSECOND, colour)
            note.append(("● " + axis.axis, theme.axis_text(axis.axis)))
        if data.excessive_sigma is not None:
            sigma, threshold = (three_digits(v / ARCSECOND) for v in (data.excessive_sigma, data.threshold))
            caution = label(name="gimbal_sigma_label", wrap=True)
            caution.setText("▲  " + say("logs.sigma_above_threshold", sigma=sigma, threshold=threshold))
            self._panels.addWidget(panel(caution))
        self._panels.addStretch(1)
        if data.threshold > 0.0:
            self.plot.limit(data.threshold / ARCSECOND, c.bad)
            note.append(("- - " + say("logs.threshold"), c.bad))
        self.plot.setLabel("bottom", say("logs.turn"))
        self.plot.finish([*note, (say("logs.predicted"), c.muted)])

    def _axis_panel(self, axis: GimbalAxis) -> QFrame:
        badge, text, gains = StateBadge(), label(kind="muted", wrap=True), label()
        verdict = say("logs.axis_below" if axis.converged else "logs.axis_above", axis=axis.axis)
        badge.show_state("good" if axis.converged else "caution", verdict)
        self.badges.append(badge)
        first, last = (three_digits(float(axis.drift[k]) / ARCSECOND) for k in (0, -1))
        angle, percent = three_digits(float(np.rad2deg(axis.angle))), three_digits(100.0 * axis.contraction)
        turns = {"count": len(axis.drift), "angle": angle, "first": first, "last": last, "percent": percent}
        observed = "" if axis.observed_contraction is None else three_digits(100.0 * axis.observed_contraction)
        text.setText(say("logs.turns_observed" if observed else "logs.turns", **turns, observed=observed))
        gain, fastest, stable = (three_digits(value) for value in (axis.gain, axis.fastest_gain, axis.largest_gain))
        gains.setText(say("logs.gain_lines", gain=gain, fastest=fastest, stable=stable))
        return panel(badge, text, _GainBar(axis), gains)


_BAR_TOP, _BAR = 10.0, 14.0
#: Length of the bar relative to the larger of the largest stable gain and the gain divided by 1.1.
_EXTENT = 1.35


class _GainBar(QWidget):
    """A bar of the stable gains with ticks at the fastest and the largest gain, and a triangle at the gain used."""

    def __init__(self, axis: GimbalAxis) -> None:
        super().__init__()
        self._axis = axis
        self.setFixedHeight(30)
        self.setMinimumWidth(30 * theme.GRID)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the bar."""
        axis, c = self._axis, theme.colours()
        painter = theme.painter(self)
        width = self.width() - 2.0
        scale = width / (_EXTENT * max(axis.largest_gain, axis.gain / 1.1, 1e-9))
        best, largest, gain = (1.0 + scale * value for value in (axis.fastest_gain, axis.largest_gain, axis.gain))
        painter.setPen(QPen(QColor(c.line), 1))
        painter.setBrush(QColor(c.window))
        painter.drawRect(QRectF(1, _BAR_TOP, width, _BAR))
        painter.fillRect(QRectF(1, _BAR_TOP, largest - 1, _BAR), theme.faint(c.good, 110))
        painter.setPen(QPen(QColor(c.text), 2))
        for x in (best, largest):
            painter.drawLine(QPointF(x, _BAR_TOP - 2), QPointF(x, _BAR_TOP + _BAR + 4))
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(c.accent if axis.gain < axis.largest_gain else c.bad))
        corners = QPointF(gain, _BAR_TOP + 4), QPointF(gain - 7, _BAR_TOP - 6), QPointF(gain + 7, _BAR_TOP - 6)
        painter.drawPolygon(QPolygonF(corners))
