"""Observability of a stage as a heat map of states over steps, from a result, a preview or the run in progress."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPoint, QRectF, QSignalBlocker, Qt
from PySide6.QtGui import QColor, QFontMetricsF, QHelpEvent, QPainter
from PySide6.QtWidgets import QComboBox, QToolTip, QWidget

from calstation.gui.text import on_language_change, say, step_sentence, term
from calstation.gui.widgets import EmptyState, ThemedPlot, column, label, row, scroll_area, theme
from calstation.messages import known, short_step_text
from calstation.physics import OBSERVABLE, FloatArray
from calstation.sequencer import StageRanked

#: Strength above which a state counts as observable.
_OBSERVED = 1.0 / OBSERVABLE
#: Range of the colour scale in decades: strengths from 1 to 100 000.
_DECADES = 5
_NAMES_WIDTH, _ROW, _AXIS = 25 * theme.GRID, 13, 13 * theme.GRID
#: Font size of states and steps, and smallest width of a step with a name, px.
_FONT, _STEP_WIDTH = 11, 14

#: Label of a move, from the plan.
StepLabel = tuple[str | float, ...]


class StepAxis(pg.AxisItem):  # type: ignore[misc]
    """The axis above a map, with vertical step names, elided if they are too long."""

    def __init__(self) -> None:
        super().__init__("top", showValues=False)
        self.setHeight(_AXIS)
        self._names: list[str] = []

    def set_names(self, names: Sequence[str]) -> None:
        """Set the names of the steps; the first is centred at x = 0.5."""
        self._names = list(names)
        self.picture = None
        self.update()

    def drawPicture(self, p: QPainter, axisSpec: Any, tickSpecs: Any, textSpecs: Any) -> None:
        """Draw the axis, and the names of as many steps as the width permits."""
        super().drawPicture(p, axisSpec, [], [])
        low, high = self.range
        step = self.size().width() / (high - low)
        font = theme.font(_FONT)
        metrics, length = QFontMetricsF(font), _AXIS - 20
        p.setFont(font)
        p.setPen(self.textPen())
        p.rotate(-90.0)
        for k in range(0, len(self._names), max(1, int(np.ceil(_STEP_WIDTH / step)))):
            centre = (k + 0.5 - low) * step
            if 0.0 <= centre <= self.size().width():
                centre = min(max(centre, _STEP_WIDTH / 2), self.size().width() - _STEP_WIDTH / 2)  # not beyond the axis
                box = QRectF(4.0 - _AXIS, centre - _STEP_WIDTH, length, 2 * _STEP_WIDTH)
                shown = metrics.elidedText(self._names[k], Qt.TextElideMode.ElideRight, length)
                p.drawText(box, Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter, shown)


class StageCombo(QComboBox):
    """Combo box of stages that emits `currentIndexChanged` only for a selection by the user."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.setObjectName(name)
        self.setMinimumWidth(22 * theme.GRID)
        on_language_change(self, self._show_names)

    @property
    def stage(self) -> str:
        """The selected stage, "" if there is none."""
        return str(self.currentData() or "")

    def offer(self, stages: Sequence[str], chosen: str = "") -> None:
        """Offer stages and select one, by default the first."""
        with QSignalBlocker(self):
            self.clear()
            for stage in stages:
                self.addItem(term("stage", stage), stage)
            self.setCurrentIndex(max(self.findData(chosen), 0))

    def _show_names(self) -> None:
        for index in range(self.count()):
            self.setItemText(index, term("stage", self.itemData(index)))


