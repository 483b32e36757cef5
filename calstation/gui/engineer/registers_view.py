"""The unit's registers, old against new, and an explicit write that states what it will change."""

from collections.abc import Callable

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QWidget

from calstation.gui.engineer.result_view import align_columns
from calstation.gui.history import local_time
from calstation.gui.text import bind, on_language_change, say
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
from calstation.physics import display
from calstation.registers import Register, TargetRegisters, UnitRegisters

_NONE = "–"


class RegistersView(QWidget):
    """Emits `read_wanted`, and `write_wanted(values, at_rest)` once a write is confirmed."""

    read_wanted = Signal()
    write_wanted = Signal(object, bool)

    def __init__(self) -> None:
        super().__init__()
        #: Registers read from the unit, None before, and those that the result asks for, None without a result.
        self.unit: UnitRegisters | None = None
        self.target: TargetRegisters | None = None
        #: Name for the journal.
        self.engineer = ""
        #: The station whose table turns to verify a write, "" for a rig turned by hand.
        self.table = ""
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
        bind(self._table.setAccessibleName, lambda: say("engineer.registers"))
        status = (self._badge, (self._about, 1), (self._job, 1))
        column(
            row(*status, self._read_button, self._write_button, spacing=2 * theme.GRID),
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
        self._empty.say(say("engineer.registers"), say("engineer.about_registers"))
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
        align_columns(self._cells, ("old", "new", "change"))
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
        if target is None or not target.written:
            return ""
        found = next((r.value for r in target.before if r.parameter == name), None)
        if found is None:
            return ""
        value, unit = display(name, found)
        return say("engineer.before_run", value=f"{value:.4f}", unit=unit)

    def _ask(self) -> None:
        """State exactly what will change, and wait for confirmation."""
        target, unit = self.target, self.unit
        assert target is not None
        assert unit is not None
        changes, table, count = self.changes, self.table, len(target.registers)
        values = {
            "changes": len(changes),
            "addresses": self._addresses(changes),
            "commits": unit.commits + 1,
            "engineer": self.engineer,
        }

        def text() -> str:
            verification = say("engineer.verify_by_turns" if table else "engineer.verify_at_rest", table=table)
            return f"{say('engineer.about_write', **values)}\n{verification}"

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
        title = {"count": count, "serial": unit.serial}
        self._notice.ask("caution", lambda: say("engineer.ask_write", **title), text, choices)

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
        kind, state = self._state()
        self._badge.setVisible(not busy and bool(state))
        if state:
            self._badge.show_state(kind, say(f"engineer.state_{state}", count=len(self.changes)))
        theme.set_kind(self._about, "error" if self._error else "")
        words = self._error or self._progress or self._sentences
        self._about.setText(words())

    def _state(self) -> tuple[str, str]:
        """Shape of the badge and name of its words, "" if there is none."""
        if self._progress is not None:
            return "active", "writing"
        if self._error:
            return "bad", "failed"
        if self._proof:
            return "good", "verified"
        if self.unit is None and self.target is not None and self.target.written:
            return "good", "written"
        if self.unit is not None and self._new:
            return ("caution", "differ") if self.changes else ("good", "equal")
        return "", ""

    def _sentences(self) -> str:
        """What the table shows."""
        texts = [say(f"engineer.verified_{self._proof}")] if self._proof else []
        unit, target = self.unit, self.target
        if unit is not None:
            values = {"model": unit.model, "firmware": unit.firmware, "commits": unit.commits}
            texts.append(say("engineer.unit_read", serial=unit.serial, **values))
            if unit.virtual:
                texts.append(say("engineer.unit_virtual"))
        elif target is not None and target.written and target.written_utc:
            texts.append(say("engineer.unit_written_at", time=local_time(target.written_utc)))
        elif target is not None and target.written:
            texts.append(say("engineer.unit_written"))
        elif self._old:
            texts.append(say("engineer.old_of_run"))
        elif self._new:
            texts.append(say("engineer.read_unit"))
        return " ".join(texts)
