"""Inputs for single values, with a signal `typed` for edits by the user and the methods `value` and `show_value`."""

import re
from collections.abc import Callable, Sequence
from typing import Any

from PySide6.QtCore import QLocale, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QMouseEvent, QPaintEvent, QShowEvent, QValidator, QWheelEvent
from PySide6.QtWidgets import QAbstractSpinBox, QCheckBox, QComboBox, QDoubleSpinBox, QLineEdit, QWidget

from calstation.escaping import for_file_name
from calstation.gui.text import on_language_change, with_minus, without_minus
from calstation.gui.widgets import theme
from calstation.gui.widgets.layout import row
from calstation.messages import Text
from calstation.physics import from_unit, in_unit


class TextEdit(QLineEdit):
    """A text input; an empty text means no value."""

    typed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.textEdited.connect(self.typed)

    def value(self) -> Any:
        """Return the typed text, or None if it is empty."""
        return self.text() or None

    def show_value(self, value: Any) -> None:
        """Show a value; an equivalent text, such as 1.50, is not replaced while the input has the focus."""
        if not self.hasFocus() or self.value() != value:
            self.setText(_value_text(value))


#: Minimum length of a serial number that is recognised next to another one.
_MIN_NUMBER = 3
#: Minimum length of a number whose repetition counts as two scans even if the whole text is a valid number.
_MIN_REPEATED = 6
#: End of the certificate number on a label after the serial number: the slot of a unit of a batch, and the time.
_AFTER_SERIAL = re.compile(r"_(.+_)?\d{8}T")


class ScanEdit(QLineEdit):
    """An input for scans: a click selects the whole text, which a scan then replaces instead of extending it.

    The scan of a label, which contains the serial number and the certificate number, enters the serial number.
    """

    def __init__(self, name: str, *, longest: int = 160) -> None:
        super().__init__()
        self.setObjectName(name)
        self.setMaxLength(longest)
        #: Number in the field to which characters may have been added.
        self._number = ""
        self._edited = False
        self.textEdited.connect(self._note_edit)
        self.textChanged.connect(self._note_change)
        self.returnPressed.connect(self._extract_number)

    def begin(self, text: str) -> None:
        """Replace the text with the first character of a scan."""
        self.setText(text)
        self._number = ""

    def keep(self) -> None:
        """Treat the text as a complete serial number."""
        self._number = self.text().strip()

    def holds_two(self, valid: Callable[[str], bool]) -> bool:
        """Return whether the text consists of two serial numbers that `valid` accepts, with or without a space.

        If the whole text is also valid, one of them must be the previous number, or both must be the same long number.
        """
        text = self.text().strip()
        splits = range(_MIN_NUMBER, len(text) - _MIN_NUMBER + 1)
        pairs = [(text[:at].strip(), text[at:].strip()) for at in splits]
        found = [pair for pair in pairs if all(len(part) >= _MIN_NUMBER and valid(part) for part in pair)]
        same = any(first == second and len(first) >= _MIN_REPEATED for first, second in found)
        return bool(found) and (not valid(text) or same or any(self._number in pair for pair in found))

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """Select the text unless a part of it has been selected."""
        super().mouseReleaseEvent(event)
        if not self.hasSelectedText():
            self.selectAll()

    def _extract_number(self) -> None:
        if serial := _serial_on_label(self.text().strip()):
            self.setText(serial)

    def _note_edit(self, _: str) -> None:
        self._edited = True

    def _note_change(self, text: str) -> None:
        edited, self._edited = self._edited, False
        if not edited:
            self.keep()
        elif not (text.startswith(self._number) or text.endswith(self._number)):
            self._number = ""


def _serial_on_label(content: str) -> str:
    """Return the serial number in the content of the code of a label, or "" if the text is not from a label.

    It is followed by a space and the certificate number, the name of the log, which begins with the serial number.
    """
    words = content.split(" ")
    pairs = [(" ".join(words[:at]), " ".join(words[at:])) for at in range(1, len(words))]
    return next((serial for serial, number in pairs if _is_certificate(number, serial)), "")


def _is_certificate(number: str, serial: str) -> bool:
    name = for_file_name(serial)
    return number.startswith(name) and _AFTER_SERIAL.match(number, len(name)) is not None


