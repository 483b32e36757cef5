"""The panel of a method: its recording and jobs, its guidance, and the views of its solution."""

from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from calstation.config import MANUAL_STATION, manual_product, uses_manual_rig
from calstation.gui.logs.methods.guidance import CROSS_CALIBRATION, GIMBAL, MULTI_POSITION
from calstation.gui.logs.methods.solution_views import SolutionViews
from calstation.gui.logs.source_bar import Exports, SourceBar
from calstation.gui.state import AppContext, JobView
from calstation.gui.text import bind, on_language_change, say
from calstation.gui.widgets import (
    CountEdit,
    JobRow,
    JobStack,
    box,
    button,
    column,
    combo_box,
    enable,
    label,
    row,
    show_text,
    theme,
)
from calstation.results import check_pair, progress_from_note
from calstation.results.plots import MethodSolution, solve_method
from calstation.simulation import record_on_bench, recordings_folder

#: The kind of recording (`simulation.Kind`) that each method solves.
_RECORDING_KINDS = {MULTI_POSITION: "hand", GIMBAL: "gimbal", CROSS_CALIBRATION: "pair"}


class MethodPanel(JobView):
    """A panel that opens or simulates a recording, solves it, and shows and exports the solution."""

    def __init__(self, app: AppContext, stage: str, source: SourceBar) -> None:
        super().__init__(app, stage)
        self.stage, self.source = stage, source
        self.path: Path | None = None
        self.solution: MethodSolution | None = None
        self.simulator = self.job(record_on_bench, self.open, failure="logs.no_recording")
        self.solver = self.job(solve_method, self._solved, failure="logs.no_answer")
        show = self._show_progress
        self.checker = self.job(check_pair, failure="logs.pair_not_checked", failed=show, cancelled=show)
        self.bench, self.exports = BenchBox(stage), Exports(self)
        self.solve_button = button(f"{stage}_solve_button", "logs.solve", self.solve, kind="primary")
        self.live_button = button("guide_live_button", "logs.guide_live", self._guide_live)
        self.export_button = button(f"{stage}_export_button", "logs.export_result", self._export)
        self.views = SolutionViews(self, stage, self.export_button)
        idle = box(row(self.bench, None, self.live_button, self.solve_button))
        jobs = JobStack(
            idle,
            JobRow(self.simulator, f"{stage}_make_cancel_button", "logs.making_recording"),
            JobRow(self.solver, f"{stage}_cancel_button", self._solving_text),
            JobRow(self.checker, "", "logs.replaying"),
            JobRow(self.exports.watch, "", "logs.writing_result"),
        )
        column(jobs, self.notice, (self.views, 1), on=self)
        self.live_button.setVisible(stage == MULTI_POSITION)  # without a parent, it would be shown as a window
        self._connect()
        on_language_change(self, self._update)

    @property
    def busy(self) -> bool:
        """Whether a job on a recording is running."""
        return any(job.busy for job in (self.simulator, self.solver, self.checker, self.exports.watch))

    def open(self, path: Path) -> None:
        """Select a recording and solve it."""
        if not self.busy:
            self.select(path)
            self.solve()

    def select(self, path: Path) -> None:
        """Select a recording without solving it."""
        self.path = path.absolute()
        self.source.show_path(self.path)

    def refresh(self) -> None:
        """Show the path in the source bar, and update the enabled controls."""
        if self.path is not None:
            self.source.show_path(self.path)
        self._update()

    def simulate(self, grade: str, seed: int) -> None:
        """Simulate a recording on the virtual bench, and solve it."""
        if not self.busy:
            self._discard()
            path = recordings_folder() / f"{self.stage}-{grade}-{seed}.h5"
            self.simulator.start(_RECORDING_KINDS[self.stage], path, grade, seed)

    def solve(self) -> None:
        """Solve the recording."""
        if not self.busy and self.path is not None:
            self._discard()
            self.solver.start(self.path, self.stage)

    def _check(self) -> None:
        """Replay the recording: check the IMUs, calibrate those out of tolerance, and store the results."""
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
        if self.solution is not None:
            self.exports.ask_result(self.solution.recording.path, self.solution.resolved.result, None, self.stage)

    def _connect(self) -> None:
        self.bench.requested.connect(self.simulate)
        self.busy_changed.connect(self._update)
        if self.views.check is not None:
            self.views.check.check_requested.connect(self._check)
            self.checker.progress.connect(self._show_progress)
            self.checker.done.connect(self.views.check.show_checked)
        self.app.station_changed.connect(self._update)
        self.app.engine_link.running_changed.connect(self._update)

    def _discard(self) -> None:
        self.notice.dismiss()
        self.solution = None
        self.views.clear()

    def _solved(self, solution: MethodSolution) -> None:
        self.solution = solution
        self.source.remember(solution.recording.path)
        self.views.show_solution(solution)
        self._update()

    def _show_progress(self, *_: object) -> None:
        if self.views.check is not None:
            job = self.checker.job
            self.views.check.show_progress(None if job is None else progress_from_note(job.note))

    def _update(self) -> None:
        """Update the enabled controls; tooltips explain why the others are disabled."""
        wait = say("window.busy_job") if self.busy else ""
        enable(self.solve_button, "" if self.path is not None else say("logs.open_recording_first"))
        enable(self.export_button, wait or ("" if self.solution is not None else say("logs.solve_first_recording")))
        if self.views.check is not None:
            self.views.check.check_button.setEnabled(not self.busy)
        enable(self.live_button, self._why_not_live(), say("logs.guide_tip"))

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
    """Selects the grade and seed of a simulated recording; its button emits `requested(grade, seed)`."""

    requested = Signal(str, int)

    def __init__(self, stage: str) -> None:
        super().__init__()
        grades = {grade: f"logs.grade_{grade}" for grade in ("mems", "tactical", "nav")}
        self.grade_combo = combo_box(f"bench_grade_{stage}", grades, fit=True)
        self.seed_edit = CountEdit(f"bench_seed_{stage}", "logs.bench_unit", 1, 9999, 1)
        bind(self.seed_edit.setToolTip, "logs.seed_tip")
        self._problem = label(kind="error", wrap=True)
        self.seed_edit.typed.connect(lambda: show_text(self._problem, ""))
        self.make_button = button(
            f"bench_make_{stage}",
            "logs.make_one",
            self._make,
            tip="logs.make_tip",
        )
        caption = label("common.virtual_bench", buddy=self.grade_combo)
        seed_caption = label("logs.bench_unit", buddy=self.seed_edit)
        boxes = row(caption, self.grade_combo, seed_caption, self.seed_edit, self.make_button)
        column(boxes, self._problem, on=self, spacing=theme.GRID // 2)
        on_language_change(self, lambda: show_text(self._problem, ""))

    def _make(self) -> None:
        problem = self.seed_edit.check()
        show_text(self._problem, "" if problem is None else say(problem))
        if problem is None:
            self.requested.emit(self.grade_combo.currentData(), self.seed_edit.value())
