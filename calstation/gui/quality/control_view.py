"""The view of control charts: a list of parameters, the charts of the selected parameter, and the runs that signal."""

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from calstation.gui.quality.control_charts import ControlCharts, ParameterCharts
from calstation.gui.text import on_language_change, parameter_text, say
from calstation.gui.widgets import Cell, CellTable, box, column, combo_box, label, row, split, theme
from calstation.messages import local_time
from calstation.physics import IntArray, display, group_of
from calstation.quality import ParameterQuality

#: Maximum number of listed runs that signal, the latest first.
_MAX_LISTED = 200
#: Number of rows that determine the width of a column.
_ROWS_FOR_WIDTH = 20
#: Number of latest runs in which a signal marks a parameter as bad.
_LATEST_RUNS = 10
_QUANTITIES = (
    Cell("quality.runs", "runs"),
    Cell("quality.signals", "signals", state="kind", hint="hint"),
)
_SIGNALS = (
    Cell("quality.run", "run"),
    Cell("common.started", "started", number=False),
    Cell("quality.signal", "rules", number=False, hint="hint"),
)


class ControlView(QWidget):
    """A view of the charts of the parameters, which emits `run_requested(name)` for a run that the user opens."""

    run_requested = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self._charts: dict[str, ParameterQuality] = {}
        #: Signals of the selected parameter; see `Charts.signals`.
        self._signals: dict[str, IntArray] = {}
        self._relative = False
        self.plots = ControlCharts()
        self._slow = combo_box("quality_slow_combo", {"ewma": "quality.ewma", "cusum": "quality.cusum"})
        self._slow.currentIndexChanged.connect(lambda _: self._choose_slow())
        self.quantities = CellTable("quality_quantities_table", "quality.quantities", _QUANTITIES, single=True)
        self.signals = CellTable("quality_signals_table", "quality.signalling_runs", _SIGNALS, named=False, single=True)
        for table in (self.quantities, self.signals):
            table.horizontalHeader().setResizeContentsPrecision(_ROWS_FOR_WIDTH)
        self.quantities.selectionModel().currentRowChanged.connect(lambda *_: self._draw())
        self.signals.selectionModel().currentRowChanged.connect(lambda *_: self.plots.choose(self._index))
        self.signals.doubleClicked.connect(lambda _: self._open())
        self.note = label(kind="muted", name="quality_signals_label", wrap=True)
        left = box((self.quantities, 3), self.note, (self.signals, 2))
        right = box((self.plots, 1), row(None, label("quality.slow_chart", buddy=self._slow), self._slow))
        column((split((left, 3), (right, 7), handle=2 * theme.GRID), 1), on=self, margins=(0, theme.GRID, 0, 0))
        on_language_change(self, self._draw)

    def show_charts(self, charts: Sequence[ParameterQuality], *, relative: bool) -> None:
        """Show the charts of a product, whose values are in standard deviations if `relative`."""
        current = self.quantities.current_name
        self._charts, self._relative = {each.parameter: each for each in charts}, relative
        self.quantities.show_cells(
            {
                name: {
                    **{"runs": str(len(each.names)), "signals": str(each.signalling), "kind": _state(each)},
                    "hint": say(f"chart.state_{_state(each)}", latest=_LATEST_RUNS),
                }
                for name, each in self._charts.items()
            }
        )
        names = list(self._charts)
        if names:
            self.quantities.selectRow(names.index(current) if current in names else 0)

    @property
    def empty(self) -> bool:
        """Whether there is nothing to show."""
        return not self._charts

    def _draw(self) -> None:
        name = self.quantities.current_name
        if not name:
            return
        parameter = self._charts[name]
        size, unit = (1.0, "σ") if self._relative else display(name, 1.0)
        charts = parameter.charts()
        self._signals = charts.signals()
        self.plots.show_data(ParameterCharts(parameter, charts, _quantity(name), unit, size))
        runs = np.unique(np.concatenate([*self._signals.values()]))
        latest = runs[::-1][:_MAX_LISTED].tolist()
        words = {signal: (say(f"chart.{signal}_short"), say(f"chart.{signal}")) for signal in self._signals}
        self.signals.show_cells({str(index): self._signal_cells(parameter, index, words) for index in latest})
        self._show_note()

    def _choose_slow(self) -> None:
        self.plots.show_slow(self._slow.currentData())
        self._show_note()

    def _show_note(self) -> None:
        """Show how many runs signal, and how many of them only in the chart of slow changes that is not shown."""
        parameter = self._charts.get(self.quantities.current_name)
        if parameter is None:
            return
        hidden = "cusum" if self._slow.currentData() == "ewma" else "ewma"
        runs = np.unique(np.concatenate([*self._signals.values()]))
        shown = np.unique(np.concatenate([each for name, each in self._signals.items() if name != hidden]))
        code = "chart.signals" if len(runs) else "chart.no_signals"
        note = say(code, count=len(runs), total=len(parameter.names))
        if count := len(runs) - len(shown):
            chart = say("quality.cusum" if hidden == "cusum" else "quality.ewma")
            note += "\n" + say("chart.signals_hidden", count=count, chart=chart)
        self.note.setText(note)

    def _signal_cells(
        self, parameter: ParameterQuality, index: int, words: dict[str, tuple[str, str]]
    ) -> dict[str, str]:
        started = datetime.fromtimestamp(parameter.started[index], UTC).isoformat()
        texts = [words[signal] for signal, runs in self._signals.items() if index in runs[-_MAX_LISTED:]]
        return {
            "run": str(index + 1),
            "started": local_time(started),
            "rules": ", ".join(short for short, _ in texts),
            "hint": "\n".join([parameter.names[index], *(text for _, text in texts)]),
        }

    @property
    def _index(self) -> int | None:
        """Index of the selected run that signals."""
        return int(self.signals.current_name) if self.signals.current_name else None

    def _open(self) -> None:
        if self._index is not None:
            self.run_requested.emit(self._charts[self.quantities.current_name].names[self._index])


def _quantity(name: str) -> str:
    """Return the name of a charted quantity: a parameter, or the mean of a group over the axes."""
    text = parameter_text(name)
    return say("chart.mean_of_axes", quantity=text) if group_of(name) == name else text


def _state(charts: ParameterQuality) -> str:
    """Return the symbol of a parameter: bad if one of its latest runs signals, caution if an earlier run does."""
    if charts.latest is None:
        return "good"
    return "bad" if charts.latest >= len(charts.names) - _LATEST_RUNS else "caution"
