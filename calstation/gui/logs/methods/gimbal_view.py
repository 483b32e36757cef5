"""A gimbal's answer drawn: drift after every turn, what the gain promised, and the gain in its stable range."""

import numpy as np
from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QFrame, QHBoxLayout, QVBoxLayout, QWidget

from calstation.gui.logs.methods.figures import three_digits
from calstation.gui.logs.methods.gain_bar import GainBar
from calstation.gui.logs.methods.plots import MethodPlot
from calstation.gui.logs.methods.scrolled import scrolled
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
