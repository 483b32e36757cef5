"""The History page: finished and incomplete runs, which can be filtered, compared and exported."""

from contextlib import nullcontext, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from PySide6.QtCore import QSignalBlocker, Qt, QTimer, QUrl, SignalInstance
from PySide6.QtGui import QDesktopServices, QGuiApplication, QHideEvent, QKeySequence, QShortcut, QShowEvent
from PySide6.QtWidgets import QWidget

from calstation.config import load_station
from calstation.database import export_shared_runs, fetch_log, fetch_result, load_shared_results, note_use
from calstation.errors import CalstationError, InputError
from calstation.gui.history.audit_view import AuditView
from calstation.gui.history.comparison import MAX_COMPARED, RunComparison
from calstation.gui.history.details import Actions, RunDetails
from calstation.gui.history.filters import Filters
from calstation.gui.history.record_view import RecordView
from calstation.gui.history.run_table import RunTable
from calstation.gui.history.trend import MAX_TREND
from calstation.gui.history.versions_view import VersionsView
from calstation.gui.operator import CertificateButton, LabelButton, UnprintedNotice
from calstation.gui.state import AppContext, FileExport, Page, ReleaseBar, ask_to_sign_in
from calstation.gui.text import bind, on_language_change, say
from calstation.gui.widgets import (
    Choice,
    ElidedLabel,
    EmptyState,
    JobRow,
    JobStack,
    box,
    button,
    column,
    enable,
    row,
    split,
    stack,
    theme,
)
from calstation.records import RunFilter, RunRecord, Verdict
from calstation.results import History, Result, refresh_history, result_doubt
from calstation.runs import Resumable, close_incomplete_job, find_resumable
from calstation.sequencer import Event, Finalized

#: Interval at which a visible page reads the folder again, because other programs may add runs, ms.
_REFRESH_MS = 60_000


