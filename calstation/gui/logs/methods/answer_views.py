"""The views of a method's answer: which there are, under which names, and what fills them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from PySide6.QtCore import QCoreApplication
from PySide6.QtWidgets import QWidget

from calstation.gui.logs.methods.answer_table import AnswerTable
from calstation.gui.logs.methods.applied_view import AppliedView
from calstation.gui.logs.methods.gimbal_view import GimbalView
from calstation.gui.logs.methods.kinds import CROSS_CALIBRATION, GIMBAL, MULTI_POSITION
from calstation.gui.logs.methods.pair_view import PairCheckView, PairLeftView
from calstation.gui.logs.methods.positions_view import PositionsView
from calstation.gui.logs.methods.scrolled import scrolled
from calstation.gui.widgets import ChecksTable
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
