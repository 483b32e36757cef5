"""One parameter over a unit's runs, with the limits of the selected run."""

from collections.abc import Mapping, Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtGui import QColor, QPen
from PySide6.QtWidgets import QComboBox, QSizePolicy, QWidget

from calstation.gui.history.run_table import local_time
from calstation.gui.text import bind
from calstation.gui.widgets import ThemedPlot, column, label, ordered, row, theme
from calstation.physics import display
from calstation.records import IndexedRun

#: Most runs shown, the latest.
_MOST = 30


class Trend(QWidget):
    """Passed runs as dots, failed ones as crosses, the selected run larger."""

    def __init__(self) -> None:
        super().__init__()
        self._runs: tuple[IndexedRun, ...] = ()
        self._selected = ""
        self._limits: Mapping[str, tuple[float, float]] = {}
        self._combo = QComboBox()
        self._combo.setObjectName("trend_combo")
        self._combo.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToContents)
        self._combo.setMinimumContentsLength(18)
        self._combo.currentIndexChanged.connect(lambda _: self.draw())
        bind(self._combo.setAccessibleName, lambda: self.tr("Parameter"))
        caption = label(lambda: self.tr("This unit's runs"), buddy=self._combo)
        caption.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self._plot = ThemedPlot()
        self._plot.setMouseEnabled(x=False, y=False)
        self._plot.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self._plot.getAxis("left").setWidth(8 * theme.GRID)
        bind(self._plot.setAccessibleName, lambda: self.tr("The parameter over the unit's runs"))
        column(row((caption, 1), self._combo), (self._plot, 1), on=self, spacing=theme.GRID // 2)
        theme.themes.changed.connect(self.draw)

    def show_runs(self, runs: Sequence[IndexedRun], selected: str, limits: Mapping[str, tuple[float, float]]) -> None:
        """Show the solved runs of a unit, oldest first, one of them selected, and the limits of parameters, SI."""
        self._runs, self._selected, self._limits = tuple(runs[-_MOST:]), selected, limits
        wanted = self._combo.currentData()
        found = dict.fromkeys(name for run in self._runs for name in run.values)
        names = ordered(found)
        with QSignalBlocker(self._combo):
            self._combo.clear()
            for name in names:
                self._combo.addItem(name, name)
            self._combo.setCurrentIndex(max(0, self._combo.findData(wanted)))
        self.setVisible(bool(names))
        self.draw()

    @property
    def points(self) -> int:
        """Number of runs drawn."""
        return sum(self._combo.currentData() in run.values for run in self._runs)

    def draw(self) -> None:
        """Draw the chosen parameter."""
        plot, c = self._plot, theme.colours()
        plot.clear()
        name = self._combo.currentData()
        if name is None:
            return
        runs = [run for run in self._runs if name in run.values]
        values = np.array([display(name, run.values[name])[0] for run in runs])
        x = np.arange(len(runs))
        plot.plot(x, values, pen=QPen(QColor(c.muted), 0))
        passed = [run.record.outcome == "passed" for run in runs]
        colours = [c.good if good else c.bad for good in passed]
        dots = pg.ScatterPlotItem(
            x=x,
            y=values,
            symbol=["o" if good else "x" for good in passed],
            size=[14 if run.name == self._selected else 8 for run in runs],
            pen=[pg.mkPen(colour, width=2) for colour in colours],
            brush=[pg.mkBrush(colour) for colour in colours],
            antialias=True,
        )
        plot.addItem(dots)
        bounds = [display(name, bound)[0] for bound in self._limits.get(name, ())]
        for bound in bounds:
            plot.addLine(y=bound, pen=QPen(QColor(c.caution), 0, Qt.PenStyle.DashLine))
        low, high = min([values.min(), *bounds]), max([values.max(), *bounds])
        pad = 0.1 * (high - low) or 1.0
        plot.setYRange(low - pad, high + pad, padding=0)
        edge = 0.5 + 0.06 * len(runs)  # space for the first and last date
        plot.setXRange(-edge, max(len(runs), 2) - 1 + edge, padding=0)
        step = max(1, -(-len(runs) // 4))  # at most four dates
        dates = [(i, local_time(runs[i].record.started_utc)[2:10]) for i in range(0, len(runs), step)]
        plot.getAxis("bottom").setTicks([dates])
        plot.setLabel("left", display(name, 0.0)[1])
