"""Heat map of the observability of a stage, from a result, a preview or the run in progress."""

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

#: Strength above which a state is observable.
_OBSERVED = 1.0 / OBSERVABLE
#: Range of the colour scale, decades: strengths from 1 to 100 000.
_DECADES = 5
#: Width of the state names, height of a row, and height of the step axis, px.
_NAMES_WIDTH, _ROW, _AXIS = 25 * theme.GRID, 13, 13 * theme.GRID
#: Height of the colour scale, px.
_BAR = 30 * theme.GRID
#: Font size of the names, and minimum width of a step whose name is drawn, px.
_FONT, _STEP_WIDTH = 11, 14

#: Label of a move in the plan.
StepLabel = tuple[str | float, ...]


class StepAxis(pg.AxisItem):  # type: ignore[misc]
    """Axis above the map with vertical names of the steps, which are elided if they are too long."""

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
        """Draw the axis and the names of as many steps as the width permits."""
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
                text = metrics.elidedText(self._names[k], Qt.TextElideMode.ElideRight, length)
                p.drawText(box, Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter, text)


class StageCombo(QComboBox):
    """Combo box of stages that emits `currentIndexChanged` only if the user selects a stage."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.setObjectName(name)
        self.setMinimumWidth(22 * theme.GRID)
        on_language_change(self, self._show_names)

    @property
    def stage(self) -> str:
        """The selected stage; "" if there is none."""
        return str(self.currentData() or "")

    def offer(self, stages: Sequence[str], chosen: str = "") -> None:
        """List the stages and select `chosen`, by default the first one."""
        with QSignalBlocker(self):
            self.clear()
            for stage in stages:
                self.addItem(term("stage", stage), stage)
            self.setCurrentIndex(max(self.findData(chosen), 0))

    def _show_names(self) -> None:
        for index in range(self.count()):
            self.setItemText(index, term("stage", self.itemData(index)))


class ObservabilityView(QWidget):
    """Shows the heat map of a stage and lists the states that the stage does not determine."""

    def __init__(self) -> None:
        super().__init__()
        self._stages: dict[str, Mapping[str, Any]] = {}
        self._labels: Mapping[int, StepLabel] = {}
        #: Latest observability event of each stage of the run in progress; empty for a result or a preview.
        self._live: dict[str, StageRanked] = {}
        self._stage_combo = StageCombo("observability_stage_combo")
        self._stage_combo.currentIndexChanged.connect(self._show)
        self._caption = label("engineer.stage", buddy=self._stage_combo)
        self._unobservable_label = label(name="unobservable_label", wrap=True)
        self.map = HeatMap()
        self._scroll = scroll_area(self.map)
        self._empty = EmptyState(title="engineer.no_observability", text="engineer.about_no_observability")
        column(
            row(self._caption, self._stage_combo, 2 * theme.GRID, (self._unobservable_label, 1)),
            (self._scroll, 1),
            (self._empty, 1),
            on=self,
            margins=(0, theme.GRID, 0, 0),
        )
        theme.on_appearance_change(self, self._show)

    def show_stages(self, stages: Mapping[str, Mapping[str, Any]], labels: Mapping[int, StepLabel] = {}) -> None:
        """Show the observability of stages from a result or a preview; `labels` contains the moves by step."""
        self._live, self._labels = {}, labels
        self._stages = {name: stage for name, stage in stages.items() if stage.get("segments")}
        self._stage_combo.offer(list(self._stages))
        self._show()

    def follow(self, ranked: StageRanked, labels: Mapping[int, StepLabel] = {}) -> None:
        """Add the observability after a step of the run in progress; the first step clears the previous contents."""
        self._labels = labels
        if not self._live:
            self._stages = {}
        stage, step = ranked.stage, ranked.step
        before: Mapping[str, Any] = self._stages.get(stage, {"segments": [], "states": {}})
        count = sum(segment["step"] < step for segment in before["segments"])  # a later event replaces the same step
        states = {}
        for name, strength in ranked.strength.items():
            earlier = before["states"].get(name, {"step": None, "by_step": []})
            observed = earlier["step"] if earlier["step"] is not None else step if strength > _OBSERVED else None
            states[name] = {"step": observed, "by_step": [*earlier["by_step"][:count], strength]}
        self._stages[stage] = {"segments": [*before["segments"][:count], {"step": step}], "states": states}
        if stage not in self._live:
            self._stage_combo.offer(list(self._stages), stage)
        self._live[stage] = ranked
        if self._stage_combo.stage == stage:
            self._show()

    def _show(self) -> None:
        stage = self._stages.get(self._stage_combo.stage)
        for widget in (self._scroll, self._caption, self._stage_combo, self._unobservable_label):
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
        unobservable = [self.map.state_name(name) for name, state in states.items() if state["step"] is None]
        if (ranked := self._live.get(self._stage_combo.stage)) is not None:
            code = "engineer.observed_so_far" if unobservable else "engineer.observed_all"
            text = say(code, step=ranked.step, rank=ranked.rank, lost=unobservable)
        elif unobservable:
            text = say("engineer.not_determined", states=", ".join(unobservable))
        else:
            text = say("engineer.all_determined")
        self._unobservable_label.setText(text)


class HeatMap(ThemedPlot):
    """Heat map of strengths on a logarithmic colour scale; dots mark unobservable states, tooltips show values."""

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
        bar.axis.setTicks([[(k, f"{10**k}") for k in range(_DECADES)]])  # a label at the top would be cut off
        bar.axis.setStyle(tickFont=theme.font())
        bar.axis.setWidth(11 * theme.GRID)
        bar.setFixedHeight(_BAR)  # so that a small window shows it without scrolling
        self.getPlotItem().layout.setAlignment(bar, Qt.AlignmentFlag.AlignTop)
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
        """Show the strengths of states.

        Parameters
        ----------
        names, steps
            Names of the states, and numbers of the steps.
        strength
            Prior sigma divided by the sigma after each step, shape (names, steps).
        labels
            Labels of the moves by step.
        """
        self._names, self._steps, self._strength, self._labels = names, steps, strength, labels
        self.setMinimumHeight(_ROW * len(names) + _AXIS)
        unobservable = strength <= _OBSERVED
        decades = np.log10(np.maximum(strength, 1.0))
        self._image.setImage(np.where(unobservable, np.nan, decades), levels=(0.0, _DECADES))
        lines, columns = np.nonzero(unobservable)
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
        """Write the strengths to a CSV file with a row for each state and a column for each step."""
        with target.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["state", *self._steps])
            writer.writerows([name, *row] for name, row in zip(self._names, self._strength.tolist(), strict=True))

    def describe(self, at: QPoint) -> str:
        """Return a description of the cell, or of the step on the axis, at a point of the view; "" elsewhere."""
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
        """Show the description of a cell or step as a tooltip."""
        if event.type() == QEvent.Type.ToolTip and isinstance(event, QHelpEvent):
            QToolTip.showText(event.globalPos(), self.describe(event.pos()), self)
            return True
        return bool(super().viewportEvent(event))

    def state_name(self, state: str) -> str:
        """Return the display name of a state, such as "gyro bias x"."""
        group, _, component = state.rpartition("_")
        error, direction = f"engineer.error_{group.removesuffix('_error')}", f"engineer.direction_{component}"
        name = say(error) if known(error) else term("group", group)
        return f"{name} {say(direction) if known(direction) else component}"
