"""Input widgets for single values, and form fields built from the schema of a configuration file."""

from collections.abc import Callable, Sequence
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo
from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtGui import QWheelEvent
from PySide6.QtWidgets import QComboBox, QFrame, QGridLayout, QLineEdit, QSizePolicy, QWidget

from calstation.config import editing
from calstation.connection import FoundPort
from calstation.gui.settings.drafts import Draft
from calstation.gui.text import Words, bind, on_language_change, say, with_minus, without_minus
from calstation.gui.widgets import Item, column, enable, label, row, show_text, theme
from calstation.messages import Text, known
from calstation.schema import KeyPath, Problem


class WordEdit(QLineEdit):
    """A text input; an empty text means no value."""

    typed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.textEdited.connect(self.typed)

    def value(self) -> Any:
        """Return the typed text, None if it is empty."""
        return self.text() or None

    def show_value(self, value: Any) -> None:
        """Show a value; while the input has the focus, an equivalent text, such as 1.50, is not replaced."""
        if not self.hasFocus() or self.value() != value:
            self.setText(_shown(value))


class NumberEdit(WordEdit):
    """A right-aligned number input; an empty text means no value."""

    def __init__(self) -> None:
        super().__init__()
        self.setAlignment(Qt.AlignmentFlag.AlignRight)

    def value(self) -> Any:
        """Return the typed number, None for an empty text, or the text itself if it is not a number."""
        return _number(self.text())


