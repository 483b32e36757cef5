"""Tables with one parameter per row: a model that is defined by its columns, and views that can be copied and saved."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, QRect, QSize, Qt
from PySide6.QtGui import (
    QColor,
    QContextMenuEvent,
    QFontMetrics,
    QGuiApplication,
    QKeyEvent,
    QKeySequence,
    QPainter,
    QResizeEvent,
    QShowEvent,
)
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QMenu, QStyleOptionHeader, QTableView, QWidget

from calstation.escaping import for_csv
from calstation.gui.text import Words, about, bind, parameter_text, say, with_minus, without_minus
from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import state_colour, state_icon
from calstation.gui.widgets.file_dialog import ask_file, proposed_file
from calstation.physics import INDEX, NAMES, aligned

Index = QModelIndex | QPersistentModelIndex

#: Minimum width of a column of elided texts and of an elided heading, px.
_MIN_WIDTH, _MIN_HEADING = 15 * theme.GRID, 7 * theme.GRID

#: Height of a row, px.
ROW = 26

#: Number of sigmas above which a difference is highlighted.
NOTABLE_SIGMAS = 3.0


@dataclass(frozen=True)
class Column:
    """A column of a parameter table; its functions are called with the name of a parameter."""

    heading: Words
    text: Callable[[str], str]
    number: bool = True  #: Whether cells are right-aligned.
    state: Callable[[str], str | None] | None = None  #: Symbol before the text, one of `badge.KINDS` or None.
    hint: Callable[[str], str] | None = None  #: Tooltip.

    @property
    def alignment(self) -> Qt.AlignmentFlag:
        """Alignment of heading and cells."""
        side = Qt.AlignmentFlag.AlignRight if self.number else Qt.AlignmentFlag.AlignLeft
        return side | Qt.AlignmentFlag.AlignVCenter


def ordered(parameters: Iterable[str]) -> list[str]:
    """Return parameters in the order of the contract, followed by parameters that are not in the contract."""
    names = list(parameters)
    return [*(name for name in NAMES if name in names), *(name for name in names if name not in INDEX)]


def align_columns(cells: Mapping[str, dict[str, str]], columns: Iterable[str]) -> None:
    """Align the decimal points of numeric columns in place; `cells` maps rows to columns and may be incomplete."""
    for column in columns:
        rows = [row for row in cells.values() if column in row]
        for row, text in zip(rows, aligned([row[column] for row in rows]), strict=True):
            row[column] = text


class ParameterModel(QAbstractTableModel):
    """A table model with a row for each parameter; the vertical header contains the names as in files.

    The accessible text of a name is its display name, which `NameHeader` draws. If `grouped`, every second group of
    parameters is shaded.
    """

    def __init__(self, columns: Sequence[Column], *, grouped: bool = True) -> None:
        super().__init__()
        self._grouped = grouped
        self.columns = tuple(columns)
        self._names: tuple[str, ...] = ()
        self._shaded: tuple[bool, ...] = ()

    def show(self, columns: Sequence[Column], names: Sequence[str]) -> None:
        """Show these columns of these parameters."""
        self.beginResetModel()
        self.columns = tuple(columns)
        self._names = tuple(names)
        groups = [name.rpartition("_")[0] for name in self._names]
        order = list(dict.fromkeys(groups))
        self._shaded = tuple(self._grouped and order.index(group) % 2 == 1 for group in groups)
        self.endResetModel()

    def lines(self, rows: Iterable[int]) -> list[list[str]]:
        """Return the headings and rows for a spreadsheet, with the parameter names in the first column."""
        lines = [["parameter", *(say(column.heading) for column in self.columns)]]
        for name in (self._names[row] for row in rows):
            lines.append([name, *(without_minus(column.text(name)).strip() for column in self.columns)])
        return lines

    def refresh(self) -> None:
        """Update all cells and headings."""
        if self._names:
            last = self.index(len(self._names) - 1, len(self.columns) - 1)
            self.dataChanged.emit(self.index(0, 0), last)
        self.headerDataChanged.emit(Qt.Orientation.Vertical, 0, max(0, len(self._names) - 1))
        self.headerDataChanged.emit(Qt.Orientation.Horizontal, 0, max(0, len(self.columns) - 1))

    def rowCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008 - Qt's own signature
        """Return the number of parameters."""
        return 0 if parent.isValid() else len(self._names)

    def columnCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008
        """Return the number of columns."""
        return 0 if parent.isValid() else len(self.columns)

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        """Return the text, alignment, colour, icon or tooltip of a cell."""
        name, column = self._names[index.row()], self.columns[index.column()]
        match role:
            case Qt.ItemDataRole.DisplayRole:
                return with_minus(column.text(name)) if column.number else column.text(name)
            case Qt.ItemDataRole.TextAlignmentRole:
                return column.alignment
            case Qt.ItemDataRole.ToolTipRole if column.hint is not None:
                return column.hint(name)
            case Qt.ItemDataRole.BackgroundRole if self._shaded[index.row()]:
                return QColor(theme.colours().window)
        state = None if column.state is None else column.state(name)
        match role:
            case Qt.ItemDataRole.UserRole:
                return state or None
            case Qt.ItemDataRole.DecorationRole if state:
                return state_icon(state)
            case Qt.ItemDataRole.ForegroundRole if state:
                return state_colour(state)
        return None

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        """Return the parameter name of a row, or the heading of a column."""
        if orientation == Qt.Orientation.Vertical:
            name = self._names[section]
            if role == Qt.ItemDataRole.BackgroundRole:
                return QColor(theme.colours().window) if self._shaded[section] else None
            if role == Qt.ItemDataRole.AccessibleTextRole:
                return parameter_text(name)
            return name if role in (Qt.ItemDataRole.DisplayRole, Qt.ItemDataRole.ToolTipRole) else None
        heading = self.columns[section].heading
        if role == Qt.ItemDataRole.DisplayRole:
            return say(heading)
        if role == Qt.ItemDataRole.ToolTipRole:
            name = heading if isinstance(heading, str) else ""
            return about("column", name.rpartition(".")[2].removesuffix("_column")) or say(heading)
        return self.columns[section].alignment if role == Qt.ItemDataRole.TextAlignmentRole else None


class NameHeader(QHeaderView):
    """The display names of the rows, shaded like their rows, which a style sheet cannot do."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(Qt.Orientation.Vertical, parent)
        self.setSectionsClickable(True)
        self.setHighlightSections(True)

    def paintSection(self, painter: QPainter, rect: QRect, logicalIndex: int) -> None:
        """Draw the name of a row; that of a selected row is bold."""
        shade = self.model().headerData(logicalIndex, Qt.Orientation.Vertical, Qt.ItemDataRole.BackgroundRole)
        if shade is None:
            super().paintSection(painter, rect, logicalIndex)
            return
        painter.save()
        painter.fillRect(rect, shade)
        painter.setFont(theme.font(bold=self.selectionModel().rowIntersectsSelection(logicalIndex)))
        painter.setPen(QColor(theme.colours().text))
        inside = rect.adjusted(theme.GRID, 0, -theme.GRID, 0)
        text = painter.fontMetrics().elidedText(self._text(logicalIndex), Qt.TextElideMode.ElideRight, inside.width())
        painter.drawText(inside, self.defaultAlignment(), text)
        painter.restore()

    def initStyleOptionForIndex(self, option: QStyleOptionHeader, logicalIndex: int) -> None:
        """Set the display name as the text of a row that is not shaded."""
        super().initStyleOptionForIndex(option, logicalIndex)
        option.text = self._text(logicalIndex)

    def sectionSizeFromContents(self, logicalIndex: int) -> QSize:
        """Return the size for the display name instead of the name in files."""
        size, metrics = super().sectionSizeFromContents(logicalIndex), QFontMetrics(theme.font(bold=True))
        name = str(self.model().headerData(logicalIndex, Qt.Orientation.Vertical))
        longer = metrics.horizontalAdvance(self._text(logicalIndex)) - metrics.horizontalAdvance(name)
        return QSize(size.width() + longer, size.height())

    def _text(self, row: int) -> str:
        return str(self.model().headerData(row, Qt.Orientation.Vertical, Qt.ItemDataRole.AccessibleTextRole))


