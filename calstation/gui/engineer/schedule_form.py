"""A stage's schedule as a form made from its method's model: checked as typed, each fault beside its field."""

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import QEvent, Qt, Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from calstation.config.schedules import (
    ScheduleField,
    ScheduleOptions,
    ScheduleProblem,
    schedule_fields,
    schedule_problems,
)
from calstation.gui.engineer.field_wording import word_description, word_field, word_problem
from calstation.gui.text.messages import term
from calstation.gui.widgets import theme
from calstation.physics.units import DISPLAY

_WIDTH = 11 * theme.GRID


class ScheduleForm(QWidget):
    """The fields of one stage; `changed` at every key. Values are those typed, right or wrong."""

    changed = Signal()

    def __init__(self, stage: str, offer: ScheduleOptions, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.stage = stage
        self._offer = offer
        self._rows: dict[str, _Row] = {}
        self._why_locked = ""
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(theme.GRID)
        groups = tuple(dict.fromkeys(name.rpartition("_")[0] for name in offer.estimates[stage]))
        groups = tuple(group for group in groups if group in DISPLAY)
        for field in schedule_fields(stage):
            row = _row(stage, field, groups)
            if row is None:
                continue
            row.changed.connect(self._typed)
            self._rows[field.name] = row
            column.addWidget(row)
        column.addStretch(1)
        self.fill(offer.schedules[stage])

    @property
    def values(self) -> dict[str, Any]:
        """What is typed, by field; a text that is no number stays a text, which no schedule takes."""
        shown = {name: row.value for name, row in self._rows.items()}
        return {**self._offer.schedules[self.stage], **shown}

    @property
    def departures(self) -> dict[str, Any]:
        """Values that differ from the product's."""
        product = self._offer.schedules[self.stage]
        return {name: value for name, value in self.values.items() if value != product.get(name)}

    @property
    def sound(self) -> bool:
        """Whether every value may be run."""
        return not schedule_problems(self.stage, self.values, self._offer)

    def fill(self, values: Mapping[str, Any]) -> None:
        """Show these values."""
        for name, row in self._rows.items():
            row.fill(values.get(name))
        self._check()

    def reset(self) -> None:
        """Back to the product's values."""
        self.fill(self._offer.schedules[self.stage])
        self.changed.emit()

    def lock(self, why: str) -> None:
        """Make the fields read-only for a reason, or free with ""."""
        self._why_locked = why
        for row in self._rows.values():
            row.lock(why)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        for row in self._rows.values():
            row.retranslate()
            row.lock(self._why_locked)
        self._check()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _typed(self) -> None:
        self._check()
        self.changed.emit()

    def _check(self) -> None:
        found = schedule_problems(self.stage, self.values, self._offer)
        product = self._offer.schedules[self.stage]
        for name, row in self._rows.items():
            row.show_problem(found.get(name))
            row.show_departure(row.value != product.get(name))


class _Row(QWidget):
    """A caption, what to type into, and a line for what is wrong with it."""

    changed = Signal()

    def __init__(self, field: ScheduleField) -> None:
        super().__init__()
        self.field = field
        self._problem: ScheduleProblem | None = None
        self.caption = QLabel()
        self.note = QLabel()
        self.note.setProperty("kind", "error")
        self.note.setWordWrap(True)
        self.note.hide()

    @property
    def value(self) -> Any:
        """What is typed."""
        raise NotImplementedError

    def fill(self, value: Any) -> None:
        """Show a value."""
        raise NotImplementedError

    def lock(self, why: str) -> None:
        """Read-only for a reason, or free with ""."""
        raise NotImplementedError

    def retranslate(self) -> None:
        """Caption, tooltip and fault in the language in force."""
        self.caption.setText(word_field(self.field.name))
        self.setToolTip(word_description(self.field))
        self.show_problem(self._problem)

    def show_problem(self, problem: ScheduleProblem | None) -> None:
        """Say what is wrong, or nothing."""
        self._problem = problem
        self.note.setText(word_problem(self.field, problem) if problem else "")
        self.note.setVisible(problem is not None)

    def show_departure(self, departs: bool) -> None:
        """A value that is not the product's stands in bold."""
        self.caption.setFont(theme.font(bold=departs))


class _Flag(_Row):
    """True or false."""

    def __init__(self, stage: str, field: ScheduleField) -> None:
        super().__init__(field)
        self.check = QCheckBox()
        self.check.setObjectName(f"schedule_{stage}_{field.name}")
        self.check.toggled.connect(self.changed)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.check)
        self.retranslate()

    @property
    def value(self) -> bool:
        """Whether it is ticked."""
        return self.check.isChecked()

    def fill(self, value: Any) -> None:
        """Show a value."""
        self.check.setChecked(bool(value))

    def lock(self, why: str) -> None:
        """Read-only for a reason, or free with ""."""
        self.check.setEnabled(not why)
        self.check.setToolTip(why or self.toolTip())

    def retranslate(self) -> None:
        """The caption stands at the box."""
        super().retranslate()
        self.check.setText(word_field(self.field.name))

    def show_departure(self, departs: bool) -> None:
        """A value that is not the product's stands in bold."""
        self.check.setFont(theme.font(bold=departs))


