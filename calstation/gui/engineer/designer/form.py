"""Form for the goal and limits of a search for a schedule, the head of its result, and its export to a file."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFrame, QWidget

from calstation.config import ScheduleOptions, editing, library
from calstation.gui.text import Words, bind, product_text, say, station_text
from calstation.gui.widgets import (
    FormField,
    FormValues,
    NameBar,
    SpinEdit,
    StateBadge,
    ask_file,
    box,
    button,
    column,
    combo_box,
    enable,
    label,
    row,
    show_text,
    theme,
)
from calstation.messages import Text

if TYPE_CHECKING:
    from calstation.designer import Design, DesignRequest, TemperatureDesign

#: Assumed time constant of a unit, s, as in `calstation.designer`, whose import would delay the first paint.
TIME_CONSTANT = 600.0
#: Goals of a search.
SHORTEST, GIVEN_TIME, AS_PRESENT = "shortest", "given_time", "as_present"

_GOALS = {
    SHORTEST: "engineer.goal_shortest",
    GIVEN_TIME: "engineer.goal_smallest_sigma",
    AS_PRESENT: "engineer.goal_as_good",
}


class DesignForm(QFrame):
    """Inputs for the goal, margin or duration, search time, speeds and seed; the button calls `begin`."""

    #: Emitted when `conditions` may have changed.
    changed = Signal()

    def __init__(self, begin: Callable[[], None]) -> None:
        super().__init__()
        self.setProperty("kind", "panel")
        self._goal = combo_box("design_goal_combo", _GOALS)
        self._goal.currentIndexChanged.connect(lambda _: self._show_goal())
        self._source = source = FormValues(
            {"margin": 0.8, "minutes": 5.0, "search": 0.0, "rate": 0.0, "acceleration": 0.0, "seed": 0.0}
            | {"time_constant": TIME_CONSTANT, "self_heating": 0.0}
        )
        self._margin = _SpinField(source, "margin", SpinEdit(0.05, 1.0, 0.05, 2), "engineer.margin")
        self._minutes = _SpinField(
            source, "minutes", SpinEdit(0.5, 60.0, 0.5, 1), "engineer.duration_minutes", "engineer.duration_tip"
        )
        self._search = _SpinField(
            source, "search", SpinEdit(0.0, 3600.0, 10.0, 0), "engineer.search_seconds", zero="engineer.usual"
        )
        self._speeds = {
            name: _SpinField(
                source, name, SpinEdit(0.0, 1000.0, 1.0, 1), f"engineer.{name}_field", zero="engineer.automatic"
            )
            for name in ("rate", "acceleration")
        }
        seed = _SpinField(source, "seed", SpinEdit(0.0, 9999.0, 1.0, 0), "engineer.seed")
        #: Thermal properties of the unit in the chamber, for a design over temperature.
        self._thermal_fields = (
            _SpinField(source, "time_constant", SpinEdit(1.0, 20_000.0, 10.0, 0), "engineer.time_constant_field"),
            _SpinField(source, "self_heating", SpinEdit(0.0, 50.0, 0.5, 1), "engineer.self_heating_field"),
        )
        self._thermal = box(row(*self._thermal_fields, None, spacing=2 * theme.GRID))
        self._thermal.hide()
        self._fields = (self._margin, self._minutes, self._search, *self._speeds.values(), seed)
        for field in (*self._fields, *self._thermal_fields):
            field.checked.connect(self.changed)
        self.button = button("design_button", "engineer.design", begin, kind="primary")
        advanced = box(row(*self._speeds.values(), seed, None, spacing=2 * theme.GRID))
        advanced.hide()
        advanced_button = button("design_more_button", "engineer.advanced")
        advanced_button.setCheckable(True)
        advanced_button.toggled.connect(advanced.setVisible)
        self._reason = label(kind="muted", name="design_reason_label", wrap=True)
        self._product = ""
        self._caption = label(self._goal_text, buddy=self._goal)
        goal_box = column(self._caption, self._goal, spacing=0)
        buttons = column(None, row(advanced_button, self.button))
        column(
            row((goal_box, 1), self._margin, self._minutes, self._search, buttons, spacing=2 * theme.GRID),
            self._thermal,
            advanced,
            self._reason,
            on=self,
            margins=(2 * theme.GRID, theme.GRID // 2, theme.GRID, theme.GRID),
        )
        source.changed.connect(self.changed)
        self._show_goal()

    @property
    def goal(self) -> str:
        """The selected goal."""
        return str(self._goal.currentData())

    def offer(self, options: ScheduleOptions) -> None:
        """Show the name of the product, and limit the speeds to those of the table."""
        self._product = options.name
        self._caption.setText(self._goal_text())
        if options.over_temperature:
            self._goal.setCurrentIndex(list(_GOALS).index(SHORTEST))
        self._goal.setEnabled(not options.over_temperature)
        self._thermal.setVisible(options.over_temperature)
        self._search.setVisible(not options.over_temperature)
        for name, most in (("rate", options.rate), ("acceleration", options.acceleration)):
            spin = self._speeds[name].spin
            spin.setMaximum(most)
            spin.setValue(spin.value())

    @property
    def conditions(self) -> tuple[object, ...]:
        """The goal, the problem and the values on which a design depends, except those that only control the search."""
        values = self._source.values
        bound = {SHORTEST: ("margin",), GIVEN_TIME: ("minutes",)}.get(self.goal, ())
        names = (*bound, "rate", "acceleration", "time_constant", "self_heating")
        return self.goal, self.problem, *(values[name] for name in names)

    @property
    def problem(self) -> str:
        """Why an entered number is not accepted, or ""."""
        fields = [*self._fields, *(() if self._thermal.isHidden() else self._thermal_fields)]
        wrong = next((field for field in fields if field.spin.wrong and not field.isHidden()), None)
        return "" if wrong is None else say("common.named", name=wrong.label.text(), text=say(wrong.problem))

    @property
    def unit(self) -> tuple[float, float]:
        """Time constant, s, and self-heating, K, of a unit in the chamber."""
        return self._source.values["time_constant"], self._source.values["self_heating"]

    def lock(self, reason: str, *, visible: bool) -> None:
        """Disable the button for a reason or a rejected number, and show the reason below the form if `visible`."""
        enable(self.button, reason or self.problem, say("engineer.design_tip"))
        show_text(self._reason, reason if visible else "")

    def request(self, station: Path | None, product: Path, stop: Path) -> "DesignRequest":
        """Return the request of a search; it ends when the file `stop` is created."""
        from calstation.designer import DesignRequest  # a global import would delay the first paint

        goal, values = self.goal, self._source.values
        return DesignRequest(
            station=station,
            product=product,
            margin=1.0 if goal == AS_PRESENT else values["margin"],
            duration=60.0 * values["minutes"] if goal == GIVEN_TIME else None,
            as_present=goal == AS_PRESENT,
            time_limit=values["search"] or None,
            seed=round(values["seed"]),
            rate_dps=values["rate"] or None,
            acceleration_dps2=values["acceleration"] or None,
            stop=stop,
        )

    def _goal_text(self) -> str:
        return say("engineer.goal_for", product=product_text(self._product)) if self._product else say("engineer.goal")

    def _show_goal(self) -> None:
        for field, goal in ((self._margin, SHORTEST), (self._minutes, GIVEN_TIME)):
            field.setVisible(self.goal == goal)
        self.changed.emit()


class _SpinField(FormField):
    """Label and input of a number between limits; the text `zero` is shown for 0."""

    #: Emitted when `problem` may have changed.
    checked = Signal()

    def __init__(
        self, source: FormValues, name: str, spin: SpinEdit, words: Words, tip: Words = "", zero: Words = ""
    ) -> None:
        self.spin = spin
        super().__init__(source, (name,), spin, words, f"design_{name}_spin")
        self.grid.setVerticalSpacing(0)
        self.grid.addWidget(self.label, 0, 0)
        self.grid.addWidget(spin, 1, 0)
        self.grid.addWidget(self.message, 2, 0)
        self.grid.setRowStretch(3, 1)  # fields in a row stay aligned if one has a message
        self.label.setWordWrap(False)
        bind(spin.setToolTip, tip or f"engineer.{name}_tip")
        if zero:
            bind(spin.setSpecialValueText, zero)
        spin.rejected.connect(lambda _: self.refresh())
        spin.rejected.connect(lambda _: self.checked.emit())

    @property
    def problem(self) -> Words:
        """Why the entered text is not accepted, or ""."""
        spin = self.spin
        if not spin.wrong:
            return ""
        low, high, step = (f"{x:g}" for x in (spin.minimum(), spin.maximum(), 10.0 ** -spin.decimals()))
        return Text.of("engineer.number_not_accepted", typed=spin.wrong, low=low, high=high, step=step)

    def refresh(self) -> None:
        """Show the value, and why an entered text is not accepted."""
        self.refusal = self.problem
        super().refresh()


class SaveBar(NameBar):
    """Asks for the name of a new product; its button calls `save` with the name."""

    def __init__(self, save: Callable[[str], None]) -> None:
        self._save, self._source = save, ""
        names = ("design_name_edit", "save_design_button", "cancel_save_design_button")
        super().__init__(names, label("engineer.product_name"), "common.save")

    def ask(self, source: str) -> None:
        """Ask for the name of a product derived from the product `source`; names have no file suffix."""
        self._source = source
        base, present, number = f"{source.removesuffix('_fast')}_fast", library.names("products"), 1
        name = base
        while name in present:
            number += 1
            name = f"{base}-{number}"
        self.ask_name(name)

    def problem(self, name: str) -> str:
        """Return why a name is not allowed, or "" if it is allowed."""
        if not editing.is_name(name):
            return say("engineer.name_rule")
        return say("engineer.other_name") if name == self._source else ""

    def remark(self, name: str) -> str:
        """Return a remark if a product with this name already exists, otherwise ""."""
        return say("engineer.design_name_taken", name=name) if name in library.names("products") else ""

    def accept(self, name: str) -> None:
        """Save the design."""
        self.hide()
        self._save(name)


class ResultHead(QWidget):
    """The state of a design, or why it is out of date, and a headline that names its product and station."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self._state, self._outdated = ("none", ""), ""
        self._badge = StateBadge()
        self._headline = label(kind="section", name=name, wrap=True)
        self._note = label(kind="caution", wrap=True)
        column(row(self._badge, (self._headline, 1), spacing=2 * theme.GRID), self._note, on=self, spacing=0)

    def show_design(self, state: tuple[str, str], options: ScheduleOptions, text: str) -> None:
        """Show the state of a design (shape and text of the badge) and its headline, with the names in `options`."""
        name = say("engineer.design_of", product=product_text(options.name), station=station_text(options.station))
        first, *more = text.split("\n")
        self._state = state
        self._headline.setText("\n".join([say("common.named", name=name, text=first), *more]))
        self.set_outdated(self._outdated)

    def set_outdated(self, why: str) -> None:
        """Show that the design is out of date for the given reason; "" shows its state."""
        self._outdated = why
        self._badge.show_state(*(("waiting", say("engineer.preview_outdated")) if why else self._state))
        show_text(self._note, why)


def export_design(parent: QWidget, design: "Design | TemperatureDesign", options: ScheduleOptions) -> None:
    """Ask for a file, and write a design for the product of `options` to it as JSON."""
    text = json.dumps(design.to_json(), indent=1, ensure_ascii=False) + "\n"
    write = partial(Path.write_text, data=text, encoding="utf-8")
    ask_file(parent, say("engineer.save_design"), Path(f"{options.product.stem}_design.json"), ["JSON (*.json)"], write)