class ParameterTable(QTableView):
    """A view of a `ParameterModel`, whose rows can be copied as text, and which can be saved."""

    def __init__(self, model: ParameterModel, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.parameters = model
        self._menu = QMenu(self)
        self.setVerticalHeader(NameHeader(self))
        self.setModel(model)
        self.setFont(theme.font())
        self.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setShowGrid(False)
        self.setTabKeyNavigation(False)
        self.verticalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Fixed)
        self.verticalHeader().setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        self.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Fixed)
        self.horizontalHeader().setHighlightSections(False)
        self.horizontalHeader().setTextElideMode(Qt.TextElideMode.ElideRight)  # not cut at the left of a number
        model.modelReset.connect(self.fit_columns)
        model.headerDataChanged.connect(self.fit_columns)
        theme.on_appearance_change(self, model.refresh)

    def fit_columns(self) -> None:
        """Fit the columns to their contents, then distribute the free width or narrow the widest columns.

        A hidden table is fitted when it is shown.
        """
        if not self.isVisible():
            return
        self.resizeColumnsToContents()
        visible = [i for i in range(self.parameters.columnCount()) if not self.isColumnHidden(i)]
        free = self.viewport().width() - sum(map(self.columnWidth, visible))
        if visible and free > 0:
            share, remainder = divmod(free, len(visible))
            for k, i in enumerate(visible):
                self.setColumnWidth(i, self.columnWidth(i) + share + (k < remainder))
        elif visible:
            self._narrow(visible, -free)

    def _narrow(self, columns: Sequence[int], excess: int) -> None:
        """Narrow columns by `excess` px in total, the widest first; headings and texts are elided, but no numbers."""
        widths = {i: self.columnWidth(i) for i in columns}
        smallest = {i: self._smallest_width(i) for i in columns}
        while excess > 0 and (wide := [i for i in columns if widths[i] > smallest[i]]):
            widths[max(wide, key=widths.__getitem__)] -= 1
            excess -= 1
        for i, width in widths.items():
            self.setColumnWidth(i, width)

    def _smallest_width(self, index: int) -> int:
        """Return the minimum width of a column, px: that of its numbers or states, or that of an elided text."""
        column, header = self.parameters.columns[index], self.horizontalHeader()
        whole = column.number or column.state is not None
        elided = header.textElideMode() != Qt.TextElideMode.ElideNone
        heading = _MIN_HEADING if elided else header.sectionSizeFromContents(index).width()
        return max(self.sizeHintForColumn(index), heading) if whole else max(_MIN_WIDTH, heading)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fit the columns to the new width."""
        super().resizeEvent(event)
        self.fit_columns()

    def showEvent(self, event: QShowEvent) -> None:
        """Fit the columns to the contents and the width at this time."""
        super().showEvent(event)
        self.fit_columns()

    def copy(self) -> None:
        """Copy the selected rows, or all if none is selected, as tab-separated text."""
        rows = sorted({index.row() for index in self.selectionModel().selectedIndexes()})
        lines = self.parameters.lines(rows or range(self.parameters.rowCount()))
        QGuiApplication.clipboard().setText("".join("\t".join(line) + "\n" for line in lines))

    def contextMenuEvent(self, event: QContextMenuEvent) -> None:
        """Offer to copy or save the table."""
        self._menu.clear()
        self._menu.addAction(say("common.copy"), self.copy)
        self._menu.addAction(say("common.save_csv"), self._ask_file)
        self._menu.popup(event.globalPos())

    def _ask_file(self) -> None:
        ask_file(self, say("common.save_table"), proposed_file(self, "table.csv"), ["CSV (*.csv)"], self._save)

    def _save(self, target: Path) -> None:
        with target.open("w", encoding="utf-8-sig", newline="") as file:
            file.write(for_csv(self.parameters.lines(range(self.parameters.rowCount()))))

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Copy rows on Ctrl+C."""
        if event.matches(QKeySequence.StandardKey.Copy):
            self.copy()
            return
        super().keyPressEvent(event)


