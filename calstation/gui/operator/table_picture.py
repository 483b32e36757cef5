"""The table as it stands now: outer ring, inner disc and the unit's axes, drawn from the encoder angles."""

import numpy as np
from PySide6.QtCore import QPointF, QSize, Qt
from PySide6.QtGui import QColor, QFontMetricsF, QPainter, QPainterPath, QPaintEvent, QPen, QPixmap, QPolygonF
from PySide6.QtWidgets import QSizePolicy, QWidget

from calstation.gui import theme
from calstation.physics.arrays import FloatArray
from calstation.physics.rotation import axis_rotation

_VIEW_AZIMUTH, _VIEW_ELEVATION = np.deg2rad(28.0), np.deg2rad(24.0)
_RING, _HOLE, _DISC = 1.0, 0.86, 0.8
_AXIS = 0.92
_PALE = 0.5
"""Opacity of a table whose angles nobody knows."""
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 73)
_EXTENT = 1.38
"""Half of what must fit into the picture, in ring radii."""


_CORNERS = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.3, 0.3) for z in (0.0, 0.26)])
"""Of the unit's box on the disc, along the disc's two directions and its normal, ring radii."""
_FACES = (
    (0, (0, 1, 3, 2)),
    (0, (4, 5, 7, 6)),
    (1, (0, 1, 5, 4)),
    (1, (2, 3, 7, 6)),
    (2, (0, 2, 6, 4)),
    (2, (1, 3, 7, 5)),
)
"""The box's faces as places in `_CORNERS`, with the axis that each is across."""


