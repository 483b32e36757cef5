"""Parallel projection of the level frame to the screen: seen from the front, slightly from the right and above."""

import numpy as np
from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QColor, QFontMetricsF, QPainter, QPainterPath, QPen, QPolygonF
from PySide6.QtWidgets import QWidget

from calstation.gui.widgets import theme
from calstation.physics import FloatArray

_VIEW_AZIMUTH, _VIEW_ELEVATION = np.deg2rad(28.0), np.deg2rad(24.0)
#: Angles of the points of a circle, rad.
CIRCLE = np.linspace(0.0, 2.0 * np.pi, 73)

#: Faces of a box: the axis across each, and the indices of its corners.
_FACES = (
    (0, (0, 1, 3, 2)),
    (0, (4, 5, 7, 6)),
    (1, (0, 1, 5, 4)),
    (1, (2, 3, 7, 6)),
    (2, (0, 2, 6, 4)),
    (2, (1, 3, 7, 5)),
)

_CA, _SA = float(np.cos(_VIEW_AZIMUTH)), float(np.sin(_VIEW_AZIMUTH))
_CE, _SE = float(np.cos(_VIEW_ELEVATION)), float(np.sin(_VIEW_ELEVATION))
#: Direction towards the viewer, level frame, shape (3,).
VIEWER = np.array([_SA * _CE, -_CA * _CE, _SE])


#: From the level frame to the screen, y downward, shape (3, 2).
_SCREEN = np.array([[_CA, _SA * _SE], [_SA, -_CA * _SE], [0.0, -_CE]])


def flat(p: FloatArray) -> QPointF:
    """A point of the level frame, shape (3,), on the screen."""
    return QPointF(*(p @ _SCREEN).tolist())


def polygon(points: FloatArray) -> QPolygonF:
    """Points of the level frame, shape (n, 3), on the screen."""
    return QPolygonF([QPointF(x, y) for x, y in (points @ _SCREEN).tolist()])


def depth(p: FloatArray) -> float:
    """Distance of a point, shape (3,), from the viewer; 0 at the origin."""
    return float(-p @ VIEWER)


def basis(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors, shape (3,), that span the plane across `normal`, shape (3,)."""
    helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
    u = np.cross(normal, helper)
    u /= np.linalg.norm(u)
    return u, np.cross(normal, u)


def pen(colour: str, width: float) -> QPen:
    """A pen with round ends."""
    made = QPen(QColor(colour), width)
    made.setCapStyle(Qt.PenCapStyle.RoundCap)
    made.setJoinStyle(Qt.PenJoinStyle.RoundJoin)
    return made


def box(painter: QPainter, corners: FloatArray) -> None:
    """Draw a box by its corners in the level frame, shape (8, 3), last axis fastest."""
    c = theme.colours()
    faces = [(float(np.mean(corners[list(face)] @ -VIEWER)), axis, corners[list(face)]) for axis, face in _FACES]
    painter.setPen(pen(c.muted, 0.015))
    dark = theme.current() == "dark"
    shade = {0: 120, 1: 150, 2: 200} if dark else {0: 112, 1: 124, 2: 100}
    for _, axis, ring in sorted(faces, key=lambda face: -face[0]):
        colour = QColor(c.panel)
        painter.setBrush(colour.lighter(shade[axis]) if dark else colour.darker(shade[axis]))
        painter.drawPolygon(polygon(ring))


def head(painter: QPainter, tip: QPointF, colour: str) -> None:
    """Draw the head of an arrow from the centre to `tip`."""
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


def letter(on: QWidget, painter: QPainter, name: str, at: QPointF, colour: str) -> None:
    """Draw a letter with an outline, in one size at any scale of the painter.

    Parameters
    ----------
    on : the painted widget
    painter : active on that widget
    name : the letter
    at : its centre, in coordinates of the painter
    colour : of the letter
    """
    painter.save()
    point = painter.transform().map(at)
    painter.resetTransform()
    ratio = on.devicePixelRatioF()
    painter.scale(ratio, ratio)
    font = theme.font(theme.SECTION, bold=True)
    metrics = QFontMetricsF(font)
    x = point.x() / ratio - metrics.horizontalAdvance(name) / 2
    y = point.y() / ratio + metrics.xHeight() / 2
    path = QPainterPath()
    path.addText(QPointF(x, y), font, name)
    painter.strokePath(path, pen(theme.colours().panel, 4.0))
    painter.fillPath(path, QColor(colour))
    painter.restore()
