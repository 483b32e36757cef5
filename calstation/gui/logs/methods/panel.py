"""One method: its recording, the work on it, its guidance and the views of its answer."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import (
    QComboBox,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSpinBox,
    QStackedWidget,
    QTabBar,
    QVBoxLayout,
    QWidget,
)

from calstation.config import MANUAL_STATION, manual_product, uses_manual_rig
from calstation.errors import CalstationError
from calstation.gui.logs import Exports, SourceBar
from calstation.gui.logs.methods.answer_views import AnswerHead, AnswerViews
from calstation.gui.logs.methods.applied_controller import AppliedController
from calstation.gui.logs.methods.guidance import Guidance
from calstation.gui.logs.methods.kinds import MULTI_POSITION, RECORDED_AS
from calstation.gui.shell import AppContext
from calstation.gui.text import error_text, on_language_change
from calstation.gui.widgets import Choice, JobRow, JobWatch, NoticeBar, theme
from calstation.results import PairCheckResult, check_pair, progress_from_note
from calstation.results.plots import MethodAnswer, solve_method
from calstation.simulation import record_on_bench, recordings_folder

#: The tab that is always there.
_GUIDANCE = 0


class MethodPanel(QWidget):
    """`live_wanted()`: the operator page is to guide by hand now."""

    live_wanted = Signal()

    def __init__(self, app: AppContext, stage: str, source: SourceBar) -> None:
        super().__init__()
        self.app, self.stage, self.source = app, stage, source
        self.path: Path | None = None
        self.answer: MethodAnswer | None = None
        self.maker, self.solver, self.checker = JobWatch(self), JobWatch(self), JobWatch(self)
        self.exports = Exports(app.job_queue, self)
        self.notice = NoticeBar()
        self.notice.setObjectName(f"{stage}_notice")
        self.answers = AnswerViews(stage)
        applied = self.answers.applied
        self.applying = None if applied is None else AppliedController(app, applied, self)
        self._build()
        self._connect()
        on_language_change(self, self.retranslate)
        self._allow()

    # What a user does

    def open(self, path: Path) -> None:
        """Take a recording and solve it; an earlier answer is discarded."""
        if not self.busy:
            self.take(path)
            self.solve()

    def take(self, path: Path) -> None:
        """Take a recording without solving it yet."""
        self.path = path.absolute()
        self.source.show_path(self.path)

    def refresh(self) -> None:
        """Show what is allowed now, in the shared bar of the log as well."""
        if self.path is not None:
            self.source.show_path(self.path)
        self._allow()

    def make(self, grade: str, seed: int) -> None:
        """Make a recording on the virtual bench, and solve it."""
        if self.busy:
            return
        self._forget()
        path = recordings_folder() / f"{self.stage}-{grade}-{seed}.h5"
        self.maker.watch(self.app.job_queue.submit(record_on_bench, RECORDED_AS[self.stage], path, grade, seed))
        self._allow()

    def solve(self) -> None:
        """Solve the recording at hand."""
        if self.busy or self.path is None:
            return
        self._forget()
        self.solver.watch(self.app.job_queue.submit(solve_method, self.path, self.stage))
        self._allow()

    def check(self) -> None:
        """Follow the recording as if live: check, calibrate what is off, keep it."""
        if self.busy or self.path is None:
            return
        self.notice.dismiss()
        self.checker.watch(self.app.job_queue.submit(check_pair, self.path))
        self._allow()

    def guide_live(self) -> None:
        """To the operator page, with the product that is calibrated by hand."""
        product = manual_product()
        if product is not None and uses_manual_rig(self.app.station_path):
            self.app.set_product(product)
            self.live_wanted.emit()

    @property
    def busy(self) -> bool:
        """Whether work on a recording is going on."""
        watches = (self.maker, self.solver, self.checker, self.exports.watch)
        return any(watch.busy for watch in watches)

    # What it is made of

    def _build(self) -> None:
        self.bench = BenchBox(self.stage)
        self.solve_button, self.live_button, self.export_button = QPushButton(), QPushButton(), QPushButton()
        self.solve_button.setObjectName(f"{self.stage}_solve_button")
        self.solve_button.setProperty("kind", "primary")
        self.live_button.setObjectName("guide_live_button")
        self.live_button.setVisible(self.stage == MULTI_POSITION)
        self.export_button.setObjectName(f"{self.stage}_export_button")
        idle = QWidget()
        row = QHBoxLayout(idle)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.GRID)
        row.addWidget(self.bench)
        row.addStretch(1)
        row.addWidget(self.live_button)
        row.addWidget(self.solve_button)
        self._work_label = QLabel()
        self._work_label.setMinimumWidth(22 * theme.GRID)
        self._rows = {watch: JobRow(watch) for watch in (self.maker, self.solver, self.checker, self.exports.watch)}
        self._rows_stack = QStackedWidget()
        for job_row in self._rows.values():
            self._rows_stack.addWidget(job_row)
        self._rows[self.solver].cancel_button.setObjectName(f"{self.stage}_cancel_button")
        self._rows[self.maker].cancel_button.setObjectName(f"{self.stage}_make_cancel_button")
        at_work = QWidget()
        work = QHBoxLayout(at_work)
        work.setContentsMargins(0, 0, 0, 0)
        work.setSpacing(2 * theme.GRID)
        work.addWidget(self._work_label)
        work.addWidget(self._rows_stack, 1)
        self._action = QStackedWidget()
        self._action.setFixedHeight(theme.BUTTON)
        self._action.addWidget(idle)
        self._action.addWidget(at_work)
        self.head = AnswerHead()
        self.tabs, self._stack = QTabBar(), QStackedWidget()
        self.tabs.setObjectName(f"{self.stage}_tabs")
        self.tabs.setProperty("kind", "views")
        self.tabs.setDrawBase(False)
        self.tabs.setExpanding(False)
        self.tabs.addTab("")
        self._stack.addWidget(Guidance(self.stage))
        for view in self.answers.views:
            self.tabs.addTab("")
            self._stack.addWidget(view.widget)
        top = QHBoxLayout()
        top.setSpacing(2 * theme.GRID)
        top.addWidget(self.tabs)
        top.addStretch(1)
        top.addWidget(self.export_button)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(theme.GRID)
        column.addWidget(self._action)
        column.addWidget(self.notice)
        column.addLayout(top)
        column.addWidget(self.head)
        column.addWidget(self._stack, 1)

    def _connect(self) -> None:
        self.bench.wanted.connect(self.make)
        self.solve_button.clicked.connect(self.solve)
        self.live_button.clicked.connect(self.guide_live)
        self.export_button.clicked.connect(self._export)
        self.tabs.currentChanged.connect(self._stack.setCurrentIndex)
        self.maker.done.connect(self._made)
        self.maker.failed.connect(lambda error: self._complain(lambda: self.tr("No recording was made"), error, None))
        self.solver.progress.connect(self._say_work)
        self.solver.done.connect(self._solved)
        self.solver.failed.connect(
            lambda error: self._complain(lambda: self.tr("This recording gives no answer"), error, self.path)
        )
        self.checker.failed.connect(
            lambda error: self._complain(lambda: self.tr("The pair cannot be checked"), error, self.path)
        )
        self.checker.done.connect(self._checked)
        self.exports.began.connect(self._allow)
        self.exports.watch.done.connect(self._exported)
        self.exports.watch.failed.connect(
            lambda error: self._complain(lambda: self.tr("The export failed"), error, self.exports.target)
        )
        for watch in self._rows:
            watch.cancelled.connect(self._allow)
        if self.applying is not None:
            self.applying.began.connect(self.notice.dismiss)
            self.applying.failed.connect(
                lambda say: self._tell("bad", lambda: self.tr("The answer cannot be applied"), say)
            )
        if self.answers.check is not None:
            self.answers.check.check_wanted.connect(self.check)
            self.checker.progress.connect(self._follow)
            self.checker.cancelled.connect(self._unfollow)
        self.app.station_changed.connect(self._allow)
        self.app.engine_link.running_changed.connect(lambda _: self._allow())

    # What comes of it

    def _forget(self) -> None:
        self.notice.dismiss()
        self.answer = None
        self.tabs.setCurrentIndex(_GUIDANCE)
        self.head.show_answer(self.answer)

    def _made(self, path: Path) -> None:
        self._allow()
        self.open(path)

    def _solved(self, answer: MethodAnswer) -> None:
        self.answer = answer
        self.source.remember(answer.recording.path)
        self.answers.show_answer(answer)
        self._allow()
        self.head.show_answer(self.answer)
        self.tabs.setCurrentIndex(_GUIDANCE + 1)
        if self.applying is not None:
            self.applying.take(answer)

    def _follow(self, *_: object) -> None:
        job = self.checker.job
        followed = None if job is None else progress_from_note(job.note)
        if followed is not None and self.answers.check is not None:
            self.answers.check.show_followed(followed)

    def _unfollow(self) -> None:
        if self.answers.check is not None:
            self.answers.check.show_followed(None)

    def _checked(self, checked: PairCheckResult) -> None:
        if self.answers.check is not None:
            self.answers.check.show_checked(checked)
        self._allow()

    def _export(self) -> None:
        if self.answer is not None:
            self.exports.ask_result(self.answer.recording.path, self.answer.resolved.result, None, self.stage)

    def _exported(self, target: Path) -> None:
        self._allow()
        self._tell("good", lambda: self.tr("Written"), lambda: str(target))

    # What is allowed, and why not

    def _allow(self) -> None:
        busy = self.busy
        self._action.setCurrentIndex(1 if busy else 0)
        current = next((row for watch, row in self._rows.items() if watch.busy), None)
        if current is not None:
            self._rows_stack.setCurrentWidget(current)
        wait = self.tr("Wait for the work at hand, or cancel it") if busy else ""
        if self.isVisible():
            self.source.setEnabled(not busy)
            self.source.setToolTip(wait)
        missing = "" if self.path is not None else self.tr("Open a recording first, or make one")
        self.solve_button.setEnabled(not missing and not busy)
        self.solve_button.setToolTip(missing)
        unsolved = "" if self.answer is not None else self.tr("Solve a recording first")
        self.export_button.setEnabled(not busy and not unsolved)
        self.export_button.setToolTip(wait or unsolved)
        for index in range(1, self.tabs.count()):
            self.tabs.setTabEnabled(index, self.answer is not None)
            self.tabs.setTabToolTip(index, unsolved)
        if self.answers.check is not None:
            self.answers.check.check_button.setEnabled(not busy)
        why_not = self._not_live()
        self.live_button.setEnabled(not why_not)
        self.live_button.setToolTip(why_not or self.tr("To the operator page, which guides from position to position"))
        self._say_work()

    def _not_live(self) -> str:
        """Why nobody can be guided now, empty where one can."""
        if self.app.engine_link.running:
            return self.tr("A calibration is going on; press STOP first.")
        if manual_product() is None or not uses_manual_rig(self.app.station_path):
            return self.tr(
                "This station's table is no hand rig. Choose a station with one on the Station page, for example "
                "'{0}', which is software."
            ).format(MANUAL_STATION)
        return ""

    # Saying it

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self.solve_button.setText(self.tr("Solve"))
        self.live_button.setText(self.tr("Guide me live"))
        self.export_button.setText(self.tr("Export result…"))
        self.tabs.setTabText(_GUIDANCE, self.tr("How it is done"))
        for index, view in enumerate(self.answers.views, start=1):
            self.tabs.setTabText(index, view.words())
        self._allow()
        self.head.show_answer(self.answer)

    def _say_work(self, *_: object) -> None:
        if self.maker.busy:
            self._work_label.setText(self.tr("Making a recording"))
        elif self.checker.busy:
            self._work_label.setText(self.tr("Following the recording"))
        elif self.solver.busy and self.solver.job is not None:
            words = {
                "reading": self.tr("Reading the recording"),
                "solving": self.tr("Solving"),
                "drawing": self.tr("Drawing"),
            }
            self._work_label.setText(words.get(self.solver.job.note, self.tr("Reading the recording")))
        elif self.exports.watch.busy:
            self._work_label.setText(self.tr("Writing the result"))

    def _complain(self, title: Callable[[], str], error: CalstationError, path: Path | None) -> None:
        self._allow()
        self._tell("bad", title, lambda: error_text(error).sentences)

    def _tell(self, kind: str, title: Callable[[], str], text: Callable[[], str]) -> None:
        close = Choice(f"{self.stage}_notice_close", lambda: self.tr("Close"), self.setFocus)
        self.notice.ask(kind, title, text, (close,))


GRADES = ("mems", "tactical", "nav")
_MOST = 9999


class BenchBox(QWidget):
    """`wanted(grade, seed)`: a recording is to be made."""

    wanted = Signal(str, int)

    def __init__(self, stage: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._caption, self._seed_caption = QLabel(), QLabel()
        self.grade_combo = QComboBox()
        self.grade_combo.setObjectName(f"bench_grade_{stage}")
        self.grade_combo.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToContents)
        for grade in GRADES:
            self.grade_combo.addItem("", grade)
        self.seed_spin = QSpinBox()
        self.seed_spin.setObjectName(f"bench_seed_{stage}")
        self.seed_spin.setRange(1, _MOST)
        self.make_button = QPushButton()
        self.make_button.setObjectName(f"bench_make_{stage}")
        self.make_button.clicked.connect(
            lambda: self.wanted.emit(self.grade_combo.currentData(), self.seed_spin.value())
        )
        self._caption.setBuddy(self.grade_combo)
        self._seed_caption.setBuddy(self.seed_spin)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.GRID)
        for widget in (self._caption, self.grade_combo, self._seed_caption, self.seed_spin, self.make_button):
            row.addWidget(widget)
        on_language_change(self, self.retranslate)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._caption.setText(self.tr("Virtual bench"))
        names = {
            "mems": self.tr("MEMS grade"),
            "tactical": self.tr("tactical grade"),
            "nav": self.tr("navigation grade"),
        }
        for index, grade in enumerate(GRADES):
            self.grade_combo.setItemText(index, names[grade])
        self._seed_caption.setText(self.tr("unit"))
        self.seed_spin.setToolTip(self.tr("Another number draws another unit and other motions"))
        self.make_button.setText(self.tr("Make one"))
        self.make_button.setToolTip(self.tr("Makes a recording without hardware, with its truth beside it"))
