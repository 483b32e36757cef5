"""Views of a finished run, and the background jobs that compute their contents."""

from collections.abc import Callable
from pathlib import Path
from typing import Generic, TypeVar

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QStackedWidget, QWidget

from calstation.errors import CalstationError
from calstation.gui.engineer.cycle_view import CycleView
from calstation.gui.engineer.diagnostics_views import InnovationsView, ResidualsView
from calstation.gui.engineer.observability_view import ObservabilityView
from calstation.gui.engineer.result_view import ResultView, verdict_text
from calstation.gui.state import AppContext, ReleaseBar
from calstation.gui.text import (
    Words,
    say,
    term,
)
from calstation.gui.widgets import (
    EmptyState,
    JobRow,
    JobWatch,
    TemperatureCurves,
    column,
    theme,
)
from calstation.messages import local_time
from calstation.physics import EffectName
from calstation.results import (
    Diagnostics,
    FinishedRun,
    Preview,
    diagnose,
    load_finished_run,
    resolve_with_state,
    solved_offline,
)
from calstation.sequencer import Event, StageRanked, StateChanged, StepStarted


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
        app.result_changed.connect(self._released)
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

    @property
    def log_name(self) -> str:
        """Name of the log of the displayed run, or ""."""
        return "" if self._run is None else Path(self._run.result.log.file).name

    def close(self) -> None:
        """Close the displayed run."""
        self.loading.cancel()
        self._diagnosing.cancel()
        self._run = self._path = self._diagnosed_log = None
        for lazy in (self.result, *self._computed, self.cycle):
            lazy.show_empty()
        self.changed.emit()

    def refresh(self) -> None:
        """Show again the state of the registers that the displayed run wrote."""
        if self._run is not None and self._run.result.parameters:
            self.result.view.refresh()

    def source(self) -> str:
        """Return a line with the serial number, time and verdict of the displayed run."""
        if self.loading.busy and self._path is not None:
            return say("engineer.opening", file=self._path.name)
        if self._run is None:
            return ""
        result = self._run.result
        added = " ".join(f"+ {term('group', state)}" for state in result.states_added)
        offline = solved_offline(result)
        solved = "" if offline is None else say(offline)
        parts = result.serial, added, local_time(result.started_utc or ""), solved, verdict_text(result, stages=False)
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
