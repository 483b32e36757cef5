"""The table of runs: outcome, unit, time, operator, duration, station, slot, batch and stages."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from PySide6.QtCore import QItemSelection, QItemSelectionModel, QModelIndex, Qt, Signal
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableWidget, QTableWidgetItem

from calstation.gui.text import KINDS, duration_text, on_language_change, product_text, say, term
from calstation.gui.widgets import plain_tip, state_colour, state_icon, theme
from calstation.messages import local_time
from calstation.records import RunRecord


@dataclass(frozen=True)
class _Column:
    """A column: its heading, its text, and the value of a number or time, by which runs are sorted."""

    heading: str
    text: Callable[[RunRecord], str]
    value: Callable[[RunRecord], float | str] | None = None

    def key(self, run: RunRecord) -> list[float | str]:
        """Return the key for sorting, in which the numbers within a text count as numbers."""
        if self.value is not None:
            return [self.value(run)]
        parts = re.split(r"(\d+)", self.text(run).casefold())  # every second part is a number
        return [int(part) if number % 2 else part for number, part in enumerate(parts)]


_COLUMNS = (
    _Column("history.outcome", lambda run: term("badge", run.badge)),
    _Column("common.serial_number", lambda run: run.serial),
    _Column("common.started", lambda run: local_time(run.started_utc), lambda run: run.started_utc),
    _Column("common.product", lambda run: product_text(run.product or "")),
    _Column("common.operator", lambda run: run.operator or ""),
    _Column("history.attempt", lambda run: str(run.attempt), lambda run: run.attempt),
    _Column("history.duration", lambda run: duration_text(run.duration), lambda run: run.duration),
    _Column("common.station", lambda run: run.station or ""),
    _Column("history.slot", lambda run: run.slot or ""),
    _Column("history.batch", lambda run: run.batch or ""),
    _Column("common.stages", lambda run: stages_text(run)),
)
_OUTCOME, _STARTED, _PRODUCT, _OPERATOR, _ATTEMPT, _DURATION, _STATION, _SLOT, _BATCH, _STAGES = 0, *range(2, 11)
#: Columns that are hidden first if the table is narrow, to make space for the stages. The details also show them.
_HIDDEN_FIRST = (_ATTEMPT, _DURATION)
#: Columns of numbers, which are right-aligned.
_NUMBERS = (_ATTEMPT, _DURATION)
#: Columns whose texts are elided if the table is still too wide, and their smallest width, px.
_ELIDED, _MIN_WIDTH = (_BATCH, _OPERATOR, _PRODUCT), 9 * theme.GRID


class RunTable(QTableWidget):
    """A table of runs, which emits `selected(run)`, with None for no run, and `selection_changed`.

    The latest run is first until a click on a heading sorts the runs by this column, and another one reverses them.
    """

    selected = Signal(object)
    selection_changed = Signal()

    def __init__(self) -> None:
        super().__init__(0, _STAGES + 1)
        #: The runs in the order of the rows.
        self.runs: tuple[RunRecord, ...] = ()
        self._latest_first: tuple[RunRecord, ...] = ()
        #: The column by which the runs are sorted, and whether the largest value is first.
        self._sort_column, self._descending = _STARTED, True
        self.setObjectName("history_table")
        self.setFont(theme.font())
        self.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
        self.setAlternatingRowColors(True)
        self.setShowGrid(False)
        self.setTabKeyNavigation(False)
        self.setWordWrap(False)
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(theme.BUTTON)
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        header.setSectionsClickable(True)
        for selecting in (header.sectionPressed, header.sectionEntered):
            selecting.disconnect()  # a click on a heading selects no runs
        header.sectionClicked.connect(self._sort_by)
        header.setSectionResizeMode(QHeaderView.ResizeMode.Fixed)
        header.setStretchLastSection(True)
        header.setResizeContentsPrecision(0)  # only visible rows determine the widths of the columns
        self.selectionModel().currentRowChanged.connect(self._row_changed)
        self.selectionModel().selectionChanged.connect(lambda *_: self.selection_changed.emit())
        theme.themes.changed.connect(self._fill_rows)
        on_language_change(self, self._refresh)

    @property
    def run(self) -> RunRecord | None:
        """The current run, or None."""
        number = self.currentRow()
        return self.runs[number] if 0 <= number < len(self.runs) else None

    @property
    def selected_runs(self) -> tuple[RunRecord, ...]:
        """All selected runs, the latest first."""
        selected = {self.runs[index.row()].log for index in self.selectedIndexes()}
        return tuple(run for run in self._latest_first if run.log in selected)

    def show_runs(self, runs: Sequence[RunRecord]) -> None:
        """Show these runs, given with the latest first, and keep the selection or else select the first row."""
        log = self.run.log if self.run is not None else None
        selected_logs = {run.log for run in self.selected_runs}
        self.setRowCount(0)
        self._latest_first, self.runs = tuple(runs), self._sorted(runs)
        self.setRowCount(len(runs))
        self._fill_rows()
        self._share_width()
        if runs:
            self._select(
                next((i for i, run in enumerate(self.runs) if run.log == log), 0),
                [i for i, run in enumerate(self.runs) if run.log in selected_logs],
            )
        else:
            self.selected.emit(None)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Distribute the new width among the columns."""
        super().resizeEvent(event)
        if event.size().width() != event.oldSize().width():
            self._share_width()

    def _sorted(self, runs: Sequence[RunRecord]) -> tuple[RunRecord, ...]:
        """Return sorted runs; equal ones remain in their order."""
        return tuple(sorted(runs, key=_COLUMNS[self._sort_column].key, reverse=self._descending))

    def _sort_by(self, column: int) -> None:
        self._descending = column == self._sort_column and not self._descending
        self._sort_column = column
        self._refresh()

    def _fill_rows(self) -> None:
        for number, run in enumerate(self.runs):
            cells = [_cell(each.text(run), column) for column, each in enumerate(_COLUMNS)]
            kind = KINDS.get(run.verdict, "none")
            cells[_OUTCOME].setIcon(state_icon(kind))
            cells[_OUTCOME].setForeground(state_colour(kind))
            for column, cell in enumerate(cells):
                cell.setToolTip(
                    plain_tip(local_time(run.started_utc, zone=True) if column == _STARTED else cell.text())
                )
                self.setItem(number, column, cell)

    def _refresh(self) -> None:
        for column, each in enumerate(_COLUMNS):
            arrow = ("  ▲", "  ▼")[self._descending] if column == self._sort_column else ""
            heading = _cell(say(each.heading) + arrow, column)
            heading.setToolTip(say("history.sort_tip"))
            self.setHorizontalHeaderItem(column, heading)
        if self.runs:
            self.show_runs(self._latest_first)

    def _share_width(self) -> None:
        """Fit the columns to their contents and the stages to the remaining width.

        In a narrow table, attempt and duration are hidden, then the stages, and batch, operator and product are elided.
        The station is shown only if there are runs of several stations, and batch and slot if there are batches.
        """
        hidden = {_STATION} if len({run.station for run in self.runs if run.station}) < 2 else set()
        if not any(run.batch for run in self.runs):
            hidden |= {_BATCH, _SLOT}
        for column in range(_STAGES + 1):
            self.setColumnHidden(column, column in hidden)
        self.resizeColumnsToContents()
        for column in range(_STAGES):
            self.setColumnWidth(column, self.columnWidth(column) + 2 * theme.GRID)
        free = self.viewport().width() - sum(self.columnWidth(column) for column in range(_STAGES))
        for column in _HIDDEN_FIRST:
            if free >= 30 * theme.GRID:  # the stages fit
                break
            free += self.columnWidth(column)
            self.setColumnHidden(column, True)
        minimum = 16 * theme.GRID
        self.setColumnHidden(_STAGES, free < minimum)
        self.setColumnWidth(_STAGES, max(free, minimum))
        for column in _ELIDED:
            width = self.columnWidth(column)
            narrow = min(width, max(width + free, _MIN_WIDTH))
            self.setColumnWidth(column, narrow)
            free += width - narrow

    def _select(self, current: int, rows: Sequence[int]) -> None:
        """Make a row the current row, and select `rows`, by default this row, regardless of pressed keys."""
        model, selected, flag = self.model(), QItemSelection(), QItemSelectionModel.SelectionFlag
        for number in rows or (current,):
            selected.select(model.index(number, 0), model.index(number, _STAGES))
        self.selectionModel().setCurrentIndex(model.index(current, _OUTCOME), flag.NoUpdate)
        self.selectionModel().select(selected, flag.ClearAndSelect)

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
    return say("common.comma").join(term("stage", stage) for stage in run.stages)
