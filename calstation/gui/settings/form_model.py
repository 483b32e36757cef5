"""The table model of a form: values, defaults and problems of a draft, in display units."""

from collections.abc import Iterable
from functools import partial
from typing import Any

from PySide6.QtCore import QModelIndex, QPersistentModelIndex, Qt
from PySide6.QtGui import QColor

from calstation.config import Form, FormCell, FormColumn, FormRow, cells_with_problem
from calstation.gui.settings.drafts import Draft
from calstation.gui.text import parameter_text, say, term, with_minus
from calstation.gui.widgets import Column, ParameterModel, align_columns, problem_text, theme
from calstation.messages import known
from calstation.schema import Problem

Index = QModelIndex | QPersistentModelIndex


class FormModel(ParameterModel):
    """The rows and columns of a form, with the values, defaults and problems of a draft."""

    def __init__(self, form: Form) -> None:
        super().__init__((), grouped=False)
        self.form = form
        self.draft: Draft | None = None
        #: Reason why values cannot be changed, "" if they can.
        self.locked = ""
        self.rows: list[FormRow] = []
        self._form_columns: list[FormColumn] = []
        self._texts: dict[str, dict[str, str]] = {}
        self._problems: dict[FormCell, Problem] = {}

    def show_draft(self, draft: Draft) -> None:
        """Show the values of a draft."""
        rows, columns = self.form.rows(draft.value), self.form.columns(draft.value)
        names = [each.name for each in rows]
        reshaped = (
            draft is not self.draft or columns != self._form_columns or names != [each.name for each in self.rows]
        )
        if reshaped:
            self.set_names(())
        self.draft, self.rows, self._form_columns = draft, rows, columns
        self._problems = {}
        for problem in draft.problems:
            for cell in cells_with_problem(rows, problem):
                self._problems.setdefault(cell, problem)
        self._write_texts()
        if reshaped:
            self.show([self._column(i, each) for i, each in enumerate(columns)], names)
        self.refresh()

    def cell(self, index: Index) -> FormCell | str:
        """Return the cell at an index, or its text if it cannot be changed."""
        return self.rows[index.row()].cells[index.column()]

    def index_of(self, cell: FormCell) -> QModelIndex:
        """Return the index of a cell."""
        number = next(i for i, each in enumerate(self.rows) if cell in each.cells)
        return self.index(number, self.rows[number].cells.index(cell))

    def describe(self, problem: Problem) -> str:
        """Return the sentence of a problem with its row and column names, "" if it does not belong to this form."""
        cells = cells_with_problem(self.rows, problem)
        if not cells:
            return ""
        index = self.index_of(cells[0])
        heading = self._heading(self._form_columns[index.column()]) if len(cells) == 1 else ""
        name, unit = self._title(self.rows[index.row()].name), cells[0].unit[0]
        name = say("form.row", number=name) if self.form.names == "number" else name
        name = say("form.cell", row=name, column=heading) if heading else name
        name = say("form.in_unit", name=name, unit=unit) if unit else name
        what = problem_text(cells[0].in_display_unit(problem))
        return say("form.problem", name=f"{name[0].upper()}{name[1:]}", what=what)

    def lines(self, rows: Iterable[int]) -> list[list[str]]:
        """Return headings and rows in the format of a spreadsheet."""
        lines = super().lines(rows)
        lines[0][0] = self.form.names
        return lines

    def flags(self, index: Index) -> Qt.ItemFlag:
        """Return the flags of a cell, which depend on whether it can be changed."""
        flags = super().flags(index)
        can_change = not self.locked and isinstance(self.cell(index), FormCell)
        return flags | Qt.ItemFlag.ItemIsEditable if can_change else flags

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        """Return the text, the value to edit, or the appearance of a cell; defaults are grey."""
        cell = self.cell(index)
        assert self.draft is not None
        if role == Qt.ItemDataRole.EditRole and isinstance(cell, FormCell):
            return cell.shown(self.draft.value)
        if role == Qt.ItemDataRole.ForegroundRole and cell not in self._problems:
            stated = isinstance(cell, FormCell) and cell.stated(self.draft.value)
            return None if stated else QColor(theme.colours().muted)
        return super().data(index, role)

    def setData(self, index: Index, value: Any, role: int = Qt.ItemDataRole.EditRole) -> bool:
        """Write a text or choice into the draft."""
        cell = self.cell(index)
        assert self.draft is not None
        assert isinstance(cell, FormCell)
        changes = cell.changes(self.draft.value, value)
        if changes:
            self.draft.set(changes)
        return bool(changes)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        """Return the name of a row, or the heading of a column with its explanation."""
        if orientation == Qt.Orientation.Vertical and role == Qt.ItemDataRole.DisplayRole:
            return self._title(self.rows[section].name)
        if orientation == Qt.Orientation.Horizontal and role == Qt.ItemDataRole.ToolTipRole:
            return self._about(self._form_columns[section])
        return super().headerData(section, orientation, role)

    def choice_text(self, cell: FormCell, value: Any) -> str:
        """Return the text of a choice."""
        key = cell.place[-1]
        if key == "orientation":
            return say("form.mounting", name=value, x=with_minus(value[:2]), z=with_minus(value[2:]))
        return say(f"form.{key}_{value}") if known(f"form.{key}_{value}") else str(value)

    def _column(self, number: int, each: FormColumn) -> Column:
        cells = [row.cells[number] for row in self.rows]
        numbers = any(isinstance(cell, FormCell) and cell.kind == "number" for cell in cells)
        return Column(
            partial(self._heading_with_unit, each),
            lambda name: self._texts[name][str(number)],
            number=numbers,
            state=lambda name: "bad" if self._problem(name, number) else None,
            hint=lambda name: self._hint(name, number),
        )

    def _write_texts(self) -> None:
        self._texts = {each.name: {str(i): self._text(cell) for i, cell in enumerate(each.cells)} for each in self.rows}
        for number in range(len(self._form_columns)):
            cells = [each.cells[number] for each in self.rows]
            if all(isinstance(cell, FormCell) and cell.kind == "number" for cell in cells):
                align_columns(self._texts, [str(number)])

    def _text(self, cell: FormCell | str) -> str:
        if isinstance(cell, str):
            return cell
        assert self.draft is not None
        shown = cell.shown(self.draft.value)
        if cell.kind == "choice":
            return self.choice_text(cell, shown) if shown in cell.choices else str(shown or "")
        return str(shown)

    def _problem(self, name: str, number: int) -> Problem | None:
        cell = self._row(name).cells[number]
        return self._problems.get(cell) if isinstance(cell, FormCell) else None

    def _hint(self, name: str, number: int) -> str:
        problem = self._problem(name, number)
        if problem is not None:
            return self.describe(problem)
        cell = self._row(name).cells[number]
        if isinstance(cell, FormCell) and (cell.kind == "names" or cell.place[-1] == "orientation"):
            return self._text(cell)  # may be too long for the column
        return self.locked or self._about(self._form_columns[number])

    def _row(self, name: str) -> FormRow:
        return next(each for each in self.rows if each.name == name)

    def _title(self, name: str) -> str:
        if self.form.names == "parameter":
            return parameter_text(name)
        return term("form", name) if self.form.names == "key" else name

    def _heading(self, each: FormColumn) -> str:
        return term("form", each.key, stage=each.stage)

    def _heading_with_unit(self, each: FormColumn) -> str:
        heading = self._heading(each)
        return say("form.in_unit", name=heading, unit=each.unit) if each.unit else heading

    def _about(self, each: FormColumn) -> str:
        return say(f"form.about_{each.key}") if known(f"form.about_{each.key}") else ""
