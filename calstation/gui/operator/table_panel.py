"""The table drawn at its encoder angles, with the angles, the rates and whether it moves."""

import numpy as np
from PySide6.QtCore import QPointF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPixmap
from PySide6.QtWidgets import QFrame, QGridLayout, QLabel, QSizePolicy, QWidget

from calstation.gui.operator.projection import (
    CIRCLE,
    VIEWER,
    basis,
    box,
    depth,
    flat,
    head,
    letter,
    pen,
    polygon,
)
from calstation.gui.text import on_language_change
from calstation.gui.widgets import StateBadge, column, label, theme
from calstation.physics import FloatArray, axis_rotation
from calstation.sequencer import TableMoved

_RING, _HOLE, _DISC = 1.0, 0.86, 0.8
_AXIS = 0.92
#: Opacity of a table whose angles are unknown.
_PALE = 0.5
#: Half of the width of the drawing, ring radii.
_EXTENT = 1.38


#: Corners of the unit's box on the disc, along two directions of the disc and its normal, ring radii.
_CORNERS = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.3, 0.3) for z in (0.0, 0.26)])


class TablePicture(QWidget):
    """Draws the table at its joint angles: outer ring, inner disc and the axes of the unit."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._outer_axis, self._inner_axis = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
        self._frame = np.array([*basis(self._inner_axis), self._inner_axis])
        self._angles = (0.0, 0.0)
        self._known = False
        self.setMinimumSize(120, 120)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)

    def sizeHint(self) -> QSize:
        """Square."""
        return QSize(220, 220)

    def set_axes(self, outer: tuple[float, float, float], inner: tuple[float, float, float]) -> None:
        """The axes as unit vectors in b at home."""
        self._outer_axis, self._inner_axis = np.array(outer), np.array(inner)
        self._frame = np.array([*basis(self._inner_axis), self._inner_axis])
        self.update()

    def set_angles(self, outer: float, inner: float, *, known: bool = True) -> None:
        """Joint angles, rad; the table is pale while they are unknown."""
        if (outer, inner, known) != (*self._angles, self._known):
            self._angles, self._known = (outer, inner), known
            self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the table, pale if its angles are unknown."""
        if self._known:
            self._draw(QPainter(self))
            return
        ratio = self.devicePixelRatioF()
        picture = QPixmap(self.size() * ratio)
        picture.setDevicePixelRatio(ratio)
        picture.fill(Qt.GlobalColor.transparent)
        self._draw(QPainter(picture))
        painter = QPainter(self)
        painter.setOpacity(_PALE)
        painter.drawPixmap(0, 0, picture)

    def _draw(self, painter: QPainter) -> None:
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        scale = min(self.width(), self.height()) / (2.0 * _EXTENT)
        painter.translate(self.width() / 2.0, self.height() / 2.0)
        painter.scale(scale, scale)
        ring = axis_rotation(tuple(self._outer_axis), self._angles[0])
        unit = ring @ axis_rotation(tuple(self._inner_axis), self._angles[1])
        normal = ring @ self._inner_axis
        facing = float(normal @ VIEWER) >= 0.0
        self._posts(painter, behind=True)
        if not facing:
            self._unit(painter, unit)
        self._plate(painter, normal, _RING, _HOLE)
        self._plate(painter, normal, _DISC, 0.0)
        if facing:
            self._unit(painter, unit)
        self._posts(painter, behind=False)
        self._axes(painter, unit, normal, facing)
        painter.end()

    def _posts(self, painter: QPainter, *, behind: bool) -> None:
        """The stand, a post at each end of the outer axis."""
        c = theme.colours()
        floor = -0.95
        for side in (1.0, -1.0):
            end = side * 1.14 * self._outer_axis
            if (depth(end) > 0.0) is not behind:
                continue
            foot = np.array([end[0], end[1], floor])
            painter.setPen(pen(c.line, 0.10))
            painter.drawLine(flat(foot), flat(end))
            painter.setPen(pen(c.muted, 0.07))
            painter.drawLine(flat(end), flat(side * _RING * self._outer_axis))

    def _plate(self, painter: QPainter, normal: FloatArray, radius: float, hole: float) -> None:
        c = theme.colours()
        u, v = basis(normal)
        edge = np.outer(np.cos(CIRCLE), u) + np.outer(np.sin(CIRCLE), v)
        painter.setPen(pen(c.muted, 0.018))
        painter.setBrush(QColor(c.line if hole else c.window))
        painter.drawPolygon(polygon(radius * edge))
        if hole:
            painter.setBrush(QColor(c.panel))
            painter.drawPolygon(polygon(hole * edge))

    def _unit(self, painter: QPainter, unit: FloatArray) -> None:
        """The unit as a box on the disc."""
        box(painter, (_CORNERS @ self._frame) @ unit.T)

    def _axes(self, painter: QPainter, unit: FloatArray, normal: FloatArray, facing: bool) -> None:
        """x, y and z as arrows, dashed behind the disc."""
        arrows = sorted(enumerate("xyz"), key=lambda pair: -depth(unit[:, pair[0]]))
        for i, name in arrows:
            direction = unit[:, i]
            tip = _AXIS * direction
            hidden = (float(direction @ normal) > 0.3) is not facing and abs(float(direction @ normal)) > 0.3
            colour = theme.AXIS_COLOURS[name]
            line = pen(colour, 0.045)
            if hidden:
                line.setStyle(Qt.PenStyle.DotLine)
            painter.setPen(line)
            painter.drawLine(QPointF(0.0, 0.0), flat(tip))
            head(painter, flat(tip), colour)
            letter(self, painter, name, flat(1.16 * direction), colour)


