"""Form for a stage's schedule, described by its method's model; errors are shown at each field during input."""

from functools import partial
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QWidget

from calstation.config import FieldSpec, ScheduleOptions, schedule_fields, schedule_problems
from calstation.gui.text import Words, bind, say, term
from calstation.gui.widgets import (
    Editor,
    FlagBox,
    FormField,
    FormValues,
    NumberEdit,
    column,
    label,
    make_input,
    theme,
    typed_number,
)
from calstation.messages import known
from calstation.physics import DISPLAY
from calstation.schema import KeyPath, Problem

#: Codes of the catalogue family ``schedule`` by pydantic's error type; all others are ``wrong_number``.
_WRONG = {
    "greater_than": "low",
    "greater_than_equal": "low",
    "less_than": "high",
    "less_than_equal": "high",
    "missing": "missing",
    "int_type": "whole",
    "int_parsing": "whole",
    "int_from_float": "whole",
}


class ScheduleForm(QWidget):
    """The fields of one stage; emits `changed` on every edit. The values are as entered, valid or not."""

    changed = Signal()

    def __init__(self, stage: str, options: ScheduleOptions) -> None:
        super().__init__()
        self.stage = stage
        self._source = source = FormValues(
            options.schedules[stage], lambda values: schedule_problems(stage, values, options)
        )
        groups = dict.fromkeys(name.rpartition("_")[0] for name in options.estimates[stage])
        rows: list[QWidget] = []
        for spec in schedule_fields(stage):
            if spec.kind == "targets":
                rows.append(label(f"schedule.{spec.name}"))
                rows += [_target_field(source, stage, spec, group) for group in groups if group in DISPLAY]
            elif spec.kind in ("number", "count", "flag", "choice"):  # others can be set only in the product file
                words = partial(_field_name, spec.name)
                rows.append(_Field(source, stage, spec, (spec.name,), _make_editor(spec), words, spec.unit))
        self._fields = [each for each in rows if isinstance(each, _Field)]
        column(*rows, None, on=self)
        source.changed.connect(self.changed)

    @property
    def values(self) -> dict[str, Any]:
        """Entered values by field; text that is not a number is kept as text, which the validation rejects."""
        return self._source.values

    @property
    def departures(self) -> dict[str, Any]:
        """Values that differ from the product's."""
        departures = {name: value for name, value in self.values.items() if self._source.differs((name,))}
        # without them a product without `rounds` would get a different limit
        if departures.keys() & {"duration_s", "targets"}:
            departures["rounds"] = self.values["rounds"]
        return departures

    @property
    def valid(self) -> bool:
        """Whether the entered schedule is valid."""
        return not self._source.problems

    def reset(self) -> None:
        """Restore the product's values."""
        self._source.reset()

    def lock(self, why: str) -> None:
        """Disable the fields for the given reason; "" enables them."""
        for field in self._fields:
            field.lock(why)


class _Field(FormField):
    """A field of a schedule; its name is bold if the value differs from the product's."""

    def __init__(
        self,
        source: FormValues,
        stage: str,
        spec: FieldSpec,
        place: KeyPath,
        editor: Editor,
        words: Words,
        unit: str,
    ) -> None:
        self._spec = spec
        super().__init__(source, place, editor, words, "_".join(map(str, ("schedule", stage, *place))), unit)
        self.unit.setFixedWidth(5 * theme.GRID)
        self.grid.setHorizontalSpacing(theme.GRID)
        self.grid.setColumnStretch(0, 1)
        if isinstance(editor, FlagBox):
            self.grid.addWidget(editor, 0, 0)
        else:
            self.grid.addWidget(self.label, 0, 0)
            self.grid.addWidget(editor, 0, 1)
            self.grid.addWidget(self.unit, 0, 2)
        self.grid.addWidget(self.message, 1, 0, 1, 3)
        if isinstance(editor, QComboBox):
            editor.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToContents)
            self.unit.hide()
        elif isinstance(editor, NumberEdit):
            editor.setFixedWidth(11 * theme.GRID)
        bind(self.setToolTip, partial(_description, stage, spec))

    def refresh(self) -> None:
        """Show the value, the problem, and whether the value differs from the product's."""
        super().refresh()
        named = self.editor if isinstance(self.editor, FlagBox) else self.label
        named.setFont(theme.font(bold=self._source.differs(self._place)))

    def problem_text(self, problem: Problem) -> str:
        """Return a description of the problem, with the remedy."""
        if problem.what.code == "product.target_unknown":
            return say("schedule.wrong_name", subject=problem.what.values["name"])
        if problem.kind in ("table", "value_error"):
            return say(problem.what)
        kind = _WRONG.get(problem.kind, "number")
        if len(problem.place) > 1:
            code = "schedule.wrong_target" if kind == "low" else "schedule.wrong_target_number"
            return say(code, subject=problem.place[1], range="0.1")
        return say(f"schedule.wrong_{kind}", range=_range(self._spec) or ("1" if kind == "whole" else "0.1"))


def _target_field(source: FormValues, stage: str, spec: FieldSpec, group: str) -> _Field:
    """Create the field for the target sigma of a group, in its display unit."""
    unit, size = DISPLAY[group]
    words = partial(term, "group", group)
    field = _Field(source, stage, spec, (spec.name, group), NumberEdit(size, _number), words, unit)
    bind(field.editor.setAccessibleName, lambda: f"{term('schedule', spec.name)}: {words()}")
    return field


def _make_editor(spec: FieldSpec) -> Editor:
    if spec.kind in ("number", "count"):
        return NumberEdit(read=partial(_number, whole=spec.kind == "count"))
    return make_input(spec, lambda: [(choice, choice.replace("_", " ")) for choice in spec.choices])


def _number(text: str, whole: bool = False) -> float | int | str | None:
    """Return the entered number, with a decimal point or comma; otherwise as `typed_number`."""
    number = typed_number(text.replace(",", "."))
    if not isinstance(number, float | int):
        return text.strip() or None
    return int(number) if whole and number == int(number) else float(number)


def _field_name(name: str) -> str:
    """Return the display name of a field, derived from its identifier if the catalogue has no entry."""
    if known(f"schedule.{name}"):
        return term("schedule", name)
    return name.rsplit("_", 1)[0].replace("_", " ").capitalize()


def _description(stage: str, spec: FieldSpec) -> str:
    """Return a description of a field, its range, and whether it may be empty."""
    codes = (f"schedule.about_{stage}_{spec.name}", f"schedule.about_{spec.name}")
    about = next((say(code) for code in codes if known(code)), spec.description)
    return "; ".join(filter(None, (about, _range(spec), say("schedule.empty") if spec.optional else "")))


def _range(spec: FieldSpec) -> str:
    """Return a description of the values that a field accepts."""
    if spec.low is None:
        return ""
    unit = f" {spec.unit}" if spec.unit else ""
    if spec.high is None:
        return say("schedule.above" if spec.above else "schedule.least", low=spec.low, unit=unit)
    return say("schedule.range_above" if spec.above else "schedule.range", low=spec.low, high=spec.high, unit=unit)
