"""Observability of a stage: states down, steps across, and how much better each state is known by then."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPoint, QRect, QRectF, QSignalBlocker, QSize, Qt
from PySide6.QtGui import QColor, QHelpEvent, QPainter, QPaintEvent
from PySide6.QtWidgets import QComboBox, QFrame, QScrollArea, QSizePolicy, QToolTip, QWidget

from calstation.gui.engineer.innovations_view import name_stages
from calstation.gui.text import on_language_change, term
from calstation.gui.widgets import EmptyState, column, label, row, theme
from calstation.physics import FloatArray

#: Strength from which a state counts as observable.
OBSERVABLE = 1.0 / 0.9
#: Range of the scale: strengths from 1 to 100 000.
_DECADES = 5
_NAMES_WIDTH, _ROW, _AXIS = 25 * theme.GRID, 13, 3 * theme.GRID
_SCALE_WIDTH = 14 * theme.GRID


class ObservabilityView(QWidget):
    """The heat map of a stage, and the states that it does not determine."""

    def __init__(self) -> None:
        super().__init__()
        self._stages: Mapping[str, Mapping[str, Any]] = {}
        self._stage_combo = QComboBox()
        self._stage_combo.setObjectName("observability_stage_combo")
        self._stage_combo.setMinimumWidth(22 * theme.GRID)
        self._stage_combo.currentIndexChanged.connect(self._show)
        self._caption = label(lambda: self.tr("Stage"))
        self._caption.setBuddy(self._stage_combo)
        self._lost = label(name="unobservable_label", wrap=True)
        self.map = HeatMap()
        self._scroll = QScrollArea()
        self._scroll.setWidgetResizable(True)
        self._scroll.setFrameShape(QFrame.Shape.NoFrame)
        self._scroll.setWidget(self.map)
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
        with QSignalBlocker(self._stage_combo):
            self._stage_combo.clear()
            for name in self._stages:
                self._stage_combo.addItem("", name)
        self._show_texts()

    def _show_texts(self) -> None:
        name_stages(self._stage_combo)
        self._empty.say(
            self.tr("No observability to show"),
            self.tr("Only stages solved by the filter report it: the excitation and the azimuth flips."),
        )
        self._show()

    def _show(self) -> None:
        found = self._stages.get(str(self._stage_combo.currentData()))
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


class HeatMap(QWidget):
    """Strengths on a logarithmic colour scale; an unobservable cell is a dot, tooltips give the values."""

    def __init__(self) -> None:
        super().__init__()
        self._names: tuple[str, ...] = ()
        self._steps: tuple[int, ...] = ()
        self._strength: FloatArray = np.empty((0, 0))
        self._colours = pg.colormap.get("viridis")
        self.setMouseTracking(True)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.MinimumExpanding)

    def show_strengths(self, names: tuple[str, ...], steps: tuple[int, ...], strength: FloatArray) -> None:
        """Show a picture.

        Parameters
        ----------
        names : states
        steps : their numbers in the stage
        strength : ndarray, shape (names, steps), prior sigma over the sigma after the step
        """
        self._names, self._steps, self._strength = names, steps, strength
        self.setMinimumHeight(self.minimumSizeHint().height())
        self.updateGeometry()
        self.update()

    def minimumSizeHint(self) -> QSize:
        """Rows high enough to tell apart."""
        return QSize(_NAMES_WIDTH + _SCALE_WIDTH + 4 * len(self._steps), _ROW * len(self._names) + _AXIS)

    def cell(self, line: int, step: int) -> QRectF:
        """The rectangle of a cell."""
        width = (self.width() - _NAMES_WIDTH - _SCALE_WIDTH) / max(len(self._steps), 1)
        height = (self.height() - _AXIS) / max(len(self._names), 1)
        return QRectF(_NAMES_WIDTH + step * width, line * height, width, height)

    def cell_at(self, at: QPoint) -> tuple[int, int] | None:
        """Line and step of the cell at a point, None beside the cells."""
        first = self.cell(0, 0)
        line = int(at.y() // first.height())
        step = int((at.x() - first.left()) // first.width())
        inside = 0 <= line < len(self._names) and 0 <= step < len(self._steps)
        return (line, step) if inside else None

    def describe(self, line: int, step: int) -> str:
        """The value of a cell in words."""
        strength = float(self._strength[line, step])
        if strength <= OBSERVABLE:
            text = self.tr("{0} after step {1}: not better known than before")
        else:
            text = self.tr("{0} after step {1}: {2:.3g} times better known than before the stage")
        return text.format(self._names[line], self._steps[step], strength)

    def event(self, event: QEvent) -> bool:
        """Show a cell's value as the tooltip."""
        if event.type() == QEvent.Type.ToolTip and isinstance(event, QHelpEvent):
            found = self.cell_at(event.pos())
            QToolTip.showText(event.globalPos(), self.describe(*found) if found else "", self)
            return True
        return super().event(event)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw cells, names, steps and scale."""
        painter = QPainter(self)
        muted = QColor(theme.colours().muted)
        for (line, step), strength in np.ndenumerate(self._strength):
            box = self.cell(line, step)
            if strength <= OBSERVABLE:
                painter.fillRect(QRectF(box.center().x() - 1, box.center().y() - 1, 2, 2), muted)
            else:
                painter.fillRect(box.adjusted(0, 0, -1, -1), self._colour(float(strength)))
        self._paint_names(painter)
        self._paint_steps(painter)
        self._paint_scale(painter)

    def _colour(self, strength: float) -> QColor:
        share = min(np.log10(max(strength, 1.0)) / _DECADES, 1.0)
        return QColor(*self._colours.map(share, mode="byte")[:3].tolist())

    def _paint_names(self, painter: QPainter) -> None:
        """Name each group once, and each of its components beside its line."""
        c = theme.colours()
        small = theme.font(min(theme.BODY, max(10, int(self.cell(0, 0).height()) - 2)))
        width = 6 * theme.GRID
        groups = [name.rpartition("_")[0] for name in self._names]
        directions = {"east": self.tr("east"), "north": self.tr("north"), "up": self.tr("up")}
        for line, name in enumerate(self._names):
            box = self.cell(line, 0)
            component = name.rpartition("_")[2]
            painter.setFont(small)
            painter.setPen(QColor(c.muted))
            painter.drawText(
                QRectF(_NAMES_WIDTH - width, box.top(), width - 6, box.height()),
                Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter,
                directions.get(component, component),
            )
        errors = {"attitude_error": self.tr("attitude"), "velocity_error": self.tr("velocity")}
        for group in dict.fromkeys(groups):
            lines = [line for line, name in enumerate(groups) if name == group]
            top, bottom = self.cell(lines[0], 0).top(), self.cell(lines[-1], 0).bottom()
            painter.setFont(theme.font())
            painter.setPen(QColor(c.text))
            painter.drawText(
                QRectF(0, top, _NAMES_WIDTH - width, bottom - top),
                Qt.AlignmentFlag.AlignVCenter,
                errors.get(group) or term("group", group),
            )
            painter.setPen(QColor(c.line))
            painter.drawLine(0, int(bottom), self.width() - _SCALE_WIDTH, int(bottom))

    def _paint_steps(self, painter: QPainter) -> None:
        painter.setFont(theme.font())
        painter.setPen(QColor(theme.colours().text))
        top = self.height() - _AXIS
        width = self.cell(0, 0).width()
        every = max(1, int(np.ceil(3.5 * theme.GRID / max(width, 1.0))))
        for index, step in list(enumerate(self._steps))[::every]:
            box = QRectF(self.cell(0, index).left() - 20, top, width + 40, _AXIS)
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter, str(step))
        box = QRectF(0, top, _NAMES_WIDTH - 6, _AXIS)
        right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        painter.drawText(box, right, self.tr("after step"))

    def _paint_scale(self, painter: QPainter) -> None:
        left, height = self.width() - _SCALE_WIDTH + 2 * theme.GRID, min(self.height() - _AXIS, 300)
        for k in range(height):
            shade = self._colour(10.0 ** (_DECADES * (1.0 - k / height)))
            painter.fillRect(QRect(left, k, 2 * theme.GRID, 1), shade)
        painter.setPen(QColor(theme.colours().text))
        for decade in range(_DECADES + 1):
            y = height * (1.0 - decade / _DECADES)
            box = QRectF(left + 2.5 * theme.GRID, min(max(y - 8, 0), height - 16), 10 * theme.GRID, 16)
            painter.drawText(box, Qt.AlignmentFlag.AlignVCenter, f"{10**decade} ×")