class NumberEdit(TextEdit):
    """A right-aligned number input in a display unit, whose size in SI is `size`; an empty text means no value.

    `read` converts the text to a number, None, or the text itself, which the validation rejects.
    """

    def __init__(self, size: float = 1.0, read: Callable[[str], Any] | None = None) -> None:
        super().__init__()
        self._size, self._read = size, read or typed_number
        #: The last shown text and its exact value, which is returned as long as the text is unchanged.
        self._exact: tuple[str, Any] = ("", None)
        self.setAlignment(Qt.AlignmentFlag.AlignRight)

    def value(self) -> Any:
        """Return the typed number, None for an empty text, or the text itself if it is not a number."""
        text, exact = self._exact
        if text == self.text():
            return exact if text else None
        number = self._read(self.text())
        return from_unit(number, self._size) if self._size != 1.0 and isinstance(number, float | int) else number

    def show_value(self, value: Any) -> None:
        """Show a value; while the input has the focus, an equivalent text is not replaced."""
        if self._size == 1.0 or not isinstance(value, float | int):
            super().show_value(value)
        elif value != self.value():
            self._exact = with_minus(in_unit(value, self._size)), value
            self.setText(self._exact[0])


class CountEdit(NumberEdit):
    """An input for an integer between two limits; it accepts any text, and `check` explains what is wrong with it.

    `words` is the code of its caption.
    """

    def __init__(self, name: str, words: str, low: int, high: int, value: int) -> None:
        super().__init__()
        self.setObjectName(name)
        self._words, self._limits = words, (low, high)
        self.setText(str(value))
        self.setFixedWidth(10 * theme.GRID)
        self.typed.connect(lambda: theme.set_invalid(self, invalid=False))

    def check(self) -> Text | None:
        """Mark a text that is not an integer between the limits until it is edited, and return why; otherwise None."""
        number, (low, high) = self.value(), self._limits
        valid = isinstance(number, int) and low <= number <= high
        theme.set_invalid(self, invalid=not valid)
        if valid:
            return None
        what = Text(self._words)
        return Text.of("form.wrong_count", what=what, typed=self.text().strip(), low=low, high=high)


