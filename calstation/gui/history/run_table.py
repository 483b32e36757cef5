"""Filters for the listed runs, and the table of runs: outcome, unit, time, operator, duration and stages."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

from PySide6.QtCore import QCoreApplication, QModelIndex, Qt, QTimer, Signal
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import (
    QAbstractItemView,
    QComboBox,
    QHeaderView,
    QLineEdit,
    QTableWidget,
    QTableWidgetItem,
    QWidget,
)

from calstation.gui.text import KINDS, bind, duration_text, on_language_change, product_text, term
from calstation.gui.widgets import label, row, state_colour, state_icon, theme
from calstation.messages import local_time
from calstation.records import RunRecord

#: Choices of outcome, and of the number of past days; None for all.
_OUTCOMES = (None, "passed", "partial", "failed", "stopped", "fault", "incomplete")
_DAYS = (None, 1, 7, 30, 365)
#: Columns hidden first if there is too little space: attempt, operator, product; the details also show them.
_HIDDEN_FIRST = (4, 5, 3)
_OUTCOME, _STARTED, _STAGES = 0, 2, 7
#: Right-aligned columns of numbers: attempt, duration.
_NUMBERS = (4, 6)


class Filters(QWidget):
    """Inputs that filter the runs; emits `changed` when a filter changes."""

    changed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.search_edit, self._outcome, self._time = QLineEdit(), QComboBox(), QComboBox()
        self.search_edit.setObjectName("history_search_edit")
        self.search_edit.setClearButtonEnabled(True)
        bind(self.search_edit.setPlaceholderText, lambda: self.tr("Serial number, date, product, operator"))
        caption = label(lambda: self.tr("Search"), buddy=self.search_edit)
        for combo, name, entries in ((self._outcome, "outcome", _OUTCOMES), (self._time, "time", _DAYS)):
            combo.setObjectName(f"history_{name}_combo")
            for entry in entries:
                combo.addItem("", entry)
            combo.currentIndexChanged.connect(lambda _: self.changed.emit())
        bind(self._outcome.setAccessibleName, lambda: self.tr("Outcome"))
        bind(self._time.setAccessibleName, lambda: self.tr("Time"))
        self._count = label(kind="muted")
        row(caption, (self.search_edit, 1), self._outcome, self._time, self._count, on=self)
        self._timer = QTimer(self, singleShot=True, interval=150)
        self._timer.timeout.connect(self.changed)
        self.search_edit.textChanged.connect(lambda _: self._timer.start())
        on_language_change(self, self._name_entries)

    @property
    def search(self) -> str:
        """The search text."""
        return self.search_edit.text().strip()

    @property
    def outcome(self) -> str | None:
        """The selected outcome, None for all."""
        return _OUTCOMES[self._outcome.currentIndex()]

    @property
    def since(self) -> str:
        """The earliest start time to list, ISO 8601 in UTC, "" for any."""
        days = _DAYS[self._time.currentIndex()]
        if days is None:
            return ""
        midnight = datetime.now().astimezone().replace(hour=0, minute=0, second=0, microsecond=0)
        return (midnight - timedelta(days=days - 1)).astimezone(UTC).isoformat()

    @property
    def active(self) -> bool:
        """Whether any filter is set."""
        return bool(self.search or self.outcome or self.since)

    def clear(self) -> None:
        """Reset all filters."""
        self.search_edit.clear()
        self._outcome.setCurrentIndex(0)
        self._time.setCurrentIndex(0)

    def show_count(self, count: int, most: int) -> None:
        """Show the number of runs listed; if it reaches `most`, there may be more."""
        text = self.tr("the latest {0} runs") if count >= most else self.tr("runs: {0}")
        self._count.setText(text.format(count))

    def _name_entries(self) -> None:
        for index, outcome in enumerate(_OUTCOMES):
            self._outcome.setItemText(index, term("badge", outcome) if outcome else self.tr("Every outcome"))
        for index, days in enumerate(_DAYS):
            text = self.tr("Last {0} days").format(days)
            if days is None or days == 1:
                text = self.tr("Any time") if days is None else self.tr("Today")
            self._time.setItemText(index, text)


class RunTable(QTableWidget):
    """Lists runs, the latest first; emits `selected(run)`, with None if there is no run."""

    selected = Signal(object)

    def __init__(self) -> None:
        super().__init__(0, _STAGES + 1)
        self.runs: tuple[RunRecord, ...] = ()
        self.setObjectName("history_table")
        self.setFont(theme.font())
        self.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.setAlternatingRowColors(True)
        self.setShowGrid(False)
        self.setTabKeyNavigation(False)
        self.setWordWrap(False)
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(theme.BUTTON)
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        header.setSectionResizeMode(QHeaderView.ResizeMode.Fixed)
        header.setStretchLastSection(True)
        header.setResizeContentsPrecision(0)  # columns are as wide as the visible rows need
        self.selectionModel().currentRowChanged.connect(self._row_changed)
        theme.themes.changed.connect(self._fill_rows)
        on_language_change(self, self._refresh)

    @property
    def run(self) -> RunRecord | None:
        """The selected run, None if there is none."""
        number = self.currentRow()
        return self.runs[number] if 0 <= number < len(self.runs) else None

    def show_runs(self, runs: Sequence[RunRecord]) -> None:
        """Show these runs; the selected run stays selected if it is among them, otherwise select the latest."""
        log = self.run.log if self.run is not None else None
        self.setRowCount(0)
        self.runs = tuple(runs)
        self.setRowCount(len(runs))
        self._fill_rows()
        self._share_width()
        if runs:
            self.selectRow(next((i for i, run in enumerate(runs) if run.log == log), 0))
        else:
            self.selected.emit(None)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Distribute the new width among the columns."""
        super().resizeEvent(event)
        if event.size().width() != event.oldSize().width():
            self._share_width()

    def _fill_rows(self) -> None:
        for number, run in enumerate(self.runs):
            self._fill(number, run)

    def _refresh(self) -> None:
        headings = (
            self.tr("Outcome"),
            self.tr("Serial number"),
            self.tr("Started"),
            self.tr("Product"),
            self.tr("Attempt"),
            self.tr("Operator"),
            self.tr("Duration"),
            self.tr("Stages"),
        )
        for column, text in enumerate(headings):
            self.setHorizontalHeaderItem(column, _cell(text, column))
        if self.runs:
            self.show_runs(self.runs)

    def _fill(self, number: int, run: RunRecord) -> None:
        texts = (
            term("badge", run.verdict),
            run.serial,
            local_time(run.started_utc),
            product_text(run.product or ""),
            str(run.attempt),
            run.operator or "",
            duration_text(run.duration),
            stages_text(run),
        )
        cells = [_cell(text, column) for column, text in enumerate(texts)]
        kind = KINDS.get(run.verdict, "none")
        cells[_OUTCOME].setIcon(state_icon(kind))
        cells[_OUTCOME].setForeground(state_colour(kind))
        for column, cell in enumerate(cells):
            cell.setToolTip(local_time(run.started_utc, zone=True) if column == _STARTED else cell.text())
            self.setItem(number, column, cell)

    def _share_width(self) -> None:
        """Fit the columns to their contents, the stages to the remaining width; hide columns if it is too small."""
        for column in range(_STAGES):
            self.setColumnHidden(column, False)
        self.resizeColumnsToContents()
        for column in range(_STAGES):
            self.setColumnWidth(column, self.columnWidth(column) + 2 * theme.GRID)
        left = self.viewport().width() - sum(self.columnWidth(column) for column in range(_STAGES))
        for column in _HIDDEN_FIRST:
            if left >= 30 * theme.GRID:  # sufficient width for the stages
                break
            left += self.columnWidth(column)
            self.setColumnHidden(column, True)
        self.setColumnWidth(_STAGES, max(left, 10 * theme.GRID))

    def _row_changed(self, current: QModelIndex) -> None:
        if current.isValid():
            self.selected.emit(self.run)


def _cell(text: str, column: int) -> QTableWidgetItem:
    cell = QTableWidgetItem(text)
    side = Qt.AlignmentFlag.AlignRight if column in _NUMBERS else Qt.AlignmentFlag.AlignLeft
    cell.setTextAlignment(side | Qt.AlignmentFlag.AlignVCenter)
    return cell


def stages_text(run: RunRecord) -> str:
    """Return the names of the solved stages, separated by commas."""
    comma = QCoreApplication.translate("RunTable", ", ")
    return comma.join(term("stage", stage) for stage in run.stages)
