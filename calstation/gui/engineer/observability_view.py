"""Observability of a stage as a picture: states down, steps across, how much better each is known by then."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QCoreApplication, QEvent, QPoint, QRect, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QHelpEvent, QPainter, QPaintEvent
from PySide6.QtWidgets import (
    QComboBox,
    QFrame,
    QHBoxLayout,
    QLabel,
    QScrollArea,
    QSizePolicy,
    QToolTip,
    QVBoxLayout,
    QWidget,
)

from calstation.gui.text.messages import term
from calstation.gui.widgets import theme
from calstation.gui.widgets.labels import EmptyState
from calstation.physics.arrays import FloatArray

#: Strength from which a state counts as observable.
SEEN = 1.0 / 0.9
#: Of strength on the scale: 1 to 100 000 times.
_DECADES = 5.0
_NAMES_WIDTH, _ROW, _AXIS = 25 * theme.GRID, 13, 3 * theme.GRID
_SCALE_WIDTH = 14 * theme.GRID


class ObservabilityView(QWidget):
    """The picture, what it could not see in words, and its scale."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._stages: Mapping[str, Mapping[str, Any]] = {}
        self.stage_combo = QComboBox()
        self.stage_combo.setObjectName("observability_stage_combo")
        self.stage_combo.setMinimumWidth(22 * theme.GRID)
        self.stage_combo.currentIndexChanged.connect(self._draw)
        self._caption, self.lost_label = QLabel(), QLabel()
        self._caption.setBuddy(self.stage_combo)
        self.lost_label.setObjectName("unobservable_label")
        self.lost_label.setWordWrap(True)
        self.map = HeatMap()
        self._scroll = QScrollArea()
        self._scroll.setWidgetResizable(True)
        self._scroll.setFrameShape(QFrame.Shape.NoFrame)
        self._scroll.setWidget(self.map)
        self._empty = EmptyState()
        head = QHBoxLayout()
        head.setSpacing(theme.GRID)
        head.addWidget(self._caption)
        head.addWidget(self.stage_combo)
        head.addSpacing(2 * theme.GRID)
        head.addWidget(self.lost_label, 1)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, theme.GRID, 0, 0)
        column.setSpacing(theme.GRID)
        column.addLayout(head)
        column.addWidget(self._scroll, 1)
        column.addWidget(self._empty, 1)
        self.retranslate()

    def show_stages(self, stages: Mapping[str, Mapping[str, Any]]) -> None:
        """Show the observability of these stages, as a result or a forecast holds it."""
        self._stages = {name: told for name, told in stages.items() if told.get("segments")}
        self.stage_combo.blockSignals(True)
        self.stage_combo.clear()
        for name in self._stages:
            self.stage_combo.addItem(term("stage", name), name)
        self.stage_combo.blockSignals(False)
        self._draw()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self._caption.setText(self.tr("Stage"))
        for index in range(self.stage_combo.count()):
            self.stage_combo.setItemText(index, term("stage", self.stage_combo.itemData(index)))
        self._empty.say(
            self.tr("No observability to show"),
            self.tr("Only stages solved by the filter tell it: the excitation and the azimuth flips."),
        )
        self._draw()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _draw(self) -> None:
        told = self._stages.get(str(self.stage_combo.currentData()))
        for widget in (self._scroll, self._caption, self.stage_combo, self.lost_label):
            widget.setVisible(told is not None)
        self._empty.setVisible(told is None)
        if told is None:
            return
        # the table holds the unit: no observation ever depends on the position error
        states = {n: state for n, state in told["states"].items() if not n.startswith("position_error")}
        self.map.show_strengths(
            tuple(states),
            tuple(int(segment["step"]) for segment in told["segments"]),
            np.array([state["by_step"] for state in states.values()], dtype=np.float64),
        )
        lost = [name for name, state in states.items() if state["step"] is None]
        if lost:
            said = self.tr("Not determined by this stage: {0}").format(", ".join(lost))
        else:
            said = self.tr("Every state is determined by this stage.")
        self.lost_label.setText(said)


