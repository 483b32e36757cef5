"""The tabs of a method: guidance on its use, and the views of its solution."""

from PySide6.QtWidgets import QPushButton, QStackedWidget, QWidget

from calstation.gui.logs.methods.answer_table import AnswerTable
from calstation.gui.logs.methods.applied_view import AppliedView
from calstation.gui.logs.methods.gimbal_view import GimbalView
from calstation.gui.logs.methods.guidance import guidance
from calstation.gui.logs.methods.kinds import CROSS_CALIBRATION, GIMBAL, MULTI_POSITION
from calstation.gui.logs.methods.pair_live import PairLiveView
from calstation.gui.logs.methods.pair_view import PairCheckView, PairResidualsView
from calstation.gui.logs.methods.positions_view import PositionsView
from calstation.gui.state import AppContext
from calstation.gui.text import duration_text, event_sentence, on_language_change
from calstation.gui.widgets import (
    ChecksTable,
    StateBadge,
    ViewTabs,
    Words,
    column,
    label,
    row,
    scroll_area,
    show_text,
    stack,
    theme,
)
from calstation.results.plots import GimbalPlotData, MethodAnswer, PairPlotData, PositionPlotData


class AnswerViews(QWidget):
    """Shows the guidance, the method's own views, and the views common to all methods: parameters and checks."""

    def __init__(self, app: AppContext, stage: str, export_button: QPushButton) -> None:
        super().__init__()
        self._answered = False
        self.positions = PositionsView() if stage == MULTI_POSITION else None
        self.applied = AppliedView(app) if stage == MULTI_POSITION else None
        self.gimbal = GimbalView() if stage == GIMBAL else None
        self.check = PairCheckView() if stage == CROSS_CALIBRATION else None
        self.residuals = PairResidualsView() if stage == CROSS_CALIBRATION else None
        self.live = PairLiveView(app) if stage == CROSS_CALIBRATION else None
        self.table, self.checks = AnswerTable(), ChecksTable()
        self.tabs, self._head = ViewTabs(f"{stage}_tabs"), _AnswerHead()
        self._stack: QStackedWidget = stack()
        self._titles: list[Words] = []
        self._add(lambda: self.tr("How it is done"), guidance(stage))
        self._add(lambda: self.tr("Rests and motions"), self.positions)
        self._add(lambda: self.tr("Before and after"), self.applied)
        self._add(lambda: self.tr("Convergence"), self.gimbal)
        self._add(lambda: self.tr("Check and monitoring"), self.check and scroll_area(self.check))
        self._add(lambda: self.tr("Residuals"), self.residuals)
        self._add(lambda: self.tr("Parameters"), self.table)
        self._add(lambda: self.tr("Checks"), self.checks)
        self._add(lambda: self.tr("Live"), self.live and scroll_area(self.live))
        self.tabs.currentChanged.connect(self._stack.setCurrentIndex)
        top = row(self.tabs, None, export_button, spacing=2 * theme.GRID)
        column(top, self._head, (self._stack, 1), on=self)
        on_language_change(self, self._refresh)

    def clear(self) -> None:
        """Show only the guidance."""
        self._answered = False
        self.tabs.setCurrentIndex(0)
        self._head.hide()
        self._refresh()

    def show_answer(self, answer: MethodAnswer) -> None:
        """Fill all views with a solution and show the first of them."""
        self._answered = True
        data = answer.picture
        if self.positions is not None and isinstance(data, PositionPlotData):
            self.positions.show_data(data)
        if self.applied is not None:
            self.applied.show_answer(answer)
        if self.gimbal is not None and isinstance(data, GimbalPlotData):
            self.gimbal.show_data(data)
        if self.check is not None and self.residuals is not None and isinstance(data, PairPlotData):
            self.check.show_data(data, answer.schedule)
            self.residuals.show_data(data, answer.parameters)
        self.table.show_answer(answer)
        self.checks.show_checks(answer.resolved.result.checks)
        self._head.show_answer(answer)
        self._refresh()
        self.tabs.setCurrentIndex(1)

    def _add(self, title: Words, view: QWidget | None) -> None:
        if view is not None:
            self._titles.append(title)
            self.tabs.addTab("")
            self._stack.addWidget(view)

    def _refresh(self) -> None:
        unsolved = "" if self._answered else self.tr("Solve a recording first")
        for index, title in enumerate(self._titles):
            self.tabs.setTabText(index, title())
            needs_answer = index > 0 and not (self.live is not None and index == len(self._titles) - 1)
            if needs_answer:
                self.tabs.setTabEnabled(index, self._answered)
                self.tabs.setTabToolTip(index, unsolved)


class _AnswerHead(QWidget):
    """Shows the verdict, recording and remarks of a solution; hidden until there is one."""

    def __init__(self) -> None:
        super().__init__()
        self._answer: MethodAnswer | None = None
        self._badge, self._about, self._remarks = StateBadge(), label(kind="muted"), label(kind="caution", wrap=True)
        column(row(self._badge, (self._about, 1), spacing=2 * theme.GRID), self._remarks, on=self)
        self.hide()
        on_language_change(self, self._refresh)

    def show_answer(self, answer: MethodAnswer) -> None:
        """Show a solution."""
        self._answer = answer
        self._refresh()
        self.show()

    def _refresh(self) -> None:
        answer = self._answer
        if answer is None:
            return
        show_text(self._remarks, "\n".join(event_sentence(key, values) for key, values in answer.resolved.messages))
        self._badge.show_state(*self._verdict(answer))
        result, recording = answer.resolved.result, answer.recording
        parts = [recording.serial, self.tr("{0} at {1:g} Hz").format(duration_text(recording.duration), recording.rate)]
        lost = len(result.undetermined)
        if lost:
            parts.append(self.tr("not determined: {0} of {1}").format(lost, len(result.parameters)))
        self._about.setText("  ·  ".join(parts))

    def _verdict(self, answer: MethodAnswer) -> tuple[str, str]:
        result = answer.resolved.result
        failed = len(result.failed_checks)
        near = sum(check.near_miss for check in result.checks)
        if failed:
            text = self.tr("{0} of {1} checks failed").format(failed, len(result.checks))
            return "bad" if result.passed is False else "caution", text
        if result.passed is None:
            return "good", self.tr("Solved; the recording names no limits")
        if near:
            return "caution", self.tr("Passed, {0} near-misses").format(near)
        return "good", self.tr("Inside every limit")
