"""Inputs for one value each, and forms made of them from the schema of a configuration file."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtGui import QWheelEvent
from PySide6.QtWidgets import QComboBox, QFrame, QGridLayout, QLineEdit, QSizePolicy, QWidget

from calstation.config import editing
from calstation.connection import FoundPort
from calstation.gui.settings.drafts import Draft
from calstation.gui.text import bind, on_language_change, say, show, term
from calstation.gui.widgets import Item, Words, column, enable, label, row, theme
from calstation.messages import known
from calstation.schema import KeyPath, Problem, field_name


class WordEdit(QLineEdit):
    """A text; empty means none."""

    typed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.textEdited.connect(self.typed)

    def value(self) -> Any:
        """The text typed."""
        return self.text() or None

    def show_value(self, value: Any) -> None:
        """Show a value; a focused text of the same value stays as typed, such as 1.50."""
        if not self.hasFocus() or self.value() != value:
            self.setText(_shown(value))


class NumberEdit(WordEdit):
    """A number, right aligned; empty means none."""

    def __init__(self) -> None:
        super().__init__()
        self.setAlignment(Qt.AlignmentFlag.AlignRight)

    def value(self) -> Any:
        """The number typed."""
        return _number(self.text())


class VectorEdit(QWidget):
    """Three numbers; the value is a list."""

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
        """The numbers as typed."""
        return [_number(edit.text()) if edit.text().strip() else "" for edit in self.edits]

    def show_value(self, value: Any) -> None:
        """Show a list of three."""
        parts: Sequence[Any] = value if isinstance(value, list) and len(value) == 3 else ("", "", "")
        for edit, part in zip(self.edits, parts, strict=True):
            edit.show_value(part)


class AddressEdit(WordEdit):
    """Host and port number as ``host:port``; the value is ``scheme://host:port``."""

    def __init__(self, scheme: str, default_port: int) -> None:
        super().__init__()
        self._prefix, self._default_port = f"{scheme}://", str(default_port)
        bind(self.setPlaceholderText, lambda: self.tr("name or IP address") + f":{default_port}")

    def value(self) -> Any:
        """The address typed, with the default port number if none is."""
        text = self.text().strip()
        host, _, number = text.rpartition(":") if ":" in text else (text, "", "")
        return f"{self._prefix}{host}:{number or self._default_port}" if text else None

    def show_value(self, value: Any) -> None:
        """Show an address, unless it is the one typed."""
        if value != self.value():
            self.setText(str(value or "").partition("://")[2])


