"""The left panel of the engineer page, which selects the stages of the next run and edits their schedules."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from PySide6.QtCore import QEvent, QObject, Qt, Signal
from PySide6.QtWidgets import QCheckBox, QFrame, QToolButton, QVBoxLayout, QWidget

from calstation.config import ScheduleOptions
from calstation.gui.engineer.schedule_form import ScheduleForm
from calstation.gui.text import about, bind, on_language_change, product_text, say, term
from calstation.gui.widgets import (
    FormField,
    PlainLabel,
    box,
    button,
    clear,
    column,
    enable,
    label,
    row,
    scroll_area,
    show_text,
    theme,
)
from calstation.messages import Text
from calstation.physics import NAMES, group_of

#: Stages of each part of the calibration, by the suffix of the object name of its check box.
PARTS = {"scale_factors": ("rate", "six_position"), "installation": ("excitation",), "biases": ("azimuth_flip",)}
_ROW_HEIGHT = theme.BUTTON - theme.GRID


class ChoicePanel(QFrame):
    """Check boxes for the stages, and the form of the selected stage.

    Signals: `changed()` when stages, their order or values change; `save_requested()` and `unlock_requested()` when the
    buttons are pressed.
    """

    changed = Signal()
    save_requested = Signal()
    unlock_requested = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.setProperty("kind", "panel")
        self._forms: dict[str, ScheduleForm] = {}
        self._name = ""
        #: Options of the last usable product, kept while a problem is shown.
        self._options: ScheduleOptions | None = None
        self._new_pin = False
        self._warning: Text | None = None  #: Warning about limits that no stage of the product judges.
        self.selector = StageSelector()
        self._product = label(kind="muted", name="choice_product_label", wrap=True)
        self._problem = label(kind="error", name="choice_problem_label", wrap=True)
        self._solved = label(kind="muted", name="solved_parameters_label", wrap=True)
        self._heading, self._lock_label = label(kind="section"), label(kind="muted", wrap=True)
        self._unlock_button = button("unlock_schedule_button", pressed=self.unlock_requested)
        self._reset_button = button("reset_schedule_button", "engineer.reset", lambda: self.form.reset())
        self._save_button = button("save_product_button", "engineer.save_to_product", self.save_requested)
        self._reason = label(kind="muted", name="save_reason_label", wrap=True)
        self._form_box = column(spacing=0)
        content = box(self._solved, self._heading, self._form_box, margins=(0, 0, theme.GRID // 2, 0))
        self._area = scroll_area(content, wide=False)
        self._area.setMinimumHeight(6 * theme.GRID)
        # queued, because the fields are not yet laid out again
        self._area.verticalScrollBar().rangeChanged.connect(self._show_edited, Qt.ConnectionType.QueuedConnection)
        for widget in (content, self._area.viewport()):
            widget.setAutoFillBackground(False)
        column(
            self._product,
            self._problem,
            self._lock_label,
            self._unlock_button,
            self.selector,
            (self._area, 1),
            row(self._reset_button, (self._save_button, 1)),
            self._reason,
            on=self,
            margins=(2 * theme.GRID, theme.GRID, theme.GRID, theme.GRID),
        )
        self.selector.changed.connect(self._show_solved)
        self.selector.changed.connect(self.changed)
        self.selector.current_changed.connect(self._show_form)
        on_language_change(self, self._show_texts)

    @property
    def schedule(self) -> dict[str, Mapping[str, Any]]:
        """Deviations from the schedule of the product by selected stage, without stages that have none."""
        return {stage: values for stage in self.selector.stages if (values := self._forms[stage].deviations)}

    @property
    def invalid(self) -> tuple[str, ...]:
        """Selected stages with an invalid schedule."""
        return tuple(stage for stage in self.selector.stages if not self._forms[stage].valid)

    @property
    def form(self) -> ScheduleForm:
        """The form of the current stage."""
        return self._forms[self.selector.current]

    def keeps(self, options: ScheduleOptions) -> bool:
        """Return whether the selection can stay: the product is the same, and all selected stages are offered."""
        shown = self._options
        same = shown is not None and shown.product.stem == options.product.stem
        return same and {*self.selector.stages} <= {*options.offered}

    def show_options(self, options: ScheduleOptions, *, keep: bool = False) -> None:
        """List the stages of a product, and create the forms for their schedules.

        `keep` keeps the selection and the changes to the schedules, see `keeps`.
        """
        selected, changes = options.stages, {}
        if keep and self._options is not None:
            changes = {stage: form.deviations for stage, form in self._forms.items()}
            if self.selector.stages != self._options.stages:
                selected = self.selector.stages
        self._name, self._options = options.name, options
        clear(self._form_box)
        self._forms = {stage: ScheduleForm(stage, options) for stage in options.offered}
        for stage, form in self._forms.items():
            form.change(changes.get(stage, {}))
            form.changed.connect(self.changed)
            form.hide()
            self._form_box.addWidget(form)
        warning = Text.of("run.unjudged_limits", product=options.name, names=options.unjudged)
        self._warning = warning if options.unjudged else None
        show_text(self._problem, "")
        self.selector.show()
        self.selector.offer(options.offered, options.stages, selected)

    def show_problem(self, product: str, problem: str) -> None:
        """Show only the name of a product and why it cannot be run, instead of the stages of the previous product."""
        self._name = product
        self.selector.hide()
        for form in self._forms.values():
            form.hide()
        self._warning = None
        show_text(self._problem, problem)
        self._show_texts()

    def lock(self, busy: str, role: str, save: str, *, new_pin: bool) -> None:
        """Disable all inputs if `busy` or `role` is a reason, and saving also if `save` is one; "" means no reason.

        The unlock button is shown if `role` is a reason; it sets the first PIN if `new_pin` is True.
        """
        self._new_pin = new_pin
        self._show_texts()
        self.selector.lock(busy or role)
        for form in self._forms.values():
            form.lock(busy or role)
        usable = self.selector.isVisibleTo(self)
        show_text(self._lock_label, role if usable else "")
        self._unlock_button.setVisible(bool(role) and usable)
        for widget in (self._reset_button, self._save_button):
            widget.setVisible(not role and usable)
        enable(self._reset_button, busy or role, say("engineer.back_to_product_values"))
        enable(self._save_button, busy or role or save)
        show_text(self._reason, busy or save if usable and not role else "")

    def _show_texts(self) -> None:
        self._unlock_button.setText(say("engineer.set_pin" if self._new_pin else "engineer.enter_pin"))
        stage = self.selector.current if self.selector.isVisibleTo(self) else ""
        self._heading.setText(say("engineer.schedule_of", stage=stage) if stage else "")
        if self._warning is not None:
            show_text(self._problem, say(self._warning))
        show_text(self._product, self._name and say("engineer.for_product", product=product_text(self._name)))
        self._show_solved()

    def _show_solved(self) -> None:
        """Show which parameters the selected stages solve; a run writes all of them, not only those of its part."""
        options, stages = self._options, self.selector.stages if self.selector.isVisibleTo(self) else ()
        text = ""
        if options is not None and stages:
            names = [name for stage in stages for name in options.estimates.get(stage, ())]
            if {*NAMES} <= {*names}:
                text = say("engineer.solved_and_written_all" if options.writes else "engineer.solved_all")
            else:
                groups = list(dict.fromkeys(map(group_of, names)))
                text = say("engineer.solved_and_written" if options.writes else "engineer.solved", names=groups)
        show_text(self._solved, text)

    def _show_edited(self) -> None:
        """Scroll to the field with the focus and its message after the form has grown or its area has shrunk."""
        field = next((field for field in self.findChildren(FormField) if field.editor.hasFocus()), None)
        if field is not None:
            self._area.ensureWidgetVisible(field, 0, theme.GRID)

    def _show_form(self, stage: str) -> None:
        for name, form in self._forms.items():
            form.setVisible(name == stage)
        self._area.verticalScrollBar().setValue(0)
        self._show_texts()


class StageSelector(QWidget):
    """Check boxes for parts of the calibration and for single stages, which can be reordered.

    Signals: `changed()` when the selection or its order changes; `current_changed(stage)` when the current row changes.
    """

    changed = Signal()
    current_changed = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self._rows: list[_StageRow] = []
        self.current = ""
        self._parts = {name: QCheckBox() for name in PARTS}
        texts = "engineer.scale_factors", "engineer.installation_and_lever_arms", "engineer.biases"
        for (name, check), text in zip(self._parts.items(), texts, strict=True):
            bind(check, text)
            check.setObjectName(f"part_check_{name}")
            check.setMinimumHeight(_ROW_HEIGHT)
            check.setFont(theme.font(theme.SECTION))
            check.clicked.connect(lambda _=False, part=name: self._choose_part(part))
        #: Stages of the product; each part consists of some of them.
        self._product_stages: tuple[str, ...] = ()
        self._single = label(self._list_title, "muted")
        self._list: QVBoxLayout = column(spacing=0)
        column(
            label("engineer.what_to_calibrate", "section"),
            *self._parts.values(),
            theme.GRID,
            self._single,
            self._list,
            label("engineer.parts_hold_once", "muted", wrap=True),
            on=self,
            spacing=0,
        )

    @property
    def stages(self) -> tuple[str, ...]:
        """The selected stages in run order."""
        return tuple(stage_row.stage for stage_row in self._rows if stage_row.check.isChecked())

    def offer(self, stages: tuple[str, ...], own: tuple[str, ...], selected: tuple[str, ...]) -> None:
        """List `stages`, and check those in `selected`, in that order; parts consist of the product's stages, `own`."""
        self._product_stages = own
        clear(self._list)
        in_order = iter(selected)
        self._rows = [_StageRow(next(in_order) if stage in selected else stage, self) for stage in stages]
        for stage_row in self._rows:
            stage_row.check.setChecked(stage_row.stage in selected)
            stage_row.check.toggled.connect(self._toggled)
            stage_row.check.clicked.connect(self._leave_unselected)
            stage_row.check.installEventFilter(self)
            stage_row.moved.connect(self._move)
        self._arrange()
        for name, check in self._parts.items():
            check.setVisible(bool(self._stages_of(name)))
        self._single.setText(self._list_title())
        self.select(self.current if self.current in selected else next(iter(selected), stages[0]))
        self._toggled()

    def select(self, stage: str) -> None:
        """Make the row of a stage the current one."""
        self.current = stage
        for stage_row in self._rows:
            theme.set_kind(stage_row, "current" if stage_row.stage == stage else "row")
        self.current_changed.emit(stage)

    def lock(self, reason: str) -> None:
        """Disable the check boxes for the given reason; "" enables them."""
        for check in self._parts.values():
            enable(check, reason)
        for stage_row in self._rows:
            enable(stage_row.check, reason, about("stage", stage_row.stage))
            stage_row.setEnabled(not reason)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Make the row that receives the focus the current one."""
        if event.type() == QEvent.Type.FocusIn:
            for stage_row in self._rows:
                if stage_row.check is watched and stage_row.stage != self.current:
                    self.select(stage_row.stage)
        return super().eventFilter(watched, event)

    def _stages_of(self, part: str) -> tuple[str, ...]:
        """Return the stages of the product that calibrate a part."""
        return tuple(stage for stage in PARTS[part] if stage in self._product_stages)

    def _list_title(self) -> str:
        """Return the title of the list of stages, which is an alternative to the parts if the product has any."""
        return say("engineer.single_stages" if any(map(self._stages_of, PARTS)) else "engineer.stages_in_order")

    def _choose_part(self, part: str) -> None:
        checked = self._parts[part].checkState() != Qt.CheckState.Unchecked
        for stage_row in self._rows:
            if stage_row.stage in self._stages_of(part):
                stage_row.check.setChecked(checked)
        self._toggled()
        self._leave_unselected()

    def _leave_unselected(self) -> None:
        """Make the first selected stage the current one if the current stage has been deselected."""
        if self.stages and self.current not in self.stages:
            self.select(self.stages[0])

    def _toggled(self) -> None:
        """Update the check boxes of the parts and the numbers of the stages."""
        selected = self.stages
        for name, check in self._parts.items():
            stages = self._stages_of(name)
            count = len(set(stages).intersection(selected))
            if 0 < count < len(stages):
                check.setCheckState(Qt.CheckState.PartiallyChecked)
            else:
                # unlike setChecked, this also redraws a box that was partly ticked
                check.setCheckState(Qt.CheckState.Checked if count else Qt.CheckState.Unchecked)
                check.setTristate(False)
        for stage_row in self._rows:
            stage_row.number.setText(str(selected.index(stage_row.stage) + 1) if stage_row.stage in selected else "")
        self.changed.emit()

    def _move(self, moved: "_StageRow", by: int) -> None:
        index = self._rows.index(moved)
        self._rows.insert(index + by, self._rows.pop(index))
        self._arrange()
        self.select(moved.stage)
        self._toggled()

    def _arrange(self) -> None:
        """Lay out the rows in run order and set the Tab order accordingly."""
        previous: QWidget = self._parts["biases"]
        for index, stage_row in enumerate(self._rows):
            self._list.removeWidget(stage_row)
            self._list.insertWidget(index, stage_row)
            stage_row.up.setEnabled(index > 0)
            stage_row.down.setEnabled(index < len(self._rows) - 1)
            for widget in (stage_row.check, stage_row.up, stage_row.down):
                QWidget.setTabOrder(previous, widget)
                previous = widget


class _StageRow(QFrame):
    """Row of a stage with its position in the run, a check box, and buttons that move it up or down."""

    moved = Signal(object, int)

    def __init__(self, stage: str, parent: QWidget) -> None:
        super().__init__(parent)
        self.stage = stage
        self.number = PlainLabel()
        self.number.setFixedWidth(2 * theme.GRID)
        self.number.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self.check = QCheckBox()
        self.check.setObjectName(f"stage_check_{stage}")
        self.check.setMinimumHeight(_ROW_HEIGHT)
        bind(self.check, partial(term, "stage", stage))
        self.up = self._make_button("up", Qt.ArrowType.UpArrow, -1)
        self.down = self._make_button("down", Qt.ArrowType.DownArrow, 1)
        margins = (theme.GRID, 0, 0, 0)
        row(self.number, (self.check, 1), self.up, self.down, on=self, spacing=theme.GRID // 2, margins=margins)

    def _make_button(self, name: str, arrow: Qt.ArrowType, by: int) -> QToolButton:
        button = QToolButton()
        button.setObjectName(f"stage_{name}_{self.stage}")
        button.setArrowType(arrow)
        button.setAutoRaise(True)
        button.setFixedSize(_ROW_HEIGHT, _ROW_HEIGHT)
        button.clicked.connect(lambda: self.moved.emit(self, by))
        for show in (button.setToolTip, button.setAccessibleName):
            bind(show, Text.of(f"engineer.move_{name}", stage=self.stage))
        return button
