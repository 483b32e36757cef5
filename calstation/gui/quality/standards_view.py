"""The check standards and instruments of a station, the errors of a check standard, and the table geometry."""

import math
from collections.abc import Mapping
from datetime import UTC, datetime

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from calstation.gui.text import Words, bind, on_language_change, parameter_text, say, with_minus
from calstation.gui.widgets import (
    Cell,
    CellTable,
    DataView,
    ElidedLabel,
    StackedPlots,
    ThemedPlot,
    box,
    column,
    dashed,
    label,
    show_text,
    split,
    theme,
)
from calstation.judgement import POWER
from calstation.messages import Text, local_time, plain_number
from calstation.physics import ARCSECOND, display
from calstation.quality import BASELINE, StandardHistory, StationQuality, TableChart

#: Quantities of the table geometry, in the order of the plots.
_QUANTITIES = ("orthogonality", "tilt_x", "tilt_y")
_STATE = Cell("quality.state", "state", number=False, state="kind", hint="hint")
#: Symbol of each state of an instrument.
_INSTRUMENT_KINDS = {"overdue": "bad", "future": "caution", "good": "good", "undated": "none"}
#: Object name, accessible name and columns of the tables of standards, runs, instruments and detectable errors.
_TABLES = (
    (
        "standards_table",
        "quality.check_standards",
        (
            _STATE,
            Cell("common.serial_number", "serial", number=False),
            Cell("quality.passed", "passed", number=False),
            Cell("quality.due", "due", number=False),
        ),
    ),
    (
        "standard_runs_table",
        "quality.runs_of_standard",
        (
            Cell("quality.agreement", "state", number=False, state="kind"),
            Cell("common.started", "started", number=False),
            Cell("quality.largest_en", "error"),
            Cell("quality.t_squared", "t_squared"),
        ),
    ),
    (
        "instruments_table",
        "quality.instruments",
        (
            Cell("quality.state", "state", number=False, state="kind"),
            Cell("quality.name", "name", number=False),
            Cell("quality.kind", "kind_name", number=False),
            Cell("quality.due", "due", number=False),
            Cell("quality.calibrated", "calibrated", number=False),
            Cell("quality.certificate", "certificate", number=False),
        ),
    ),
    (
        "standard_power_table",
        "quality.smallest_errors",
        (
            Cell("common.parameter", "parameter", number=False),
            Cell("quality.normalised_error", "e_n"),
            Cell("quality.error", "error"),
            Cell("common.unit", "unit", number=False),
            Cell("quality.of_limit", "share"),
        ),
    ),
)


