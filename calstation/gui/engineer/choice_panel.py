"""The left of the engineer page: what is calibrated, and the schedule of the stage looked at."""

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import QEvent, Qt, Signal
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QScrollArea, QVBoxLayout, QWidget

from calstation.config.schedules import ScheduleOptions
from calstation.gui.engineer.parts import Parts
from calstation.gui.engineer.schedule_form import ScheduleForm
from calstation.gui.text.messages import term
from calstation.gui.widgets import theme


class ChoicePanel(QFrame):
    """`changed` when stages, order or a value do; `unlock_wanted` where the engineer's role is asked for."""

    changed = Signal()
    save_wanted = Signal()
    unlock_wanted = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("kind", "panel")
        self._offer: ScheduleOptions | None = None
        self._forms: dict[str, ScheduleForm] = {}
        self.parts = Parts()
        self._heading, self._lock_label = QLabel(), QLabel()
        self._heading.setProperty("kind", "section")
        self._lock_label.setProperty("kind", "muted")
        self._lock_label.setWordWrap(True)
        self.unlock_button, self.reset_button, self.save_button = QPushButton(), QPushButton(), QPushButton()
        self.unlock_button.setObjectName("unlock_schedule_button")
        self.reset_button.setObjectName("reset_schedule_button")
        self.save_button.setObjectName("save_product_button")
        self._new_pin = False
        self._reason = QLabel()
        self._reason.setObjectName("save_reason_label")
        self._reason.setProperty("kind", "muted")
        self._reason.setWordWrap(True)
        self._area = QScrollArea()
        self._area.setFrameShape(QFrame.Shape.NoFrame)
        self._area.setWidgetResizable(True)
        held = QWidget()
        self._held = QVBoxLayout(held)
        self._held.setContentsMargins(0, 0, theme.GRID // 2, 0)
        self._area.setWidget(held)
        self._area.viewport().setAutoFillBackground(False)
        held.setAutoFillBackground(False)
        self._area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self._lay_out()
        self.parts.changed.connect(self.changed)
        self.parts.looked_at.connect(self._look_at)
        self.unlock_button.clicked.connect(self.unlock_wanted)
        self.reset_button.clicked.connect(self._reset)
        self.save_button.clicked.connect(self.save_wanted)
        self.retranslate()

    def _lay_out(self) -> None:
        buttons = QHBoxLayout()
        buttons.setSpacing(theme.GRID)
        buttons.addWidget(self.reset_button)
        buttons.addWidget(self.save_button, 1)
        column = QVBoxLayout(self)
        column.setContentsMargins(2 * theme.GRID, theme.GRID, theme.GRID, theme.GRID)
        column.setSpacing(theme.GRID)
        column.addWidget(self.parts)
        column.addWidget(self._heading)
        column.addWidget(self._lock_label)
        column.addWidget(self._area, 1)
        column.addWidget(self.unlock_button)
        column.addLayout(buttons)
        column.addWidget(self._reason)

    @property
    def schedule(self) -> dict[str, Mapping[str, Any]]:
        """Departures from the product's schedule of the stages chosen, by stage; those without are left out."""
        return {
            stage: departures for stage in self.parts.stages if (departures := self._forms[stage].departures)
        }

    @property
    def unsound(self) -> tuple[str, ...]:
        """Stages chosen whose schedule cannot be run as typed."""
        return tuple(stage for stage in self.parts.stages if not self._forms[stage].sound)

    def form(self, stage: str) -> ScheduleForm:
        """A stage's form."""
        return self._forms[stage]

    def show_offer(self, offer: ScheduleOptions) -> None:
        """Offer a product's stages with their schedules."""
        self._offer = offer
        for form in self._forms.values():
            form.setParent(None)
            form.deleteLater()
        self._forms = {stage: ScheduleForm(stage, offer) for stage in offer.offered}
        for form in self._forms.values():
            form.changed.connect(self.changed)
            form.hide()
            self._held.addWidget(form)
        self.parts.offer(offer.offered, offer.stages)

    def lock(self, choice: str, schedule: str, save: str) -> None:
        """Why stages cannot be chosen, values not edited, the product not saved; "" where they can."""
        self.parts.lock(choice)
        for form in self._forms.values():
            form.lock(choice or schedule)
        self._lock_label.setText(schedule)
        self._lock_label.setVisible(bool(schedule))
        self.unlock_button.setVisible(bool(schedule))
        for button, why in (
            (self.reset_button, choice or schedule),
            (self.save_button, choice or schedule or save),
        ):
            button.setVisible(not schedule)
            button.setEnabled(not why)
            button.setToolTip(why)
        self._reason.setText("" if schedule else choice or save)
        self._reason.setVisible(bool(self._reason.text()))

    def ask_for_pin(self, new: bool) -> None:
        """What the button that unlocks asks for; `new` where no PIN has been set yet."""
        self._new_pin = new
        self._say_unlock()

    def _say_unlock(self) -> None:
        self.unlock_button.setText(
            self.tr("Set the engineer's PIN") if self._new_pin else self.tr("Enter the engineer's PIN")
        )

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._say_unlock()
        self.reset_button.setText(self.tr("Reset"))
        self.reset_button.setToolTip(self.tr("Back to the product's values of this stage"))
        self.save_button.setText(self.tr("Save to product"))
        self._head()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _look_at(self, stage: str) -> None:
        if stage not in self._forms:
            return
        for name, form in self._forms.items():
            form.setVisible(name == stage)
        self._area.verticalScrollBar().setValue(0)
        self._head()

    def _head(self) -> None:
        stage = self.parts.current
        self._heading.setText(self.tr("Schedule: {0}").format(term("stage", stage)) if stage else "")

    def _reset(self) -> None:
        self._forms[self.parts.current].reset()
