"""Control charts of the chosen runs: a list of quantities, their charts, and the runs that signal."""

from collections.abc import Mapping
from datetime import UTC, datetime

import numpy as np
from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QAbstractItemView, QComboBox, QWidget

from calstation.gui.quality.control_charts import ControlCharts, ControlData
from calstation.gui.text import bind, on_language_change, parameter_text, say
from calstation.gui.widgets import CellTable, Column, column, label, row, show_text, split, theme
from calstation.messages import local_time
from calstation.physics import display
from calstation.quality import cusum_chart, ewma_chart, individuals_chart, standardised
from calstation.records import RunColumns

#: Fewest runs for a chart.
LEAST_RUNS = 3
#: Largest number of signalling runs that are listed, the latest first.
_MOST_LISTED = 200


class ControlView(QWidget):
    """Shows the charts of one quantity of the runs; emits `run_wanted(name)` for a run that the user opens."""

    run_wanted = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self._runs: RunColumns | None = None
        self._reference: Mapping[str, float] = {}
        self._shown: list[int] = []  # indices of the runs of the charts
        self._data: ControlData | None = None
        self.charts = ControlCharts()
        self._quantity, self._scale, self._slow = QComboBox(), QComboBox(), QComboBox()
        for combo, name in ((self._quantity, "quantity"), (self._scale, "scale"), (self._slow, "slow")):
            combo.setObjectName(f"quality_{name}_combo")
            combo.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToContents)
        self._scale.addItem("", "value")
        self._scale.addItem("", "standardised")
        self._slow.addItem("EWMA", "ewma")
        self._slow.addItem("CUSUM", "cusum")
        self._note = label(kind="muted", name="quality_signals_label", wrap=True)
        self.signals = CellTable("quality_signals_table")
        self._build_table()
        self._quantity.currentIndexChanged.connect(lambda _: self._draw())
        self._scale.currentIndexChanged.connect(lambda _: self._draw())
        self._slow.currentIndexChanged.connect(lambda _: self.charts.show_slow(self._slow.currentData()))
        captions = [
            label(lambda: self.tr("Quantity"), buddy=self._quantity),
            label(lambda: self.tr("Shown as"), buddy=self._scale),
            label(lambda: self.tr("Slow changes"), buddy=self._slow),
        ]
        combos = (self._quantity, self._scale, self._slow)
        bar = [item for pair in zip(captions, combos, strict=True) for item in (*pair, theme.GRID)]
        side = QWidget()
        column(self._note, (self.signals, 1), on=side)
        column(
            row(*bar, None),
            (split((self.charts, 3), (side, 1), handle=2 * theme.GRID), 1),
            on=self,
            margins=(0, theme.GRID, 0, 0),
        )
        on_language_change(self, self._show_texts)

    def show_runs(self, runs: RunColumns, reference: Mapping[str, float]) -> None:
        """Show runs, the oldest first; `reference` are the values from which standardised ones are measured, SI."""
        self._runs, self._reference = runs, reference
        wanted = self._quantity.currentData()
        names = [name for name, values in runs.values.items() if np.isfinite(values).sum() >= LEAST_RUNS]
        with QSignalBlocker(self._quantity):
            self._quantity.clear()
            for name in names:
                self._quantity.addItem(parameter_text(name), name)
            self._quantity.setCurrentIndex(max(0, self._quantity.findData(wanted)))
        self._draw()

    def _build_table(self) -> None:
        table = self.signals
        bind(table.setAccessibleName, lambda: self.tr("Runs that signal, the latest first"))
        table.verticalHeader().hide()
        table.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        table.parameters.set_columns(
            (
                table.column(lambda: self.tr("Run"), "run"),
                table.column(lambda: self.tr("Serial number"), "serial", number=False),
                table.column(lambda: self.tr("Signal"), "rules", number=False, hint=self._hint),
            )
        )
        table.selectionModel().currentRowChanged.connect(lambda current, _: self._choose(current.row()))
        table.doubleClicked.connect(lambda index: self._open(index.row()))

    def _hint(self, key: str) -> str:
        return self.signals.cells[key]["hint"]

    def _draw(self) -> None:
        runs, name = self._runs, self._quantity.currentData()
        if runs is None or name is None:
            return
        values, sigmas = runs.values[name], runs.sigmas[name]
        known = np.isfinite(values)
        relative = self._scale.currentData() == "standardised"
        if relative:
            known &= sigmas > 0.0
        self._shown = np.flatnonzero(known).tolist()
        found, unit = values[known], ""
        if relative:
            found = standardised(found, self._reference.get(name, float(np.mean(found))), sigmas[known])
        else:
            size, unit = display(name, 1.0)
            found = found * size
        text = parameter_text(name)
        self._data = data = ControlData(
            self.tr("{0}, in σ").format(text) if relative else text,
            unit,
            individuals_chart(found),
            ewma_chart(found),
            cusum_chart(found),
        )
        self.charts.choose(None)
        self.charts.show_data(data)
        self._list_signals()

    def _list_signals(self) -> None:
        runs, data = self._runs, self._data
        if runs is None or data is None:
            return
        rules: dict[int, list[str]] = {}
        for index, rule in zip(data.individuals.signals.index, data.individuals.signals.rule, strict=True):
            rules.setdefault(int(index), []).append(f"nelson_{rule}")
        further = (
            ("range", data.individuals.range_signals),
            ("ewma", data.ewma.signals),
            ("cusum", np.union1d(data.cusum.signals_high, data.cusum.signals_low)),
        )
        for code, found in further:
            for index in found.tolist():
                rules.setdefault(index, []).append(code)
        cells = {}
        for index in sorted(rules, reverse=True)[:_MOST_LISTED]:
            k = self._shown[index]
            started = datetime.fromtimestamp(runs.started[k], UTC).isoformat()
            words = [say(f"chart.{code}") for code in rules[index]]
            cells[str(index)] = {
                "run": str(index + 1),
                "serial": runs.serials[k],
                "rules": ", ".join(say(f"chart.{code}_short") for code in rules[index]),
                "hint": "\n".join([local_time(started), *words]),
            }
        self.signals.show_cells(cells)
        count, total = len(rules), len(self._shown)
        show_text(self._note, say("chart.signals" if count else "chart.no_signals", count=count, total=total))

    def _choose(self, line: int) -> None:
        keys = list(self.signals.cells)
        self.charts.choose(int(keys[line]) if 0 <= line < len(keys) else None)

    def _open(self, line: int) -> None:
        assert self._runs is not None
        self.run_wanted.emit(self._runs.names[self._shown[int(list(self.signals.cells)[line])]])

    def _show_texts(self) -> None:
        self._scale.setItemText(0, self.tr("Value"))
        self._scale.setItemText(1, self.tr("(Value − reference) / σ"))
        for index in range(self._quantity.count()):
            self._quantity.setItemText(index, parameter_text(self._quantity.itemData(index)))
        self._draw()