class HeatMap(QWidget):
    """Strengths on a logarithmic scale; a cell that is not seen yet is a dot, and the pointer tells values."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._names: tuple[str, ...] = ()
        self._steps: tuple[int, ...] = ()
        self._strength: FloatArray = np.empty((0, 0))
        self._colours = pg.colormap.get("viridis")
        self.setMouseTracking(True)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.MinimumExpanding)

    def show_strengths(self, names: tuple[str, ...], steps: tuple[int, ...], strength: FloatArray) -> None:
        """Show strengths, shape (names, steps): prior sigma over sigma after the step."""
        self._names, self._steps, self._strength = names, steps, strength
        self.setMinimumHeight(self.minimumSizeHint().height())
        self.updateGeometry()
        self.update()

    def minimumSizeHint(self) -> QSize:
        """Rows high enough to tell apart."""
        return QSize(_NAMES_WIDTH + _SCALE_WIDTH + 4 * len(self._steps), _ROW * len(self._names) + _AXIS)

    def colour(self, strength: float) -> QColor:
        """A strength's colour."""
        place = min(max(np.log10(max(strength, 1.0)) / _DECADES, 0.0), 1.0)
        return QColor(*self._colours.map(place, mode="byte")[:3].tolist())

    def cell(self, row: int, column: int) -> QRectF:
        """Where a cell is."""
        width = (self.width() - _NAMES_WIDTH - _SCALE_WIDTH) / max(len(self._steps), 1)
        height = (self.height() - _AXIS) / max(len(self._names), 1)
        return QRectF(_NAMES_WIDTH + column * width, row * height, width, height)

    def word(self, row: int, column: int) -> str:
        """What a cell says."""
        strength = float(self._strength[row, column])
        if strength <= SEEN:
            return self.tr("{0} after step {1}: not known better than before").format(
                self._names[row], self._steps[column]
            )
        return self.tr("{0} after step {1}: {2:.3g} times better known than before the stage").format(
            self._names[row], self._steps[column], strength
        )

    def paintEvent(self, event: QPaintEvent) -> None:
        """Names, cells, steps and scale."""
        painter = QPainter(self)
        c = theme.colours()
        for row in range(len(self._names)):
            for column in range(len(self._steps)):
                box = self.cell(row, column)
                strength = float(self._strength[row, column])
                if strength <= SEEN:
                    painter.fillRect(
                        QRectF(box.center().x() - 1, box.center().y() - 1, 2, 2), QColor(c.muted)
                    )
                else:
                    painter.fillRect(box.adjusted(0, 0, -1, -1), self.colour(strength))
        self._paint_names(painter)
        self._paint_steps(painter)
        self._paint_scale(painter)

    def _paint_names(self, painter: QPainter) -> None:
        """A group's name once, and each of its components beside its row."""
        c = theme.colours()
        small = theme.font(min(theme.BODY, max(10, int(self.cell(0, 0).height()) - 2)))
        groups = [name.rpartition("_")[0] for name in self._names]
        row = 0
        while row < len(groups):
            end = row
            while end < len(groups) and groups[end] == groups[row]:
                box = self.cell(end, 0)
                painter.setFont(small)
                painter.setPen(QColor(c.muted))
                label = QRectF(_NAMES_WIDTH - 6 * theme.GRID, box.top(), 6 * theme.GRID - 6, box.height())
                side = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
                painter.drawText(label, side, word_component(self._names[end].rpartition("_")[2]))
                end += 1
            span = QRectF(0, self.cell(row, 0).top(), _NAMES_WIDTH - 6 * theme.GRID, 0)
            span.setBottom(self.cell(end - 1, 0).bottom())
            painter.setFont(theme.font())
            painter.setPen(QColor(c.text))
            painter.drawText(span, Qt.AlignmentFlag.AlignVCenter, word_state_group(groups[row]))
            painter.setPen(QColor(c.line))
            painter.drawLine(0, int(span.bottom()), self.width() - _SCALE_WIDTH, int(span.bottom()))
            row = end

    def _paint_steps(self, painter: QPainter) -> None:
        painter.setFont(theme.font())
        painter.setPen(QColor(theme.colours().text))
        top = self.height() - _AXIS
        width = self.cell(0, 0).width()
        every = max(1, int(np.ceil(3.5 * theme.GRID / max(width, 1.0))))
        for column, step in enumerate(self._steps):
            if column % every == 0:
                box = QRectF(self.cell(0, column).left() - 20, top, width + 40, _AXIS)
                painter.drawText(box, Qt.AlignmentFlag.AlignCenter, str(step))
        box = QRectF(0, top, _NAMES_WIDTH - 6, _AXIS)
        painter.drawText(
            box, Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter, self.tr("after step")
        )

    def _paint_scale(self, painter: QPainter) -> None:
        left, height = self.width() - _SCALE_WIDTH + 2 * theme.GRID, min(self.height() - _AXIS, 300)
        for k in range(height):
            shade = self.colour(10.0 ** (_DECADES * (1.0 - k / height)))
            painter.fillRect(QRect(left, k, 2 * theme.GRID, 1), shade)
        painter.setPen(QColor(theme.colours().text))
        for decade in range(int(_DECADES) + 1):
            y = height * (1.0 - decade / _DECADES)
            box = QRectF(left + 2.5 * theme.GRID, min(max(y - 8, 0), height - 16), 10 * theme.GRID, 16)
            painter.drawText(box, Qt.AlignmentFlag.AlignVCenter, f"{10**decade} ×")

    def event(self, event: QEvent) -> bool:
        """Tell a cell's value where the pointer rests."""
        if event.type() == QEvent.Type.ToolTip and isinstance(event, QHelpEvent):
            found = self.at(event.pos())
            if found is None:
                QToolTip.hideText()
            else:
                QToolTip.showText(event.globalPos(), self.word(*found), self)
            return True
        return super().event(event)

    def at(self, at: QPoint) -> tuple[int, int] | None:
        """Row and column of the cell at a place, None where there is none."""
        for row in range(len(self._names)):
            if self.cell(row, 0).top() <= at.y() < self.cell(row, 0).bottom():
                for column in range(len(self._steps)):
                    box = self.cell(row, column)
                    if box.left() <= at.x() < box.right():
                        return row, column
        return None


def word_component(component: str) -> str:
    """A component of a group: a direction in words, an axis as it is."""
    return {
        "east": QCoreApplication.translate("HeatMap", "east"),
        "north": QCoreApplication.translate("HeatMap", "north"),
        "up": QCoreApplication.translate("HeatMap", "up"),
    }.get(component, component)


def word_state_group(group: str) -> str:
    """A group of states in words: navigation errors, else a parameter group."""
    return {
        "attitude_error": QCoreApplication.translate("HeatMap", "attitude"),
        "velocity_error": QCoreApplication.translate("HeatMap", "velocity"),
    }.get(group) or term("group", group)