class VectorEdit(QWidget):
    """Three number inputs; the value is a list."""

    typed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.edits = [NumberEdit() for _ in range(3)]
        row(*((edit, 1) for edit in self.edits), on=self, spacing=theme.GRID // 2)
        for axis, edit in zip("xyz", self.edits, strict=True):
            edit.setAccessibleName(axis)
            edit.typed.connect(self.typed)
        self.setFocusProxy(self.edits[0])

    def value(self) -> Any:
        """Return the typed numbers."""
        return [_number(edit.text()) if edit.text().strip() else "" for edit in self.edits]

    def show_value(self, value: Any) -> None:
        """Show a list of three numbers."""
        parts: Sequence[Any] = value if isinstance(value, list) and len(value) == 3 else ("", "", "")
        for edit, part in zip(self.edits, parts, strict=True):
            edit.show_value(part)


class AddressEdit(WordEdit):
    """An input for host and port number as ``host:port``; the value is ``scheme://host:port``."""

    def __init__(self, scheme: str, default_port: int) -> None:
        super().__init__()
        self._prefix, self._default_port = f"{scheme}://", str(default_port)
        bind(self.setPlaceholderText, Text.of("settings.host_placeholder", port=default_port))

    def value(self) -> Any:
        """Return the typed address, with the default port number if none is typed."""
        text = self.text().strip()
        host, _, number = text.rpartition(":") if ":" in text else (text, "", "")
        return f"{self._prefix}{host}:{number or self._default_port}" if text else None

    def show_value(self, value: Any) -> None:
        """Show an address, unless it is the same as the typed one."""
        if value != self.value():
            self.setText(str(value or "").partition("://")[2])


class _Box(QComboBox):
    """A combo box that ignores the mouse wheel, so that scrolling the page does not change a setting."""

    typed = Signal()

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Pass the event on to the page."""
        event.ignore()


class ChoiceBox(_Box):
    """Selects one of several values; `choices` returns them with their texts in the current language."""

    def __init__(self, choices: Callable[[], Sequence[tuple[Any, str]]], name: str = "") -> None:
        super().__init__()
        self.setObjectName(name)
        self._choices = choices
        self.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.activated.connect(self.typed)
        on_language_change(self, self.fill)

    def fill(self) -> None:
        """Update the list of choices."""
        chosen = self.currentData()
        with QSignalBlocker(self):
            self.clear()
            for value, text in self._choices():
                self.addItem(text, value)
            self.show_value(chosen)

    def showPopup(self) -> None:
        """Update the choices first, because files may have been added or removed outside the window."""
        self.fill()
        super().showPopup()

    def value(self) -> Any:
        """Return the selected value."""
        return self.currentData()

    def show_value(self, value: Any) -> None:
        """Select a value; add it first if it is not among the choices."""
        index = next((i for i in range(self.count()) if self.itemData(i) == value), -1)
        if index < 0 and value is not None:
            self.addItem(str(value), value)
            index = self.count() - 1
        self.setCurrentIndex(index)


class EditableBox(_Box):
    """A combo box whose value is typed or selected."""

    def __init__(self) -> None:
        super().__init__()
        self.setEditable(True)
        self.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)
        line = self.lineEdit()
        assert line is not None
        self.line: QLineEdit = line
        self.line.textEdited.connect(self.typed)

    def value(self) -> Any:
        """Return the typed or selected text, None if it is empty."""
        return self.currentText().strip() or None

    def show_value(self, value: Any) -> None:
        """Show a value, unless the text already represents it."""
        if self.value() != value:
            self.setEditText(_shown(value))


class NumberBox(EditableBox):
    """A number that is typed, or selected from common ones."""

    def __init__(self, common: Sequence[int]) -> None:
        super().__init__()
        self.addItems([str(number) for number in common])
        self.activated.connect(self.typed)

    def value(self) -> Any:
        """Return the typed or selected number, or the text itself if it is not a number."""
        return _number(self.currentText())


class PortBox(EditableBox):
    """A serial port, typed or selected; a USB adapter is identified by its serial number, not by its USB socket."""

    def __init__(self) -> None:
        super().__init__()
        self.setCompleter(None)  # type: ignore[arg-type]  # completion could select an unintended port
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self._ports: Sequence[FoundPort] = ()
        self.activated.connect(self._chosen)
        self.view().setMinimumWidth(56 * theme.GRID)
        bind(self.line.setPlaceholderText, "settings.port_placeholder")

    def offer(self, ports: Sequence[FoundPort]) -> None:
        """List the ports found."""
        self._ports = ports
        typed = self.currentText()
        with QSignalBlocker(self):
            self.clear()
            for port in ports:
                if port.usb:
                    self.addItem(f"{port.usb}   {_describe(port)}", port.usb)
                self.addItem(port.device if port.usb else _describe(port), port.device)
            self.setCurrentIndex(-1)
            self.setEditText(typed)

    def description(self) -> str:
        """Return the description of the adapter at the port shown, "" if it was not found."""
        value = self.value()
        return next((_describe(port) for port in self._ports if value in (port.device, port.usb)), "")

    def _chosen(self, index: int) -> None:
        self.setEditText(str(self.itemData(index)))
        self.typed.emit()


#: Types of input that a field may have.
Editor = WordEdit | VectorEdit | ChoiceBox | NumberBox | PortBox


def _number(text: str) -> int | float | str | None:
    """Return the typed number, None for an empty text, or the text itself, which the validation rejects."""
    text = text.strip()
    for kind in (int, float):
        try:
            return kind(without_minus(text))
        except ValueError:
            continue
    return text or None


def _shown(value: Any) -> str:
    if value is None:
        return ""
    shown = format(value, ".12g") if isinstance(value, float) else str(value)
    return with_minus(shown) if isinstance(value, float | int) else shown


def _describe(port: FoundPort) -> str:
    """Return the description of an adapter and the current device name of its port."""
    maker = "" if port.maker in port.description else port.maker
    about = ", ".join(filter(None, (port.description, maker)))
    return f"{about} · {port.device}" if about else port.device


#: Widths of the label, the input and the unit of a field, px.
LABEL, EDITOR, _UNIT = 22 * theme.GRID, 30 * theme.GRID, 9 * theme.GRID

#: Units by field name, and by the last part of a field name.
_UNITS = {"velocity_sigma": "m/s", "speed": "×"}
_UNITS_BY_END = {"deg": "°", "dps": "°/s", "dps2": "°/s²", "m": "m", "mps2": "m/s²", "s": "s", "ppm": "ppm"}


class Field(QWidget):
    """A label, an input and a unit, with an error message or a hint below the input.

    The last key of `place` selects label and hint from the catalogue family ``setting``, unless `name` and `hint` are
    given. The schema of the value determines the input and its default, unless `editor` and `default` are given.
    """

    def __init__(
        self,
        draft: Draft,
        place: KeyPath,
        editor: Editor | None = None,
        *,
        name: str = "",
        width: int = EDITOR,
        hint: Words = "",
        default: Any = None,
    ) -> None:
        super().__init__()
        key, info = str(place[-1]), editing.field_of(draft.kind, place)
        self.editor = editor or _make_editor(info, key)
        #: Key paths whose problems are shown here.
        self.places: tuple[KeyPath, ...] = (place,)
        #: Warning about a valid but unlikely value; its text is "" if there is none.
        self.advice: Words = ""
        self._draft, self._place = draft, place
        about = f"setting.about_{key}"
        self._hint = hint or (about if known(about) else "")
        self._default = info.get_default() if default is None and info and not info.is_required() else default
        joined = "_".join(map(str, place))
        self.editor.setObjectName(f"{joined}_edit")
        words = f"setting.{name or key}"
        self.label = label(words, wrap=True, buddy=self.editor)
        self.label.setFixedWidth(LABEL)
        bind(self.editor.setAccessibleName, words)
        self._message = label(name=f"{joined}_message", wrap=True)
        self._message.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Minimum)
        unit = label(kind="muted")
        unit.setText(_UNITS.get(key) or _UNITS_BY_END.get(key.rpartition("_")[2], ""))
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(2 * theme.GRID)
        grid.setVerticalSpacing(2)
        for number, widget in enumerate((self.label, self.editor, unit)):
            grid.addWidget(widget, 0, number)
        grid.addWidget(self._message, 1, 1, 1, 2)
        grid.setColumnStretch(2, 1)
        self.editor.setFixedWidth(width)
        self.setMinimumWidth(LABEL + width + _UNIT + 3 * theme.GRID)
        self.editor.typed.connect(lambda: draft.set({place: self.editor.value()}))
        draft.changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def hide_label(self, words: Words) -> None:
        """Hide the label in a table of fields with headings; `words` is the input's name for screen readers."""
        self.label.hide()
        self.setFixedWidth(self.editor.maximumWidth() + _UNIT)
        bind(self.editor.setAccessibleName, words)

    def refresh(self) -> None:
        """Show the value and the message from the draft."""
        value = self._draft.value(self._place)
        self.editor.show_value(self._default if value is None else value)
        problem = next((p for p in self._draft.problems if self._is_mine(p.place)), None)
        wrong = problem is not None
        if problem is not None:
            kind, text = "error", problem_text(problem)
        elif text := say(self.advice):
            kind = "caution"
        else:
            kind, text = "muted", say(self._hint)
        show_text(self._message, text)
        if self._message.property("kind") != kind:
            theme.set_kind(self._message, kind)
        if self.editor.property("wrong") != wrong:
            self.editor.setProperty("wrong", wrong)
            self.editor.style().polish(self.editor)
        self.editor.setAccessibleDescription(text)

    def _is_mine(self, place: KeyPath) -> bool:
        """Return whether a problem at this key path is shown here; a list also shows its elements' problems."""
        return place in self.places or (place[:-1] == self._place and isinstance(place[-1], int))


class Row(QWidget):
    """A label and an input that is not bound to a single value; `name` selects the label in the family ``setting``."""

    def __init__(self, editor: QWidget, name: str = "") -> None:
        super().__init__()
        self.editor = editor
        caption = label(f"setting.{name}" if name else "", wrap=True, buddy=editor)
        caption.setFixedWidth(LABEL)
        editor.setFixedWidth(EDITOR)
        row(caption, editor, None, on=self, spacing=2 * theme.GRID)


class Section(QWidget):
    """A part of the page that consists of fields and rows."""

    def lock(self, reason: str) -> None:
        """Disable the inputs of all fields and rows, with `reason` as their tooltip; "" enables them."""
        for field in self.findChildren(Field):
            enable(field.editor, reason)
        for each in self.findChildren(Row):
            enable(each.editor, reason)


def panel(*items: Item, spacing: int = theme.GRID) -> QWidget:
    """Create a framed panel of these items that is only as high as its contents."""
    frame = QFrame()
    frame.setProperty("kind", "panel")
    wide = 2 * theme.GRID
    column(*items, None, on=frame, spacing=spacing, margins=(wide, wide, wide, wide))
    made = QWidget()
    column(frame, None, on=made)
    return made


def problem_text(problem: Problem) -> str:
    """Return the text of a problem for display below its field."""
    codes = (f"field.{problem.what.code.replace('.', '_')}", f"field.{problem.kind}")
    code = next(filter(known, codes), None)
    return say(code, **problem.values) if code else say(problem.what)


def problem_text_with_name(problem: Problem) -> str:
    """Return the text of a problem with the name of its field, for display apart from the field."""
    if known(f"field.{problem.kind}") and problem.place:
        return f"{problem.name}: {problem_text(problem)}"
    return say(problem.as_text)


def choices_of(name: str, *values: Any) -> Callable[[], list[tuple[Any, str]]]:
    """Return a function that lists values with their names from the catalogue family ``setting``, numbers as digits."""
    return lambda: [(v, f"{v:g}" if isinstance(v, float | int) else say(f"setting.{name}_{v}")) for v in values]


def _make_editor(info: FieldInfo | None, name: str) -> Editor:
    """Create an input for the type of a field; a number input without a schema."""
    kind = info.annotation if info is not None else float
    if get_origin(kind) is Literal:
        return ChoiceBox(choices_of(name, *get_args(kind)))
    if get_origin(kind) is list:
        return VectorEdit()
    return WordEdit() if kind is str else NumberEdit()
