"""Innovations of a stage in units of their sigmas, against ±3, and the mean NIS of every stage with its band."""

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QComboBox, QGridLayout, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from calstation.gui.engineer.bands import dashed
from calstation.gui.text.messages import term
from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import StateBadge
from calstation.gui.widgets.plot import ThemedPlot
from calstation.results.diagnostics import Diagnostics, StageDiagnostics

_LEFT = 7 * theme.GRID
#: Observations inside ±3 σ that are drawn in each plot; of more, every so many-th.
_MOST = 1500
_BOUND = 3.0
#: Of fewer observations a mean below its band is no sign of anything.
_FEW = 100
#: Least height of a plot, sigmas either way.
_SHOWN = 5.0


class InnovationsView(QWidget):
    """One plot per component, and below them one line per stage."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._diagnostics: Diagnostics | None = None
        self._items: list[tuple[ThemedPlot, pg.GraphicsObject]] = []
        self._drawn = False
        self.stage_combo = QComboBox()
        self.stage_combo.setObjectName("innovation_stage_combo")
        self.stage_combo.setMinimumWidth(22 * theme.GRID)
        self.stage_combo.currentIndexChanged.connect(self._draw)
        self._caption, self._beyond = QLabel(), QLabel()
        self._caption.setBuddy(self.stage_combo)
        self.plots = tuple(ThemedPlot() for _ in range(3))
        self._nis = QGridLayout()
        self._nis.setHorizontalSpacing(3 * theme.GRID)
        self._nis.setVerticalSpacing(theme.GRID // 2)
        self._nis.setColumnStretch(4, 1)
        head = QHBoxLayout()
        head.setSpacing(theme.GRID)
        head.addWidget(self._caption)
        head.addWidget(self.stage_combo)
        head.addSpacing(2 * theme.GRID)
        head.addWidget(self._beyond, 1)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, theme.GRID, 0, 0)
        column.setSpacing(theme.GRID // 2)
        column.addLayout(head)
        for number, plot in enumerate(self.plots):
            plot.getAxis("left").setWidth(_LEFT)
            plot.setMouseEnabled(x=True, y=False)
            if number < 2:
                plot.getAxis("bottom").setStyle(showValues=False)
                plot.getAxis("bottom").setHeight(4)
            if number:
                plot.setXLink(self.plots[0])
            column.addWidget(plot, 1)
        column.addLayout(self._nis)
        self.retranslate()

    def show_diagnostics(self, diagnostics: Diagnostics) -> None:
        """Show these, the last stage that has innovations first."""
        self._diagnostics = diagnostics
        self.stage_combo.blockSignals(True)
        self.stage_combo.clear()
        for stage in diagnostics.stages:
            if stage.innovations is not None:
                self.stage_combo.addItem(term("stage", stage.stage), stage.stage)
        sizes = [0 if s.innovations is None else len(s.innovations.seq) for s in diagnostics.stages]
        longest = diagnostics.stages[int(np.argmax(sizes))].stage if sizes else ""
        self.stage_combo.setCurrentIndex(max(self.stage_combo.findData(longest), 0))
        self.stage_combo.blockSignals(False)
        self._tell_nis()
        self._drawn = False
        if self.isVisible():
            self._draw()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._caption.setText(self.tr("Stage"))
        self.plots[2].setLabel("bottom", self.tr("time in the stage, min"))
        for index in range(self.stage_combo.count()):
            self.stage_combo.setItemText(index, term("stage", self.stage_combo.itemData(index)))
        self._draw()
        self._tell_nis()

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

    def _stage(self) -> StageDiagnostics | None:
        if self._diagnostics is None:
            return None
        chosen = self.stage_combo.currentData()
        return next((s for s in self._diagnostics.stages if s.stage == chosen), None)

    def _draw(self) -> None:
        for plot, item in self._items:
            plot.removeItem(item)
        self._items.clear()
        self._drawn = True
        stage = self._stage()
        if stage is None or stage.innovations is None:
            self._beyond.setText("")
            return
        c = theme.colours()
        seen = stage.innovations
        minutes = (seen.seq - stage.first_seq) / stage.sample_rate / 60.0
        names = self._components(stage)
        size = 3 if len(seen.seq) > 100 else 8
        for number, (plot, name) in enumerate(zip(self.plots, names, strict=True)):
            values = seen.normalised[:, number]
            beyond = np.abs(values) > _BOUND
            inside = np.flatnonzero(~beyond)[:: -(-len(values) // _MOST)]
            for drawn, colour, grow in ((inside, c.accent, 0), (np.flatnonzero(beyond), c.bad, 2)):
                dots = pg.ScatterPlotItem(
                    minutes[drawn], values[drawn], size=size + grow, pen=None, brush=pg.mkBrush(colour)
                )
                self._add(plot, dots)
            for level in (-_BOUND, 0.0, _BOUND):
                pen = pg.mkPen(c.line) if level == 0.0 else dashed(c.muted)
                self._add(plot, pg.InfiniteLine(level, 0, pen=pen))
            reach = max(_SHOWN, float(np.abs(values).max(initial=0.0)) * 1.05)
            plot.setYRange(-reach, reach, padding=0.0)
            plot.setLabel("left", name)
            plot.getAxis("left").label.setFont(theme.font())
        span = float(minutes.max(initial=0.0))
        self.plots[0].setXRange(0.0, max(span, 1e-3), padding=0.02)
        share = 100.0 * float(np.mean(np.abs(seen.normalised) > _BOUND))
        self._beyond.setText(
            self.tr("{0} observations, {1:.2f} % beyond ±3 σ (0.27 % expected)").format(len(seen.seq), share)
        )

    def _add(self, plot: ThemedPlot, item: pg.GraphicsObject) -> None:
        plot.addItem(item)
        self._items.append((plot, item))

    def _components(self, stage: StageDiagnostics) -> tuple[str, str, str]:
        """What the three components are: velocity in the level frame, or along the unit's axes."""
        if stage.details.get("turns") or stage.details.get("positions"):
            return "x, σ", "y, σ", "z, σ"
        return self.tr("east, σ"), self.tr("north, σ"), self.tr("up, σ")

    def _tell_nis(self) -> None:
        while (item := self._nis.takeAt(0)) is not None:
            widget = item.widget()
            if widget is not None:
                widget.deleteLater()
        if self._diagnostics is None:
            return
        for column, text in enumerate((self.tr("Stage"), self.tr("Mean NIS"), self.tr("99.9 % band"), "")):
            label = QLabel(text)
            label.setProperty("kind", "muted")
            self._nis.addWidget(label, 0, column)
        for line, stage in enumerate(self._diagnostics.stages, 1):
            c = stage.consistency
            badge = StateBadge()
            if not c.passed:
                badge.show_state("bad", self.tr("above: errors the model does not explain"))
            elif c.warning:
                few = c.count < _FEW
                badge.show_state(
                    "none" if few else "caution", self.tr("below the band: sigma is on the safe side")
                )
            else:
                badge.show_state("good", self.tr("inside"))
            texts = (term("stage", stage.stage), f"{c.nis_mean:.3f}", f"{c.nis_low:.3f} – {c.nis_high:.3f}")
            for column, text in enumerate(texts):
                self._nis.addWidget(QLabel(text), line, column)
            self._nis.addWidget(badge, line, 3)
