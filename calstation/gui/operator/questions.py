"""Questions in notice bars, the message about a run, the dialog before its start, and why products are unsuitable."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from calstation.config import ManualRigError, Person, RunRequest, load_station, product_error
from calstation.database import Claim
from calstation.errors import CalstationError
from calstation.gui.state import AppContext, PeoplePanel, RunStatus, chamber_reason, needs_no_run, prevented_by
from calstation.gui.text import (
    Words,
    engineer_corrects,
    fault_text,
    for_operator,
    language,
    rendered,
    say,
    step_sentence,
    term,
)
from calstation.gui.widgets import Choice, NoticeBar
from calstation.messages import Text, event_text, joined
from calstation.runs import Question, Role, RunStart
from calstation.validation import find_validation_due

#: Badge shapes (`widgets.badge.KINDS`) of the questions before a start, by subject; the default is ``caution``.
_KINDS = {"resume": "paused", "attempts": "bad"}


def ask(
    bar: NoticeBar,
    kind: str,
    question: Text | Callable[[], Text],
    answers: Mapping[str, Callable[[], None]],
    *,
    primary: str = "",
    others: Sequence[Choice] = (),
    engineer: bool = False,
) -> None:
    """Ask a question in a notice bar or, if there are no answers, show a notice.

    Parameters
    ----------
    bar, kind
        The notice bar and its badge shape (`widgets.badge.KINDS`).
    question
        Title and explanation, or a function that returns them whenever the bar is refreshed.
    answers
        Actions by terms of the catalogue family ``answer``.
    primary
        Answer that confirms nothing and receives the focus; "" for none.
    others
        Additional choices with their own texts, which are shown first.
    engineer
        Whether an engineer reads the question; for operators, it does not name entries of profiles or files.
    """
    current = question if callable(question) else lambda: question
    choices = [
        Choice(f"{name}_choice", Text(f"answer.{name}", current().values), act, name == primary, safe=name == primary)
        for name, act in answers.items()
    ]
    title, text = (lambda: rendered(current()).text), lambda: rendered(current(), engineer=engineer).remedy
    bar.ask(kind, title, text, [*others, *choices])


def close_question(run: RunStatus) -> Text:
    """Return what closing the window would interrupt, and what is lost: a term of the family ``question``."""
    state = {"starting": "preparing", "pausing": "pause", "paused": "pause", "stopping": "end"}.get(run.state)
    state = state or (run.state if run.state == "preparing" else "run" if run.in_progress else "end")
    if state == "run" and (run.unloading or run.registers == "written"):
        state = "unloading"
    elif state in ("preparing", "run") and (run.registers or run.register_operation):
        state = run.registers or "operation"
    elif state == "end" and run.chamber.must_stay_closed:
        state = "return"
    later = "resumed" if run.resumable else "again" if state == "preparing" else "lost"
    later = "unverified" if run.registers else later
    latest = None if run.chamber.access == "open" else run.chamber.latest
    chamber = "" if latest is None else Text.of("window.close_chamber", air=latest.air_c)
    return Text.of(f"question.close_during_{state}", later=Text(f"window.close_{later}"), chamber=chamber)


def closing_notice(run: RunStatus) -> Text:
    """Return what the window waits for before it closes: a term of the family ``question``."""
    returns = run.chamber.latest is not None and run.chamber.access != "open"
    if returns:
        return Text("question.closing_chamber")
    return Text("question.closing_stopped" if run.table_stopped else "question.closing")


def progress_message(run: RunStatus) -> str:
    """Return what a run in progress is doing."""
    if run.state == "stopping" and not (run.commanded or run.by_hand):
        return say("operator.message_stopping_connecting")
    if run.state == "stopping" and run.table_stopped:
        return say("operator.message_table_stopped")
    if run.state in ("stopping", "paused"):
        return say(f"operator.message_{run.state}{'_manual' if run.by_hand else ''}")
    if run.pause_requested:
        return term("no_pause", "requested")
    if run.latest is None:
        return ""
    kind, key, values = run.latest
    if key == "carry" and run.stage is not None:  # the position panel gives the instruction
        return term("stage", run.stage.name)
    if kind == "solving":
        return say("common.named", name=term("stage", key), text=term("stage_state", kind))
    if key == "will_fail":  # the reason is for engineers
        return rendered(Text("question.will_fail")).text
    return say(event_text(key, values)) if kind == "message" else step_sentence(key, values)


def urgent_message(run: RunStatus, *, engineer: bool) -> str:
    """Return the most urgent message, on a fault, the table, the chamber or another window; "" for none."""
    table = say("operator.message_table_stopped") if run.table_stopped else ""
    if run.fault is not None and prevented_by(run) is None:
        return joined(fault_text(run.fault, engineer=engineer).text, table, language.current())
    if run.stop_incomplete:
        return say("advice.stop_incomplete")
    if run.chamber.must_stay_closed:
        closed = say("operator.chamber_message", reason=chamber_reason(run))
        return joined(table, closed, language.current()) if table and run.state == "stopping" else closed
    if run.occupied is None or (run.in_progress and run.commanded):
        return ""
    other = rendered(run.occupied).text
    stopping = run.elsewhere is not None and run.elsewhere[1] == "stopping"
    return joined(say("operator.message_stopping_manual"), other, language.current()) if stopping else other


def sign_in_text(app: AppContext) -> str:
    """Return that the operator must sign in, and whether the last one was signed out by the idle timeout."""
    return say("operator.sign_in_again" if app.signed_out_idle else "operator.sign_in")


def why_not_load(run: RunStatus, problem: Text | None) -> tuple[Words, Words]:
    """Return title and text of the reason why no unit may be loaded now; both are empty if there is none.

    `problem` is why the next run is not possible, or None.
    """
    if (other := run.occupied) is not None:
        return lambda: rendered(other).text, lambda: rendered(other).remedy
    if problem is not None:
        to_watch = "operator.message_pair" if run.monitoring is None else ""
        return lambda: rendered(problem).text, to_watch if needs_no_run(run) else "operator.about_impossible"
    if run.stop_incomplete:
        return "operator.table_unsafe", "operator.table_unconfirmed"
    if run.chamber.must_stay_closed and run.chamber.unchecked:
        return "operator.chamber_closed", "operator.chamber_unchecked"
    if run.chamber.must_stay_closed:
        return "operator.chamber_unknown", "operator.chamber_unconfirmed"
    return "", ""


def refusal(code: str, error: CalstationError, *, engineer: bool) -> Text:
    """Return why a run cannot start: a term of the family ``question``, for operators without files and keys."""
    message = error.as_text
    plain = None if engineer else for_operator(message)
    if plain is None:
        return Text.of(f"question.{code}", why=message)
    return Text.of(f"question.{code}_settings", why=plain, ask=engineer_corrects(message))


class FailingNotice(NoticeBar):
    """Says once that a run will fail, as soon as this is certain, and offers to end it.

    `answered` is called when the run is to continue.
    """

    def __init__(self, run: RunStatus, answered: Callable[[], None]) -> None:
        super().__init__("failing_notice")
        self._run, self._answered = run, answered
        self._asked = False
        run.changed.connect(self._run_changed)

    def _run_changed(self) -> None:
        if not self._run.failing:
            self._asked = False
            if self.asking:
                self.dismiss()
        elif not self._asked:
            self._asked = True
            answers = {"end_failing": self._run.end_failing, "stay": self._answered}
            ask(self, "bad", Text("question.will_fail"), answers)


class StartDialog:
    """Dialog that asks the questions of a `RunStart` in a notice bar, then starts the engine.

    `panel` is the object name of the panel `people`, in which engineers permit a run; `cancelled` is called when a
    question is cancelled.
    """

    def __init__(self, app: AppContext, notice: NoticeBar, panel: str, cancelled: Callable[[], None]) -> None:
        self._app, self._notice, self._cancelled = app, notice, cancelled
        self.people = PeoplePanel(panel)
        self.people.cancelled.connect(notice.dismiss)
        app.run.changed.connect(self._run_changed)

    def begin(self, request: RunRequest) -> None:
        """Ask the questions about a requested run, then start it or show why it cannot start."""
        role: Role = "engineer" if self._app.role.engineer else "operator"
        by = self._app.author if role == "engineer" else None
        request = replace(request, operator=self._app.badge or self._app.person, allowed_by=by)
        self._attempt(lambda: self._continue(RunStart(request, role)), resume=request.resume is not None)

    def drop(self) -> None:
        """Remove a question, a notice or an open panel without starting a run."""
        self.people.hide()
        self._notice.dismiss()

    @property
    def asking(self) -> bool:
        """Whether a question before a start, which can always be cancelled, is open."""
        return self._notice.offers("cancel_choice") and not self._notice.offers("same_units_choice")

    def _run_changed(self) -> None:
        """Remove an open question when another window or program begins to use the station."""
        if self._app.run.occupied is not None and (self.asking or not self.people.isHidden()):
            self.drop()

    def _attempt(self, action: Callable[[], None], *, resume: bool = False) -> None:
        """Execute a step towards the start, or show why no run can start now or why the step failed."""
        if why_not := self._app.run.why_not_start:
            ask(self._notice, "caution", why_not if isinstance(why_not, Text) else Text(why_not), {})
            return
        if self._app.badge_required:
            ask(self._notice, "caution", Text("station.badge_missing"), {})
            self._cancelled()
            return
        try:
            action()
        except CalstationError as error:
            engineer = self._app.role.engineer
            refused = refusal("cannot_resume" if resume else "cannot_run", error, engineer=engineer)
            ask(self._notice, "caution", refused, {}, engineer=engineer)

    def _continue(self, start: RunStart) -> None:
        question = start.next_question()
        if question is None:
            self._launch(start.request)
            return
        answers: dict[str, Callable[[], None]] = {
            name: partial(self._attempt, partial(self._answer, start, question, name), resume=name == "resume")
            for name in question.answers
        }
        self._ask(question.text, answers or {"unlock": self._app.role.ask}, _KINDS.get(question.subject, "caution"))

    def _answer(self, start: RunStart, question: Question, answer: str) -> None:
        if question.subject == "standard":
            self._ask_engineer(start)
        else:
            start.answer(question, answer)
            self._continue(start)

    def _ask_engineer(self, start: RunStart) -> None:
        """Ask for the reason for an override, and for the badges and PINs of the engineers who permit it."""

        def confirmed(reason: str, first: Person, second: Person | None) -> None:
            try:
                start.override(reason, first, second)
            except CalstationError as error:
                self.people.retry(error)
                return
            self.people.hide()
            self._notice.dismiss()
            self._attempt(lambda: self._continue(start))

        required, app, request = start.override_required, self._app, start.request
        by = (app.badge if required.badge else app.person) or ""
        units = ", ".join(filter(None, request.serials or (request.serial,)))
        self.people.ask(Text.of("operator.ask_calibrate", serial=units), required, confirmed, by=by)

    def _launch(self, request: RunRequest) -> None:
        """Start the engine; if a job uses a device, ask first."""
        app = self._app
        if app.job_queue.uses_device:
            self._ask(Text.of("question.device_busy"), {"clear": lambda: self._attempt(lambda: self._launch(request))})
        elif not app.engine_link.running:
            if request.product is not None:
                app.set_product(request.product)  # shown in the header; a resumed run may have another product
            app.engine_link.start(replace(request, operator=app.badge or app.person))

    def _ask(self, question: Text, answers: Mapping[str, Callable[[], None]], kind: str = "caution") -> None:
        """Ask a question with an additional answer that cancels it."""
        ask(self._notice, kind, question, {**answers, "cancel": self._cancelled}, primary="cancel")


class ValidationNotice(NoticeBar):
    """Warning that the validation of the installation must be repeated, which does not prevent a run."""

    def __init__(self, app: AppContext) -> None:
        super().__init__("validation_notice")
        self._search = app.job(self, find_validation_due, self._show)

    def check(self) -> None:
        """Compare the installation with the last validation."""
        self._search.start()

    def _show(self, due: Text | None) -> None:
        if due is not None:
            self.ask("caution", due, "")


class ClaimNotice(NoticeBar):
    """Warning that another station is calibrating a unit of this station, which does not prevent a run."""

    def __init__(self, app: AppContext) -> None:
        super().__init__("claim_notice")
        self._app = app
        self._claims: Sequence[Claim] = ()
        app.exchange_changed.connect(self._refresh)
        app.claim_changed.connect(self._refresh)
        app.engine_link.running_changed.connect(self._running_changed)

    def _running_changed(self, running: bool) -> None:
        request = self._app.engine_link.request
        if request is None or self._app.run.register_operation:
            return
        if running:
            self._app.claim(*filter(None, request.serials or (request.serial,)))
        elif request.serial in self._app.claimed:  # the next unit has not been claimed yet
            self._app.claim()

    def _refresh(self) -> None:
        state, claimed = self._app.exchange_state, self._app.claimed
        claims = [] if state is None else [claim for claim in state.claims if claim.serial in claimed]
        if claims == list(self._claims):
            return
        self._claims = claims
        if claims:
            self.ask("caution", self._claim_text, "operator.agree_station")
        else:
            self.dismiss()

    def _claim_text(self) -> str:
        messages = [claim.message for claim in self._claims]
        return "\n".join(say(event_text(message.id, message.values)) for message in messages)


#: Code of the text for a station that is incompatible with the product, by the code of the error, and the default.
_BY_HAND = "window.manual_station"
_WRONG_RIGS = {
    "product.needs_manual_table": "window.driven_station",
    "plan.needs_gimbal": "window.not_gimbal_station",
    "product.needs_table": "window.gimbal_station",
    "product.pair_station": "window.pair_station",
}


def wrong_rig(error: ManualRigError) -> str:
    """Return the code of the text for a station that is incompatible with a product."""
    return _WRONG_RIGS.get(error.code, _BY_HAND)


def has_pair(station: Path | None) -> bool:
    """Return whether the IMUs of a station are on one body, so that they can be monitored live."""
    try:
        return bool(load_station(station)[1].secondaries)
    except CalstationError:
        return False


def unsuitable_products(app: AppContext, products: Sequence[Path]) -> dict[Path, tuple[str, str]]:
    """Return a short and a long reason for the products that the station cannot calibrate."""
    reasons: dict[Path, tuple[str, str]] = {}
    for path in products:
        error = product_error(app.station_path, path)
        if isinstance(error, ManualRigError):
            code = wrong_rig(error)
            reasons[path] = (term("unsuitable", code.partition(".")[2]), say(code))
        elif error is not None:
            problem = refusal("cannot_run", error, engineer=app.role.engineer)
            short = "no_chamber" if error.code == "temperature.no_chamber" else "settings"
            reasons[path] = (term("unsuitable", short), rendered(problem).remedy)
    return reasons
