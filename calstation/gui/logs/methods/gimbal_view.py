"""A gimbal's answer drawn: drift after every turn, what the gain promised, and the gain in its stable range."""

import numpy as np
from PySide6.QtCore import QEvent, QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QFrame, QHBoxLayout, QSizePolicy, QVBoxLayout, QWidget

from calstation.gui.logs.methods.figures import scrolled, three_digits
from calstation.gui.logs.methods.plots import MethodPlot
from calstation.gui.widgets import ElidedLabel, StateBadge, theme
from calstation.physics import ARCSECOND, FloatArray
from calstation.results.plots import GimbalAxis, GimbalPlotData

#: A promise smaller than this part of the smallest drift measured is not drawn.
_FAINT = 0.2


class _AxisPanel(QFrame):
    """One axis in words, and its gain."""

    def __init__(self) -> None:
        super().__init__()
        self.setProperty("kind", "panel")
        self.badge, self._text, self.bar = StateBadge(theme.BODY), ElidedLabel(), GainBar()
        self._text.setProperty("kind", "muted")
        column = QVBoxLayout(self)
        column.setContentsMargins(2 * theme.GRID, theme.GRID, 2 * theme.GRID, theme.GRID // 2)
        column.setSpacing(theme.GRID // 2)
        column.addWidget(self.badge)
        column.addWidget(self._text)
        column.addWidget(self.bar)

    def show_axis(self, axis: GimbalAxis) -> None:
        """Show an axis."""
        first, last = (three_digits(float(axis.drift[k]) / ARCSECOND) for k in (0, -1))
        kind = "good" if axis.done else "caution"
        self.badge.show_state(
            kind,
            self.tr("Axis {0}: below the threshold").format(axis.axis)
            if axis.done
            else self.tr("Axis {0}: not below the threshold").format(axis.axis),
        )
        self._text.setText(
            self.tr("{0} turns by {1}°: {2} → {3}″, {4} % left by each").format(
                len(axis.drift),
                three_digits(float(np.rad2deg(axis.angle))),
                first,
                last,
                three_digits(100.0 * axis.contraction),
            )
        )
        self.bar.show_axis(axis)


class GimbalView(QWidget):
    """Dots are the drift measured in each turn; the thin line is what the gain promises; the threshold is dashed."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._picture: GimbalPlotData | None = None
        self.plot = MethodPlot(log=True)
        self.plot.getAxis("bottom").setTickSpacing(1.0, 1.0)
        self._panels: list[_AxisPanel] = []
        side = QWidget()
        self._right = QVBoxLayout(side)
        self._right.setContentsMargins(0, 0, 0, 0)
        self._right.setSpacing(theme.GRID)
        self._right.addStretch(1)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, theme.GRID, 0, 0)
        row.setSpacing(2 * theme.GRID)
        row.addWidget(self.plot, 11)
        row.addWidget(scrolled(side), 8)

    def show_picture(self, picture: GimbalPlotData) -> None:
        """Draw it."""
        self._picture = picture
        for panel in self._panels:
            self._right.removeWidget(panel)
            panel.deleteLater()
        self._panels = [_AxisPanel() for _ in picture.axes]
        for k, panel in enumerate(self._panels):
            self._right.insertWidget(k, panel)
        self.retranslate()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        p = self._picture
        if p is None:
            return
        c = theme.colours()
        self.plot.empty()
        parts = [(self.tr("Drift | D | in each turn, ″"), c.text)]
        for axis, panel in zip(p.axes, self._panels, strict=True):
            panel.show_axis(axis)
            colour = theme.AXIS_COLOURS[axis.axis]
            turn = np.arange(1.0, len(axis.drift) + 1.0)
            self.plot.line(turn, _worth_drawing(axis) / ARCSECOND, colour)
            self.plot.dots(turn, axis.drift / ARCSECOND, colour)
            parts.append(("● " + axis.axis, colour))
        if p.threshold > 0.0:
            self.plot.limit(p.threshold / ARCSECOND, c.bad)
            parts.append(("- - " + self.tr("threshold"), c.bad))
        parts.append((self.tr("— predicted"), c.muted))
        self.plot.say(parts)
        self.plot.setLabel("bottom", self.tr("turn"))
        self.plot.fit()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language or theme."""
        if event.type() in (QEvent.Type.LanguageChange, QEvent.Type.PaletteChange):
            self.retranslate()
        super().changeEvent(event)


def _worth_drawing(axis: GimbalAxis) -> FloatArray:
    """What the gain promises, rad, as long as it is of the size of what was measured: noise ends all promises."""
    return np.where(axis.predicted > _FAINT * axis.drift.min(), axis.predicted, np.nan)


_HEIGHT = 62
_BAR_TOP, _BAR = 24.0, 14.0
#: The bar reaches to so many times the largest stable gain, or the gain in use.
_ROOM = 1.35


class GainBar(QWidget):
    """Filled: stable. A tick below: fastest. A triangle above: in use."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._axis: GimbalAxis | None = None
        self.setFixedHeight(_HEIGHT)
        self.setMinimumWidth(30 * theme.GRID)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    def show_axis(self, axis: GimbalAxis) -> None:
        """Show an axis' gain."""
        self._axis = axis
        self.setAccessibleName(
            self.tr("Gain {0}, stable below {1}, fastest at {2}").format(
                *(three_digits(v) for v in (axis.gain, axis.largest, axis.best))
            )
        )
        self.update()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange and self._axis is not None:
            self.show_axis(self._axis)
        super().changeEvent(event)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw it."""
        axis = self._axis
        if axis is None:
            return
        c = theme.colours()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setFont(theme.font())
        most = _ROOM * max(axis.largest, axis.gain / 1.1, 1e-9)
        width = self.width() - 2.0

        def at(gain: float) -> float:
            return 1.0 + width * gain / most

        bar = QRectF(1, _BAR_TOP, width, _BAR)
        painter.setPen(QPen(QColor(c.line), 1))
        painter.setBrush(QColor(c.window))
        painter.drawRect(bar)
        stable = QColor(c.good)
        stable.setAlpha(110)
        painter.fillRect(QRectF(1, _BAR_TOP, at(axis.largest) - 1, _BAR), stable)
        painter.setPen(QPen(QColor(c.text), 2))
        for gain in (axis.largest, axis.best):
            painter.drawLine(QPointF(at(gain), _BAR_TOP - 2), QPointF(at(gain), _BAR_TOP + _BAR + 4))
        self._below(painter, at(axis.best), at(axis.largest), axis)
        inside = axis.gain < axis.largest
        x = at(axis.gain)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(c.accent if inside else c.bad))
        painter.drawPolygon(
            QPolygonF([QPointF(x, _BAR_TOP + 4), QPointF(x - 7, _BAR_TOP - 6), QPointF(x + 7, _BAR_TOP - 6)])
        )
        painter.setPen(QColor(c.accent if inside else c.bad))
        self._text(painter, x, 0.0, self.tr("α = {0}").format(three_digits(axis.gain)))

    def _below(self, painter: QPainter, best: float, largest: float, axis: GimbalAxis) -> None:
        """What the two ticks are; side by side where they are close together."""
        painter.setPen(QColor(theme.colours().text))
        top = _BAR_TOP + _BAR + 5.0
        fastest = self.tr("fastest {0}").format(three_digits(axis.best))
        stable = self.tr("stable below {0}").format(three_digits(axis.largest))
        metrics = painter.fontMetrics()
        left = best - metrics.horizontalAdvance(fastest) - 4.0
        if left < 0.0 or largest + metrics.horizontalAdvance(stable) / 2 < self.width():
            gap = metrics.horizontalAdvance(stable) / 2 + metrics.horizontalAdvance(fastest) / 2 + 12
            if largest - best >= gap:
                self._text(painter, best, top, fastest)
                self._text(painter, largest, top, stable)
                return
        height = metrics.height()
        painter.drawText(QRectF(0, top, best + 2.0, height), Qt.AlignmentFlag.AlignRight, fastest)
        right = QRectF(self.width() - metrics.horizontalAdvance(stable) - 1.0, top, self.width(), height)
        right.moveLeft(min(max(largest - 10.0, best + 10.0), right.left()))
        painter.drawText(right, Qt.AlignmentFlag.AlignLeft, stable)

    def _text(self, painter: QPainter, x: float, top: float, text: str) -> None:
        metrics = painter.fontMetrics()
        width = metrics.horizontalAdvance(text) + 2
        left = min(max(x - width / 2, 0.0), self.width() - width)
        painter.drawText(QRectF(left, top, width, metrics.height()), Qt.AlignmentFlag.AlignCenter, text)
