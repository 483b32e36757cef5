"""Follows a job of the workshop from a timer and tells how it gets on."""

from PySide6.QtCore import QObject, QTimer, Signal

from calstation.jobs.queue import Job

#: Between two looks at the job, ms.
_EVERY = 50


class JobWatch(QObject):
    """Watches one job after another.

    `progress(fraction, remaining)` with seconds left or None; `done(result)`; `failed(sentence)`; `cancelled()`.
    """

    progress = Signal(float, object)
    done = Signal(object)
    failed = Signal(str)
    cancelled = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.job: Job | None = None
        self._timer = QTimer(self)
        self._timer.setInterval(_EVERY)
        self._timer.timeout.connect(self._look)

    @property
    def busy(self) -> bool:
        """Whether a job is being watched."""
        return self.job is not None

    def watch(self, job: Job) -> None:
        """Follow `job`; one followed before is let go."""
        self.job = job
        self._timer.start()
        self.progress.emit(0.0, None)

    def cancel(self) -> None:
        """Give the job up."""
        if self.job is not None:
            self.job.cancel()
            self._look()

    def _look(self) -> None:
        job = self.job
        if job is None:
            return
        job.poll()
        if not job.ended:
            self.progress.emit(job.fraction, job.remaining)
            return
        self.job = None
        self._timer.stop()
        if job.state == "done":
            self.progress.emit(1.0, 0.0)
            self.done.emit(job.result)
        elif job.state == "failed":
            self.failed.emit(job.error)
        else:
            self.cancelled.emit()
