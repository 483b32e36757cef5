"""The range to solve: two boxes for the first and last sequence number, held within the log and in order."""

from PySide6.QtCore import QEvent, Signal
from PySide6.QtWidgets import QHBoxLayout, QLabel, QMenu, QPushButton, QWidget

from calstation.gui import theme
from calstation.gui.widgets.count_spin import CountSpin
from calstation.gui.wording import word_stage, word_time
from calstation.station.overview import Overview


class RangeBar(QWidget):
    """`changed(first, last)`: another range was entered here."""

    changed = Signal(object, object)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._overview: Overview | None = None
        self.first_spin, self.last_spin = CountSpin(), CountSpin()
        self._labels = QLabel(), QLabel()
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.GRID)
        for spin, label, name in zip(
            (self.first_spin, self.last_spin), self._labels, ("first_seq_spin", "last_seq_spin"), strict=True
        ):
            spin.setObjectName(name)
            spin.setMinimumWidth(19 * theme.GRID)
            spin.valueChanged.connect(self._entered)
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
        self.retranslate()

    def show_log(self, overview: Overview) -> None:
        """Take a log's limits; all of it is chosen."""
        self._overview = overview
        self.set_range(overview.facts.first_seq, overview.facts.last_seq)
        self._fill()

    @property
    def range(self) -> tuple[int, int]:
        """First and last sequence number chosen."""
        return self.first_spin.value(), self.last_spin.value()

    def set_range(self, first: int, last: int) -> None:
        """Show a range; neither box can be set beyond the other, nor beyond the log."""
        assert self._overview is not None
        facts = self._overview.facts
        first = min(max(first, facts.first_seq), facts.last_seq)
        last = min(max(last, first), facts.last_seq)
        for spin in (self.first_spin, self.last_spin):
            spin.blockSignals(True)
        self.first_spin.setRange(facts.first_seq, last)
        self.last_spin.setRange(first, facts.last_seq)
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

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _fill(self) -> None:
        self._menu.clear()
        if self._overview is None:
            return
        facts = self._overview.facts
        parts = [(self.tr("Whole log"), facts.first_seq, facts.last_seq)]
        parts += [(word_stage(s.stage), s.first_seq, s.last_seq) for s in self._overview.spans]
        for word, first, last in parts:
            action = self._menu.addAction(word)
            action.triggered.connect(lambda _=False, part=(first, last): self._choose(*part))

    def _choose(self, first: int, last: int) -> None:
        self.set_range(first, last)
        self.changed.emit(*self.range)

    def _entered(self) -> None:
        self.set_range(self.first_spin.value(), self.last_spin.value())
        self.changed.emit(*self.range)

    def _say_length(self) -> None:
        if self._overview is None:
            self.length_label.setText("")
            return
        first, last = self.range
        self.length_label.setText(word_time((last - first + 1) / self._overview.rate))
