"""Base classes of the pages and other views with background jobs."""

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
    """Base class of views with background jobs; a notice bar reports their errors.

    The signal `busy_changed` is emitted when a job starts and after it has ended. The focus proxy of the view receives
    the keyboard focus when a notice is closed.
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
            Slots that are called with the result, with the error, and without arguments.
        failure
            Title of the notice that reports an error; "" if only `failed` handles it.
        then
            Slot that is called after the notice has been closed; by default the view receives the focus.
        cancellable
            Whether the job may be cancelled; False for a job that uses a device.
        """
        watch = self.app.job(self, work, done, failed=failed, cancelled=cancelled, cancellable=cancellable)
        if failure:
            self.notice.report_failures(watch, failure, then or self.setFocus)
        watch.busy_changed.connect(self.busy_changed)
        self._jobs.append(watch)
        return watch


class Page(JobView):
    """Base class of the pages of the window.

    The main window draws a strip with STOP at its right end at the top of every page. The rest of the strip shows the
    `header` of the page or, if it is None, the progress of the run.
    """

    header: QWidget | None = None

    @property
    def manual(self) -> str:
        """The section of the manual about the current view, as ``path#anchor``; "" for the Help page."""
        return ""

    def __init__(self, app: AppContext, name: str = "") -> None:
        super().__init__(app, name)
        if name:
            self.setObjectName(f"{name}_page")

    def prepare(self) -> None:
        """Create views that would otherwise be created at their first use, which would block the window in a run."""

    def may_leave(self, go: Callable[[], object]) -> bool:
        """Return whether the page may be left; a page that returns False calls `go` after the user has confirmed."""
        return True


class FileExport:
    """Export to files that the user selects, in jobs of `view`; `then` is called after the notice has been closed."""

    def __init__(self, view: JobView, then: Callable[[], None] | None = None) -> None:
        self._view, self._then = view, then or view.setFocus
        self._target = Path()
        self._files: Callable[[Path], list[Path]] = lambda target: [target]
        self.watch = view.job(
            None, self._show_written, failure="common.export_failed", cancelled=self._drop_partial, then=self._then
        )
        self._cleanup = view.app.job(view, drop_partial)

    def ask(
        self,
        title: str,
        proposed: Path,
        kinds: list[str],
        work: Callable[[Path], tuple[Any, ...]],
        files: Callable[[Path], list[Path]] = lambda target: [target],
    ) -> None:
        """Ask for a file, and start a job with the function and the arguments that `work` returns for it.

        `files` returns all files that the job writes.
        """

        def begin(target: Path) -> None:
            self._target, self._files = target, files
            self.watch.start(*work(target))

        ask_file(self._view, title, proposed, kinds, begin)

    def _show_written(self, target: Path) -> None:
        self._view.notice.inform("good", "common.written", lambda: "\n".join(map(str, self._files(target))), self._then)

    def _drop_partial(self) -> None:
        """Delete the partial file of a cancelled job."""
        self._cleanup.start(self._target)