class TablePicture(QWidget):
    """Draws the table at two joint angles; `set_axes` tells how it is built."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._outer_axis, self._inner_axis = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
        self._frame = np.array([*_basis(self._inner_axis), self._inner_axis])
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
        self._frame = np.array([*_basis(self._inner_axis), self._inner_axis])
        self.update()

    def set_angles(self, outer: float, inner: float, *, known: bool = True) -> None:
        """Joint angles, rad; pale where they are not known."""
        if (outer, inner, known) != (*self._angles, self._known):
            self._angles, self._known = (outer, inner), known
            self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw from back to front."""
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
        facing = float(normal @ _VIEWER) >= 0.0
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
        """The stand: a post to each end of the outer axis."""
        c = theme.colours()
        floor = -0.95
        for side in (1.0, -1.0):
            end = side * 1.14 * self._outer_axis
            if (_depth(end) > 0.0) is not behind:
                continue
            foot = np.array([end[0], end[1], floor])
            painter.setPen(_pen(c.line, 0.10))
            painter.drawLine(_flat(foot), _flat(end))
            painter.setPen(_pen(c.muted, 0.07))
            painter.drawLine(_flat(end), _flat(side * _RING * self._outer_axis))

    def _plate(self, painter: QPainter, normal: FloatArray, radius: float, hole: float) -> None:
        c = theme.colours()
        u, v = _basis(normal)
        edge = np.outer(np.cos(_CIRCLE), u) + np.outer(np.sin(_CIRCLE), v)
        painter.setPen(_pen(c.muted, 0.018))
        painter.setBrush(QColor(c.line if hole else c.window))
        painter.drawPolygon(_polygon(radius * edge))
        if hole:
            painter.setBrush(QColor(c.panel))
            painter.drawPolygon(_polygon(hole * edge))

    def _unit(self, painter: QPainter, unit: FloatArray) -> None:
        """The unit as a box on the disc, its faces from back to front."""
        c = theme.colours()
        corners = (_CORNERS @ self._frame) @ unit.T
        faces = [
            (float(np.mean(corners[list(face)] @ -_VIEWER)), axis, corners[list(face)])
            for axis, face in _FACES
        ]
        painter.setPen(_pen(c.muted, 0.015))
        dark = theme.current() == "dark"
        shade = {0: 120, 1: 150, 2: 200} if dark else {0: 112, 1: 124, 2: 100}
        for _, axis, ring in sorted(faces, key=lambda face: -face[0]):
            colour = QColor(c.panel)
            painter.setBrush(colour.lighter(shade[axis]) if dark else colour.darker(shade[axis]))
            painter.drawPolygon(_polygon(ring))

    def _axes(self, painter: QPainter, unit: FloatArray, normal: FloatArray, facing: bool) -> None:
        """x, y and z as arrows; what lies behind the disc is dashed."""
        arrows = sorted(enumerate("xyz"), key=lambda pair: -_depth(unit[:, pair[0]]))
        for i, name in arrows:
            direction = unit[:, i]
            tip = _AXIS * direction
            hidden = (float(direction @ normal) > 0.3) is not facing and abs(float(direction @ normal)) > 0.3
            colour = theme.AXIS_COLOURS[name]
            pen = _pen(colour, 0.045)
            if hidden:
                pen.setStyle(Qt.PenStyle.DotLine)
            painter.setPen(pen)
            painter.drawLine(QPointF(0.0, 0.0), _flat(tip))
            self._head(painter, _flat(tip), colour)
            self._letter(painter, name, _flat(1.16 * direction), colour)

    def _head(self, painter: QPainter, tip: QPointF, colour: str) -> None:
        length = float(np.hypot(tip.x(), tip.y()))
        if length < 0.1:
            painter.setBrush(QColor(colour))
            painter.drawEllipse(tip, 0.05, 0.05)
            return
        along = QPointF(tip.x() / length, tip.y() / length)
        across = QPointF(-along.y(), along.x())
        back = tip - along * 0.13
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(colour))
        painter.drawPolygon(QPolygonF([tip + along * 0.03, back + across * 0.06, back - across * 0.06]))

    def _letter(self, painter: QPainter, name: str, at: QPointF, colour: str) -> None:
        painter.save()
        point = painter.transform().map(at)
        painter.resetTransform()
        ratio = self.devicePixelRatioF()
        painter.scale(ratio, ratio)
        font = theme.font(theme.SECTION, bold=True)
        metrics = QFontMetricsF(font)
        x = point.x() / ratio - metrics.horizontalAdvance(name) / 2
        y = point.y() / ratio + metrics.xHeight() / 2
        path = QPainterPath()
        path.addText(QPointF(x, y), font, name)
        painter.strokePath(path, _pen(theme.colours().panel, 4.0))
        painter.fillPath(path, QColor(colour))
        painter.restore()


_CA, _SA = float(np.cos(_VIEW_AZIMUTH)), float(np.sin(_VIEW_AZIMUTH))
_CE, _SE = float(np.cos(_VIEW_ELEVATION)), float(np.sin(_VIEW_ELEVATION))
_VIEWER = np.array([_SA * _CE, -_CA * _CE, _SE])
"""From the table towards who looks at it, level frame."""


_SCREEN = np.array([[_CA, _SA * _SE], [_SA, -_CA * _SE], [0.0, -_CE]])
"""From the level frame to the screen, y downward, shape (3, 2)."""


def _flat(p: FloatArray) -> QPointF:
    """A point of the level frame on the screen."""
    return QPointF(*(p @ _SCREEN).tolist())


def _polygon(points: FloatArray) -> QPolygonF:
    """Points of the level frame, shape (n, 3), on the screen."""
    return QPolygonF([QPointF(x, y) for x, y in (points @ _SCREEN).tolist()])


def _depth(p: FloatArray) -> float:
    """How far a point lies away from who looks."""
    return float(-p @ _VIEWER)


def _basis(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors that span the plane across `normal`."""
    helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
    u = np.cross(normal, helper)
    u /= np.linalg.norm(u)
    return u, np.cross(normal, u)


def _pen(colour: str, width: float) -> QPen:
    pen = QPen(QColor(colour), width)
    pen.setCapStyle(Qt.PenCapStyle.RoundCap)
    pen.setJoinStyle(Qt.PenJoinStyle.RoundJoin)
    return pen