class ObservabilityView(QWidget):
    """Heat map of a stage's observability, with a list of the states that the stage does not determine."""

    def __init__(self) -> None:
        super().__init__()
        self._stages: dict[str, Mapping[str, Any]] = {}
        self._labels: Mapping[int, StepLabel] = {}
        #: Latest observability analysis of each stage of the monitored run; empty for a result or a preview.
        self._live: dict[str, StageRanked] = {}
        self._stage_combo = StageCombo("observability_stage_combo")
        self._stage_combo.currentIndexChanged.connect(self._show)
        self._caption = label("engineer.stage", buddy=self._stage_combo)
        self._lost = label(name="unobservable_label", wrap=True)
        self.map = HeatMap()
        self._scroll = scroll_area(self.map)
        self._empty = EmptyState(title="engineer.no_observability", text="engineer.about_no_observability")
        column(
            row(self._caption, self._stage_combo, 2 * theme.GRID, (self._lost, 1)),
            (self._scroll, 1),
            (self._empty, 1),
            on=self,
            margins=(0, theme.GRID, 0, 0),
        )
        theme.on_appearance_change(self, self._show)

    def show_stages(self, stages: Mapping[str, Mapping[str, Any]], labels: Mapping[int, StepLabel] = {}) -> None:
        """Show the observability of stages from a result or a preview; `labels` names the moves by step."""
        self._live, self._labels = {}, labels
        self._stages = {name: stage for name, stage in stages.items() if stage.get("segments")}
        self._stage_combo.offer(list(self._stages))
        self._show()

    def follow(self, ranked: StageRanked, labels: Mapping[int, StepLabel] = {}) -> None:
        """Add the observability after a step of the running stage; the first call clears the previous contents."""
        self._labels = labels
        if not self._live:
            self._stages = {}
        stage, step = ranked.stage, ranked.step
        before: Mapping[str, Any] = self._stages.get(stage, {"segments": [], "states": {}})
        kept = sum(segment["step"] < step for segment in before["segments"])  # the latest step may still grow
        states = {}
        for name, strength in ranked.strength.items():
            earlier = before["states"].get(name, {"step": None, "by_step": []})
            seen = earlier["step"] if earlier["step"] is not None else step if strength > _OBSERVED else None
            states[name] = {"step": seen, "by_step": [*earlier["by_step"][:kept], strength]}
        self._stages[stage] = {"segments": [*before["segments"][:kept], {"step": step}], "states": states}
        if stage not in self._live:
            self._stage_combo.offer(list(self._stages), stage)
        self._live[stage] = ranked
        if self._stage_combo.stage == stage:
            self._show()

    def _show(self) -> None:
        stage = self._stages.get(self._stage_combo.stage)
        for widget in (self._scroll, self._caption, self._stage_combo, self._lost):
            widget.setVisible(stage is not None)
        self._empty.setVisible(stage is None)
        if stage is None:
            return
        # The unit is fixed to the table, so no observation depends on the position error.
        states = {n: state for n, state in stage["states"].items() if not n.startswith("position_error")}
        self.map.show_strengths(
            tuple(states),
            tuple(int(segment["step"]) for segment in stage["segments"]),
            np.array([state["by_step"] for state in states.values()], dtype=np.float64),
            self._labels,
        )
        self.map.setLabel("top", say("engineer.after_step", stage=self._stage_combo.stage))
        lost = [self.map.state_name(name) for name, state in states.items() if state["step"] is None]
        if (ranked := self._live.get(self._stage_combo.stage)) is not None:
            code = "engineer.observed_so_far" if lost else "engineer.observed_all"
            self._lost.setText(say(code, step=ranked.step, rank=ranked.rank, lost=lost))
            return
        self._lost.setText(
            say("engineer.not_determined", states=", ".join(lost)) if lost else say("engineer.all_determined")
        )


