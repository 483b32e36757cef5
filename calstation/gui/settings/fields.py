"""Labelled inputs bound to values of a draft: checked as typed, with the problem and its remedy beneath."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from PySide6.QtWidgets import QFrame, QGridLayout, QSizePolicy, QWidget

from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.inputs import Editor
from calstation.gui.text import bind, on_language_change, say, show
from calstation.gui.widgets import Item, Words, column, enable, label, row, theme
from calstation.messages import known
from calstation.schema import KeyPath, Problem, field_name

#: Widths of a field's label and of its input, px.
LABEL, EDITOR = 22 * theme.GRID, 30 * theme.GRID

#: Width kept for a unit beside an input, px.
_UNIT = 9 * theme.GRID


class Field(QWidget):
    """Label, input, unit and, beneath, what is wrong or what the value means.

    Parameters
    ----------
    draft, place : the value shown
    editor : its input
    words : text of the label
    unit : beside the input
    hint : what the value means, shown while nothing is wrong
    default : shown if the file has no value

    Attributes
    ----------
    places : places whose problems are shown here
    """

    def __init__(
        self,
        draft: Draft,
        place: KeyPath,
        editor: Editor,
        words: Words,
        *,
        unit: str = "",
        hint: Words = str,
        default: Any = None,
    ) -> None:
        super().__init__()
        self.draft, self.place, self.editor = draft, place, editor
        self.places: tuple[KeyPath, ...] = (place,)
        self._hint, self._default = hint, default
        self._advice: Words = str
        name = "_".join(map(str, place))
        editor.setObjectName(f"{name}_edit")
        self.label = label(words, wrap=True)
        self.label.setBuddy(editor)
        self.label.setFixedWidth(LABEL)
        bind(editor.setAccessibleName, words)
        self.message = label(name=f"{name}_message", wrap=True)
        self.message.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Minimum)
        self._unit = label(lambda: unit, "muted")
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(2 * theme.GRID)
        grid.setVerticalSpacing(2)
        grid.addWidget(self.label, 0, 0)
        grid.addWidget(editor, 0, 1)
        grid.addWidget(self._unit, 0, 2)
        grid.addWidget(self.message, 1, 1, 1, 2)
        grid.setColumnStretch(2, 1)
        self.set_width(EDITOR)
        editor.typed.connect(lambda: draft.set({place: editor.value()}))
        draft.changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def set_width(self, width: int) -> "Field":
        """Give the input a width in px."""
        self.editor.setFixedWidth(width)
        self.setMinimumWidth(LABEL + width + _UNIT + 3 * theme.GRID)
        return self

    def hide_label(self, width: int) -> "Field":
        """Show only the input, of a width in px, as a cell of a table."""
        self.editor.setFixedWidth(width)
        self.label.hide()
        self.setFixedWidth(width + _UNIT)
        return self

    def lock(self, reason: str) -> None:
        """Disable the input with the reason as its tooltip; "" enables it."""
        enable(self.editor, reason)

    def advise(self, advice: Words) -> None:
        """Show a warning about an allowed but unlikely value; `advice` gives "" if there is none."""
        self._advice = advice
        self.refresh()

    def refresh(self) -> None:
        """Show value and message of the draft."""
        value = self.draft.value(self.place)
        self.editor.show_value(self._default if value is None else value)
        problem = next((p for p in self.draft.problems if self._is_mine(p.place)), None)
        advice = self._advice()
        kind, text = "muted", self._hint()
        if problem is not None:
            kind, text = "error", problem_text(problem)
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

    def _is_mine(self, place: KeyPath) -> bool:
        """Whether a problem of this place is shown here; a list shows those of its elements."""
        return place in self.places or (place[:-1] == self.place and isinstance(place[-1], int))


class Form(QWidget):
    """Fields and rows one below the other."""

    def __init__(self, *widgets: QWidget) -> None:
        super().__init__()
        self.fields = [widget for widget in widgets if isinstance(widget, Field)]
        column(*widgets, None, on=self)

    def lock(self, reason: str) -> None:
        """Disable all fields with the reason as their tooltip; "" enables them."""
        for field in self.fields:
            field.lock(reason)


class Row(QWidget):
    """A label and an input that belongs to no single value."""

    def __init__(self, widget: QWidget, words: Words = str) -> None:
        super().__init__()
        caption = label(words, wrap=True)
        caption.setBuddy(widget)
        caption.setFixedWidth(LABEL)
        widget.setFixedWidth(EDITOR)
        row(caption, widget, None, on=self, spacing=2 * theme.GRID)


def panel(*items: Item, spacing: int = theme.GRID) -> QWidget:
    """Make a framed panel of these items, at the top of its place."""
    frame = QFrame()
    frame.setProperty("kind", "panel")
    wide = 2 * theme.GRID
    column(*items, None, on=frame, spacing=spacing, margins=(wide, wide, wide, wide))
    place = QWidget()
    column(frame, None, on=place)
    return place


def set_tab_order(widgets: Sequence[QWidget]) -> None:
    """Let Tab follow the order in which the widgets are read."""
    for before, after in pairwise(widgets):
        QWidget.setTabOrder(before, after)


def problem_text(problem: Problem) -> str:
    """The sentence for a problem beneath its field."""
    code = f"field.{problem.kind}"
    return say(code, **problem.values) if known(code) else show(problem.what)


def problem_text_with_name(problem: Problem) -> str:
    """The sentence for a problem away from its field, with the field's name."""
    if known(f"field.{problem.kind}") and problem.place:
        return f"{field_name(problem.place)}: {problem_text(problem)}"
    return show(problem.as_text)