class StandardsView(QWidget, DataView[StationQuality]):
    """A view of the check standards of a station, which emits `run_requested(name)` for a run that the user opens."""

    run_requested = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self.standards, self.runs, self.instruments, self.power = (
            CellTable(*each, named=False, single=True) for each in _TABLES
        )
        self.standards.selectionModel().currentRowChanged.connect(lambda *_: self._show_runs())
        self.runs.selectionModel().currentRowChanged.connect(lambda *_: self._show_errors())
        self.runs.doubleClicked.connect(lambda _: self._open())
        self.errors, self.table = ErrorBars(), TableCharts()
        self.waiting = label(wrap=True, name="table_waiting_label")
        self.alarm = label(kind="error", wrap=True, name="table_alarm_label")
        words: tuple[Words, ...] = (
            "quality.product_standards",
            "quality.standard_runs",
            "quality.station_instruments",
            "quality.normalised_errors",
            Text.of("quality.geometry_chart", runs=BASELINE),
            Text.of("quality.detected_errors", percent=round(100 * POWER)),
        )
        titles = [ElidedLabel("muted") for _ in words]
        for title, text in zip(titles, words, strict=True):
            bind(title, text)
        hints = ("chart.no_standard_of_product", "chart.no_instruments", "chart.no_table_runs")
        self._no_standards, self._no_instruments, self._no_table = (
            label(code, "muted", wrap=True, name=f"{code.removeprefix('chart.')}_label") for code in hints
        )
        self._filler = QWidget()  # keeps the hints at the top
        self._of_standards = box((self.standards, 2), titles[1], (self.runs, 4))
        left = box(
            *(titles[0], self._no_standards, (self._of_standards, 6)),
            *(titles[2], self._no_instruments, (self.instruments, 3), (self._filler, 9)),
        )
        self._of_runs = box(titles[3], (self.errors, 3), titles[5], (self.power, 2))
        right = box(titles[4], self._no_table, self.waiting, self.alarm, (self.table, 1))
        body = split((left, 7), (self._of_runs, 7), (right, 6), handle=2 * theme.GRID)
        column((body, 1), on=self, margins=(0, theme.GRID, 0, 0))
        on_language_change(self, self.refresh)

    def show_data(self, data: StationQuality) -> None:
        """Show the state of a station, and select its first check standard."""
        self.table.show_data(data.table)
        super().show_data(data)
        if data.standards:
            self.standards.selectRow(0)

    @property
    def empty(self) -> bool:
        """Whether there is nothing to show."""
        data = self.data
        return data is None or not (data.standards or data.instruments or data.table)

    @property
    def _standard(self) -> StandardHistory | None:
        line = self.standards.currentIndex().row()
        return None if self.data is None or line < 0 else self.data.standards[line]

    def draw(self, data: StationQuality) -> None:
        """Fill the tables."""
        for hint, widgets, present in (
            (self._no_standards, (self._of_standards, self._of_runs), data.standards),
            (self._no_instruments, (self.instruments,), data.instruments),
            (self._no_table, (self.table,), data.table),
        ):
            hint.setVisible(not present)
            for widget in widgets:
                widget.setVisible(bool(present))
        self._filler.setVisible(not data.standards and not data.instruments)
        missing = BASELINE - min((data.table[name].baseline if name in data.table else 0) for name in _QUANTITIES)
        waiting = missing > 0 and bool(data.table)
        text = say("quality.baseline_missing", missing=missing, runs=BASELINE) if waiting else ""
        show_text(self.waiting, text)
        moved = [name for name in _QUANTITIES if name in data.table and data.table[name].alarms]
        alarms = [say("chart.table_moved", quantities=moved)] if moved else []
        if (shift := data.gravity) is not None:
            since, ppm = datetime.fromtimestamp(shift.started, UTC).isoformat(), 1e6 * shift.step
            values = {"run": shift.name, "since": local_time(since), "ppm": ppm, "units": shift.units}
            alarms.append(say("chart.gravity_changed", **values))
        show_text(self.alarm, "\n".join(alarms))
        cells = {}
        for each in data.standards:
            state, reason = each.state, "good" if each.state.problem is None else each.state.problem.reason
            cells[state.standard.serial] = {
                "kind": "good" if state.problem is None else "bad",
                "state": say(f"chart.standard_{reason}"),
                "hint": "" if state.problem is None else say(state.problem.cause),
                "serial": state.standard.serial,
                "passed": "–" if state.last_passed is None else local_time(state.last_passed.isoformat())[:10],
                "due": "–" if state.due is None else local_time(state.due.isoformat())[:10],
            }
        self.standards.show_cells(cells)
        self.instruments.show_cells(
            {
                str(k): {
                    "kind": "caution" if state == "overdue" and not each.required else _INSTRUMENT_KINDS[state],
                    "state": say(f"chart.instrument_{state}"),
                    "name": each.name,
                    "kind_name": say(f"form.kind_{each.kind}"),
                    "certificate": each.certificate or "–",
                    "calibrated": "–" if each.calibrated is None else each.calibrated.isoformat(),
                    "due": "–" if each.due is None else each.due.isoformat(),
                }
                for k, (each, state) in enumerate(zip(data.instruments, data.instrument_states, strict=True))
            }
        )
        self._show_runs()

    def _show_runs(self) -> None:
        standard = self._standard
        runs = [] if standard is None else list(zip(standard.started_utc, standard.verdicts, strict=True))
        cells = {}
        for k, (started, verdict) in reversed(list(enumerate(runs))):
            largest = max(verdict.e_n, key=lambda name: abs(verdict.e_n[name]), default="")
            cells[str(k)] = {
                "kind": "good" if verdict.passed else "bad",
                "state": say(f"chart.standard_{'agrees' if verdict.passed else 'differs'}"),
                "started": local_time(started),
                "error": f"{abs(verdict.e_n.get(largest, 0.0)):.2f} ({verdict.e_n_limit:.2f})",
                "t_squared": f"{verdict.t_squared:.1f} ({verdict.t_squared_limit:.1f})",
            }
        self.runs.show_cells(cells)
        if cells:
            self.runs.selectRow(0)
        else:
            self.errors.show_data(({}, 1.0))
            self.power.show_cells({})

    def _show_errors(self) -> None:
        standard, run = self._standard, self.runs.current_name
        if standard is not None and run:
            verdict = standard.verdicts[int(run)]
            self.errors.show_data((verdict.e_n, verdict.e_n_limit))
            self.power.show_cells(_power_cells(standard, int(run)))

    def _open(self) -> None:
        standard, run = self._standard, self.runs.current_name
        if standard is not None and run:
            self.run_requested.emit(standard.names[int(run)])


