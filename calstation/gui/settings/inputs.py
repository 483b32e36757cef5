"""Inputs for numbers, words, choices, vectors, addresses and ports: each emits `typed` and has a value."""

from collections.abc import Callable, Sequence
from typing import Any

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtGui import QWheelEvent
from PySide6.QtWidgets import QComboBox, QLineEdit, QSizePolicy, QWidget

from calstation.connection import FoundPort
from calstation.gui.text import bind, on_language_change
from calstation.gui.widgets import row, theme


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
