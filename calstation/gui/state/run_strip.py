"""Widgets that show the status of the run and of the exchange with the shared database."""

from collections import Counter
from collections.abc import Callable, Sequence
from datetime import datetime

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QPushButton, QWidget

from calstation.database import ExchangeState
from calstation.gui.state.chamber_notice import chamber_reason
from calstation.gui.state.context import AppContext
from calstation.gui.state.run_status import RunStatus
from calstation.gui.text import KINDS, bind, duration_text, on_language_change, rendered, say, term
from calstation.gui.widgets import (
    STEPS,
    ElidedLabel,
    PlainLabel,
    StateBadge,
    column,
    enable,
    plain_tip,
    progress_bar,
    show_text,
    theme,
)
from calstation.messages import local_time

#: Outcomes of units in the order in which they are counted.
_COUNTED = ("passed", "partial", "failed", "fault", "stopped", "incomplete")
#: Outcomes of units, the worst first.
_WORST = ("failed", "fault", "stopped", "incomplete", "partial", "passed")


class RunStrip(QWidget):
    """A strip with the units and the state of the current run above the current stage.

    While there is no run, the strip shows what an operator must do before the next run, or the text of `show_idle`.
    """

    def __init__(self, run: RunStatus) -> None:
        super().__init__()
        self._run, self._idle = run, ""
        self._ready: bool | None = None
        self._badge = StateBadge(theme.SECTION, elided=True)
        self._text, self._bar = ElidedLabel(), progress_bar(theme.GRID)
        parts = (self._badge, self._text, self._bar)
        column(None, *parts, None, on=self, spacing=0, margins=(0, 0, theme.GRID, 0))
        run.changed.connect(self._refresh)
        on_language_change(self, self._refresh)

    def show_idle(self, text: str, *, ready: bool) -> None:
        """While there is no run, show a text about the next run, or why it cannot start if it is not `ready`."""
        if (text, ready) != (self._idle, self._ready):
            self._idle, self._ready = text, ready
            self._refresh()

    def _refresh(self) -> None:
        run = self._run
        idle, ready = (run.missing, not run.missing) if self._ready is None else (self._idle, self._ready)
        waits = not ready and run.display_state == "idle" and run.occupied is None
        closed = run.chamber.must_stay_closed
        title = term("badge", "not_ready") if waits and not (closed or run.stop_incomplete) else run_title(run)
        self._badge.show_state(run_badge(run)[0], title)
        parts = []
        if run.stage is not None:
            parts = [term("stage", run.stage.name), f"{100.0 * run.stage.fraction:.0f} %"]
        if closed:
            parts = [chamber_reason(run)]
        elif run.other_program is not None and not run.in_progress:
            parts = [rendered(run.other_program).text]
        elif run.remaining is not None:
            parts.append(say("common.time_left", time=duration_text(run.remaining)))
        if idle and not parts and not run.in_progress:
            parts = [idle]
        if not parts and run.display_state == "not_ready" and run.problem is not None:
            parts = [rendered(run.problem, engineer=False).remedy]
        self._text.setWordWrap(not run.in_progress)  # also below the text while the bar is hidden
        show_text(self._text, "  ·  ".join(parts))
        self._bar.setVisible(run.in_progress)
        self._bar.setValue(round(STEPS * run.fraction))


def run_title(run: RunStatus) -> str:
    """Return the units and the state of the run in one line."""
    state = run_badge(run)[1]
    if run.chamber.must_stay_closed or run.occupied is not None or not run.serials or (run.in_slots and run.ended):
        return state
    if run.ended and run.unit.result is not None and run.unit.result.simulated:
        state = say("history.outcome_simulated", outcome=state)
    return f"{_units_text(run.serials)}  ·  {state}"


def _units_text(serials: Sequence[str]) -> str:
    return serials[0] if len(serials) == 1 else say("operator.unit_count", count=len(serials))


def needs_no_run(run: RunStatus) -> bool:
    """Return whether the units of the station are on one body, so that they are only watched live."""
    return run.problem is not None and run.problem.code == "question.pair_station"


def run_badge(run: RunStatus) -> tuple[str, str]:
    """Return the shape and the text of the badge of a run.

    A table that may still be moving and a chamber that must stay closed take precedence. Other windows of the station
    show the run of the first window. Another program that uses the station takes precedence over the last run. The text
    states whether a run is partial. After a run of several units, the text counts the outcomes, and the
    shape is that of the worst outcome.
    """
    kind, text = _state_badge(run)
    if run.stop_incomplete:
        return "bad", term("badge", "table_unsafe")
    if not run.chamber.must_stay_closed:
        return kind, text
    closed = term("badge", "chamber_closed")
    return "caution", f"{closed}  ·  {text}" if run.in_progress or run.fault is not None else closed


