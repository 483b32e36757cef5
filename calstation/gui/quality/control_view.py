"""Control charts: a list of quantities, the charts of the selected one, and the runs that signal."""

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from calstation.gui.quality.control_charts import ControlCharts, Shown
from calstation.gui.text import on_language_change, parameter_text, say
from calstation.gui.widgets import Cell, CellTable, column, combo_box, label, row, split, theme
from calstation.messages import local_time
from calstation.physics import IntArray, display
from calstation.quality import ParameterQuality

#: Largest number of signalling runs that are listed, the latest first.
_MAX_LISTED = 200
#: Number of rows used to determine the width of a column.
_MEASURED = 20
#: Number of the latest runs whose signals make a quantity notable.
_LATEST = 10
_QUANTITIES = (
    Cell("quality.runs", "runs"),
    Cell("quality.signals", "signals", state="kind"),
)
_SIGNALS = (
    Cell("quality.run", "run"),
    Cell("common.started", "started", number=False),
    Cell("quality.signal", "rules", number=False, hint="hint"),
)


class ControlView(QWidget):
    """Shows the charts of quantities; emits `run_wanted(name)` for a run that the user opens."""

    run_wanted = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self._charts: dict[str, ParameterQuality] = {}
        self._signals: dict[str, IntArray] = {}  #: Signals of the selected quantity, see `Charts.signals`.
        self._relative = False
        self.plots = ControlCharts()
        self._slow = combo_box("quality_slow_combo", {"ewma": "quality.ewma", "cusum": "quality.cusum"})
        self._slow.currentIndexChanged.connect(lambda _: self.plots.show_slow(self._slow.currentData()))
        self.quantities = CellTable("quality_quantities_table", "quality.quantities", _QUANTITIES, single=True)
        name, words = "quality_signals_table", "quality.signalling_runs"
        self.signals = CellTable(name, words, _SIGNALS, named=False, single=True)
        for table in (self.quantities, self.signals):
            table.horizontalHeader().setResizeContentsPrecision(_MEASURED)
        self.quantities.selectionModel().currentRowChanged.connect(lambda *_: self._draw())
        self.signals.selectionModel().currentRowChanged.connect(lambda *_: self.plots.choose(self._index))
        self.signals.doubleClicked.connect(lambda _: self._open())
        self.note = label(kind="muted", name="quality_signals_label", wrap=True)
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
        return self.quantities.current_name

    def _fill(self) -> None:
        self.quantities.show_cells(
            {
                name: {"runs": str(len(each.names)), "signals": str(sum(each.alarms.values())), "kind": _state(each)}
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
        latest = runs[::-1][:_MAX_LISTED].tolist()
        words = {signal: (say(f"chart.{signal}_short"), say(f"chart.{signal}")) for signal in self._signals}
        self.signals.show_cells({str(index): self._signal_cells(shown, index, words) for index in latest})
        code = "chart.signals" if len(runs) else "chart.no_signals"
        self.note.setText(say(code, count=len(runs), total=len(shown.names)))

    def _signal_cells(self, shown: ParameterQuality, index: int, words: dict[str, tuple[str, str]]) -> dict[str, str]:
        started = datetime.fromtimestamp(shown.started[index], UTC).isoformat()
        here = [words[signal] for signal, runs in self._signals.items() if index in runs[-_MAX_LISTED:]]
        return {
            "run": str(index + 1),
            "started": local_time(started),
            "rules": ", ".join(short for short, _ in here),
            "hint": "\n".join([shown.names[index], *(text for _, text in here)]),
        }

    @property
    def _index(self) -> int | None:
        """Index of the selected signalling run."""
        return int(self.signals.current_name) if self.signals.current_name else None

    def _open(self) -> None:
        if self._index is not None:
            self.run_wanted.emit(self._charts[self._quantity].names[self._index])


def _state(charts: ParameterQuality) -> str:
    """Return the symbol of a quantity: whether one of its latest runs, or any run, signals."""
    if charts.latest is None:
        return "good"
    return "bad" if charts.latest >= len(charts.names) - _LATEST else "caution"
