"""Comparison of two versions of the solutions of all logs: changed verdicts, and changes of the parameters."""

from collections.abc import Callable, Sequence

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QAbstractItemView, QComboBox, QTableWidget, QTableWidgetItem, QWidget

from calstation.fleet import GROUPS, Comparison, VerdictChange, compare_job, export_job, versions_job
from calstation.gui.history.moves_plot import MovesPlot
from calstation.gui.state import FileExport, Page
from calstation.gui.text import Words, bind, on_language_change, parameter_text, product_text, say, term
from calstation.gui.widgets import (
    ROW,
    CellTable,
    EmptyState,
    JobRow,
    JobStack,
    button,
    column,
    combo_box,
    enable,
    label,
    row,
    show_text,
    split,
    stack,
    theme,
)
from calstation.messages import known, local_time

#: Version of the results stored by the runs.
_ONLINE = "online"
#: Rows of the plot: parameters, or the groups of one parameter.
_GROUPS = {"": "history.by_parameter", **{kind: f"history.by_{kind}" for kind in GROUPS}}
#: Largest number of changed verdicts listed; an export contains all.
_MOST = 1000


class VersionsView(QWidget):
    """Selects two versions, compares them by a job and shows the result; `back` is called to return to the list."""

    def __init__(self, page: Page, back: Callable[[], None]) -> None:
        super().__init__()
        self._app = page.app
        self._versions: list[str] = []
        self._found: Comparison | None = None
        self._reader = page.job(versions_job, self._offer, failure="history.versions_not_read", then=back)
        self._worker = page.job(compare_job, self._show_found, failure="history.versions_not_compared", then=back)
        self.back_button = button("versions_back_button", "history.back_to_list", back)
        self.exports = FileExport(page, self.back_button.setFocus)
        for watch in (self._worker, self.exports.watch):
            watch.busy_changed.connect(page.notice.dismiss)
        self._reader.busy_changed.connect(self._show_texts)
        self._summary = label(wrap=True, name="versions_summary_label")
        self._changes_title = label(kind="section")
        self.changes = self._make_changes()
        self.moves = self._make_moves()
        self.plot = MovesPlot()
        self._group = combo_box("versions_group_combo", _GROUPS)
        bind(self._group.setAccessibleName, "history.plot_rows")
        self._group.currentIndexChanged.connect(lambda _: self._draw())
        left = QWidget()
        column(self._changes_title, (self.changes, 2), (self.moves, 3), on=left)
        right = QWidget()
        column(row(None, self._group), (self.plot, 1), on=right)
        answer = QWidget()
        column(self._summary, (split((left, 5), (right, 4), handle=2 * theme.GRID), 1), on=answer)
        self._nothing = EmptyState()
        self._body, self._answer = stack(self._nothing, answer), answer
        column(self._make_choice(), (self._body, 1), on=self)
        on_language_change(self, self._show_texts)

    def open(self) -> None:
        """Read the versions of the database."""
        if self._app.exchange_state is not None and not self._reader.busy:
            self._reader.start(self._app.station_path)
        self._show_texts()
        self.back_button.setFocus()

    def _make_choice(self) -> QWidget:
        self._before, self._after = self._version_combo("before"), self._version_combo("after")
        self._compare_button = button("versions_compare_button", "common.compare", self._compare, kind="primary")
        self._export_button = button("versions_export_button", "history.export", self._export)
        idle = QWidget()
        row(None, self._compare_button, self._export_button, on=idle)
        progress = JobStack(
            idle,
            JobRow(self._reader, "versions_read_cancel_button"),
            JobRow(self._worker, "versions_cancel_button"),
            JobRow(self.exports.watch, "versions_export_cancel_button"),
        )
        before = label("history.before", buddy=self._before)
        after = label("history.after", buddy=self._after)
        choice = QWidget()
        row(self.back_button, before, (self._before, 2), after, (self._after, 2), (progress, 3), on=choice)
        return choice

    def _version_combo(self, name: str) -> QComboBox:
        combo = QComboBox()
        combo.setObjectName(f"versions_{name}_combo")
        combo.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        combo.setMinimumContentsLength(10)
        combo.currentIndexChanged.connect(lambda _: self._show_texts())
        return combo

    def _make_changes(self) -> QTableWidget:
        table = QTableWidget(0, 7)
        table.setObjectName("versions_changes_table")
        table.setFont(theme.font())
        table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        table.setAlternatingRowColors(True)
        table.setShowGrid(False)
        table.setWordWrap(False)
        table.setTabKeyNavigation(False)
        table.verticalHeader().hide()
        table.verticalHeader().setDefaultSectionSize(ROW)
        table.horizontalHeader().setHighlightSections(False)
        table.horizontalHeader().setStretchLastSection(True)
        table.horizontalHeader().setResizeContentsPrecision(_MOST)
        table.horizontalHeader().setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        bind(table.setAccessibleName, "history.changed_verdicts")
        return table

    def _make_moves(self) -> CellTable:
        table = CellTable("versions_moves_table")
        bind(table.setAccessibleName, "history.moves_of_parameters")
        table.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        text = table.column
        table.parameters.set_columns(
            (
                text("history.median_sigma", "median"),
                text("history.percentile_sigma", "percentile_95"),
                text("history.largest_sigma", "largest"),
                text("history.largest_unit", "serial", number=False, hint=self._log_of),
            )
        )
        table.selectionModel().currentRowChanged.connect(lambda *_: self._draw())
        return table

    # ---- choosing and comparing

    def _offer(self, versions: list[str]) -> None:
        """Offer the versions; by default select the results of the runs, or the first version, and the last one."""
        if versions == self._versions:
            self._show_texts()
            return
        self._versions, self._found = versions, None
        for combo, index in ((self._before, 0), (self._after, len(versions) - 1)):
            combo.clear()
            for version in versions:
                combo.addItem(self._name(version), version)
            combo.setCurrentIndex(index)
        self._show_texts()

    def _name(self, version: str) -> str:
        return say("history.original_results") if version == _ONLINE else version

    def _chosen(self) -> tuple[str, str]:
        return self._before.currentData() or "", self._after.currentData() or ""

    def _compare(self) -> None:
        self._worker.start(self._app.station_path, *self._chosen())

    def _export(self) -> None:
        station, (before, after) = self._app.station_path, self._chosen()
        self.exports.ask(
            say("history.export_comparison"),
            self._app.runs_folder.absolute().parent / "comparison.json",
            ["JSON (*.json)", "Parquet (*.parquet)"],
            lambda target: (export_job, station, before, after, target),
        )

    def _show_found(self, found: Comparison) -> None:
        self._found = found
        self._show_texts()

    # ---- showing

    def _why_not(self) -> str:
        before, after = self._chosen()
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
        found = self._found
        if found is None or (found.before, found.after) != self._chosen():
            self._body.setCurrentWidget(self._nothing)
            self._nothing.say(*self._empty_words())
            return
        self._body.setCurrentWidget(self._answer)
        down, up = len(found.pass_to_fail), len(found.fail_to_pass)
        lines = [say("history.logs_in_both", count=found.logs)]
        if found.only_before or found.only_after:
            lines.append(say("history.logs_in_one", before=found.only_before, after=found.only_after))
        lines.append(say("history.verdict_changes", down=down, up=up))
        show_text(self._summary, "  ·  ".join(lines))
        self._fill_changes(found.changes)
        self._fill_moves(found)
        self._draw()

    def _empty_words(self) -> tuple[Words, ...]:
        """Return title and text of the area in which the result will be shown."""
        if self._app.exchange_state is None:
            return "history.nothing_shared", "history.no_database"
        if self._reader.busy:
            return ("history.reading_versions",)
        if len(self._versions) < 2:
            return "history.no_two_versions_yet", "history.no_versions"
        return "history.choose_versions", "history.about_versions"

    def _fill_changes(self, changes: Sequence[VerdictChange]) -> None:
        table, shown = self.changes, changes[:_MOST]
        code = "history.no_verdict_changed"
        if changes:
            code = "history.changed_count" if len(shown) == len(changes) else "history.changed_listed"
        self._changes_title.setText(say(code, count=len(changes), shown=len(shown)))
        table.setVisible(bool(changes))
        headings = (
            "common.serial_number",
            "common.product",
            "common.station",
            "common.started",
            "history.before",
            "history.after",
            "history.failed_checks",
        )
        table.setHorizontalHeaderLabels([say(code) for code in headings])
        table.setRowCount(len(shown))
        for number, change in enumerate(shown):
            texts = (
                change.serial,
                product_text(change.product or ""),
                change.station or "",
                local_time(change.started_utc or ""),
                self._verdict(change.before),
                self._verdict(change.after),
                _checks_text(change.failed_after or change.failed_before),
            )
            for k, text in enumerate(texts):
                cell = QTableWidgetItem(text)
                cell.setToolTip(change.log)
                table.setItem(number, k, cell)
        table.resizeColumnsToContents()

    def _verdict(self, verdict: str) -> str:
        code = f"history.verdict_{verdict}"
        return say(code) if known(code) else term("badge", verdict)

    def _fill_moves(self, found: Comparison) -> None:
        numbers = ("median", "percentile_95", "largest")
        self.moves.show_cells(
            {
                name: {**{key: f"{getattr(move, key):.3f}" for key in numbers}, "serial": move.serial}
                for name, move in found.moves.items()
            },
            numbers,
        )
        if found.moves and not self.moves.currentIndex().isValid():
            medians = [move.median for move in found.moves.values()]
            self.moves.selectRow(medians.index(max(medians)))

    def _log_of(self, name: str) -> str:
        assert self._found is not None
        return self._found.moves[name].log

    def _draw(self) -> None:
        found, kind = self._found, self._group.currentData()
        if found is None:
            return
        rows = {parameter_text(name): move for name, move in found.moves.items()}
        line = self.moves.currentIndex().row()
        if kind and 0 <= line < len(found.moves):
            name = list(found.moves)[line]
            naming = product_text if kind == "product" else str
            rows = {naming(group.name): group.moves[name] for group in found.groups[kind] if name in group.moves}
        self.plot.show_moves(rows)


def _checks_text(names: str) -> str:
    """Return the quantities whose checks failed."""
    quantities = dict.fromkeys(name.split()[0] for name in names.split(", ") if name)
    return ", ".join(map(parameter_text, quantities))
