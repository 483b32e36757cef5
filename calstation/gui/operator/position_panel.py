"""Guides who carries the unit by hand: the picture, one large word with its shape, what to do, which position it is."""

import numpy as np
from PySide6.QtCore import QEvent, Qt, Signal
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QSizePolicy, QVBoxLayout, QWidget

from calstation.config.summary import RunSummary
from calstation.gui.operator.position_picture import PositionPicture
from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import StateBadge
from calstation.sequencer.events import PositionGuided

#: Read from two metres, px; on a wide panel a third larger.
_WORD, _SENTENCE = theme.VERDICT // 2, theme.VERDICT // 3
_WIDE = 170 * theme.GRID
_KINDS = {"waiting": "waiting", "moving": "active", "still": "paused", "enough": "good", "repeat": "caution"}
#: A rail that is asked for by less than this from where it is need not be named, rad.
_TURNED = np.deg2rad(1.0)


class PositionPanel(QFrame):
    """Shows `PositionGuided` events; `finish_wanted()` : the operator has done enough positions."""

    finish_wanted = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("kind", "panel")
        self._guided: PositionGuided | None = None
        self._finishing = self._over = False
        self.picture = PositionPicture()
        self.badge = StateBadge(_WORD)
        self.task_label, self.place_label, self._note = QLabel(), QLabel(), QLabel()
        self._note.setProperty("kind", "muted")
        for label in (self.task_label, self._note):
            label.setWordWrap(True)
        self.finish_button = QPushButton()
        self.finish_button.setObjectName("finish_positions_button")
        self.finish_button.clicked.connect(self._finish)
        column = QWidget()
        column.setMinimumWidth(60 * theme.GRID)
        column.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        words = QVBoxLayout(column)
        words.setContentsMargins(0, 0, 0, 0)
        words.setSpacing(2 * theme.GRID)
        words.addStretch(1)
        words.addWidget(self.badge, 0, Qt.AlignmentFlag.AlignLeft)
        words.addWidget(self.task_label)
        words.addWidget(self.place_label)
        words.addStretch(1)
        words.addWidget(self._note)
        words.addWidget(self.finish_button, 0, Qt.AlignmentFlag.AlignLeft)
        row = QHBoxLayout(self)
        row.setContentsMargins(2 * theme.GRID, theme.GRID, 2 * theme.GRID, 2 * theme.GRID)
        row.setSpacing(3 * theme.GRID)
        row.addWidget(self.picture, 1)
        row.addWidget(column, 1)
        self._enlarge(1.0)
        self.retranslate()

    def plan(self, run_summary: RunSummary) -> None:
        """A run begins: its rig and its positions."""
        self._guided, self._finishing, self._over = None, False, False
        self.picture.set_plan(run_summary.outer_axis, run_summary.inner_axis, run_summary.positions)
        self.retranslate()

    def take(self, guided: PositionGuided) -> None:
        """Show where the position stands."""
        self._guided, self._over = guided, False
        self.picture.take(guided)
        self.retranslate()

    def rest(self) -> None:
        """The stage's last position is done."""
        self._over = True
        self.retranslate()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        now = self._guided
        self.finish_button.setText(self.tr("Enough positions: finish"))
        if self._over:
            self.badge.show_state("good", self.tr("All positions done"))
            self.task_label.setText(self.tr("Leave the unit alone while its errors are computed and judged."))
        elif now is None:
            self.badge.show_state("none", self.tr("Wait"))
            self.task_label.setText(self.tr("Leave the unit alone until the first position is asked for."))
        if self._over or now is None:
            self.place_label.setText("")
            self._note.setText("")
            self.finish_button.setVisible(False)
            return
        self.badge.show_state(_KINDS[now.state], self._state(now.state))
        self.task_label.setText(self._task(now))
        self.place_label.setText(self._place(now))
        self._say_finish(now)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Larger words where there is room."""
        self._enlarge(4.0 / 3.0 if event.size().width() >= _WIDE else 1.0)
        super().resizeEvent(event)

    def _enlarge(self, times: float) -> None:
        self.badge.set_size(round(times * _WORD))
        self.task_label.setFont(theme.font(round(times * _SENTENCE), bold=True))
        self.place_label.setFont(theme.font(round(times * _SENTENCE)))

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _state(self, state: str) -> str:
        return {
            "waiting": self.tr("Waiting"),
            "moving": self.tr("Moving"),
            "still": self.tr("Hold still"),
            "enough": self.tr("Enough: go on"),
            "repeat": self.tr("Too soon: once more"),
        }[state]

    def _task(self, now: PositionGuided) -> str:
        """What to do now."""
        if now.state == "still":
            return self.tr("Hands off. {seconds:.0f} s left.").format(
                seconds=max(np.ceil(now.wanted - now.rest), 0.0)
            )
        if now.state == "repeat":
            return self.tr(
                "It was moved before it had rested. Let go, and leave it for {seconds:.0f} s."
            ).format(seconds=now.wanted)
        outer, inner = f"{np.rad2deg(now.outer):.0f}°", f"{np.rad2deg(now.inner):.0f}°"
        turns = (
            abs(now.outer - now.outer_before) > _TURNED,
            abs(now.inner - now.inner_before) > _TURNED,
        )
        if turns == (True, True):
            words = self.tr(
                "Turn the outer rail to about {outer} and the inner rail to about {inner}, then let go."
            )
        elif turns == (True, False):
            words = self.tr("Turn the outer rail to about {outer}, then let go.")
        elif turns == (False, True):
            words = self.tr("Turn the inner rail to about {inner}, then let go.")
        else:
            words = self.tr(
                "Leave it with the outer rail at {outer} and the inner rail at {inner}, hands off."
            )
        return words.format(outer=outer, inner=inner).replace("-", "−")

    def _place(self, now: PositionGuided) -> str:
        words = self.tr("position {index} of {count}") if now.stage else self.tr("check {index} of {count}")
        return words.format(index=now.index, count=now.count)

    def _say_finish(self, now: PositionGuided) -> None:
        """Whether it may end here, and why not."""
        if not now.stage:
            self._note.setText(self.tr("The registers are written; these two rests prove them."))
        elif self._finishing:
            self._note.setText(self.tr("Finishing: the positions done are being solved."))
        elif now.suffices:
            self._note.setText(
                self.tr("The positions done lie all around and tell everything; more make it more exact.")
            )
        else:
            self._note.setText(
                self.tr("Rings on the globe are still to do; bring the large one to the mark on top.")
            )
        self.finish_button.setVisible(bool(now.stage))
        self.finish_button.setEnabled(now.suffices and not self._finishing)
        self.finish_button.setToolTip(
            "" if now.suffices else self.tr("Not yet: the positions done do not lie all around.")
        )

    def _finish(self) -> None:
        self._finishing = True
        self.finish_wanted.emit()
        self.retranslate()
