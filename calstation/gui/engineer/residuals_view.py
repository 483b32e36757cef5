"""What is left at every rest after compensation: gravity's length and the earth's rate, measured less expected."""

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPointF
from PySide6.QtGui import QResizeEvent, QShowEvent
from PySide6.QtWidgets import QVBoxLayout, QWidget

from calstation.gui.engineer.bands import Band, Bands
from calstation.gui.text.messages import term
from calstation.gui.widgets import theme
from calstation.gui.widgets.labels import ElidedLabel
from calstation.gui.widgets.plot import ThemedPlot
from calstation.physics.arrays import FloatArray
from calstation.physics.units import DEGREE_PER_HOUR, MICRO_G
from calstation.results.diagnostics import Diagnostics, StageDiagnostics

_LEFT = 9 * theme.GRID
#: A rest closer than this to a face goes by the face's name.
_FACE = np.cos(np.deg2rad(30.0))


class ResidualsView(QWidget):
    """Three plots over the rests of all stages; where the pointer is, the rest is named."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._diagnostics: Diagnostics | None = None
        self._items: list[tuple[ThemedPlot, pg.GraphicsObject]] = []
        self._places: list[tuple[StageDiagnostics, int]] = []
        self._drawn = False
        self.rest_label = ElidedLabel()
        self.rest_label.setObjectName("rest_label")
        self.plots = tuple(ThemedPlot() for _ in range(3))
        self._bands = tuple(Bands(plot, named=number == 0) for number, plot in enumerate(self.plots))
        column = QVBoxLayout(self)
        column.setContentsMargins(0, theme.GRID, 0, 0)
        column.setSpacing(theme.GRID // 2)
        column.addWidget(self.rest_label)
        for number, plot in enumerate(self.plots):
            plot.getAxis("left").setWidth(_LEFT)
            plot.showGrid(y=True, alpha=0.2)
            plot.setMouseEnabled(x=True, y=False)
            if number < 2:
                plot.getAxis("bottom").setStyle(showValues=False)
                plot.getAxis("bottom").setHeight(4)
            if number:
                plot.setXLink(self.plots[0])
            plot.scene().sigMouseMoved.connect(lambda at, of=plot: self._point(of, at))
            column.addWidget(plot, 1)
        self.retranslate()

    def show_diagnostics(self, diagnostics: Diagnostics) -> None:
        """Show these."""
        self._diagnostics = diagnostics
        self._drawn = False
        if self.isVisible():
            self._draw()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._explain()
        for plot, text in zip(
            self.plots,
            (self.tr("gravity, µg"), self.tr("vertical rate, °/h"), self.tr("horizontal rate, °/h")),
            strict=True,
        ):
            plot.setLabel("left", text)
            plot.getAxis("left").label.setFont(theme.font())
        self.plots[2].setLabel("bottom", self.tr("rest, by the axis that is up"))
        self._draw()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language or theme."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        elif event.type() == QEvent.Type.PaletteChange and self._drawn:
            self._draw()
        super().changeEvent(event)

    def showEvent(self, event: QShowEvent) -> None:
        """Draw once it is looked at."""
        super().showEvent(event)
        if not self._drawn:
            self._draw()

    def _draw(self) -> None:
        for plot, item in self._items:
            plot.removeItem(item)
        self._items.clear()
        self._drawn = True
        self._places = []
        if self._diagnostics is None:
            return
        stages = [stage for stage in self._diagnostics.stages if len(stage.rests)]
        bands: list[Band] = []
        for stage in stages:
            begin = len(self._places)
            self._places += [(stage, k) for k in range(len(stage.rests))]
            bands.append((term("stage", stage.stage), begin - 0.5, len(self._places) - 0.5))
        for band in self._bands:
            band.show(bands)
        columns = self._columns(stages)
        for plot, (values, sigmas) in zip(self.plots, columns, strict=True):
            self._draw_column(plot, values, sigmas)
        self.plots[0].setXRange(-0.5, max(len(self._places) - 0.5, 0.5), padding=0.01)
        self._name_ticks()

    def _name_ticks(self) -> None:
        """As many rests' faces as there is room for."""
        ticks = [(k, face(stage.rests.up[i])) for k, (stage, i) in enumerate(self._places)]
        room = max(1, (self.plots[2].width() - _LEFT) // (4 * theme.GRID))
        self.plots[2].getAxis("bottom").setTicks([ticks[:: -(-max(len(ticks), 1) // room)]])

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Another width has room for more or fewer names."""
        super().resizeEvent(event)
        self._name_ticks()

    def leaveEvent(self, event: QEvent) -> None:
        """No rest is pointed at any more."""
        self._explain()
        super().leaveEvent(event)

    def _explain(self) -> None:
        theme.set_kind(self.rest_label, "muted")
        self.rest_label.setText(
            self.tr(
                "Measured less expected at every rest, with ±1 σ of the rest's own noise; point at a rest."
            )
        )

    def _columns(self, stages: Sequence[StageDiagnostics]) -> list[tuple[FloatArray, FloatArray]]:
        """Values and sigmas of each plot, in the units people read."""
        rests = [stage.rests for stage in stages]
        none = np.empty(0)
        force = np.concatenate([none, *(r.force for r in rests)]) / MICRO_G
        force_sigma = np.concatenate([none, *(r.force_sigma for r in rests)]) / MICRO_G
        vertical = np.concatenate([none, *(r.vertical_rate for r in rests)]) / DEGREE_PER_HOUR
        horizontal = np.concatenate([none, *(r.horizontal_rate for r in rests)]) / DEGREE_PER_HOUR
        rate_sigma = np.concatenate([none, *(r.rate_sigma for r in rests)]) / DEGREE_PER_HOUR
        return [(force, force_sigma), (vertical, rate_sigma), (horizontal, rate_sigma)]

    def _draw_column(self, plot: ThemedPlot, values: FloatArray, sigmas: FloatArray) -> None:
        c = theme.colours()
        place = np.arange(len(values), dtype=np.float64)
        bars = pg.ErrorBarItem(x=place, y=values, height=2.0 * sigmas, beam=0.25, pen=pg.mkPen(c.muted))
        dots = pg.ScatterPlotItem(place, values, size=7, pen=None, brush=pg.mkBrush(c.accent))
        zero = pg.InfiniteLine(0.0, 0, pen=pg.mkPen(c.text))
        for item in (zero, bars, dots):
            plot.addItem(item, ignoreBounds=item is not dots)
            self._items.append((plot, item))
        reach = float(np.max(np.abs(values) + sigmas, initial=0.0)) * 1.1 or 1.0
        plot.setYRange(-reach, reach, padding=0.0)

    def _point(self, plot: ThemedPlot, at: QPointF) -> None:
        """Name the rest under the pointer."""
        view = plot.getPlotItem().getViewBox()
        if not self._places or not view.sceneBoundingRect().contains(at):
            return
        k = min(max(round(view.mapSceneToView(at).x()), 0), len(self._places) - 1)
        stage, i = self._places[k]
        rests = stage.rests
        x, y, z = (float(v) for v in rests.up[i])
        said = self.tr("{0}, rest {1}, up ({2:+.2f}, {3:+.2f}, {4:+.2f})").format(
            term("stage", stage.stage), i + 1, x, y, z
        )
        if np.isfinite(rests.angles[i]).all():
            outer, inner = np.rad2deg(rests.angles[i])
            said += self.tr(", outer {0:.1f}°, inner {1:.1f}°").format(float(outer), float(inner))
        said += self.tr(": {0:+.2f} µg, {1:+.4f} °/h up, {2:+.4f} °/h level").format(
            float(rests.force[i] / MICRO_G),
            float(rests.vertical_rate[i] / DEGREE_PER_HOUR),
            float(rests.horizontal_rate[i] / DEGREE_PER_HOUR),
        )
        theme.set_kind(self.rest_label, "")
        self.rest_label.setText(said)


def face(up: FloatArray) -> str:
    """The axis that points up, "" where none does by 30°."""
    axis = int(np.argmax(np.abs(up)))
    if abs(up[axis]) < _FACE:
        return ""
    return ("+" if up[axis] > 0.0 else "−") + "xyz"[axis]
