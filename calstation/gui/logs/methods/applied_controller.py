"""The view before and after at work: an answer applied to a recording, or to what its unit says now."""

from pathlib import Path

import numpy as np
from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QFileDialog, QWidget

from calstation.connection import apply_to_unit
from calstation.errors import CalstationError
from calstation.gui.logs.methods.applied_view import AppliedView
from calstation.gui.shell import AppContext
from calstation.gui.text import error_text
from calstation.physics import NAMES, FloatArray
from calstation.results.plots import MethodAnswer, apply_to_recording


class AppliedController(QObject):
    """Does the view's work with one answer after another.

    `began()`: what is wrong with work before is no news any more; `failed(say)`: `say` words what is wrong in the
    language in force.
    """

    began = Signal()
    failed = Signal(object)

    def __init__(self, app: AppContext, view: AppliedView, parent: QWidget) -> None:
        super().__init__(parent)
        self._app, self._view, self._parent = app, view, parent
        self._answer: MethodAnswer | None = None
        self._path: Path | None = None
        view.wanted.connect(self._look_for_another)
        view.unit_wanted.connect(self.apply_now)
        view.watch.failed.connect(self._complain)
        for ended in (view.watch.done, view.watch.failed):
            ended.connect(lambda _: self._allow())
        view.watch.cancelled.connect(self._allow)
        app.engine_link.running_changed.connect(lambda _: self._allow())

    def take(self, answer: MethodAnswer) -> None:
        """Another answer: applied to its own recording first."""
        self._answer = answer
        self._view.clear(answer.recording.serial)
        self.apply(answer.recording.path)

    def apply(self, path: Path) -> None:
        """Show a recording with the answer, before and after."""
        if self._answer is None or self._at_device:
            return
        self.began.emit()
        self._path = path
        self._view.watch.watch(self._app.job_queue.submit(apply_to_recording, path, *self._vectors()))
        self._allow()

    def apply_now(self) -> None:
        """Show some seconds of the unit's stream with the answer, before and after."""
        if self._answer is None or self._at_device or self._app.engine_link.running:
            return
        self.began.emit()
        self._path = None
        job = self._app.job_queue.submit(
            apply_to_unit,
            self._answer.recording.path,
            self._app.station_path,
            self._app.product_path,
            *self._vectors(),
            cancellable=False,
        )
        self._view.watch.watch(job)
        self._allow()

    @property
    def _at_device(self) -> bool:
        """Whether the unit is being listened to: nothing else may take its place in the view until it has ended."""
        job = self._view.watch.job
        return job is not None and not job.cancellable

    def _vectors(self) -> tuple[FloatArray, FloatArray]:
        """All parameters before and found; those that the method does not find stay as they were."""
        answer = self._answer
        assert answer is not None
        before = np.array([answer.before[name][0] for name in NAMES])
        rows = answer.parameters
        found = [rows[name].value if name in rows else before[k] for k, name in enumerate(NAMES)]
        return before, np.array(found)

    def _allow(self) -> None:
        self._view.set_at_work(at_device=self._at_device, running=self._app.engine_link.running)

    def _complain(self, error: CalstationError) -> None:
        self.failed.emit(lambda: error_text(error).sentences)

    def _look_for_another(self) -> None:
        dialog = QFileDialog(self._parent, self.tr("Apply to a recording"))
        dialog.setFileMode(QFileDialog.FileMode.ExistingFile)
        dialog.setNameFilters([self.tr("Logs (*.h5 *.csv *.csv.gz)"), self.tr("All files (*)")])
        if self._answer is not None:
            dialog.setDirectory(str(self._answer.recording.path.parent))
        dialog.fileSelected.connect(lambda name: self.apply(Path(name)))
        dialog.finished.connect(dialog.deleteLater)
        dialog.open()
