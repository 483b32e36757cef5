"""Form for a stage's schedule, generated from its method's model; errors are shown at each field during input."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QCheckBox, QComboBox, QGridLayout, QLabel, QLineEdit, QSizePolicy, QWidget

from calstation.config import ScheduleField, ScheduleOptions, ScheduleProblem, schedule_fields, schedule_problems
from calstation.gui.text import Words, bind, on_language_change, say, term, with_minus, without_minus
from calstation.gui.widgets import column, enable, label, row, show_text, theme
from calstation.messages import known
from calstation.physics import DISPLAY


class ScheduleForm(QWidget):
    """The fields of one stage; emits `changed` on every edit. The values are as entered, valid or not."""

    changed = Signal()

    def __init__(self, stage: str, options: ScheduleOptions) -> None:
        super().__init__()
        self.stage = stage
        self._options = options
        groups = dict.fromkeys(name.rpartition("_")[0] for name in options.estimates[stage])
        shown = tuple(group for group in groups if group in DISPLAY)
        self._rows = {
            field.name: _TargetsRow(stage, field, shown) if field.kind == "targets" else _Row(stage, field)
            for field in schedule_fields(stage)
            if field.kind != "other"  # can be set only in the product file
        }
        column(*self._rows.values(), None, on=self)
        for each in self._rows.values():
            each.changed.connect(self._typed)
        self.fill(options.schedules[stage])
        on_language_change(self, self._check)

    @property
    def values(self) -> dict[str, Any]:
        """Entered values by field; text that is not a number is kept as text, which the validation rejects."""
        return {**self._options.schedules[self.stage], **{name: each.value for name, each in self._rows.items()}}

    @property
    def departures(self) -> dict[str, Any]:
        """Values that differ from the product's."""
        product = self._options.schedules[self.stage]
        found = {name: value for name, value in self.values.items() if value != product.get(name)}
        # without them a product without `rounds` would get a different limit
        if found.keys() & {"duration_s", "targets"}:
            found["rounds"] = self.values["rounds"]
        return found

    @property
    def valid(self) -> bool:
        """Whether the entered schedule is valid."""
        return not schedule_problems(self.stage, self.values, self._options)

    def fill(self, values: Mapping[str, Any]) -> None:
        """Show these values."""
        for name, each in self._rows.items():
            each.fill(values.get(name))
        self._check()

    def reset(self) -> None:
        """Restore the product's values."""
        self.fill(self._options.schedules[self.stage])
        self.changed.emit()

    def lock(self, why: str) -> None:
        """Disable the fields for the given reason; "" enables them."""
        for each in self._rows.values():
            each.lock(why)

    def _typed(self) -> None:
        self._check()
        self.changed.emit()

    def _check(self) -> None:
        found = schedule_problems(self.stage, self.values, self._options)
        product = self._options.schedules[self.stage]
        for name, each in self._rows.items():
            each.show_state(found.get(name), departs=each.value != product.get(name))


class _Row(QWidget):
    """Name and input of a field; an error in the value is shown below them."""

    changed = Signal()

    def __init__(self, stage: str, field: ScheduleField) -> None:
        super().__init__()
        self._field = field
        self._name: QLabel | QCheckBox = label(partial(_field_name, field.name))
        self._problem = label(kind="error", wrap=True)
        self._problem.hide()
        self._inputs: list[QWidget] = []
        bind(self.setToolTip, lambda: _description(stage, field))
        self._make_inputs(f"schedule_{stage}_{field.name}")

    def _make_inputs(self, name: str) -> None:
        field = self._field
        if field.kind == "flag":
            check = self._name = QCheckBox()
            check.toggled.connect(self.changed)
            bind(check, partial(_field_name, field.name))
            column(check, on=self)
            self._inputs = [check]
        elif field.kind == "choice":
            combo = QComboBox()
            for choice in field.choices:
                combo.addItem(choice.replace("_", " "), choice)
            combo.currentIndexChanged.connect(lambda _: self.changed.emit())
            row((self._name, 1), combo, on=self)
            self._inputs = [combo]
        else:
            edit = self._make_edit(name, self._name.text)
            inputs = row((self._name, 1), edit, _unit_label(field.unit))
            column(inputs, self._problem, on=self, spacing=theme.GRID // 2)
        self._inputs[0].setObjectName(name)

    def _make_edit(self, name: str, words: Words) -> QLineEdit:
        edit = QLineEdit()
        edit.setObjectName(name)
        edit.setAlignment(Qt.AlignmentFlag.AlignRight)
        edit.setFixedWidth(11 * theme.GRID)
        edit.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Fixed)
        edit.textEdited.connect(self.changed)
        bind(edit.setAccessibleName, words)
        self._inputs.append(edit)
        return edit

    @property
    def value(self) -> Any:
        """The entered or selected value, None if the field is empty."""
        (each,) = self._inputs
        if isinstance(each, QCheckBox):
            return each.isChecked()
        if isinstance(each, QComboBox):
            return each.currentData()
        assert isinstance(each, QLineEdit)
        return _number(each.text(), whole=self._field.kind == "count")

    def fill(self, value: Any) -> None:
        """Show a value; for None the field is empty."""
        (each,) = self._inputs
        if isinstance(each, QCheckBox):
            each.setChecked(bool(value))
        elif isinstance(each, QComboBox):
            each.setCurrentIndex(each.findData(value))
        elif isinstance(each, QLineEdit):
            shown = f"{value:.12g}" if isinstance(value, float) else str(value)
            each.setText("" if value is None else with_minus(shown))

    def lock(self, why: str) -> None:
        """Disable the inputs for the given reason; "" enables them."""
        for each in self._inputs:
            enable(each, why, self.toolTip())

    def show_state(self, problem: ScheduleProblem | None, *, departs: bool) -> None:
        """Show any error in the value, and show the name in bold if the value differs from the product's."""
        show_text(self._problem, _problem_text(self._field, problem) if problem else "")
        self._name.setFont(theme.font(bold=departs))


