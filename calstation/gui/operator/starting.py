"""Start of runs on the operator page, from a scan or an interrupted run to the start of the engine."""

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, QTimer

from calstation.config import RunRequest, virtual_serials
from calstation.errors import CalstationError
from calstation.gui.operator.header import RunHeader
from calstation.gui.operator.interrupted import InterruptedRuns
from calstation.gui.operator.questions import StartDialog, ask, sign_in_text
from calstation.gui.state import AppContext, EarlierRuns, Slot, UnitStatus
from calstation.gui.text import fault_text, on_language_change, rendered, say, term
from calstation.gui.widgets import NoticeBar
from calstation.messages import Text
from calstation.records import Verdict
from calstation.results import History
from calstation.runs import Interrupted, RunSummary, product_of, resumable_run
from calstation.sound import play

#: Note next to the serial field by the reason why a scan is refused.
_NOTES = {
    "question.invalid_serial": "operator.not_valid",
    "question.wrong_case": "operator.not_valid",
    "question.two_serials": "operator.not_valid",
    "question.missing_serial": "operator.missing",
    "question.serial_twice": "operator.twice",
    "question.no_slot_left": "operator.no_slot_left",
    "question.slots_skipped": "operator.no_slot_left",
}

#: Time for which the notice about a scan during a run is displayed, ms.
_REFUSED_MS = 10_000


