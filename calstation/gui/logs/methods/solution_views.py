"""The tabs of a method: its guidance and the views of its solution."""

from PySide6.QtWidgets import QPushButton, QStackedWidget, QWidget

from calstation.gui.logs.methods.applied_view import AppliedView
from calstation.gui.logs.methods.gimbal_view import GimbalView
from calstation.gui.logs.methods.guidance import CROSS_CALIBRATION, GIMBAL, MULTI_POSITION, guidance
from calstation.gui.logs.methods.pair_live import PairLiveView
from calstation.gui.logs.methods.pair_view import PairCheckView, PairResidualsView
from calstation.gui.logs.methods.positions_view import PositionsView
from calstation.gui.logs.methods.solution_table import SolutionTable
from calstation.gui.state import JobView
from calstation.gui.text import Words, checks_tip, duration_text, on_language_change, say
from calstation.gui.widgets import (
    ChecksTable,
    DataView,
    StateBadge,
    ViewTabs,
    column,
    label,
    plain_tip,
    row,
    scroll_area,
    show_text,
    stack,
    theme,
)
from calstation.messages import event_text
from calstation.results.plots import GimbalPlotData, MethodSolution, PairPlotData, PositionPlotData


class SolutionViews(QWidget):
    """The guidance of a method, its special views, and the views of parameters and checks."""

    def __init__(self, panel: JobView, stage: str, export_button: QPushButton) -> None:
        super().__init__()
        self._solved = False
        self.positions = PositionsView() if stage == MULTI_POSITION else None
        self.applied = AppliedView(panel) if stage == MULTI_POSITION else None
        self.gimbal = GimbalView() if stage == GIMBAL else None
        self.check = PairCheckView() if stage == CROSS_CALIBRATION else None
        self.residuals = PairResidualsView() if stage == CROSS_CALIBRATION else None
        self.live = PairLiveView(panel.app) if stage == CROSS_CALIBRATION else None
        self.table, self.checks = SolutionTable(), ChecksTable()
        self.tabs, self._head = ViewTabs(f"{stage}_tabs"), _SolutionHead()
        self._stack: QStackedWidget = stack()
        self._add("logs.how_done", guidance(stage))
        self._add("logs.rests_and_motions", self.positions)
        self._add("logs.before_and_after", self.applied)
        self._add("logs.convergence", self.gimbal)
        self._add("logs.check_and_monitoring", self.check and scroll_area(self.check))
        self._add("common.residuals", self.residuals)
        self._add("common.parameters", self.table)
        self._add("logs.checks", self.checks)
        self._add("common.live", self.live and scroll_area(self.live))
        self.tabs.currentChanged.connect(self._stack.setCurrentIndex)
        self.tabs.currentChanged.connect(self._show_head)
        top = row(self.tabs, None, export_button, spacing=2 * theme.GRID)
        column(top, self._head, (self._stack, 1), on=self)
        on_language_change(self, self._refresh)

    def clear(self) -> None:
        """Show only the guidance."""
        self._solved = False
        self.tabs.setCurrentIndex(0)
        self._show_head()
        self._refresh()

    def show_live(self) -> None:
        """Show the live monitoring, which is the last view, and focus its button."""
        if self.live is not None:
            self.tabs.setCurrentIndex(self.tabs.count() - 1)
            self.live.start_button.setFocus()

    def show_solution(self, solution: MethodSolution) -> None:
        """Fill all views with a solution and show the first of them."""
        self._solved = True
        data = solution.plot_data
        if self.positions is not None and isinstance(data, PositionPlotData):
            self.positions.show_data(data)
        if self.applied is not None:
            self.applied.show_solution(solution)
        if self.gimbal is not None and isinstance(data, GimbalPlotData):
            self.gimbal.show_data(data)
        if self.check is not None and self.residuals is not None and isinstance(data, PairPlotData):
            self.check.show_data(data, solution.schedule)
            self.residuals.show_data(data, solution.parameters)
        self.table.show_data(solution)
        self.checks.show_checks(solution.resolved.result.checks)
        self._head.show_data(solution)
        self._refresh()
        self.tabs.setCurrentIndex(1)
        self._show_head()

    def _show_head(self) -> None:
        """Show the verdict on the recording, but not above the live view, which shows other data."""
        live = self.live is not None and self.tabs.currentIndex() == self.tabs.count() - 1
        self._head.setVisible(self._solved and not live)

    def _add(self, title: Words, view: QWidget | None) -> None:
        if view is not None:
            self.tabs.add(title)
            self._stack.addWidget(view)

    def _refresh(self) -> None:
        unsolved = "" if self._solved else say("logs.solve_first_recording")
        for index in range(1, self.tabs.count() - (self.live is not None)):  # the guidance and the live view are kept
            self.tabs.setTabEnabled(index, self._solved)
            self.tabs.setTabToolTip(index, unsolved)


class _SolutionHead(QWidget, DataView[MethodSolution]):
    """The verdict on a solution, its recording and its remarks; hidden if there is no solution."""

    def __init__(self) -> None:
        super().__init__()
        self._badge, self._about, self._remarks = StateBadge(), label(kind="muted"), label(kind="caution", wrap=True)
        column(row(self._badge, (self._about, 1), spacing=2 * theme.GRID), self._remarks, on=self)
        self.hide()
        on_language_change(self, self.refresh)

    def draw(self, solution: MethodSolution) -> None:
        """Show a solution."""
        show_text(self._remarks, "\n".join(say(event_text(key, values)) for key, values in solution.resolved.messages))
        self._badge.show_state(*self._verdict(solution))
        notable = [c for c in solution.resolved.result.checks if c.near_miss or not c.passed]
        self._badge.setToolTip(plain_tip(checks_tip(notable)))
        result, recording = solution.resolved.result, solution.recording
        duration = duration_text(recording.duration)
        parts = [recording.serial, say("logs.recording_length", duration=duration, rate=recording.sample_rate)]
        if undetermined := len(result.undetermined):
            parts.append(say("logs.lost_count", lost=undetermined, count=len(result.parameters)))
        self._about.setText("  ·  ".join(parts))

    def _verdict(self, solution: MethodSolution) -> tuple[str, str]:
        result = solution.resolved.result
        failed = len(result.failed_checks)
        near = sum(check.near_miss for check in result.checks)
        if failed:
            text = say("logs.checks_failed", failed=failed, count=len(result.checks))
            return "bad" if result.passed is False else "caution", text
        if result.passed is None:
            return "good", say("logs.recording_no_limits")
        if near:
            return "caution", say("logs.passed_near", count=near)
        return "good", say("logs.recording_inside")
