"""The comparison of two versions of the solutions of all logs: changed verdicts and changed parameters."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QHBoxLayout, QWidget

from calstation.fleet import GROUPS, Comparison, ParameterShift, VerdictChange, compare_job, export_job, versions_job
from calstation.gui.state import FileExport, Page
from calstation.gui.text import Words, bind, on_language_change, parameter_text, product_text, say, term
from calstation.gui.widgets import (
    NOTABLE_SIGMAS,
    Cell,
    CellTable,
    DataView,
    EmptyState,
    JobRow,
    JobStack,
    LogAxis,
    ThemedPlot,
    box,
    button,
    column,
    combo_box,
    dashed,
    enable,
    fill_combo,
    label,
    row,
    show_text,
    split,
    stack,
    theme,
)
from calstation.messages import known, local_time

#: Version of the results stored by the runs.
_RUN_RESULTS = "online"
#: Choices for the rows of the plot: the parameters, or the groups of logs for the selected parameter.
_GROUPS = {"": "history.by_parameter", **{kind: f"history.by_{kind}" for kind in GROUPS}}
#: Maximum number of changed verdicts in the list; an export contains all.
_MAX_CHANGES = 1000
_CHANGES = (
    Cell("common.serial_number", "serial", number=False, hint="log"),
    Cell("common.product", "product", number=False, hint="log"),
    Cell("common.station", "station", number=False, hint="log"),
    Cell("common.started", "started", number=False, hint="log"),
    Cell("history.before", "before", number=False, hint="log"),
    Cell("history.after", "after", number=False, hint="log"),
    Cell("history.failed_checks", "checks", number=False, hint="log"),
)
_MOVES = (
    Cell("history.median_sigma", "median"),
    Cell("history.percentile_sigma", "percentile_95"),
    Cell("history.largest_sigma", "largest"),
    Cell("history.largest_unit", "serial", number=False, hint="log"),
)


class VersionsView(QWidget):
    """A comparison of two versions that the user selects; `back` is called to return to the list."""

    def __init__(self, page: Page, back: Callable[[], None]) -> None:
        super().__init__()
        self._app = page.app
        self._versions: list[str] = []
        self._comparison: Comparison | None = None
        self._reader = page.job(versions_job, self._offer, failure="history.versions_not_read", then=back)
        self._comparer = page.job(
            compare_job, self._show_comparison, failure="history.versions_not_compared", then=back
        )
        self.back_button = button("versions_back_button", "history.back_to_list", back)
        self.exports = FileExport(page, self.back_button.setFocus)
        for watch in (self._comparer, self.exports.watch):
            watch.busy_changed.connect(page.notice.dismiss)
        self._reader.busy_changed.connect(self._show_texts)
        self._summary = label(wrap=True, name="versions_summary_label")
        self._changes_title = label(kind="section")
        self.changes = CellTable("versions_changes_table", "history.changed_verdicts", _CHANGES, named=False)
        self.moves = CellTable("versions_moves_table", "history.moves_of_parameters", _MOVES, single=True)
        self.moves.selectionModel().currentRowChanged.connect(lambda *_: self._draw())
        self.plot = ShiftPlot()
        self._group = combo_box("versions_group_combo", _GROUPS)
        bind(self._group.setAccessibleName, "history.plot_rows")
        self._group.currentIndexChanged.connect(lambda _: self._draw())
        left = box(self._changes_title, (self.changes, 2), (self.moves, 3))
        right = box(row(None, self._group), (self.plot, 1))
        self._result = box(self._summary, (split((left, 5), (right, 4), handle=2 * theme.GRID), 1))
        self._nothing = EmptyState()
        self._body = stack(self._nothing, self._result)
        column(self._make_choice(), (self._body, 1), on=self)
        on_language_change(self, self._show_texts)

    def open(self) -> None:
        """Read the versions of the database."""
        if self._app.exchange_state is not None and not self._reader.busy:
            self._reader.start(self._app.station_path)
        self._show_texts()
        self.back_button.setFocus()

    def _make_choice(self) -> QHBoxLayout:
        self._before, self._after = (combo_box(f"versions_{name}_combo", characters=10) for name in ("before", "after"))
        for combo in (self._before, self._after):
            combo.currentIndexChanged.connect(lambda _: self._show_texts())
        self._compare_button = button("versions_compare_button", "common.compare", self._compare, kind="primary")
        self._export_button = button("versions_export_button", "history.export", self._export)
        idle = box(row(None, self._compare_button, self._export_button))
        progress = JobStack(
            idle,
            JobRow(self._reader, "versions_read_cancel_button"),
            JobRow(self._comparer, "versions_cancel_button"),
            JobRow(self.exports.watch, "versions_export_cancel_button"),
        )
        before = label("history.before", buddy=self._before)
        after = label("history.after", buddy=self._after)
        return row(self.back_button, before, (self._before, 2), after, (self._after, 2), (progress, 3))

    # ---- choosing and comparing

    def _offer(self, versions: list[str]) -> None:
        """List the versions; select the first (usually the runs' results) and the last."""
        if versions == self._versions:
            self._show_texts()
            return
        self._versions, self._comparison = versions, None
        for combo, chosen in ((self._before, versions[:1]), (self._after, versions[-1:])):
            fill_combo(combo, [(self._name(version), version) for version in versions], *chosen)
        self._show_texts()

    def _name(self, version: str) -> str:
        return say("history.original_results") if version == _RUN_RESULTS else version

    def _selected(self) -> tuple[str, str]:
        return self._before.currentData() or "", self._after.currentData() or ""

    def _compare(self) -> None:
        self._comparer.start(self._app.station_path, *self._selected())

    def _export(self) -> None:
        station, (before, after) = self._app.station_path, self._selected()
        self.exports.ask(
            say("history.export_comparison"),
            self._app.runs_folder.absolute().parent / "comparison.json",
            ["JSON (*.json)", "Parquet (*.parquet)"],
            lambda target: (export_job, station, before, after, target),
        )

    def _show_comparison(self, comparison: Comparison) -> None:
        self._comparison = comparison
        self._show_texts()

    # ---- showing

    def _why_not(self) -> str:
        before, after = self._selected()
        if len(self._versions) < 2:
            return say("history.no_two_versions")
        return say("history.choose_different") if before == after else ""

    def _show_texts(self) -> None:
        why = self._why_not()
        enable(self._compare_button, why, say("history.compare_versions_tip"))
        enable(self._export_button, why, say("history.export_comparison_tip"))
        for combo in (self._before, self._after):
            for index in range(combo.count()):
                combo.setItemText(index, self._name(combo.itemData(index)))
        comparison = self._comparison
        if comparison is None or (comparison.before, comparison.after) != self._selected():
            self._body.setCurrentWidget(self._nothing)
            self._nothing.say(*self._empty_words())
            return
        self._body.setCurrentWidget(self._result)
        down, up = len(comparison.pass_to_fail), len(comparison.fail_to_pass)
        lines = [say("history.logs_in_both", count=comparison.logs)]
        if comparison.only_before or comparison.only_after:
            lines.append(say("history.logs_in_one", before=comparison.only_before, after=comparison.only_after))
        lines.append(say("history.verdict_changes", down=down, up=up))
        show_text(self._summary, "  ·  ".join(lines))
        self._fill_changes(comparison.changes)
        self._fill_shifts(comparison)
        self._draw()

    def _empty_words(self) -> tuple[Words, ...]:
        """Return the title and text that are shown instead of a result."""
        if self._app.exchange_state is None:
            return "history.nothing_shared", "history.no_database"
        if self._reader.busy:
            return ("history.reading_versions",)
        if len(self._versions) < 2:
            return "history.no_two_versions_yet", "history.no_versions"
        return "history.choose_versions", "history.about_versions"

    def _fill_changes(self, changes: Sequence[VerdictChange]) -> None:
        table, listed = self.changes, changes[:_MAX_CHANGES]
        code = "history.no_verdict_changed"
        if changes:
            code = "history.changed_count" if len(listed) == len(changes) else "history.changed_listed"
        self._changes_title.setText(say(code, count=len(changes), shown=len(listed)))
        table.setVisible(bool(changes))
        table.show_cells(
            {
                str(number): {
                    "serial": change.serial,
                    "product": product_text(change.product or ""),
                    "station": change.station or "",
                    "started": local_time(change.started_utc or ""),
                    "before": self._verdict(change.before),
                    "after": self._verdict(change.after),
                    "checks": _checks_text(change.failed_after or change.failed_before),
                    "log": change.log,
                }
                for number, change in enumerate(listed)
            }
        )

    def _verdict(self, verdict: str) -> str:
        code = f"history.verdict_{verdict}"
        return say(code) if known(code) else term("badge", verdict)

    def _fill_shifts(self, comparison: Comparison) -> None:
        numbers = ("median", "percentile_95", "largest")
        self.moves.show_cells(
            {
                name: {**{key: f"{getattr(move, key):.3f}" for key in numbers}, "serial": move.serial, "log": move.log}
                for name, move in comparison.moves.items()
            },
            numbers,
        )
        if comparison.moves and not self.moves.currentIndex().isValid():
            medians = [move.median for move in comparison.moves.values()]
            self.moves.selectRow(medians.index(max(medians)))

    def _draw(self) -> None:
        comparison, kind = self._comparison, self._group.currentData()
        if comparison is None:
            return
        rows = {parameter_text(name): move for name, move in comparison.moves.items()}
        name = self.moves.current_name
        if kind and name:
            naming = product_text if kind == "product" else str
            rows = {naming(group.name): group.moves[name] for group in comparison.groups[kind] if name in group.moves}
        self.plot.show_data(rows)


def _checks_text(names: str) -> str:
    """Return the quantities whose checks failed."""
    quantities = dict.fromkeys(name.split()[0] for name in names.split(", ") if name)
    return ", ".join(map(parameter_text, quantities))


#: Lower end of the axis, at which smaller changes are drawn, and minimum of its upper end, sigmas.
_MIN_CHANGE, _MIN_END = 1e-3, 10.0
#: Height of the horizontal axis with its label, px.
_AXIS_HEIGHT = 7 * theme.GRID


class ShiftPlot(ThemedPlot, DataView[Mapping[str, ParameterShift]]):
    """A plot of the median, 95th percentile and maximum of the changes, with a row per parameter or group of logs."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("moves_plot")
        self.setAxisItems({"bottom": LogAxis("bottom")})
        self.apply_theme()
        self.setLogMode(x=True)
        bind(self.setAccessibleName, "history.move_distribution")
        theme.on_appearance_change(self, self.refresh)

    def show_data(self, data: Mapping[str, ParameterShift]) -> None:
        """Plot changes, whose keys are the labels of the rows."""
        self.setMinimumHeight(theme.BODY * len(data) + _AXIS_HEIGHT)
        self.getViewBox().reset()
        super().show_data(data)

    def draw(self, data: Mapping[str, ParameterShift]) -> None:
        """Plot the changes."""
        self.clear()
        c = theme.colours()
        y = np.arange(len(data))
        marks = (("median", "o"), ("percentile_95", "|"), ("largest", "x"))
        x = {mark: np.array([max(getattr(move, mark), _MIN_CHANGE) for move in data.values()]) for mark, _ in marks}
        self.addItem(pg.InfiniteLine(np.log10(NOTABLE_SIGMAS), 90, pen=dashed(c.caution)))
        for k in y.tolist():
            ends = [x["median"][k], x["largest"][k]]
            self.addItem(pg.PlotDataItem(ends, [k, k], pen=theme.pen(c.muted, 1)))
        for mark, symbol in marks:
            pen, colour = theme.pen(c.accent, 2), QColor(c.accent)
            style = {"symbol": symbol, "symbolSize": 9, "symbolPen": pen, "symbolBrush": colour}
            self.addItem(pg.PlotDataItem(x[mark], y, pen=None, **style))
        self.getAxis("left").setTicks([list(enumerate(data))])
        self.getPlotItem().invertY(True)
        self.setYRange(-0.6, max(len(y), 1) - 0.4, padding=0)
        end = max([_MIN_END, *x["largest"]])
        self.setXRange(np.log10(_MIN_CHANGE) - 0.1, np.log10(end) + 0.1, padding=0)
        self.setLabel("bottom", say("history.axis_moves"))
