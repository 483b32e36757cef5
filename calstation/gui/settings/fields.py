"""A labelled input bound to one value of a draft: checked as typed, with its message and mend beneath it."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

from PySide6.QtCore import QEvent
from PySide6.QtWidgets import (
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from calstation.config.editing import Place
from calstation.gui.settings.draft import Draft
from calstation.gui.settings.inputs import ChoiceBox, NumberBox, NumberEdit, VectorEdit, WordEdit
from calstation.gui.settings.port_box import AddressEdit, PortBox
from calstation.gui.settings.problem_wording import word_problem
from calstation.gui.widgets import theme

#: Says a text in the language in force, anew whenever asked.
Words = Callable[[], str]

#: Widths of a field's label and of its input, px.
LABEL, EDITOR = 22 * theme.GRID, 30 * theme.GRID

#: Width kept for a unit behind an input, px.
_UNIT = 9 * theme.GRID


Editor = NumberEdit | WordEdit | ChoiceBox | NumberBox | VectorEdit | AddressEdit | PortBox


class Field(QWidget):
    """Label, input, unit and, beneath, what is wrong or what the value means.

    Parameters
    ----------
    place : of the value in the draft
    words : the label's
    unit : behind the input
    hint : what the value means, shown while nothing is wrong
    width : of the input, px
    bare : without its label, for a table of inputs
    also : further places whose problems are told here
    default : what is in force where the file does not say
    """

    def __init__(
        self,
        draft: Draft,
        place: Place,
        editor: Editor,
        words: Words,
        *,
        unit: str = "",
        hint: Words = str,
        width: int = EDITOR,
        bare: bool = False,
        also: Sequence[Place] = (),
        default: Any = None,
    ) -> None:
        super().__init__()
        self.draft, self.place, self.editor = draft, place, editor
        self.places = (place, *also)
        self._words, self._hint, self._default = words, hint, default
        self._advice: Words = str
        editor.setObjectName("_".join(map(str, place)) + "_edit")
        self.label = QLabel()
        self.label.setBuddy(editor)
        self.label.setFixedWidth(LABEL)
        self.label.setWordWrap(True)
        self.message = QLabel()
        self.message.setObjectName("_".join(map(str, place)) + "_message")
        self.message.setWordWrap(True)
        self.message.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Minimum)
        editor.setFixedWidth(width)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(2 * theme.GRID)
        grid.setVerticalSpacing(2)
        grid.addWidget(self.label, 0, 0)
        self.label.setVisible(not bare)
        if bare:
            self.setFixedWidth(width + _UNIT)
        else:
            self.setMinimumWidth(LABEL + width + _UNIT + 3 * theme.GRID)
        grid.addWidget(editor, 0, 1)
        self._unit = QLabel(unit)
        self._unit.setProperty("kind", "muted")
        grid.addWidget(self._unit, 0, 2)
        grid.addWidget(self.message, 1, 1, 1, 2)
        grid.setColumnStretch(2, 1)
        editor.typed.connect(self._typed)
        draft.changed.connect(self.refresh)
        self.retranslate()

    def lock(self, reason: str) -> None:
        """Forbid typing, with the reason as the tooltip; "" allows it."""
        self.editor.setEnabled(not reason)
        self.editor.setToolTip(reason)

    def advise(self, advice: Words) -> None:
        """Say that the value is allowed but hardly meant; `str` takes it back."""
        self._advice = advice
        self.refresh()

    def refresh(self) -> None:
        """Show value and message as the draft has them."""
        value = self.draft.value(self.place)
        self.editor.show_value(self._default if value is None else value)
        problem = next((p for p in self.draft.problems if self._mine(p.place)), None)
        advice = self._advice()
        kind, text = "muted", self._hint()
        if problem is not None:
            kind, text = "error", word_problem(problem)
        elif advice:
            kind, text = "caution", advice
        self.message.setText(text)
        self.message.setVisible(bool(text))
        if self.message.property("kind") != kind:
            theme.set_kind(self.message, kind)
        wrong = problem is not None
        if self.editor.property("wrong") != wrong:
            self.editor.setProperty("wrong", wrong)
            self.editor.style().polish(self.editor)
        self.editor.setAccessibleDescription(text)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self.label.setText(self._words())
        self.editor.setAccessibleName(self._words())
        if isinstance(self.editor, ChoiceBox):
            self.editor.fill()
        self.refresh()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _mine(self, place: Place) -> bool:
        """Whether a problem of this place is told here; one inside a list is the list's."""
        return place in self.places or (place[:-1] == self.place and isinstance(place[-1], int))

    def _typed(self) -> None:
        self.draft.set({self.place: self.editor.value()})


class Form(QWidget):
    """Fields one below the other, below a heading."""

    def __init__(self, *fields: QWidget) -> None:
        super().__init__()
        self.fields = [field for field in fields if isinstance(field, Field)]
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(theme.GRID)
        for field in fields:
            column.addWidget(field)
        column.addStretch(1)

    def lock(self, reason: str) -> None:
        """Forbid or allow typing in all fields, see `Field.lock`."""
        for field in self.fields:
            field.lock(reason)


class Row(QWidget):
    """A label and an input that belongs to no single value."""

    def __init__(self, widget: QWidget, words: Words, *, width: int = EDITOR) -> None:
        super().__init__()
        self._words = words
        self._label = QLabel()
        self._label.setBuddy(widget)
        self._label.setFixedWidth(LABEL)
        self._label.setWordWrap(True)
        widget.setFixedWidth(width)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(2 * theme.GRID)
        row.addWidget(self._label)
        row.addWidget(widget)
        row.addStretch(1)
        self.retranslate()

    def retranslate(self) -> None:
        """Say the label again in the language in force."""
        self._label.setText(self._words())

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)


def tab_through(*widgets: QWidget) -> None:
    """Let Tab go through widgets in this order, which is that of reading."""
    for before, after in pairwise(widgets):
        QWidget.setTabOrder(before, after)


def at_top(panel: QWidget) -> QWidget:
    """A panel that is as high as what it holds, at the top of its place."""
    place = QWidget()
    column = QVBoxLayout(place)
    column.setContentsMargins(0, 0, 0, 0)
    column.addWidget(panel)
    column.addStretch(1)
    return place
