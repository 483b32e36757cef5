"""Forms for limits, noise, priors and register maps: editable tables of a draft's values in display units."""

from collections.abc import Callable
from functools import partial
from typing import Any

from PySide6.QtCore import QAbstractItemModel, QModelIndex, QSize, Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import (
    QAbstractItemView,
    QComboBox,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QWidget,
)

from calstation.config import (
    Form,
    FormCell,
    arrange_entries,
    cells_with_problem,
)
from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.form_model import FormModel, Index
from calstation.gui.text import on_language_change, parameter_text, say, with_minus, without_minus
from calstation.gui.widgets import (
    ChoiceBox,
    EditableBox,
    ParameterTable,
    WordEdit,
    button,
    column,
    enable,
    label,
    row,
    show_text,
    theme,
)
from calstation.schema import Problem

#: Largest width of a column, and additional width for the input of a cell with choices, px.
_WIDEST, _ARROW = 34 * theme.GRID, 3 * theme.GRID

_EDITS = (
    QAbstractItemView.EditTrigger.DoubleClicked
    | QAbstractItemView.EditTrigger.EditKeyPressed
    | QAbstractItemView.EditTrigger.AnyKeyPressed
)


class _Delegate(QStyledItemDelegate):
    """Creates the input of a cell: a line, a list of choices, or a line with suggestions."""

    def createEditor(self, parent: QWidget, option: QStyleOptionViewItem, index: Index) -> QWidget:
        """Create the input of a cell."""
        model = _model(index)
        cell = model.cell(index)
        assert isinstance(cell, FormCell)
        if cell.kind == "choice":
            box = ChoiceBox(lambda: [(value, model.choice_text(cell, value)) for value in cell.choices])
            box.setParent(parent)
            box.typed.connect(lambda: self._done(box))
            box.view().setMinimumWidth(box.view().sizeHintForColumn(0) + _ARROW)  # the column may be narrower
            return box
        if cell.choices:
            typed = EditableBox(cell.choices)
            typed.setParent(parent)
            return typed
        line = WordEdit()
        line.setParent(parent)
        line.setAlignment(model.data(index, Qt.ItemDataRole.TextAlignmentRole))
        return line

    def setEditorData(self, editor: QWidget, index: Index) -> None:
        """Show the value of a cell in its input."""
        assert isinstance(editor, ChoiceBox | EditableBox | WordEdit)
        value = index.data(Qt.ItemDataRole.EditRole)
        editor.show_value(value if isinstance(editor, ChoiceBox) else with_minus(value))

    def setModelData(self, editor: QWidget, model: QAbstractItemModel, index: Index) -> None:
        """Write the value of an input into the draft."""
        assert isinstance(editor, ChoiceBox | EditableBox | WordEdit)
        value = editor.value()
        _model(index).setData(index, value if isinstance(editor, ChoiceBox) else without_minus(value or ""))

    def sizeHint(self, option: QStyleOptionViewItem, index: Index) -> QSize:
        """Return the size of a cell; long lists of names are elided."""
        size = super().sizeHint(option, index)
        cell = _model(index).cell(index)
        if isinstance(cell, FormCell) and cell.choices:
            size.setWidth(size.width() + _ARROW)
        return size.boundedTo(QSize(_WIDEST, 1000))

    def initStyleOption(self, option: QStyleOptionViewItem, index: Index) -> None:
        """Show an arrow next to a value that has choices."""
        super().initStyleOption(option, index)
        cell = _model(index).cell(index)
        if isinstance(cell, FormCell) and cell.choices and not _model(index).locked:
            option.text += " ▾"

    def _done(self, editor: QWidget) -> None:
        self.commitData.emit(editor)
        self.closeEditor.emit(editor)


def _model(index: Index) -> FormModel:
    model = index.model()
    assert isinstance(model, FormModel)
    return model


