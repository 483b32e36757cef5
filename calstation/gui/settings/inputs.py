"""The inputs of fields: numbers, words, choices and vectors; each tells `typed` and gives and shows its value."""

from collections.abc import Callable, Sequence
from typing import Any

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtGui import QWheelEvent
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QLineEdit, QWidget

from calstation.gui.widgets import theme


def number_of(text: str) -> int | float | str | None:
    """What was typed into a number's input: a number, None for nothing, else the text for the check to refuse."""
    text = text.strip()
    if not text:
        return None
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def shown(value: Any) -> str:
    """A value as it stands in its input."""
    if value is None:
        return ""
    return format(value, ".12g") if isinstance(value, float) else str(value)


def line_of(box: QComboBox) -> QLineEdit:
    """The line of an editable box."""
    line = box.lineEdit()
    assert line is not None
    return line


class StillBox(QComboBox):
    """A box that a turn of the wheel over it scrolls past: settings do not change by the way."""

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Leave the wheel to the page."""
        event.ignore()


class NumberEdit(QLineEdit):
    """A number, right aligned; empty means none."""

    typed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.textEdited.connect(self.typed)

    def value(self) -> Any:
        """What was typed."""
        return number_of(self.text())

    def show_value(self, value: Any) -> None:
        """Show a value, unless the text says it already: 1.50 stays as it was typed."""
        if not self.hasFocus() or number_of(self.text()) != value:
            self.setText(shown(value))


class WordEdit(QLineEdit):
    """A text; empty means none."""

    typed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.textEdited.connect(self.typed)

    def value(self) -> Any:
        """What was typed."""
        return self.text() or None

    def show_value(self, value: Any) -> None:
        """Show a value."""
        if self.text() != shown(value):
            self.setText(shown(value))


class ChoiceBox(StillBox):
    """One of some values, each with words."""

    typed = Signal()

    def __init__(self, choices: Callable[[], Sequence[tuple[Any, str]]]) -> None:
        super().__init__()
        self._choices = choices
        self.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.activated.connect(self.typed)
        self.fill()

    def fill(self) -> None:
        """Offer the choices again, in the language in force."""
        chosen = self.currentData()
        with QSignalBlocker(self):
            self.clear()
            for value, words in self._choices():
                self.addItem(words, value)
            self.show_value(chosen)

    def showPopup(self) -> None:
        """Offer what there is at this moment: files come and go beside the window."""
        self.fill()
        super().showPopup()

    def value(self) -> Any:
        """What is chosen."""
        return self.currentData()

    def show_value(self, value: Any) -> None:
        """Choose a value; one that is not offered is shown as it is."""
        index = next((i for i in range(self.count()) if self.itemData(i) == value), -1)
        if index < 0 and value is not None:
            self.addItem(str(value), value)
            index = self.count() - 1
        self.setCurrentIndex(index)


class NumberBox(StillBox):
    """A number, typed or one of the usual ones."""

    typed = Signal()

    def __init__(self, usual: Sequence[int]) -> None:
        super().__init__()
        self.setEditable(True)
        self.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)
        for number in usual:
            self.addItem(str(number), number)
        line_of(self).textEdited.connect(self.typed)
        self.activated.connect(self.typed)

    def value(self) -> Any:
        """What was typed or chosen."""
        return number_of(self.currentText())

    def show_value(self, value: Any) -> None:
        """Show a number, unless the text says it already."""
        if self.value() != value:
            self.setEditText(shown(value))


class VectorEdit(QWidget):
    """Three numbers; the value is a list."""

    typed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.edits = [NumberEdit() for _ in range(3)]
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.GRID // 2)
        for axis, edit in zip("xyz", self.edits, strict=True):
            edit.setAccessibleName(axis)
            edit.typed.connect(self.typed)
            row.addWidget(edit, 1)
        self.setFocusProxy(self.edits[0])

    def value(self) -> Any:
        """The numbers as typed."""
        return [number_of(edit.text()) if edit.text().strip() else "" for edit in self.edits]

    def show_value(self, value: Any) -> None:
        """Show a list of three."""
        parts: Sequence[Any] = value if isinstance(value, list) and len(value) == 3 else ("", "", "")
        for edit, part in zip(self.edits, parts, strict=True):
            if not edit.hasFocus() or number_of(edit.text()) != part:
                edit.setText(shown(part))
