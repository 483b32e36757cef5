"""The views of a method's answer: which there are, under which names, and what fills them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from PySide6.QtCore import QCoreApplication, QEvent
from PySide6.QtWidgets import QHBoxLayout, QLabel, QVBoxLayout, QWidget

from calstation.gui.logs.methods.answer_table import AnswerTable
from calstation.gui.logs.methods.applied_view import AppliedView
from calstation.gui.logs.methods.figures import scrolled
from calstation.gui.logs.methods.gimbal_view import GimbalView
from calstation.gui.logs.methods.kinds import CROSS_CALIBRATION, GIMBAL, MULTI_POSITION
from calstation.gui.logs.methods.pair_view import PairCheckView, PairLeftView
from calstation.gui.logs.methods.positions_view import PositionsView
from calstation.gui.text import duration_text, event_sentence
from calstation.gui.widgets import ChecksTable, StateBadge, theme
from calstation.results.plots import GimbalPlotData, MethodAnswer, PositionPlotData


@dataclass(frozen=True)
class View:
    """One view: `words` says its name anew whenever asked."""

    words: Callable[[], str]
    widget: QWidget


class AnswerViews:
    """A method's own views, and those that every method has: parameters and checks."""

    def __init__(self, stage: str) -> None:
        self.positions = PositionsView() if stage == MULTI_POSITION else None
        self.applied = AppliedView() if stage == MULTI_POSITION else None
        self.gimbal = GimbalView() if stage == GIMBAL else None
        self.check = PairCheckView() if stage == CROSS_CALIBRATION else None
        self._checking = None if self.check is None else scrolled(self.check)
        self.left = PairLeftView() if stage == CROSS_CALIBRATION else None
        self.table, self.checks = AnswerTable(), ChecksTable()

    @property
    def views(self) -> Sequence[View]:
        """In the order of their tabs."""
        own = (
            (lambda: QCoreApplication.translate("method_views", "Rests and motions"), self.positions),
            (lambda: QCoreApplication.translate("method_views", "Before and after"), self.applied),
            (lambda: QCoreApplication.translate("method_views", "Convergence"), self.gimbal),
            (lambda: QCoreApplication.translate("method_views", "Check and watch"), self._checking),
            (lambda: QCoreApplication.translate("method_views", "What is left"), self.left),
            (lambda: QCoreApplication.translate("method_views", "Parameters"), self.table),
            (lambda: QCoreApplication.translate("method_views", "Checks"), self.checks),
        )
        return [View(words, widget) for words, widget in own if widget is not None]

    def show_answer(self, answer: MethodAnswer) -> None:
        """Fill all of them."""
        picture = answer.picture
        if self.positions is not None and isinstance(picture, PositionPlotData):
            self.positions.show_picture(picture)
        if self.gimbal is not None and isinstance(picture, GimbalPlotData):
            self.gimbal.show_picture(picture)
        if self.check is not None and self.left is not None:
            self.check.show_answer(answer)
            self.left.show_answer(answer)
        self.table.show_answer(answer)
        self.checks.show_checks(answer.resolved.result.checks)


class AnswerHead(QWidget):
    """Hidden while there is no answer."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._answer: MethodAnswer | None = None
        self.badge, self._about, self._remarks = StateBadge(theme.BODY), QLabel(), QLabel()
        self._about.setProperty("kind", "muted")
        self._remarks.setProperty("kind", "caution")
        self._remarks.setWordWrap(True)
        line = QHBoxLayout()
        line.setSpacing(2 * theme.GRID)
        line.addWidget(self.badge)
        line.addWidget(self._about, 1)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(theme.GRID)
        column.addLayout(line)
        column.addWidget(self._remarks)

    def show_answer(self, answer: MethodAnswer | None) -> None:
        """Show an answer, or none."""
        self._answer = answer
        self.setVisible(answer is not None)
        self.retranslate()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        answer = self._answer
        if answer is None:
            return
        remarks = "\n".join(event_sentence(key, values) for key, values in answer.resolved.messages)
        self._remarks.setText(remarks)
        self._remarks.setVisible(bool(remarks))
        self.badge.show_state(*self._verdict(answer))
        result, recording = answer.resolved.result, answer.recording
        about = [
            recording.serial,
            self.tr("{0} at {1:g} Hz").format(duration_text(recording.duration), recording.rate),
        ]
        lost = result.unobservable
        if lost:
            about.append(self.tr("not determined: {0} of {1}").format(len(lost), len(result.parameters)))
        self._about.setText("  ·  ".join(about))

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _verdict(self, answer: MethodAnswer) -> tuple[str, str]:
        """Shape and words of what the checks say."""
        result = answer.resolved.result
        failed = len(result.failed_checks)
        near = sum(check.near_miss for check in result.checks)
        if failed:
            said = self.tr("{0} of {1} checks failed").format(failed, len(result.checks))
            return "bad" if result.passed is False else "caution", said
        if result.passed is None:
            return "good", self.tr("Solved; the recording names no limits")
        if near:
            return "caution", self.tr("Passed, {0} near-misses").format(near)
        return "good", self.tr("Inside every limit")
