"""The Offline page: one log, drawn and solved again by its stages or by a method that needs no rate table."""

import shutil
import tempfile
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QMimeData, Qt, Signal
from PySide6.QtGui import QDragEnterEvent, QDropEvent, QKeySequence, QShortcut
from PySide6.QtWidgets import (
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSplitter,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from calstation.errors import CalstationError
from calstation.gui.logs.comparison import Comparison
from calstation.gui.logs.exports import Exports
from calstation.gui.logs.log_columns import Wanted
from calstation.gui.logs.log_head import LogHead
from calstation.gui.logs.log_plot import LogPlot
from calstation.gui.logs.methods import MethodBar
from calstation.gui.logs.range_bar import RangeBar
from calstation.gui.logs.source_bar import SourceBar
from calstation.gui.logs.stage_choice import StageChoice
from calstation.gui.logs.time_axis import time_text
from calstation.gui.shell import AppContext, Page
from calstation.gui.text import error_text, on_language_change, term
from calstation.gui.widgets import Choice, EmptyState, JobRow, JobWatch, NoticeBar, theme
from calstation.results import History, Resolved, offline_solve
from calstation.results.plots import Columns, LogIndex, log_index, samples

if TYPE_CHECKING:
    from calstation.gui.logs.methods import MethodPanel

_LOGS = (".h5", ".csv", ".csv.gz")
_LATEST = 8
_PLOT_SHARE, _RESULT_SHARE = 1, 1


class OfflinePage(Page):
    """A log, its range, and the solution; `live_wanted()`: the operator page shall guide a manual run."""

    live_wanted = Signal()

    def __init__(self, app: AppContext) -> None:
        super().__init__(app)
        self.setObjectName("offline_page")
        self.setAcceptDrops(True)
        self.log: LogIndex | None = None
        self.solved: Resolved | None = None
        self._pictures: Path | None = None
        self._picture: Path | None = None
        self._opened = 0
        self.reader, self.solver, self._closer = JobWatch(self), JobWatch(self), JobWatch(self)
        self.exports = Exports(app.job_queue, self)
        self._wanted: Wanted | None = None
        self.methods = MethodBar()
        self.source = SourceBar(app.settings, latest=self._latest_runs)
        self.notice = NoticeBar()
        self.notice.setObjectName("offline_notice")
        self._stack = QStackedWidget()
        self._stack.addWidget(self._make_empty())
        self._stack.addWidget(self._make_reading())
        self._stack.addWidget(self._make_open())
        box = QVBoxLayout(self)
        box.setContentsMargins(2 * theme.GRID, theme.GRID, 2 * theme.GRID, 2 * theme.GRID)
        box.setSpacing(theme.GRID)
        stages = QWidget()
        column = QVBoxLayout(stages)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(theme.GRID)
        column.addWidget(self.notice)
        column.addWidget(self._stack, 1)
        self._panels: dict[str, MethodPanel] = {}
        self._body = QStackedWidget()
        self._body.addWidget(stages)
        box.addWidget(self.methods)
        box.addWidget(self.source)
        box.addWidget(self._body, 1)
        self._connect()
        on_language_change(self, self.retranslate)
        self._allow()

    def title(self) -> str:
        """The page's name on its tab."""
        return self.tr("Offline")

    # What a user does

    @property
    def panel(self) -> "MethodPanel | None":
        """The panel of the chosen method; None while the log is solved by its stages."""
        return self._panels.get(self.methods.chosen_method)

    def choose(self, method: str) -> None:
        """Solve by a method; "" for the stages of the log."""
        self.methods.choose(method)

    def open(self, path: Path) -> None:
        """Read a log and draw it; one that was open is closed."""
        self.choose("")
        if self.solver.busy or self.exports.watch.busy:
            self._tell(
                "caution",
                str,
                lambda: self.tr("Another log can be opened when this work is done or cancelled."),
            )
            return
        if self.reader.busy:
            self.reader.cancel()
        self.notice.dismiss()
        self._close()
        path = path.absolute()
        self.source.show_path(path)
        self._opened += 1
        self._stack.setCurrentWidget(self._reading)
        self._picture = self._folder() / str(self._opened)
        job = self.app.job_queue.submit(log_index, path, self._picture)
        self.reader.watch(job)
        self._allow()

    def solve(self) -> None:
        """Solve the chosen range and stages."""
        if self.log is None or self._blocked():
            return
        self.notice.dismiss()
        stages: tuple[str, ...] | None = self.stages.stages
        if stages == self.stages.held:
            stages = None  # as recorded, which is what the run did
        first, last = self.range.range
        spans = self.log.spans
        self.solver.watch(self.app.job_queue.submit(offline_solve, self.log.path, stages, first, last, spans))
        self._allow()

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        """Take a file that may be a log."""
        if _dropped(event.mimeData()) is not None:
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        """Open it."""
        path = _dropped(event.mimeData())
        if path is not None:
            event.acceptProposedAction()
            self._open_chosen(path)

    # What it is made of

    def _latest_runs(self) -> list[Path]:
        """Logs of the last runs, the latest first."""
        folder = self.app.runs_folder
        if not folder.is_dir():
            return []
        return [run.log.absolute() for run in History(folder).runs(limit=_LATEST) if run.log.is_file()]

    def _make_empty(self) -> QWidget:
        self._empty = EmptyState()
        self._empty_button = QPushButton()
        self._empty_button.setProperty("kind", "primary")
        self._empty_button.clicked.connect(self.source.look)
        self._empty.add(self._empty_button)
        return self._empty

    def _make_reading(self) -> QWidget:
        self._reading = EmptyState()
        row = JobRow(self.reader)
        row.cancel_button.setObjectName("read_cancel_button")
        row.setFixedWidth(70 * theme.GRID)
        self._reading.add(row)
        return self._reading

    def _make_open(self) -> QWidget:
        self.head, self.plot, self.range = LogHead(), LogPlot(), RangeBar()
        self._pointer = QLabel()
        self._pointer.setProperty("kind", "muted")
        self._pointer.setFixedHeight(2 * theme.GRID + 4)
        left = QWidget()
        column = QVBoxLayout(left)
        column.setContentsMargins(0, 0, theme.GRID, 0)
        column.setSpacing(theme.GRID)
        column.addWidget(self.head)
        column.addWidget(self.plot, 1)
        column.addWidget(self._pointer)
        column.addWidget(self.range)
        self._open = QSplitter(Qt.Orientation.Horizontal)
        self._open.setChildrenCollapsible(False)
        self._open.setHandleWidth(theme.GRID)
        self._open.addWidget(left)
        self._open.addWidget(self._make_result())
        self._open.setStretchFactor(0, _PLOT_SHARE)
        self._open.setStretchFactor(1, _RESULT_SHARE)
        self._open.setSizes([_PLOT_SHARE * 1000, _RESULT_SHARE * 1000])
        return self._open

    def _make_result(self) -> QWidget:
        self.stages, self.comparison = StageChoice(), Comparison()
        self.solve_button = QPushButton()
        self.solve_button.setObjectName("solve_button")
        self.solve_button.setProperty("kind", "primary")
        self._solving, self._exporting = JobRow(self.solver), JobRow(self.exports.watch)
        self._solving.cancel_button.setObjectName("solve_cancel_button")
        self._exporting.cancel_button.setObjectName("export_cancel_button")
        self._action = QStackedWidget()
        self._action.setFixedHeight(theme.BUTTON)
        for widget in (self.solve_button, self._solving, self._exporting):
            self._action.addWidget(widget)
        self.result_button, self.log_button = QPushButton(), QPushButton()
        self.result_button.setObjectName("export_result_button")
        self.log_button.setObjectName("export_log_button")
        exports = QHBoxLayout()
        exports.setSpacing(theme.GRID)
        exports.addWidget(self.result_button)
        exports.addWidget(self.log_button)
        exports.addStretch(1)
        right = QWidget()
        column = QVBoxLayout(right)
        column.setContentsMargins(theme.GRID, 0, 0, 0)
        column.setSpacing(theme.GRID)
        column.addWidget(self.stages)
        column.addWidget(self._action)
        column.addWidget(self.comparison, 1)
        column.addLayout(exports)
        return right

    def _connect(self) -> None:
        self.app.open_log.connect(self.open)
        self.source.chosen.connect(self._open_chosen)
        self.methods.chosen.connect(self._show_method)
        self.solve_button.clicked.connect(self.solve)
        self.result_button.clicked.connect(self._export_result)
        self.log_button.clicked.connect(self._export_log)
        self.plot.range_moved.connect(self._dragged)
        self.plot.samples_wanted.connect(self._close_up)
        self.plot.pointed.connect(self._point)
        self.range.changed.connect(self._entered)
        self.stages.changed.connect(self._allow)
        self.head.zoomed.connect(self.plot.zoom)
        self.head.whole.connect(self.plot.whole)
        self.head.to_range.connect(lambda: self.plot.show_part(*self.range.range))
        self.reader.done.connect(self._read)
        self.reader.failed.connect(self._unreadable)
        self.reader.cancelled.connect(self._unread)
        self.solver.done.connect(self._found)
        self.solver.failed.connect(self._unsolved)
        self.solver.cancelled.connect(self._allow)
        self.exports.began.connect(self._exporting_began)
        self.exports.watch.done.connect(self._exported)
        self.exports.watch.failed.connect(self._not_exported)
        self.exports.watch.cancelled.connect(self._allow)
        self._closer.done.connect(self._closed_up)
        opener = QShortcut(QKeySequence.StandardKey.Open, self, self.source.look)
        opener.setContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)

    def _open_chosen(self, path: Path) -> None:
        if self.panel is None:
            self.open(path)
        else:
            self.panel.open(path)

    def _show_method(self, method: str) -> None:
        """Show the stages or a method's panel, which is made the first time; the log stays the same."""
        from calstation.gui.logs.methods import MethodPanel

        if not method:
            self._body.setCurrentIndex(0)
            self._allow()
            return
        if method not in self._panels:
            panel = self._panels[method] = MethodPanel(self.app, method, self.source)
            panel.live_wanted.connect(self.live_wanted)
            self._body.addWidget(panel)
        panel = self._panels[method]
        if panel.path is None and self.log is not None:
            panel.take(self.log.path)
        self._body.setCurrentWidget(panel)
        panel.refresh()

    # What comes of it

    def _read(self, log: LogIndex) -> None:
        self.log = log
        self.solved = None
        self.source.remember(log.path)
        self.head.show_log(log)
        self.range.show_log(log)
        self.stages.show_log(log)
        self.comparison.show_log(log)
        self._stack.setCurrentWidget(self._open)
        self.plot.show_log(log)
        self._allow()
        self.plot.setFocus()

    def _unreadable(self, error: CalstationError) -> None:
        self._unread()
        path = Path(self.source.log_edit.text())
        self._complain(lambda: self.tr("This log cannot be opened"), error, path)

    def _unread(self) -> None:
        self._close()
        self._allow()

    def _found(self, solved: Resolved) -> None:
        self.solved = solved
        self.comparison.show_solved(solved)
        self._allow()

    def _unsolved(self, error: CalstationError) -> None:
        self._allow()
        self._complain(lambda: self.tr("This range cannot be solved"), error, self.log.path if self.log else None)

    def _export_log(self) -> None:
        assert self.log is not None
        self.exports.ask_log(self.log, *self.range.range)

    def _export_result(self) -> None:
        assert self.log is not None
        assert self.solved is not None
        self.exports.ask_result(self.log.path, self.solved.result, self.log.stored)

    def _exporting_began(self) -> None:
        self.notice.dismiss()
        self._allow()

    def _exported(self, target: Path) -> None:
        self._allow()
        self._tell("good", lambda: self.tr("Written"), lambda: str(target))

    def _not_exported(self, error: CalstationError) -> None:
        self._allow()
        self._complain(lambda: self.tr("The export failed"), error, self.exports.target)

    def _dragged(self, first: int, last: int) -> None:
        self.range.set_range(first, last)
        self.stages.set_range(first, last)
        self._allow()

    def _entered(self, first: int, last: int) -> None:
        self.plot.set_range(first, last)
        self.stages.set_range(first, last)
        self._allow()

    def _close_up(self, wanted: Wanted) -> None:
        """Fetch single samples; while some are on their way, the plot asks again when they are there."""
        if self.log is None or self._closer.busy:
            return
        log, self._wanted = self.log, wanted
        job = self.app.job_queue.submit(
            samples, log.path, log.folder, log.scale, wanted.start, wanted.stop, wanted.count
        )
        self._closer.watch(job)

    def _closed_up(self, columns: Columns) -> None:
        if self._wanted is not None:
            self.plot.show_samples(self._wanted, columns)

    def _point(self, seq: int | None) -> None:
        log = self.log
        if seq is None or log is None:
            self._pointer.setText("")
            return
        time = time_text((seq - log.facts.first_seq) / log.rate, 1.0 / log.rate)
        stage = next((term("stage", s.stage) for s in log.spans if s.first_seq <= seq <= s.last_seq), "")
        self._pointer.setText(self.tr("Sample {0}").format(seq) + f"   {time}   {stage}")

    # What is allowed, and why not

    def _blocked(self) -> str:
        """Why nothing can be solved now, empty where it can."""
        if self.log is None:
            return self.tr("Open a log first")
        if self.solver.busy or self.exports.watch.busy:
            return self.tr("Wait for the work at hand, or cancel it")
        if not self.stages.held:
            return self.tr("The range holds no stage; widen it")
        if not self.stages.stages:
            return self.tr("Tick a stage to solve")
        return ""

    def _allow(self) -> None:
        blocked = self._blocked()
        self.solve_button.setEnabled(not blocked)
        self.solve_button.setToolTip(blocked)
        busy = self.solver.busy or self.exports.watch.busy
        wait = self.tr("Wait for the work at hand, or cancel it")
        for widget in (self.source, self.range, self.stages):
            widget.setEnabled(not busy)
            widget.setToolTip(wait if busy else "")
        part = self.log is not None and not self.range.whole
        self.log_button.setText(self.tr("Export range…") if part else self.tr("Export log…"))
        self.log_button.setEnabled(self.log is not None and not busy)
        self.result_button.setEnabled(self.solved is not None and not busy)
        what = self.tr("Only the samples chosen; “Set to…” goes back to the whole log") if part else ""
        self.log_button.setToolTip(wait if busy else what)
        self.result_button.setToolTip(
            wait if busy else "" if self.solved is not None else self.tr("Solve the log first")
        )
        current = self._solving if self.solver.busy else self._exporting
        self._action.setCurrentWidget(current if busy else self.solve_button)

    # Saying it

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._empty.say(
            self.tr("A stored log, drawn and solved again"),
            self.tr(
                "Open a raw log (.h5) or a CSV with its TOML beside it, or drop the file here. Choose a range; "
                "the solver of the run solves it again, and both results are compared."
            ),
        )
        self._empty_button.setText(self.tr("Open a log…"))
        self._reading.say(self.tr("Reading the log"), "")
        self.solve_button.setText(self.tr("Start offline solve"))
        self.result_button.setText(self.tr("Export result…"))
        self._allow()

    def _complain(self, title: Callable[[], str], error: CalstationError, path: Path | None) -> None:
        self._tell("bad", title, lambda: error_text(error).sentences)

    def _tell(self, kind: str, title: Callable[[], str], text: Callable[[], str]) -> None:
        close = Choice("offline_notice_close", lambda: self.tr("Close"), self.plot.setFocus)
        self.notice.ask(kind, title, text, (close,))

    # Pictures

    def _folder(self) -> Path:
        """Where pictures of logs lie while the window is open."""
        if self._pictures is None:
            self._pictures = Path(tempfile.mkdtemp(prefix="calstation-"))
            weakref.finalize(self, shutil.rmtree, self._pictures, ignore_errors=True)
        return self._pictures

    def _close(self) -> None:
        self._stack.setCurrentWidget(self._empty)
        self.plot.close_log()
        self.log = self.solved = self._wanted = None
        if self._picture is not None:
            shutil.rmtree(self._picture, ignore_errors=True)
            self._picture = None


def _dropped(mime: QMimeData) -> Path | None:
    """The first dropped file that may be a log."""
    for url in mime.urls():
        if url.isLocalFile() and url.toLocalFile().lower().endswith(_LOGS):
            return Path(url.toLocalFile())
    return None
