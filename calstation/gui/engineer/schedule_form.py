"""The schedule of a stage as a form made from its method's model: checked as typed, each problem beside its field."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QCheckBox, QComboBox, QGridLayout, QLabel, QLineEdit, QSizePolicy, QWidget

from calstation.config import (
    ScheduleField,
    ScheduleOptions,
    ScheduleProblem,
    schedule_fields,
    schedule_problems,
)
from calstation.gui.text import bind, on_language_change, say, term
from calstation.gui.widgets import column, enable, label, row, theme
from calstation.messages import known
from calstation.physics import DISPLAY

_WIDTH = 11 * theme.GRID


class ScheduleForm(QWidget):
    """The fields of one stage; emits `changed` at every key. Values are those typed, right or wrong."""

    changed = Signal()

    def __init__(self, stage: str, offer: ScheduleOptions) -> None:
        super().__init__()
        self.stage = stage
        self._offer = offer
        groups = dict.fromkeys(name.rpartition("_")[0] for name in offer.estimates[stage])
        shown = tuple(group for group in groups if group in DISPLAY)
        made = {field.name: _make_row(stage, field, shown) for field in schedule_fields(stage)}
        self._rows = {name: each for name, each in made.items() if each is not None}
        column(*self._rows.values(), None, on=self)
        for each in self._rows.values():
            each.changed.connect(self._typed)
        self.fill(offer.schedules[stage])
        on_language_change(self, self._check)

    @property
    def values(self) -> dict[str, Any]:
        """Values typed, by field; text that is not a number stays text, which the check refuses."""
        typed = {name: each.value for name, each in self._rows.items()}
        return {**self._offer.schedules[self.stage], **typed}

    @property
    def departures(self) -> dict[str, Any]:
        """Values that differ from the product's."""
        product = self._offer.schedules[self.stage]
        return {name: value for name, value in self.values.items() if value != product.get(name)}

    @property
    def valid(self) -> bool:
        """Whether the schedule can be run."""
        return not schedule_problems(self.stage, self.values, self._offer)

    def fill(self, values: Mapping[str, Any]) -> None:
        """Show these values."""
        for name, each in self._rows.items():
            each.fill(values.get(name))
        self._check()

    def reset(self) -> None:
        """Go back to the product's values."""
        self.fill(self._offer.schedules[self.stage])
        self.changed.emit()

    def lock(self, why: str) -> None:
        """Disable the fields with a reason; "" enables them."""
        for each in self._rows.values():
            each.lock(why)

    def _typed(self) -> None:
        self._check()
        self.changed.emit()

    def _check(self) -> None:
        found = schedule_problems(self.stage, self.values, self._offer)
        product = self._offer.schedules[self.stage]
        for name, each in self._rows.items():
            each.show_problem(found.get(name))
            each.emphasise(each.value != product.get(name))


class _Row(QWidget):
    """A caption, an input and a line for what is wrong with it; subclasses have the input."""

    changed = Signal()

    def __init__(self, stage: str, field: ScheduleField) -> None:
        super().__init__()
        self.field = field
        self.caption = label(lambda: _field_name(field.name))
        self.note = label(kind="error", wrap=True)
        self.note.hide()
        bind(self.setToolTip, lambda: _description(stage, field))

    @property
    def value(self) -> Any:
        """The value typed."""
        raise NotImplementedError

    def fill(self, value: Any) -> None:
        """Show a value."""
        raise NotImplementedError

    def lock(self, why: str) -> None:
        """Disable the input with a reason; "" enables it."""
        raise NotImplementedError

    def show_problem(self, problem: ScheduleProblem | None) -> None:
        """Show what is wrong with the value, if anything."""
        self.note.setText(_problem_text(self.field, problem) if problem else "")
        self.note.setVisible(problem is not None)

    def emphasise(self, departs: bool) -> None:
        """Show in bold that the value is not the product's."""
        self.caption.setFont(theme.font(bold=departs))


class _Flag(_Row):
    """True or false."""

    def __init__(self, stage: str, field: ScheduleField) -> None:
        super().__init__(stage, field)
        self._check = QCheckBox()
        self._check.setObjectName(f"schedule_{stage}_{field.name}")
        self._check.toggled.connect(self.changed)
        bind(self._check, lambda: _field_name(field.name))
        column(self._check, on=self)

    @property
    def value(self) -> bool:
        """Whether it is ticked."""
        return self._check.isChecked()

    def fill(self, value: Any) -> None:
        """Show a value."""
        self._check.setChecked(bool(value))

    def lock(self, why: str) -> None:
        """Disable the input with a reason; "" enables it."""
        enable(self._check, why, self.toolTip())

    def emphasise(self, departs: bool) -> None:
        """Show in bold that the value is not the product's."""
        self._check.setFont(theme.font(bold=departs))


class _Choice(_Row):
    """One of several words."""

    def __init__(self, stage: str, field: ScheduleField) -> None:
        super().__init__(stage, field)
        self._combo = QComboBox()
        self._combo.setObjectName(f"schedule_{stage}_{field.name}")
        self._combo.addItems([choice.replace("_", " ") for choice in field.choices])
        self._combo.currentIndexChanged.connect(lambda _: self.changed.emit())
        self.caption.setBuddy(self._combo)
        row((self.caption, 1), self._combo, on=self)

    @property
    def value(self) -> str:
        """The word chosen."""
        return self.field.choices[self._combo.currentIndex()]

    def fill(self, value: Any) -> None:
        """Show a value."""
        if value in self.field.choices:
            self._combo.setCurrentIndex(self.field.choices.index(value))

    def lock(self, why: str) -> None:
        """Disable the input with a reason; "" enables it."""
        enable(self._combo, why, self.toolTip())


