"""Observability of a stage: states down, steps across, and how much better each state is known by then."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPoint, QRectF
from PySide6.QtGui import QHelpEvent
from PySide6.QtWidgets import QToolTip, QWidget

from calstation.gui.engineer.controls import StageCombo
from calstation.gui.text import on_language_change, term
from calstation.gui.widgets import EmptyState, ThemedPlot, column, label, row, scroll_area, theme
from calstation.physics import FloatArray

#: Strength from which a state counts as observable.
OBSERVABLE = 1.0 / 0.9
#: Range of the scale: strengths from 1 to 100 000.
_DECADES = 5
_NAMES_WIDTH, _ROW, _AXIS = 25 * theme.GRID, 13, 5 * theme.GRID


class ObservabilityView(QWidget):
    """The heat map of a stage, and the states that it does not determine."""

    def __init__(self) -> None:
        super().__init__()
        self._stages: Mapping[str, Mapping[str, Any]] = {}
        self._stage_combo = StageCombo("observability_stage_combo")
        self._stage_combo.currentIndexChanged.connect(self._show)
        self._caption = label(lambda: self.tr("Stage"), buddy=self._stage_combo)
        self._lost = label(name="unobservable_label", wrap=True)
        self.map = HeatMap()
        self._scroll = scroll_area(self.map)
        self._empty = EmptyState()
        column(
            row(self._caption, self._stage_combo, 2 * theme.GRID, (self._lost, 1)),
            (self._scroll, 1),
            (self._empty, 1),
            on=self,
            margins=(0, theme.GRID, 0, 0),
        )
        on_language_change(self, self._show_texts)

    def show_stages(self, stages: Mapping[str, Mapping[str, Any]]) -> None:
        """Show the observability of stages, as a result or a preview has it."""
        self._stages = {name: found for name, found in stages.items() if found.get("segments")}
        self._stage_combo.offer(list(self._stages))
        self._show()

    def _show_texts(self) -> None:
        self._empty.say(
            self.tr("No observability to show"),
            self.tr("Only stages solved by the filter report it: the excitation and the azimuth flips."),
        )
        self._show()

    def _show(self) -> None:
        found = self._stages.get(self._stage_combo.stage)
        for widget in (self._scroll, self._caption, self._stage_combo, self._lost):
            widget.setVisible(found is not None)
        self._empty.setVisible(found is None)
        if found is None:
            return
        # The table holds the unit: no observation ever depends on the position error.
        states = {n: state for n, state in found["states"].items() if not n.startswith("position_error")}
        self.map.show_strengths(
            tuple(states),
            tuple(int(segment["step"]) for segment in found["segments"]),
            np.array([state["by_step"] for state in states.values()], dtype=np.float64),
        )
        lost = [name for name, state in states.items() if state["step"] is None]
        self._lost.setText(
            self.tr("Not determined by this stage: {0}").format(", ".join(lost))
            if lost
            else self.tr("Every state is determined by this stage.")
        )


class HeatMap(ThemedPlot):
    """Strengths on a logarithmic colour scale; an unobservable cell is a dot, tooltips give the values."""

    def __init__(self) -> None:
        super().__init__()
        self._names: tuple[str, ...] = ()
        self._steps: tuple[int, ...] = ()
        self._strength: FloatArray = np.empty((0, 0))
        self._image = pg.ImageItem(axisOrder="row-major")
        self._dots = pg.ScatterPlotItem(size=2, pxMode=True, pen=None)
        for item in (self._image, self._dots):
            self.addItem(item)
        colours = pg.colormap.get("viridis")
        bar = pg.ColorBarItem(values=(0, _DECADES), colorMap=colours, interactive=False, width=2 * theme.GRID)
        bar.setImageItem(self._image, insert_in=self.getPlotItem())
        bar.axis.setTicks([[(k, f"{10**k} ×") for k in range(_DECADES + 1)]])
        bar.axis.setStyle(tickFont=theme.font())
        bar.axis.setWidth(11 * theme.GRID)
        self.setMouseEnabled(x=False, y=False)
        self.getViewBox().invertY()
        self.getAxis("left").setWidth(_NAMES_WIDTH)
        self.getAxis("left").setStyle(tickFont=theme.font(11), tickLength=0)

    def show_strengths(self, names: tuple[str, ...], steps: tuple[int, ...], strength: FloatArray) -> None:
        """Show the strengths of named states: prior sigma over the sigma after each step, shape (names, steps)."""
        self._names, self._steps, self._strength = names, steps, strength
        self.setMinimumHeight(_ROW * len(names) + _AXIS)
        lost = strength <= OBSERVABLE
        decades = np.log10(np.maximum(strength, 1.0))
        self._image.setImage(np.where(lost, np.nan, decades), levels=(0.0, _DECADES))
        lines, columns = np.nonzero(lost)
        self._dots.setData(columns + 0.5, lines + 0.5, brush=theme.colours().muted)
        self.getAxis("left").setTicks([[(k + 0.5, self._state_name(name)) for k, name in enumerate(names)]])
        every = 1 + len(steps) // 15
        self.getAxis("bottom").setTicks([[(k + 0.5, str(step)) for k, step in enumerate(steps)][::every]])
        self.setLabel("bottom", self.tr("after step"))
        self.setRange(QRectF(0.0, 0.0, len(steps), len(names)), padding=0.0)

    def centre_of(self, line: int, step: int) -> QPoint:
        """The middle of a cell in the view."""
        centre: QPoint = self.mapFromScene(self.getViewBox().mapViewToScene(pg.Point(step + 0.5, line + 0.5)))
        return centre

    def describe(self, at: QPoint) -> str:
        """The cell at a point of the view in words, "" beside the cells."""
        found = self.getViewBox().mapSceneToView(self.mapToScene(at))
        line, step = int(np.floor(found.y())), int(np.floor(found.x()))
        if not (0 <= line < len(self._names) and 0 <= step < len(self._steps)):
            return ""
        strength = float(self._strength[line, step])
        if strength <= OBSERVABLE:
            text = self.tr("{0} after step {1}: not better known than before")
        else:
            text = self.tr("{0} after step {1}: {2:.3g} times better known than before the stage")
        return str(text.format(self._names[line], self._steps[step], strength))

    def viewportEvent(self, event: QEvent) -> bool:
        """Show a cell's value as the tooltip."""
        if event.type() == QEvent.Type.ToolTip and isinstance(event, QHelpEvent):
            QToolTip.showText(event.globalPos(), self.describe(event.pos()), self)
            return True
        return bool(super().viewportEvent(event))

    def _state_name(self, state: str) -> str:
        """Group and component, such as "gyro bias x"."""
        group, _, component = state.rpartition("_")
        errors = {"attitude_error": self.tr("attitude"), "velocity_error": self.tr("velocity")}
        directions = {"east": self.tr("east"), "north": self.tr("north"), "up": self.tr("up")}
        return f"{errors.get(group) or term('group', group)} {directions.get(component, component)}"
