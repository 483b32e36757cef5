"""The comparison of selected runs: a table of their parameters, and a plot of the values relative to the limits."""

from collections.abc import Callable, Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QWidget

from calstation.gui.text import bind, on_language_change, parameter_text, say
from calstation.gui.widgets import (
    ComparisonTable,
    ParameterSet,
    ThemedPlot,
    button,
    column,
    label,
    ordered,
    row,
    show_text,
    split,
    theme,
)
from calstation.messages import local_time
from calstation.records import RunRecord
from calstation.results import Result, run_outcome

#: Symbol of each run in the plot, and the same symbol in the heading of the table.
_SYMBOLS = (("o", "●"), ("s", "■"), ("t1", "▲"), ("d", "◆"), ("t", "▼"), ("star", "★"), ("+", "✚"), ("x", "✖"))
#: Maximum number of runs in a comparison.
MAX_COMPARED = len(_SYMBOLS)
#: Fraction of a plot row that the symbols occupy.
_ROW_SHARE = 0.7
#: Height of the horizontal axis with its label, px.
_AXIS_HEIGHT = 7 * theme.GRID

#: Lower and upper limit of each parameter, SI.
Limits = dict[str, tuple[float, float]]


class RunComparison(QWidget):
    """A comparison of runs with the first of them; `back` is called to return to the list."""

    def __init__(self, back: Callable[[], None]) -> None:
        super().__init__()
        self._runs: Sequence[RunRecord] = ()
        back_button = button("comparison_back_button", "history.back_to_list", back)
        self.setFocusProxy(back_button)
        self._title = label(kind="section")
        self._note = label(kind="muted", wrap=True, name="comparison_note_label")
        self.table = ComparisonTable("run_comparison_table", "history.compared_parameters", independent=True)
        header = self.table.horizontalHeader()
        header.setTextElideMode(Qt.TextElideMode.ElideNone)  # Qt elides several lines as if they were one
        header.setMinimumHeight(8 * theme.GRID)  # serial number, date and time on three lines
        self.plot = ComparisonPlot()
        body = split((self.table, 13), (self.plot, 9), handle=2 * theme.GRID)
        column(row(back_button, self._title, None, spacing=2 * theme.GRID), self._note, (body, 1), on=self)
        on_language_change(self, self._refresh)

    def show_runs(self, runs: Sequence[RunRecord], results: Sequence[Result]) -> None:
        """Show these runs and their results."""
        self._runs = runs
        one = {run.serial for run in runs}
        self.table.show_sets(
            [
                ParameterSet(self._heading(k), result.parameters, marked=len(one) == 1)
                for k, result in enumerate(results)
            ]
        )
        self.plot.show_results(self.table.names, results)
        self.plot.setVisible(any(self.plot.limits))
        self._refresh()

    def _heading(self, k: int) -> Callable[[], str]:
        run = self._runs[k]

        def heading() -> str:
            mark = f"\n{say(run_outcome(run))}" if run.altered or run.simulated else ""
            date, _, time = local_time(run.started_utc).partition(" ")
            return f"{_SYMBOLS[k][1]} {run.serial}\n{date}\n{time}{mark}"

        return heading

    def _refresh(self) -> None:
        serials = list(dict.fromkeys(run.serial for run in self._runs))
        runs = say("history.runs_of", count=len(self._runs), units=serials[:2])
        if len(serials) > 2:
            runs = say("history.runs_of_units", count=len(self._runs), units=len(serials))
        self._title.setText(runs)
        lines = [say("history.differences_to_first")]
        if len(serials) == 1:
            lines.append(say("history.large_differences"))
        if self._runs and not any(self.plot.limits):
            lines.append(say("history.no_limits_to_draw"))
        if any(run.altered for run in self._runs):
            lines.append(say("history.compared_without_result"))
        show_text(self._note, " ".join(lines))


class ComparisonPlot(ThemedPlot):
    """Plots the values and sigmas of several results relative to their own limits, one row per parameter."""

    def __init__(self) -> None:
        super().__init__(zoom=True)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self._names: list[str] = []
        #: Limits of the plotted parameters in each result.
        self.limits: list[Limits] = []
        self._results: Sequence[Result] = ()
        bind(self.setAccessibleName, "history.relative_values")
        theme.on_appearance_change(self, self.draw)

    def show_results(self, names: Sequence[str], results: Sequence[Result]) -> None:
        """Plot the named parameters that have limits in at least one result, for the results with these limits."""
        self._results = results
        self.limits = [limits_of(result) for result in results]
        limited = {name for limits in self.limits for name in limits}
        self._names = [name for name in ordered(names) if name in limited]
        self.setMinimumHeight(theme.BODY * len(self._names) + _AXIS_HEIGHT)  # so that parameter names do not overlap
        self.getViewBox().reset()
        self.draw()

    def draw(self) -> None:
        """Plot the results."""
        self.clear()
        c = theme.colours()
        for bound, style in ((-1.0, Qt.PenStyle.DashLine), (0.0, Qt.PenStyle.SolidLine), (1.0, Qt.PenStyle.DashLine)):
            self.addLine(x=bound, pen=theme.pen(c.caution if bound else c.line, style=style))
        count = len(self._results)
        for k, (result, limits) in enumerate(zip(self._results, self.limits, strict=True)):
            colour = QColor(c.text if k == 0 else c.accent)
            offset = _ROW_SHARE * ((k + 0.5) / count - 0.5)
            values = result.parameters
            names = [(number, name) for number, name in enumerate(self._names) if name in limits and name in values]
            y = np.array([number + offset for number, _ in names])
            rows = [(values[name], *limits[name]) for _, name in names]
            x = np.array([(2.0 * p.value - low - high) / (high - low) for p, low, high in rows])
            sigma = np.array([2.0 * p.sigma / (high - low) for p, low, high in rows])
            self.addItem(pg.ErrorBarItem(x=x, y=y, left=sigma, right=sigma, beam=0.0, pen=theme.pen(colour)))
            symbol, pen, brush = _SYMBOLS[k][0], theme.pen(colour), pg.mkBrush(colour)
            self.addItem(pg.ScatterPlotItem(x=x, y=y, symbol=symbol, size=9, pen=pen, brush=brush, antialias=True))
        self.getAxis("left").setTicks([[(number, parameter_text(name)) for number, name in enumerate(self._names)]])
        self.getPlotItem().invertY(True)
        self.setYRange(-0.6, max(len(self._names), 1) - 0.4, padding=0)
        self.setLabel("bottom", say("history.relative_value"))


def limits_of(result: Result) -> Limits:
    """Return the limits of the parameters of a result."""
    checks = [check for check in result.checks if check.kind == "within"]
    return {check.subject: check.limit for check in checks if isinstance(check.limit, tuple)}