class _Number(_Row):
    """One number."""

    def __init__(self, stage: str, field: ScheduleField) -> None:
        super().__init__(stage, field)
        self._edit = _number_edit(f"schedule_{stage}_{field.name}")
        self._edit.textEdited.connect(self.changed)
        self.caption.setBuddy(self._edit)
        bind(self._edit.setAccessibleName, self.caption.text)
        inputs = row((self.caption, 1), self._edit, _unit_label(field.unit))
        column(inputs, self.note, on=self, spacing=theme.GRID // 2)

    @property
    def value(self) -> float | int | str | None:
        """The number typed, None for nothing."""
        return _number(self._edit.text(), whole=self.field.kind == "count")

    def fill(self, value: Any) -> None:
        """Show a value, nothing for None."""
        shown = f"{value:.12g}" if isinstance(value, float) else str(value)
        self._edit.setText("" if value is None else shown)

    def lock(self, why: str) -> None:
        """Disable the input with a reason; "" enables it."""
        enable(self._edit, why, self.toolTip())


class _Targets(_Row):
    """One sigma for each group that the stage estimates, in the unit shown."""

    def __init__(self, stage: str, field: ScheduleField, groups: tuple[str, ...]) -> None:
        super().__init__(stage, field)
        #: Targets of single parameters, which the form does not show.
        self._others: dict[str, Any] = {}
        #: Text and exact value, SI, of each target as filled in.
        self._filled: dict[str, tuple[str, float]] = {}
        self._edits = {group: _number_edit(f"schedule_{stage}_targets_{group}") for group in groups}
        grid = QGridLayout()
        grid.setHorizontalSpacing(theme.GRID)
        grid.setVerticalSpacing(theme.GRID // 2)
        grid.setColumnStretch(0, 1)
        for line, (group, edit) in enumerate(self._edits.items()):
            edit.textEdited.connect(self.changed)
            caption = label(partial(term, "group", group))
            caption.setBuddy(edit)
            bind(edit.setAccessibleName, partial(self._accessible_name, group))
            for number, widget in enumerate((caption, edit, _unit_label(DISPLAY[group][0]))):
                grid.addWidget(widget, line, number)
        column(self.caption, grid, self.note, on=self, spacing=theme.GRID // 2)

    def _accessible_name(self, group: str) -> str:
        return f"{self.caption.text()}: {term('group', group)}"

    @property
    def value(self) -> dict[str, Any]:
        """Sigma by group, SI; an unchanged text keeps its exact value."""
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
        """Show targets."""
        targets: Mapping[str, Any] = value or {}
        self._others = {name: sigma for name, sigma in targets.items() if name not in self._edits}
        self._filled.clear()
        for group, edit in self._edits.items():
            text = ""
            if group in targets:
                text = f"{targets[group] / DISPLAY[group][1]:.6g}"
                self._filled[group] = (text, float(targets[group]))
            edit.setText(text)

    def lock(self, why: str) -> None:
        """Disable the inputs with a reason; "" enables them."""
        for edit in self._edits.values():
            enable(edit, why, self.toolTip())


def _make_row(stage: str, field: ScheduleField, groups: tuple[str, ...]) -> _Row | None:
    """The row of a field; None for a field that only the product's file can set."""
    if field.kind == "targets":
        return _Targets(stage, field, groups)
    if field.kind == "flag":
        return _Flag(stage, field)
    if field.kind == "choice":
        return _Choice(stage, field)
    return None if field.kind == "other" else _Number(stage, field)


def _number_edit(name: str) -> QLineEdit:
    edit = QLineEdit()
    edit.setObjectName(name)
    edit.setAlignment(Qt.AlignmentFlag.AlignRight)
    edit.setFixedWidth(_WIDTH)
    edit.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Fixed)
    return edit


def _unit_label(unit: str) -> QLabel:
    made = QLabel(unit)
    made.setFixedWidth(5 * theme.GRID)
    return made


def _number(text: str, whole: bool = False) -> float | int | str | None:
    """The number typed, None for nothing, or the text itself, which the check refuses."""
    text = text.strip().replace(",", ".")
    if not text:
        return None
    try:
        number = float(text)
    except ValueError:
        return text
    return int(number) if whole and number.is_integer() else number


def _field_name(name: str) -> str:
    """The name of a field; of an unknown one as its method calls it."""
    if known(f"schedule.{name}"):
        return term("schedule", name)
    return name.rsplit("_", 1)[0].replace("_", " ").capitalize()


def _description(stage: str, field: ScheduleField) -> str:
    """What a field does, its range, and whether it may be empty."""
    codes = (f"schedule.about_{stage}_{field.name}", f"schedule.about_{field.name}")
    about = next((say(code) for code in codes if known(code)), field.description)
    parts = (about, _range(field), say("schedule.empty") if field.optional else "")
    return "; ".join(part for part in parts if part)


def _range(field: ScheduleField) -> str:
    """The values that a field accepts."""
    unit = f" {field.unit}" if field.unit else ""
    if field.low is None:
        return ""
    if field.high is None:
        return say("schedule.above" if field.above else "schedule.least", low=field.low, unit=unit)
    code = "schedule.range_above" if field.above else "schedule.range"
    return say(code, low=field.low, high=field.high, unit=unit)


def _problem_text(field: ScheduleField, problem: ScheduleProblem) -> str:
    """What is wrong with a field's value, and the remedy."""
    kind: str = problem.kind
    if problem.subject and kind != "name":
        kind = "target" if kind == "low" else "target_number"
    return say(
        f"schedule.wrong_{kind}",
        bound=problem.bound,
        unit=f" {field.unit}" if field.unit else "",
        range=_range(field) or ("1" if kind == "whole" else "0.1"),
        subject=problem.subject,
    )
