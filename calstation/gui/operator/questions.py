"""Questions in a notice bar, and those before the start of a run, which the pages ask in the same way."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

from calstation.config import Person, RunRequest, computer_user
from calstation.errors import CalstationError
from calstation.gui.state import AppContext, PeoplePanel
from calstation.gui.text import rendered
from calstation.gui.widgets import Choice, NoticeBar
from calstation.messages import Text
from calstation.runs import Question, Role, RunStart

#: Shapes of the questions before a start (`widgets.badge.KINDS`) by subject; the others ask for caution.
_KINDS = {"resume": "paused", "attempts": "bad"}


def ask(
    bar: NoticeBar,
    kind: str,
    question: Text,
    answers: Mapping[str, Callable[[], None]],
    *,
    primary: str = "",
    others: Sequence[Choice] = (),
) -> None:
    """Ask a question in a notice bar, or show a notice if there are no answers; `kind` is a state of `badge.KINDS`.

    `answers` maps names of the catalogue family ``answer`` to their actions, and `primary` names the one that receives
    the focus. `others` are additional choices with their own texts, which are shown first.
    """
    choices = [
        Choice(f"{name}_choice", Text(f"answer.{name}", question.values), act, name == primary)
        for name, act in answers.items()
    ]
    bar.ask(kind, lambda: rendered(question).text, lambda: rendered(question).remedy, [*others, *choices])


class StartDialog:
    """Asks the questions of a `RunStart` in a notice bar, then starts the engine.

    `panel` is the name of the panel `people`, which asks for the engineers who permit a run; `cancelled` is called
    when a question is cancelled.
    """

    def __init__(self, app: AppContext, notice: NoticeBar, panel: str, cancelled: Callable[[], None]) -> None:
        self._app, self._notice, self._cancelled = app, notice, cancelled
        self.people = PeoplePanel(panel)

    def begin(self, request: RunRequest) -> None:
        """Ask what must be asked about a requested run, and start it; show why it is refused."""
        role: Role = "engineer" if self._app.role.engineer else "operator"
        request = replace(request, operator=self._app.badge or request.operator)
        self._attempt(lambda: self._continue(RunStart(request, role)), resume=request.resume is not None)

    def drop(self) -> None:
        """Remove an open question, or the panel that asks for engineers; nothing is started."""
        self.people.hide()
        if self._notice.asking:
            self._notice.dismiss()

    def _attempt(self, action: Callable[[], None], *, resume: bool = False) -> None:
        try:
            action()
        except CalstationError as error:
            code = "question.cannot_resume" if resume else "question.cannot_run"
            ask(self._notice, "caution", Text.of(code, why=error.as_text), {})

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
        """Ask for the reason of an override, and for the badges and PINs of those who permit it."""

        def confirmed(reason: str, first: Person, second: Person | None) -> None:
            try:
                start.override(reason, first, second)
            except CalstationError as error:
                ask(self._notice, "bad", error.as_text, {})
                self.people.retry()
                return
            self.people.hide()
            self._notice.dismiss()
            self._attempt(lambda: self._continue(start))

        required, app, request = start.override_required, self._app, start.request
        by = (app.badge if required.badge else app.operator or request.operator or computer_user()) or ""
        units = ", ".join(filter(None, request.serials or (request.serial,)))
        self.people.ask(Text.of("operator.ask_calibrate", serial=units), required, confirmed, by=by)

    def _launch(self, request: RunRequest) -> None:
        """Start the engine for the current operator, unless a badge is missing or a job uses a device."""
        app = self._app
        if app.badge_required:
            ask(self._notice, "caution", Text("station.badge_missing"), {})
            self._cancelled()
        elif app.job_queue.at_device:
            self._ask(Text.of("question.device_busy"), {"clear": lambda: self._launch(request)})
        elif not app.engine_link.running:
            app.engine_link.start(replace(request, operator=app.badge or request.operator))

    def _ask(self, question: Text, answers: Mapping[str, Callable[[], None]], kind: str = "caution") -> None:
        """Ask a question that can also be cancelled."""
        primary = "resume" if "resume" in answers else "cancel"
        ask(self._notice, kind, question, {**answers, "cancel": self._cancelled}, primary=primary)
