"""Base classes of pages and of other views with background jobs."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from calstation.gui.state.context import AppContext
from calstation.gui.text import Words
from calstation.gui.widgets import JobWatch, NoticeBar, Slot, ask_file
from calstation.results import drop_partial


class JobView(QWidget):
    """A view with background jobs, whose failures its notice bar reports; `busy_changed()` when one begins or ends.

    The focus proxy of the view receives the keyboard focus when a notice is closed.
    """

    busy_changed = Signal()

    def __init__(self, app: AppContext, name: str) -> None:
        super().__init__()
        self.app = app
        self.notice = NoticeBar(f"{name}_notice")
        self._jobs: list[JobWatch] = []

    @property
    def busy(self) -> bool:
        """Whether a job of the view is waiting or running."""
        return any(job.busy for job in self._jobs)

    def job(
        self,
        work: Callable[..., object] | None,
        done: Slot = None,
        *,
        failure: Words = "",
        failed: Slot = None,
        cancelled: Slot = None,
        then: Callable[[], None] | None = None,
        cancellable: bool = True,
    ) -> JobWatch:
        """Return a watch whose `start` calls `work` in the background; see `AppContext.job`.

        Parameters
        ----------
        work
            Function at the top level of a module; None if it is the first argument of `start`.
        done, failed, cancelled
            Called with the result, with the error, and without arguments.
        failure
            Title under which the notice bar reports an error; "" to leave the report to `failed`.
        then
            Called after the report has been closed; by default the view receives the focus.
        cancellable
            False for a job that uses a device.
        """
        watch = self.app.job(self, work, done, failed=failed, cancelled=cancelled, cancellable=cancellable)
        if failure:
            self.notice.report_failures(watch, failure, then or self.setFocus)
        watch.busy_changed.connect(self.busy_changed)
        self._jobs.append(watch)
        return watch


class Page(JobView):
    """A page of the window.

    The main window draws a strip at the top of every page, with STOP at its right end. `header` is shown on the left
    of the strip; if it is None, the strip shows the progress of the run.
    """

    header: QWidget | None = None

    def __init__(self, app: AppContext, name: str = "") -> None:
        super().__init__(app, name)
        if name:
            self.setObjectName(f"{name}_page")

    def may_leave(self, go: Callable[[], object]) -> bool:
        """Return whether the page may be left; a page may return False and call `go` after a confirmation."""
        return True


class FileExport:
    """Exports to a file selected by the user as a job of `view`; `then` is called after its notice is closed."""

    def __init__(self, view: JobView, then: Callable[[], None] | None = None) -> None:
        self._view, self._then = view, then or view.setFocus
        self._target = Path()
        self.watch = view.job(
            None, self._show_written, failure="common.export_failed", cancelled=self._drop_partial, then=self._then
        )
        self._cleanup = view.app.job(view, drop_partial)

    def ask(self, title: str, proposed: Path, kinds: list[str], work: Callable[[Path], tuple[Any, ...]]) -> None:
        """Ask for a file, then start the job that `work` returns for it, a function and its arguments."""

        def begin(target: Path) -> None:
            self._target = target
            self.watch.start(*work(target))

        ask_file(self._view, title, proposed, kinds, begin)

    def _show_written(self, target: Path) -> None:
        self._view.notice.inform("good", "common.written", lambda: str(target), self._then)

    def _drop_partial(self) -> None:  # a cancelled job worker leaves a partial file
        self._cleanup.start(self._target)