@dataclass(frozen=True)
class Cell:
    """A column of a `CellTable`: its heading, and the keys of its texts, symbols and tooltips ("" for none)."""

    heading: Words
    key: str
    number: bool = True
    state: str = ""
    hint: str = ""


class CellTable(ParameterTable):
    """A table of texts by row name and column key, in which a missing text is shown as a dash.

    Parameters
    ----------
    name, words
        Object name and accessible name.
    columns
        The columns, which `show_cells` may replace.
    grouped
        Whether every second group of parameters is shaded.
    named
        Whether the names of the rows are shown.
    single
        Whether only one row can be selected.
    row
        Height of a row, px.
    """

    def __init__(
        self,
        name: str,
        words: Words = "",
        columns: Sequence[Cell] = (),
        *,
        grouped: bool = False,
        named: bool = True,
        single: bool = False,
        row: int = ROW,
    ) -> None:
        self.cells: dict[str, dict[str, str]] = {}
        super().__init__(ParameterModel(self._columns_of(columns), grouped=grouped))
        self.setObjectName(name)
        bind(self.setAccessibleName, words)
        self.verticalHeader().setVisible(named)
        self.verticalHeader().setDefaultSectionSize(row)
        if single:
            self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)

    def show_cells(
        self, cells: Mapping[str, dict[str, str]], numbers: Iterable[str] = (), columns: Sequence[Cell] = ()
    ) -> None:
        """Show these rows, in other `columns` if given, and align the columns `numbers` at the decimal point."""
        self.cells = dict(cells)
        align_columns(self.cells, numbers)
        self.parameters.show(self._columns_of(columns) or self.parameters.columns, list(self.cells))

    @property
    def current_name(self) -> str:
        """Name of the current row, or ""."""
        return dict(enumerate(self.cells)).get(self.currentIndex().row(), "")

    def _columns_of(self, columns: Sequence[Cell]) -> list[Column]:
        def text(key: str, default: str) -> Callable[[str], str]:
            return lambda name: self.cells[name].get(key, default)

        return [
            Column(
                each.heading,
                text(each.key, "–"),
                each.number,
                text(each.state, "") if each.state else None,
                text(each.hint, "") if each.hint else None,
            )
            for each in columns
        ]
