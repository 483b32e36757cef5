"""The History page: finished and incomplete runs, filtered by serial number, outcome and time."""

from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt, QUrl, SignalInstance
from PySide6.QtGui import QDesktopServices, QGuiApplication, QKeySequence, QShortcut, QShowEvent

from calstation.config import computer_user
from calstation.errors import InputError
from calstation.gui.history.details import Actions, RunDetails
from calstation.gui.history.run_table import Filters, RunTable
from calstation.gui.shell import AppContext, Page
from calstation.gui.text import bind, on_language_change
from calstation.gui.widgets import Choice, EmptyState, JobWatch, NoticeBar, button, column, split, stack, theme
from calstation.records import RunFilter, RunRecord
from calstation.results import History, Result, load_result, refresh_history
from calstation.runs import Resumable, close_incomplete_job, find_resumable
from calstation.sequencer import Event, Verdict

#: Maximum number of runs listed.
_MAX_RUNS = 300


class HistoryPage(Page):
    """Lists the runs in the runs folder, with the details of the selected run."""

    def __init__(self, app: AppContext) -> None:
        super().__init__(app)
        self.setObjectName("history_page")
        self._refresher, self._offers, self._closer = JobWatch(self), JobWatch(self), JobWatch(self)
        self._resumable: frozenset[Path] = frozenset()
        self._index: tuple[Path, History] | None = None
        self._filters, self.table, self.details = Filters(), RunTable(), RunDetails()
        bind(self.table.setAccessibleName, lambda: self.tr("Runs, the latest first"))
        self.notice = NoticeBar("history_notice")
        self._clear_button = button("history_clear_button", lambda: self.tr("Show all runs"), self._filters.clear)
        self._nothing = EmptyState(self._clear_button)
        self._split = split((self.table, 14), (self.details, 9), handle=2 * theme.GRID)
        self._stack = stack(self._nothing, self._split)
        wide = 2 * theme.GRID
        column(self._filters, self.notice, (self._stack, 1), on=self, margins=(wide, theme.GRID, wide, wide))
        self._connect()
        on_language_change(self, self._show_nothing)

    @property
    def busy(self) -> bool:
        """Whether a background job of the page is running."""
        return self._refresher.busy or self._offers.busy or self._closer.busy

    def refresh(self) -> None:
        """Update the index from the folder, then list the runs."""
        if not self.app.runs_folder.is_dir():
            self.show_runs()
        elif not self._refresher.busy:
            self._refresher.watch(self.app.job_queue.submit(refresh_history, self.app.runs_folder))
            self._offers.watch(self.app.job_queue.submit(find_resumable, self.app.runs_folder))

    def show_runs(self) -> None:
        """List the indexed runs that match the filters."""
        filters = self._filters
        runs = []
        if self.app.runs_folder.is_dir():
            found = self._history().runs(RunFilter(filters.search, filters.outcome or ""), _MAX_RUNS)
            runs = [run for run in found if run.started_utc >= filters.since]
        self._stack.setCurrentWidget(self._split if runs else self._nothing)
        self.table.show_runs(runs)
        self._show_nothing()

    def showEvent(self, event: QShowEvent) -> None:
        """List the indexed runs immediately, and update the list when the folder has been read."""
        super().showEvent(event)
        self._list_visible()

    def _connect(self) -> None:
        details, app = self.details, self.app
        self._filters.changed.connect(self.show_runs)
        self.table.selected.connect(self._show_details)
        self.table.doubleClicked.connect(lambda _: self._open_result())
        details.result_button.clicked.connect(self._open_result)
        details.log_button.clicked.connect(lambda: self._emit_log(app.open_log))
        details.folder_button.clicked.connect(self._open_folder)
        details.resume_button.clicked.connect(lambda: self._emit_log(app.resume_run))
        details.close_button.clicked.connect(self._close_run)
        self._refresher.done.connect(lambda _: self.show_runs())
        unread, focus = lambda: self.tr("The runs could not be read"), self.table.setFocus
        self.notice.report_failures(self._refresher, unread, focus)
        self.notice.report_failures(self._offers, unread, focus)
        self.notice.report_failures(self._closer, lambda: self.tr("The run was not closed"), focus)
        self._offers.done.connect(self._show_resumable)
        for ended in (self._closer.done, self._closer.failed):
            ended.connect(self._update)
            ended.connect(self.refresh)
        app.engine_link.event.connect(self._follow)
        app.runs_folder_changed.connect(self._list_visible)
        app.engine_link.running_changed.connect(lambda _: self._update())
        finder = QShortcut(QKeySequence.StandardKey.Find, self, self._filters.search_edit.setFocus)
        finder.setContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)

    def _follow(self, event: Event) -> None:
        """Update the list when a run has ended."""
        if isinstance(event, Verdict) and self.isVisible():
            self.refresh()

    def _list_visible(self) -> None:
        if self.isVisible():
            self.show_runs()
            self.refresh()

    def _history(self) -> History:
        """Return the index of the current folder; it stays open because opening takes longer than a query."""
        folder = self.app.runs_folder
        if self._index is None or self._index[0] != folder:
            self._index = (folder, History(folder))
        return self._index[1]

    def _show_details(self, run: RunRecord | None) -> None:
        self.details.setVisible(run is not None)
        if run is not None:
            self.details.show_run(run, _result(run), self._history().solved(run.serial), self._actions())

    def _actions(self) -> Actions:
        run = self.table.run
        resumable = run is not None and run.log in self._resumable
        return Actions(self.app.engine_link.running, self._closer.busy, resumable)

    def _update(self) -> None:
        self.details.allow(self._actions())

    def _show_resumable(self, offers: list[Resumable]) -> None:
        self._resumable = frozenset(offer.log for offer in offers)
        self._update()

    # ---- actions on the selected run

    def _open_result(self) -> None:
        run = self.table.run
        if run is not None and run.result is not None and self.details.has_parameters:
            self.app.open_run.emit(run.result)

    def _emit_log(self, signal: SignalInstance) -> None:
        if self.table.run is not None:
            signal.emit(self.table.run.log)

    def _open_folder(self) -> None:
        if self.table.run is not None:
            folder = str(self.table.run.log.parent.absolute())
            if QDesktopServices.openUrl(QUrl.fromLocalFile(folder)):
                return
            copy = partial(QGuiApplication.clipboard().setText, folder)  # this computer cannot open folders
            choices = (
                Choice("copy_folder_button", lambda: self.tr("Copy the path"), copy, primary=True),
                Choice("folder_close_button", lambda: self.tr("Close"), self.table.setFocus),
            )
            self.notice.ask("none", lambda: self.tr("Folder of this run"), lambda: folder, choices)

    def _close_run(self) -> None:
        if self.table.run is not None:
            job = self.app.job_queue.submit(close_incomplete_job, self.table.run.log, computer_user())
            self._closer.watch(job)
            self._update()

    def _show_nothing(self) -> None:
        self._filters.show_count(len(self.table.runs), _MAX_RUNS)
        active = self._filters.active
        self._clear_button.setVisible(active)
        if active:
            self._nothing.say(self.tr("No run matches"), self.tr("Search for less, or show every outcome and time."))
        else:
            self._nothing.say(
                self.tr("Every run will be listed here"),
                self.tr(
                    "Passed, failed, stopped, faulty and incomplete ones, with their results and logs. "
                    "Start a run on the first page."
                ),
            )


def _result(run: RunRecord) -> Result | None:
    """Return the result of a run, None if there is no readable one."""
    if run.result is None:
        return None
    try:
        return load_result(run.result)
    except InputError:
        return None
