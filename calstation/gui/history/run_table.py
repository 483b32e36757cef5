"""The table of runs: outcome, unit, time, operator, duration, station, slot, batch and stages."""

from collections.abc import Callable, Sequence

from PySide6.QtCore import QItemSelection, QItemSelectionModel, QModelIndex, Qt, Signal
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableWidget, QTableWidgetItem

from calstation.gui.text import KINDS, duration_text, on_language_change, product_text, say, term
from calstation.gui.widgets import state_colour, state_icon, theme
from calstation.messages import local_time
from calstation.records import RunRecord

#: Heading and text of each column.
_COLUMNS: tuple[tuple[str, Callable[[RunRecord], str]], ...] = (
    ("history.outcome", lambda run: term("badge", run.badge)),
    ("common.serial_number", lambda run: run.serial),
    ("common.started", lambda run: local_time(run.started_utc)),
    ("common.product", lambda run: product_text(run.product or "")),
    ("history.attempt", lambda run: str(run.attempt)),
    ("common.operator", lambda run: run.operator or ""),
    ("history.duration", lambda run: duration_text(run.duration)),
    ("common.station", lambda run: run.station or ""),
    ("history.slot", lambda run: run.slot or ""),
    ("history.batch", lambda run: run.batch or ""),
    ("common.stages", lambda run: stages_text(run)),
)
_OUTCOME, _STARTED, _DURATION, _STATION, _SLOT, _BATCH, _STAGES = 0, 2, 6, 7, 8, 9, 10
#: Columns that are hidden first if the table is narrow: attempt, operator, product. The details also show them.
_HIDDEN_FIRST = (4, 5, 3)
#: Columns of numbers, which are right-aligned: attempt, duration.
_NUMBERS = (4, 6)


class RunTable(QTableWidget):
    """A table of runs, the latest first, which emits `selected(run)`, with None for no run, and `selection_changed`."""

    selected = Signal(object)
    selection_changed = Signal()

    def __init__(self) -> None:
        super().__init__(0, _STAGES + 1)
        self.runs: tuple[RunRecord, ...] = ()
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
        return tuple(self.runs[number] for number in sorted({index.row() for index in self.selectedIndexes()}))

    def show_runs(self, runs: Sequence[RunRecord]) -> None:
        """Show these runs, and keep the selection or, if that is not possible, select the latest run."""
        log = self.run.log if self.run is not None else None
        selected_logs = {run.log for run in self.selected_runs}
        self.setRowCount(0)
        self.runs = tuple(runs)
        self.setRowCount(len(runs))
        self._fill_rows()
        self._share_width()
        if runs:
            self._select(
                next((i for i, run in enumerate(runs) if run.log == log), 0),
                [i for i, run in enumerate(runs) if run.log in selected_logs],
            )
        else:
            self.selected.emit(None)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Distribute the new width among the columns."""
        super().resizeEvent(event)
        if event.size().width() != event.oldSize().width():
            self._share_width()

    def _fill_rows(self) -> None:
        for number, run in enumerate(self.runs):
            cells = [_cell(text(run), column) for column, (_, text) in enumerate(_COLUMNS)]
            kind = KINDS.get(run.verdict, "none")
            cells[_OUTCOME].setIcon(state_icon(kind))
            cells[_OUTCOME].setForeground(state_colour(kind))
            for column, cell in enumerate(cells):
                cell.setToolTip(local_time(run.started_utc, zone=True) if column == _STARTED else cell.text())
                self.setItem(number, column, cell)

    def _refresh(self) -> None:
        for column, (code, _) in enumerate(_COLUMNS):
            self.setHorizontalHeaderItem(column, _cell(say(code), column))
        if self.runs:
            self.show_runs(self.runs)

    def _share_width(self) -> None:
        """Fit the columns to their contents and the stages to the remaining width; hide columns in a narrow table.

        The station is shown only if there are runs of several stations. Batch and slot are shown only if there are runs
        in batches; duration and stages are then hidden first.
        """
        hidden = {_STATION} if len({run.station for run in self.runs if run.station}) < 2 else set()
        batches = any(run.batch for run in self.runs)
        if not batches:
            hidden |= {_BATCH, _SLOT}
        for column in range(_STAGES + 1):
            self.setColumnHidden(column, column in hidden)
        self.resizeColumnsToContents()
        for column in range(_STAGES):
            self.setColumnWidth(column, self.columnWidth(column) + 2 * theme.GRID)
        free = self.viewport().width() - sum(self.columnWidth(column) for column in range(_STAGES))
        for column in (*_HIDDEN_FIRST, *([_DURATION] if batches else [])):
            if free >= 30 * theme.GRID:  # the stages fit
                break
            free += self.columnWidth(column)
            self.setColumnHidden(column, True)
        minimum = 10 * theme.GRID
        self.setColumnHidden(_STAGES, batches and free < minimum)
        self.setColumnWidth(_STAGES, max(free, minimum))

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
