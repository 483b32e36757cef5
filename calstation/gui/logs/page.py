"""The Offline page, which plots a log and solves its stages again or by a method that needs no rate table."""

import shutil
import tempfile
import weakref
from pathlib import Path

from PySide6.QtCore import QMimeData, Qt
from PySide6.QtGui import QDragEnterEvent, QDropEvent, QKeySequence, QShortcut
from PySide6.QtWidgets import QSplitter

from calstation.gui.logs.allan_view import AllanView
from calstation.gui.logs.comparison import Comparison
from calstation.gui.logs.import_panel import ImportPanel
from calstation.gui.logs.log_head import LogHead
from calstation.gui.logs.log_plot import LogPlot
from calstation.gui.logs.methods import CROSS_CALIBRATION, MULTI_POSITION, MethodBar, MethodPanel
from calstation.gui.logs.plot_items import SampleRequest, time_text
from calstation.gui.logs.range_bar import RangeBar, StageChoice
from calstation.gui.logs.source_bar import MAX_RECENT, Exports, SourceBar
from calstation.gui.state import AppContext, Page
from calstation.gui.text import on_language_change, say, step_sentence, term
from calstation.gui.widgets import (
    EmptyState,
    JobRow,
    JobStack,
    MissingEffect,
    box,
    button,
    column,
    enable,
    label,
    row,
    set_subject,
    show_text,
    split,
    stack,
    theme,
)
from calstation.physics import EffectName
from calstation.records import LOG_SUFFIXES, foreign_format
from calstation.results import History, Resolved, offline_solve
from calstation.results.plots import Columns, LogIndex, log_index, longest_rest, samples


