"""Fields of the configuration files, inputs for addresses and ports, and rows and panels of the sections."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import QFileDialog, QFrame, QSizePolicy, QWidget

from calstation.config import editing, field_spec
from calstation.connection import SerialPortInfo
from calstation.gui.settings.drafts import Draft
from calstation.gui.text import Words, bind, on_language_change, say
from calstation.gui.widgets import (
    EditableBox,
    Editor,
    FormField,
    Item,
    WordEdit,
    box,
    button,
    choices_of,
    column,
    enable,
    label,
    make_input,
    problem_text,
    row,
    theme,
)
from calstation.messages import Text, known
from calstation.schema import KeyPath, Problem


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


class PortBox(EditableBox):
    """A serial port, typed or selected; a USB adapter is identified by its serial number, not by its USB socket."""

    def __init__(self) -> None:
        super().__init__()
        self.setCompleter(None)  # type: ignore[arg-type]  # completion could select an unintended port
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self._ports: Sequence[SerialPortInfo] = ()
        self.view().setMinimumWidth(56 * theme.GRID)
        bind(self.line.setPlaceholderText, "settings.port_placeholder")

    def offer(self, ports: Sequence[SerialPortInfo]) -> None:
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

    def choose(self, index: int) -> None:
        """Use the name of the selected port."""
        self.setEditText(str(self.itemData(index)))
        super().choose(index)


def _describe(port: SerialPortInfo) -> str:
    """Return the description of an adapter and the current device name of its port."""
    maker = "" if port.maker in port.description else port.maker
    about = ", ".join(filter(None, (port.description, maker)))
    return f"{about} · {port.device}" if about else port.device


#: Widths of the label, the input and the unit of a field, px.
LABEL, EDITOR, _UNIT = 22 * theme.GRID, 30 * theme.GRID, 9 * theme.GRID


class Field(FormField):
    """A field of a configuration file; the message stands below the input.

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
        key = str(place[-1])
        spec = field_spec(key, editing.field_of(draft.kind, place))
        editor = editor or make_input(spec, choices_of(key, *spec.choices))
        super().__init__(draft, place, editor, f"setting.{name or key}", f"{'_'.join(map(str, place))}_edit", spec.unit)
        about = f"setting.about_{key}"
        self.hint = hint or (about if known(about) else "")
        self.default = spec.default if default is None else default
        theme.set_kind(self.unit, "muted")
        self.label.setFixedWidth(LABEL)
        self.message.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Minimum)
        for number, widget in enumerate((self.label, self.editor, self.unit)):
            self.grid.addWidget(widget, 0, number)
        self.grid.addWidget(self.message, 1, 1, 1, 2)
        self.grid.setColumnStretch(2, 1)
        self.editor.setFixedWidth(width)
        self.setMinimumWidth(LABEL + width + _UNIT + 3 * theme.GRID)
        self.refresh()

    def hide_label(self, words: Words) -> None:
        """Hide the label in a table of fields with headings; `words` is the input's name for screen readers."""
        self.label.hide()
        self.setFixedWidth(self.editor.maximumWidth() + _UNIT)
        bind(self.editor.setAccessibleName, words)


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
    """A part of the page that consists of fields and rows of a draft; subclasses call `follow` last."""

    def __init__(self, draft: Draft) -> None:
        super().__init__()
        self._draft = draft

    def follow(self, draft: Draft) -> None:
        """Refresh the section after each change of the draft or the language, and now."""
        draft.changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def refresh(self) -> None:
        """Show the draft."""

    def lock(self, reason: str) -> None:
        """Disable the inputs of all fields and rows, with `reason` as their tooltip; "" enables them."""
        for field in self.findChildren(Field):
            field.lock(reason)
        for each in self.findChildren(Row):
            enable(each.editor, reason)


def folder_row(name: str, draft: Draft, place: KeyPath) -> Row:
    """Create a row with a button to choose the folder at a key path of a draft."""

    def choose() -> None:
        title = say(f"setting.{place[-1]}")
        if folder := QFileDialog.getExistingDirectory(made, title, str(draft.value(place) or "")):
            draft.set({place: str(Path(folder))})

    made = Row(button(name, "settings.choose_folder", choose))
    return made


def panel(*items: Item, spacing: int = theme.GRID) -> QWidget:
    """Create a framed panel of these items that is only as high as its contents."""
    frame = QFrame()
    frame.setProperty("kind", "panel")
    wide = 2 * theme.GRID
    column(*items, None, on=frame, spacing=spacing, margins=(wide, wide, wide, wide))
    return box(frame, None)


def problem_text_with_name(problem: Problem) -> str:
    """Return the text of a problem with the name of its field, for display apart from the field."""
    if known(f"field.{problem.kind}") and problem.place:
        return f"{problem.name}: {problem_text(problem)}"
    return say(problem.as_text)
