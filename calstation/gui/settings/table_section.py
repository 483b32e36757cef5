"""The table profile: travel, rate and acceleration limits of both joints, axes and accuracies."""

from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGridLayout

from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.fields import Field, Section
from calstation.gui.text import say, with_minus
from calstation.gui.widgets import ThemedPlot, VectorEdit, column, label, row, theme

_JOINTS = ("outer", "inner")
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
        axes = [Field(draft, (name,)) for name in ("outer_axis", "inner_axis")]
        axes[0].key_paths += ((),)  # a problem of both axes has the key path of the whole file
        editors = {"axis_offset_mm": VectorEdit("12")}
        accuracy = [Field(draft, ("accuracy", name), editors.get(name), width=_NARROW_WIDTH) for name in _ACCURACY]
        left = column(label("settings.table", "section"), self._file, self._make_joints(), self._travel, *axes, None)
        right = column(
            label("settings.accuracy", "section"),
            *accuracy,
            Field(draft, ("outer_lever",), width=22 * theme.GRID),
            None,
        )
        row((left, 1), (right, 1), on=self, spacing=3 * theme.GRID)
        self.connect_draft()

    def _make_joints(self) -> QGridLayout:
        """Create the fields for travel, rate and acceleration of both joints, side by side."""
        headings = "settings.outer_axis", "settings.inner_axis"
        grid = QGridLayout()
        grid.setHorizontalSpacing(2 * theme.GRID)
        grid.setVerticalSpacing(theme.GRID // 2)
        grid.setColumnStretch(3, 1)
        for line, key in enumerate(_LIMITS, start=1):
            caption = label(f"setting.{key}")
            caption.setMinimumHeight(4 * theme.GRID)
            grid.addWidget(caption, line, 0, Qt.AlignmentFlag.AlignTop)
            for number, (joint, heading) in enumerate(zip(_JOINTS, headings, strict=True), start=1):
                field = Field(self._draft, (joint, key), width=_NARROW_WIDTH)
                field.hide_label(heading)
                if key == "high_deg":
                    field.key_paths += ((joint,),)  # a low angle above the high angle is reported once
                grid.addWidget(field, line, number, Qt.AlignmentFlag.AlignTop)
        for number, heading in enumerate(headings, start=1):
            title = label(heading)
            title.setFont(theme.font(bold=True))
            grid.addWidget(title, 0, number)
        return grid

    def refresh(self) -> None:
        """Show the values of the draft."""

        def ends(joint: str) -> tuple[Any, Any]:
            return self._draft.value((joint, "low_deg")), self._draft.value((joint, "high_deg"))

        self._travel.show_travel({say("settings.outer"): ends("outer"), say("settings.inner"): ends("inner")})
        self._file.setText(say("settings.table_profile", profile=self._draft.name))


class TravelPlot(ThemedPlot):
    """A plot of the travel of both joints as bars on a common scale in degrees."""

    def __init__(self) -> None:
        super().__init__(zoom=False)
        self._travel: dict[str, tuple[Any, Any]] = {}
        self.setFixedHeight(22 * theme.GRID)
        self.setMouseEnabled(x=False, y=False)
        for widget in (self, self.viewport()):
            widget.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.hideAxis("bottom")
        self.setYRange(-0.6, 1.6, padding=0.0)
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
        heights = {name: 1 - number for number, name in enumerate(travel)}
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