def _state_badge(run: RunStatus) -> tuple[str, str]:
    """Return the shape and the text of the badge of a run, regardless of the table and the chamber."""
    if run.elsewhere is not None and not run.in_progress:
        serials, elsewhere = run.elsewhere
        text = "  ·  ".join([_units_text(serials), term("badge", elsewhere)] if serials else [term("badge", elsewhere)])
        return KINDS.get(elsewhere, "none"), say("window.in_other_window", state=text)
    if run.program is not None and not run.in_progress and run.fault is None:
        return KINDS["in_use"], term("badge", "in_use")
    if run.in_slots and run.ended:
        counts = Counter(run.display_state_of(unit) for unit in run.units)
        texts = [term("unit_count", outcome, count=counts[outcome]) for outcome in _COUNTED if counts[outcome]]
        worst = next((outcome for outcome in _WORST if counts[outcome]), run.display_state)
        text = term("unit_count", "comma").join(texts)
        return KINDS.get(worst, "none"), text if counts["partial"] else _marked(run, text)
    if run.display_state == "not_ready" and needs_no_run(run):
        return "none", term("badge", "to_watch")
    state = term("badge", run.display_state)
    if run.display_state == "monitoring" and run.monitoring is not None:
        return run.monitoring[0], state
    marked = state if run.state in ("idle", "partial") else _marked(run, state)
    return KINDS.get(run.display_state, "none"), marked


def _marked(run: RunStatus, state: str) -> str:
    """Return the text of a state with the mark of a partial run."""
    return f"{term('badge', 'partial')}  ·  {state}" if run.partial else state


class EndStageButton(QPushButton):
    """A button that ends the current stage after its move, visible during a run if `allowed` returns True."""

    def __init__(self, run: RunStatus, name: str, parent: QWidget, allowed: Callable[[], bool] = lambda: True) -> None:
        super().__init__(parent)  # without a parent, a button created during a run would be shown as a window
        self._run, self._allowed = run, allowed
        self.setObjectName(name)
        self.setVisible(False)
        bind(self, "window.end_stage")
        self.clicked.connect(run.end_stage)
        run.changed.connect(self._refresh)
        on_language_change(self, self._refresh)

    def _refresh(self) -> None:
        run, why_not = self._run, _why_not_end_stage(self._run)
        self.setVisible(run.in_progress and not run.register_operation and not run.by_hand and self._allowed())
        enable(self, term("end_stage", why_not) if why_not else "", say("window.end_stage_tip"))


class PauseButton(QPushButton):
    """A button that pauses a run after its current step, and resumes it."""

    def __init__(self, run: RunStatus, name: str) -> None:
        super().__init__()
        self._run = run
        self.setObjectName(name)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # the keys of a scan must not press it
        self.clicked.connect(run.pause_or_resume)
        run.changed.connect(self._refresh)
        on_language_change(self, self._refresh)

    def _refresh(self) -> None:
        run = self._run
        state = "requested" if run.pause_requested else run.display_state if run.in_progress else "idle"
        enable(self, "" if state in ("running", "paused") else term("no_pause", state))
        self.setText(say("common.resume" if run.state == "paused" else "operator.pause"))


class ExchangeLabel(PlainLabel):
    """A line with the numbers of runs and logs that cannot be sent because of an error, which its tooltip shows."""

    def __init__(self, app: AppContext) -> None:
        super().__init__()
        self.setObjectName("exchange_label")
        self._app = app
        theme.set_kind(self, "caution")
        app.exchange_changed.connect(self._refresh)
        on_language_change(self, self._refresh)

    def _refresh(self) -> None:
        state = self._app.exchange_state
        show_text(self, "" if state is None else "  ·  ".join(filter(None, (self._runs(state), self._logs(state)))))
        errors = () if state is None else (state.error, state.archive_error)
        self.setToolTip(plain_tip("\n".join(say(error) for error in errors if error is not None)))

    def _runs(self, state: ExchangeState) -> str:
        count, since = state.pending, state.contact_utc
        if state.error is None or not count:
            return ""
        if since is None:
            return say("window.waiting_runs", count=count)
        today = since.astimezone().date() == datetime.now().astimezone().date()
        since_text = f"{since.astimezone():%H:%M}" if today else local_time(since.isoformat())
        return say("window.waiting_runs_since", count=count, since=since_text)

    def _logs(self, state: ExchangeState) -> str:
        count = state.logs_pending
        if state.archive_error is None or not count:
            return ""
        return say("window.logs_wait", count=count)


def _why_not_end_stage(run: RunStatus) -> str:
    """Return why the current stage cannot be ended early, a term of the family ``end_stage``; "" if it can."""
    stage = run.stage
    if stage is None or run.state != "running":
        return "no_stage"
    if stage.state != "active" or not stage.repeated:
        return "not_repeated"
    return "ending" if stage.name == run.stage_ending else ""