class FormTable(ParameterTable):
    """The table of a form: typing or a double click changes a value, a click opens its choices, Delete clears it."""

    def __init__(self, model: FormModel) -> None:
        super().__init__(model)
        self.form_model = model
        self.setObjectName(f"{model.form.name}_table")
        self.setItemDelegate(_Delegate(self))
        self.setEditTriggers(_EDITS)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectItems)
        self.setHorizontalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.verticalHeader().setHighlightSections(True)
        self.clicked.connect(self._open_choices)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Clear the current cell on Delete."""
        index = self.currentIndex()
        clears = event.key() == Qt.Key.Key_Delete and index.isValid()
        if clears and self.form_model.flags(index) & Qt.ItemFlag.ItemIsEditable:
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
    """A form of a draft with the actions on its rows."""

    def __init__(self, form: Form) -> None:
        super().__init__()
        self.form = form
        self._draft: Draft | None = None
        self.model = FormModel(form)
        self.table = FormTable(self.model)
        self.setObjectName(f"{form.name}_form")
        self._reason = label(kind="error", name=f"{form.name}_form_reason", wrap=True)
        self._offer = ChoiceBox(self._offered, f"{form.name}_add_combo")
        self._offer.setMinimumWidth(28 * theme.GRID)
        self._offer.setVisible(bool(form.offered))
        self._add_button = self._button("add", "settings.add", self._add)
        self._remove_button = self._button("remove", "settings.remove", self._remove)
        self._up_button = self._button("up", "settings.move_up", partial(self._move, -1))
        self._down_button = self._button("down", "settings.move_down", partial(self._move, 1))
        self._buttons = (self._add_button, self._remove_button, self._up_button, self._down_button)
        rows = bool(form.offered) or form.listed
        for each, there in zip(self._buttons, (rows, rows, form.listed, form.listed), strict=True):
            each.setVisible(there)
        hint = label("form.edit_hint", "muted", wrap=True)
        actions = row(self._offer, *self._buttons, (hint, 1))
        column(self._reason, (self.table, 1), actions, on=self, margins=(0, theme.GRID, 0, 0))
        self.table.selectionModel().currentChanged.connect(lambda *_: self._enable())
        self.model.modelReset.connect(self._enable)
        on_language_change(self, self.refresh)

    def _button(self, action: str, words: str, pressed: Callable[..., Any]) -> Any:
        return button(f"{self.form.name}_{action}_button", words, lambda: pressed())

    @property
    def title(self) -> str:
        """The code of the form's name."""
        return f"form.tab_{self.form.name}"

    def show_draft(self, draft: Draft) -> None:
        """Show a draft."""
        self._draft = draft
        self.refresh()

    def lock(self, reason: str) -> None:
        """Prevent changes for the reason in the tooltips; "" permits them."""
        self.model.locked = reason
        self._enable()

    def refresh(self) -> None:
        """Show the current values, or the reason why there are none."""
        self.table.setAccessibleName(say(self.title))
        draft = self._draft
        if draft is None:
            return
        current = self.table.currentIndex()
        at = current.row(), current.column()
        self.model.show_draft(draft)
        if not self.table.currentIndex().isValid() and at[0] >= 0:
            self.table.setCurrentIndex(self.model.index(min(at[0], len(self.model.rows) - 1), at[1]))
        unreadable = self.form.unreadable(draft.problems)
        show_text(self._reason, "" if unreadable is None else say("form.unreadable", reason=say(unreadable.as_text)))
        self.table.setEnabled(unreadable is None)
        if self._offer.value() not in dict(self._offered()):
            self._offer.setCurrentIndex(-1)
        self._offer.fill()
        self._offer.setCurrentIndex(max(self._offer.currentIndex(), 0))
        self._enable()

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
        none = "" if number >= 0 else say("settings.choose_row")
        enable(self._offer, why_not)
        some = self.form.listed or self._offer.count()
        enable(self._add_button, why_not or ("" if some else say("settings.all_listed")))
        enable(self._remove_button, why_not or none)
        enable(self._up_button, why_not or none or ("" if number > 0 else say("settings.is_first")))
        enable(self._down_button, why_not or none or ("" if number < last else say("settings.is_last")))

    def _offered(self) -> list[tuple[str, str]]:
        present = {each.name for each in self.model.rows}
        return [(name, parameter_text(name)) for name in self.form.offered if name not in present]

    def _add(self) -> None:
        draft = self._draft
        assert draft is not None
        if self.form.new_entry is not None:
            number = len(self.model.rows)
            self._arrange([*range(number), self.form.new_entry(draft.value, draft.model)])
        else:
            name = self._offer.value()
            draft.set({(*self.form.roots[0], name): {}})
            number = next(i for i, each in enumerate(self.model.rows) if each.name == name)
        first = next(i for i, cell in enumerate(self.model.rows[number].cells) if isinstance(cell, FormCell))
        self.table.setCurrentIndex(self.model.index(number, first))
        self.table.setFocus()

    def _remove(self) -> None:
        draft, number = self._draft, self.table.currentIndex().row()
        assert draft is not None
        if self.form.listed:
            self._arrange([i for i in range(len(self.model.rows)) if i != number])
        else:
            draft.set(dict.fromkeys(self.model.rows[number].places))

    def _move(self, by: int) -> None:
        index = self.table.currentIndex()
        order: list[Any] = list(range(len(self.model.rows)))
        order.insert(index.row() + by, order.pop(index.row()))
        self._arrange(order)
        self.table.setCurrentIndex(self.model.index(index.row() + by, index.column()))

    def _arrange(self, order: list[Any]) -> None:
        draft = self._draft
        assert draft is not None
        (key,) = self.form.roots[0]
        draft.rewrite(arrange_entries(draft.text, str(key), order))
