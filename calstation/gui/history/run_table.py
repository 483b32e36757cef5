"""Runs as rows: outcome, unit, time, operator, duration and stages."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from PySide6.QtCore import (
    QAbstractTableModel,
    QCoreApplication,
    QModelIndex,
    QPersistentModelIndex,
    Qt,
    Signal,
)
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableView

from calstation.gui.text import KINDS, duration_text, term
from calstation.gui.widgets import state_colour, state_icon, theme
from calstation.records import RunRecord

Index = QModelIndex | QPersistentModelIndex

#: Width that the stages need, px.
_STAGES = 30 * theme.GRID
#: Columns hidden first if the width is short: attempt, operator, product, which the details show as well.
_HIDDEN_FIRST = (4, 5, 3)
_OUTCOME, _STARTED = 0, 2


@dataclass(frozen=True)
class _Column:
    heading: Callable[[], str]
    text: Callable[[RunRecord], str]
    number: bool = False

    @property
    def alignment(self) -> Qt.AlignmentFlag:
        """Numbers to the right, words to the left."""
        side = Qt.AlignmentFlag.AlignRight if self.number else Qt.AlignmentFlag.AlignLeft
        return side | Qt.AlignmentFlag.AlignVCenter


class RunModel(QAbstractTableModel):
    """The runs found, the latest first."""

    def __init__(self) -> None:
        super().__init__()
        self.runs: tuple[RunRecord, ...] = ()
        self._columns = (
            _Column(lambda: self.tr("Outcome"), lambda run: term("badge", run.outcome)),
            _Column(lambda: self.tr("Serial number"), lambda run: run.serial),
            _Column(lambda: self.tr("Started"), lambda run: local_time(run.started_utc)),
            _Column(lambda: self.tr("Product"), lambda run: run.product or ""),
            _Column(lambda: self.tr("Attempt"), lambda run: str(run.attempt), number=True),
            _Column(lambda: self.tr("Operator"), lambda run: run.operator or ""),
            _Column(lambda: self.tr("Duration"), lambda run: duration_text(run.duration), number=True),
            _Column(lambda: self.tr("Stages"), lambda run: stages_text(run)),
        )

    def set_runs(self, runs: Sequence[RunRecord]) -> None:
        """Show these runs."""
        self.beginResetModel()
        self.runs = tuple(runs)
        self.endResetModel()

    def rowCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008 - Qt's own signature
        """Number of runs."""
        return 0 if parent.isValid() else len(self.runs)

    def columnCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008
        """Number of columns."""
        return 0 if parent.isValid() else len(self._columns)

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        """A cell; the outcome with its shape, the time with UTC as its tooltip."""
        run, column = self.runs[index.row()], self._columns[index.column()]
        if role == Qt.ItemDataRole.DisplayRole:
            return column.text(run)
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return column.alignment
        if role == Qt.ItemDataRole.ToolTipRole:
            return utc_text(run.started_utc) if index.column() == _STARTED else column.text(run)
        if index.column() == _OUTCOME:
            kind = KINDS.get(run.outcome, "none")
            if role == Qt.ItemDataRole.DecorationRole:
                return state_icon(kind)
            if role == Qt.ItemDataRole.ForegroundRole:
                return state_colour(kind)
        return None

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        """Headings along the top."""
        if orientation == Qt.Orientation.Vertical:
            return None
        column = self._columns[section]
        if role == Qt.ItemDataRole.DisplayRole:
            return column.heading()
        return column.alignment if role == Qt.ItemDataRole.TextAlignmentRole else None


class RunTable(QTableView):
    """Shows a `RunModel`; emits `selected(run)`, None if there is no run."""

    selected = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self.runs = RunModel()
        self.setModel(self.runs)
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
        self.runs.modelReset.connect(self._share_width)
        self.selectionModel().currentRowChanged.connect(self._row_changed)

    @property
    def run(self) -> RunRecord | None:
        """The run selected."""
        number = self.currentIndex().row()
        return self.runs.runs[number] if 0 <= number < len(self.runs.runs) else None

    def show_runs(self, runs: Sequence[RunRecord]) -> None:
        """Show these runs; the selected one stays selected if it is among them, else the latest is."""
        log = self.run.log if self.run is not None else None
        self.runs.set_runs(runs)
        if runs:
            self.selectRow(next((i for i, run in enumerate(runs) if run.log == log), 0))
        else:
            self.selected.emit(None)

    def refresh(self) -> None:
        """Show the texts of all cells again."""
        if self.runs.runs:
            self.show_runs(self.runs.runs)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Share another width."""
        super().resizeEvent(event)
        if event.size().width() != event.oldSize().width():
            self._share_width()

    def _share_width(self) -> None:
        """Fit columns to their contents; the stages take the rest, and some columns are hidden for them."""
        last = self.runs.columnCount() - 1
        for column in range(last):
            self.setColumnHidden(column, False)
        self.resizeColumnsToContents()
        for column in range(last):
            self.setColumnWidth(column, self.columnWidth(column) + 2 * theme.GRID)
        left = self.viewport().width() - sum(self.columnWidth(column) for column in range(last))
        for column in _HIDDEN_FIRST:
            if left >= _STAGES:
                break
            left += self.columnWidth(column)
            self.setColumnHidden(column, True)
        self.setColumnWidth(last, max(left, 10 * theme.GRID))

    def _row_changed(self, current: QModelIndex) -> None:
        if current.isValid():
            self.selected.emit(self.run)


def local_time(started_utc: str) -> str:
    """A time in this computer's time zone; unchanged if it is not ISO 8601."""
    try:
        return f"{datetime.fromisoformat(started_utc).astimezone():%Y-%m-%d %H:%M}"
    except ValueError:
        return started_utc


def utc_text(started_utc: str) -> str:
    """A time in UTC, to the second."""
    try:
        return f"{datetime.fromisoformat(started_utc):%Y-%m-%d %H:%M:%S} UTC"
    except ValueError:
        return started_utc


def stages_text(run: RunRecord) -> str:
    """The stages that were solved."""
    comma = QCoreApplication.translate("RunModel", ", ")
    return comma.join(term("stage", stage) for stage in run.stages)
