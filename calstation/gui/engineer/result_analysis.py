"""Views of a finished run, and the background jobs that compute their contents."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Generic, TypeVar

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QStackedWidget, QWidget

from calstation.errors import CalstationError
from calstation.gui.engineer.cycle_view import CycleView
from calstation.gui.engineer.diagnostics_views import InnovationsView, ResidualsView
from calstation.gui.engineer.observability_view import ObservabilityView
from calstation.gui.operator import advice
from calstation.gui.state import AppContext, ReleaseBar
from calstation.gui.text import (
    KINDS,
    Words,
    is_parameter_check,
    on_language_change,
    product_text,
    say,
    sigmas_text,
    term,
)
from calstation.gui.widgets import (
    NOTABLE_SIGMAS,
    Cell,
    CellTable,
    ChecksTable,
    EmptyState,
    JobRow,
    JobWatch,
    MissingEffect,
    StateBadge,
    TemperatureCurves,
    button,
    column,
    label,
    ordered,
    row,
    set_subject,
    show_text,
    theme,
)
from calstation.judgement import Check
from calstation.messages import local_time
from calstation.physics import NAMES, EffectName, display, further_parameter, limit_number, number
from calstation.records import CheckKind
from calstation.results import (
    Diagnostics,
    FinishedRun,
    Preview,
    Registers,
    Result,
    diagnose,
    in_sigma,
    load_finished_run,
    resolve_with_state,
)
from calstation.sequencer import Event, StageRanked, StateChanged, StepStarted

_NONE = "–"
#: Maximum height of the table of checks that do not refer to a single parameter, px.
_MAX_CHECKS_HEIGHT = 26 * theme.GRID
#: Kinds of checks of the output that the parameters correct, without added states.
_COMPENSATED: frozenset[CheckKind] = frozenset(
    {
        *("gravity_at_rest", "improvement_at_rest", "improvement_at_rest_floor", "level_horizontal", "level_vertical"),
        *("motion_angle", "motion_improvement", "motion_improvement_floor"),
    }
)
_COLUMNS = (
    Cell("common.unit", "unit", number=False),
    Cell("common.numeric_value", "value"),
    Cell("common.at_temperature", "at"),
    Cell("common.plus_minus_sigma", "sigma"),
    Cell("engineer.previous", "previous"),
    Cell("engineer.change", "change"),
    Cell("common.in_sigma", "in_sigma", state="change_state"),
    Cell("engineer.value_limit", "limit"),
    Cell("engineer.accepted", "accepted"),
    Cell("engineer.sigma_limit", "sigma_limit"),
    Cell("engineer.stage", "stage", number=False),
    Cell("common.verdict", "verdict", number=False, state="verdict_state", hint="hint"),
)
_NUMBERS = ("value", "at", "sigma", "previous", "change", "in_sigma", "limit", "accepted", "sigma_limit")
#: Columns for the comparison with the previous run or with the result without an added state.
_COMPARED_COLUMNS = (4, 5, 6)
#: Column of the acceptance limits, which the decision rule may narrow.
_ACCEPTED_COLUMN = 8
#: Column of the temperature of the worst value, and headings of value and sigma of a result over temperature.
_AT_COLUMN = 2
_WORST = {
    **{"value": "common.worst_value", "sigma": "common.worst_sigma"},
    **{"previous": "engineer.previous_at_reference", "change": "engineer.change_at_reference"},
}
#: Badge shape (`widgets.badge.KINDS`) of each parameter verdict.
_SHAPES = {"good": "good", "near": "caution", "lost": "caution", "value": "bad", "sigma": "bad", "both": "bad"}


def verdict_text(result: Result, *, stages: bool = True) -> str:
    """Return the verdict on a run, such as ``PASS``, with the stages of a partial run if `stages` is True."""
    if result.released or not result.partial or not result.stages:
        return term("badge", result.badge)
    passed = result.verdict == "partial"
    if not stages:
        return term("badge", "partial") if passed else say("engineer.partial", outcome=result.outcome)
    code = "engineer.passed_stages" if passed else "engineer.partial_stages"
    return say(code, outcome=result.outcome, stages=result.stages)


def verdict_badge(result: Result) -> tuple[str, str]:
    """Return the badge shape (`widgets.badge.KINDS`) and the text of the verdict on a run or a re-solved log."""
    if result.outcome != "resolved":
        return KINDS.get(result.verdict, "none"), verdict_text(result)
    kind = {None: "none", True: "partial" if result.partial else "good", False: "bad"}[result.passed]
    return kind, say(f"engineer.resolved_{kind if result.tested else 'untested'}")


class ResultView(QWidget):
    """A view of the verdict on a run, its parameters, and the checks that do not refer to a single parameter."""

    def __init__(self, adding: JobWatch, release: ReleaseBar) -> None:
        super().__init__()
        self.release = release
        self.finished: FinishedRun | None = None
        self.missing = MissingEffect(adding, "add_state_button")
        self._badge = StateBadge(theme.SECTION)
        self._summary, self._note = label(wrap=True), label(wrap=True, name="override_note")
        self._table = CellTable("result_table", "engineer.run_parameters", _COLUMNS, grouped=True)
        self._checks = ChecksTable()
        self._checks.setObjectName("acceptance_checks")
        copy = button("copy_button", "common.copy_table", self._table.copy, tip="engineer.copy_table_tip")
        column(
            row(self._badge, (self._summary, 1), copy, spacing=2 * theme.GRID),
            self._note,
            release,
            (self._table, 2),
            self.missing,
            (self._checks, 1),
            on=self,
            margins=(0, theme.GRID, 0, 0),
        )
        on_language_change(self, self._refresh)

    def show_run(self, finished: FinishedRun) -> None:
        """Show a finished run."""
        self.finished = finished
        set_subject(self, finished.result.serial)
        general = [check for check in finished.result.checks if not is_parameter_check(check)]
        self._checks.show_checks(general)
        self._checks.setMaximumHeight(min(self._checks.height_of_rows(), _MAX_CHECKS_HEIGHT))
        self._checks.setVisible(bool(general))
        self.missing.show_result(finished.result if finished.log is not None else None)
        self._refresh()

    def _refresh(self) -> None:
        finished = self.finished
        if finished is None:
            return
        result = finished.result
        cells = {name: _cells(finished, name) for name in ordered(result.parameters)}
        compared = "engineer.without_state" if result.states_added else "engineer.previous"
        headings = {"previous": compared} if result.temperature is None else _WORST
        columns = [replace(cell, heading=headings.get(cell.key, cell.heading)) for cell in _COLUMNS]
        self._table.show_cells(cells, _NUMBERS, columns)
        for index in _COMPARED_COLUMNS:
            self._table.setColumnHidden(index, not finished.previous)
        self._table.setColumnHidden(_AT_COLUMN, result.temperature is None)
        self._table.setColumnHidden(_ACCEPTED_COLUMN, all("accepted" not in row for row in cells.values()))
        self._table.fit_columns()
        kind, verdict = verdict_badge(result)
        self._badge.show_state(kind, f"{result.serial}  ·  {verdict}")
        texts = []
        if result.product:
            texts.append(say("engineer.for_product", product=product_text(result.product)))
        if count := len(result.checks):
            passed = count - len(result.failed_checks)
            texts.append(say("engineer.checks_passed", passed=passed, count=count))
            if result.failed_checks:
                texts.append(say("engineer.checks_failed", names=advice.failed_names(result)))
        if near := sum(check.near_miss for check in result.checks):
            texts.append(say("engineer.near_misses", count=near))
        if result.conformity is not None:
            texts.append(say(f"engineer.rule_{result.conformity.rule}"))
        if result.registers is not None and result.verified:
            texts += _register_texts(result.registers)
        if result.states_added:
            names = [term("group", state) for state in result.states_added]
            texts.append(say("event.states_added", states=names))
        if finished.previous_utc:
            texts.append(say("engineer.compared_with", time=local_time(finished.previous_utc)))
        self._summary.setText("  ·  ".join(texts))
        notes = advice.override_notes(result)
        if result.states_added and any(check.kind in _COMPENSATED for check in result.failed_checks):
            notes.append(say("engineer.compensated_without_states"))
        show_text(self._note, "\n".join(notes))


def _cells(finished: FinishedRun, name: str) -> dict[str, str]:
    """Return the texts in the row of a parameter, in display units and rounded according to the sigma."""
    result, previous = finished.result, finished.previous.get(name)
    parameter, at = result.worst(name)
    at_reference = result.parameters[name]
    checks: dict[str, Check] = {
        check.kind: check for check in result.checks if is_parameter_check(check) and check.subject == name
    }
    verdict = "lost" if name in result.undetermined else _verdict(checks)
    value, unit = _display(name, parameter.value)
    sigma, _ = _display(name, parameter.sigma)
    size = 1.0 / _display(name, 1.0)[0]
    cells = {
        "unit": unit or parameter.unit,
        "value": number(value, sigma),
        "sigma": number(sigma, sigma),
        "stage": term("stage", parameter.stage),
        "verdict": say(f"engineer.verdict_{verdict}"),
        "verdict_state": _SHAPES.get(verdict, ""),
        "hint": _conformity_hint(result, name),
    }
    if at is not None:
        cells["at"] = f"{at:.0f}"
    if previous is not None:
        before, now = _display(name, previous.value)[0], _display(name, at_reference.value)[0]
        cells["previous"] = number(before, sigma)
        cells["change"] = "0" if before == now else number(now - before, sigma)
        # a trial with an added state solves the same data again
        sigmas = in_sigma(at_reference, previous, independent=not result.states_added)
        cells["in_sigma"] = "0" if before == now else sigmas_text(sigmas)
        if abs(sigmas) > NOTABLE_SIGMAS:
            cells["change_state"] = "caution"
    if "within" in checks:
        check = checks["within"]
        for key, interval in (("limit", check.limit), ("accepted", check.acceptance)):
            if isinstance(interval, tuple):
                low, high = (limit_number(bound, size, parameter.value) for bound in interval)
                magnitude = interval[0] == -interval[1]
                bound = limit_number(interval[1], size, abs(parameter.value))
                cells[key] = f"±{bound}" if magnitude else f"{low} … {high}"
        if check.acceptance is not None and check.acceptance[0] > check.acceptance[1]:
            cells["accepted"] = _NONE
    if "sigma_below" in checks and not isinstance(checks["sigma_below"].limit, tuple):
        cells["sigma_limit"] = limit_number(checks["sigma_below"].limit, size, parameter.sigma)
    return cells


def _conformity_hint(result: Result, name: str) -> str:
    """Return the probability that the decision on a parameter is wrong, and the risks for its product."""
    decision = None if result.conformity is None else result.conformity.parameters.get(name)
    if decision is None:
        return ""
    kind = "accepted" if decision.accepted else "refused"
    texts = [say(f"engineer.conformity_{kind}", percent=100.0 * decision.probability)]
    if decision.false_accept is not None and decision.false_reject is not None:
        risks = {"accept": 100.0 * decision.false_accept, "reject": 100.0 * decision.false_reject}
        texts.append(say("engineer.conformity_product", **risks))
    return "\n".join(texts)


def _register_texts(registers: Registers) -> list[str]:
    """Return whether and when the registers were written, and whether they were only read back."""
    code = "engineer.registers_written_at" if registers.written_utc else "engineer.registers_written"
    texts = [say(code, time=local_time(registers.written_utc or ""))]
    if registers.proved_on == "read_back":
        texts.append(say("engineer.registers_read_back"))
    return texts


def _verdict(checks: dict[str, Check]) -> str:
    """Return the verdict on a parameter from its checks by kind: a key of `_SHAPES`, or ``none``."""
    value = "within" in checks and not checks["within"].passed
    sigma = "sigma_below" in checks and not checks["sigma_below"].passed
    if value or sigma:
        return "both" if value and sigma else "value" if value else "sigma"
    if any(check.near_miss for check in checks.values()):
        return "near"
    return "good" if checks else "none"


def _display(name: str, value: float) -> tuple[float, str]:
    """Return a value in its display unit, and the unit; return the value and "" for an unknown parameter."""
    return display(name, value) if name in NAMES or further_parameter(name) else (value, "")


class ResultAnalysis(QObject):
    """Manages the views of a result and the background jobs that compute their contents.

    Signals: `changed()` when a run starts to load and after it has loaded; `loaded(run)`; `failed(error)` if the run
    cannot be opened.
    """

    changed = Signal()
    loaded = Signal(object)
    failed = Signal(object)

    def __init__(self, app: AppContext, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._app = app
        self._run: FinishedRun | None = None
        self._path: Path | None = None
        #: Whether the displayed observability belongs to the run in progress.
        self._following = False
        #: Whether the run or register operation in progress has not yet reported the observability of a stage.
        self._starting = False
        #: Labels of the moves of the run in progress, by step.
        self._step_labels: dict[int, tuple[str | float, ...]] = {}
        #: Log whose diagnostics are shown or being computed.
        self._diagnosed_log: Path | None = None
        self.loading = app.job(self, load_finished_run, self._loaded, failed=self._load_failed)
        self._diagnosing = app.job(self, diagnose, self._diagnosed, cancelled=self._diagnosis_failed)
        self.adding = app.job(self, resolve_with_state, self._loaded)
        self.result, self.observability = _LazyView(self._result_view), _LazyView(ObservabilityView)
        self.innovations = _LazyView(InnovationsView, self._diagnosing)
        self.residuals = _LazyView(ResidualsView, self._diagnosing)
        self.cycle = _LazyView(CycleView)
        self.over_temperature = _LazyView(lambda: TemperatureCurves("engineer_curves_combo"))
        #: The views whose contents are computed by `diagnose`.
        self._computed = self.innovations, self.residuals
        #: The views in order: parameters, innovations, residuals, observability.
        self.views: tuple[QWidget, ...] = (self.result, *self._computed, self.observability)
        app.released.connect(self._released)
        self._diagnosing.failed.connect(lambda error: self._diagnosis_failed(error.as_text))

    def create_views(self) -> None:
        """Create the views that a run fills."""
        for lazy in (self.result, self.observability, self.cycle):
            _ = lazy.view

    def open(self, path: Path) -> None:
        """Open a result or a log."""
        self.loading.cancel()
        self.adding.cancel()
        self._path = path
        self.loading.start(path, self._app.runs_folder)
        self.changed.emit()

    def show_preview(self, preview: Preview) -> None:
        """Show the observability predicted by a preview, unless a run is open."""
        if self._run is None:
            self.observability.view.show_stages({s.stage: s.observability for s in preview.stages}, preview.step_labels)
            self.observability.show_view()

    def follow(self, event: Event) -> None:
        """Show the observability of the run in progress, unless a run was opened since it started."""
        if isinstance(event, StateChanged) and event.state == "preparing":
            self._following = self._starting = True
            self._step_labels = {}
        elif isinstance(event, StepStarted) and event.label:
            self._step_labels[event.step] = event.label
        elif isinstance(event, StageRanked) and self._following:
            if self._starting:
                self._starting = False
                self.observability.view.show_stages({})
            self.observability.view.follow(event, self._step_labels)
            self.observability.show_view()

    def prepare(self, view: QWidget | None) -> None:
        """Compute innovations and residuals if `view` shows them and they have not been computed yet."""
        run = self._run
        if run is None or view not in self._computed or run.log == self._diagnosed_log is not None:
            return
        if run.log is None:
            self._diagnosis_failed("engineer.log_gone")
        elif not run.result.stages:
            self._diagnosis_failed(lambda: _why_no_result(run))
        else:
            self._diagnosed_log = run.log
            log, stages = run.result.log, tuple(run.result.stages)
            self._diagnosing.start(run.log, stages, log.first_seq, log.last_seq)
            for lazy in self._computed:
                lazy.show_work()

    @property
    def serial(self) -> str:
        """Serial number of the displayed run, or ""."""
        return "" if self._run is None else self._run.result.serial

    @property
    def product(self) -> str:
        """Name of the product of the displayed run, or ""."""
        return "" if self._run is None else self._run.result.product or ""

    def close(self) -> None:
        """Close the displayed run."""
        self.loading.cancel()
        self._diagnosing.cancel()
        self._run = self._path = self._diagnosed_log = None
        for lazy in (self.result, *self._computed, self.cycle):
            lazy.show_empty()
        self.changed.emit()

    def source(self) -> str:
        """Return a line with the serial number, time and verdict of the displayed run."""
        if self.loading.busy and self._path is not None:
            return say("engineer.opening", file=self._path.name)
        if self._run is None:
            return ""
        result = self._run.result
        added = " ".join(f"+ {term('group', state)}" for state in result.states_added)
        parts = (result.serial, added, local_time(result.started_utc or ""), verdict_text(result, stages=False))
        return "  ·  ".join(part for part in parts if part)

    def _result_view(self) -> ResultView:
        view = ResultView(self.adding, ReleaseBar(self._app, "engineer_release"))
        view.missing.requested.connect(self._add_state)
        return view

    def _add_state(self, state: EffectName) -> None:
        """Solve the log of the displayed run again with an additional state."""
        if self._run is not None:
            self.adding.start(self._run, state)

    def _loaded(self, run: FinishedRun) -> None:
        self._diagnosing.cancel()
        self._run, self._diagnosed_log, self._following = run, None, False
        if run.result.parameters:
            self.result.view.show_run(run)
            result_file = self._path if self._path is not None and self._path.suffix == ".json" else None
            self.result.view.release.offer(run.result, result_file)
            self.result.show_view()
        else:
            self.result.show_empty(lambda: _why_no_result(run))
        self.observability.view.show_stages(run.result.observability, run.step_labels)
        self.observability.show_view()
        if run.result.temperature is not None:
            self.over_temperature.view.show_result(run.result)
            self.over_temperature.show_view()
        for lazy in self._computed:
            lazy.show_empty()
        if run.result.cycle:
            self.cycle.view.show_result(run.result)
            self.cycle.show_view()
        else:
            self.cycle.show_empty("engineer.no_cycle")
        self.changed.emit()
        self.loaded.emit(run)

    def _released(self, path: Path) -> None:
        """Read the displayed result again after its unit was released."""
        if path == self._path:
            self.open(path)

    def _load_failed(self, error: CalstationError) -> None:
        self._path = None
        self.changed.emit()
        self.failed.emit(error)

    def _diagnosed(self, diagnostics: Diagnostics) -> None:
        self.innovations.view.show_data(diagnostics)
        self.residuals.view.show_data(diagnostics)
        for lazy in self._computed:
            lazy.show_view()

    def _diagnosis_failed(self, reason: Words = "") -> None:
        self._diagnosed_log = None
        for lazy in self._computed:
            lazy.show_empty(reason)


def _why_no_result(run: FinishedRun) -> str:
    """Return the outcome of a run without parameters, and its error."""
    result = run.result
    text = say("engineer.no_result", outcome=result.outcome)
    error = result.error if result.fault is None else say(result.fault.as_text)
    return f"{text}. {error}" if error else text


View = TypeVar("View", bound=QWidget)


class _LazyView(QStackedWidget, Generic[View]):
    """A stack that shows a placeholder, or the progress of a job, until the view has contents."""

    def __init__(self, create: Callable[[], View], watch: JobWatch | None = None) -> None:
        super().__init__()
        self._create = create
        self._view: View | None = None
        self._empty, self._work = EmptyState(title="engineer.no_run", text="engineer.about_no_run"), QWidget()
        if watch is not None:
            wide = 8 * theme.GRID
            working = EmptyState(title="engineer.solving", text="engineer.about_solving")
            column((working, 1), JobRow(watch), None, on=self._work, spacing=0, margins=(wide, 0, wide, 0))
        for widget in (self._empty, self._work):
            self.addWidget(widget)

    @property
    def view(self) -> View:
        """The view, which is created on first use."""
        if self._view is None:
            self._view = self._create()
            self.addWidget(self._view)
        return self._view

    def show_view(self) -> None:
        """Show the view."""
        self.setCurrentWidget(self.view)

    def show_work(self) -> None:
        """Show the progress of the job."""
        self.setCurrentWidget(self._work)

    def show_empty(self, reason: Words = "") -> None:
        """Show why the view has no contents or, if `reason` is "", how to obtain them."""
        title = "engineer.nothing_to_show" if reason else "engineer.no_run"
        self._empty.say(title, reason or "engineer.about_no_run")
        self.setCurrentWidget(self._empty)
