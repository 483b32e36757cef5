"""Control charts: a list of quantities, the charts of the selected one, and the runs that signal."""

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QAbstractItemView, QWidget

from calstation.gui.quality.control_charts import ControlCharts, Shown
from calstation.gui.text import bind, on_language_change, parameter_text, say
from calstation.gui.widgets import CellTable, Column, column, combo_box, label, row, split, theme
from calstation.messages import local_time
from calstation.physics import IntArray, display
from calstation.quality import ParameterQuality

#: Largest number of signalling runs that are listed, the latest first.
_MOST_LISTED = 200
#: Number of rows used to determine the width of a column.
_MEASURED = 20
#: Number of the latest runs whose signals make a quantity notable.
_LATEST = 10


class ControlView(QWidget):
    """Shows the charts of quantities; emits `run_wanted(name)` for a run that the user opens."""

    run_wanted = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self._charts: dict[str, ParameterQuality] = {}
        self._states: dict[str, str | None] = {}
        self._signals: dict[str, IntArray] = {}  #: Signals of the selected quantity, see `Charts.signals`.
        self._relative = False
        self.plots = ControlCharts()
        self._slow = combo_box("quality_slow_combo", {"ewma": "quality.ewma", "cusum": "quality.cusum"})
        self._slow.currentIndexChanged.connect(lambda _: self.plots.show_slow(self._slow.currentData()))
        self.quantities, self.signals = CellTable("quality_quantities_table"), CellTable("quality_signals_table")
        self.note = label(kind="muted", name="quality_signals_label", wrap=True)
        self._build_tables()
        self._side, right = QWidget(), QWidget()
        column((self.quantities, 3), self.note, (self.signals, 2), on=self._side)
        caption = label("quality.slow_chart", buddy=self._slow)
        column((self.plots, 1), row(None, caption, self._slow), on=right)
        column((split((self._side, 3), (right, 7), handle=2 * theme.GRID), 1), on=self, margins=(0, theme.GRID, 0, 0))
        on_language_change(self, self._draw)

    def show_charts(self, charts: Sequence[ParameterQuality], *, relative: bool) -> None:
        """Show charts of the quantities of one product; `relative` values are in standard deviations."""
        chosen = self._quantity
        self._charts, self._relative = {each.parameter: each for each in charts}, relative
        self._states = {name: _state(each) for name, each in self._charts.items()}
        self._fill()
        names = list(self._charts)
        if names:
            self.quantities.selectRow(names.index(chosen) if chosen in names else 0)

    @property
    def empty(self) -> bool:
        """Return whether there is nothing to show."""
        return not self._charts

    @property
    def _quantity(self) -> str:
        names = list(self._charts)
        line = self.quantities.currentIndex().row()
        return names[line] if 0 <= line < len(names) else ""

    def _build_tables(self) -> None:
        quantities, signals = self.quantities, self.signals
        bind(quantities.setAccessibleName, "quality.quantities")
        bind(signals.setAccessibleName, "quality.signalling_runs")
        for table in (quantities, signals):
            table.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
            table.horizontalHeader().setResizeContentsPrecision(_MEASURED)
        quantities.parameters.set_columns(
            (
                quantities.column("quality.runs", "runs"),
                Column(
                    "quality.signals",
                    lambda name: quantities.cells[name]["signals"],
                    state=lambda name: self._states[name],
                ),
            )
        )
        signals.verticalHeader().hide()
        signals.parameters.set_columns(
            (
                signals.column("quality.run", "run"),
                signals.column("common.started", "started", number=False),
                signals.column("quality.signal", "rules", number=False, hint=self._hint),
            )
        )
        quantities.selectionModel().currentRowChanged.connect(lambda *_: self._draw())
        signals.selectionModel().currentRowChanged.connect(lambda current, _: self._mark(current.row()))
        signals.doubleClicked.connect(lambda index: self._open(index.row()))

    def _hint(self, key: str) -> str:
        return self.signals.cells[key]["hint"]

    def _fill(self) -> None:
        self.quantities.show_cells(
            {
                name: {"runs": str(len(each.names)), "signals": str(sum(each.alarms.values()))}
                for name, each in self._charts.items()
            }
        )

    def _draw(self) -> None:
        name = self._quantity
        if not name:
            return
        shown, text = self._charts[name], parameter_text(name)
        size, unit = (1.0, "σ") if self._relative else display(name, 1.0)
        charts = shown.charts()
        self._signals = charts.signals()
        self.plots.show_data(Shown(shown, charts, text, unit, size))
        runs = np.unique(np.concatenate([*self._signals.values()]))
        latest = runs[::-1][:_MOST_LISTED].tolist()
        words = {signal: (say(f"chart.{signal}_short"), say(f"chart.{signal}")) for signal in self._signals}
        self.signals.show_cells({str(index): self._signal_cells(shown, index, words) for index in latest})
        code = "chart.signals" if len(runs) else "chart.no_signals"
        self.note.setText(say(code, count=len(runs), total=len(shown.names)))

    def _signal_cells(self, shown: ParameterQuality, index: int, words: dict[str, tuple[str, str]]) -> dict[str, str]:
        started = datetime.fromtimestamp(shown.started[index], UTC).isoformat()
        here = [words[signal] for signal, found in self._signals.items() if index in found[-_MOST_LISTED:]]
        return {
            "run": str(index + 1),
            "started": local_time(started),
            "rules": ", ".join(short for short, _ in here),
            "hint": "\n".join([shown.names[index], *(text for _, text in here)]),
        }

    def _index(self, line: int) -> int | None:
        keys = list(self.signals.cells)
        return int(keys[line]) if 0 <= line < len(keys) else None

    def _mark(self, line: int) -> None:
        self.plots.choose(self._index(line))

    def _open(self, line: int) -> None:
        index = self._index(line)
        if index is not None:
            self.run_wanted.emit(self._charts[self._quantity].names[index])


def _state(charts: ParameterQuality) -> str:
    """Return the symbol of a quantity: whether one of its latest runs, or any run, signals."""
    if charts.latest is None:
        return "good"
    return "bad" if charts.latest >= len(charts.names) - _LATEST else "caution"
