"""A finished run in four views: opened by a job, innovations and residuals computed when they are first shown."""

from pathlib import Path

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QStackedWidget, QWidget

from calstation.errors import CalstationError
from calstation.gui.engineer.innovations_view import InnovationsView
from calstation.gui.engineer.observability_view import ObservabilityView
from calstation.gui.engineer.residuals_view import ResidualsView
from calstation.gui.engineer.result_view import ResultView, verdict_text
from calstation.gui.shell import AppContext
from calstation.gui.text import error_text, on_language_change, say
from calstation.gui.widgets import EmptyState, JobRow, JobWatch, Words, column, theme
from calstation.results import Diagnostics, FinishedRun, Preview, diagnose, load_finished_run


class ResultAnalysis(QObject):
    """The four views of a result and the jobs that fill them.

    Emits `changed` when another run is being opened or could not be, `loaded(run)` once it is open, and
    `failed(error)`.
    """

    changed = Signal()
    loaded = Signal(object)
    failed = Signal(object)

    def __init__(self, app: AppContext, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._app = app
        self._run: FinishedRun | None = None
        self._path: Path | None = None
        #: The log whose diagnostics are shown or being computed.
        self._diagnosed_log: Path | None = None
        self.loading, self._diagnosing = JobWatch(self), JobWatch(self)
        self.result, self.observability = ResultView(), ObservabilityView()
        self.innovations, self.residuals = InnovationsView(), ResidualsView()
        self._result, self._observability = _LazyView(self.result), _LazyView(self.observability)
        self._computed = tuple(_LazyView(view, self._diagnosing) for view in (self.innovations, self.residuals))
        #: Parameters, innovations, residuals, observability.
        self.views: tuple[QWidget, ...] = (self._result, *self._computed, self._observability)
        self.loading.done.connect(self._loaded)
        self.loading.failed.connect(self._not_loaded)
        self._diagnosing.done.connect(self._diagnosed)
        self._diagnosing.failed.connect(lambda error: self._not_diagnosed(lambda: error_text(error).sentences))
        self._diagnosing.cancelled.connect(lambda: self._not_diagnosed(None))

    def open(self, path: Path) -> None:
        """Open a result or a log."""
        self._path = path
        self.loading.watch(self._app.job_queue.submit(load_finished_run, path, self._app.runs_folder))
        self.changed.emit()

    def show_preview(self, preview: Preview) -> None:
        """Show the observability that a preview expects, until a run is opened."""
        if self._run is None:
            self.observability.show_stages({s.stage: s.observability for s in preview.stages})
            self._observability.show_view()

    def prepare(self, view: QWidget | None) -> None:
        """Compute innovations and residuals if `view` shows them and they are not there yet."""
        run = self._run
        if run is None or view not in self._computed or run.log == self._diagnosed_log is not None:
            return
        if run.log is None:
            self._not_diagnosed(lambda: say("engineer.log_gone"))
        elif not run.result.stages:
            self._not_diagnosed(lambda: _why_no_result(run))
        else:
            self._diagnosed_log = run.log
            log, stages = run.result.log, tuple(run.result.stages)
            job = self._app.job_queue.submit(diagnose, run.log, stages, log.first_seq, log.last_seq)
            self._diagnosing.watch(job)
            for lazy in self._computed:
                lazy.show_work()

    def source(self) -> str:
        """Serial number, time and verdict of the run shown, in a line."""
        if self.loading.busy and self._path is not None:
            return self.tr("Opening {0}").format(self._path.name)
        if self._run is None:
            return ""
        result = self._run.result
        started = (result.started_utc or "").replace("T", " ")[:16]
        parts = (result.serial, started, verdict_text(result, stages=False))
        return "  ·  ".join(part for part in parts if part)

    def _loaded(self, run: FinishedRun) -> None:
        self._run, self._diagnosed_log = run, None
        if run.result.parameters:
            self.result.show_run(run)
            self._result.show_view()
        else:
            self._result.show_empty(lambda: _why_no_result(run))
        self.observability.show_stages(run.result.observability)
        self._observability.show_view()
        for lazy in self._computed:
            lazy.show_empty()
        self.changed.emit()
        self.loaded.emit(run)

    def _not_loaded(self, error: CalstationError) -> None:
        self._path = None
        self.changed.emit()
        self.failed.emit(error)

    def _diagnosed(self, found: Diagnostics) -> None:
        self.innovations.show_diagnostics(found)
        self.residuals.show_diagnostics(found)
        for lazy in self._computed:
            lazy.show_view()

    def _not_diagnosed(self, why: Words | None) -> None:
        self._diagnosed_log = None
        for lazy in self._computed:
            lazy.show_empty(why)


def _why_no_result(run: FinishedRun) -> str:
    result = run.result
    text = say("engineer.no_result", outcome=result.outcome)
    error = result.error if result.fault is None else error_text(result.fault).sentences
    return f"{text}. {error}" if error else text


class _LazyView(QStackedWidget):
    """A view that explains what it will show, or its job, until there is something to show."""

    def __init__(self, view: QWidget, watch: JobWatch | None = None) -> None:
        super().__init__()
        self._why: Words | None = None
        self._empty, self._working = EmptyState(), EmptyState()
        work = QWidget()
        if watch is not None:
            wide = 8 * theme.GRID
            column((self._working, 1), JobRow(watch), None, on=work, spacing=0, margins=(wide, 0, wide, 0))
        for widget in (self._empty, view, work):
            self.addWidget(widget)
        on_language_change(self, self._show_texts)

    def show_view(self) -> None:
        """Show the view itself."""
        self.setCurrentIndex(1)

    def show_work(self) -> None:
        """Show the progress of its job."""
        self.setCurrentIndex(2)

    def show_empty(self, why: Words | None = None) -> None:
        """Show why there is nothing to show, or how to get it."""
        self._why = why
        self._show_texts()
        self.setCurrentIndex(0)

    def _show_texts(self) -> None:
        if self._why is not None:
            self._empty.say(say("engineer.nothing_to_show"), self._why())
        else:
            self._empty.say(say("engineer.no_run"), say("engineer.about_no_run"))
        self._working.say(say("engineer.solving"), say("engineer.about_solving"))
