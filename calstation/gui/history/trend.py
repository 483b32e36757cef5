"""One parameter over a unit's runs, with the limits of the run looked at."""

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, Qt
from PySide6.QtGui import QColor, QPen
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QLabel, QSizePolicy, QVBoxLayout, QWidget

from calstation.gui.history.run_table import local_time
from calstation.gui.widgets import theme
from calstation.gui.widgets.plot import ThemedPlot
from calstation.physics.parameters import INDEX, NAMES
from calstation.physics.units import display
from calstation.records.run_index import IndexedRun

#: Runs shown: the latest.
_MOST = 30
_DATES = 4


class Trend(QWidget):
    """Passed runs as dots, failed ones as crosses, the run looked at larger."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._runs: tuple[IndexedRun, ...] = ()
        self._looked_at = ""
        self._limits: dict[str, tuple[float, float]] = {}
        self._label = QLabel()
        self._label.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.combo = QComboBox()
        self.combo.setObjectName("trend_combo")
        self.combo.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToContents)
        self.combo.setMinimumContentsLength(18)
        self.combo.currentIndexChanged.connect(lambda _: self.draw())
        self._label.setBuddy(self.combo)
        self._plot = ThemedPlot()
        self._plot.setMouseEnabled(x=False, y=False)
        self._plot.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        head = QHBoxLayout()
        head.addWidget(self._label, 1)
        head.addWidget(self.combo)
        box = QVBoxLayout(self)
        box.setContentsMargins(0, 0, 0, 0)
        box.setSpacing(theme.GRID // 2)
        box.addLayout(head)
        box.addWidget(self._plot, 1)
        self.retranslate()

    def show_runs(
        self, runs: Sequence[IndexedRun], looked_at: str, limits: dict[str, tuple[float, float]]
    ) -> None:
        """Show a unit's solved runs, oldest first.

        looked_at : name of one of them; limits : lowest and highest value of each parameter, SI
        """
        self._runs, self._looked_at, self._limits = tuple(runs[-_MOST:]), looked_at, limits
        wanted = self.combo.currentData()
        found = dict.fromkeys(name for run in self._runs for name in run.values)
        names = [*(n for n in NAMES if n in found), *(n for n in found if n not in INDEX)]
        self.combo.blockSignals(True)
        self.combo.clear()
        for name in names:
            self.combo.addItem(name, name)
        self.combo.setCurrentIndex(max(0, self.combo.findData(wanted)))
        self.combo.blockSignals(False)
        self.setVisible(bool(names))
        self.draw()

    @property
    def points(self) -> int:
        """Runs drawn."""
        return sum(self.combo.currentData() in run.values for run in self._runs)

    def draw(self) -> None:
        """Draw the parameter chosen."""
        plot, c = self._plot, theme.colours()
        plot.clear()
        name = self.combo.currentData()
        if name is None:
            return
        runs = [run for run in self._runs if name in run.values]
        values = np.array([display(name, run.values[name])[0] for run in runs])
        x = np.arange(len(runs))
        plot.plot(x, values, pen=QPen(QColor(c.muted), 0))
        for passed, symbol, colour in ((True, "o", c.good), (False, "x", c.bad)):
            k = [i for i, run in enumerate(runs) if (run.record.outcome == "passed") == passed]
            sizes = [14 if runs[i].name == self._looked_at else 8 for i in k]
            plot.addItem(
                pg.ScatterPlotItem(
                    x=x[k],
                    y=values[k],
                    symbol=symbol,
                    size=sizes,
                    pen=pg.mkPen(colour, width=2),
                    brush=QColor(colour),
                    antialias=True,
                )
            )
        low, high = float(values.min()), float(values.max())
        limits = self._limits.get(name)
        if limits is not None:
            bounds = [display(name, bound)[0] for bound in limits]
            for bound in bounds:
                plot.addLine(y=bound, pen=QPen(QColor(c.caution), 0, Qt.PenStyle.DashLine))
            low, high = min(low, *bounds), max(high, *bounds)
        pad = 0.1 * (high - low) or 1.0
        plot.setYRange(low - pad, high + pad, padding=0)
        edge = 0.5 + 0.06 * len(runs)  # room for the first and last date
        plot.setXRange(-edge, max(len(runs), 2) - 1 + edge, padding=0)
        step = max(1, -(-len(runs) // _DATES))
        dates = [(i, local_time(runs[i].record.started_utc)[2:10]) for i in range(0, len(runs), step)]
        plot.getAxis("bottom").setTicks([dates])
        plot.setLabel("left", display(name, 0.0)[1])
        plot.getAxis("left").setWidth(8 * theme.GRID)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._label.setText(self.tr("This unit's runs"))
        self.combo.setAccessibleName(self.tr("Parameter"))
        self._plot.setAccessibleName(self.tr("The parameter over the unit's runs"))

    def changeEvent(self, event: QEvent) -> None:
        """Follow language and theme."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        elif event.type() == QEvent.Type.PaletteChange and self._runs:
            self.draw()
        super().changeEvent(event)