class OfflinePage(Page):
    """The page that shows a log, the selected range and the solution."""

    def __init__(self, app: AppContext) -> None:
        super().__init__(app, "offline")
        self.setAcceptDrops(True)
        self.log: LogIndex | None = None
        self.solved: Resolved | None = None
        #: Range and stages for which the last solution was started, and range and stages of `solved`.
        self._started_with: tuple[object, ...] = ()
        self._solved_with: tuple[object, ...] = ()
        self._indexes = Path(tempfile.mkdtemp(prefix="calstation-"))
        weakref.finalize(self, shutil.rmtree, self._indexes, ignore_errors=True)
        self._opened = 0
        self._pointed: int | None = None
        self._request: SampleRequest | None = None
        close = self._close
        self.reader = self.job(log_index, self._show_log, failure="logs.log_not_opened", failed=close, cancelled=close)
        self.solver = self.job(offline_solve, self._show_solved, failure="logs.range_not_solved")
        self._sampler = self.job(samples, self._show_samples)
        self.rest_finder = self.job(longest_rest, lambda rest: self.range.choose(*rest), failure="logs.no_rest_found")
        self.methods, self.source = MethodBar(), SourceBar(app.settings, self._latest_runs)
        self.exports = Exports(self)
        self._panels: dict[str, MethodPanel] = {}
        self._build()
        self._connect()
        on_language_change(self, self._refresh)

    @property
    def manual(self) -> str:
        """The section of the manual about an import, the selected method or the solution of a log."""
        if self._stack.currentWidget() is self.importer:
            return "how-to/resolve-a-log.md#from-another-program"
        method = self.methods.method
        return f"explanation/methods.md#{method}" if method else "how-to/resolve-a-log.md"

    @property
    def panel(self) -> MethodPanel | None:
        """The panel of the selected method, or None for the stages of the log."""
        return self._panels.get(self.methods.method)

    def open(self, path: Path) -> None:
        """Close the open log, if any, and open another one."""
        self.methods.select("")
        if self._working:
            self.notice.inform("caution", str, self._wait_text, self.plot.setFocus)
            return
        self.reader.cancel()
        self.notice.dismiss()
        self._close()
        self.source.show_path(path.absolute())
        self._opened += 1
        self._stack.setCurrentWidget(self._reading)
        self.reader.start(path.absolute(), self._index_folder)

    def look_at(self, path: Path) -> None:
        """Show how a recording of another program is interpreted before it is imported."""
        self.methods.select("")
        if self._working:
            self.notice.inform("caution", str, self._wait_text, self.plot.setFocus)
            return
        self.notice.dismiss()
        self.source.show_path(path.absolute())
        self._stack.setCurrentWidget(self.importer)
        self.importer.open(path)

    def _leave_importer(self) -> None:
        """Show the log that was open before."""
        self._stack.setCurrentWidget(self._open if self.log is not None else self._empty)
        self.source.show_path(None if self.log is None else self.log.path)

    def solve(self, *states: EffectName) -> None:
        """Solve the selected range and stages; `states` are added to the error model."""
        if self.log is None or self._why_not_solve():
            return
        self.notice.dismiss()
        self._started_with = self._selection
        stages = self.stages.selected if self.stages.selected != self.stages.available else None  # None: as in the run
        self.solver.start(self.log.path, stages, *self.range.range, self.log.spans, states)

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        """Accept a file that may be a log."""
        if _dropped(event.mimeData()) is not None:
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        """Open the dropped file."""
        path = _dropped(event.mimeData())
        if path is not None:
            event.acceptProposedAction()
            self._open_chosen(path)

    def _build(self) -> None:
        open_button = button("", "logs.open_log_button", self.source.browse, kind="primary")
        self.importer = ImportPanel(self.app)
        self._empty = EmptyState(open_button, title="logs.no_log", text="logs.about_no_log")
        progress = JobRow(self.reader, "read_cancel_button")
        progress.setFixedWidth(70 * theme.GRID)
        self._reading = EmptyState(progress, title="logs.reading_log")
        self._open = self._build_open()
        self._stack = stack(self._empty, self._reading, self._open, self.importer)
        self._body = stack(box(self.notice, (self._stack, 1)))
        margins = (2 * theme.GRID, theme.GRID, 2 * theme.GRID, 2 * theme.GRID)
        column(self.methods, self.source, (self._body, 1), on=self, margins=margins)

    def _build_open(self) -> QSplitter:
        self.plot, self.range = LogPlot(), RangeBar()
        self.setFocusProxy(self.plot)
        self.head = LogHead(self.plot, self.range)
        self._pointer = label(kind="muted", name="pointer_label")
        self._pointer.setFixedHeight(2 * theme.GRID + 4)
        self.stages, self.comparison = StageChoice(), Comparison()
        self.solve_button = button("solve_button", "logs.start_solve", lambda: self.solve(), kind="primary")
        jobs = JobStack(
            self.solve_button,
            JobRow(self.solver, "solve_cancel_button"),
            JobRow(self.exports.watch, "export_cancel_button"),
            JobRow(self.rest_finder, "rest_cancel_button"),
        )
        self.result_button = button("export_result_button", "logs.export_result", self._export_result)
        self.log_button = button("export_log_button", pressed=self._export_log)
        self.allan_button = button("allan_button", "logs.allan_deviation", self._show_allan)
        self.allan = AllanView(self)
        self._why_not = label(kind="muted", name="why_not_solve_label", wrap=True)
        left = box(self.head, (self.plot, 1), self._pointer, self.range, margins=(0, 0, theme.GRID, 0))
        self.missing = MissingEffect(self.solver, "offline_add_state_button")
        exports = row(self.result_button, self.log_button, None, self.allan_button)
        right = box(
            self.stages, jobs, self._why_not, (self.comparison, 1), self.missing, exports, margins=(theme.GRID, 0, 0, 0)
        )
        self._right = stack(right, self.allan)
        return split((left, 9), (self._right, 11))

    def _connect(self) -> None:
        self.source.path_selected.connect(self._open_chosen)
        self.source.recording_selected.connect(self.look_at)
        self.importer.closed.connect(self._leave_importer)
        self.importer.imported.connect(self.open)
        self.importer.busy_changed.connect(self._update)
        self.methods.method_selected.connect(self._show_method)
        self.plot.range_moved.connect(self.range.set_range)
        self.range.changed.connect(self.plot.set_range)
        for signal in (self.plot.range_moved, self.range.changed):
            signal.connect(self._choose_range)
        self.plot.samples_requested.connect(self._fetch_samples)
        self.plot.pointed.connect(self._show_pointed)
        self.stages.changed.connect(self._update)
        self.missing.requested.connect(self._add_state)
        self.range.checked.connect(self._update)
        self.range.rest_requested.connect(self._find_rest)
        self.allan.closed.connect(self._hide_allan)
        self.busy_changed.connect(self._update)
        self.exports.watch.busy_changed.connect(self.notice.dismiss)
        shortcut = QShortcut(QKeySequence.StandardKey.Open, self, self.source.browse)
        shortcut.setContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)

    # ---- logs and methods

    def _latest_runs(self) -> list[Path]:
        """Return the logs of the last runs, the latest first."""
        folder = self.app.runs_folder
        if not folder.is_dir():
            return []
        return [run.log.absolute() for run in History(folder).runs(limit=MAX_RECENT) if run.log.is_file()]

    def _open_chosen(self, path: Path) -> None:
        panel = self.panel
        if panel is None and (path.is_dir() or foreign_format(path) is not None):
            self.look_at(path)
        elif panel is None:
            self.open(path)
        elif panel.busy:
            panel.notice.inform("caution", str, self._wait_text, panel.setFocus)
        else:
            panel.open(path)

    def show_monitoring(self) -> None:
        """Show the live monitoring of the IMUs on one body."""
        self.methods.select(CROSS_CALIBRATION)
        self._panels[CROSS_CALIBRATION].views.show_live()

    def _show_method(self, method: str) -> None:
        """Show the stages of the log or the panel of a method, which is created on first use."""
        if not method:
            self._body.setCurrentIndex(0)
            if self.log is not None:
                self.source.show_path(self.log.path)
            self._update()
            return
        if method not in self._panels:
            self._panels[method] = panel = MethodPanel(self.app, method, self.source)
            panel.busy_changed.connect(self._update)
            self._body.addWidget(panel)
        panel = self._panels[method]
        if panel.path is None and self.log is not None:
            panel.select(self.log.path)
        self._body.setCurrentWidget(panel)
        panel.refresh()
        self._update()

    @property
    def _index_folder(self) -> Path:
        return self._indexes / str(self._opened)

    def _close(self, *_: object) -> None:
        self._stack.setCurrentWidget(self._empty)
        self.plot.close_log()
        self._hide_allan()
        self.log = self.solved = self._request = None
        shutil.rmtree(self._index_folder, ignore_errors=True)
        self._update()

    def _show_log(self, log: LogIndex) -> None:
        self.log, self.solved = log, None
        self.source.remember(log.path)
        self.head.show_log(log)
        set_subject(self, log.meta.imu.serial)
        self.range.show_log(log)
        self.stages.show_stages(log.spans)
        self.stages.set_range(*self.range.range)
        self.comparison.show_log(log)
        self.missing.show_result(log.stored)
        self._stack.setCurrentWidget(self._open)
        self.plot.show_log(log)
        self._update()
        self.plot.setFocus()

    def _show_solved(self, solved: Resolved) -> None:
        self.solved, self._solved_with = solved, self._started_with
        self.comparison.show_solved(solved)
        self.missing.show_result(solved.result)
        self._update()

    def _add_state(self, state: EffectName) -> None:
        """Solve the log again with one more state than in the current result."""
        self.solve(*(self.solved.result.states_added if self.solved is not None else ()), state)

    def _export_log(self) -> None:
        if self.log is not None:
            self.exports.ask_log(self.log, *self.range.range)

    def _export_result(self) -> None:
        if self.log is not None and self.solved is not None:
            self.exports.ask_result(self.log.path, self.solved.result, self.log.stored)

    def _find_rest(self) -> None:
        if self.log is not None:
            self.notice.dismiss()
            self.rest_finder.start(self.log.path)

    def _show_allan(self) -> None:
        if self.log is not None:
            self.notice.dismiss()
            self._right.setCurrentWidget(self.allan)
            self.allan.compute(self.log.path, *self.range.range)

    def _hide_allan(self, *_: object) -> None:
        self._right.setCurrentIndex(0)

    # ---- range, samples and pointer

    def _choose_range(self, first: int, last: int) -> None:
        self.stages.set_range(first, last)
        self._update()

    def _fetch_samples(self, request: SampleRequest) -> None:
        """Fetch the samples of a request; during another fetch, ignore the request, which the plot will repeat."""
        log = self.log
        if log is not None and not self._sampler.busy:
            self._request = request
            self._sampler.start(log.path, log.folder, log.scale, request.start, request.stop, request.count)

    def _show_samples(self, columns: Columns) -> None:
        if self._request is not None:
            self.plot.show_samples(self._request, columns)

    def _show_pointed(self, seq: int | None) -> None:
        """Show the time, stage and step of the sample under the mouse."""
        log, self._pointed = self.log, seq
        if seq is None or log is None:
            self._pointer.setText("")
            return
        time = time_text((seq - log.facts.first_seq) / log.rate, 1.0 / log.rate)
        stage = next((term("stage", s.stage) for s in log.spans if s.first_seq <= seq <= s.last_seq), "")
        step = int(log.step_numbers[log.steps.ranges[:, 0].searchsorted(seq, side="right")])
        label = log.step_labels.get(step)
        code = "logs.step_with_move" if label else "logs.step"
        move = say(code, number=step, move=step_sentence("move", label or ()))
        unused = (log.paused, "logs.paused"), (log.invalid, "logs.invalid")
        use = next((say(words) for ranges, words in unused if ranges.contains(seq)), "")
        parts = time, say("logs.sample", seq=seq), stage, move if step else "", use
        self._pointer.setText("   ".join(filter(None, parts)))

    # ---- texts and enabled controls

    @property
    def _working(self) -> bool:
        importing = self.importer.looker, self.importer.exports.watch
        jobs = self.solver, self.exports.watch, self.rest_finder, self.allan.watch, self.allan.saving, *importing
        return any(watch.busy for watch in jobs)

    def _wait_text(self) -> str:
        return say("logs.wait_for_job")

    @property
    def _selection(self) -> tuple[object, ...]:
        return *self.range.range, self.stages.selected

    def _why_not_export_result(self) -> str:
        if self.solved is None:
            return say("logs.solve_first")
        if self._selection != self._solved_with:
            return say("logs.solve_again")
        return ""

    def _why_not_solve(self) -> str:
        if self.log is None:
            return say("logs.open_log_first")
        if self._working:
            return say("window.busy_job")
        if self.range.problem:
            return self.range.problem
        if not self.log.spans:
            return say("logs.log_without_stages", method=MULTI_POSITION)
        if not self.stages.available:
            return say("logs.range_empty")
        return "" if self.stages.selected else say("logs.tick_stage")

    def _update(self) -> None:
        """Update the enabled controls; tooltips explain why the others are disabled."""
        busy = self._working if self.panel is None else self.panel.busy
        enable(self.source, say("window.busy_job") if busy else "")
        wait = say("window.busy_job") if self._working else ""
        for widget in (self.range, self.stages):
            enable(widget, wait)
        why_not_solve = self._why_not_solve()
        enable(self.solve_button, why_not_solve)
        show_text(self._why_not, "" if busy or self.range.problem else why_not_solve)  # the range shows its problem
        why_not = wait or (say("logs.open_log_first") if self.log is None else self.range.problem)
        enable(self.allan_button, why_not, say("logs.allan_tip"))
        part = self.log is not None and not self.range.is_whole_log
        self.log_button.setText(say("logs.export_range_button" if part else "logs.export_log_button"))
        enable(self.log_button, why_not, say("logs.export_range_tip") if part else "")
        enable(self.result_button, wait or self._why_not_export_result())
        self.comparison.set_outdated(self.solved is not None and self._selection != self._solved_with)

    def _refresh(self) -> None:
        self._show_pointed(self._pointed)
        self._update()


def _dropped(mime: QMimeData) -> Path | None:
    """Return the first dropped file that may be a log, if any."""
    for url in mime.urls():
        path = Path(url.toLocalFile())
        is_log = path.name.lower().endswith(LOG_SUFFIXES) or path.is_dir() or foreign_format(path) is not None
        if url.isLocalFile() and is_log:
            return path
    return None
