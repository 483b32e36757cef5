"""The trend of a parameter over the runs of a unit."""

from collections.abc import Mapping, Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QWidget

from calstation.gui.history.comparison import limits_of
from calstation.gui.text import (
    KINDS,
    bind,
    on_language_change,
    parameter_text,
    product_text,
    say,
)
from calstation.gui.widgets import (
    ElidedLabel,
    ThemedPlot,
    column,
    combo_box,
    fill_combo,
    ordered,
    row,
    set_subject,
    state_colour,
    theme,
)
from calstation.messages import local_time
from calstation.physics import display
from calstation.records import IndexedRun, RunRecord
from calstation.results import Result

#: Maximum number of runs in the trend.
MAX_TREND = 30
#: Maximum number of dates on the axis.
_MAX_DATES = 4
#: Half width of the lines at the limits of the selected run, as a fraction of the distance between two runs.
_LIMIT_WIDTH = 0.4
#: Vertical margin as a fraction of the range, and horizontal margin for the outer dates as a fraction of the number of
#: runs.
_MARGIN, _DATE_MARGIN = 0.1, 0.06


class Trend(QWidget):
    """A plot of a parameter over the runs of a unit.

    A dot is a run that passed, a triangle a run with a changed result, and a cross any other run. Only the limits of
    the selected run are drawn, because other runs may have been judged by other limits.
    """

    def __init__(self) -> None:
        super().__init__()
        self._runs: tuple[IndexedRun, ...] = ()
        self.has_values = False  #: Whether there is a parameter to plot.
        self._selected = ""
        self._limits: Mapping[str, tuple[float, float]] = {}
        self._combo = combo_box("trend_combo", fit=True, characters=18)
        self._combo.currentIndexChanged.connect(lambda _: self.draw())
        bind(self._combo.setAccessibleName, "common.parameter")
        self._caption = ElidedLabel()
        self._caption.setObjectName("trend_label")
        self._caption.setBuddy(self._combo)
        self._plot = ThemedPlot()
        self._plot.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self._plot.getAxis("bottom").setHeight(6 * theme.GRID)  # the date and the time are on two lines
        bind(self._plot.setAccessibleName, "history.parameter_over_runs")
        column(row((self._caption, 1), self._combo), (self._plot, 1), on=self, spacing=theme.GRID // 2)
        theme.themes.changed.connect(self.draw)
        on_language_change(self, self._show_texts)

    def _show_texts(self) -> None:
        """Show the names of the parameters, and the plot with its caption."""
        names = [self._combo.itemData(number) for number in range(self._combo.count())]
        fill_combo(self._combo, [(parameter_text(name), name) for name in names])
        self.draw()

    def _show_caption(self, *, limited: bool) -> None:
        product = self._runs[-1].record.product if self._runs else None
        runs = say("history.runs_of_this_unit")
        if product is not None:
            runs = say("history.runs_of_unit_as", product=product_text(product))
        self._caption.setText(say("history.runs_with_limits", runs=runs) if limited else runs)

    def show_runs(self, runs: Sequence[IndexedRun], selected: str, result: Result | None) -> None:
        """Show the solved runs of a unit as one product, the oldest first; `selected` names the run with `result`.

        If another run is selected and the chosen parameter passed in it, choose the first failed parameter, if any.
        """
        other = selected != self._selected
        self._runs, self._selected = tuple(runs), selected
        self._limits = {} if result is None else limits_of(result)
        names = ordered({name: None for run in self._runs for name in run.values})
        failed = [check.subject for check in result.failed_checks if check.subject in names] if result and other else []
        chosen = self._combo.currentData()
        if failed and chosen not in failed:
            chosen = failed[0]
        fill_combo(self._combo, [(name, name) for name in names], chosen)
        self.has_values = bool(names)
        self.setVisible(self.has_values)
        self._show_texts()

    def draw(self) -> None:
        """Plot the selected parameter."""
        plot, c = self._plot, theme.colours()
        plot.clear()
        name = self._combo.currentData()
        if name is None:
            return
        runs = [run for run in self._runs if name in run.values]
        if runs:
            set_subject(self, f"{runs[-1].record.serial}_{name}")
        values = np.array([display(name, run.values[name])[0] for run in runs])
        x = np.arange(len(runs))
        plot.plot(x, values, pen=theme.pen(c.muted))
        colours = [state_colour(KINDS.get(run.record.badge, "none")) for run in runs]
        dots = pg.ScatterPlotItem(
            x=x,
            y=values,
            symbol=[_symbol(run.record) for run in runs],
            size=[14 if run.name == self._selected else 8 for run in runs],
            pen=[theme.pen(colour, 2) for colour in colours],
            brush=[pg.mkBrush(colour) for colour in colours],
            antialias=True,
        )
        plot.addItem(dots)
        at = np.array([k for k, run in enumerate(runs) if run.name == self._selected])
        bounds = [display(name, bound)[0] for bound in self._limits.get(name, ()) if at.size]
        for bound in bounds:
            plot.plot([at[0] - _LIMIT_WIDTH, at[0] + _LIMIT_WIDTH], [bound, bound], pen=theme.pen(c.caution, 2))
        low, high = min([values.min(), *bounds]), max([values.max(), *bounds])
        pad = _MARGIN * (high - low) or 1.0
        plot.setYRange(low - pad, high + pad, padding=0)
        edge = 0.5 + _DATE_MARGIN * len(runs)
        plot.setXRange(-edge, max(len(runs), 2) - 1 + edge, padding=0)
        step = max(1, -(-len(runs) // _MAX_DATES))
        dates = [(i, local_time(runs[i].record.started_utc).replace(" ", "\n")) for i in range(0, len(runs), step)]
        plot.getAxis("bottom").setTicks([dates])
        plot.setLabel("left", display(name, 0.0)[1])
        self._show_caption(limited=bool(bounds))


def _symbol(run: RunRecord) -> str:
    """Return the symbol of a run in the trend."""
    return "t1" if run.altered else "o" if run.verdict.passed else "x"
