"""Forms for the lists and tables of a file, such as limits and registers, which are editable tables of values."""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from PySide6.QtCore import QAbstractItemModel, QModelIndex, QPersistentModelIndex, QSize, Qt
from PySide6.QtGui import QColor, QKeyEvent
from PySide6.QtWidgets import QAbstractItemView, QComboBox, QStyledItemDelegate, QStyleOptionViewItem, QWidget

from calstation.config import Form, FormCell, FormColumn, FormRow, arrange_entries, cells_with_problem
from calstation.gui.settings.drafts import Draft
from calstation.gui.text import on_language_change, parameter_text, say, term, with_minus, without_minus
from calstation.gui.widgets import (
    ChoiceBox,
    Column,
    EditableBox,
    Item,
    ParameterModel,
    ParameterTable,
    TextEdit,
    align_columns,
    button,
    column,
    enable,
    label,
    line_edit,
    problem_text,
    row,
    show_text,
    theme,
)
from calstation.messages import known
from calstation.schema import KeyPath, Problem

Index = QModelIndex | QPersistentModelIndex

#: Function that returns the value at a key path of a file, or None.
ReadValue = Callable[[KeyPath], Any]

#: Maximum width of a column, and width of the arrow in a cell with choices, px.
_MAX_WIDTH, _ARROW_WIDTH = 34 * theme.GRID, 3 * theme.GRID

_EDIT_TRIGGERS = (
    QAbstractItemView.EditTrigger.DoubleClicked
    | QAbstractItemView.EditTrigger.EditKeyPressed
    | QAbstractItemView.EditTrigger.AnyKeyPressed
)