class _Choice(_Row):
    """One of several words."""

    def __init__(self, stage: str, field: ScheduleField) -> None:
        super().__init__(field)
        self.combo = QComboBox()
        self.combo.setObjectName(f"schedule_{stage}_{field.name}")
        self.combo.addItems([choice.replace("_", " ") for choice in field.choices])
        self.combo.currentIndexChanged.connect(lambda _: self.changed.emit())
        self.caption.setBuddy(self.combo)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.caption, 1)
        row.addWidget(self.combo)
        self.retranslate()

    @property
    def value(self) -> str:
        """The word chosen."""
        return self.field.choices[self.combo.currentIndex()]

    def fill(self, value: Any) -> None:
        """Show a value."""
        if value in self.field.choices:
            self.combo.setCurrentIndex(self.field.choices.index(value))

    def lock(self, why: str) -> None:
        """Read-only for a reason, or free with ""."""
        self.combo.setEnabled(not why)
        self.combo.setToolTip(why or self.toolTip())


class _Value(_Row):
    """One number."""

    def __init__(self, stage: str, field: ScheduleField) -> None:
        super().__init__(field)
        self.edit = _edit(f"schedule_{stage}_{field.name}")
        self.edit.textEdited.connect(self.changed)
        self.caption.setBuddy(self.edit)
        unit = QLabel(field.unit)
        unit.setFixedWidth(5 * theme.GRID)
        row = QHBoxLayout()
        row.setSpacing(theme.GRID)
        row.addWidget(self.caption, 1)
        row.addWidget(self.edit)
        row.addWidget(unit)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(theme.GRID // 2)
        column.addLayout(row)
        column.addWidget(self.note)
        self.retranslate()

    @property
    def value(self) -> float | int | str | None:
        """A number where it is one; None where nothing is typed."""
        return _number(self.edit.text(), whole=self.field.kind == "count")

    def fill(self, value: Any) -> None:
        """Show a value, nothing for None."""
        self.edit.setText(
            "" if value is None else f"{value:.12g}" if isinstance(value, float) else f"{value}"
        )

    def lock(self, why: str) -> None:
        """Read-only for a reason, or free with ""."""
        self.edit.setEnabled(not why)
        self.edit.setToolTip(why or self.toolTip())
        self.edit.setAccessibleName(self.caption.text())


class _Targets(_Row):
    """One sigma for each group that the stage estimates, in the unit people read."""

    def __init__(self, stage: str, field: ScheduleField, groups: tuple[str, ...]) -> None:
        super().__init__(field)
        self._others: dict[str, Any] = {}
        self._filled: dict[str, tuple[str, float]] = {}
        self._edits = {group: _edit(f"schedule_{stage}_targets_{group}") for group in groups}
        self._captions = {group: QLabel() for group in groups}
        grid = QGridLayout()
        grid.setHorizontalSpacing(theme.GRID)
        grid.setVerticalSpacing(theme.GRID // 2)
        grid.setColumnStretch(0, 1)
        for line, (group, edit) in enumerate(self._edits.items()):
            edit.textEdited.connect(self.changed)
            self._captions[group].setBuddy(edit)
            unit = QLabel(DISPLAY[group][0])
            unit.setFixedWidth(5 * theme.GRID)
            for place, widget in enumerate((self._captions[group], edit, unit)):
                grid.addWidget(widget, line, place)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(theme.GRID // 2)
        column.addWidget(self.caption)
        column.addLayout(grid)
        column.addWidget(self.note)
        self.retranslate()

    @property
    def value(self) -> dict[str, Any]:
        """Sigma by group, SI; targets of single parameters, which this form does not show, as they were."""
        found = dict(self._others)
        for group, edit in self._edits.items():
            number = _number(edit.text())
            text, sigma = self._filled.get(group, ("", 0.0))
            if text and edit.text() == text:
                found[group] = sigma
            elif number is not None:
                found[group] = number * DISPLAY[group][1] if isinstance(number, float) else number
        return found

    def fill(self, value: Any) -> None:
        """Show targets."""
        given: Mapping[str, Any] = value or {}
        self._others = {name: sigma for name, sigma in given.items() if name not in self._edits}
        self._filled.clear()
        for group, edit in self._edits.items():
            text = f"{given[group] / DISPLAY[group][1]:.6g}" if group in given else ""
            if text:
                self._filled[group] = (text, float(given[group]))
            edit.setText(text)

    def lock(self, why: str) -> None:
        """Read-only for a reason, or free with ""."""
        for group, edit in self._edits.items():
            edit.setEnabled(not why)
            edit.setToolTip(why or self.toolTip())
            edit.setAccessibleName(f"{self.caption.text()}: {self._captions[group].text()}")

    def retranslate(self) -> None:
        """Groups' names too."""
        super().retranslate()
        for group, caption in self._captions.items():
            caption.setText(term("group", group))


def _row(stage: str, field: ScheduleField, groups: tuple[str, ...]) -> "_Row | None":
    """A field's line in the form; None for what only the product's file can say."""
    if field.kind == "targets":
        return _Targets(stage, field, groups)
    if field.kind == "flag":
        return _Flag(stage, field)
    if field.kind == "choice":
        return _Choice(stage, field)
    return None if field.kind == "other" else _Value(stage, field)


def _edit(name: str) -> QLineEdit:
    edit = QLineEdit()
    edit.setObjectName(name)
    edit.setAlignment(Qt.AlignmentFlag.AlignRight)
    edit.setFixedWidth(_WIDTH)
    edit.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Fixed)
    return edit


def _number(text: str, whole: bool = False) -> float | int | str | None:
    text = text.strip().replace(",", ".")
    if not text:
        return None
    try:
        number = float(text)
    except ValueError:
        return text
    return int(number) if whole and number.is_integer() else number
