"""The table profile: travel, rate and acceleration limits of all joints, axes and accuracies."""

from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGridLayout, QWidget

from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.fields import Field, Section
from calstation.gui.text import say, with_minus
from calstation.gui.widgets import ThemedPlot, VectorEdit, column, label, row, theme

#: Joints from base to body with their names and the headings of their columns; only a gimbal has a middle joint.
_JOINTS = {
    "outer": ("settings.outer", "settings.outer_axis"),
    "middle": ("settings.middle", "settings.middle_axis"),
    "inner": ("settings.inner", "settings.inner_axis"),
}
_LIMITS = ("low_deg", "high_deg", "max_rate_dps", "max_acceleration_dps2")
_ACCURACY = (
    "encoder_sigma_deg",
    "mount_sigma_deg",
    "azimuth_sigma_deg",
    "base_tilt_sigma_deg",
    "velocity_sigma",
    "velocity_interval_s",
    "axis_offset_mm",
    "axis_offset_sigma_mm",
    "poll_latency_s",
    "poll_jitter_s",
)
_NARROW_WIDTH = 14 * theme.GRID


class TableSection(Section):
    """The section for the joints, the axes and the accuracies of a table profile."""

    def __init__(self, draft: Draft) -> None:
        super().__init__(draft)
        self._file = label(kind="muted", wrap=True)
        self._travel = TravelPlot()
        axes = [Field(draft, (f"{joint}_axis",)) for joint in _JOINTS]
        axes[0].key_paths += ((),)  # a problem of several axes has the key path of the whole file
        self._middle_widgets: list[QWidget] = [axes[1]]
        editors = {"axis_offset_mm": VectorEdit("12")}
        accuracy = [Field(draft, ("accuracy", name), editors.get(name), width=_NARROW_WIDTH) for name in _ACCURACY]
        left = column(label("settings.table", "section"), self._file, self._make_joints(), self._travel, *axes, None)
        right = column(
            label("settings.accuracy", "section"),
            *accuracy,
            Field(draft, ("outer_lever",), width=22 * theme.GRID),
            None,
        )
        row((left, 1), (right, 1), on=self, spacing=theme.GRID)
        self.connect_draft()

    def _make_joints(self) -> QGridLayout:
        """Create the fields for travel, rate and acceleration of all joints, side by side."""
        grid = QGridLayout()
        grid.setHorizontalSpacing(theme.GRID)
        grid.setVerticalSpacing(theme.GRID // 2)
        grid.setColumnStretch(len(_JOINTS) + 1, 1)
        for line, key in enumerate(_LIMITS, start=1):
            caption = label(f"setting.{key}")
            caption.setMinimumHeight(4 * theme.GRID)
            grid.addWidget(caption, line, 0, Qt.AlignmentFlag.AlignTop)
            for number, (joint, (_, heading)) in enumerate(_JOINTS.items(), start=1):
                field = Field(self._draft, (joint, key), width=10 * theme.GRID)
                field.hide_label(heading)
                if key == "high_deg":
                    field.key_paths += ((joint,),)  # a low angle above the high angle is reported once
                grid.addWidget(field, line, number, Qt.AlignmentFlag.AlignTop)
                if joint == "middle":
                    self._middle_widgets.append(field)
        for number, (joint, (_, heading)) in enumerate(_JOINTS.items(), start=1):
            title = label(heading)
            title.setFont(theme.font(bold=True))
            grid.addWidget(title, 0, number)
            if joint == "middle":
                self._middle_widgets.append(title)
        return grid

    def refresh(self) -> None:
        """Show the values of the draft."""

        def ends(joint: str) -> tuple[Any, Any]:
            return self._draft.value((joint, "low_deg")), self._draft.value((joint, "high_deg"))

        is_gimbal = self._draft.value(("middle",)) is not None
        for widget in self._middle_widgets:
            widget.setVisible(is_gimbal)
        names = {joint: name for joint, (name, _) in _JOINTS.items() if is_gimbal or joint != "middle"}
        self._travel.show_travel({say(name): ends(joint) for joint, name in names.items()})
        self._file.setText(say("settings.table_profile", profile=self._draft.name))


class TravelPlot(ThemedPlot):
    """A plot of the travel of the joints as bars on a common scale in degrees."""

    def __init__(self) -> None:
        super().__init__(zoom=False)
        self._travel: dict[str, tuple[Any, Any]] = {}
        self.setMouseEnabled(x=False, y=False)
        for widget in (self, self.viewport()):
            widget.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.hideAxis("bottom")
        theme.themes.changed.connect(self._draw)

    def show_travel(self, travel: dict[str, tuple[Any, Any]]) -> None:
        """Show the low and high angle of each joint by name, degrees; an invalid range has no bar."""
        if travel != self._travel:
            self._travel = travel
            self._draw()

    def _draw(self) -> None:
        travel = self._travel
        self.clear()
        c = theme.colours()
        summaries, reach = [], 0.0
        heights = {name: len(travel) - 1 - number for number, name in enumerate(travel)}
        self.setFixedHeight(11 * theme.GRID * len(travel))
        self.setYRange(-0.6, len(travel) - 0.4, padding=0.0)
        for name, (low, high) in travel.items():
            y, text = heights[name], say("setting.no_travel")
            if isinstance(low, float | int) and isinstance(high, float | int) and low < high:
                reach = max(reach, -low, high)
                text = _span_text(high - low)
                self.addItem(pg.BarGraphItem(x0=low, x1=high, y=y, height=0.3, brush=c.accent, pen=c.accent))
                for angle in (low, high):
                    self._write(with_minus(f"{angle:g}°"), c.text, angle, y - 0.15, above=False)
            self.plot([0.0, 0.0], [y - 0.25, y + 0.25], pen=theme.pen(c.text, 2))
            self._write(text, c.muted, 0.0, y + 0.2, above=True)
            summaries.append(f"{name}: {text}")
        reach = 1.15 * (reach or 180.0)
        self.setXRange(-reach, reach, padding=0.0)
        self.getAxis("left").setTicks([[(y, name) for name, y in heights.items()]])
        self.setAccessibleName("; ".join(summaries))

    def _write(self, text: str, colour: str, x: float, y: float, *, above: bool) -> None:
        item = pg.TextItem(text, color=colour, anchor=(0.5, 1.0 if above else 0.0))
        item.setFont(theme.font())
        item.setPos(x, y)
        self.addItem(item, ignoreBounds=True)


def _span_text(span: float) -> str:
    """Return the text of the total travel of a joint, in degrees."""
    if span >= 720.0:
        return say("setting.travel_turns", turns=round(span / 360.0, 2))
    return say("setting.travel_degrees", degrees=round(span, 3))