class _Box(QComboBox):
    """A combo box that ignores the mouse wheel, so that scrolling the page changes no setting."""

    typed = Signal()

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Leave the wheel to the page."""
        event.ignore()


class ChoiceBox(_Box):
    """One of several values; `choices` gives them with their texts in the current language."""

    def __init__(self, choices: Callable[[], Sequence[tuple[Any, str]]], name: str = "") -> None:
        super().__init__()
        self.setObjectName(name)
        self._choices = choices
        self.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.activated.connect(self.typed)
        on_language_change(self, self.fill)

    def fill(self) -> None:
        """Offer the present choices."""
        chosen = self.currentData()
        with QSignalBlocker(self):
            self.clear()
            for value, text in self._choices():
                self.addItem(text, value)
            self.show_value(chosen)

    def showPopup(self) -> None:
        """Offer the present choices: files may have come or gone outside the window."""
        self.fill()
        super().showPopup()

    def value(self) -> Any:
        """The value chosen."""
        return self.currentData()

    def show_value(self, value: Any) -> None:
        """Choose a value; one that is not offered is added."""
        index = next((i for i in range(self.count()) if self.itemData(i) == value), -1)
        if index < 0 and value is not None:
            self.addItem(str(value), value)
            index = self.count() - 1
        self.setCurrentIndex(index)


class _EditableBox(_Box):
    """A value typed or chosen."""

    def __init__(self) -> None:
        super().__init__()
        self.setEditable(True)
        self.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)
        line = self.lineEdit()
        assert line is not None
        self.line: QLineEdit = line
        self.line.textEdited.connect(self.typed)

    def value(self) -> Any:
        """The text typed or chosen."""
        return self.currentText().strip() or None

    def show_value(self, value: Any) -> None:
        """Show a value, unless the text has it."""
        if self.value() != value:
            self.setEditText(_shown(value))


class NumberBox(_EditableBox):
    """A number, typed or chosen among common ones."""

    def __init__(self, common: Sequence[int]) -> None:
        super().__init__()
        self.addItems([str(number) for number in common])
        self.activated.connect(self.typed)

    def value(self) -> Any:
        """The number typed or chosen."""
        return _number(self.currentText())


class PortBox(_EditableBox):
    """A serial port, typed or chosen; a USB adapter is chosen by its serial number, whatever socket it is in."""

    def __init__(self) -> None:
        super().__init__()
        self.setCompleter(None)  # type: ignore[arg-type]  # completion would choose a port that was not meant
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self._ports: Sequence[FoundPort] = ()
        self.activated.connect(self._chosen)
        self.view().setMinimumWidth(56 * theme.GRID)
        bind(self.line.setPlaceholderText, lambda: self.tr("choose or type a port"))

    def offer(self, ports: Sequence[FoundPort]) -> None:
        """Offer the ports found."""
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
        """The adapter at the port shown, "" if it was not found."""
        value = self.value()
        return next((_describe(port) for port in self._ports if value in (port.device, port.usb)), "")

    def _chosen(self, index: int) -> None:
        self.setEditText(str(self.itemData(index)))
        self.typed.emit()


#: Every input that a field may have.
Editor = WordEdit | VectorEdit | ChoiceBox | NumberBox | PortBox


def _number(text: str) -> int | float | str | None:
    """The number typed, None for nothing, or the text itself, which the check refuses."""
    text = text.strip()
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text or None


def _shown(value: Any) -> str:
    if value is None:
        return ""
    return format(value, ".12g") if isinstance(value, float) else str(value)


def _describe(port: FoundPort) -> str:
    """The adapter's description and the system's present name of its port."""
    maker = "" if port.maker in port.description else port.maker
    about = ", ".join(filter(None, (port.description, maker)))
    return f"{about} · {port.device}" if about else port.device


#: Widths of a field's label, of its input, and of the unit beside it, px.
LABEL, EDITOR, _UNIT = 22 * theme.GRID, 30 * theme.GRID, 9 * theme.GRID

#: Units by names of fields, and by the ends of names.
_UNITS = {"velocity_sigma": "m/s", "speed": "×"}
_UNITS_BY_END = {"deg": "°", "dps": "°/s", "dps2": "°/s²", "m": "m", "mps2": "m/s²", "s": "s"}


class Field(QWidget):
    """Label, input, unit and, beneath, what is wrong or what the value means.

    The key names label and hint in the catalogue family ``setting``, unless `name` and `hint` are given; the type that
    the schema has for the value chooses the input, and the schema its default, unless `editor` and `default` are given.
    """

    def __init__(
        self,
        draft: Draft,
        place: KeyPath,
        editor: Editor | None = None,
        *,
        name: str = "",
        width: int = EDITOR,
        hint: Words | None = None,
        default: Any = None,
    ) -> None:
        super().__init__()
        key, info = str(place[-1]), _schema(draft.kind, place)
        self.editor = editor or _make_editor(info, key)
        #: Places whose problems are shown here.
        self.places: tuple[KeyPath, ...] = (place,)
        #: Warns of an allowed but unlikely value; gives "" if there is nothing to warn of.
        self.advice: Words = str
        self._draft, self._place = draft, place
        about = f"setting.about_{key}"
        self._hint = hint or (partial(say, about) if known(about) else str)
        self._default = info.get_default() if default is None and info and not info.is_required() else default
        joined = "_".join(map(str, place))
        self.editor.setObjectName(f"{joined}_edit")
        words = partial(term, "setting", name or key)
        self.label = label(words, wrap=True, buddy=self.editor)
        self.label.setFixedWidth(LABEL)
        bind(self.editor.setAccessibleName, words)
        self._message = label(name=f"{joined}_message", wrap=True)
        self._message.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Minimum)
        unit = _UNITS.get(key) or _UNITS_BY_END.get(key.rpartition("_")[2], "")
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(2 * theme.GRID)
        grid.setVerticalSpacing(2)
        for number, widget in enumerate((self.label, self.editor, label(lambda: unit, "muted"))):
            grid.addWidget(widget, 0, number)
        grid.addWidget(self._message, 1, 1, 1, 2)
        grid.setColumnStretch(2, 1)
        self.editor.setFixedWidth(width)
        self.setMinimumWidth(LABEL + width + _UNIT + 3 * theme.GRID)
        self.editor.typed.connect(lambda: draft.set({place: self.editor.value()}))
        draft.changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def hide_label(self, words: Words) -> None:
        """Leave the label to the headings of a table of fields; `words` name the input for a screen reader."""
        self.label.hide()
        self.setFixedWidth(self.editor.maximumWidth() + _UNIT)
        bind(self.editor.setAccessibleName, words)

    def refresh(self) -> None:
        """Show value and message of the draft."""
        value = self._draft.value(self._place)
        self.editor.show_value(self._default if value is None else value)
        problem = next((p for p in self._draft.problems if self._is_mine(p.place)), None)
        wrong = problem is not None
        if problem is not None:
            kind, text = "error", problem_text(problem)
        elif text := self.advice():
            kind = "caution"
        else:
            kind, text = "muted", self._hint()
        self._message.setText(text)
        self._message.setVisible(bool(text))
        if self._message.property("kind") != kind:
            theme.set_kind(self._message, kind)
        if self.editor.property("wrong") != wrong:
            self.editor.setProperty("wrong", wrong)
            self.editor.style().polish(self.editor)
        self.editor.setAccessibleDescription(text)

    def _is_mine(self, place: KeyPath) -> bool:
        """Whether a problem of this place is shown here; a list shows those of its elements."""
        return place in self.places or (place[:-1] == self._place and isinstance(place[-1], int))


class Row(QWidget):
    """A label, named as in the catalogue family ``setting`` or "", and an input that belongs to no single value."""

    def __init__(self, editor: QWidget, name: str = "") -> None:
        super().__init__()
        self.editor = editor
        caption = label(partial(term, "setting", name) if name else str, wrap=True, buddy=editor)
        caption.setFixedWidth(LABEL)
        editor.setFixedWidth(EDITOR)
        row(caption, editor, None, on=self, spacing=2 * theme.GRID)


class Section(QWidget):
    """A part of the page, made of fields and rows."""

    def lock(self, reason: str) -> None:
        """Disable the inputs of all fields and rows with the reason as their tooltip; "" enables them."""
        for field in self.findChildren(Field):
            enable(field.editor, reason)
        for each in self.findChildren(Row):
            enable(each.editor, reason)


def panel(*items: Item, spacing: int = theme.GRID) -> QWidget:
    """Make a framed panel of these items, as high as they need."""
    frame = QFrame()
    frame.setProperty("kind", "panel")
    wide = 2 * theme.GRID
    column(*items, None, on=frame, spacing=spacing, margins=(wide, wide, wide, wide))
    made = QWidget()
    column(frame, None, on=made)
    return made


def problem_text(problem: Problem) -> str:
    """The sentence for a problem beneath its field."""
    code = f"field.{problem.kind}"
    return say(code, **problem.values) if known(code) else show(problem.what)


def problem_text_with_name(problem: Problem) -> str:
    """The sentence for a problem away from its field, with the field's name."""
    if known(f"field.{problem.kind}") and problem.place:
        return f"{field_name(problem.place)}: {problem_text(problem)}"
    return show(problem.as_text)


def choices_of(name: str, *values: Any) -> Callable[[], list[tuple[Any, str]]]:
    """The values of a choice with their names in the catalogue family ``setting``; numbers as they are."""
    return lambda: [(v, f"{v:g}" if isinstance(v, float | int) else term("setting", f"{name}_{v}")) for v in values]


def _schema(kind: str, place: KeyPath) -> FieldInfo | None:
    """The schema's field at a place, None for a place below a table without a schema."""
    model: type[BaseModel] | None = editing.MODELS[kind]
    info = None
    for key in place:
        if model is None:
            return None
        info = model.model_fields[str(key)]
        types = (info.annotation, *get_args(info.annotation))
        model = next((t for t in types if isinstance(t, type) and issubclass(t, BaseModel)), None)
    return info


def _make_editor(info: FieldInfo | None, name: str) -> Editor:
    """An input for the type of a field; numbers without a schema."""
    kind = info.annotation if info is not None else float
    if get_origin(kind) is Literal:
        return ChoiceBox(choices_of(name, *get_args(kind)))
    if get_origin(kind) is list:
        return VectorEdit()
    return WordEdit() if kind is str else NumberEdit()
