"""Panel of one method: its recording, jobs, guidance, and the views of the solution."""

from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QSpinBox, QWidget

from calstation.config import MANUAL_STATION, manual_product, uses_manual_rig
from calstation.gui.logs.methods.answer_views import AnswerViews
from calstation.gui.logs.methods.kinds import MULTI_POSITION, RECORDED_AS
from calstation.gui.logs.source_bar import Exports, SourceBar
from calstation.gui.state import AppContext, JobView
from calstation.gui.text import bind, on_language_change, say
from calstation.gui.widgets import JobRow, JobStack, box, button, column, combo_box, enable, label, row
from calstation.results import check_pair, progress_from_note
from calstation.results.plots import MethodAnswer, solve_method
from calstation.simulation import record_on_bench, recordings_folder


class MethodPanel(JobView):
    """Opens, makes, solves and exports a recording, and shows its solution."""

    def __init__(self, app: AppContext, stage: str, source: SourceBar) -> None:
        super().__init__(app, stage)
        self.stage, self.source = stage, source
        self.path: Path | None = None
        self.answer: MethodAnswer | None = None
        self.maker = self.job(record_on_bench, self.open, failure="logs.no_recording")
        self.solver = self.job(solve_method, self._solved, failure="logs.no_answer")
        show = self._show_progress
        self.checker = self.job(check_pair, failure="logs.pair_not_checked", failed=show, cancelled=show)
        self.bench, self.exports = BenchBox(stage), Exports(self)
        self.solve_button = button(f"{stage}_solve_button", "logs.solve", self.solve, kind="primary")
        self.live_button = button("guide_live_button", "logs.guide_live", self._guide_live)
        self.live_button.setVisible(stage == MULTI_POSITION)
        self.export_button = button(f"{stage}_export_button", "logs.export_result", self._export)
        self.answers = AnswerViews(self, stage, self.export_button)
        idle = box(row(self.bench, None, self.live_button, self.solve_button))
        jobs = JobStack(
            idle,
            JobRow(self.maker, f"{stage}_make_cancel_button", "logs.making_recording"),
            JobRow(self.solver, f"{stage}_cancel_button", self._solving_text),
            JobRow(self.checker, "", "logs.replaying"),
            JobRow(self.exports.watch, "", "logs.writing_result"),
        )
        column(jobs, self.notice, (self.answers, 1), on=self)
        self._connect()
        on_language_change(self, self._update)

    @property
    def busy(self) -> bool:
        """Whether a job on a recording is running."""
        return any(job.busy for job in (self.maker, self.solver, self.checker, self.exports.watch))

    def open(self, path: Path) -> None:
        """Select a recording and solve it; an earlier solution is discarded."""
        if not self.busy:
            self.take(path)
            self.solve()

    def take(self, path: Path) -> None:
        """Select a recording without solving it."""
        self.path = path.absolute()
        self.source.show_path(self.path)

    def refresh(self) -> None:
        """Update the path in the shared source bar and the enabled controls."""
        if self.path is not None:
            self.source.show_path(self.path)
        self._update()

    def make(self, grade: str, seed: int) -> None:
        """Make a recording on the virtual bench, and solve it."""
        if not self.busy:
            self._discard()
            path = recordings_folder() / f"{self.stage}-{grade}-{seed}.h5"
            self.maker.start(RECORDED_AS[self.stage], path, grade, seed)

    def solve(self) -> None:
        """Solve the recording."""
        if not self.busy and self.path is not None:
            self._discard()
            self.solver.start(self.path, self.stage)

    def _check(self) -> None:
        """Replay the recording: check the IMUs, calibrate if out of tolerance, and store the results."""
        if not self.busy and self.path is not None:
            self.notice.dismiss()
            self.checker.start(self.path)

    def _guide_live(self) -> None:
        """Open the operator page with the product for manual calibration."""
        product = manual_product()
        if product is not None and uses_manual_rig(self.app.station_path):
            self.app.set_product(product)
            self.app.page_requested.emit("operator_page")

    def _export(self) -> None:
        if self.answer is not None:
            self.exports.ask_result(self.answer.recording.path, self.answer.resolved.result, None, self.stage)

    def _connect(self) -> None:
        self.bench.requested.connect(self.make)
        self.busy_changed.connect(self._update)
        if self.answers.check is not None:
            self.answers.check.check_wanted.connect(self._check)
            self.checker.progress.connect(self._show_progress)
            self.checker.done.connect(self.answers.check.show_checked)
        self.app.station_changed.connect(self._update)
        self.app.engine_link.running_changed.connect(self._update)

    def _discard(self) -> None:
        self.notice.dismiss()
        self.answer = None
        self.answers.clear()

    def _solved(self, answer: MethodAnswer) -> None:
        self.answer = answer
        self.source.remember(answer.recording.path)
        self.answers.show_answer(answer)
        self._update()

    def _show_progress(self, *_: object) -> None:
        if self.answers.check is not None:
            job = self.checker.job
            self.answers.check.show_progress(None if job is None else progress_from_note(job.note))

    def _update(self) -> None:
        """Enable the controls that are currently usable; tooltips explain why the others are disabled."""
        wait = say("window.busy_job") if self.busy else ""
        enable(self.solve_button, "" if self.path is not None else say("logs.open_recording_first"))
        enable(self.export_button, wait or ("" if self.answer is not None else say("logs.solve_first_recording")))
        if self.answers.check is not None:
            self.answers.check.check_button.setEnabled(not self.busy)
        tip = say("logs.guide_tip")
        enable(self.live_button, self._why_not_live(), tip)

    def _why_not_live(self) -> str:
        if self.app.engine_link.running:
            return say("window.busy_run")
        if manual_product() is None or not uses_manual_rig(self.app.station_path):
            return say("window.no_manual_rig", station=MANUAL_STATION)
        return ""

    def _solving_text(self) -> str:
        note = self.solver.job.note if self.solver.job is not None else ""
        codes = {"solving": "logs.solving", "drawing": "logs.drawing"}
        return say(codes.get(note, "logs.reading_recording"))


class BenchBox(QWidget):
    """Selects the grade and seed of a simulated recording; emits `requested(grade, seed)` to request it."""

    requested = Signal(str, int)

    def __init__(self, stage: str) -> None:
        super().__init__()
        grades = {grade: f"logs.grade_{grade}" for grade in ("mems", "tactical", "nav")}
        self.grade_combo, self.seed_spin = combo_box(f"bench_grade_{stage}", grades, fit=True), QSpinBox()
        self.seed_spin.setObjectName(f"bench_seed_{stage}")
        self.seed_spin.setRange(1, 9999)
        bind(self.seed_spin.setToolTip, "logs.seed_tip")
        self.make_button = button(
            f"bench_make_{stage}",
            "logs.make_one",
            lambda: self.requested.emit(self.grade_combo.currentData(), self.seed_spin.value()),
            tip="logs.make_tip",
        )
        caption = label("common.virtual_bench", buddy=self.grade_combo)
        seed_caption = label("logs.bench_unit", buddy=self.seed_spin)
        row(caption, self.grade_combo, seed_caption, self.seed_spin, self.make_button, on=self)
