"""A multi-position answer drawn: the sphere of positions, what is left at every rest, and of every motion's angle."""

import numpy as np
from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from calstation.gui.logs.methods.figures import Figure
from calstation.gui.logs.methods.plots import MethodPlot
from calstation.gui.logs.methods.sphere import PositionSphere
from calstation.gui.widgets import theme
from calstation.physics import ARCSECOND, MICRO_G, FloatArray
from calstation.results.plots import PositionPlotData


class PositionsView(QWidget):
    """Hollow dots are before, filled ones after; a product's limit is dashed."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._picture: PositionPlotData | None = None
        self.sphere = PositionSphere()
        self._caption = QLabel()
        self._caption.setProperty("kind", "muted")
        self._caption.setWordWrap(True)
        self.force_figure, self.angle_figure = Figure(), Figure()
        self.force_plot, self.angle_plot = MethodPlot(log=True), MethodPlot(log=True)
        globe = QFrame()
        globe.setProperty("kind", "panel")
        left = QVBoxLayout(globe)
        left.setContentsMargins(theme.GRID, theme.GRID, theme.GRID, theme.GRID)
        left.addWidget(self.sphere, 1)
        left.addWidget(self._caption)
        figures = QHBoxLayout()
        figures.setSpacing(4 * theme.GRID)
        figures.addWidget(self.force_figure)
        figures.addWidget(self.angle_figure)
        figures.addStretch(1)
        right = QVBoxLayout()
        right.setSpacing(theme.GRID)
        right.addLayout(figures)
        right.addWidget(self.force_plot, 1)
        right.addWidget(self.angle_plot, 1)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, theme.GRID, 0, 0)
        row.setSpacing(2 * theme.GRID)
        row.addWidget(globe, 4)
        row.addLayout(right, 9)
        self.retranslate()

    def show_picture(self, picture: PositionPlotData) -> None:
        """Draw it."""
        self._picture = picture
        self.sphere.show_positions(picture.up)
        self._draw()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self.sphere.setAccessibleName(self.tr("Directions of gravity in the unit's axes"))
        self._draw()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language or theme."""
        if event.type() in (QEvent.Type.LanguageChange, QEvent.Type.PaletteChange):
            self.retranslate()
        super().changeEvent(event)

    def _draw(self) -> None:
        p = self._picture
        if p is None:
            return
        self._caption.setText(
            self.tr("Where gravity lay in the unit at {0} rests. Drag to turn.").format(len(p.up))
        )
        self.force_figure.show_change(
            self.tr("| f | − g at rest, rms"),
            _rms(p.force_before) / MICRO_G,
            _rms(p.force_after) / MICRO_G,
            "µg",
        )
        for widget in (self.angle_figure, self.angle_plot):
            widget.setVisible(len(p.angle_after) > 0)
        self.angle_figure.show_change(
            self.tr("angle of motions, rms"),
            _rms(p.angle_before) / ARCSECOND,
            _rms(p.angle_after) / ARCSECOND,
            "″",
        )
        self._fill(
            self.force_plot,
            self.tr("| f | − g at each rest, µg"),
            p.force_before,
            p.force_after,
            p.force_limit,
            MICRO_G,
        )
        self._fill(
            self.angle_plot,
            self.tr("Error of each motion's angle, ″"),
            p.angle_before,
            p.angle_after,
            p.angle_limit,
            ARCSECOND,
        )

    def _fill(
        self,
        plot: MethodPlot,
        title: str,
        before: FloatArray,
        after: FloatArray,
        limit: float | None,
        size: float,
    ) -> None:
        c = theme.colours()
        plot.empty()
        number = np.arange(1.0, len(before) + 1.0)
        plot.dots(number, np.abs(before) / size, c.caution, hollow=True)
        plot.dots(number, np.abs(after) / size, c.accent)
        parts = [(title, c.text), ("○ " + self.tr("before"), c.caution), ("● " + self.tr("after"), c.accent)]
        if limit is not None:
            plot.limit(limit / size, c.bad)
            parts.append(("- - " + self.tr("limit"), c.bad))
        plot.say(parts)
        plot.fit()


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0
