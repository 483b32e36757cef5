"""The unit's registers, old against new, and an explicit write that states what it will change."""

from collections.abc import Callable

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QWidget

from calstation.gui.history import local_time
from calstation.gui.text import bind, on_language_change
from calstation.gui.widgets import (
    Choice,
    Column,
    EmptyState,
    JobRow,
    JobWatch,
    NoticeBar,
    ParameterModel,
    ParameterTable,
    StateBadge,
    Words,
    button,
    column,
    enable,
    label,
    row,
    theme,
)
from calstation.physics import aligned, display
from calstation.registers import Register, TargetRegisters, UnitRegisters

_NONE = "–"


class RegistersView(QWidget):
    """Emits `read_wanted`, and `write_wanted(values, at_rest)` once a write is confirmed.

    Attributes
    ----------
    unit : registers read from the unit, None before
    target : registers that the result asks for, None without a result
    engineer : name for the journal
    table : the station whose table turns to verify a write, "" for a rig turned by hand
    """

    read_wanted = Signal()
    write_wanted = Signal(object, bool)

    def __init__(self) -> None:
        super().__init__()
        self.unit: UnitRegisters | None = None
        self.target: TargetRegisters | None = None
        self.engineer = self.table = ""
        self._old: dict[str, Register] = {}
        self._new: dict[str, Register] = {}
        self._cells: dict[str, dict[str, str]] = {}
        self._why_not = ""
        self._error: Words | None = None
        self._progress: Words | None = None
        #: What verified the present write, "" if there was none; see `Settled.proof`.
        self._proof = ""
        self.watch = JobWatch(self)
        self.watch.cancelled.connect(self._refresh)
        self._job = JobRow(self.watch)
        self._notice = NoticeBar()
        self._empty, self._badge, self._about = EmptyState(), StateBadge(), label(wrap=True)
        self._reason = label(kind="muted", name="write_reason_label")
        self._reason.setAlignment(Qt.AlignmentFlag.AlignRight)
        self._read_button = button("read_registers_button", lambda: self.tr("Read the unit"), self.read_wanted)
        self._write_button = button("write_registers_button", lambda: self.tr("Write to the unit"), self._ask)
        self._model = ParameterModel(
            (
                Column(lambda: self.tr("Address"), self._text("address")),
                Column(lambda: self.tr("Unit"), self._text("unit"), number=False),
                Column(self._old_heading, self._text("old"), hint=self._before_run),
                Column(lambda: self.tr("stored as"), self._text("old_raw")),
                Column(lambda: self.tr("New"), self._text("new")),
                Column(lambda: self.tr("stored as"), self._text("new_raw")),
                Column(lambda: self.tr("Change"), self._text("change")),
            ),
            grouped=False,
        )
        self._table = ParameterTable(self._model)
        self._table.setObjectName("register_table")
        self._table.verticalHeader().setDefaultSectionSize(26)
        bind(self._table.setAccessibleName, lambda: self.tr("Registers, old against new"))
        column(
            row(
                self._badge,
                (self._about, 1),
                (self._job, 1),
                self._read_button,
                self._write_button,
                spacing=2 * theme.GRID,
            ),
            self._reason,
            self._notice,
            (self._table, 1),
            (self._empty, 1),
            on=self,
            margins=(0, theme.GRID, 0, 0),
        )
        on_language_change(self, self._show_texts)

    @property
    def changes(self) -> list[str]:
        """Parameters whose register would get another value."""
        return [n for n, new in self._new.items() if n in self._old and self._old[n].raw != new.raw]

    def show_target(self, target: TargetRegisters | None) -> None:
        """Show the registers that a result asks for."""
        self.target = target
        self._proof, self._error = "", None
        if target is None or self.unit is None or self.unit.serial != target.serial:
            self.unit = None
        self._fill()

    def show_unit(self, unit: UnitRegisters, proof: str = "") -> None:
        """Show the registers of the unit; `proof` tells what verified them if they have just been written."""
        self.unit, self._proof = unit, proof
        self._error = self._progress = None
        self._fill()

    def begin(self) -> None:
        """Show that the unit is being read or written."""
        self._error = None
        self._notice.dismiss()
        self._refresh()

    def show_progress(self, words: Words) -> None:
        """Show the progress of a write."""
        self._progress = words
        self._refresh()

    def show_error(self, words: Words) -> None:
        """Show why a read or write was not done."""
        self._error, self._progress = words, None
        self._refresh()

    def set_why_not(self, read: str, write: str) -> None:
        """Disable reading and writing with their reasons; "" enables them."""
        enable(self._read_button, read)
        enable(self._write_button, write)
        self._why_not = "" if self._proof or read else write
        self._show_reason()
        if write:
            self._notice.dismiss()

    def _show_texts(self) -> None:
        self._empty.say(
            self.tr("Registers, old against new"),
            self.tr(
                "Open a result or finish a run to see what it would write, and read the unit in the fixture to see "
                "what it holds. Nothing is written without confirmation."
            ),
        )
        self._model.refresh()
        self._refresh()

    def _fill(self) -> None:
        target = self.target
        old = self.unit.registers if self.unit is not None else ()
        if self.unit is None and target is not None:
            old = target.written or target.before
        self._old = {register.parameter: register for register in old}
        self._new = {} if target is None else {r.parameter: r for r in target.registers}
        names = sorted({**self._old, **self._new}, key=self._address)
        self._cells = {name: self._row_cells(name) for name in names}
        for key in ("old", "new", "change"):
            present = [name for name in names if key in self._cells[name]]
            texts = aligned([self._cells[name][key] for name in present])
            for name, text in zip(present, texts, strict=True):
                self._cells[name][key] = text
        self._model.set_names(names)
        self._table.setVisible(bool(names))
        self._empty.setVisible(not names)
        self._refresh()

    def _row_cells(self, name: str) -> dict[str, str]:
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

    def _text(self, key: str) -> Callable[[str], str]:
        return lambda name: self._cells[name].get(key, _NONE)

    def _address(self, name: str) -> int:
        return (self._old.get(name) or self._new[name]).address

    def _old_heading(self) -> str:
        known = self.unit is not None or (self.target is not None and bool(self.target.written))
        return self.tr("In the unit") if known else self.tr("Old")

    def _before_run(self, name: str) -> str:
        """The value that the run found and replaced."""
        target = self.target
        found = next((r for r in target.before if r.parameter == name), None) if target is not None else None
        if target is None or not target.written or found is None:
            return ""
        value, unit = display(name, found.value)
        return self.tr("before the run: {0} {1}").format(f"{value:.4f}", unit)

    def _ask(self) -> None:
        """State exactly what will change, and wait for confirmation."""
        target, unit = self.target, self.unit
        assert target is not None
        assert unit is not None
        changes, table, count = self.changes, self.table, len(target.registers)

        def choice(name: str, words: Words, *, at_rest: bool) -> Choice:
            return Choice(name, words, lambda: self.write_wanted.emit(target.values, at_rest))

        choices = [Choice("cancel_write_button", lambda: self.tr("Cancel"), lambda: None, primary=True)]
        confirm = "confirm_write_button"
        if table:
            at_rest = "confirm_at_rest_button"
            choices.append(choice(at_rest, lambda: self.tr("Write, table at rest"), at_rest=True))
            choices.append(choice(confirm, lambda: self.tr("Write and turn the table"), at_rest=False))
        else:
            choices.append(choice(confirm, lambda: self.tr("Write {0} registers").format(count), at_rest=True))
        self._notice.ask(
            "caution",
            lambda: self.tr("Write {0} registers of unit {1}?").format(count, unit.serial),
            lambda: (
                self.tr(
                    "{0} of them change, exactly as the table shows below ({1}); all others keep their values. "
                    "The unit commits them to flash and restarts: flash write number {2} known here. "
                    "The journal records it under the name {3}."
                ).format(len(changes), self._addresses(changes), unit.commits + 1, self.engineer)
                + "\n"
                + self._verification(table)
            ),
            choices,
        )

    def _verification(self, table: str) -> str:
        """How the output is verified after the write, and what moves for it."""
        if not table:
            return self.tr("Then its output is checked at rest; do not touch the unit.")
        return self.tr(
            "The table of “{0}” moves: home first, then whole turns of both axes before and after the write, which "
            "verify the gyros as well. Is everyone clear of the table and the unit secured? STOP works at any time."
        ).format(table)

    def _addresses(self, names: list[str]) -> str:
        """Addresses as ranges."""
        ranges: list[list[int]] = []
        for address in sorted(self._address(name) for name in names):
            if ranges and address == ranges[-1][1] + 1:
                ranges[-1][1] = address
            else:
                ranges.append([address, address])
        return ", ".join(f"{a}" if a == b else f"{a}–{b}" for a, b in ranges)

    def _show_reason(self) -> None:
        """Show beside the button why it is disabled: a touch screen has no tooltips."""
        self._reason.setText(self._why_not)
        self._reason.setVisible(bool(self._why_not) and not self.watch.busy and self._progress is None)

    def _refresh(self) -> None:
        busy = self.watch.busy
        self._show_reason()
        self._job.setVisible(busy)
        self._about.setVisible(not busy)
        for each in (self._read_button, self._write_button):
            each.setVisible(not busy and self._progress is None)
        state = self._state()
        self._badge.setVisible(not busy and state is not None)
        if state is not None:
            self._badge.show_state(*state)
        theme.set_kind(self._about, "error" if self._error else "")
        words = self._error or self._progress or self._sentences
        self._about.setText(words())

    def _state(self) -> tuple[str, str] | None:
        """Kind and text of the badge."""
        if self._progress is not None:
            return "active", self.tr("being written")
        if self._error:
            return "bad", self.tr("not done")
        if self._proof:
            return "good", self.tr("written and read back")
        if self.unit is None and self.target is not None and self.target.written:
            return "good", self.tr("written by the run")
        if self.unit is not None and self._new:
            count = len(self.changes)
            return ("caution", self.tr("{0} differ").format(count)) if count else ("good", self.tr("equal"))
        return None

    def _sentences(self) -> str:
        texts = []
        if self._proof:
            verified = {
                "turn": self.tr("Verified with a turn of the table."),
                "rest": self.tr("Verified at rest; no turn was made."),
            }
            read_back = self.tr("Only read back: the unit's output does not show its registers.")
            texts.append(verified.get(self._proof, read_back))
        if self.unit is not None:
            unit = self.unit
            texts.append(
                self.tr("Unit {0}, {1}, firmware {2}; flash writes known here: {3}.").format(
                    unit.serial, unit.model, unit.firmware, unit.commits
                )
            )
            if unit.virtual:
                texts.append(self.tr("A virtual unit starts afresh with every bench."))
        elif self.target is not None and self.target.written:
            texts.append(
                self.tr("In the unit: as the run wrote it and read it back, {0}.").format(
                    local_time(self.target.written_utc)
                )
                if self.target.written_utc
                else self.tr("In the unit: as the run wrote it and read it back.")
            )
        elif self._old:
            texts.append(self.tr("Old: as the run found them. Read the unit to see what it holds now."))
        elif self._new:
            texts.append(self.tr("Read the unit to see what it holds now."))
        return " ".join(texts)
