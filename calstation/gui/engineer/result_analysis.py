"""A finished run looked at closely: opened by a job, its innovations and residuals made once somebody looks at them."""

from pathlib import Path

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QWidget

from calstation.errors import CalstationError
from calstation.gui.engineer.error_wording import one_line
from calstation.gui.engineer.innovations_view import InnovationsView
from calstation.gui.engineer.lazy import LazyView
from calstation.gui.engineer.observability_view import ObservabilityView
from calstation.gui.engineer.residuals_view import ResidualsView
from calstation.gui.engineer.result_view import ResultView
from calstation.gui.engineer.verdict_wording import word_verdict
from calstation.gui.shell.context import AppContext
from calstation.gui.text.messages import error_text, term
from calstation.gui.widgets.jobs import JobWatch
from calstation.results.diagnostics import Diagnostics, diagnose
from calstation.results.finished_run import FinishedRun, load_finished_run
from calstation.results.preview import Preview


class ResultAnalysis(QObject):
    """The four views of a result and the jobs that fill them.

    `changed` when another run is opened or could not be; `loaded` once it is there; `failed(path, error)`
    """

    changed = Signal()
    loaded = Signal(object)
    failed = Signal(object, object)

    def __init__(self, app: AppContext, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._app = app
        self.run: FinishedRun | None = None
        self._path: Path | None = None
        self._looked: Path | None = None
        self.loading, self.diagnosing = JobWatch(self), JobWatch(self)
        self.result, self.observability = ResultView(), ObservabilityView()
        self.innovations, self.residuals = InnovationsView(), ResidualsView()
        self._result, self._observability = LazyView(self.result), LazyView(self.observability)
        self._deep = tuple(LazyView(view, self.diagnosing) for view in (self.innovations, self.residuals))
        self.loading.done.connect(self._loaded)
        self.loading.failed.connect(self._not_loaded)
        self.diagnosing.done.connect(self._diagnosed)
        self.diagnosing.failed.connect(self._not_diagnosed)
        self.diagnosing.cancelled.connect(lambda: self._not_diagnosed(None))

    @property
    def views(self) -> tuple[LazyView, ...]:
        """Parameters, innovations, residuals, observability."""
        return (self._result, *self._deep, self._observability)

    def open(self, path: Path) -> None:
        """Look at a result or a log."""
        self._path = path
        self.loading.watch(self._app.job_queue.submit(load_finished_run, path, self._app.runs_folder))
        self.changed.emit()

    def foresee(self, told: Preview) -> None:
        """Before any run is opened, the observability that a preview expects."""
        if self.run is None:
            self.observability.show_stages({s.stage: s.observability for s in told.stages})
            self._observability.show_view()

    def look(self, view: QWidget | None) -> None:
        """A view is looked at: innovations and residuals are made now if they were not."""
        run = self.run
        if run is None or view not in self._deep or run.log == self._looked is not None:
            return
        if run.log is None:
            self._say_why_not(self.tr("Its log is not there any more."))
        elif not run.result_json["stages"]:
            self._say_why_not(self._why_no_answer(run))
        else:
            self._looked = run.log
            log, stages = run.result_json["log"], tuple(run.result_json["stages"])
            job = self._app.job_queue.submit(diagnose, run.log, stages, log["first_seq"], log["last_seq"])
            self.diagnosing.watch(job)
            for lazy in self._deep:
                lazy.show_work()

    def source(self) -> str:
        """What is looked at, in a line."""
        if self.loading.busy and self._path is not None:
            return self.tr("Opening {0}").format(self._path.name)
        if self.run is None:
            return ""
        result = self.run.result_json
        started = str(result.get("started_utc") or "").replace("T", " ")[:16]
        parts = (str(result["unit"]["serial"]), started, word_verdict(result, stages=False))
        return "  ·  ".join(part for part in parts if part)

    def _loaded(self, run: FinishedRun) -> None:
        self.run, self._looked = run, None
        if run.result_json["parameters"]:
            self.result.show_run(run)
            self._result.show_view()
        else:
            self._result.show_empty(self._why_no_answer(run))
        self.observability.show_stages(run.result_json.get("observability") or {})
        self._observability.show_view()
        for lazy in self._deep:
            lazy.show_empty()
        self.changed.emit()
        self.loaded.emit(run)

    def _not_loaded(self, error: CalstationError) -> None:
        path, self._path = self._path, None
        self.changed.emit()
        self.failed.emit(path, error)

    def _diagnosed(self, found: Diagnostics) -> None:
        self.innovations.show_diagnostics(found)
        self.residuals.show_diagnostics(found)
        for lazy in self._deep:
            lazy.show_view()

    def _not_diagnosed(self, error: CalstationError | None) -> None:
        self._say_why_not(error_text(error).sentences if error else "")

    def _say_why_not(self, text: str) -> None:
        self._looked = None
        for lazy in self._deep:
            lazy.show_empty(text)

    def _why_no_answer(self, run: FinishedRun) -> str:
        said = self.tr("The run ended without an answer: {0}").format(
            term("badge", str(run.result_json["outcome"]))
        )
        error = run.result_json.get("error")
        return f"{said}. {one_line(str(error))}" if error else said