class ErrorBars(ThemedPlot, DataView[tuple[Mapping[str, float], float]]):
    """A plot of the normalised errors of the parameters as horizontal bars, with their limit."""

    def __init__(self) -> None:
        super().__init__()
        self.getAxis("left").setWidth(22 * theme.GRID)
        self.getViewBox().invertY(True)
        self.getViewBox().sigResized.connect(self._label_rows)
        theme.on_appearance_change(self, self.refresh)

    def draw(self, data: tuple[Mapping[str, float], float]) -> None:
        """Draw the errors of a run."""
        errors, highest = data
        self.setLabel("bottom", say("quality.normalised_error"))
        self.getPlotItem().clear()
        c = theme.colours()
        values, rows = np.array(list(errors.values())), np.arange(len(errors))
        brushes = [theme.faint(c.bad if abs(value) > highest else c.accent, 130) for value in values]
        self.addItem(pg.BarGraphItem(x0=0, y=rows, height=0.7, width=values, brushes=brushes, pen=c.line))
        for limit in (-highest, highest):
            self.addItem(pg.InfiniteLine(limit, 90, pen=dashed(c.bad)))
        reach = 1.1 * max(highest, float(np.abs(values).max(initial=0.0)))
        self.setXRange(-reach, reach, padding=0)
        self.setYRange(-0.5, max(len(rows), 4) - 0.5)
        self._label_rows()

    def _label_rows(self) -> None:
        """Label as many rows as there is space for."""
        errors = {} if self.data is None else self.data[0]
        space = self.getViewBox().height() / max(len(errors), 4)
        step = max(1, math.ceil(self.fontMetrics().height() / max(space, 1.0)))
        names = [(k, parameter_text(name)) for k, name in enumerate(errors)]
        self.getAxis("left").setTicks([names[::step]])


class TableCharts(StackedPlots[Mapping[str, TableChart]]):
    """Plots of the EWMA charts of the table geometry."""

    def __init__(self) -> None:
        super().__init__(len(_QUANTITIES), 9 * theme.GRID)
        column(*((plot, 1) for plot in self.plots), on=self, spacing=theme.GRID // 2)

    def draw(self, data: Mapping[str, TableChart]) -> None:
        """Draw the charts."""
        c = theme.colours()
        self.plots[-1].setLabel("bottom", say("quality.axis_run"))
        for plot, name in zip(self.plots, _QUANTITIES, strict=True):
            plot.setLabel("left", say(f"chart.{name}"))
            if name not in data:
                continue
            quantity = data[name]
            chart = quantity.ewma
            all_runs = np.arange(1, len(quantity.values) + 1)
            run, alarms = all_runs[quantity.baseline :], chart.signals
            values = pg.ScatterPlotItem(all_runs, quantity.values / ARCSECOND, size=4, pen=None, brush=c.line)
            self.add(plot, values)
            for limit in (chart.low, chart.high):
                self.add(plot, pg.PlotDataItem(run, limit / ARCSECOND, pen=dashed(c.bad)))
            self.add(plot, pg.PlotDataItem(run, chart.average / ARCSECOND, pen=theme.pen(c.accent, 1)))
            style = {"symbol": "s", "size": 10, "pen": theme.pen(c.bad, 2), "brush": None}
            self.add(plot, pg.ScatterPlotItem(run[alarms], chart.average[alarms] / ARCSECOND, **style))


def _power_cells(standard: StandardHistory, k: int) -> dict[str, dict[str, str]]:
    """Return the cells for the smallest errors that a run detects, by parameter."""
    cells = {}
    verdict = standard.verdicts[k]
    for name, error in verdict.detectable.items():
        value, unit = display(name, error)
        share = f"{100.0 * error / standard.half_limits[name]:.0f} %" if name in standard.half_limits else "–"
        e_n = with_minus(f"{verdict.e_n[name]:.2f}")
        named = {"parameter": parameter_text(name), "e_n": e_n}
        cells[name] = {**named, "error": plain_number(value, ".3g"), "unit": unit, "share": share}
    return cells
