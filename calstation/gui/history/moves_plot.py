"""Plot of the changes of parameters from one version to another."""

from collections.abc import Mapping

import numpy as np
import pyqtgraph as pg
from PySide6.QtGui import QColor

from calstation.fleet import Move
from calstation.gui.text import bind, say
from calstation.gui.widgets import NOTABLE_SIGMAS, LogAxis, ThemedPlot, dashed, theme

#: Smallest change that is distinguished from zero, and smallest upper end of the axis, sigmas.
_LEAST, _END = 1e-3, 10.0
#: Height of the horizontal axis with its label, px.
_AXIS = 7 * theme.GRID


class MovesPlot(ThemedPlot):
    """Median, 95th percentile and maximum of the change, one row for each parameter or group of logs."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("moves_plot")
        self._rows: Mapping[str, Move] = {}
        self.setAxisItems({"bottom": LogAxis("bottom")})
        self.apply_theme()
        self.setLogMode(x=True)
        bind(self.setAccessibleName, "history.move_distribution")
        theme.on_appearance_change(self, self.draw)

    def show_moves(self, rows: Mapping[str, Move]) -> None:
        """Plot changes by the text of their row."""
        self._rows = rows
        self.setMinimumHeight(theme.BODY * len(rows) + _AXIS)
        self.getViewBox().reset()
        self.draw()

    def draw(self) -> None:
        """Plot the changes."""
        self.clear()
        c = theme.colours()
        y = np.arange(len(self._rows))
        marks = (("median", "o"), ("percentile_95", "|"), ("largest", "x"))
        x = {mark: np.array([max(getattr(move, mark), _LEAST) for move in self._rows.values()]) for mark, _ in marks}
        self.addItem(pg.InfiniteLine(np.log10(NOTABLE_SIGMAS), 90, pen=dashed(c.caution)))
        for k in y.tolist():
            ends = [x["median"][k], x["largest"][k]]
            self.addItem(pg.PlotDataItem(ends, [k, k], pen=pg.mkPen(c.muted, width=1)))
        for mark, symbol in marks:
            pen, colour = pg.mkPen(c.accent, width=2), QColor(c.accent)
            style = {"symbol": symbol, "symbolSize": 9, "symbolPen": pen, "symbolBrush": colour}
            self.addItem(pg.PlotDataItem(x[mark], y, pen=None, **style))
        self.getAxis("left").setTicks([list(enumerate(self._rows))])
        self.getPlotItem().invertY(True)
        self.setYRange(-0.6, max(len(y), 1) - 0.4, padding=0)
        end = max([_END, *x["largest"]])
        self.setXRange(np.log10(_LEAST) - 0.1, np.log10(end) + 0.1, padding=0)
        self.setLabel("bottom", say("history.axis_moves"))
