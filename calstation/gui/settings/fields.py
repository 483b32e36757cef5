"""Fields, rows and panels of the sections, and inputs for addresses and ports."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import QFrame, QSizePolicy, QWidget

from calstation.config import editing, field_spec
from calstation.connection import SerialPortInfo
from calstation.gui.settings.drafts import Draft
from calstation.gui.text import Words, bind, on_language_change, say, term
from calstation.gui.widgets import (
    EditableBox,
    Editor,
    FormField,
    Item,
    TextEdit,
    ask_folder,
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


class AddressEdit(TextEdit):
    """An input for a host and a port number as ``host:port``; its value is ``scheme://host:port``."""

    def __init__(self, scheme: str, default_port: int) -> None:
        super().__init__()
        self._prefix, self._default_port = f"{scheme}://", str(default_port)
        bind(self.setPlaceholderText, Text.of("settings.host_placeholder", port=default_port))

    def value(self) -> Any:
        """Return the typed address, by default with the default port number."""
        text = self.text().strip()
        host, _, number = text.rpartition(":") if ":" in text else (text, "", "")
        return f"{self._prefix}{host}:{number or self._default_port}" if text else None

    def show_value(self, value: Any) -> None:
        """Show an address, unless it equals the typed one."""
        if value != self.value():
            self.setText(str(value or "").partition("://")[2])


class PortBox(EditableBox):
    """An input for a serial port; a USB adapter is identified by its serial number instead of its USB socket."""

    def __init__(self) -> None:
        super().__init__()
        self.setCompleter(None)  # type: ignore[arg-type]  # a completer could enter another port
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self._ports: Sequence[SerialPortInfo] = ()
        self.view().setMinimumWidth(56 * theme.GRID)
        bind(self.line.setPlaceholderText, "settings.port_placeholder")

    def show_ports(self, ports: Sequence[SerialPortInfo]) -> None:
        """List the ports of this computer."""
        self._ports = ports
        text = self.currentText()
        with QSignalBlocker(self):
            self.clear()
            for port in ports:
                if port.usb:
                    self.addItem(f"{port.usb}   {_describe(port)}", port.usb)
                self.addItem(port.device if port.usb else _describe(port), port.device)
            self.setCurrentIndex(-1)
            self.setEditText(text)

    def description(self) -> str:
        """Return the description of the adapter at the current port, or "" if there is none."""
        value = self.value()
        return next((_describe(port) for port in self._ports if value in (port.device, port.usb)), "")

    def choose(self, index: int) -> None:
        """Show the name of the selected port."""
        self.setEditText(str(self.itemData(index)))
        super().choose(index)


def _describe(port: SerialPortInfo) -> str:
    """Return the description of an adapter and the device name of its port."""
    maker = "" if port.maker in port.description else port.maker
    description = ", ".join(filter(None, (port.description, maker)))
    return f"{description} · {port.device}" if description else port.device


#: Widths of the label, the input and the unit of a field, px.
LABEL, EDITOR, _UNIT = 22 * theme.GRID, 30 * theme.GRID, 9 * theme.GRID
#: Headings under which the entries of a section of a file are edited.
_HEADINGS = {
    "table": "settings.link_to_table",
    "chamber": "settings.link_to_chamber",
    "imu": "settings.link_to_imu",
    "site": "settings.site",
    "records": "settings.shared_records",
    "laboratory": "settings.laboratory",
    "sign_in": "settings.operators",
    "accuracy": "settings.accuracy",
    "outer": "settings.outer_axis",
    "middle": "settings.middle_axis",
    "inner": "settings.inner_axis",
}
#: Width of the unit in a table of fields, px.
_SHORT_UNIT = 7 * theme.GRID


