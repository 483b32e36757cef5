"""View that reads the registers of the unit, compares them with a result, and has the engine write them."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QWidget

from calstation.config import (
    Person,
    ProductConfig,
    RegisterOperation,
    RunRequest,
    StationConfig,
    confirm,
    confirmation_required,
    load_product,
    load_station,
)
from calstation.errors import CalstationError
from calstation.gui.engineer.result_view import verdict_badge
from calstation.gui.state import AppContext, PeoplePanel
from calstation.gui.text import Words, fault_text, language, on_language_change, say, step_sentence
from calstation.gui.widgets import (
    Cell,
    CellTable,
    Choice,
    EmptyState,
    JobRow,
    NoticeBar,
    StateBadge,
    button,
    column,
    enable,
    label,
    row,
    theme,
)
from calstation.messages import Text, event_text, joined
from calstation.physics import display
from calstation.registers import (
    Register,
    RunRegisters,
    TargetRegisters,
    Transfer,
    UnitRegisters,
    ranges_of,
    read_unit,
    run_registers,
    target_registers,
    unit_transfer,
)
from calstation.results import FinishedRun, Result
from calstation.sequencer import Event, Fault, Message, Settled, StepStarted

#: Placeholder in a request for a serial number that has not been entered.
UNNAMED = "-"

#: Events that report the state of the unit after an incomplete write.
_INCOMPLETE = ("transfer_unproved", "old_unproved")


class RegistersView(QWidget):
    """A view of old and new register values, with buttons that read and write them.

    `request` returns the station, product and engineer of an operation. The signal `changed` is emitted when the
    available actions may have changed.
    """

    changed = Signal()

    def __init__(self, app: AppContext, request: Callable[[], RunRequest]) -> None:
        super().__init__()
        self._app, self._request = app, request
        #: Registers read from the unit; None before they are read.
        self.unit: UnitRegisters | None = None
        #: Registers computed from the result; None without a result.
        self.target: TargetRegisters | None = None
        #: Name of the station whose table moves for the verification of a write; "" for a manual rig.
        self.table = ""
        self._run: FinishedRun | None = None
        #: Registers that the run wrote; None if it wrote none.
        self._wrote: RunRegisters | None = None
        #: Latest transfer to the unit that was read or, if none was read, to the unit of the run; None if unknown.
        self._latest: Transfer | None = None
        self._operation: RegisterOperation | None = None
        #: Latest event of the current write that is in `_INCOMPLETE`; "" if there is none.
        self._incomplete = ""
        #: Outcome of the last operation while the resulting registers are displayed, otherwise None.
        self._settled: Settled | None = None
        self._old: dict[str, Register] = {}
        self._new: dict[str, Register] = {}
        self._why_not = ""
        self._error: Words = ""
        #: Why the registers of the result could not be computed, or "".
        self._why_no_target: Words = ""
        self._progress: Words = ""
        #: Whether the station, product or folder has changed since the read started.
        self._is_outdated = False
        end = self._end_reading
        self.watch = app.job(self, read_unit, end, failed=end, cancelled=self._refresh, cancellable=False)
        self._target_watch = app.job(self, target_registers, self._show_target, failed=self._refuse_target)
        self._lay_out()
        app.engine_link.event.connect(self._follow)
        for changed in (app.station_changed, app.product_changed, app.runs_folder_changed):
            changed.connect(self._unit_changed)
        on_language_change(self, self._fill)

    def _lay_out(self) -> None:
        self._job, self._notice, self._people = JobRow(self.watch), NoticeBar(), PeoplePanel("registers")
        self._people.cancelled.connect(lambda: self._show_error(""))
        self._empty = EmptyState(title="engineer.registers", text="engineer.about_registers")
        self._badge, self._about = StateBadge(), label(wrap=True)
        self._reason = label(kind="muted", name="write_reason_label", wrap=True)
        self._reason.setAlignment(Qt.AlignmentFlag.AlignRight)
        self._read_button = button("read_registers_button", "engineer.read_unit_button", self._read)
        self._write_button = button("write_registers_button", "engineer.write_unit", self._ask)
        columns = (
            Cell("engineer.address", "address"),
            Cell("common.unit", "unit", number=False),
            Cell(self._old_heading, "old", hint="before_run"),
            Cell("engineer.stored_as", "old_raw"),
            Cell("engineer.new", "new"),
            Cell("engineer.stored_as", "new_raw"),
            Cell("engineer.change", "change"),
        )
        self._table = CellTable("register_table", "engineer.registers", columns)
        status = (self._badge, (self._about, 1), (self._job, 1))
        column(
            row(*status, self._read_button, self._write_button, spacing=2 * theme.GRID),
            *(self._reason, self._notice, self._people),
            *((self._table, 1), (self._empty, 1)),
            on=self,
            margins=(0, theme.GRID, 0, 0),
        )

    def show_run(self, run: FinishedRun) -> None:
        """Compute the target registers of a run."""
        self._run = run
        self._target_watch.cancel()
        self._show_target(None)
        if run.result.parameters:
            self._target_watch.start(self._request(), run.result)

    def set_why_not(self, read: str, write: str) -> None:
        """Disable reading and writing for the given reasons; an empty reason enables the action."""
        enable(self._read_button, read)
        enable(self._write_button, write)
        self._why_not = "" if self._settled is not None or read else write
        self._show_reason()
        if write:
            self._notice.dismiss()
            self._people.hide()

    @property
    def _interrupted(self) -> bool:
        """Whether the transfer to the unit that was read was interrupted and must be finished or reverted first."""
        return self.unit is not None and self._latest is not None and self._latest.closing is None

    def why_not_write(self) -> str:
        """Return the reason why the registers cannot be written yet, or "" if they can be written."""
        entered = self._request().serial
        if self.unit is not None and self._interrupted and entered in (self.unit.serial, UNNAMED):
            return ""
        if self.target is None:
            return say(self._why_no_target or "engineer.no_target")
        if self.unit is None:
            return say("engineer.no_unit")
        wanted = self.target.serial
        if self.unit.serial != wanted:
            return say("engineer.other_unit", found=self.unit.serial, wanted=wanted)
        if entered not in (wanted, UNNAMED):
            return say("engineer.result_of_other_unit", shown=wanted, entered=entered)
        return "" if self._changes() else say("engineer.nothing_to_write")

    # ---- reading and writing

    def _unit_changed(self) -> None:
        """Forget the unit of the previous station, product or folder, and compute the target registers again.

        The folder contains the registers of virtual units; the target registers depend on the product's profile.
        """
        if self._operation is not None:
            return
        self._is_outdated = True
        self.unit, self._settled, self._error = None, None, ""
        if self._run is not None:
            self.show_run(self._run)
        else:
            self._fill()

    def _read(self) -> None:
        self._is_outdated = False
        self.watch.start(self._request(), self._app.runs_folder)
        self._error = ""
        self._notice.dismiss()
        self._refresh()
        self.changed.emit()

    def _confirm(self, operation: RegisterOperation) -> None:
        """Start an operation; if the product requires two engineers, start it after both have confirmed it."""
        try:
            needed = confirmation_required("registers", *self._files())
        except CalstationError as error:
            self._show_failure(error)
            return
        if not needed.second:
            self._start(replace(operation, people=self._app.author))
            return

        def confirmed(reason: str, first: Person, second: Person | None) -> None:
            try:
                people = confirm("registers", *self._files(), first, second)
            except CalstationError as error:
                self._people.retry(error)
                return
            self._people.hide()
            request = replace(operation.request, operator=first.badge)
            self._start(replace(operation, request=request, people=people))

        title = Text.of("engineer.two_engineers", serial=operation.request.serial)
        self._people.ask(title, needed, confirmed, by=self._app.badge or "", reason=False)

    def _files(self) -> tuple[ProductConfig, StationConfig]:
        request = self._request()
        return load_product(request.product)[1], load_station(request.station)[1]

    def _start(self, operation: RegisterOperation) -> None:
        if why_not := "engineer.device_busy" if self._app.job_queue.uses_device else self._app.run.why_not_start:
            self._show_error(why_not)
            return
        self._operation = operation
        self._incomplete = self._error = ""
        self._show_progress("engineer.write_starting")
        self._app.engine_link.start(self._operation)

    def _follow(self, event: Event) -> None:
        """Show the progress and the outcome of the current write."""
        if self._operation is None or self._app.engine_link.operation is not self._operation:
            return
        if isinstance(event, Message):
            if event.id in _INCOMPLETE:
                self._incomplete = event.id
            self._show_progress(event_text(event.id, event.values))
        elif isinstance(event, StepStarted):
            self._show_progress(lambda: step_sentence(event.kind, event.label))
        elif isinstance(event, Settled | Fault):
            self._operation = None
            self._show_end(event)

    def _show_end(self, event: Settled | Fault) -> None:
        """Show the registers after a completed write, or why the write failed or stopped."""
        self._look_up()
        if isinstance(event, Fault):
            self._show_error(lambda: fault_text(event).sentences)
        elif event.closing != "stopped":
            self._show_unit(UnitRegisters.of(event.unit), event)
        else:
            self._show_error(event_text(self._incomplete, {}) if self._incomplete else "engineer.write_stopped")

    # ---- display

    def _show_target(self, target: TargetRegisters | None) -> None:
        self.target = target
        self._settled, self._error, self._why_no_target = None, "", ""
        if target is None or self.unit is None or self.unit.serial != target.serial:
            self.unit = None
        self._fill()

    def _end_reading(self, outcome: UnitRegisters | CalstationError) -> None:
        if self._is_outdated:
            self._refresh()
            self.changed.emit()
        elif isinstance(outcome, CalstationError):
            self._show_failure(outcome)
        else:
            self._show_unit(outcome)

    def _show_unit(self, unit: UnitRegisters, settled: Settled | None = None) -> None:
        self.unit, self._settled = unit, settled
        self._error = self._progress = ""
        self._fill()

    def _show_progress(self, words: Words) -> None:
        self._progress = words
        self._refresh()

    def _refuse_target(self, error: CalstationError) -> None:
        self._why_no_target, self._progress = error.as_text, ""
        self._refresh()
        self.changed.emit()

    def _show_failure(self, error: CalstationError) -> None:
        self._show_error(error.as_text)

    def _show_error(self, words: Words) -> None:
        self._error, self._progress = words, ""
        self._refresh()
        self.changed.emit()

    def _look_up(self) -> None:
        """Read the unit's latest transfer, and what became of the registers that the run wrote, from the journal."""
        run, shown = self._run, self.unit or self.target
        self._wrote = self._latest = None
        try:
            station = load_station(self._request().station)[1]
            if run is not None and not (run.result.simulated and station.bench is None):  # wrote to no real unit
                self._wrote = run_registers(run.result, run.runs)
            if shown is not None:
                self._latest = unit_transfer(station, self._app.runs_folder, shown.serial)
        except CalstationError as error:
            self._error = error.as_text

    def _fill(self) -> None:
        self._look_up()
        target = self.target
        old = self.unit.registers if self.unit is not None else ()
        if self.unit is None and target is not None:
            old = target.written if self._written_remain else target.before
        self._old = {register.parameter: register for register in old}
        self._new = {} if target is None else {r.parameter: r for r in target.registers}
        names = sorted({**self._old, **self._new}, key=self._address)
        self._table.show_cells({name: self._cells(name) for name in names}, ("old", "new", "change"))
        self._table.setVisible(bool(names))
        self._empty.setVisible(not names)
        self._refresh()
        self.changed.emit()

    def _cells(self, name: str) -> dict[str, str]:
        old, new = self._old.get(name), self._new.get(name)
        cells = {"address": str(self._address(name)), "unit": display(name, 0.0)[1]}
        cells["before_run"] = self._before_run(name)
        if old is not None:
            cells |= {"old": f"{display(name, old.value)[0]:.4f}", "old_raw": old.raw}
        if new is not None:
            cells |= {"new": f"{display(name, new.value)[0]:.4f}", "new_raw": new.raw}
        if old is not None and new is not None:
            difference = display(name, new.value - old.value)[0]
            cells["change"] = "0" if old.raw == new.raw else f"{difference:+.4f}"
        return cells

    def _changes(self) -> list[str]:
        """Return the parameters whose stored value would change."""
        return [n for n, new in self._new.items() if n in self._old and self._old[n].raw != new.raw]

    def _address(self, name: str) -> int:
        return (self._old.get(name) or self._new[name]).address

    @property
    def _written_remain(self) -> bool:
        """Whether, according to its journal, the unit still contains the verified registers that the run wrote."""
        return self._wrote is not None and self._wrote.verified and not self._wrote.replaced

    def _old_heading(self) -> str:
        in_unit = self.unit is not None or self._written_remain
        return say("engineer.in_unit" if in_unit else "engineer.old")

    def _before_run(self, name: str) -> str:
        """Return a tooltip with the value before the run that wrote the registers, or "" if the run wrote none."""
        before = self.target.before if self.target is not None and self._wrote is not None else ()
        register = next((register for register in before if register.parameter == name), None)
        if register is None:
            return ""
        value, unit = display(name, register.value)
        return say("engineer.before_run", value=f"{value:.4f}", unit=unit)

    def _ask(self) -> None:
        """Ask for confirmation of a write, stating the changes and any verdict other than PASS.

        If a transfer was interrupted, ask instead whether to finish or to revert it.
        """
        target, unit, run = self.target, self.unit, self._run
        if unit is not None and self._interrupted:
            self._ask_interrupted(unit.serial)
            return
        if target is None or unit is None or run is None:
            return
        result, log = run.result, Path(run.result.log.file).name
        request = replace(self._request(), serial=result.serial)
        write = RegisterOperation(request, "write", dict(target.values), log)
        changes, count = self._changes(), len(target.registers)
        values = {
            "changes": len(changes),
            "addresses": ranges_of(map(self._address, changes)),
            "commits": unit.commits + 1,
            "engineer": self._request().operator or "",
        }

        def text() -> str:
            return f"{say('engineer.about_write', **values)}\n{self._about_verification('verify')}"

        choices = self._choices(write, "write", Text.of("engineer.write_registers", count=count))
        passed, later = result.verdict == "passed", self._later(result)
        kind = "caution" if passed or later is not None else verdict_badge(result)[0]

        def title() -> str:
            code = "engineer.ask_write" if passed else "engineer.ask_write_despite"
            question = say(code, count=count, serial=unit.serial, verdict=verdict_badge(result)[1])
            return joined(say(later), question, language.current()) if later is not None else question

        self._notice.ask(kind, title, text, choices)

    def _ask_interrupted(self, serial: str) -> None:
        """Ask whether to finish an interrupted transfer and verify its registers, or to restore the old ones."""
        request = replace(self._request(), serial=serial)
        restore = RegisterOperation(request, "restore", at_rest=True)
        choices = self._choices(RegisterOperation(request, "finish"), "finish", "engineer.finish")
        revert = Choice("restore_registers_button", "engineer.restore", lambda: self._confirm(restore))
        title, about = Text.of("engineer.ask_finish", serial=serial), partial(self._about_verification, "finish")
        self._notice.ask("caution", title, about, [choices[0], revert, *choices[1:]])

    def _choices(self, operation: RegisterOperation, code: str, by_hand: Words) -> list[Choice]:
        """Return the choices of a question: cancel, or start an operation with or without motion of the table."""
        at_rest = partial(self._confirm, replace(operation, at_rest=True))
        cancel = Choice("cancel_write_button", "common.cancel", lambda: None, primary=True, safe=True)
        if not self.table:
            return [cancel, Choice("confirm_write_button", by_hand, at_rest)]
        turn = partial(self._confirm, operation)
        return [
            cancel,
            Choice("confirm_at_rest_button", f"engineer.{code}_at_rest", at_rest),
            Choice("confirm_write_button", f"engineer.{code}_and_turn", turn),
        ]

    def _about_verification(self, what: str) -> str:
        return say(f"engineer.about_{what}_{'by_turns' if self.table else 'at_rest'}", table=self.table)

    def _later(self, result: Result) -> Text | None:
        """Return a text if the registers of the unit were written after the run of a result, or None."""
        latest, started = self._latest, result.started_utc
        if latest is None or not started or latest.utc < started or latest.source == Path(result.log.file).name:
            return None
        code = "engineer.later_run" if latest.why == "run" else "engineer.later_write"
        return Text.of(code, serial=result.serial, time=latest.utc)

    def _show_reason(self) -> None:
        """Show why a button is disabled, because touch screens show no tooltips; show it only once."""
        self._reason.setText(self._why_not)
        shown = not self._why_not or self._why_not in self._about.text()
        self._reason.setVisible(not (shown or self.watch.busy or self._progress))

    def _refresh(self) -> None:
        busy = self.watch.busy
        self._job.setVisible(busy)
        self._about.setVisible(not busy)
        for widget in (self._read_button, self._write_button):
            widget.setVisible(not busy and not self._progress)
        self._write_button.setText(say("engineer.finish_transfer" if self._interrupted else "engineer.write_unit"))
        kind, state = self._state()
        self._badge.setVisible(not busy and bool(state))
        if state:
            self._badge.show_state(kind, say(f"engineer.state_{state}", count=len(self._changes())))
        theme.set_kind(self._about, "error" if self._error else "")
        self._about.setText(say(self._error or self._progress or self._sentences))
        self._show_reason()

    @property
    def _stated(self) -> RunRegisters | None:
        """Registers that the run wrote; None while the target registers are computed, or if the run wrote none."""
        return self._wrote if self.target is not None or self._why_no_target else None

    def _state(self) -> tuple[str, str]:
        """Return the shape of the badge and the key of its text; both are "" if there is no badge."""
        if self._progress:
            return "active", "writing"
        if self._error:
            return "bad", "failed"
        if self._settled is not None:
            return ("good", "verified") if self._settled.closing == "done" else ("caution", "restored")
        wrote = self._stated
        if self._interrupted or (wrote is not None and not (wrote.verified or wrote.replaced)):
            return "caution", "unverified"
        if self.unit is None and wrote is not None:
            return ("caution", "replaced") if wrote.replaced else ("good", "written")
        if self.unit is not None and self._new:
            return ("caution", "differ") if self._changes() else ("good", "equal")
        return "", ""

    def _sentences(self) -> str:
        """Return what is known about the registers of the unit."""
        proof = "" if self._settled is None else self._settled.proof
        texts = [say(f"engineer.verified_{proof}")] if proof else []
        what = [] if self._stated is None else self._stated.texts
        if self._settled is not None and self._latest is not None and self._latest.why == "hand":
            what = [Text.of("registers.written_at", time=self._latest.utc)]
        wrote = say("engineer.run_wrote", what=what) if what else ""
        texts += [wrote[0].upper() + wrote[1:]] if wrote else []
        if self._why_no_target:
            texts.append(say(self._why_no_target))
        if (unit := self.unit) is not None:
            values = {"model": unit.model, "firmware": unit.firmware, "commits": unit.commits}
            texts.append(say("engineer.unit_read", serial=unit.serial, **values))
            if unit.virtual:
                texts.append(say("engineer.unit_virtual"))
        elif self._new and not self._written_remain:
            texts.append(say("engineer.old_of_run" if self._old else "engineer.read_unit"))
        return " ".join(texts)