class RunStarter(QObject):
    """The steps to a run: checks scanned serial numbers, fills the slots, and asks the questions before the start."""

    def __init__(self, app: AppContext, header: RunHeader, notice: NoticeBar) -> None:
        super().__init__(header)
        self._app, self._header, self._notice = app, header, notice
        #: Dialog with the questions before a start.
        self.dialog = StartDialog(app, notice, "override", header.focus_scan)
        #: Summary of the next run; None if station and product are unusable.
        self.run_summary: RunSummary | None = None
        #: Units of the next run at a station with several slots.
        self.slots = app.slots
        #: Serial number that the virtual bench suggested last; "" after the user has entered one.
        self._suggested = ""
        self._accepted = False  #: Whether this number has been accepted, as one that the user enters.
        #: Why the entered serial number was refused; None if it was not.
        self.refused: Text | None = None
        self.interrupted = InterruptedRuns(app, header, notice, self._resume)
        #: Whether the question about an interrupted run was open when the notice last changed.
        self._resume_asked = False
        #: Whether the notice says that the fault must be closed first.
        self._fault_named = False
        notice.changed.connect(self._question_changed)
        header.serial_entered.connect(self.scan)
        header.serial_edited.connect(self.edited)
        header.scan_refused.connect(self._refuse_scan)
        #: Timer that is active while the notice about a refused scan is displayed.
        self._refused_shown = QTimer(self, singleShot=True, interval=_REFUSED_MS)
        self._refused_shown.timeout.connect(self._end_refusal)
        header.start_pressed.connect(self.start)
        #: Whether a unit was scanned during the search for interrupted runs; see `_reading_ended`.
        self._scanned_early = False
        #: Timer for one turn of the event loop, in which a search that follows directly begins.
        self._after_search = QTimer(self, singleShot=True, interval=0)
        self._after_search.timeout.connect(self._reading_ended)
        app.run.changed.connect(self._run_changed)
        header.badge_field.signed_in.connect(self._signed_in)
        header.badge_field.refused.connect(self._badge_refused)
        self.slots.changed.connect(self._note_next)
        on_language_change(header, self._note_next)

    def set_next_run(self, run_summary: RunSummary | None) -> None:
        """Set the summary of the next run."""
        self.run_summary = self.interrupted.run_summary = run_summary
        if run_summary is not None:
            self.slots.set_names(run_summary.slots)
        if self.slots:
            self._drop_refused()
        self.suggest()

    def suggest(self) -> None:
        """On the virtual bench, fill empty fields or slots with the serial numbers of units that have not passed yet.

        Earlier suggestions are removed unless they were accepted. While verdicts are displayed, other units are
        suggested. None is suggested after a failed or incomplete run of a single unit, which may be repeated, or for
        slots while a question about an interrupted run is open.
        """
        header, run, slots = self._header, self._app.run, self.slots
        self.refused = None
        is_virtual = self.run_summary is not None and self.run_summary.virtual
        if self._suggested and header.serial == self._suggested and not (self._accepted and is_virtual):
            header.set_serial("")
        slots.remove_units(only_suggested=True)
        displayed = [unit.serial for unit in run.units] if run.ended or run.fault is not None else []
        repeated = not slots and run.state in (Verdict.FAILED, Verdict.STOPPED, Verdict.INCOMPLETE)
        repeated = repeated or (bool(slots) and self.interrupted.asking)
        if self.run_summary is not None and self.run_summary.virtual and not header.serial and not repeated:
            passed, summary = History(self._app.runs_folder).passed_units(), self.run_summary

            def unsuitable(serial: str) -> bool:
                interrupted = bool(slots) and serial in self.interrupted.serials  # another slot might be suggested
                return interrupted or serial in (*displayed, *slots.serials) or serial in passed

            if slots:
                slots.suggest(lambda: suggested_serial(summary, unsuitable))
            else:
                self._suggested, self._accepted = suggested_serial(summary, unsuitable), False
                header.set_serial(self._suggested)
        self._note_next()

    def _question_changed(self) -> None:
        """Replace the suggested units when the question about an interrupted run is asked or has been answered."""
        self._fault_named = False
        if self.interrupted.asking != self._resume_asked:
            self._resume_asked = self.interrupted.asking
            if self.slots and self.refused is None and not self._app.engine_link.running:
                self.suggest()

    def clear_units(self) -> None:
        """Remove the units of the last run, and suggest units for the next one."""
        self._note_last()
        self._enter("")
        self.slots.remove_units()
        self.suggest()

    def await_unit(self) -> None:
        """After a fault, wait for START if a unit was scanned in the meantime, otherwise for a scan."""
        scanned = bool(self._header.serial) and self._header.serial != self._suggested
        self.suggest()
        if not (scanned and self.check()):
            self._header.focus_scan()

    @property
    def being_used(self) -> bool:
        """Whether a serial number is entered, the operator field has the focus, or a notice is displayed."""
        return bool(self._header.serial) or self._header.operator_edit.hasFocus() or not self._notice.isHidden()

    def drop_fault(self) -> None:
        """Clear the fault, and the notice that it must be closed, without checking the entered serial number."""
        if self._fault_named:
            self._notice.dismiss()
        self._app.run.acknowledge()

    def offer_unfinished(self) -> None:
        """After a run, ask about its units with unverified registers.

        Without such units, offer to resume an incomplete run, or else to calibrate its units in slots again.
        """
        run, request = self._app.run, self._app.engine_link.request
        units = [unit for unit in run.units if unit.unfinished]
        undecided = [unit for unit in run.units if self.interrupted.has_open_transfer(unit.serial)]
        if undecided and request is not None:
            apart = [unit for unit in undecided if unit not in units][:1]
            self.ask_transfer(request, *(unit.serial for unit in apart or units))
        elif units:
            again = partial(self._offer_again, units) if self._app.run.in_slots else (lambda: None)
            offered = [unit.serial for unit in run.units if unit in units or unit.resumable]
            self.interrupted.offer(offered, otherwise=again)

    def _offer_again(self, units: Sequence[UnitStatus]) -> None:
        question = Text.of("question.same_units", serials=[unit.serial for unit in units])
        fill = partial(self.fill_again, units)
        ask(self._notice, "paused", question, {"same_units": fill, "cancel": self._header.focus_scan})

    def fill_again(self, units: Sequence[UnitStatus]) -> None:
        """Assign units of the last run to their slots again, and wait for START."""
        self._notice.dismiss()
        self._drop_refused()
        self.slots.remove_units(only_suggested=True)
        serials = {unit.slot: unit.serial for unit in units}
        for slot in [slot for slot in self.slots if slot.name in serials]:
            self.slots.fill(slot, serials[slot.name], self._app.history())
        self._show_slots()
        self.slots.leave_out_others()

    def _show_slots(self) -> None:
        """Show the slots instead of the verdicts, and wait for START."""
        self.leave_verdict()
        self._await_start()

    def leave_verdict(self) -> None:
        """Remove the verdict before the next unit; each slot then shows the verdict on the unit to be unloaded."""
        if self._app.run.ended:
            self._note_last()  # a failed unit may have been released
            self._app.run.acknowledge()

    def _note_last(self) -> None:
        """Note in which slots the units of the last run are."""
        run, request = self._app.run, self._app.engine_link.request
        if (run.ended or run.fault is not None) and request is not None and request.station == self._app.station_path:
            self.slots.note_last({unit.slot: (unit.serial, run.final_state_of(unit)) for unit in run.units})

    def scan(self) -> None:
        """Check the entered serial number; if a run of the unit was interrupted, offer to resume it.

        A badge instead signs in the operator. A text is a badge if the station lists it, or if it has the form of a
        badge but not that of a serial number.
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
        if accepted and self._app.run.fault is not None:
            ask(self._notice, "caution", Text("operator.fault_below"), {})
            self._fault_named = True
        elif accepted and self._notice.isHidden():
            self._remind()
        self._scanned_early = accepted and self._app.run.reading_runs
        if accepted:
            self._ask_interrupted()

    def _ask_interrupted(self) -> None:
        """Ask about an interrupted run of the scanned unit, or about its registers."""
        summary, header = self.run_summary, self._header
        run = self._app.run
        if summary is None or self.slots or header.badge_field.required or run.reading_runs or run.fault is not None:
            return
        if self._interrupted(header.serial, summary.station):
            self.start()

    def _run_changed(self) -> None:
        if self._scanned_early and not self._app.run.reading_runs:
            self._after_search.start()

    def _reading_ended(self) -> None:
        """Check a unit again that was scanned during the search for interrupted runs, which disables START."""
        if not self._scanned_early or self._app.run.reading_runs:
            return
        self._scanned_early = False
        if self._notice.asking or not (self._header.serial or self.slots.full):
            return
        if self.check():
            self._ask_interrupted()

    def _remind(self) -> None:
        """If other units are scanned, warn that units of the last run have unverified registers."""
        scanned = self._header.serial, *self.slots.units
        left = [unit.serial for unit in self._app.run.units if unit.serial not in scanned]
        if undecided := list(filter(self.interrupted.has_open_transfer, left)):
            ask(self._notice, "caution", Text.of("question.registers_left", serials=undecided), {})

    def _interrupted(self, serial: str, station: str) -> bool:
        """Return whether START asks about an interrupted run of a unit, or about its registers."""
        resumable = self.interrupted.has_open_transfer(serial)
        return resumable or resumable_run(self._app.history(), serial, station) is not None

    @property
    def overdue(self) -> tuple[Text, ...]:
        """The overdue calibrations for which START asks an engineer; none for a check standard."""
        summary = self.run_summary
        is_standard = summary is not None and self._header.serial in summary.check_standards
        return () if summary is None or is_standard else summary.overdue

    @property
    def incomplete(self) -> bool:
        """Whether anything is missing before the next run, such as a badge, a valid scan, an answer or a reset."""
        run = self._app.run
        asking = self.asking or self._app.engineer_asks
        missing = self._header.badge_field.required or self.refused is not None or bool(self.overdue) or asking
        return missing or run.unreset is not None or run.why_not_start == "operator.reading_runs"

    def missing_text(self, answer: str) -> str:
        """Return what is missing before the next run, or a note on its product; "" for neither.

        `answer` is the code of the text about an open question, which differs between this page and the others.
        """
        run, summary = self._app.run, self.run_summary
        if run.reading_runs:
            return say("operator.reading_runs")
        if self._app.badge_required:
            return sign_in_text(self._app)
        if run.unreset is not None:
            return fault_text(run.unreset, engineer=self._app.role.engineer).remedy
        if self.asking:
            return say(answer)
        if self._app.engineer_asks:
            return say("operator.answer_engineer")
        if self.refused is not None:
            return rendered(self.refused).text
        if causes := self.overdue:
            return say("operator.message_overdue", causes=causes)
        unjudged = () if summary is None or summary.omitted else summary.unjudged
        return say("operator.message_unjudged", names=unjudged) if unjudged else ""

    @property
    def asking(self) -> bool:
        """Whether a question is open that must be answered before START, also about an interrupted run or transfer."""
        return self.dialog.asking or any(
            self._notice.offers(f"{answer}_choice") for answer in ("later", "restore", "anew")
        )

    @property
    def asking_about_units(self) -> bool:
        """Whether such a question, or one about calibrating incomplete units again, is open."""
        return self.asking or self._notice.offers("same_units_choice")

    def _refuse_scan(self) -> None:
        """Show that a scan during a run was ignored."""
        self._signal(accepted=False)
        badges = self._header.badge_field.section is not None
        ask(self._notice, "bad", Text("question.badge_scan_during_run" if badges else "question.scan_during_run"), {})
        self._refused_shown.start()

    def _end_refusal(self) -> None:
        if not self._notice.asking:
            self._notice.dismiss()

    def _signed_in(self) -> None:
        """Continue with the serial number or with interrupted runs."""
        self._signal(accepted=True)
        if not self._notice.asking:
            self._notice.dismiss()
        self._header.focus_scan()
        self.interrupted.offer()

    def _badge_refused(self, error: CalstationError) -> None:
        self._signal(accepted=False)
        entered, sign_in = str(error.values.get("badge", "")), self._header.badge_field.section
        is_unit = self._valid(entered) and not (sign_in is not None and sign_in.is_badge(entered))
        ask(self._notice, "caution", Text("question.unit_before_badge") if is_unit else error.as_text, {})
        self._header.focus_scan()

    def _signal(self, *, accepted: bool) -> None:
        """Play the sound for an accepted or a refused scan, unless sounds are switched off."""
        if self._app.settings.value("sounds", True, type=bool):
            play("accepted" if accepted else "refused")

    def _valid(self, serial: str) -> bool:
        return self.run_summary is not None and re.fullmatch(self.run_summary.serial_pattern, serial) is not None

    def slot_edited(self) -> None:
        """After a click on a slot, remove a refused serial number and a notice or question about units."""
        self._drop_refused()
        self.edited()

    def _drop_refused(self) -> None:
        """Remove a refused serial number from the field, because START would use it."""
        if self.refused is not None:
            self._enter("")

    def _enter(self, serial: str) -> None:
        """Replace the serial number in the field, which may have been refused."""
        self.refused = None
        self._header.set_serial(serial)

    def edited(self) -> None:
        """Remove a notice or question about units after the field or the slots have been edited."""
        self.refused, self._suggested, self._scanned_early = None, "", False
        self.interrupted.forget_recovery()
        self._note_next()
        if self.run_summary is not None and not self._app.run.in_progress:
            self._notice.dismiss()

    def check(self) -> bool:
        """Return whether the serial number is valid; if so, move the focus to START, which must still be pressed.

        At a station with several slots, assign the unit to the next slot; the focus moves to START when all slots are
        full, or on Enter without a serial number.
        """
        header, slots = self._header, self.slots
        if self.run_summary is None:
            if header.serial:
                header.note_serial(term("badge", "not_ready"), accepted=False)
            return False
        if slots.units and not header.serial:
            self.refused = None
            self._await_start()
            return True
        code = "question.invalid_serial" if header.serial else "question.missing_serial"
        refusal: Text | None = Text.of(code, serial=header.serial, example=self.run_summary.serial_example)
        if header.serial_edit.holds_two(self._valid):
            refusal = Text.of("question.two_serials", serial=header.serial)
        elif header.serial and self._valid(header.serial):
            refusal = slots.refusal(header.serial) if slots else None
        elif header.serial and self._valid(other := header.serial.swapcase()):
            refusal = Text.of("question.wrong_case", serial=header.serial, other=other)
        self.refused = refusal
        if refusal is not None:
            header.note_serial(say(_NOTES[refusal.code]), accepted=False)
            ask(self._notice, "caution", refusal, {})
            header.focus_scan()
            return False
        self.leave_verdict()
        if slots.next is not None:
            serial, slot = header.serial, self._last_slot(header.serial, self.run_summary.station) or slots.next
            moved = slot is not slots.next
            self.slots.fill(slot, serial, self._app.history())
            self._app.claim(*slots.units)
            header.set_serial("")
            self._notice.dismiss()
            if moved:
                ask(self._notice, "caution", Text.of("question.last_slot", serial=serial, slot=slot.name), {})
            self._note_next(accepted=True)
            self._await_start() if slots.full else header.focus_scan()
            return True
        self._accepted = True
        self._app.claim(header.serial)
        earlier = EarlierRuns.of(self._app.history(), header.serial)
        header.note_serial(say(earlier.note), accepted=True)
        self._await_start()
        return True

    def _last_slot(self, serial: str, station: str) -> Slot | None:
        """Return the slot in which a unit was last or was interrupted, or None if a scan does not fill it."""
        name = self.slots.last(serial)
        if not name and (interrupted := resumable_run(self._app.history(), serial, station)) is not None:
            name = interrupted.slot or ""
        return self.slots.fillable(name)

    def _await_start(self) -> None:
        """Move the focus to START or, if a badge is required, to the badge field."""
        if self._header.badge_field.required:
            self._header.focus_scan()
        else:
            self._header.start_button.setFocus()

    def start(self) -> None:
        """Check the serial number, ask the questions before a start, then start the run.

        At a station with several slots, while verdicts are displayed or a number is in the field, show the units in the
        slots instead, so that no unit is calibrated that was not displayed.
        """
        serial, displayed = self._header.serial, not (self.slots and (self._app.run.ended or self._header.serial))
        if self._app.engine_link.running or not self.check():
            return
        if not displayed:
            self._show_slots()
            if self._notice.isHidden():
                names = [slot.name for slot in self.slots if serial and slot.serial == serial]
                entered = Text.of("question.unit_in_slot", serial=serial, slot="".join(names))
                ask(self._notice, "none", entered if names else Text("question.units_in_slots"), {})
            return
        app, units = self._app, self.slots.units or (self._header.serial,)
        self.dialog.begin(
            self._request(units[0], app.product_path, app.stages, serials=self.slots.serials, schedule=app.schedule)
        )

    def ask_transfer(self, request: RunRequest, *serials: str) -> None:
        """Ask whether to undo or finish open transfers, then start a run of only these units from its first stage."""
        slots = tuple(serial if serial in serials else "" for serial in request.serials)
        self._enter("" if self.slots else serials[0])  # instead of a suggested unit
        anew = replace(request, serial=serials[0], serials=slots, batch=None, resume=None, resumes=(), unfinished=None)
        self.dialog.begin(anew)

    def _resume(self, interrupted: Interrupted) -> None:
        self._enter("")  # if the run is refused, no unit that was not scanned can be started
        self.slots.remove_units()
        logs = interrupted.logs
        known = None
        with suppress(CalstationError):  # the dialog shows the error of the log
            known = product_of(logs[0])
        product = self._app.product_path if known is None else None
        resumes = logs if self.slots else ()
        self.dialog.begin(self._request("", product, None, resume=logs[0], resumes=resumes))

    def _request(self, serial: str, product: Path | None, stages: tuple[str, ...] | None, **more: Any) -> RunRequest:
        app = self._app
        return RunRequest(serial, app.station_path, product, stages, app.runs_folder, **more)

    def _note_next(self, *, accepted: bool | None = None) -> None:
        """Show next to the serial field to which unit or slot the next scan applies."""
        judged = self._app.run.ended or self._app.run.fault is not None
        note, next_slot = (say("operator.next_unit") if judged else ""), self.slots.marked
        if self.slots and not judged and not self._app.run.in_progress:
            full = len(self.slots.units) == len(self.slots.serials)
            left_out = any(slot.left_out for slot in self.slots)
            others = "operator.others_left_out" if left_out else "operator.slots_stay_empty"
            note = say("operator.slots_full" if full else others)
            if next_slot is not None:
                note = say("operator.slot", slot=next_slot.name)
        self._header.note_serial(note, accepted=accepted)


def suggested_serial(run_summary: RunSummary, unsuitable: Callable[[str], bool]) -> str:
    """Return the next serial number of the virtual bench for which `unsuitable` returns False, or "" for hardware.

    A number that does not match the product's pattern is suggested only if it is in the station file.
    """
    if run_summary.bench is None:
        return ""
    serial = virtual_serials(run_summary.bench, run_summary.slots, unsuitable)[0]
    in_file = "serial" in run_summary.bench and not run_summary.slots
    return serial if in_file or re.fullmatch(run_summary.serial_pattern, serial) else ""