class Field(FormField):
    """A field of a configuration file, with its message below the input.

    The last key of `key_path` selects the label and the hint from the catalogue family ``setting``, unless `name` and
    `hint` are given. The schema of the value determines the input and the default, unless `editor` and `default` are
    given.
    """

    def __init__(
        self,
        draft: Draft,
        key_path: KeyPath,
        editor: Editor | None = None,
        *,
        name: str = "",
        width: int = EDITOR,
        hint: Words = "",
        default: Any = None,
    ) -> None:
        key, object_name = str(key_path[-1]), f"{'_'.join(map(str, key_path))}_edit"
        spec = field_spec(key, editing.field_of(draft.kind, key_path))
        editor = editor or make_input(spec, choices_of(key, *spec.choices))
        super().__init__(draft, key_path, editor, f"setting.{name or key}", object_name, spec.unit)
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

    def problem_text(self, problem: Problem) -> str:
        """Return the text of a problem; for a text with a wrong format, the hint, which describes the format."""
        hint = say(self.hint) if problem.kind == "string_pattern_mismatch" else ""
        return hint or super().problem_text(problem)

    def hide_label(self, heading: str) -> None:
        """Hide the label in a table of fields; `heading` is the catalogue code of the column."""
        self.label.hide()
        self.setFixedWidth(self.editor.maximumWidth() + _SHORT_UNIT)
        bind(self.editor.setAccessibleName, lambda: f"{say(heading)}, {term('setting', str(self._key_path[-1]))}")


class Row(QWidget):
    """A label with the term `name` of the family ``setting``, and a widget that does not edit a single value."""

    def __init__(self, editor: QWidget, name: str = "") -> None:
        super().__init__()
        self.editor = editor
        caption = label(f"setting.{name}" if name else "", wrap=True, buddy=editor)
        caption.setFixedWidth(LABEL)
        editor.setFixedWidth(EDITOR)
        row(caption, editor, None, on=self, spacing=2 * theme.GRID)


class Section(QWidget):
    """A section of the page with fields and rows that edit a draft; `connect_draft` is called after their creation."""

    def __init__(self, draft: Draft) -> None:
        super().__init__()
        self._draft = draft

    def connect_draft(self) -> None:
        """Refresh the section now and after each change of the draft or the language."""
        self._draft.changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def refresh(self) -> None:
        """Show the values of the draft."""

    def lock(self, reason: str) -> None:
        """Disable the inputs of all fields and rows and show `reason` in their tooltips; "" enables them."""
        for field in self.findChildren(Field):
            field.lock(reason)
        for each in self.findChildren(Row):
            enable(each.editor, reason)


def folder_row(name: str, draft: Draft, key_path: KeyPath) -> Row:
    """Create a row with a button that selects the folder at a key path of a draft."""

    def choose() -> None:
        title = say(f"setting.{key_path[-1]}")
        folder = Path(str(draft.value(key_path) or ""))
        ask_folder(folder_button, title, folder, lambda chosen: draft.set({key_path: str(chosen)}))

    folder_button = button(name, "settings.choose_folder", choose)
    return Row(folder_button)


def panel(*items: Item, spacing: int = theme.GRID) -> QWidget:
    """Create a framed panel of items, which is as high as its contents."""
    frame = QFrame()
    frame.setProperty("kind", "panel")
    wide = 2 * theme.GRID
    column(*items, None, on=frame, spacing=spacing, margins=(wide, wide, wide, wide))
    return box(frame, None)


def problem_text_with_name(problem: Problem, kind: str = "stations") -> str:
    """Return the text of a problem in a file of a kind with the label of its field, for display away from the field.

    An entry without a field, which is edited in the text of the file, is named as in the file.
    """
    has_fields = kind in ("stations", "tables") and problem.kind != "extra_forbidden"
    if has_fields and (name := _label_of(problem.key_path)):
        return say("form.problem", name=name, what=problem_text(problem))
    if known(f"field.{problem.kind}") and problem.key_path:
        return f"{problem.name}: {problem_text(problem)}"
    return say(problem.as_text)


def _label_of(key_path: KeyPath) -> str:
    """Return the labels of a section and its field, or "" if no field edits the entry."""
    if len(key_path) not in (1, 2) or not all(isinstance(key, str) for key in key_path):
        return ""
    *sections, field = key_path
    if not known(f"setting.{field}"):
        return ""
    heading = _HEADINGS.get(str(sections[0])) if sections else None
    return say("form.cell", row=say(heading), column=say(f"setting.{field}")) if heading else say(f"setting.{field}")
