"""Widgets that select the range of sequence numbers and the stages of a log that are solved."""

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QAbstractSpinBox, QCheckBox, QMenu, QWidget

from calstation.gui.text import Words, duration_text, on_language_change, say, term
from calstation.gui.widgets import LimitedSpin, button, column, enable, grid, label, row, show_text, theme
from calstation.messages import Text
from calstation.results.plots import LogIndex, StageSpan

#: Number of stage check boxes in a row.
_COLUMNS = 4
#: Largest value up to which a double, the value type of the spin box, represents every integer.
_MAX_VALUE = 2**53


class CountSpin(LimitedSpin):
    """A spin box for integers up to 2^53, which emits a value only when it has been entered."""

    def __init__(self, name: str) -> None:
        super().__init__(0, _MAX_VALUE, 0)
        self.setObjectName(name)
        self.setStepType(QAbstractSpinBox.StepType.AdaptiveDecimalStepType)
        self.setMinimumWidth(13 * theme.GRID)

    def value(self) -> int:
        """Return the value as an integer."""
        return round(super().value())


class RangeBar(QWidget):
    """Inputs for a range of sequence numbers, which emit `changed(first, last)` when the user enters another range."""

    changed = Signal(object, object)
    #: Emitted when `problem` may have changed.
    checked = Signal()
    #: Emitted to request the selection of the longest rest in the log.
    rest_requested = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._log_index: LogIndex | None = None
        self.first_spin, self.last_spin = CountSpin("first_seq_spin"), CountSpin("last_seq_spin")
        first, last = label("logs.first_sample"), label("logs.last_sample")
        for caption, spin in ((first, self.first_spin), (last, self.last_spin)):
            caption.setBuddy(spin)
            spin.valueChanged.connect(lambda _, spin=spin: self._accept_value(spin))
            spin.lineEdit().textEdited.connect(lambda _: self._show_note(""))
            spin.rejected.connect(lambda _: self._show_note(""))
        self.length_label = label(kind="muted")
        self.set_button = button("range_button", "logs.set_to", tip="logs.set_to_tip")
        self._menu = QMenu(self)
        self.set_button.setMenu(self._menu)
        self.note_label = label(kind="error", name="range_note_label", wrap=True)
        boxes = row(first, self.first_spin, last, self.last_spin, (self.length_label, 1), self.set_button)
        column(boxes, self.note_label, on=self, spacing=theme.GRID // 2)
        self._note: Words = ""
        on_language_change(self, self._show_texts)

    def show_log(self, log_index: LogIndex) -> None:
        """Set the limits to the range of a log, and select the whole log."""
        self._log_index = log_index
        self.set_range(log_index.facts.first_seq, log_index.facts.last_seq)
        self._fill_menu()

    @property
    def range(self) -> tuple[int, int]:
        """First and last selected sequence numbers."""
        return self.first_spin.value(), self.last_spin.value()

    @property
    def problem(self) -> str:
        """Why the entered texts are not samples of the log, or ""."""
        if self._log_index is None:
            return ""
        limits = {"first": self._log_index.facts.first_seq, "last": self._log_index.facts.last_seq}
        texts = [spin.wrong for spin in (self.first_spin, self.last_spin) if spin.wrong]
        return "\n".join(say("logs.sample_outside", sample=text, **limits) for text in texts)

    @property
    def is_whole_log(self) -> bool:
        """Whether the whole log is selected."""
        log = self._log_index
        return log is None or self.range == (log.facts.first_seq, log.facts.last_seq)

    def set_range(self, first: int, last: int) -> None:
        """Show a range, limited to the log, instead of the entered values."""
        if self._log_index is None:
            return
        facts = self._log_index.facts
        first = min(max(first, facts.first_seq), facts.last_seq)
        last = min(max(last, first), facts.last_seq)
        for spin, value in ((self.first_spin, first), (self.last_spin, last)):
            with QSignalBlocker(spin):
                spin.setRange(facts.first_seq, facts.last_seq)
                spin.setValue(value)
        self._show_length()
        self._show_note("")

    def _show_texts(self) -> None:
        self._fill_menu()
        self._show_length()
        self._show_note(self._note)

    def _show_length(self) -> None:
        if self._log_index is not None:
            first, last = self.range
            self.length_label.setText(duration_text((last - first + 1) / self._log_index.rate))

    def _fill_menu(self) -> None:
        self._menu.clear()
        if self._log_index is None:
            return
        facts = self._log_index.facts
        parts = [(say("logs.whole_log"), facts.first_seq, facts.last_seq)]
        parts += [(term("stage", s.stage), s.first_seq, s.last_seq) for s in self._log_index.spans]
        for text, first, last in parts:
            action = self._menu.addAction(text)
            action.triggered.connect(lambda _=False, part=(first, last): self.choose(*part))
        self._menu.addSeparator()
        self._menu.addAction(say("logs.longest_rest")).triggered.connect(lambda _: self.rest_requested.emit())

    def choose(self, first: int, last: int) -> None:
        """Select a range as if the user had entered it."""
        self.set_range(first, last)
        self.changed.emit(*self.range)

    def _accept_value(self, spin: CountSpin) -> None:
        """Accept a new value, limited by that of the other box; a rejected text in the other box remains."""
        first, last = self.range
        note: Words = ""
        if first > last:
            is_first = spin is self.first_spin
            limit = last if is_first else first
            note = Text.of("logs.first_clipped", last=limit) if is_first else Text.of("logs.last_clipped", first=limit)
            with QSignalBlocker(spin):
                spin.setValue(limit)
        self._show_length()
        self._show_note(note)
        self.changed.emit(*self.range)

    def _show_note(self, note: Words) -> None:
        """Show a note about a limited value, or why an entered text is not a sample of the log."""
        self._note = note
        show_text(self.note_label, self.problem or say(note))
        self.checked.emit()


class StageChoice(QWidget):
    """Check boxes of the stages with samples in the range, which emit `changed()` when the selection changes."""

    changed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._grid = grid(self, across=2 * theme.GRID, down=0, stretch=_COLUMNS)
        self._spans: tuple[StageSpan, ...] = ()
        self._boxes: dict[str, QCheckBox] = {}
        self._range = (0, 0)
        on_language_change(self, self._refresh)

    def show_stages(self, spans: tuple[StageSpan, ...]) -> None:
        """Show check boxes for the stages of a log, all ticked."""
        self._spans = spans
        for box in self._boxes.values():
            self._grid.removeWidget(box)
            box.deleteLater()
        self._boxes = {}
        for stage in dict.fromkeys(span.stage for span in spans):
            box = QCheckBox()
            box.setObjectName(f"offline_stage_check_{stage}")
            box.setMinimumHeight(4 * theme.GRID)
            box.setChecked(True)
            box.toggled.connect(self.changed)
            self._grid.addWidget(box, *divmod(len(self._boxes), _COLUMNS))
            self._boxes[stage] = box

    def set_range(self, first: int, last: int) -> None:
        """Disable the stages outside a range of sequence numbers."""
        self._range = (first, last)
        self._refresh()

    @property
    def available(self) -> tuple[str, ...]:
        """Stages with samples in the range, in the order of the log."""
        return tuple(dict.fromkeys(s.stage for s in self._spans if s.within(*self._range)))

    @property
    def selected(self) -> tuple[str, ...]:
        """Stages to solve, in the order of the log."""
        return tuple(stage for stage in self.available if self._boxes[stage].isChecked())

    def _refresh(self) -> None:
        for stage, box in self._boxes.items():
            box.setText(term("stage", stage))
            enable(box, "" if stage in self.available else say("logs.stage_outside"))
