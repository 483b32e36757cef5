"""Starts and resumes runs: checks the serial number, asks the necessary questions, starts the engine."""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject

from calstation.config import (
    Person,
    RunRequest,
    RunSummary,
    computer_user,
    confirm,
    confirmation_required,
    library,
    load_product,
    load_station,
)
from calstation.errors import CalstationError
from calstation.gui.operator.header import RunHeader
from calstation.gui.operator.questions import ask
from calstation.gui.shell import AppContext, PeoplePanel
from calstation.gui.text import event_sentence, on_language_change
from calstation.gui.widgets import JobWatch, NoticeBar
from calstation.messages import Text
from calstation.results import Delivery, History
from calstation.runs import Resumable, close_incomplete_job, find_resumable, recover_startup, resumable_run
from calstation.sound import play


class RunStarter(QObject):
    """Performs all steps from a scan, or from the offer of an interrupted run, to the start of the engine."""

    def __init__(self, app: AppContext, header: RunHeader, notice: NoticeBar) -> None:
        super().__init__(header)
        self._app, self._header, self._notice = app, header, notice
        #: Asks for the engineers who allow a run.
        self.people = PeoplePanel("override")
        #: Summary of the next run; None while station and product cannot be used.
        self.run_summary: RunSummary | None = None
        #: Serial number that the virtual bench has suggested last.
        self._suggested = ""
        self._wanted: Path | None = None
        self._serial: str | None = None
        self._search, self._closing = JobWatch(self, self._found, self._not_found), JobWatch(self)
        self._recovery = JobWatch(self, lambda done: self._show_delivery(done.delivery), self._not_recovered)
        notice.report_failures(self._closing, lambda: self.tr("The run was not closed"), header.focus_scan)
        app.resume_run.connect(lambda log: self.offer(log=log))
        header.serial_entered.connect(self.scan)
        header.serial_edited.connect(self._edited)
        header.start_pressed.connect(self.start)
        header.badge_field.signed_in.connect(self._signed_in)
        header.badge_field.refused.connect(self._badge_refused)
        on_language_change(header, self._note_next)

    def suggest(self) -> None:
        """On the virtual bench, fill an empty field with a serial number that has not passed yet.

        An earlier suggestion is replaced, on hardware by nothing. While a verdict is shown, the field is for another
        unit.
        """
        header, run = self._header, self._app.run
        if self._suggested and header.serial == self._suggested:
            header.set_serial("")
        judged = run.serial if run.ended or run.fault is not None else ""
        if self.run_summary is not None and self.run_summary.virtual and not header.serial:
            history = self._history()

            def unsuitable(serial: str) -> bool:
                return serial == judged or (history is not None and history.passed_before(serial) is not None)

            self._suggested = suggested_serial(self.run_summary, unsuitable)
            header.set_serial(self._suggested)
        self._note_next()

    def scan(self) -> None:
        """Check the serial number that has been entered; if its run was interrupted, offer to resume it.

        A badge that was scanned into the field signs in the operator: one of the station's list, or any text of the
        form of a badge that is no serial number.
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
        if accepted and (interrupted := self._interrupted()) is not None:
            self._ask_resume(interrupted)

    def _signed_in(self) -> None:
        """Go on with the serial number, or with runs that can be resumed."""
        self._signal(accepted=True)
        if not self._notice.asking:
            self._notice.dismiss()
        self._header.focus_scan()
        self.offer()

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

    def check(self) -> bool:
        """Check the serial number; if it is valid, move the focus to START, which has to be pressed separately."""
        header = self._header
        if self.run_summary is None:
            return False
        if not self._valid(header.serial):
            header.note_serial(self.tr("not valid"), accepted=False)
            code = "question.invalid_serial" if header.serial else "question.missing_serial"
            example = self.run_summary.serial_example
            ask(self._notice, "caution", Text.of(code, serial=header.serial, example=example), {})
            header.focus_scan()
            return False
        history = self._history()
        before = history.attempts(header.serial) if history is not None else 0
        if self._app.run.ended:
            self._app.run.acknowledge()
        self._app.claim(header.serial)
        note = self.tr("attempt {count}").format(count=before + 1) if before else self.tr("accepted")
        header.note_serial(note, accepted=True)
        if header.badge_field.required:
            header.focus_scan()
        else:
            header.start_button.setFocus()
        return True

    def start(self) -> None:
        """Check the serial number, ask the necessary questions, then start the run."""
        if self._app.engine_link.running or not self.check():
            return
        interrupted = self._interrupted()
        if interrupted is None:
            self._start_anew()
        else:
            self._ask_resume(interrupted)

    def _start_anew(self) -> None:
        """Start a run from its first stage, after a question if the unit has passed or failed too often."""
        if self.run_summary is None:
            return
        app, serial, history = self._app, self._header.serial, self._history()
        request = self._request(serial, app.product_path, app.stages, schedule=app.schedule)
        allowed = self.run_summary.attempts_allowed
        if history is not None and allowed is not None and (failures := history.failures(serial)) >= allowed:
            self._ask_attempt(failures, request)
        elif history is not None and (passed := history.passed_before(serial)) is not None:
            where = "passed_elsewhere" if passed.origin else "passed_before"
            when, station = passed.started_utc, passed.station or "?"
            question = Text.of(f"question.{where}", serial=serial, when=when, station=station)
            self._ask(question, {"repeat": lambda: self.run(request)})
        else:
            self.run(request)

    def run(self, request: RunRequest) -> None:
        """Start a run; ask for confirmation before a real table moves."""
        if self.run_summary is not None and self.run_summary.virtual:
            self._launch(request)
        else:
            station = self.run_summary.station if self.run_summary is not None else ""
            question = Text.of("question.table_moves", station=station)
            self._ask(question, {"clear": lambda: self._launch(request)})

    def _launch(self, request: RunRequest) -> None:
        """Start the engine for the present operator, unless a badge is missing or a job uses a device."""
        badge_field = self._header.badge_field
        if badge_field.required:
            ask(self._notice, "caution", Text("station.badge_missing"), {})
            self._header.focus_scan()
        elif self._app.job_queue.at_device:
            self._ask(Text.of("question.device_busy"), {"clear": lambda: self._launch(request)})
        else:
            self._app.engine_link.start(replace(request, operator=badge_field.operator))

    def ask_transfer(self, request: RunRequest) -> None:
        """Ask whether to restore the old registers or to finish an interrupted transfer, then start the run."""
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
        """Offer an engineer to calibrate although a check standard or a certificate is not in order."""
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
        self.people.ask(
            lambda: self.tr("Calibrate {0} nevertheless?").format(request.serial), required, confirmed, by=by
        )

    # ---- interrupted runs

    def recover(self) -> None:
        """When the window opens, close aborted runs, hand over pending results, then offer runs that can be resumed."""
        if self._app.runs_folder.is_dir():
            recovery = self._app.job_queue.submit(recover_startup, self._app.runs_folder, self._app.station_path)
            self._recovery.watch(recovery)
        self.offer()

    def _not_recovered(self, error: CalstationError) -> None:
        if self.run_summary is not None:  # otherwise the page shows what is wrong with station and product
            self._notice.report(lambda: self.tr("Earlier runs were not closed or handed over"), error, self.offer)

    def _show_delivery(self, delivery: Delivery) -> None:
        """Show why results could not be handed over."""
        if delivery.waiting and not self._notice.asking:
            values = {"count": delivery.waiting, "folder": str(delivery.folder), "reason": delivery.reason}
            self._notice.ask("caution", lambda: event_sentence("handover_waiting", values), str)

    def offer(self, serial: str | None = None, log: Path | None = None) -> None:
        """Offer runs that can be resumed, limited to those of the unit `serial` or to the run of `log` if given."""
        self._serial, self._wanted = serial, log
        if self._app.runs_folder.is_dir():
            self._search.watch(self._app.job_queue.submit(find_resumable, self._app.runs_folder))

    def _found(self, found: list[Resumable]) -> None:
        if self._app.engine_link.running or self.run_summary is None:
            return
        if self._wanted is None:
            self._offer([run for run in found if self._serial in (None, run.serial)])
            return
        chosen = [run for run in found if run.log.name == self._wanted.name]
        if chosen:
            self._notice.dismiss()
            self._offer(chosen)  # it was chosen on another page, so someone may be at the fixture
        else:
            ask(self._notice, "caution", Text.of("question.nothing_to_resume"), {})

    def _not_found(self, error: CalstationError) -> None:
        ask(self._notice, "caution", Text.of("question.cannot_resume", why=error.as_text), {})

    def _interrupted(self) -> Resumable | None:
        """Return the run of the unit entered that can be resumed, or None."""
        folder = self._app.runs_folder
        return resumable_run(folder, self._header.serial) if folder.is_dir() else None

    def _ask_resume(self, run: Resumable) -> None:
        """Ask whether to resume the run of the unit entered, or to calibrate it from the first stage."""
        answers = {
            "resume": lambda: self._resume(run),
            "anew": self._start_anew,
            "cancel": self._header.focus_scan,
        }
        ask(self._notice, "paused", _resume_question(run), answers, primary="resume")

    def _offer(self, runs: list[Resumable]) -> None:
        if not runs or self._notice.asking:
            return
        run, others = runs[0], runs[1:]
        answers = {
            "resume": lambda: self._resume(run),
            "close_incomplete_job": lambda: self._close(run, others),
            "later": lambda: self._offer(others),
        }
        ask(self._notice, "paused", _resume_question(run), answers, primary="resume")

    def _resume(self, run: Resumable) -> None:
        product = _product_file(run.product) or self._app.product_path
        self._header.set_serial(run.serial)
        self.run(self._request(run.serial, product, run.stages, resume=run.log))

    def _close(self, run: Resumable, others: list[Resumable]) -> None:
        if self._app.badge_required:
            ask(self._notice, "caution", Text("station.badge_missing"), {})
            return
        operator = self._app.operator or computer_user()
        self._closing.watch(self._app.job_queue.submit(close_incomplete_job, run.log, operator))
        self._offer(others)

    def _request(self, serial: str, product: Path | None, stages: tuple[str, ...] | None, **more: Any) -> RunRequest:
        app = self._app
        return RunRequest(serial, app.station_path, product, stages, app.runs_folder, **more)

    def _history(self) -> History | None:
        """Return the history of earlier runs, or None if there is no runs folder."""
        folder = self._app.runs_folder
        return History(folder) if folder.is_dir() else None

    def _note_next(self) -> None:
        """While a verdict is shown, state that the field is for the next unit."""
        judged = self._app.run.ended or self._app.run.fault is not None
        self._header.note_serial(self.tr("next unit") if judged else "")

    def _edited(self) -> None:
        self._note_next()
        if self.run_summary is not None and not self._app.run.going:
            self._notice.dismiss()

    def _ask_attempt(self, failures: int, request: RunRequest) -> None:
        """Ask for one more attempt after too many failures, which only an engineer can allow."""
        if self._app.role.engineer:
            question = Text.of("question.allow_attempt", serial=request.serial, count=failures)
            self._ask(question, {"beyond": lambda: self.run(replace(request, beyond_attempts=True))}, "bad")
        else:
            question = Text.of("question.set_aside", serial=request.serial, count=failures)
            self._ask(question, {"unlock": self._app.role.ask}, "bad")

    def _ask(self, question: Text, answers: Mapping[str, Callable[[], None]], kind: str = "caution") -> None:
        """Ask a question that can also be cancelled."""
        ask(self._notice, kind, question, {**answers, "cancel": self._header.focus_scan}, primary="cancel")


def suggested_serial(run_summary: RunSummary, unsuitable: Callable[[str], bool]) -> str:
    """Return the virtual bench's own serial number or one for which `unsuitable` is False; "" for hardware."""
    if run_summary.bench is None:
        return ""
    own = run_summary.bench.get("serial")
    if own is not None:
        return str(own)
    for number in range(1, 1000):
        serial = f"SN-{number:06d}"
        if not re.fullmatch(run_summary.serial_pattern, serial):
            return ""
        if not unsuitable(serial):
            return serial
    return ""


def _resume_question(run: Resumable) -> Text:
    """Return the question whether to resume a run after its finished stages."""
    finished = len(run.finished)
    stage = run.stages[finished] if finished < len(run.stages) else run.stages[-1]
    return Text.of("question.resume", serial=run.serial, number=finished + 1, stage=stage, when=run.started_utc)


def _product_file(name: str | None) -> Path | None:
    for stem in library.names("products"):
        path = library.find("products", stem)
        try:
            if load_product(path)[1].name == name:
                return path
        except CalstationError:
            continue
    return None
