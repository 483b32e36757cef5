"""Polling of background jobs, and rows that show their progress and a Cancel button."""

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QObject, Qt, QTimer, Signal
from PySide6.QtWidgets import QStackedWidget, QWidget

from calstation.gui.text import Words, duration_text, on_language_change, say
from calstation.gui.widgets import theme
from calstation.gui.widgets.layout import STEPS, button, label, progress_bar, row
from calstation.jobs import Job

#: Interval between two polls, ms; short compared with the 0.2 s that a job started by a selection takes.
_POLL_MS = 20

#: Minimum widths of the text and of the remaining time of a job, px.
_TEXT_WIDTH, _REMAINING_WIDTH = 22 * theme.GRID, 15 * theme.GRID

#: A function that receives the arguments of a signal, or None.
Slot = Callable[..., object] | None


class JobWatch(QObject):
    """A watch that polls one job at a time; `done`, `failed` and `cancelled` are slots for the signals of that name.

    `submit` queues a job that is started; a newer job replaces the previous one, whose result is then ignored.

    Signals: `busy_changed()` when a job begins and after it has ended; `progress(fraction, remaining)` with the
    remaining seconds or None; `done(result)`; `failed(error)` with a `CalstationError`; `cancelled()`.
    """

    busy_changed = Signal()
    progress = Signal(float, object)
    done = Signal(object)
    failed = Signal(object)
    cancelled = Signal()

    def __init__(
        self,
        parent: QObject,
        submit: Callable[..., Job],
        done: Slot = None,
        failed: Slot = None,
        cancelled: Slot = None,
    ) -> None:
        super().__init__(parent)
        self._submit = submit
        for signal, slot in ((self.done, done), (self.failed, failed), (self.cancelled, cancelled)):
            if slot is not None:
                signal.connect(slot)
        self.job: Job | None = None
        self._timer = QTimer(self, interval=_POLL_MS)
        self._timer.timeout.connect(self._poll)

    @property
    def busy(self) -> bool:
        """Whether a job is being polled."""
        return self.job is not None

    def start(self, *args: Any, **kwargs: Any) -> None:
        """Submit a job with these arguments; a previous job is cancelled if it is waiting and may be cancelled."""
        job = self._submit(*args, **kwargs)
        if self.job is not None and self.job.cancellable and self.job.state == "waiting":
            self.job.cancel()
        self.job = job
        self._timer.start()
        self.busy_changed.emit()
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
        self.busy_changed.emit()
        if job.state == "done":
            self.progress.emit(1.0, 0.0)
            self.done.emit(job.result)
        elif job.state == "failed":
            self.failed.emit(job.error)
        else:
            self.cancelled.emit()


class JobRow(QWidget):
    """A row with the text and progress of a `JobWatch`, and a Cancel button with the object name `cancel_name`.

    `usual` states the usual duration, which is shown until the remaining time is known.
    """

    def __init__(self, watch: JobWatch, cancel_name: str = "", words: Words = "", *, usual: Words = "") -> None:
        super().__init__()
        self.watch = watch
        self._words, self._usual = words, usual
        self._fraction = 0.0
        self._remaining: float | None = None
        self._text_label, self.remaining_label = label(), label()
        self.bar = progress_bar(2 * theme.GRID)
        self.remaining_label.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self.cancel_button = button(cancel_name, "common.cancel", watch.cancel)
        if not words:
            self._text_label.hide()
        row(self._text_label, (self.bar, 1), self.remaining_label, self.cancel_button, on=self)
        watch.progress.connect(self._show)
        on_language_change(self, self._refresh)

    def _show(self, fraction: float, remaining: float | None) -> None:
        self._fraction, self._remaining = fraction, remaining
        self._refresh()

    def _refresh(self) -> None:
        job = self.watch.job
        self._text_label.setText(say(self._words))
        self.cancel_button.setVisible(job is None or job.cancellable)
        self.bar.setValue(round(STEPS * self._fraction))
        percent = f"{100 * self._fraction:.0f} %"
        if job is not None and job.state == "waiting":
            self.remaining_label.setText(say("common.waiting"))
        elif self._remaining is None:
            self.remaining_label.setText(", ".join(filter(None, (percent, say(self._usual)))))
        else:
            remaining = say("common.time_left", time=duration_text(self._remaining))
            self.remaining_label.setText(f"{percent}, {remaining}")
        self.bar.setAccessibleName(self.remaining_label.text())
        for text_label, width in ((self._text_label, _TEXT_WIDTH), (self.remaining_label, _REMAINING_WIDTH)):
            text_label.setMinimumWidth(max(width, text_label.sizeHint().width()))  # the bar shrinks, not a text


class JobStack(QStackedWidget):
    """A stack that shows the row of the running job, or the widget `idle` if no job is running."""

    def __init__(self, idle: QWidget, *rows: JobRow) -> None:
        super().__init__()
        self._idle, self._rows = idle, rows
        self.setFixedHeight(theme.BUTTON)
        for widget in (idle, *rows):
            self.addWidget(widget)
        for each in rows:
            each.watch.busy_changed.connect(self._refresh)

    def _refresh(self) -> None:
        running = next((each for each in self._rows if each.watch.busy), self._idle)
        self.setCurrentWidget(running)
