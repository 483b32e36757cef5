"""The history page: finished and incomplete runs, found by serial number, outcome and time."""

from pathlib import Path

from PySide6.QtCore import Qt, QUrl
from PySide6.QtGui import QDesktopServices, QGuiApplication, QKeySequence, QShortcut, QShowEvent
from PySide6.QtWidgets import QPushButton, QSplitter, QStackedWidget, QVBoxLayout

from calstation.errors import CalstationError, InputError
from calstation.gui.history.details import RunDetails
from calstation.gui.history.filters import Filters
from calstation.gui.history.run_table import RunTable
from calstation.gui.shell.context import AppContext
from calstation.gui.shell.page import Page
from calstation.gui.text.messages import error_text
from calstation.gui.widgets import theme
from calstation.gui.widgets.jobs import JobWatch
from calstation.gui.widgets.labels import EmptyState
from calstation.gui.widgets.notice import Choice, NoticeBar
from calstation.records.run_index import RunRecord
from calstation.results.history import History, refresh_history
from calstation.results.result import Result, load_result
from calstation.runs.incomplete import close_incomplete_job
from calstation.runs.resume import Resumable, find_resumable
from calstation.sequencer.events import Event, Verdict

#: Runs listed at a time.
MOST = 300
_TABLE_SHARE, _DETAILS_SHARE = 15, 8


