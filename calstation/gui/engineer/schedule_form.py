"""Form for the schedule of a stage, generated from the schedule model of its method; it shows errors during input."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QWidget

from calstation.config import FieldSpec, ScheduleOptions, implied_targets, schedule_fields, schedule_problems
from calstation.gui.text import Words, bind, say, schedule_text, term
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
from calstation.physics import DISPLAY, group_of, limit_number
from calstation.schema import KeyPath, Problem

#: Suffix of the message code ``schedule.wrong_...`` for each pydantic error type; the default is ``number``.
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
    """The fields of the schedule of a stage, whose values may be invalid; every edit emits `changed()`."""

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
                rows += [_TargetField(source, stage, spec, group, options) for group in groups if group in DISPLAY]
            elif spec.kind in ("number", "count", "flag", "choice"):  # other kinds can be set only in the product file
                words = partial(schedule_text, spec.name, stage)
                rows.append(_Field(source, stage, spec, (spec.name,), _make_editor(spec), words, spec.unit))
        self._fields = [widget for widget in rows if isinstance(widget, _Field)]
        column(*rows, None, on=self)
        source.changed.connect(self.changed)

    @property
    def values(self) -> dict[str, Any]:
        """Entered values by field; text that is not a number is kept and rejected by the validation."""
        return self._source.values

    @property
    def deviations(self) -> dict[str, Any]:
        """Values that differ from the values in the product."""
        deviations = {name: value for name, value in self.values.items() if self._source.differs((name,))}
        # a product without `rounds` would otherwise get a different limit
        if deviations.keys() & {"duration_s", "targets"}:
            deviations["rounds"] = self.values["rounds"]
        return deviations

    @property
    def valid(self) -> bool:
        """Whether the entered schedule is valid."""
        return not self._source.problems

    @property
    def wrong(self) -> tuple[str, ...]:
        """The displayed names of the fields with invalid values, which may be scrolled out of view."""
        names = dict.fromkeys(str(problem.key_path[0]) for problem in self._source.problems if problem.key_path)
        return tuple(schedule_text(name, self.stage) for name in names)

    def change(self, values: Mapping[str, Any]) -> None:
        """Change the values of some fields."""
        self._source.set({(name,): value for name, value in values.items()})

    def reset(self) -> None:
        """Restore the values in the product."""
        self._source.reset()

    def lock(self, reason: str) -> None:
        """Disable the fields for the given reason; "" enables them."""
        for field in self._fields:
            field.lock(reason)


class _Field(FormField):
    """A field of a schedule, whose name is bold if its value differs from the value in the product."""

    def __init__(
        self,
        source: FormValues,
        stage: str,
        spec: FieldSpec,
        key_path: KeyPath,
        editor: Editor,
        words: Words,
        unit: str,
    ) -> None:
        self._spec = spec
        name = "_".join(map(str, ("schedule", stage, *key_path)))
        super().__init__(source, key_path, editor, words, name, unit)
        self.unit.setFixedWidth(6 * theme.GRID)
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
        """Show the value, its problem, and whether it differs from the product's value."""
        super().refresh()
        label = self.editor if isinstance(self.editor, FlagBox) else self.label
        label.setFont(theme.font(bold=self._source.differs(self._key_path)))

    def problem_text(self, problem: Problem) -> str:
        """Return a description of the problem and its remedy."""
        if problem.what.code == "product.target_unknown":
            return say("schedule.wrong_name", subject=problem.what.values["name"])
        if problem.kind in ("table", "value_error"):
            return say(problem.what)
        kind = _WRONG.get(problem.kind, "number")
        if len(problem.key_path) > 1:
            code = "schedule.wrong_target" if kind == "low" else "schedule.wrong_target_number"
            return say(code, subject=problem.key_path[1], range="0.1")
        return say(f"schedule.wrong_{kind}", range=_range(self._spec) or ("1" if kind == "whole" else "0.1"))


class _TargetField(_Field):
    """The field for the target sigma of a parameter group in its display unit; it warns above the product's limit.

    While the field is empty, its placeholder is the target that applies by default.
    """

    def __init__(self, source: FormValues, stage: str, spec: FieldSpec, group: str, options: ScheduleOptions) -> None:
        self._unit, self._size = DISPLAY[group]
        self._limit = options.sigma_limits.get(stage, {}).get(group)
        self._options = options
        #: Targets of single parameters of the group in the product.
        self._single = {n: s for n, s in source.stored[spec.name].items() if n != group and group_of(n) == group}
        words = partial(term, "group", group)
        self._edit = NumberEdit(self._size, _number)
        super().__init__(source, stage, spec, (spec.name, group), self._edit, words, self._unit)
        self.warning = self._above_limit
        bind(self._edit.setAccessibleName, lambda: say("common.named", name=term("schedule", spec.name), text=words()))
        self.refresh()

    def refresh(self) -> None:
        """Show the value, its problem, and the target that applies without a value."""
        super().refresh()
        implied = implied_targets(self._source.values, self._options).get(str(self._key_path[-1]))
        self._edit.setPlaceholderText("" if implied is None else f"{implied / self._size:.3g}")

    def changes(self, value: Any) -> dict[KeyPath, Any]:
        """Return the changes for a new target: it replaces the targets of single parameters, which None restores."""
        changes: dict[KeyPath, Any] = {self._key_path: value}
        return changes | {(self._key_path[0], n): s if value is None else None for n, s in self._single.items()}

    def _above_limit(self) -> str:
        value, limit = self._source.value(self._key_path), self._limit
        if limit is None or not isinstance(value, float | int) or value <= limit * (1.0 + 1e-9):
            return ""
        return say("schedule.above_limit", limit=limit_number(limit, self._size), unit=self._unit)


def _make_editor(spec: FieldSpec) -> Editor:
    if spec.kind in ("number", "count"):
        return NumberEdit(read=partial(_number, whole=spec.kind == "count"))
    return make_input(spec, lambda: [(choice, choice.replace("_", " ")) for choice in spec.choices])


def _number(text: str, whole: bool = False) -> float | int | str | None:
    """Return the number in `text` with a decimal point or comma, an integer if `whole`; other text is unchanged."""
    number = typed_number(text.replace(",", "."))
    if not isinstance(number, float | int):
        return text.strip() or None
    return int(number) if whole and number == int(number) else float(number)


def _description(stage: str, spec: FieldSpec) -> str:
    """Return a description of a field with its range, and whether it may be empty."""
    codes = (f"schedule.about_{stage}_{spec.name}", f"schedule.about_{spec.name}")
    about = next((say(code) for code in codes if known(code)), spec.description)
    return "; ".join(filter(None, (about, _range(spec), say("schedule.empty") if spec.optional else "")))


def _range(spec: FieldSpec) -> str:
    """Return a description of the range of a field."""
    if spec.low is None:
        return ""
    unit = f" {spec.unit}" if spec.unit else ""
    codes = ("least", "above") if spec.high is None else ("range", "range_above")
    return say(f"schedule.{codes[spec.above]}", low=spec.low, high=spec.high, unit=unit)
