"""The range to solve: two boxes for the first and last sequence number, held within the log and in order."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QAbstractSpinBox,
    QDoubleSpinBox,
    QHBoxLayout,
    QLabel,
    QMenu,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from calstation.gui.text import duration_text, on_language_change, term
from calstation.gui.widgets import theme
from calstation.results.plots import LogIndex

#: Up to here a double, and so this box, holds every whole number.
LARGEST = 2**53


class CountSpin(QDoubleSpinBox):
    """Whole numbers up to 2^53; says a new value when it is entered, not at every key."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setDecimals(0)
        self.setRange(0, LARGEST)
        self.setKeyboardTracking(False)
        self.setButtonSymbols(QAbstractSpinBox.ButtonSymbols.NoButtons)
        self.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.setStepType(QAbstractSpinBox.StepType.AdaptiveDecimalStepType)

    def value(self) -> int:
        """The count."""
        return round(super().value())


class RangeBar(QWidget):
    """`changed(first, last)`: another range was entered here."""

    changed = Signal(object, object)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._log_index: LogIndex | None = None
        self.first_spin, self.last_spin = CountSpin(), CountSpin()
        self._labels = QLabel(), QLabel()
        row = QHBoxLayout()
        row.setSpacing(theme.GRID)
        for spin, label, name in zip(
            (self.first_spin, self.last_spin), self._labels, ("first_seq_spin", "last_seq_spin"), strict=True
        ):
            spin.setObjectName(name)
            spin.setMinimumWidth(19 * theme.GRID)
            spin.valueChanged.connect(lambda _, box=spin: self._entered(box))
            spin.lineEdit().textEdited.connect(self._type)
            spin.editingFinished.connect(lambda box=spin: self._finished(box))
            label.setBuddy(spin)
            row.addWidget(label)
            row.addWidget(spin)
        self.length_label = QLabel()
        self.length_label.setProperty("kind", "muted")
        self.part_button = QPushButton()
        self.part_button.setObjectName("range_button")
        self._menu = QMenu(self)
        self.part_button.setMenu(self._menu)
        row.addWidget(self.length_label, 1)
        row.addWidget(self.part_button)
        self._typed = ""
        self.note_label = QLabel()
        self.note_label.setObjectName("range_note_label")
        self.note_label.setProperty("kind", "error")
        self.note_label.setWordWrap(True)
        self.note_label.hide()
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(theme.GRID // 2)
        column.addLayout(row)
        column.addWidget(self.note_label)
        on_language_change(self, self.retranslate)

    def show_log(self, log_index: LogIndex) -> None:
        """Take a log's limits; all of it is chosen."""
        self._log_index = log_index
        self.set_range(log_index.facts.first_seq, log_index.facts.last_seq)
        self._fill()

    @property
    def range(self) -> tuple[int, int]:
        """First and last sequence number chosen."""
        return self.first_spin.value(), self.last_spin.value()

    @property
    def whole(self) -> bool:
        """Whether all of the log is chosen."""
        log = self._log_index
        return log is None or self.range == (log.facts.first_seq, log.facts.last_seq)

    def set_range(self, first: int, last: int) -> None:
        """Show a range; neither box can be set beyond the other, nor beyond the log."""
        assert self._log_index is not None
        facts = self._log_index.facts
        first = min(max(first, facts.first_seq), facts.last_seq)
        last = min(max(last, first), facts.last_seq)
        for spin in (self.first_spin, self.last_spin):
            spin.blockSignals(True)
        for spin in (self.first_spin, self.last_spin):
            spin.setRange(facts.first_seq, facts.last_seq)
        self.first_spin.setValue(first)
        self.last_spin.setValue(last)
        for spin in (self.first_spin, self.last_spin):
            spin.blockSignals(False)
        self._say_length()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        for label, text in zip(self._labels, (self.tr("First sample"), self.tr("Last sample")), strict=True):
            label.setText(text)
        self.part_button.setText(self.tr("Set to…"))
        self.part_button.setToolTip(self.tr("The whole log, or one of its stages"))
        self._fill()
        self._say_length()

    def _fill(self) -> None:
        self._menu.clear()
        if self._log_index is None:
            return
        facts = self._log_index.facts
        parts = [(self.tr("Whole log"), facts.first_seq, facts.last_seq)]
        parts += [(term("stage", s.stage), s.first_seq, s.last_seq) for s in self._log_index.spans]
        for word, first, last in parts:
            action = self._menu.addAction(word)
            action.triggered.connect(lambda _=False, part=(first, last): self._choose(*part))

    def _choose(self, first: int, last: int) -> None:
        self.set_range(first, last)
        self.changed.emit(*self.range)

    def _entered(self, spin: CountSpin) -> None:
        """A box holds something else; beyond the other it goes as far as that, and says so."""
        first, last = self.range
        self._say_note("")
        if first > last:
            held = last if spin is self.first_spin else first
            self._say_note(
                self.tr("The first sample cannot lie behind the last: set to {0}.").format(held)
                if spin is self.first_spin
                else self.tr("The last sample cannot lie before the first: set to {0}.").format(held)
            )
            first = last = held
        self._typed = ""
        self.set_range(first, last)
        self.changed.emit(*self.range)

    def _type(self, text: str) -> None:
        self._typed = text
        self._say_note("")

    def _finished(self, spin: CountSpin) -> None:
        """What is outside the log the box has not taken; it holds what it held before."""
        typed, self._typed = self._typed, ""
        if self._log_index is None or not typed or typed == spin.lineEdit().text():
            return
        facts = self._log_index.facts
        self._say_note(
            self.tr("{0} is not in this log; it holds samples {1} to {2}.").format(
                typed, facts.first_seq, facts.last_seq
            )
        )

    def _say_note(self, text: str) -> None:
        self.note_label.setText(text)
        self.note_label.setVisible(bool(text))

    def _say_length(self) -> None:
        if self._log_index is None:
            self.length_label.setText("")
            return
        first, last = self.range
        self.length_label.setText(duration_text((last - first + 1) / self._log_index.rate))
