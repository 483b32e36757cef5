"""Follows background jobs from a timer, and shows their progress in a row with a Cancel button."""

from PySide6.QtCore import QObject, Qt, QTimer, Signal
from PySide6.QtWidgets import QLabel, QProgressBar, QWidget

from calstation.gui.text import duration_text, on_language_change
from calstation.gui.widgets import theme
from calstation.gui.widgets.layout import button, row
from calstation.jobs import Job

#: Interval between two polls of a job, ms.
_EVERY = 50


class JobWatch(QObject):
    """Polls one job after another.

    `progress(fraction, remaining)` with seconds left or None; `done(result)`; `failed(error)` with a
    `CalstationError`; `cancelled()`.
    """

    progress = Signal(float, object)
    done = Signal(object)
    failed = Signal(object)
    cancelled = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.job: Job | None = None
        self._timer = QTimer(self)
        self._timer.setInterval(_EVERY)
        self._timer.timeout.connect(self._poll)

    @property
    def busy(self) -> bool:
        """Whether a job is being followed."""
        return self.job is not None

    def watch(self, job: Job) -> None:
        """Follow `job` in place of the one before."""
        self.job = job
        self._timer.start()
        self.progress.emit(0.0, None)

    def cancel(self) -> None:
        """Cancel the job."""
        if self.job is not None:
            self.job.cancel()
            self._poll()

    def _poll(self) -> None:
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


_STEPS = 1000
#: Fraction from which the time left is shown.
_FIRM = 0.05


class JobRow(QWidget):
    """Follows one `JobWatch`."""

    def __init__(self, watch: JobWatch, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._watch = watch
        self._fraction = 0.0
        self._remaining: float | None = None
        self.bar = QProgressBar()
        self.bar.setRange(0, _STEPS)
        self.bar.setTextVisible(False)
        self.bar.setFixedHeight(2 * theme.GRID)
        self.left_label = QLabel()
        self.left_label.setMinimumWidth(15 * theme.GRID)
        self.left_label.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self.cancel_button = button("", lambda: self.tr("Cancel"), watch.cancel)
        row((self.bar, 1), self.left_label, self.cancel_button, on=self)
        watch.progress.connect(self._show)
        on_language_change(self, self._refresh)

    def _show(self, fraction: float, remaining: float | None) -> None:
        self._fraction, self._remaining = fraction, remaining
        self._refresh()

    def _refresh(self) -> None:
        job = self._watch.job
        self.cancel_button.setVisible(job is None or job.cancellable)
        self.bar.setValue(round(_STEPS * self._fraction))
        percent = f"{100 * self._fraction:.0f} %"
        if job is not None and job.state == "waiting":
            self.left_label.setText(self.tr("waiting for other work"))
        elif self._remaining is None or self._fraction < _FIRM:
            self.left_label.setText(percent)
        else:
            left = self.tr("{0} left").format(duration_text(self._remaining))
            self.left_label.setText(f"{percent}, {left}")
        self.bar.setAccessibleName(self.left_label.text())
