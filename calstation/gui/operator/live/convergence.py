"""Plot of the ratio of the sigma of each parameter group to its target or limit over device time."""

import time
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QResizeEvent, QShowEvent
from PySide6.QtWidgets import QFrame

from calstation.gui.text import say, term
from calstation.gui.widgets import LineLabel, LineLabels, ThemedPlot, column, label, row, theme
from calstation.physics import DISPLAY

#: Maximum number of points per line; when it is exceeded, every second point is removed.
_MAX_POINTS = 2000
#: Minimum host time between two updates of the plot, s.
_DRAW_INTERVAL = 0.25
#: Ratios that the vertical axis always includes, and its margin, decades.
_RATIOS, _MARGIN = (0.3, 30.0), 0.1


#: Width of the labels, px, and their maximum fraction of the width of the panel.
_LABELS, _LABELS_SHARE = 38 * theme.GRID, 0.52


@dataclass
class Line:
    """Ratio of the sigma of a group to its `target`, SI, over device time, s.

    The target is that of a stage if `own`, otherwise the product's limit.
    """

    target: float
    own: bool = False
    times: list[float] = field(default_factory=list)
    ratios: list[float] = field(default_factory=list)

    @cached_property
    def curve(self) -> pg.PlotCurveItem:
        """The curve, created when its unit is first displayed, because there may be a hundred of them."""
        return pg.PlotCurveItem(skipFiniteCheck=True)

    def add(self, at: float, ratio: float) -> None:
        """Add a point; only the first and the last of several points with the same ratio are stored."""
        if len(self.ratios) > 1 and self.ratios[-1] == self.ratios[-2] == ratio:
            self.times[-1] = at
            return
        self.times.append(at)
        self.ratios.append(ratio)
        if len(self.times) > _MAX_POINTS:
            del self.times[1:-1:2], self.ratios[1:-1:2]

    @property
    def reached(self) -> bool:
        """Whether the sigma has reached its target or limit."""
        return bool(self.ratios) and self.ratios[-1] <= 1.0


class Convergence(QFrame):
    """Plot of the ratio of the sigma of each group to its target or limit over device time, with a dashed line at 1."""

    def __init__(self) -> None:
        super().__init__()
        self.setProperty("kind", "panel")
        #: Lines of the displayed unit, by group.
        self.lines: dict[str, Line] = {}
        #: Lines by slot and group.
        self._all_lines: dict[str, dict[str, Line]] = {}
        #: Device time of the latest point, s, and host time of the latest update, s.
        self._now = self._updated_at = 0.0
        self._plot = ThemedPlot()
        self._plot.getAxis("left").setWidth(7 * theme.GRID)
        box = self._plot.getViewBox()
        box.sigTransformChanged.connect(self._label_lines)
        box.sigResized.connect(self._label_lines)
        self._target = pg.InfiniteLine(0.0, angle=0)
        self._plot.addItem(self._target)
        self._labels, self._title = LineLabels(_LABELS), label(kind="muted")
        column(
            self._title,
            (row((self._plot, 1), self._labels, spacing=0), 1),
            on=self,
            spacing=0,
            margins=(theme.GRID,) * 4,
        )
        theme.on_appearance_change(self, self._refresh)

    def showEvent(self, event: QShowEvent) -> None:
        """Draw the points that were added while the plot was hidden."""
        super().showEvent(event)
        self.draw()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Leave about half of a narrow panel to the curves."""
        super().resizeEvent(event)
        self._labels.setFixedWidth(min(_LABELS, round(_LABELS_SHARE * self.width())))

    def start(
        self, targets: Mapping[str, float], slots: Sequence[str] = ("",), own: Container[str] = frozenset()
    ) -> None:
        """Start a run of the units in `slots`, and show the first unit.

        `targets` are the sigmas to reach by group, SI: targets of stages for the groups in `own`, otherwise limits.
        """
        self._all_lines = {slot: {g: Line(target, g in own) for g, target in targets.items()} for slot in slots}
        self._now = 0.0
        self.show_unit(slots[0])

    def show_unit(self, slot: str) -> None:
        """Show the lines of the unit in a slot."""
        for line in self.lines.values():
            self._plot.removeItem(line.curve)
        self.lines = self._all_lines.get(slot, {})
        for group, line in self.lines.items():
            line.curve.opts["name"] = f"log10 {group}"  # the CSV export shows this name
            self._plot.addItem(line.curve)
        self._refresh()
        self.draw()

    def add(self, at: float, sigma: Mapping[str, float], slot: str = "") -> None:
        """Add the sigmas of a unit by group, SI, at device time `at`, s since the start of the first stage."""
        self._now = max(self._now, at)
        lines = self._all_lines.get(slot, {})
        for group, value in sigma.items():
            line = lines.get(group)
            if line is not None and value > 0.0:
                line.add(self._now, value / line.target)
        if lines is self.lines and self.isVisible() and time.monotonic() - self._updated_at >= _DRAW_INTERVAL:
            self.draw()

    def draw(self) -> None:
        """Update the plot."""
        self._updated_at = time.monotonic()
        ratios = [*_RATIOS, *(ratio for line in self.lines.values() for ratio in line.ratios)]
        low, high = np.log10(min(ratios)) - _MARGIN, np.log10(max(ratios)) + _MARGIN
        for line in self.lines.values():
            if line.times:  # extend the last value to the current time
                times, ratios = [*line.times, self._now], [*line.ratios, line.ratios[-1]]
                line.curve.setData(np.array(times) / 60.0, np.log10(ratios))
        decades = range(int(np.ceil(low)), int(np.floor(high)) + 1)
        self._plot.getAxis("left").setTicks([[(d, f"{10.0**d:g}") for d in decades], []])
        self._plot.setYRange(low, high, padding=0.0)
        self._plot.setXRange(0.0, max(0.1, self._now / 60.0), padding=0.0)
        self._label_lines()

    def _refresh(self) -> None:
        c = theme.colours()
        self._plot.setLabel("bottom", say("operator.axis_time"))
        self._title.setText(say(self._goal[0]))
        self._target.setPen(theme.pen(c.text, 1, Qt.PenStyle.DashLine))
        for line in self.lines.values():
            line.curve.setPen(theme.pen(c.muted, 1))
        self._label_lines()

    @property
    def _goal(self) -> tuple[str, str]:
        """Codes of the plot's title and of the name of the target or limit for the sigmas of the displayed unit."""
        own = {line.own for line in self.lines.values()}
        if len(own) > 1:
            return "operator.sigma_over_target_or_limit", "operator.target_or_limit"
        if True in own:
            return "operator.sigma_over_target", "operator.target"
        return "operator.sigma_over_limit", "operator.limit"

    def _label_lines(self) -> None:
        c = theme.colours()
        labels = [LineLabel(self._height(1.0), say(self._goal[1]), QColor(c.text), bold=True)]
        for group, line in self.lines.items():
            if not line.ratios:
                continue
            unit, size = DISPLAY[group]
            value = line.ratios[-1] * line.target / size
            number = f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"  # the format g would use an exponent
            sigma = say("operator.sigma_of", name=term("group", group), value=number, unit=unit)
            text, colour, state = sigma, c.text, ""
            if line.reached:
                text = say("operator.target_reached" if line.own else "operator.limit_reached", value=sigma)
                colour, state = c.good, "good"
            labels.append(LineLabel(self._height(line.ratios[-1]), text, QColor(colour), state))
        self._labels.show_labels(labels)

    def _height(self, ratio: float) -> float:
        return float(self._plot.getViewBox().mapViewToScene(pg.Point(0.0, float(np.log10(ratio)))).y())
