"""The form engine: fields with a label, an input, a unit and a message, which edit the values of a source."""

from collections.abc import Callable, Iterable, Mapping
from copy import deepcopy
from typing import Any

from PySide6.QtCore import QObject, QSignalBlocker, Signal
from PySide6.QtWidgets import QFrame, QLabel, QWidget

from calstation.config import FieldSpec
from calstation.gui.text import Words, bind, on_language_change, say
from calstation.gui.widgets import theme
from calstation.gui.widgets.inputs import ChoiceBox, Editor, FlagBox, NumberEdit, TextEdit, VectorEdit
from calstation.gui.widgets.layout import (
    Item,
    PlainLabel,
    button,
    column,
    enable,
    grid,
    label,
    line_edit,
    row,
    show_text,
)
from calstation.messages import known
from calstation.schema import KeyPath, Problem, value_at


class FormValues(QObject):
    """The values of a form: the stored values, the edited `values`, and the problems that `check` finds in them.

    An edit replaces the mapping `values`, so that a caller can keep it and compare it with later values.
    """

    changed = Signal()

    def __init__(
        self,
        stored: Mapping[str, Any],
        check: Callable[[Mapping[str, Any]], Iterable[Problem]] = lambda _: (),
        parent: QObject | None = None,
    ) -> None:
        super().__init__(parent)
        self.stored, self._check = stored, check
        self.reset()

    def value(self, key_path: KeyPath) -> Any:
        """Return the edited value at a key path, or None."""
        return value_at(self.values, key_path)

    def differs(self, key_path: KeyPath) -> bool:
        """Return whether the value at a key path differs from the stored one."""
        return bool(self.value(key_path) != value_at(self.stored, key_path))

    def set(self, changes: Mapping[KeyPath, Any]) -> None:
        """Change values; None removes a value from a table."""
        values = deepcopy(self.values)
        for (*tables, key), value in changes.items():
            table = value_at(values, tuple(tables))
            if value is None and tables:
                table.pop(key, None)
            else:
                table[key] = value
        self._show(values)

    def reset(self) -> None:
        """Restore the stored values."""
        self._show(deepcopy(dict(self.stored)))

    def _show(self, values: dict[str, Any]) -> None:
        self.values, self.problems = values, list(self._check(values))
        self.changed.emit()


class FormField(QWidget):
    """A label, an input and its unit, with a message below the input: a problem, a refusal, a warning or a hint.

    Subclasses arrange the widgets in `grid`.

    Parameters
    ----------
    source, key_path
        Values of the form, and key path of the field's value.
    words
        Text of the label, and name of the input for screen readers.
    name
        Object name of the input; its suffix ``_edit`` is replaced by ``_message`` for the message.
    """

    def __init__(
        self, source: FormValues, key_path: KeyPath, editor: Editor, words: Words, name: str, unit: str = ""
    ) -> None:
        super().__init__()
        self._source, self._key_path, self.editor = source, key_path, editor
        #: Key paths whose problems are shown here.
        self.key_paths: tuple[KeyPath, ...] = (key_path,)
        #: Why the input does not accept its text, so that the source keeps the previous value.
        self.refusal: Words = ""
        #: Warning about a valid but unlikely value, and text shown if there is neither a problem nor a warning.
        self.warning: Words = ""
        self.hint: Words = ""
        #: Value shown if the source has none.
        self.default: Any = None
        editor.setObjectName(name)
        self.label = label(words, wrap=True, buddy=editor)
        self.unit = PlainLabel(unit)
        self.message = label(name=f"{name.removesuffix('_edit')}_message", wrap=True)
        bind(editor.setAccessibleName, words)
        if isinstance(editor, FlagBox):
            bind(editor, words)
        self.grid = grid(self, across=2 * theme.GRID, down=2)
        self._typing = False
        editor.typed.connect(self._typed)
        source.changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def lock(self, reason: str) -> None:
        """Disable the input, with `reason` as its tooltip; "" enables it."""
        enable(self.editor, reason, self.toolTip())

    def refresh(self) -> None:
        """Show the value and the message."""
        value = self._source.value(self._key_path)
        if not self._typing or self.editor.value() != value:  # do not replace the text while the user types
            with QSignalBlocker(self.editor):
                self.editor.show_value(self.default if value is None else value)
        problem = next((p for p in self._source.problems if self._shows(p.key_path)), None)
        if problem is not None:
            kind, text = "error", self.problem_text(problem)
        elif text := say(self.refusal):
            kind = "error"
        elif text := say(self.warning):
            kind = "caution"
        else:
            kind, text = "muted", say(self.hint)
        show_text(self.message, text)
        if self.message.property("kind") != kind:
            theme.set_kind(self.message, kind)
        for edit in self.editor.edits if isinstance(self.editor, VectorEdit) else (self.editor,):
            theme.set_invalid(edit, invalid=kind == "error")
        self.editor.setAccessibleDescription(text)

    def problem_text(self, problem: Problem) -> str:
        """Return the text of a problem with this field."""
        return problem_text(problem)

    def changes(self, value: Any) -> dict[KeyPath, Any]:
        """Return the changes of the form that a typed value makes."""
        return {self._key_path: value}

    def _typed(self) -> None:
        self._typing = True
        self._source.set(self.changes(self.editor.value()))
        self._typing = False

    def _shows(self, key_path: KeyPath) -> bool:
        """Return whether this field shows the problems at a key path; a list also shows those of its elements."""
        return key_path in self.key_paths or (key_path[:-1] == self._key_path and isinstance(key_path[-1], int))


