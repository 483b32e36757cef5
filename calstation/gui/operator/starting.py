"""Start of runs: checks the serial numbers, asks the necessary questions, starts the engine."""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject

from calstation.config import (
    Person,
    RunRequest,
    computer_user,
    confirm,
    confirmation_required,
    load_product,
    load_station,
    new_batch_id,
)
from calstation.errors import CalstationError
from calstation.gui.operator.header import RunHeader
from calstation.gui.operator.interrupted import InterruptedRuns, product_file
from calstation.gui.operator.questions import ask
from calstation.gui.operator.units import Slots
from calstation.gui.state import AppContext, PeoplePanel
from calstation.gui.text import on_language_change, say
from calstation.gui.widgets import NoticeBar
from calstation.messages import Text
from calstation.records import RunRecord
from calstation.results import History
from calstation.runs import Resumable, RunSummary
from calstation.sound import play


class RunStarter(QObject):
    """Performs all steps from a scan, or from the offer of an interrupted run, to the start of the engine."""

    def __init__(self, app: AppContext, header: RunHeader, notice: NoticeBar) -> None:
        super().__init__(header)
        self._app, self._header, self._notice = app, header, notice
        #: Panel that asks for the engineers who permit a run.
        self.people = PeoplePanel("override")
        #: Summary of the next run; None if station and product are unusable.
        self.run_summary: RunSummary | None = None
        #: Units of the next run at a station with several slots.
        self.slots = Slots(self)
        #: Serial number last suggested by the virtual bench.
        self._suggested = ""
        self.interrupted = InterruptedRuns(app, header, notice, self._resume)
        header.serial_entered.connect(self.scan)
        header.serial_edited.connect(self.edited)
        header.start_pressed.connect(self.start)
        header.badge_field.signed_in.connect(self._signed_in)
        header.badge_field.refused.connect(self._badge_refused)
        self.slots.changed.connect(self._note_next)
        on_language_change(header, self._note_next)

    def plan(self, run_summary: RunSummary | None) -> None:
        """Set the next run."""
        self.run_summary = self.interrupted.run_summary = run_summary
        if run_summary is not None:
            self.slots.plan(run_summary.slots)
        self.suggest()

    def suggest(self) -> None:
        """Fill an empty field or empty slots with serial numbers that have not passed yet; only on the virtual bench.

        Earlier suggestions are replaced, or removed on hardware. While a verdict is shown, the next run has other
        units.
        """
        header, run, slots = self._header, self._app.run, self.slots
        if self._suggested and header.serial == self._suggested:
            header.set_serial("")
        slots.remove_units(only_suggested=True)
        judged = [unit.serial for unit in run.units] if run.ended or run.fault is not None else []
        if self.run_summary is not None and self.run_summary.virtual and not header.serial:
            history = self._history()

            def unsuitable(serial: str) -> bool:
                taken = serial in judged or serial in slots.serials
                return taken or (history is not None and history.passed_before(serial) is not None)

            for slot in [each for each in slots if each.open]:
                slots.suggest(slot, suggested_serial(self.run_summary, unsuitable))
            if not slots:
                self._suggested = suggested_serial(self.run_summary, unsuitable)
                header.set_serial(self._suggested)
        self._note_next()

    def clear_units(self) -> None:
        """Remove the units of the last run and suggest the next ones."""
        self._header.set_serial("")
        self.slots.remove_units()
        self.suggest()

    def offer_same_units(self) -> None:
        """Offer to calibrate the unfinished units after a run of several units that was not completed."""
        serials = {unit.slot: unit.serial for unit in self._app.run.units if unit.unfinished}
        if not serials:
            return

        def fill() -> None:
            self.slots.remove_units(only_suggested=True)
            for slot in [each for each in self.slots if each.name in serials]:
                serial = serials[slot.name]
                self.slots.fill(slot, serial, self._attempts(serial))
            if self._app.run.ended:
                self._app.run.acknowledge()
            self._await_start()

        question = Text.of("question.same_units", serials=list(serials.values()))
        ask(self._notice, "paused", question, {"same_units": fill, "cancel": self._header.focus_scan})

    def scan(self) -> None:
        """Check the entered serial number; if its run was interrupted, offer to resume it.

        A badge scanned into the field signs in the operator: a badge in the station's list, or any text that has the
        form of a badge but not of a serial number.
        """
        header, badge = self._header, self._header.serial
        sign_in = header.badge_field.section
        if sign_in is not None and (badge in sign_in.names or (sign_in.is_badge(badge) and not self._valid(badge))):
            header.set_serial("")
            self.suggest()
            header.badge_field.sign_in(badge)
            return
        accepted = self.check()
        self._signal(accepted=accepted)
        if accepted and not self.slots and (interrupted := self.interrupted.of(header.serial)) is not None:
            self.interrupted.ask(interrupted, self._start_anew)

    def _signed_in(self) -> None:
        """Continue with the serial number, or with runs that can be resumed."""
        self._signal(accepted=True)
        if not self._notice.asking:
            self._notice.dismiss()
        self._header.focus_scan()
        self.interrupted.offer()

    def _badge_refused(self, error: CalstationError) -> None:
        self._signal(accepted=False)
        ask(self._notice, "caution", error.as_text, {})
        self._header.focus_scan()

    def _signal(self, *, accepted: bool) -> None:
        """Play the sound of an accepted or a refused scan, unless this computer is muted."""
        if self._app.settings.value("sounds", True, type=bool):
            play("accepted" if accepted else "refused")

    def _valid(self, serial: str) -> bool:
        return self.run_summary is not None and re.fullmatch(self.run_summary.serial_pattern, serial) is not None

    def edited(self) -> None:
        """Remove a notice or a question about units that were edited in the field or in the slots."""
        self._note_next()
        if self.run_summary is not None and not self._app.run.going:
            self._notice.dismiss()

    def check(self) -> bool:
        """Check the serial number; if it is valid, move the focus to START, which must be pressed separately.

        At a station with several slots, put the unit into its slot; the focus moves on when all slots have one, or
        when Enter has been pressed without a serial number.
        """
        header, slots = self._header, self.slots
        if self.run_summary is None:
            return False
        if slots.units and not header.serial:
            self._await_start()
            return True
        if not self._valid(header.serial):
            self._refuse(say("operator.not_valid"))
            code = "question.invalid_serial" if header.serial else "question.missing_serial"
            example = self.run_summary.serial_example
            ask(self._notice, "caution", Text.of(code, serial=header.serial, example=example), {})
            header.focus_scan()
            return False
        if slots and (where := slots.slot_of(header.serial)) is not None:
            self._refuse(say("operator.twice"))
            ask(self._notice, "caution", Text.of("question.serial_twice", serial=header.serial, slot=where.name), {})
            header.focus_scan()
            return False
        if slots and slots.next is None:
            self._refuse(say("operator.no_slot_left"))
            ask(self._notice, "caution", Text.of("question.no_slot_left", serial=header.serial), {})
            header.focus_scan()
            return False
        before = self._attempts(header.serial)
        if self._app.run.ended:
            self._app.run.acknowledge()
        if slots.next is not None:
            slots.fill(slots.next, header.serial, before)
            self._app.claim(*slots.units)
            header.set_serial("")
            self._notice.dismiss()
            self._note_next(accepted=True)
            self._await_start() if slots.full else header.focus_scan()
            return True
        self._app.claim(header.serial)
        note = say("operator.attempt" if before else "operator.accepted", count=before + 1)
        header.note_serial(note, accepted=True)
        self._await_start()
        return True

    def _await_start(self) -> None:
        """Move the focus to START, or to a missing badge."""
        if self._header.badge_field.required:
            self._header.focus_scan()
        else:
            self._header.start_button.setFocus()

    def _refuse(self, note: str) -> None:
        """Show next to the field that a scan was refused."""
        self._header.note_serial(note, accepted=False)

    def start(self) -> None:
        """Check the serial number, ask the necessary questions, then start the run."""
        if self._app.engine_link.running or not self.check():
            return
        interrupted = None if self.slots else self.interrupted.of(self._header.serial)
        if interrupted is None:
            self._start_anew()
        else:
            self.interrupted.ask(interrupted, self._start_anew)

    def _start_anew(self) -> None:
        """Start a run from its first stage, after a question if a unit has passed before or failed too often."""
        if self.run_summary is None:
            return
        app, history, slots = self._app, self._history(), self.slots
        units = slots.units or (self._header.serial,)
        batch = {"serials": slots.serials, "batch": new_batch_id()} if slots else {}
        request = self._request(units[0], app.product_path, app.stages, schedule=app.schedule, **batch)
        allowed = self.run_summary.attempts_allowed
        failures = {serial: history.failures(serial) for serial in units} if history is not None else {}
        too_often = [serial for serial, count in failures.items() if allowed is not None and count >= allowed]
        others = [serial for serial in units if serial not in too_often]
        passed = {serial: history.passed_before(serial) for serial in others} if history is not None else {}
        before = {serial: run for serial, run in passed.items() if run is not None}
        if too_often:
            self._ask_attempt(too_often, max(failures.values()), before, request)
        else:
            self._ask_repeat(before, request)

    def _ask_repeat(self, before: Mapping[str, RunRecord], request: RunRequest) -> None:
        """Ask whether to calibrate units again that have passed before, if any, and start the run."""
        if not before:
            self.run(request)
            return
        question = Text.of("question.units_passed_before", serials=list(before))
        if not self.slots:
            ((serial, first),) = before.items()
            where = "passed_elsewhere" if first.origin else "passed_before"
            when, station = first.started_utc, first.station or "?"
            question = Text.of(f"question.{where}", serial=serial, when=when, station=station)
        self._ask(question, {"repeat": lambda: self.run(request)})

    def run(self, request: RunRequest) -> None:
        """Start a run; ask for confirmation before a real table moves."""
        if self.run_summary is not None and self.run_summary.virtual:
            self._launch(request)
        else:
            station = self.run_summary.station if self.run_summary is not None else ""
            question = Text.of("question.table_moves", station=station)
            self._ask(question, {"clear": lambda: self._launch(request)})

    def _launch(self, request: RunRequest) -> None:
        """Start the engine for the current operator, unless a badge is missing or a job uses a device."""
        badge_field = self._header.badge_field
        if badge_field.required:
            ask(self._notice, "caution", Text("station.badge_missing"), {})
            self._header.focus_scan()
        elif self._app.job_queue.at_device:
            self._ask(Text.of("question.device_busy"), {"clear": lambda: self._launch(request)})
        else:
            self._app.engine_link.start(replace(request, operator=badge_field.operator))

    def ask_transfer(self, request: RunRequest, serial: str) -> None:
        """Ask whether to restore old registers or to finish an interrupted transfer, then calibrate the unit alone."""
        slots = tuple(each if each == serial else "" for each in request.serials)
        request = replace(request, serial=serial, serials=slots, batch=None)
        manual = self.run_summary is None or self.run_summary.by_hand
        question = Text.of(
            "question.transfer_interrupted_manual" if manual else "question.transfer_interrupted", serial=request.serial
        )
        answers = {
            "restore": lambda: self.run(replace(request, unfinished="restore")),
            "finish": lambda: self.run(replace(request, unfinished="finish")),
        }
        self._ask(question, answers)

    def ask_override(self, request: RunRequest, refusal: Text) -> None:
        """Offer an engineer to calibrate despite an overdue or failed check standard or certificate."""
        if not self.slots:
            self._header.set_serial(request.serial)
        self._ask(refusal, {"override": lambda: self._ask_engineer(request)})

    def _ask_engineer(self, request: RunRequest) -> None:
        try:
            files = load_product(request.product)[1], load_station(request.station)[1]
        except CalstationError as error:
            ask(self._notice, "caution", Text.of("question.cannot_run", why=error.as_text), {})
            return
        required = confirmation_required("override", *files)

        def confirmed(reason: str, first: Person, second: Person | None) -> None:
            try:
                people = confirm("override", *files, first, second)
            except CalstationError as error:
                ask(self._notice, "bad", error.as_text, {})
                self.people.retry()
                return
            self.people.hide()
            self._notice.dismiss()
            self.run(replace(request, override_standard=reason, overridden_by=people))

        by = (self._app.badge if required.badge else self._app.operator or computer_user()) or ""
        self.people.ask(Text.of("operator.ask_calibrate", serial=request.serial), required, confirmed, by=by)

    def _resume(self, run: Resumable) -> None:
        product = product_file(run.product) or self._app.product_path
        self._header.set_serial(run.serial)
        self.run(self._request(run.serial, product, run.stages, resume=run.log))

    def _request(self, serial: str, product: Path | None, stages: tuple[str, ...] | None, **more: Any) -> RunRequest:
        app = self._app
        return RunRequest(serial, app.station_path, product, stages, app.runs_folder, **more)

    def _history(self) -> History | None:
        """Return the history of earlier runs, or None if there is no runs folder."""
        folder = self._app.runs_folder
        return History(folder) if folder.is_dir() else None

    def _attempts(self, serial: str) -> int:
        """Return the number of earlier runs of a unit."""
        history = self._history()
        return 0 if history is None else history.attempts(serial)

    def _note_next(self, *, accepted: bool | None = None) -> None:
        """Show the slot of the next scan and, while a verdict is shown, that the field is for the next unit."""
        judged = self._app.run.ended or self._app.run.fault is not None
        note, following = (say("operator.next_unit") if judged else ""), self.slots.marked
        if self.slots and not judged and not self._app.run.going:
            full = len(self.slots.units) == len(self.slots.serials)
            note = say("operator.slots_full" if full else "operator.slots_stay_empty")
            if following is not None:
                note = say("operator.slot", slot=following.name)
        self._header.note_serial(note, accepted=accepted)

    def _ask_attempt(
        self, serials: list[str], failures: int, before: Mapping[str, RunRecord], request: RunRequest
    ) -> None:
        """Ask for another attempt after too many failures, which only an engineer can permit, then about the others."""
        kind = "units_" if self.slots else ""
        values = {"serial": serials[0], "serials": serials, "count": failures}
        if self._app.role.engineer:
            question = Text.of(f"question.{kind}allow_attempt", **values)
            beyond = replace(request, beyond_attempts=True)
            self._ask(question, {"beyond": lambda: self._ask_repeat(before, beyond)}, "bad")
        else:
            self._ask(Text.of(f"question.{kind}set_aside", **values), {"unlock": self._app.role.ask}, "bad")

    def _ask(self, question: Text, answers: Mapping[str, Callable[[], None]], kind: str = "caution") -> None:
        """Ask a question that can also be cancelled."""
        ask(self._notice, kind, question, {**answers, "cancel": self._header.focus_scan}, primary="cancel")


def suggested_serial(run_summary: RunSummary, unsuitable: Callable[[str], bool]) -> str:
    """Return the virtual bench's own serial number or one for which `unsuitable` is False; "" for hardware."""
    if run_summary.bench is None:
        return ""
    own = run_summary.bench.get("serial")
    if own is not None and not run_summary.slots:
        return str(own)
    for number in range(1, 1000):
        serial = f"SN-{number:06d}"
        if not re.fullmatch(run_summary.serial_pattern, serial):
            return ""
        if not unsuitable(serial):
            return serial
    return ""