class HeatMap(ThemedPlot):
    """Strengths on a logarithmic colour scale; a dot marks an unobservable cell, and tooltips show the values."""

    def __init__(self) -> None:
        super().__init__()
        self._axis = StepAxis()
        self.getPlotItem().setAxisItems({"top": self._axis})
        self.hideAxis("bottom")
        self._names: tuple[str, ...] = ()
        self._steps: tuple[int, ...] = ()
        self._labels: Mapping[int, StepLabel] = {}
        self._strength: FloatArray = np.empty((0, 0))
        self._image = pg.ImageItem(axisOrder="row-major")
        self._dots = pg.ScatterPlotItem(size=2, pxMode=True, pen=None)
        for item in (self._image, self._dots):
            self.addItem(item)
        colours = pg.colormap.get("viridis")
        bar = pg.ColorBarItem(values=(0, _DECADES), colorMap=colours, interactive=False, width=2 * theme.GRID)
        self._scale = bar.axis
        bar.setImageItem(self._image, insert_in=self.getPlotItem())
        bar.axis.setTicks([[(k, f"{10**k}") for k in range(_DECADES)]])  # the top label would be cut off
        bar.axis.setStyle(tickFont=theme.font())
        bar.axis.setWidth(11 * theme.GRID)
        self.getViewBox().invertY()
        self.getAxis("left").setWidth(_NAMES_WIDTH)
        self.getAxis("left").setStyle(tickFont=theme.font(_FONT), tickLength=0)
        for axis in (self._axis, self._scale):
            axis.label.setFont(theme.font())

    def show_strengths(
        self,
        names: tuple[str, ...],
        steps: tuple[int, ...],
        strength: FloatArray,
        labels: Mapping[int, StepLabel] = {},
    ) -> None:
        """Show the strengths of states: prior sigma divided by the sigma after each step, shape (names, steps)."""
        self._names, self._steps, self._strength, self._labels = names, steps, strength, labels
        self.setMinimumHeight(_ROW * len(names) + _AXIS)
        lost = strength <= _OBSERVED
        decades = np.log10(np.maximum(strength, 1.0))
        self._image.setImage(np.where(lost, np.nan, decades), levels=(0.0, _DECADES))
        lines, columns = np.nonzero(lost)
        self._dots.setData(columns + 0.5, lines + 0.5, brush=theme.colours().muted)
        self.getAxis("left").setTicks([[(k + 0.5, self.state_name(name)) for k, name in enumerate(names)]])
        short = {step: f"  {say(short_step_text(labels[step]))}" if step in labels else "" for step in steps}
        self._axis.set_names([f"{step}{short[step]}" for step in steps])
        self._scale.setLabel(say("engineer.sigma_ratio"))
        for axis in (self._axis, self._scale):
            axis.setPen(QColor(theme.colours().line))
            axis.setTextPen(QColor(theme.colours().text))
        self.setXRange(0.0, len(steps), padding=0.0)
        self.setYRange(0.0, len(names), padding=0.0)

    def write_csv(self, target: Path) -> None:
        """Write the strengths, one row per state and one column per step."""
        with target.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["state", *self._steps])
            writer.writerows([name, *row] for name, row in zip(self._names, self._strength.tolist(), strict=True))

    def describe(self, at: QPoint) -> str:
        """Return a description of the cell, or of the step on the axis, at a point of the view, "" elsewhere."""
        scene = self.mapToScene(at)
        at_view = self.getViewBox().mapSceneToView(scene)
        line, step = int(np.floor(at_view.y())), int(np.floor(at_view.x()))
        if not 0 <= step < len(self._steps):
            return ""
        number = self._steps[step]
        move = ""
        if number in self._labels:
            move = say("engineer.step", number=number, move=step_sentence("move", self._labels[number]))
        if self._axis.sceneBoundingRect().contains(scene):
            return move
        if not 0 <= line < len(self._names):
            return ""
        strength = float(self._strength[line, step])
        code = "engineer.state_not_better" if strength <= _OBSERVED else "engineer.state_better"
        text = say(code, state=self.state_name(self._names[line]), step=number, times=strength)
        return "\n".join(filter(None, (text, move)))

    def viewportEvent(self, event: QEvent) -> bool:
        """Show the description of a cell or step as the tooltip."""
        if event.type() == QEvent.Type.ToolTip and isinstance(event, QHelpEvent):
            QToolTip.showText(event.globalPos(), self.describe(event.pos()), self)
            return True
        return bool(super().viewportEvent(event))

    def state_name(self, state: str) -> str:
        """Return the group and component of a state, such as "gyro bias x"."""
        group, _, component = state.rpartition("_")
        error, direction = f"engineer.error_{group.removesuffix('_error')}", f"engineer.direction_{component}"
        name = say(error) if known(error) else term("group", group)
        return f"{name} {say(direction) if known(direction) else component}"
