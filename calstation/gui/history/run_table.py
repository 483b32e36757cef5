"""The table of runs: outcome, unit, time, operator, duration, station, slot, batch and stages."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from PySide6.QtCore import (
    QAbstractTableModel,
    QItemSelection,
    QItemSelectionModel,
    QModelIndex,
    QPersistentModelIndex,
    Qt,
    QTimer,
    Signal,
)
from PySide6.QtGui import QColor, QIcon, QResizeEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableView

from calstation.gui.text import KINDS, duration_text, on_language_change, product_text, say, term
from calstation.gui.widgets import plain_tip, state_colour, state_icon, theme
from calstation.messages import local_time
from calstation.records import LATEST_FIRST, RunOrder, RunRecord
from calstation.results import lacks_log, run_outcome


@dataclass(frozen=True)
class _Column:
    """A column: its heading, the field of a run by which it is sorted, and its text."""

    heading: str
    field: str
    text: Callable[[RunRecord], str]


_COLUMNS = (
    _Column("history.outcome", "verdict", lambda run: run_text(run)),
    _Column("common.serial_number", "serial", lambda run: run.serial),
    _Column("common.started", "started_utc", lambda run: local_time(run.started_utc)),
    _Column("common.product", "product", lambda run: product_text(run.product or "")),
    _Column("common.operator", "operator", lambda run: run.operator or ""),
    _Column("history.attempt", "attempt", lambda run: str(run.attempt)),
    _Column("history.duration", "duration", lambda run: duration_text(run.duration)),
    _Column("common.station", "station", lambda run: run.station or ""),
    _Column("history.slot", "slot", lambda run: run.slot or ""),
    _Column("history.batch", "batch", lambda run: run.batch or ""),
    _Column("common.stages", "stages", lambda run: stages_text(run)),
)
_OUTCOME, _STARTED, _PRODUCT, _OPERATOR, _ATTEMPT, _DURATION, _STATION, _SLOT, _BATCH, _STAGES = 0, *range(2, 11)
#: Columns that are hidden after the stages if the table is narrow; the details also show their values.
_HIDDEN_NEXT = (_DURATION, _ATTEMPT)
#: Columns of numbers, which are right-aligned.
_NUMBERS = (_ATTEMPT, _DURATION)
#: Columns whose texts are elided if the table is still too wide, and their smallest width, px.
_ELIDED, _MIN_WIDTH = (_BATCH, _OPERATOR, _PRODUCT), 10 * theme.GRID


Index = QModelIndex | QPersistentModelIndex

#: Number of runs that are read at once.
_PART = 100

#: Function that returns runs, given their maximum number, the index of the first one, and their order.
ReadRuns = Callable[[int, int, RunOrder], Sequence[RunRecord]]


def _text(run: RunRecord, column: int) -> str:
    return _COLUMNS[column].text(run)


def _tip(run: RunRecord, column: int) -> str:
    return plain_tip(local_time(run.started_utc, zone=True) if column == _STARTED else _text(run, column))


def _icon(run: RunRecord, column: int) -> QIcon | None:
    return state_icon(outcome_kind(run)) if column == _OUTCOME else None


def _colour(run: RunRecord, column: int) -> QColor | None:
    return state_colour(outcome_kind(run)) if column == _OUTCOME else None


def _alignment(column: int) -> Qt.AlignmentFlag:
    side = Qt.AlignmentFlag.AlignRight if column in _NUMBERS else Qt.AlignmentFlag.AlignLeft
    return side | Qt.AlignmentFlag.AlignVCenter


#: Content of a cell by its role.
_CELLS: dict[int, Callable[[RunRecord, int], Any]] = {
    Qt.ItemDataRole.DisplayRole: _text,
    Qt.ItemDataRole.ToolTipRole: _tip,
    Qt.ItemDataRole.TextAlignmentRole: lambda _, column: _alignment(column),
    Qt.ItemDataRole.DecorationRole: _icon,
    Qt.ItemDataRole.ForegroundRole: _colour,
}


class _RunModel(QAbstractTableModel):
    """The runs that match the filters, which are read in parts while the table is scrolled."""

    def __init__(self) -> None:
        super().__init__()
        self.runs: list[RunRecord] = []
        self.order = LATEST_FIRST
        self._read: ReadRuns = lambda *_: ()
        self._count = 0

    def show_runs(self, read: ReadRuns, count: int) -> None:
        """Show `count` runs; read as many as before, but at least one and at most three parts."""
        self._reset(read, count, min(max(len(self.runs), _PART), 3 * _PART))

    def read_again(self, read: ReadRuns, count: int) -> None:
        """Show `count` runs; read one part more than before."""
        self._reset(read, count, len(self.runs) + _PART)

    def _reset(self, read: ReadRuns, count: int, limit: int) -> None:
        self.beginResetModel()
        self._read, self._count = read, count
        self.runs = list(read(limit, 0, self.order)) if count else []
        self.endResetModel()

    def sort_by(self, column: int) -> None:
        """Sort all runs by a column, in descending order if they are already sorted by it."""
        field = _COLUMNS[column].field
        self.order = RunOrder(field, descending=self.order == RunOrder(field))
        self.show_runs(self._read, self._count)

    def canFetchMore(self, parent: Index = QModelIndex()) -> bool:  # noqa: B008 - Qt's own signature
        """Return whether runs have not been read yet."""
        return not parent.isValid() and len(self.runs) < self._count

    def fetchMore(self, parent: Index = QModelIndex()) -> None:  # noqa: B008
        """Read the next part."""
        runs = self._read(_PART, len(self.runs), self.order)
        if not runs:  # some have been removed in the meantime
            self._count = len(self.runs)
            return
        self.beginInsertRows(QModelIndex(), len(self.runs), len(self.runs) + len(runs) - 1)
        self.runs += runs
        self.endInsertRows()

    def rowCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008
        """Return the number of runs that have been read."""
        return 0 if parent.isValid() else len(self.runs)

    def columnCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008
        """Return the number of columns."""
        return 0 if parent.isValid() else len(_COLUMNS)

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        """Return the text, alignment, colour, icon or tooltip of a cell."""
        cell = _CELLS.get(role)  # Qt asks for many other roles of every cell
        return None if cell is None else cell(self.runs[index.row()], index.column())

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        """Return the heading of a column, with an arrow if the runs are sorted by it."""
        if orientation == Qt.Orientation.Vertical:
            return None
        arrow = ("  ▲", "  ▼")[self.order.descending] if _COLUMNS[section].field == self.order.field else ""
        match role:
            case Qt.ItemDataRole.DisplayRole:
                return say(_COLUMNS[section].heading) + arrow
            case Qt.ItemDataRole.ToolTipRole:
                return say("history.sort_tip")
            case Qt.ItemDataRole.TextAlignmentRole:
                return _alignment(section)
        return None


class RunTable(QTableView):
    """A table of runs, which emits `selected(run)`, with None for no run, and `selection_changed()`.

    The latest run is first. A click on a heading sorts the runs by that column; another click reverses the order.
    """

    selected = Signal(object)
    selection_changed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._model = _RunModel()
        self.setModel(self._model)
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
        self._current_timer = QTimer(self, singleShot=True, interval=0)
        self._current_timer.timeout.connect(self._select_current)
        self.selectionModel().selectionChanged.connect(lambda *_: self._current_timer.start())
        on_language_change(self, self._refresh)

    @property
    def runs(self) -> list[RunRecord]:
        """The runs in the order of the rows, as far as they have been read."""
        return self._model.runs

    @property
    def run(self) -> RunRecord | None:
        """The current run, or None."""
        number = self.currentIndex().row()
        return self.runs[number] if 0 <= number < len(self.runs) else None

    @property
    def selected_runs(self) -> tuple[RunRecord, ...]:
        """All selected runs, the latest first."""
        runs = [self.runs[index.row()] for index in self.selectionModel().selectedRows()]
        return tuple(sorted(runs, key=lambda run: (run.started_utc, run.log.stem), reverse=True))

    def show_runs(self, read: ReadRuns, count: int, *, in_place: bool = False) -> None:
        """Show `count` runs, which `read` returns, and keep the selection or else select the first row.

        With `in_place`, all runs that were read are read again, and the scroll position is kept.
        """
        if not in_place:
            self._keep_selection(lambda: self._model.show_runs(read, count))
            return
        top = self.verticalScrollBar().value()
        self._keep_selection(lambda: self._model.read_again(read, count))
        self.verticalScrollBar().setValue(top)

    def _keep_selection(self, change: Callable[[], None]) -> None:
        """Change the rows, and select the same runs again or else the first row."""
        log = self.run.log if self.run is not None else None
        selected_logs = {run.log for run in self.selected_runs}
        change()
        self._share_width()
        if self.runs:
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

    def _sort_by(self, column: int) -> None:
        self._keep_selection(lambda: self._model.sort_by(column))

    def _refresh(self) -> None:
        """Show the words of the current language."""
        self._model.headerDataChanged.emit(Qt.Orientation.Horizontal, 0, _STAGES)
        self.viewport().update()
        self._share_width()

    def _share_width(self) -> None:
        """Fit the columns to their contents and the stages to the remaining width.

        In a narrow table, the stages are hidden, then duration and attempt, and batch, operator and product are elided.
        The station is shown only if there are runs of several stations, and batch and slot if there are batches.
        """
        hidden = {_STATION} if len({run.station for run in self.runs if run.station}) < 2 else set()
        if not any(run.batch for run in self.runs):
            hidden |= {_BATCH, _SLOT}
        for column in range(_STAGES + 1):
            self.setColumnHidden(column, column in hidden)
        self.resizeColumnsToContents()
        free = self.viewport().width() - sum(self.columnWidth(column) for column in range(_STAGES))
        minimum = 16 * theme.GRID
        self.setColumnHidden(_STAGES, free < minimum)
        self.setColumnWidth(_STAGES, max(free, minimum))
        for column in _HIDDEN_NEXT:
            if free >= 0:
                break
            free += self.columnWidth(column)
            self.setColumnHidden(column, True)
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

    def _select_current(self) -> None:
        """After a row has been deselected, make a selected row the current one, or select the current one again."""
        selection, flag = self.selectionModel(), QItemSelectionModel.SelectionFlag
        current, selected = selection.currentIndex(), selection.selectedRows(_OUTCOME)
        if not current.isValid() or selection.isRowSelected(current.row()):
            return
        if selected:
            selection.setCurrentIndex(selected[0], flag.NoUpdate)
        else:
            selection.select(current, flag.Select | flag.Rows)

    def _row_changed(self, current: QModelIndex) -> None:
        if current.isValid():
            self.selected.emit(self.run)


def stages_text(run: RunRecord) -> str:
    """Return the names of the solved stages, separated by commas."""
    return say("common.comma").join(term("stage", stage) for stage in run.stages)


def run_text(run: RunRecord) -> str:
    """Return the outcome of a run, such as ``FAIL (partial)``, and whether only its log is missing."""
    outcome = say(run_outcome(run))
    return say("history.outcome_without_log", outcome=outcome) if lacks_log(run) and not run.missing else outcome


def outcome_kind(run: RunRecord) -> str:
    """Return the badge shape of the outcome of a run; a PASS without a log has no tick, because nothing confirms it."""
    kind = KINDS.get(run.badge, "none")
    return "caution" if kind == "good" and lacks_log(run) else kind