class VectorEdit(QWidget):
    """Number inputs for the components of a vector with these accessible names; the value is a list."""

    typed = Signal()

    def __init__(self, components: Sequence[str] = "xyz") -> None:
        super().__init__()
        self.edits = [NumberEdit() for _ in components]
        row(*((edit, 1) for edit in self.edits), on=self, spacing=theme.GRID // 2)
        for component, edit in zip(components, self.edits, strict=True):
            edit.setAccessibleName(component)
            edit.typed.connect(self.typed)
        self.setFocusProxy(self.edits[0])

    def value(self) -> Any:
        """Return the typed numbers."""
        return [typed_number(edit.text()) if edit.text().strip() else "" for edit in self.edits]

    def show_value(self, value: Any) -> None:
        """Show a list or tuple of as many numbers."""
        is_vector = isinstance(value, list | tuple) and len(value) == len(self.edits)
        parts: Sequence[Any] = value if is_vector else [""] * len(self.edits)
        for edit, part in zip(self.edits, parts, strict=True):
            edit.show_value(part)


class FlagBox(QCheckBox):
    """A check box; its value is True or False."""

    typed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.toggled.connect(lambda _: self.typed.emit())

    def value(self) -> bool:
        """Return whether the box is checked."""
        return self.isChecked()

    def show_value(self, value: Any) -> None:
        """Check the box or clear it."""
        self.setChecked(bool(value))


class LimitedSpin(QDoubleSpinBox):
    """A number input without buttons; if a wrong text is entered, it keeps its value and emits `rejected(text)`.

    Any text can be typed, because ignoring a digit would change the number. A rejected text remains in the input until
    it is corrected, so that nobody mistakes the value for the entered number; then `rejected("")` is emitted.
    """

    rejected = Signal(str)

    def __init__(self, low: float, high: float, decimals: int) -> None:
        super().__init__()
        self.setLocale(QLocale.c())
        self.setDecimals(decimals)
        self.setRange(low, high)
        self.setKeyboardTracking(False)
        self.setButtonSymbols(QAbstractSpinBox.ButtonSymbols.NoButtons)
        self.setAlignment(Qt.AlignmentFlag.AlignRight)
        #: Text that has been typed but not accepted, and the text that has been rejected.
        self._entered = self.wrong = ""
        self.lineEdit().textEdited.connect(self._note_text)
        self.editingFinished.connect(self._check_entered)

    def validate(self, text: str, position: int) -> Any:
        """Return whether a text is acceptable; other texts can be typed but not entered."""
        state, *others = super().validate(text, position)
        invalid = state == QValidator.State.Invalid
        return (QValidator.State.Intermediate if invalid else state, *others)

    def setValue(self, value: float) -> None:
        """Show a value instead of a rejected text."""
        self._note_text("")
        super().setValue(value)

    def stepBy(self, steps: int) -> None:
        """Change the value by a number of steps."""
        self._note_text("")
        super().stepBy(steps)

    def setSpecialValueText(self, text: str) -> None:
        """Set the text of the smallest value, but keep a rejected text, which Qt would replace."""
        super().setSpecialValueText(text)
        self._check_entered()

    def showEvent(self, event: QShowEvent) -> None:
        """Keep a rejected text, which Qt would replace."""
        super().showEvent(event)
        self._check_entered()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Paint the input, with a red border around a rejected text."""
        super().paintEvent(event)
        theme.paint_invalid_border(self)

    def _note_text(self, text: str) -> None:
        corrected, self._entered, self.wrong = bool(self.wrong), text, ""
        if corrected:
            theme.set_invalid(self, invalid=False)
            self.rejected.emit("")

    def _check_entered(self) -> None:
        text, self._entered = self._entered.strip(), ""
        if text and self.validate(text, len(text))[0] != QValidator.State.Acceptable:
            self._entered = self.wrong = text
            self.lineEdit().setText(text)
            theme.set_invalid(self, invalid=True)
            self.rejected.emit(text)


class SpinEdit(LimitedSpin):
    """A number input of a form that accepts only numbers between two limits."""

    typed = Signal()

    def __init__(self, low: float, high: float, step: float, decimals: int) -> None:
        super().__init__(low, high, decimals)
        self.setSingleStep(step)
        self.setMinimumWidth(11 * theme.GRID)
        self.valueChanged.connect(lambda _: self.typed.emit())

    def show_value(self, value: Any) -> None:
        """Show a number."""
        if value != self.value():
            self.setValue(value)


class _Box(QComboBox):
    """A combo box that ignores the mouse wheel, so that scrolling the page does not change a setting."""

    typed = Signal()

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Pass the event on to the page."""
        event.ignore()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Paint the box, with a red border while its value is wrong."""
        super().paintEvent(event)
        theme.paint_invalid_border(self)


class ChoiceBox(_Box):
    """A combo box for one of several values; `choices` returns them with their texts in the current language."""

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
    """A combo box whose value is typed or selected from `suggestions`; `read` converts a text that is not empty."""

    def __init__(self, suggestions: Sequence[Any] = (), read: Callable[[str], Any] = str) -> None:
        super().__init__()
        self._read = read
        self.line = QLineEdit()
        self.setEditable(True)
        self.setLineEdit(self.line)
        self.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)
        self.addItems(list(map(str, suggestions)))
        self.line.textEdited.connect(self.typed)
        self.activated.connect(self.choose)

    def choose(self, index: int) -> None:
        """Use the selected item."""
        self.typed.emit()

    def value(self) -> Any:
        """Return the typed or selected value, or None if the text is empty."""
        text = self.currentText().strip()
        return self._read(text) if text else None

    def show_value(self, value: Any) -> None:
        """Show a value, unless the text already represents it."""
        if self.value() != value:
            self.setEditText(_value_text(value))


#: Any of the inputs.
Editor = TextEdit | VectorEdit | FlagBox | SpinEdit | ChoiceBox | EditableBox


def typed_number(text: str) -> int | float | str | None:
    """Return the typed number, None for an empty text, or the text itself, which the validation rejects."""
    text = text.strip()
    for kind in (int, float):
        try:
            return kind(without_minus(text))
        except ValueError:
            continue
    return text or None


def _value_text(value: Any) -> str:
    """Return the text of a value, with a minus sign and at most 12 digits for a number."""
    if value is None:
        return ""
    text = format(value, ".12g") if isinstance(value, float) else str(value)
    return with_minus(text) if isinstance(value, float | int) else text