class HistoryPage(Page):
    """The page that lists the runs in the runs folder, with the details of the selected run."""

    def __init__(self, app: AppContext) -> None:
        super().__init__(app, "history")
        unread = "common.runs_not_read"
        self._refresher = self.job(refresh_history, self._show_refreshed, failure=unread)
        self._quiet_refresher = self.job(refresh_history, self._show_added)  # errors are not shown
        self._resumable_finder = self.job(find_resumable, self._show_resumable, failure=unread)
        self._closer = self.job(
            close_incomplete_job, self._closed, failure="common.run_not_closed", failed=self._show_closed
        )
        self._loader = self.job(load_shared_results, self._show_comparison, failure="history.runs_not_compared")
        self._logs = self.job(fetch_log, app.open_log.emit, failure="history.log_not_opened")
        self._results = self.job(fetch_result, self._open_fetched, failure="common.result_not_opened")
        self._resumable: frozenset[Path] = frozenset()
        self._index: tuple[Path, History] | None = None
        self._compared: tuple[RunRecord, ...] = ()
        self._shown_log: Path | None = None  #: Log of the run whose details are shown.
        self._match_count = self._export_count = 0
        #: Change token of the index when its runs were listed; None if they were not listed.
        self._listed: str | None = None
        #: Timers that show the list and the details in separate iterations of the event loop, to keep each one short.
        self._list_timer, self._details_timer = (QTimer(self, singleShot=True, interval=0) for _ in range(2))
        self._refresh_timer = QTimer(self, interval=_REFRESH_MS)
        self.table = RunTable()
        bind(self.table.setAccessibleName, "history.run_table")
        self.setFocusProxy(self.table)
        unprinted = UnprintedNotice(app, "history_unprinted_notice", self.setFocus)
        self.details = RunDetails(
            LabelButton(app, "history_label_button", self.notice, self.setFocus, unprinted=unprinted),
            CertificateButton(app, "history_certificate_button", self.notice, self.setFocus),
            ReleaseBar(app, "history_release"),
        )
        self.exports = FileExport(self)
        self._filters = Filters(self._build_actions())
        self._clear_button.clicked.connect(self._filters.clear)
        self._nothing = EmptyState()
        self._split = split((self.table, 25), (self.details, 21), handle=2 * theme.GRID)
        self._stack = stack(self._nothing, self._split)
        runs = box(self._filters, (self._stack, 1))
        self._comparison = RunComparison(self._show_list)
        self.versions = VersionsView(self, self._show_list)
        self.record = RecordView(app, self._show_list)
        self.audit = AuditView(app, self._show_list)
        self._views = stack(runs, self._comparison, self.versions, self.record, self.audit)
        wide = 2 * theme.GRID
        column(unprinted, self.notice, (self._views, 1), on=self, margins=(wide, theme.GRID, wide, wide))
        self._connect()
        self.busy_changed.connect(self._show_texts)
        on_language_change(self, self._show_texts)

    @property
    def manual(self) -> str:
        """The section of the manual about the current view."""
        sections: dict[QWidget | None, str] = {
            self._comparison: "how-to/history.md#compare",
            self.versions: "how-to/history.md#versions",
            self.record: "how-to/history.md#the-record-of-a-run",
            self.audit: "how-to/audit-trail.md",
        }
        return sections.get(self._views.currentWidget(), "how-to/history.md#filter")

    def refresh(self) -> None:
        """Update the index from the folder, then list the runs."""
        if not self.app.runs_folder.is_dir():
            self._listed = None
            self.show_runs()
        elif not self._refresher.busy:
            self._refresher.start(self.app.runs_folder)
            self._find_resumable()

    def _refresh_quietly(self) -> None:
        """Update the index, because other programs may have changed the folder; errors are not shown."""
        if self.app.runs_folder.is_dir() and not self.app.job_queue.busy:
            self._quiet_refresher.start(self.app.runs_folder)

    def _show_added(self, changed: int) -> None:
        if changed:
            self._find_resumable()
        self._show_refreshed(in_place=True)

    def _find_resumable(self) -> None:
        name, measured = self._station()
        self._resumable_finder.start(self.app.runs_folder, name, measured=measured)

    def _station(self) -> tuple[str | None, bool]:
        """Return the name of the station, or None if its file is invalid, and whether it has hardware."""
        try:
            station = load_station(self.app.station_path)[1]
        except CalstationError:
            return None, False
        return station.name, station.bench is None

    def show_runs(self, *, in_place: bool = False) -> None:
        """List the indexed runs that match the filters."""
        with self._history().one_connection() if self.app.runs_folder.is_dir() else nullcontext():
            self._show_matching(in_place)

    def _show_matching(self, in_place: bool) -> None:
        history = self._history() if self.app.runs_folder.is_dir() else None
        conditions = self._filters.conditions
        self._match_count, self._export_count = (0, 0) if history is None else history.counts(conditions)
        self._stack.setCurrentWidget(self._split if self._match_count else self._nothing)
        with QSignalBlocker(self.table):
            self.table.show_runs(
                lambda *part: [] if history is None else history.runs(conditions, *part),
                self._match_count,
                in_place=in_place,
            )
        self._details_timer.start()
        self._show_texts()

    def showEvent(self, event: QShowEvent) -> None:
        """List the indexed runs in the next iteration of the event loop, and again after the folder has been read."""
        super().showEvent(event)
        self.refresh()
        self._list_timer.start()
        self._refresh_timer.start()

    def hideEvent(self, event: QHideEvent) -> None:
        """Stop reading the folder."""
        super().hideEvent(event)
        self._refresh_timer.stop()

    def _build_actions(self) -> QWidget:
        """Create the row with the number of runs and the actions on several runs, or the progress of a job."""
        self._count_label = ElidedLabel("muted")
        self._count_label.setObjectName("history_count_label")
        self._count_label.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self._clear_button = button("history_clear_button", "history.show_all")
        self._compare_button = button("history_compare_button", "common.compare", self._compare)
        self._export_button = button("history_export_button", pressed=self._export)
        versions = button(
            "history_versions_button", "history.versions", self._show_versions, tip="history.versions_tip"
        )
        audit = button("history_audit_button", "history.audit_trail", self._show_audit, tip="history.audit_tip")
        buttons = (self._clear_button, self._compare_button, versions, audit, self._export_button)
        actions = box(row((self._count_label, 1), *buttons))
        return JobStack(
            actions,
            JobRow(self._loader, "comparison_cancel_button"),
            JobRow(self._logs, "log_cancel_button", "history.copying_log"),
            JobRow(self._results, "result_cancel_button", "history.reading_result"),
            JobRow(self.exports.watch, "history_export_cancel_button"),
        )

    def _connect(self) -> None:
        details, app = self.details, self.app
        self._filters.changed.connect(self.show_runs)
        self.table.selected.connect(self._show_details)
        self._list_timer.timeout.connect(self._show_refreshed)
        self._details_timer.timeout.connect(self._show_details)
        self._refresh_timer.timeout.connect(self._refresh_quietly)
        self.table.doubleClicked.connect(lambda _: self._open_result())
        details.result_button.clicked.connect(self._open_result)
        details.log_button.clicked.connect(self._open_log)
        details.record_button.clicked.connect(self._show_record)
        details.folder_button.clicked.connect(self._open_folder)
        details.resume_button.clicked.connect(lambda: self._emit_log(app.resume_run))
        details.close_button.clicked.connect(self._close_run)
        details.batch_button.clicked.connect(self._show_batch)
        self.table.selection_changed.connect(self._show_texts)
        self.exports.watch.busy_changed.connect(self.notice.dismiss)
        app.engine_link.event.connect(self._handle_event)
        app.runs_folder_changed.connect(self._list_visible)
        app.result_changed.connect(lambda _: self._list_visible())
        app.engine_link.running_changed.connect(lambda _: self._update())
        app.role.changed.connect(self._update)
        finder = QShortcut(QKeySequence.StandardKey.Find, self, self._filters.search_edit.setFocus)
        finder.setContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)

    def _handle_event(self, event: Event) -> None:
        """Update the list when a run has ended."""
        if isinstance(event, Finalized) and self.isVisible():
            self.refresh()

    def _list_visible(self) -> None:
        if self.isVisible():
            self._show_refreshed()
            self.refresh()

    def _show_refreshed(self, _: object = None, *, in_place: bool = False) -> None:
        """List the indexed runs and offer their values in the filters, unless the index has not changed."""
        listed = None
        if self.app.runs_folder.is_dir():
            listed = (
                self._history().mark()
            )  # before the queries, because another process may change the index meanwhile
            if listed is not None and self._listed == listed:
                return
            self._filters.show_choices(self._history().choices())
        self.show_runs(in_place=in_place)
        self._listed = listed

    def _history(self) -> History:
        """Return the index of the current folder, which stays open, because opening takes longer than a query."""
        folder = self.app.runs_folder
        if self._index is None or self._index[0] != folder:
            self._index = (folder, History(folder))
        return self._index[1]

    def _show_details(self) -> None:
        run = self.table.run
        shown = None if run is None else run.log
        if shown != self._shown_log and self.notice.good:  # it is about the previous run
            self.notice.dismiss()
        self._shown_log = shown
        self.details.setVisible(run is not None)
        if run is not None:
            result, unit_runs = self._result(run), self._history().solved(run.serial, run.product, MAX_TREND)
            absent = self._history().absent_attempts(run.serial)
            self.details.show_run(run, result, unit_runs, self._actions(), absent, result_doubt(run))
            try:
                self.details.resolves.show_records(self._history().resolves(run.log), None)
            except InputError as error:
                self.details.resolves.show_records((), error)

    def _result(self, run: RunRecord) -> Result | None:
        """Return the result of a run, from its log if it has no result file; None if missing, unreadable or altered.

        The result of a run of another station is available after it has been opened, until it is overridden or closed.
        If a log contradicts the result file, the run is marked as altered in the index and in the list.
        """
        result = None
        if not (run.altered or run.missing):
            with suppress(InputError):
                result = self._history().result(run)
        if result is None:
            if not (run.origin or run.missing):
                self._history().read_again(run)
                self._list_timer.start()  # lists the runs only if the index has changed
            return None
        outdated = run.origin and (result.released, result.closed_utc is not None) != (run.released, run.closed)
        return None if outdated else result

    def _actions(self) -> Actions:
        run = self.table.run
        resumable = run is not None and run.log in self._resumable
        superseded = run is not None and run.verdict is Verdict.INCOMPLETE and self._superseded(run)
        return Actions(self.app.engine_link.running, self._closer.busy, resumable, superseded, self.app.role.engineer)

    def _superseded(self, run: RunRecord) -> bool:
        """Return whether a later run of the unit has a verdict; a simulated one does not count for a measured run."""
        return any(
            later.verdict.judged and later.started_utc > run.started_utc and later.simulated <= run.simulated
            for later in self._history().of(run.serial)
        )

    def _update(self) -> None:
        self.details.set_actions(self._actions())

    def _show_resumable(self, offers: list[Resumable]) -> None:
        self._resumable = frozenset(offer.log for offer in offers)
        self._update()

    def _closed(self, results: list[Path]) -> None:
        for result in results:
            self.app.result_changed.emit(result)
        self._show_closed(results)

    def _show_closed(self, _: object) -> None:
        self._update()
        self.refresh()

    # ---- actions on the selected run

    def _open_result(self) -> None:
        """Open the result of the selected run; the result of another station is read from the shared database."""
        run = self.table.run
        if run is None:
            return
        if run.origin and run.stages:
            self._results.start(self.app.station_path, run)
        elif run.result is not None and self.details.has_parameters:
            self.app.open_run.emit(run.result)

    def _open_fetched(self, result: Path) -> None:
        self._show_details()
        self.app.open_run.emit(result)

    def _open_log(self) -> None:
        """Open the log of the selected run; the log of another station is copied from the archive."""
        run = self.table.run
        if run is None:
            return
        if run.log.exists():
            if run.origin:
                note_use(run.log)
            self.app.open_log.emit(run.log)
        else:
            self._logs.start(run)

    def _emit_log(self, signal: SignalInstance) -> None:
        if self.table.run is not None:
            signal.emit(self.table.run.log)

    def _open_folder(self) -> None:
        if self.table.run is not None:
            folder = str(self.table.run.log.parent.absolute())
            if QDesktopServices.openUrl(QUrl.fromLocalFile(folder)):
                return
            copy = partial(QGuiApplication.clipboard().setText, folder)  # used if this computer cannot open folders
            choices = (
                Choice("copy_folder_button", "history.copy_path", copy, primary=True),
                Choice("folder_close_button", "common.close", self.table.setFocus),
            )
            self.notice.ask("none", "history.run_folder", lambda: folder, choices)

    def _show_record(self) -> None:
        """Show the events and the certificates of the selected run."""
        if (run := self.table.run) is not None:
            self.notice.dismiss()
            self._views.setCurrentWidget(self.record)
            self.record.open(run, self._result(run))

    def _show_batch(self) -> None:
        """List the runs of the batch of the selected run."""
        run = self.table.run
        if run is not None and run.batch is not None:
            self._filters.search_edit.setText(run.batch)

    def _close_run(self) -> None:
        if self.app.badge_required:
            ask_to_sign_in(self.app, self.notice, "common.run_not_closed", "operator.sign_in", self.table.setFocus)
        elif self.table.run is not None:
            self._closer.start((self.table.run.log,), self.app.person or None)
            self._update()

    # ---- actions on several runs

    def _compare(self) -> None:
        """Read the results of the selected runs, and compare them in chronological order."""
        self._compared = self.table.selected_runs[::-1]
        self._loader.start(self.app.station_path, self.app.runs_folder, self._compared)

    def _show_comparison(self, results: list[Result]) -> None:
        self.notice.dismiss()
        self._comparison.show_runs(self._compared, results)
        self._views.setCurrentWidget(self._comparison)
        self._comparison.setFocus()

    def _show_versions(self) -> None:
        self.notice.dismiss()
        self._views.setCurrentWidget(self.versions)
        self.versions.open()

    def _show_audit(self) -> None:
        self.notice.dismiss()
        self._views.setCurrentWidget(self.audit)
        self.audit.open()

    def _show_list(self) -> None:
        self._views.setCurrentIndex(0)
        self.table.setFocus()

    def _export(self) -> None:
        """Export the selected runs or, unless there are several, all runs that match the filters."""
        folder, conditions = self.app.runs_folder, self._filters.conditions
        conditions = replace(conditions, missing=False)
        if len(self.table.selected_runs) > 1:
            conditions = RunFilter(names=tuple(run.log.stem for run in self.table.selected_runs))
        self.exports.ask(
            say("history.export_runs"),
            folder.absolute().parent / "runs.csv",
            ["CSV (*.csv)", "JSON (*.json)"],
            lambda target: (export_shared_runs, self.app.station_path, folder, conditions, target),
        )

    def _why_not_compare(self) -> str:
        chosen = self.table.selected_runs
        if not 2 <= len(chosen) <= MAX_COMPARED:
            return say("history.select_runs", largest=MAX_COMPARED)
        if any(run.verdict is Verdict.INCOMPLETE for run in chosen):
            return say("history.incomplete_selected")
        return say("history.missing_selected") if any(run.missing for run in chosen) else ""

    def _show_texts(self) -> None:
        """Show the number of runs, the possible actions, and the text of an empty list."""
        chosen = len(self.table.selected_runs)
        self._count_label.setText(say("history.run_count", count=self._match_count))
        filtered = self._filters.conditions != RunFilter(missing=None)
        self._clear_button.setVisible(filtered)
        enable(self._compare_button, self._why_not_compare(), say("history.compare_tip"))
        self._export_button.setText(say("history.export_selection" if chosen > 1 else "history.export_list"))
        present = sum(not run.missing for run in self.table.selected_runs)
        count = present if chosen > 1 else self._export_count
        tip = say("history.export_tip", count=count)
        enable(self._export_button, "" if count else say("history.nothing_to_export"), tip)
        if filtered:
            self._nothing.say("history.no_run_matches", "history.relax_filters")
        else:
            self._nothing.say(*(("chart.reading",) if self.busy else ("history.no_runs_yet", "history.about_no_runs")))