class FormModel(ParameterModel):
    """The table model of a form: its rows and columns, with the values, defaults and problems of a draft."""

    def __init__(self, form: Form) -> None:
        super().__init__((), grouped=False)
        self.form = form
        self.draft = Draft(form.kind)
        #: Reason why values cannot be changed, or "".
        self.locked = ""
        self.rows: list[FormRow] = []
        self._form_columns: list[FormColumn] = []
        self._texts: dict[str, dict[str, str]] = {}
        self._problems: dict[FormCell | str, Problem] = {}

    def show_draft(self, draft: Draft) -> None:
        """Show the values of a draft."""
        rows, columns = self.form.rows(draft.value), self.form.columns(draft.value)
        names = [each.name for each in rows]
        reshaped = (
            draft is not self.draft or columns != self._form_columns or names != [each.name for each in self.rows]
        )
        if reshaped:
            self.show((), ())
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
        """Return the cell at an index, or the text of a constant cell."""
        return self.rows[index.row()].cells[index.column()]

    def index_of(self, cell: FormCell) -> QModelIndex:
        """Return the index of a cell."""
        number = next(i for i, each in enumerate(self.rows) if cell in each.cells)
        return self.index(number, self.rows[number].cells.index(cell))

    def describe(self, problem: Problem) -> str:
        """Return a sentence on a problem with the names of its row and column, or "" if it is not in this form."""
        cells = cells_with_problem(self.rows, problem)
        if not cells:
            return ""
        index = self.index_of(cells[0])
        heading = self._heading(self._form_columns[index.column()], unit=False) if len(cells) == 1 else ""
        name = self._cell_name(self.rows[index.row()].name, heading, cells[0].unit[0])
        return say("form.problem", name=name, what=problem_text(cells[0].in_display_unit(problem)))

    def differences(self, old: ReadValue, new: ReadValue) -> list[str]:
        """Return a line for each value with a unit that differs between two texts of a file, in its display unit."""
        columns, earlier = self.form.columns(new), {each.name: each.cells for each in self.form.rows(old)}
        lines = []
        for each in self.form.rows(new):
            for heading, cell in zip(columns, each.cells, strict=True):
                if isinstance(cell, FormCell) and cell.unit[0] and each.name in earlier:
                    before, after = (str(cell.displayed(get)) for get in (old, new))
                    name = self._cell_name(each.name, self._heading(heading, unit=False), cell.unit[0])
                    values = {"old": with_minus(before) or "–", "new": with_minus(after) or "–"}
                    lines += [say("form.changed", name=name, **values)] if before != after else []
        return lines

    def _cell_name(self, name: str, heading: str, unit: str) -> str:
        """Return the name of a row with the heading of a column and a unit, unless they are ""."""
        name = say("form.row", number=self._title(name)) if self.form.names == "number" else self._title(name)
        name = say("form.cell", row=name, column=heading) if heading else name
        name = say("form.in_unit", name=name, unit=unit) if unit else name
        return f"{name[:1].upper()}{name[1:]}"

    def lines(self, rows: Iterable[int]) -> list[list[str]]:
        """Return the headings and the rows for a spreadsheet."""
        lines = super().lines(rows)
        lines[0][0] = self.form.names
        return lines

    def flags(self, index: Index) -> Qt.ItemFlag:
        """Return the flags of a cell, including whether it can be edited."""
        flags = super().flags(index)
        cell = self.cell(index)
        can_change = not self.locked and isinstance(cell, FormCell) and cell.editable
        return flags | Qt.ItemFlag.ItemIsEditable if can_change else flags

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        """Return the text, the edited value, or the appearance of a cell; defaults are grey."""
        cell = self.cell(index)
        if role == Qt.ItemDataRole.EditRole and isinstance(cell, FormCell):
            return cell.displayed(self.draft.value)
        if role == Qt.ItemDataRole.ForegroundRole and cell not in self._problems:
            stated = isinstance(cell, FormCell) and cell.is_set(self.draft.value)
            return None if stated else QColor(theme.colours().muted)
        return super().data(index, role)

    def setData(self, index: Index, value: Any, role: int = Qt.ItemDataRole.EditRole) -> bool:
        """Write a text or a selected value into the draft."""
        cell = self.cell(index)
        changes = {} if isinstance(cell, str) else cell.changes(self.draft.value, value)
        if changes:
            self.draft.set(changes)
        return bool(changes)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        """Return the name of a row, or the heading of a column with its explanation."""
        if orientation == Qt.Orientation.Vertical:
            is_file_name = role == Qt.ItemDataRole.DisplayRole and self.form.names == "parameter"
            if role in (Qt.ItemDataRole.DisplayRole, Qt.ItemDataRole.AccessibleTextRole) and not is_file_name:
                return self._title(self.rows[section].name)
        if orientation == Qt.Orientation.Horizontal and role == Qt.ItemDataRole.ToolTipRole:
            return self._about(self._form_columns[section])
        return super().headerData(section, orientation, role)

    def choice_text(self, cell: FormCell, value: Any) -> str:
        """Return the text of a choice."""
        key = cell.key_path[-1]
        if key == "orientation":
            return say("form.mounting", name=value, x=with_minus(value[:2]), z=with_minus(value[2:]))
        return say(f"form.{key}_{value}") if known(f"form.{key}_{value}") else str(value)

    def _column(self, number: int, each: FormColumn) -> Column:
        cells = [row.cells[number] for row in self.rows]
        numbers = any(isinstance(cell, FormCell) and cell.kind == "number" for cell in cells)
        return Column(
            partial(self._heading, each),
            lambda name: self._texts[name][str(number)],
            number=numbers,
            state=lambda name: "bad" if self._named_cell(name, number) in self._problems else None,
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
        shown = cell.displayed(self.draft.value)
        if cell.kind == "choice":
            return self.choice_text(cell, shown) if shown in cell.choices else str(shown or "")
        return str(shown)

    def _named_cell(self, name: str, number: int) -> FormCell | str:
        return next(each for each in self.rows if each.name == name).cells[number]

    def _hint(self, name: str, number: int) -> str:
        cell = self._named_cell(name, number)
        if not isinstance(cell, str):
            if cell in self._problems:
                return self.describe(self._problems[cell])
            if cell.kind == "names" or cell.key_path[-1] == "orientation":
                return self._text(cell)  # the text may be too long for the column
        return self.locked or self._about(self._form_columns[number])

    def _title(self, name: str) -> str:
        if self.form.names == "parameter":
            return parameter_text(name)
        return term("form", name) if self.form.names == "key" else name

    def _heading(self, each: FormColumn, *, unit: bool = True) -> str:
        heading = term("form", each.key, stage=each.stage)
        return say("form.in_unit", name=heading, unit=each.unit) if unit and each.unit else heading

    def _about(self, each: FormColumn) -> str:
        return say(f"form.about_{each.key}") if known(f"form.about_{each.key}") else ""


class _Delegate(QStyledItemDelegate):
    """Creates the input of a cell: a text input, a list of choices, or a text input with suggestions."""

    def __init__(self, model: FormModel, parent: QWidget) -> None:
        super().__init__(parent)
        self._model = model

    def createEditor(self, parent: QWidget, option: QStyleOptionViewItem, index: Index) -> QWidget:
        """Create the input of a cell."""
        model, cell = self._model, self._model.cell(index)
        if isinstance(cell, FormCell) and cell.kind == "choice":
            box = ChoiceBox(lambda: [(value, model.choice_text(cell, value)) for value in cell.choices])
            box.setParent(parent)
            box.typed.connect(lambda: self._done(box))
            box.view().setMinimumWidth(box.view().sizeHintForColumn(0) + _ARROW_WIDTH)  # the column may be narrower
            return box
        if isinstance(cell, FormCell) and cell.choices:
            editable = EditableBox(cell.choices)
            editable.setParent(parent)
            return editable
        line = TextEdit()
        line.setParent(parent)
        line.setAlignment(model.data(index, Qt.ItemDataRole.TextAlignmentRole))
        return line

    def setEditorData(self, editor: QWidget, index: Index) -> None:
        """Show the value of a cell in its input."""
        value = index.data(Qt.ItemDataRole.EditRole)
        if isinstance(editor, ChoiceBox):
            editor.show_value(value)
        elif isinstance(editor, EditableBox | TextEdit):
            editor.show_value(with_minus(value))

    def setModelData(self, editor: QWidget, model: QAbstractItemModel, index: Index) -> None:
        """Write the value of an input into the draft."""
        if isinstance(editor, ChoiceBox):
            model.setData(index, editor.value())
        elif isinstance(editor, EditableBox | TextEdit):
            model.setData(index, without_minus(editor.value() or ""))

    def sizeHint(self, option: QStyleOptionViewItem, index: Index) -> QSize:
        """Return the size of a cell, up to the maximum width of a column."""
        size = super().sizeHint(option, index)
        cell = self._model.cell(index)
        if isinstance(cell, FormCell) and cell.choices:
            size.setWidth(size.width() + _ARROW_WIDTH)
        return size.boundedTo(QSize(_MAX_WIDTH, 1000))

    def initStyleOption(self, option: QStyleOptionViewItem, index: Index) -> None:
        """Show an arrow next to a value with choices."""
        super().initStyleOption(option, index)
        cell = self._model.cell(index)
        if isinstance(cell, FormCell) and cell.choices and not self._model.locked:
            option.text += " ▾"

    def _done(self, editor: QWidget) -> None:
        self.commitData.emit(editor)
        self.closeEditor.emit(editor)


class FormTable(ParameterTable):
    """The table of a form: typing or a double click edits a value, a click opens its choices, Delete clears it."""

    def __init__(self, model: FormModel) -> None:
        super().__init__(model)
        self.form_model = model
        self.setObjectName(f"{model.form.name}_table")
        self.setItemDelegate(_Delegate(model, self))
        self.setEditTriggers(_EDIT_TRIGGERS)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectItems)
        self.setHorizontalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.verticalHeader().setHighlightSections(True)
        self.clicked.connect(self._open_choices)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Clear the current cell on Delete."""
        index = self.currentIndex()
        delete = event.key() == Qt.Key.Key_Delete and index.isValid()
        if delete and self.form_model.flags(index) & Qt.ItemFlag.ItemIsEditable:
            cell = self.form_model.cell(index)
            self.form_model.setData(index, None if isinstance(cell, FormCell) and cell.kind == "choice" else "")
            return
        super().keyPressEvent(event)

    def _open_choices(self, index: QModelIndex) -> None:
        cell = self.form_model.cell(index)
        if not isinstance(cell, FormCell) or cell.kind != "choice" or self.form_model.locked:
            return
        self.edit(index)
        box = self.indexWidget(index)
        if isinstance(box, QComboBox):
            box.showPopup()


class FormView(QWidget):
    """A form with an explanation, buttons for actions on its rows, and further items below."""

    def __init__(self, form: Form, *further: Item) -> None:
        super().__init__()
        self.form = form
        self._draft = Draft(form.kind)
        self.model = FormModel(form)
        self.table = FormTable(self.model)
        self.setObjectName(f"{form.name}_form")
        self._reason = label(kind="error", name=f"{form.name}_form_reason", wrap=True)
        self._name_box = ChoiceBox(self._names_to_add, f"{form.name}_add_combo")
        self._name_box.setMinimumWidth(28 * theme.GRID)
        #: Input for the name of a new row, which can be scanned.
        self._name_edit = line_edit(
            f"{form.name}_add_edit", lambda _: self._enable(), width=28 * theme.GRID, hint="form.type_or_scan"
        )
        self._about = label(kind="muted", wrap=True)
        actions = {
            "add": ("settings.add", lambda: self._add()),
            "remove": ("settings.remove", lambda: self._remove()),
            "up": ("settings.move_up", lambda: self._move(-1)),
            "down": ("settings.move_down", lambda: self._move(1)),
        }
        self._buttons = {name: button(f"{form.name}_{name}_button", *action) for name, action in actions.items()}
        self._name_edit.returnPressed.connect(self._buttons["add"].click)
        hint = label("form.edit_hint", "muted", wrap=True)
        below = row(self._name_box, self._name_edit, *self._buttons.values(), (hint, 1))
        column(self._about, self._reason, (self.table, 1), below, *further, on=self, margins=(0, theme.GRID, 0, 0))
        self._name_box.setVisible(bool(form.offered))
        self._name_edit.setVisible(self._typed)
        for name, each in self._buttons.items():
            each.setVisible(form.listed or ((self._typed or bool(form.offered)) and name in ("add", "remove")))
        self.table.selectionModel().currentChanged.connect(lambda *_: self._enable())
        self.model.modelReset.connect(self._enable)
        on_language_change(self, self.refresh)

    @property
    def _typed(self) -> bool:
        """Whether the name of a new row is typed."""
        return self.form.names == "text"

    @property
    def title(self) -> str:
        """The catalogue code of the name of the form."""
        return f"form.tab_{self.form.name}"

    def show_draft(self, draft: Draft) -> None:
        """Show the values of a draft."""
        self._draft = draft
        self.refresh()

    def show_form(self, form: Form, draft: Draft) -> None:
        """Show the values of a draft in another form of the same kind."""
        self.form = self.model.form = form
        self.show_draft(draft)

    def lock(self, reason: str) -> None:
        """Disable changes and show `reason` in tooltips; "" enables them."""
        self.model.locked = reason
        self._enable()

    def refresh(self) -> None:
        """Show the current values, or the reason why they cannot be shown."""
        self.table.setAccessibleName(say(self.title))
        about = f"form.about_tab_{self.form.name}"
        show_text(self._about, say(about) if known(about) else "")
        draft = self._draft
        current = self.table.currentIndex()
        line, number = current.row(), current.column()
        self.model.show_draft(draft)
        if not self.table.currentIndex().isValid() and line >= 0:
            self.table.setCurrentIndex(self.model.index(min(line, len(self.model.rows) - 1), number))
        unreadable = self.form.unreadable(draft.problems)
        show_text(self._reason, "" if unreadable is None else say("form.unreadable", reason=say(unreadable.as_text)))
        self.table.setEnabled(unreadable is None)
        if self._name_box.value() not in dict(self._names_to_add()):
            self._name_box.setCurrentIndex(-1)
        self._name_box.fill()
        self._name_box.setCurrentIndex(max(self._name_box.currentIndex(), 0))
        self._enable()

    def describe(self, problem: Problem) -> str:
        """Return a sentence on a problem with the names of its row and column, or "" if it is not in this form."""
        return self.model.describe(problem)

    def go_to(self, problem: Problem) -> bool:
        """Select the cell of a problem, and return whether it belongs to this form."""
        cells = cells_with_problem(self.model.rows, problem)
        if cells:
            self.table.setCurrentIndex(self.model.index_of(cells[0]))
            self.table.setFocus()
        return bool(cells)

    def _enable(self) -> None:
        why_not = self.model.locked or self._reason.text()
        number, last = self.table.currentIndex().row(), len(self.model.rows) - 1
        why_no_row = why_not or ("" if number >= 0 else say("settings.choose_row"))
        enable(self._name_box, why_not)
        enable(self._name_edit, why_not)
        enable(self._buttons["add"], why_not or self._why_not_add())
        enable(self._buttons["remove"], why_no_row)
        enable(self._buttons["up"], why_no_row or ("" if number > 0 else say("settings.is_first")))
        enable(self._buttons["down"], why_no_row or ("" if number < last else say("settings.is_last")))

    def _why_not_add(self) -> str:
        """Return why no row can be added, or ""."""
        if self._typed:
            name = self._name_edit.text().strip()
            listed = name in (each.name for each in self.model.rows)
            return say("settings.is_listed") if listed else "" if name else say("settings.type_or_scan")
        return "" if self.form.listed or self._name_box.count() else say("settings.all_listed")

    def _names_to_add(self) -> list[tuple[str, str]]:
        present = {each.name for each in self.model.rows}
        return [(name, parameter_text(name)) for name in self.form.offered if name not in present]

    def _add(self) -> None:
        draft = self._draft
        if self.form.new_entry is not None:
            number = len(self.model.rows)
            self._arrange([*range(number), self.form.new_entry(draft.value, draft.model)])
        else:
            name = self._name_edit.text().strip() if self._typed else self._name_box.value()
            self._name_edit.clear()
            draft.set({(*self.form.roots[0], name): self.form.new_value})
            number = next(i for i, each in enumerate(self.model.rows) if each.name == name)
        first = next(i for i, cell in enumerate(self.model.rows[number].cells) if isinstance(cell, FormCell))
        self.table.setCurrentIndex(self.model.index(number, first))
        self.table.setFocus()

    def _remove(self) -> None:
        number = self.table.currentIndex().row()
        if self.form.listed:
            self._arrange([i for i in range(len(self.model.rows)) if i != number])
        else:
            chosen = self.model.rows[number]
            changes: dict[KeyPath, Any] = dict.fromkeys(chosen.key_paths)
            for cell in chosen.cells:
                if isinstance(cell, FormCell) and cell.member is not None:
                    changes |= cell.changes(self._draft.value, False)
            self._draft.set(changes)

    def _move(self, by: int) -> None:
        index = self.table.currentIndex()
        order: list[Any] = list(range(len(self.model.rows)))
        order.insert(index.row() + by, order.pop(index.row()))
        self._arrange(order)
        self.table.setCurrentIndex(self.model.index(index.row() + by, index.column()))

    def _arrange(self, order: list[Any]) -> None:
        root = self.form.roots[0]
        if len(root) == 1:
            self._draft.rewrite(arrange_entries(self._draft.text, str(root[0]), order))
            return
        present = self._draft.value(root)
        self._draft.set({root: [present[each] if isinstance(each, int) else each for each in order] or None})


class FittedForm(FormView):
    """A form whose table is as high as its rows, for a section with other contents."""

    def refresh(self) -> None:
        """Show the current values, and make the table as high as its rows."""
        super().refresh()
        header, line = self.table.horizontalHeader(), self.table.verticalHeader().defaultSectionSize()
        bar = self.table.horizontalScrollBar().sizeHint().height()
        self.table.setFixedHeight(header.sizeHint().height() + len(self.model.rows) * line + bar + theme.GRID)