class NameBar(QFrame):
    """A bar that asks for the name of a new file and passes a valid name to `accept`; `ask_name` shows it.

    Parameters
    ----------
    names
        Object names of the input, of the button that accepts the name, and of the Cancel button.
    caption, words
        The label of the input, and the text of the button.
    others
        Items beside the input.
    """

    def __init__(self, names: tuple[str, str, str], caption: QLabel, words: Words, *others: Item) -> None:
        super().__init__()
        self._locked = ""
        self.setProperty("kind", "panel")
        self.edit = line_edit(names[0], lambda _: self.check(), width=26 * theme.GRID, longest=60)
        self.edit.returnPressed.connect(self._accept)
        caption.setBuddy(self.edit)
        self.message, self._remark = label(kind="error", wrap=True), label(kind="caution", wrap=True)
        self._button = button(names[1], words, self._accept, kind="primary")
        #: The last widget in Tab order.
        self.last = button(names[2], "common.cancel", self.hide)
        inputs = row(caption, self.edit, *others, None, self._button, self.last)
        margins = (2 * theme.GRID, theme.GRID, theme.GRID, theme.GRID)
        column(inputs, self.message, self._remark, on=self, spacing=theme.GRID // 2, margins=margins)
        on_language_change(self, self.check)
        self.hide()

    def ask_name(self, proposed: str = "") -> None:
        """Show the bar with a proposed name."""
        self.edit.setText(proposed)
        self.check()
        self.show()
        self.edit.setFocus()
        self.edit.selectAll()

    def lock(self, reason: str) -> None:
        """Disable the button for the given reason; "" enables it."""
        self._locked = reason
        self.check()

    def check(self) -> None:
        """Show why the name cannot be used, or a remark on it."""
        name = self.edit.text()
        problem = self.problem(name) if name else ""
        show_text(self.message, problem)
        show_text(self._remark, "" if problem else self.remark(name))
        enable(self._button, self._locked or problem or ("" if name else say("common.type_name")))

    def problem(self, name: str) -> str:
        """Return why a name cannot be used, or "" if it can."""
        return ""

    def remark(self, name: str) -> str:
        """Return a remark on a valid name, or ""."""
        return ""

    def accept(self, name: str) -> None:
        """Handle a valid name."""

    def _accept(self) -> None:
        if self._button.isEnabled():
            self.accept(self.edit.text())


def problem_text(problem: Problem) -> str:
    """Return the text of a problem for display below its field."""
    codes = (f"field.{problem.what.code.replace('.', '_')}", f"field.{problem.kind}")
    code = next(filter(known, codes), None)
    return say(code, **problem.values) if code else say(problem.what)


def choices_of(name: str, *values: Any) -> Callable[[], list[tuple[Any, str]]]:
    """Return a function that lists values with their texts: the digits of a number, or a term of ``setting``."""
    return lambda: [(v, f"{v:g}" if isinstance(v, float | int) else say(f"setting.{name}_{v}")) for v in values]


def make_input(spec: FieldSpec, choices: Callable[[], list[tuple[Any, str]]]) -> Editor:
    """Create the input for the type of a field; `choices` lists its values with their texts if it is a choice."""
    match spec.kind:
        case "choice":
            return ChoiceBox(choices)
        case "flag":
            return FlagBox()
        case "vector":
            return VectorEdit()
        case "text":
            return TextEdit()
    return NumberEdit()
