"""Export to a file selected by the user, as a background job."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QWidget

from calstation.gui.widgets.files import ask_file
from calstation.gui.widgets.jobs import JobWatch
from calstation.gui.widgets.notice import NoticeBar
from calstation.jobs import JobQueue
from calstation.results import drop_partial


class FileExport(QObject):
    """Asks for the target file and submits the export job; `notice` shows its outcome, then `focus` is called."""

    def __init__(self, job_queue: JobQueue, page: QWidget, notice: NoticeBar, focus: Callable[[], None]) -> None:
        super().__init__(page)
        self._notice, self._focus = notice, focus
        self._job_queue, self._page = job_queue, page
        self._target = Path()
        self.watch, self._cleanup = JobWatch(self, self._written, cancelled=self._drop_partial), JobWatch(self)
        notice.report_failures(self.watch, "common.export_failed", focus)

    def ask(self, title: str, proposed: Path, kinds: list[str], work: Callable[[Path], tuple[Any, ...]]) -> None:
        """Ask for a file, then submit the job that `work` returns for it, a function and its arguments."""

        def begin(target: Path) -> None:
            self._target = target
            self.watch.watch(self._job_queue.submit(*work(self._target)))

        ask_file(self._page, title, proposed, kinds, begin)

    def _written(self, target: Path) -> None:
        self._notice.inform("good", "common.written", lambda: str(target), self._focus)

    def _drop_partial(self) -> None:  # a cancelled job worker leaves a partial file
        self._cleanup.watch(self._job_queue.submit(drop_partial, self._target))