class TablePanel(QFrame):
    """Shows `TableMoved` events."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("kind", "panel")
        self.picture = TablePicture()
        self.badge = StateBadge()
        self._moved: TableMoved | None = None
        names = (label(lambda: self.tr("outer")), label(lambda: self.tr("inner")))
        self.angle_labels = [QLabel(), QLabel()]
        self._rates = [label(kind="muted"), label(kind="muted")]
        grid = QGridLayout()
        grid.setHorizontalSpacing(theme.GRID)
        grid.setVerticalSpacing(0)
        right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        for row in range(2):
            self.angle_labels[row].setFont(theme.font(theme.SECTION, bold=True))
            for at, cell in enumerate((names[row], self.angle_labels[row], self._rates[row])):
                grid.addWidget(cell, row, at, right if at else Qt.AlignmentFlag.AlignLeft)
        grid.setColumnStretch(1, 1)
        grid.setColumnMinimumWidth(2, 9 * theme.GRID)
        column(
            self.badge,
            (self.picture, 1),
            grid,
            on=self,
            spacing=theme.GRID // 2,
            margins=(2 * theme.GRID, theme.GRID, 2 * theme.GRID, theme.GRID),
        )
        on_language_change(self, self._show_state)

    def set_axes(self, outer: tuple[float, float, float], inner: tuple[float, float, float]) -> None:
        """The axes as unit vectors in b at home."""
        self.picture.set_axes(outer, inner)

    def take(self, moved: TableMoved) -> None:
        """Show angles and rates."""
        self._moved = moved
        self.picture.set_angles(moved.outer, moved.inner)
        for shown, angle in zip(self.angle_labels, (moved.outer, moved.inner), strict=True):
            shown.setText(f"{np.rad2deg(angle):z.3f}°".replace("-", "−"))
        for shown, rate in zip(self._rates, (moved.outer_rate, moved.inner_rate), strict=True):
            shown.setText(f"{np.rad2deg(rate):z.1f} °/s".replace("-", "−"))
        self._show_state()

    def forget(self) -> None:
        """Show a table whose angles are unknown."""
        self._moved = None
        self.picture.set_angles(0.0, 0.0, known=False)
        for shown in (*self.angle_labels, *self._rates):
            shown.setText("–")
        self._show_state()

    def _show_state(self) -> None:
        if self._moved is None:
            self.badge.show_state("none", self.tr("table not connected"))
        elif self._moved.moving:
            self.badge.show_state("active", self.tr("table moving"))
        else:
            self.badge.show_state("stopped", self.tr("table at rest"))