class _TargetsRow(_Row):
    """One target sigma for each group that the stage estimates, in display units."""

    def __init__(self, stage: str, field: ScheduleField, groups: tuple[str, ...]) -> None:
        self._groups = groups
        #: Targets of single parameters, which the form does not show.
        self._others: dict[str, Any] = {}
        #: Displayed text and exact SI value of each target as filled in.
        self._filled: dict[str, tuple[str, float]] = {}
        super().__init__(stage, field)

    def _make_inputs(self, name: str) -> None:
        self._edits: dict[str, QLineEdit] = {}
        grid = QGridLayout()
        grid.setHorizontalSpacing(theme.GRID)
        grid.setVerticalSpacing(theme.GRID // 2)
        grid.setColumnStretch(0, 1)
        for line, group in enumerate(self._groups):
            caption = label(partial(term, "group", group))
            self._edits[group] = self._make_edit(f"{name}_{group}", partial(self._target_name, group))
            for number, widget in enumerate((caption, self._edits[group], _unit_label(DISPLAY[group][0]))):
                grid.addWidget(widget, line, number)
        column(self._name, grid, self._problem, on=self, spacing=theme.GRID // 2)

    def _target_name(self, group: str) -> str:
        return f"{self._name.text()}: {term('group', group)}"

    @property
    def value(self) -> dict[str, Any]:
        """Target sigmas by group or parameter, SI; an unchanged text keeps its exact value."""
        targets = dict(self._others)
        for group, edit in self._edits.items():
            number = _number(edit.text())
            text, sigma = self._filled.get(group, ("", 0.0))
            if text and edit.text() == text:
                targets[group] = sigma
            elif number is not None:
                targets[group] = number * DISPLAY[group][1] if isinstance(number, float) else number
        return targets

    def fill(self, value: Any) -> None:
        """Show the targets."""
        targets: Mapping[str, Any] = value or {}
        self._others = {name: sigma for name, sigma in targets.items() if name not in self._edits}
        self._filled = {
            group: (f"{targets[group] / DISPLAY[group][1]:.6g}", float(targets[group]))
            for group in self._edits
            if group in targets
        }
        for group, edit in self._edits.items():
            edit.setText(self._filled.get(group, ("", 0.0))[0])


def _unit_label(unit: str) -> QLabel:
    made = QLabel(unit)
    made.setFixedWidth(5 * theme.GRID)
    return made


def _number(text: str, whole: bool = False) -> float | int | str | None:
    """Return the entered number, None for an empty text, or the text itself, which the validation rejects."""
    text = text.strip().replace(",", ".")
    try:
        number = float(without_minus(text))
    except ValueError:
        return text or None
    return int(number) if whole and number.is_integer() else number


def _field_name(name: str) -> str:
    """Return the display name of a field, derived from its identifier if the catalogue has no entry."""
    if known(f"schedule.{name}"):
        return term("schedule", name)
    return name.rsplit("_", 1)[0].replace("_", " ").capitalize()


def _description(stage: str, field: ScheduleField) -> str:
    """Return a description of a field, its range, and whether it may be empty."""
    codes = (f"schedule.about_{stage}_{field.name}", f"schedule.about_{field.name}")
    about = next((say(code) for code in codes if known(code)), field.description)
    parts = (about, _range(field), say("schedule.empty") if field.optional else "")
    return "; ".join(part for part in parts if part)


def _range(field: ScheduleField) -> str:
    """Return a description of the values that a field accepts."""
    if field.low is None:
        return ""
    unit = _unit(field)
    if field.high is None:
        return say("schedule.above" if field.above else "schedule.least", low=field.low, unit=unit)
    code = "schedule.range_above" if field.above else "schedule.range"
    return say(code, low=field.low, high=field.high, unit=unit)


def _problem_text(field: ScheduleField, problem: ScheduleProblem) -> str:
    """Return a description of the error in a field's value, with the remedy."""
    kind: str = problem.kind
    if problem.subject and kind != "name":
        kind = "target" if kind == "low" else "target_number"
    return say(
        f"schedule.wrong_{kind}",
        bound=problem.bound,
        unit=_unit(field),
        range=_range(field) or ("1" if kind == "whole" else "0.1"),
        subject=problem.subject,
    )


def _unit(field: ScheduleField) -> str:
    return f" {field.unit}" if field.unit else ""