class HistoryPage(Page):
    """The runs of the window's runs folder."""

    def __init__(self, app: AppContext) -> None:
        super().__init__(app)
        self.setObjectName("history_page")
        self._refresher, self._offers, self._closer = JobWatch(self), JobWatch(self), JobWatch(self)
        self._resumable: frozenset[Path] = frozenset()
        self._index: tuple[Path, History] | None = None
        self.filters, self.table, self.details = Filters(), RunTable(), RunDetails()
        self.notice = NoticeBar()
        self.notice.setObjectName("history_notice")
        self._nothing = EmptyState()
        self._clear_button = QPushButton()
        self._clear_button.setObjectName("history_clear_button")
        self._nothing.add(self._clear_button)
        self._split = QSplitter(Qt.Orientation.Horizontal)
        self._split.setChildrenCollapsible(False)
        self._split.setHandleWidth(2 * theme.GRID)
        self._split.addWidget(self.table)
        self._split.addWidget(self.details)
        self._split.setStretchFactor(0, _TABLE_SHARE)
        self._split.setStretchFactor(1, _DETAILS_SHARE)
        self._split.setSizes([_TABLE_SHARE * 100, _DETAILS_SHARE * 100])
        self._stack = QStackedWidget()
        self._stack.addWidget(self._nothing)
        self._stack.addWidget(self._split)
        box = QVBoxLayout(self)
        box.setContentsMargins(2 * theme.GRID, theme.GRID, 2 * theme.GRID, 2 * theme.GRID)
        box.setSpacing(theme.GRID)
        box.addWidget(self.filters)
        box.addWidget(self.notice)
        box.addWidget(self._stack, 1)
        self._connect()
        self.retranslate()

    def title(self) -> str:
        """The page's name on its tab."""
        return self.tr("History")

    @property
    def busy(self) -> bool:
        """Whether the folder is being looked into."""
        return self._refresher.busy or self._offers.busy or self._closer.busy

    @property
    def nothing_title(self) -> str:
        """What the page says where it has no run to show; empty where it has."""
        return self._nothing.title if self._stack.currentWidget() is self._nothing else ""

    def refresh(self) -> None:
        """Bring the index up to date with the folder's files, then show it."""
        if not self.app.runs_folder.is_dir():
            self.show_runs()
        elif not self._refresher.busy:
            self._refresher.watch(self.app.job_queue.submit(refresh_history, self.app.runs_folder))
            self._offers.watch(self.app.job_queue.submit(find_resumable, self.app.runs_folder))

    def show_runs(self) -> None:
        """Show what the index holds of what is asked for."""
        folder, filters = self.app.runs_folder, self.filters
        runs = []
        if folder.is_dir():
            found = self._history().runs(filters.search, filters.outcome, MOST)
            runs = [run for run in found if run.started_utc >= filters.since]
        filters.show_count(len(runs), MOST)
        self._stack.setCurrentWidget(self._split if runs else self._nothing)
        self.table.show_runs(runs)
        self._say_nothing()

    def showEvent(self, event: QShowEvent) -> None:
        """Look into the folder when the page comes up."""
        super().showEvent(event)
        self.show_runs()
        self.refresh()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._clear_button.setText(self.tr("Show all runs"))
        self.table.setAccessibleName(self.tr("Runs, the latest first"))
        self.table.refresh()
        self.filters.show_count(len(self.table.runs.runs), MOST)
        self._say_nothing()

    def _connect(self) -> None:
        self.filters.changed.connect(self.show_runs)
        self._clear_button.clicked.connect(self.filters.clear)
        self.table.selected.connect(self._look_at)
        self.table.doubleClicked.connect(lambda _: self._open_result())
        details = self.details
        details.result_wanted.connect(self._open_result)
        details.log_wanted.connect(self._open_log)
        details.folder_wanted.connect(self._open_folder)
        details.resume_wanted.connect(self._resume)
        details.close_wanted.connect(self._close)
        self._refresher.done.connect(lambda _: self.show_runs())
        self._refresher.failed.connect(self._complain)
        self._offers.done.connect(self._offered)
        self._closer.done.connect(lambda _: self._closed())
        self._closer.failed.connect(self._not_closed)
        self.app.engine_link.event.connect(self._take)
        self.app.runs_folder_changed.connect(self._elsewhere)
        self.app.engine_link.running_changed.connect(lambda _: self._allow())
        finder = QShortcut(QKeySequence.StandardKey.Find, self, self.filters.search_edit.setFocus)
        finder.setContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)

    def _take(self, event: Event) -> None:
        """A run has ended: its row is there."""
        if isinstance(event, Verdict) and self.isVisible():
            self.refresh()

    def _elsewhere(self) -> None:
        """Another folder holds the runs."""
        if self.isVisible():
            self.show_runs()
            self.refresh()

    def _history(self) -> History:
        """The index of the folder at hand; opening it takes longer than asking it."""
        folder = self.app.runs_folder
        if self._index is None or self._index[0] != folder:
            self._index = (folder, History(folder))
        return self._index[1]

    def _look_at(self, run: RunRecord | None) -> None:
        self.details.setVisible(run is not None)
        if run is not None:
            unit = self._history().solved(run.serial)
            self.details.show_run(run, _read(run.result), unit, self._standing())

    def _standing(self) -> tuple[bool, bool, bool]:
        """Whether a run is going on, one is being closed, the one looked at can be resumed."""
        run = self.table.run
        resumable = run is not None and run.log in self._resumable
        return self.app.engine_link.running, self._closer.busy, resumable

    def _allow(self) -> None:
        self.details.allow(self._standing())

    def _offered(self, offers: list[Resumable]) -> None:
        """These runs can be resumed."""
        self._resumable = frozenset(offer.log for offer in offers)
        self._allow()

    def _open_result(self) -> None:
        run = self.table.run
        if run is not None and run.result is not None and self.details.result_button.isEnabled():
            self.app.open_run.emit(run.result)

    def _open_log(self) -> None:
        if self.table.run is not None:
            self.app.open_log.emit(self.table.run.log)

    def _open_folder(self) -> None:
        if self.table.run is not None:
            folder = str(self.table.run.log.parent.absolute())
            if not QDesktopServices.openUrl(QUrl.fromLocalFile(folder)):
                self._show_folder(folder)

    def _show_folder(self, folder: str) -> None:
        """Where this computer has nothing to show a folder with, its path is to be copied."""
        self.notice.ask(
            "none",
            lambda: self.tr("Folder of this run"),
            lambda: folder,
            (
                Choice(
                    "copy_folder_button",
                    lambda: self.tr("Copy the path"),
                    lambda: QGuiApplication.clipboard().setText(folder),
                    primary=True,
                ),
                Choice("folder_close_button", lambda: self.tr("Close"), self.table.setFocus),
            ),
        )

    def _resume(self) -> None:
        if self.table.run is not None:
            self.app.resume_run.emit(self.table.run.log)

    def _close(self) -> None:
        if self.table.run is not None:
            self._closer.watch(self.app.job_queue.submit(close_incomplete_job, self.table.run.log, None))
            self._allow()

    def _closed(self) -> None:
        self._allow()
        self.refresh()

    def _not_closed(self, error: CalstationError) -> None:
        self._allow()
        self._complain(error)
        self.refresh()

    def _complain(self, error: CalstationError) -> None:
        close = Choice("history_notice_close", lambda: self.tr("Close"), self.table.setFocus)
        self.notice.ask(
            "bad",
            lambda: self.tr("The runs could not be read"),
            lambda: error_text(error).sentences,
            (close,),
        )

    def _say_nothing(self) -> None:
        self._clear_button.setVisible(self.filters.narrow)
        if self.filters.narrow:
            self._nothing.say(
                self.tr("No run fits"), self.tr("Search for less, or show every outcome and time.")
            )
        else:
            self._nothing.say(
                self.tr("Every run will be listed here"),
                self.tr(
                    "Passed, failed, stopped, faulty and incomplete ones, with their results and logs. "
                    "Start a run on the first page."
                ),
            )


def _read(path: Path | None) -> Result | None:
    """The result of a run; None if there is none, or none that can be read."""
    try:
        return None if path is None else load_result(path)
    except InputError:
        return None
