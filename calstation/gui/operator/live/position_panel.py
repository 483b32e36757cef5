"""Panel that guides the operator through the positions of a manual rig."""

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QFrame, QSizePolicy, QWidget

from calstation.gui.operator.live.position_picture import PositionPicture
from calstation.gui.text import KINDS, on_language_change, rendered, say, term, with_minus
from calstation.gui.widgets import StateBadge, button, column, enable, label, row, theme
from calstation.messages import Text
from calstation.runs import RunSummary
from calstation.sequencer import PositionGuided

#: Font sizes of the state and the task, px, legible from two metres; they are a third larger on a wide panel.
_STATE_SIZE, _TASK_SIZE = theme.VERDICT // 2, theme.VERDICT // 3
#: Minimum rotation of a rail for which an instruction is shown, rad.
_MIN_ROTATION = np.deg2rad(1.0)
_KINDS = {"waiting": "waiting", "moving": "active", "still": "paused", "enough": "good", "repeat": "caution"}


class PositionPanel(QFrame):
    """A panel that shows `PositionGuided` events, and emits `finish_requested` when the operator ends a stage early."""

    finish_requested = Signal()

    def __init__(self, prefix: str = "") -> None:
        super().__init__()
        self.setProperty("kind", "panel")
        self._guided: PositionGuided | None = None
        self._finishing = self._finished = False
        self._halted = ""  #: ``paused`` or ``stopping`` while the panel shows no instructions.
        self.picture = PositionPicture()
        self.badge = StateBadge(_STATE_SIZE)
        self.task_label, self.count_label = label(wrap=True), label()
        self._note = label(kind="muted", wrap=True)
        self.finish_button = button(f"{prefix}finish_positions_button", "operator.enough_positions", self._finish)
        texts = QWidget()
        texts.setMinimumWidth(60 * theme.GRID)
        texts.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        left = Qt.AlignmentFlag.AlignLeft
        column(
            *(None, (self.badge, 0, left), self.task_label, self.count_label),
            *(None, self._note, (self.finish_button, 0, left)),
            on=texts,
            spacing=2 * theme.GRID,
        )
        margins = (2 * theme.GRID, theme.GRID, 2 * theme.GRID, 2 * theme.GRID)
        row((self.picture, 1), (texts, 1), on=self, spacing=3 * theme.GRID, margins=margins)
        self._enlarge(1.0)
        on_language_change(self, self._refresh)

    def set_run(self, run_summary: RunSummary) -> None:
        """Show the rig and the positions of a run."""
        self._guided, self._finishing, self._finished, self._halted = None, False, False, ""
        self.picture.set_plan(run_summary)
        self._refresh()

    def show_position(self, guided: PositionGuided) -> None:
        """Show the progress of a position."""
        last_completed = guided.index == guided.count <= len(guided.done) // 3
        self._guided, self._finished = guided, last_completed
        self.picture.show_position(guided)
        self._refresh()

    def show_state(self, state: str) -> None:
        """Show the state of the run instead of instructions from its pause or stop until it is resumed or stored."""
        halted = {"paused": "paused", "stopping": "stopping", "stopped": "stopping"}.get(state, "")
        if halted != self._halted:
            self._halted = halted
            self._refresh()

    def finish_stage(self) -> None:
        """Show that the positions of the stage are complete."""
        self._finished = True
        self._refresh()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Enlarge the texts on a wide panel."""
        self._enlarge(4.0 / 3.0 if event.size().width() >= 170 * theme.GRID else 1.0)
        super().resizeEvent(event)

    def _enlarge(self, factor: float) -> None:
        self.badge.set_size(round(factor * _STATE_SIZE))
        self.task_label.setFont(theme.font(round(factor * _TASK_SIZE), bold=True))
        self.count_label.setFont(theme.font(round(factor * _TASK_SIZE)))

    def _refresh(self) -> None:
        now = self._guided
        if self._halted:
            self.badge.show_state(KINDS[self._halted], term("badge", self._halted))
            self.task_label.setText(say(f"operator.message_{self._halted}_manual"))
            for text in (self.count_label, self._note):
                text.clear()
            self.finish_button.setVisible(False)
            return
        if self._finished or now is None:
            texts = rendered(Text.of("position.finished" if self._finished else "position.before"))
            self.badge.show_state("good" if self._finished else "none", texts.text)
            self.task_label.setText(texts.remedy)
            self.count_label.clear()
            self._note.clear()
            self.finish_button.setVisible(False)
            return
        remaining = max(np.ceil(now.wanted - now.rest), 0.0)
        texts = rendered(Text.of(f"position.{now.state}", seconds=remaining, wanted=now.wanted))
        self.badge.show_state(_KINDS[now.state], texts.text)
        self.task_label.setText(texts.remedy or self._rotation_text(now))
        code = "position.count" if now.stage else "position.count_verification"
        self.count_label.setText(say(code, index=now.index, count=now.count))
        if not now.stage:
            note = "verification"
        elif self._finishing:
            note = "finishing"
        else:
            note = "sufficient" if now.suffices else "insufficient"
        self._note.setText(say(f"position.note_{note}"))
        self.finish_button.setVisible(bool(now.stage))
        enable(self.finish_button, "" if now.suffices else say("position.not_sufficient"))
        self.finish_button.setEnabled(now.suffices and not self._finishing)

    def _rotation_text(self, now: PositionGuided) -> str:
        """Return the instruction to rotate a rail to its angle; the outer rail is rotated before the inner one."""
        outer = abs(now.outer - now.outer_before) > _MIN_ROTATION
        inner = abs(now.inner - now.inner_before) > _MIN_ROTATION
        if outer and inner:
            before, after = (self.picture.up_at(angle, now.inner_before) for angle in (now.outer_before, now.outer))
            outer = bool(before @ now.up > after @ now.up)
        none = "none" if now.stage else "none_verification"
        rail = "outer" if outer else "inner" if inner else none
        angles = {name: f"{np.rad2deg(angle):.0f}°" for name, angle in (("outer", now.outer), ("inner", now.inner))}
        return with_minus(say(f"position.turn_{rail}", **angles))

    def _finish(self) -> None:
        self._finishing = True
        self.finish_requested.emit()
        self._refresh()
