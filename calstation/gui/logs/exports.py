"""Exports the log as CSV and TOML, and the result as JSON or CSV, to files that the user chooses."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QWidget

from calstation.gui.widgets import JobWatch, NoticeBar, ask_file
from calstation.jobs import JobQueue
from calstation.results import Result, drop_partial, export_log, export_result
from calstation.results.plots import LogIndex


class Exports(QObject):
    """Asks for the target file and submits the export job; `notice` shows how it ended, then `focus` is called."""

    def __init__(self, job_queue: JobQueue, page: QWidget, notice: NoticeBar, focus: Callable[[], None]) -> None:
        super().__init__(page)
        self._notice, self._focus = notice, focus
        self._job_queue, self._page = job_queue, page
        self._target = Path()
        self.watch, self._cleanup = JobWatch(self, self._written, cancelled=self._drop_partial), JobWatch(self)
        notice.report_failures(self.watch, lambda: self.tr("The export failed"), focus)

    def ask_log(self, log: LogIndex, first: int, last: int) -> None:
        """Ask for the file to which a log's samples from `first` to `last` are exported."""
        whole = (first, last) == (log.facts.first_seq, log.facts.last_seq)
        ending = "export" if whole else f"{first}-{last}"
        self._ask(
            self.tr("Export the log") if whole else self.tr("Export the range"),
            log.path.with_name(f"{_stem(log.path)}-{ending}.csv"),
            ["CSV (*.csv)", self.tr("Compressed CSV (*.csv.gz)")],
            lambda target: (export_log, log.path, target, first, last),
        )

    def ask_result(self, log: Path, result: Result, stored: Result | None, ending: str = "offline") -> None:
        """Ask for the file of a log's result; `stored` is the run's result, `ending` a suffix of the proposed name."""
        self._ask(
            self.tr("Export the result"),
            log.with_name(f"{_stem(log)}-{ending}.json"),
            ["JSON (*.json)", self.tr("Parameters as CSV (*.csv)")],
            lambda target: (export_result, result, stored, target),
        )

    def _ask(self, title: str, proposed: Path, kinds: list[str], work: Callable[[Path], tuple[Any, ...]]) -> None:
        """Ask for a file, then submit the job that `work` returns for it, a function and its arguments."""

        def begin(target: Path) -> None:
            self._target = target
            self.watch.watch(self._job_queue.submit(*work(self._target)))

        ask_file(self._page, title, proposed, kinds, begin)

    def _written(self, target: Path) -> None:
        self._notice.inform("good", lambda: self.tr("Written"), lambda: str(target), self._focus)

    def _drop_partial(self) -> None:  # a cancelled job worker leaves a partial file
        self._cleanup.watch(self._job_queue.submit(drop_partial, self._target))


def _stem(path: Path) -> str:
    return path.name.removesuffix(".gz").removesuffix(".csv").removesuffix(".h5")
