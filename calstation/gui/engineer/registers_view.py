"""The unit's registers, old against new, and an explicit write that says what it will change."""

from collections.abc import Callable

from PySide6.QtCore import QEvent, Qt, Signal
from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from calstation.errors import CalstationError
from calstation.gui.engineer.error_wording import one_line
from calstation.gui.history.run_table import local_time
from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import StateBadge
from calstation.gui.widgets.jobs import JobRow, JobWatch
from calstation.gui.widgets.labels import EmptyState
from calstation.gui.widgets.layout import Words
from calstation.gui.widgets.notice import Choice, NoticeBar
from calstation.gui.widgets.parameter_table import Column, ParameterModel, ParameterTable
from calstation.physics.units import aligned, display
from calstation.registers.unit_registers import Register, TargetRegisters, UnitRegisters

_NONE = "–"


class RegistersView(QWidget):
    """`read_wanted` and `write_wanted(values, at_rest)` ask the page to have it done.

    table_of : station whose table turns to prove what is written, "" where hands turn the rails
    """

    read_wanted = Signal()
    write_wanted = Signal(object, bool)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.unit: UnitRegisters | None = None
        self.wanted: TargetRegisters | None = None
        self._old: dict[str, Register] = {}
        self._new: dict[str, Register] = {}
        self._cells: dict[str, dict[str, str]] = {}
        self._why_not = ""
        self._error: Words | None = None
        self._written = False
        self._proof = ""
        self._said: Words | None = None
        self.engineer = self.table_of = ""
        self.watch = JobWatch(self)
        self._row = JobRow(self.watch)
        self.notice = NoticeBar()
        self._empty = EmptyState()
        self._badge = StateBadge()
        self._about = QLabel()
        self._about.setWordWrap(True)
        self._reason = QLabel()
        self._reason.setObjectName("write_reason_label")
        self._reason.setProperty("kind", "muted")
        self._reason.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.read_button, self.write_button = QPushButton(), QPushButton()
        self.read_button.setObjectName("read_registers_button")
        self.write_button.setObjectName("write_registers_button")
        self.read_button.clicked.connect(self.read_wanted)
        self.write_button.clicked.connect(self._ask)
        self.model = ParameterModel(
            (
                Column(lambda: self.tr("Address"), self._text("address")),
                Column(lambda: self.tr("Unit"), self._text("unit"), number=False),
                Column(self._held_heading, self._text("old"), hint=self._before),
                Column(lambda: self.tr("stored as"), self._text("old_raw")),
                Column(lambda: self.tr("New"), self._text("new")),
                Column(lambda: self.tr("stored as"), self._text("new_raw")),
                Column(lambda: self.tr("Change"), self._text("change")),
            ),
            grouped=False,
        )
        self.table = ParameterTable(self.model)
        self.table.setObjectName("register_table")
        self.table.verticalHeader().setDefaultSectionSize(26)
        self._lay_out()
        self.watch.failed.connect(self.complain)
        self.watch.cancelled.connect(self._say)
        self.retranslate()

    def _lay_out(self) -> None:
        head = QHBoxLayout()
        head.setSpacing(2 * theme.GRID)
        head.addWidget(self._badge)
        head.addWidget(self._about, 1)
        head.addWidget(self._row, 1)
        head.addWidget(self.read_button)
        head.addWidget(self.write_button)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, theme.GRID, 0, 0)
        column.setSpacing(theme.GRID)
        column.addLayout(head)
        column.addWidget(self._reason)
        column.addWidget(self.notice)
        column.addWidget(self.table, 1)
        column.addWidget(self._empty, 1)

    @property
    def changes(self) -> list[str]:
        """Parameters whose register would hold something else."""
        return [n for n, new in self._new.items() if n in self._old and self._old[n].raw != new.raw]

    def show_wanted(self, wanted: TargetRegisters | None) -> None:
        """What the loaded result asks for."""
        self.wanted = wanted
        self._written = False
        self._error = None
        if wanted is None or self.unit is None or self.unit.serial != wanted.serial:
            self.unit = None
        self._fill()

    def show_unit(self, unit: UnitRegisters, proof: str = "") -> None:
        """What the unit holds; `proof` : by what that was found right, where it was written just now."""
        self.unit, self._written, self._error = unit, bool(proof), None
        self._proof, self._said = proof, None
        self._fill()

    def begin(self) -> None:
        """The unit is being asked."""
        self._error = None
        self.notice.dismiss()
        self._say()

    def tell(self, words: Words) -> None:
        """How a write gets on."""
        self._said = words
        self._say()

    def set_why_not(self, read: str, write: str) -> None:
        """Why the unit cannot be read or written now, "" where it can."""
        self.read_button.setEnabled(not read)
        self.read_button.setToolTip(read)
        self._why_not = "" if self._written or read else write
        self._say_why_not()
        self.write_button.setEnabled(not write)
        self.write_button.setToolTip(write)
        if write:
            self.notice.dismiss()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self.read_button.setText(self.tr("Read the unit"))
        self.write_button.setText(self.tr("Write to the unit"))
        self.table.setAccessibleName(self.tr("Registers, old against new"))
        self._empty.say(
            self.tr("Registers, old against new"),
            self.tr(
                "Open a result or finish a run to see what it would write, and read the unit in the fixture to see "
                "what it holds. Nothing is written without being asked for."
            ),
        )
        self.notice.refresh()
        self.model.refresh()
        self._say()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _fill(self) -> None:
        before = self.unit.registers if self.unit is not None else ()
        if self.unit is None and self.wanted is not None:
            before = self.wanted.written or self.wanted.before
        self._old = {register.parameter: register for register in before}
        self._new = {} if self.wanted is None else {r.parameter: r for r in self.wanted.registers}
        names = sorted({**self._old, **self._new}, key=self._address)
        self._cells = {name: self._cells_of(name) for name in names}
        for column in ("old", "new", "change"):
            there = [name for name in names if column in self._cells[name]]
            texts = aligned([self._cells[name][column] for name in there])
            for name, text in zip(there, texts, strict=True):
                self._cells[name][column] = text
        self.model.set_names(names)
        self.table.setVisible(bool(names))
        self._empty.setVisible(not names)
        self._say()

    @property
    def _known(self) -> bool:
        """Whether the unit was read, or the run itself has read back what it wrote."""
        return self.unit is not None or (self.wanted is not None and bool(self.wanted.written))

    def _held_heading(self) -> str:
        return self.tr("In the unit") if self._known else self.tr("Old")

    def _before(self, name: str) -> str:
        """What the run found there, where it has written since."""
        if self.wanted is None or not self.wanted.written:
            return ""
        found = {register.parameter: register.value for register in self.wanted.before}
        if name not in found:
            return ""
        value, unit = display(name, found[name])
        return self.tr("before the run: {0} {1}").format(f"{value:.4f}", unit)

    def _address(self, name: str) -> int:
        return (self._old.get(name) or self._new[name]).address

    def _cells_of(self, name: str) -> dict[str, str]:
        old, new = self._old.get(name), self._new.get(name)
        cells = {"address": str(self._address(name)), "unit": display(name, 0.0)[1]}
        if old is not None:
            cells |= {"old": f"{display(name, old.value)[0]:.4f}", "old_raw": old.raw}
        if new is not None:
            cells |= {"new": f"{display(name, new.value)[0]:.4f}", "new_raw": new.raw}
        if old is not None and new is not None:
            difference = display(name, new.value - old.value)[0]
            cells["change"] = "0" if old.raw == new.raw else f"{difference:+.4f}"
        return cells

    def _text(self, column: str) -> Callable[[str], str]:
        return lambda name: self._cells[name].get(column, _NONE)

    def complain(self, error: CalstationError) -> None:
        """Say what could not be done, in an error's own words."""
        self.regret(lambda: one_line(error))

    def regret(self, words: Words) -> None:
        """Say what was not done."""
        self._error, self._said = words, None
        self._say()

    def _ask(self) -> None:
        """State exactly what will change, and wait for the word."""
        assert self.wanted is not None
        assert self.unit is not None
        wanted, unit, changes, table = self.wanted, self.unit, self.changes, self.table_of

        def write(*, at_rest: bool) -> None:
            self.write_wanted.emit(wanted.values, at_rest)

        turning = (
            Choice(
                "confirm_at_rest_button", lambda: self.tr("Write, table at rest"), lambda: write(at_rest=True)
            ),
            Choice(
                "confirm_write_button",
                lambda: self.tr("Write and turn the table"),
                lambda: write(at_rest=False),
            ),
        )
        by_hand = Choice(
            "confirm_write_button",
            lambda: self.tr("Write {0} registers").format(len(wanted.registers)),
            lambda: write(at_rest=True),
        )
        self.notice.ask(
            "caution",
            lambda: self.tr("Write {0} registers of unit {1}?").format(len(wanted.registers), unit.serial),
            lambda: (
                self.tr(
                    "{0} of them change, exactly as the table shows below ({1}); all others keep their values. "
                    "The unit commits them to flash and restarts: flash write number {2} known here. "
                    "It stands in the journal under the name {3}."
                ).format(len(changes), self._addresses(changes), unit.commits + 1, self.engineer)
                + "\n"
                + self._proving(table)
            ),
            (
                Choice("cancel_write_button", lambda: self.tr("Cancel"), lambda: None, primary=True),
                *(turning if table else (by_hand,)),
            ),
        )

    def _proving(self, table: str) -> str:
        """What proves the output behind the write, and what moves for it."""
        if not table:
            return self.tr("Then its output is checked at rest; do not touch the unit.")
        return self.tr(
            "The table of “{0}” moves: home first; then whole turns of both axes, before and after the write, which "
            "proves the gyros as well. Is everybody clear of it, and the unit tight? STOP works all the time."
        ).format(table)

    def _addresses(self, names: list[str]) -> str:
        """Addresses as ranges."""
        places = sorted(self._address(name) for name in names)
        spans: list[list[int]] = []
        for place in places:
            if spans and place == spans[-1][1] + 1:
                spans[-1][1] = place
            else:
                spans.append([place, place])
        return ", ".join(f"{a}" if a == b else f"{a}–{b}" for a, b in spans)

    def _say_why_not(self) -> None:
        """Why the button is grey, beside it: a tooltip is not there for a finger."""
        self._reason.setText(self._why_not)
        self._reason.setVisible(bool(self._why_not) and not self.watch.busy and self._said is None)

    def _say(self) -> None:
        busy = self.watch.busy
        self._say_why_not()
        self._row.setVisible(busy)
        self._about.setVisible(not busy)
        for button in (self.read_button, self.write_button):
            button.setVisible(not busy and self._said is None)
        self._badge.setVisible(not busy and bool(self._badge_of()))
        if shown := self._badge_of():
            self._badge.show_state(*shown)
        theme.set_kind(self._about, "error" if self._error else "")
        self._about.setText(self._error() if self._error else self._sentence())

    def _badge_of(self) -> tuple[str, str] | None:
        if self._said is not None:
            return "active", self.tr("being written")
        if self._error:
            return "bad", self.tr("not done")
        if self._written:
            return "good", self.tr("written and read back")
        if self.unit is None and self.wanted is not None and self.wanted.written:
            return "good", self.tr("written by the run")
        if self.unit is not None and self._new:
            count = len(self.changes)
            return ("caution", self.tr("{0} differ").format(count)) if count else ("good", self.tr("equal"))
        return None

    def _sentence(self) -> str:
        if self._said is not None:
            return self._said()
        parts = []
        if self._written:
            parts.append(
                {
                    "turn": self.tr("Found right with a turn of the table."),
                    "rest": self.tr("Found right at rest; no turn was made."),
                }.get(self._proof, self.tr("Only read back: the unit shows no output with its registers."))
            )
        if self.unit is not None:
            parts.append(
                self.tr("Unit {0}, {1}, firmware {2}; flash writes known here: {3}.").format(
                    self.unit.serial, self.unit.model, self.unit.firmware, self.unit.commits
                )
            )
            if self.unit.virtual:
                parts.append(self.tr("A virtual unit starts afresh with every bench."))
        elif self.wanted is not None and self.wanted.written:
            parts.append(
                self.tr("In the unit: as the run wrote it and read it back, {0}.").format(
                    local_time(self.wanted.written_utc)
                )
                if self.wanted.written_utc
                else self.tr("In the unit: as the run wrote it and read it back.")
            )
        elif self._old:
            parts.append(self.tr("Old: as the run found them. Read the unit to see what it holds now."))
        elif self._new:
            parts.append(self.tr("Read the unit to see what it holds now."))
        return " ".join(parts)
