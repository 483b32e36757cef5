"""Base class of drawings of the level frame in a parallel projection from the front, the right and above."""

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QFontMetricsF, QPainter, QPainterPath, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QSizePolicy, QWidget

from calstation.gui.widgets import theme
from calstation.physics import FloatArray

#: Half the width of a drawing; the radius of the globe and of the table is 1.
_EXTENT = 1.38
#: Smallest distance between the names of two axes, in units of the radius of the table.
_LETTER = 0.25
_AZIMUTH, _ELEVATION = np.deg2rad(28.0), np.deg2rad(24.0)
_SA, _CA = float(np.sin(_AZIMUTH)), float(np.cos(_AZIMUTH))
_SE, _CE = float(np.sin(_ELEVATION)), float(np.cos(_ELEVATION))
#: Direction towards the viewer, shape (3,).
VIEWER = np.array([_SA * _CE, -_CA * _CE, _SE])
#: Projection from the level frame to the screen, where y points down, shape (3, 2).
_SCREEN = np.array([[_CA, _SA * _SE], [_SA, -_CA * _SE], [0.0, -_CE]])
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 73)

#: Faces of a box: the normal axis of each face, and the indices of its corners.
_FACES = (
    (0, (0, 1, 3, 2)),
    (0, (4, 5, 7, 6)),
    (1, (0, 1, 5, 4)),
    (1, (2, 3, 7, 6)),
    (2, (0, 2, 6, 4)),
    (2, (1, 3, 7, 5)),
)


def depth(point: FloatArray) -> float:
    """Return the depth of a point, shape (3,), along the line of sight, positive behind the origin."""
    return float(-point @ VIEWER)


def basis(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two unit vectors, shape (3,), that span the plane normal to `normal`, shape (3,)."""
    helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
    u = np.cross(normal, helper)
    u /= np.linalg.norm(u)
    return u, np.cross(normal, u)


def circle(normal: FloatArray) -> FloatArray:
    """Return points on the unit circle in the plane normal to `normal`, shape (n, 3)."""
    u, v = basis(normal)
    return np.asarray(np.outer(np.cos(_ANGLES), u) + np.outer(np.sin(_ANGLES), v))


def screen(point: FloatArray) -> QPointF:
    """Project a point of the level frame, shape (3,), onto the screen."""
    return QPointF(*(point @ _SCREEN).tolist())


def apart(points: FloatArray, distance: float) -> FloatArray:
    """Return points, shape (n, 2), after moving apart each pair that is closer than `distance`."""
    moved = np.array(points)
    for i in range(len(moved)):
        for j in range(i):
            between = moved[i] - moved[j]
            gap = float(np.linalg.norm(between))
            if gap < distance:
                direction = between / gap if gap > 1e-6 else np.array([1.0, 0.0])
                moved[i] += 0.5 * (distance - gap) * direction
                moved[j] -= 0.5 * (distance - gap) * direction
    return moved


class Drawing(QWidget):
    """A square drawing; subclasses implement `draw`, which calls the methods below from back to front."""

    def __init__(self, size: int, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._size = size
        self._painter = QPainter()
        self.setMinimumSize(size // 2, size // 2)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)

    def sizeHint(self) -> QSize:
        """Return a square size."""
        return QSize(self._size, self._size)

    def draw(self) -> None:
        """Paint the drawing."""
        raise NotImplementedError

    def paintEvent(self, event: QPaintEvent) -> None:
        """Set up the painter and draw."""
        painter = self._painter = theme.painter(self)
        scale = min(self.width(), self.height()) / (2.0 * _EXTENT)
        painter.translate(self.width() / 2.0, self.height() / 2.0)
        painter.scale(scale, scale)
        self.draw()
        painter.end()

    def fade(self) -> None:
        """Make everything drawn so far pale; a graphics effect would lay out the whole window at every paint."""
        self._painter.resetTransform()
        self._painter.setOpacity(0.5)
        self._painter.fillRect(self.rect(), QColor(theme.colours().panel))

    def set_opacity(self, opacity: float) -> None:
        """Set the opacity of everything drawn from now on."""
        self._painter.setOpacity(opacity)

    def line(self, start: QPointF, end: QPointF, colour: str, width: float, *, dotted: bool = False) -> None:
        """Draw a line with round ends.

        Parameters
        ----------
        start, end
            Points on the screen, in units of the radius of the table.
        colour, width
            Colour as ``#rrggbb``, and width in the same units.
        dotted
            Whether the line is dotted.
        """
        self._painter.setPen(_pen(colour, width, dotted=dotted))
        self._painter.drawLine(start, end)

    def area(self, points: Sequence[QPointF], fill: QColor | str, edge: str = "", width: float = 0.0) -> None:
        """Fill a polygon, and draw its edge if `edge` is a colour."""
        self._painter.setPen(_pen(edge, width) if edge else QPen(Qt.PenStyle.NoPen))
        self._painter.setBrush(QColor(fill))
        self._painter.drawPolygon(QPolygonF(points))

    def disc(self, centre: QPointF, radius: float, colour: str, width: float, fill: str = "") -> None:
        """Draw a circle on the screen, filled if `fill` is a colour."""
        self._painter.setPen(_pen(colour, width))
        self._painter.setBrush(QColor(fill) if fill else Qt.BrushStyle.NoBrush)
        self._painter.drawEllipse(centre, radius, radius)

    def arc(self, radius: float, share: float, colour: str, width: float) -> None:
        """Draw a part of a circle on the screen, clockwise from the top.

        Parameters
        ----------
        radius, width
            Radius and line width, in units of the radius of the table.
        share
            Fraction of the circle, from 0 to 1.
        colour
            Colour as ``#rrggbb``.
        """
        line = _pen(colour, width)
        line.setCapStyle(Qt.PenCapStyle.FlatCap)
        self._painter.setPen(line)
        frame = QRectF(-radius, -radius, 2.0 * radius, 2.0 * radius)
        self._painter.drawArc(frame, 90 * 16, round(-share * 360 * 16))

    def plate(self, normal: FloatArray, radius: float, fill: str, edge: str) -> None:
        """Draw a disc in the plane normal to `normal`, shape (3,)."""
        self.area([screen(p) for p in radius * circle(normal)], fill, edge, 0.018)

    def box(self, corners: FloatArray) -> None:
        """Draw a box from its corners, shape (8, 3), of which the last coordinate varies fastest."""
        c = theme.colours()
        dark = theme.current() == "dark"
        shade = (120, 150, 200) if dark else (112, 124, 100)
        for axis, face in sorted(_FACES, key=lambda face: -depth(corners[list(face[1])].mean(axis=0))):
            panel = QColor(c.panel)
            fill = panel.lighter(shade[axis]) if dark else panel.darker(shade[axis])
            self.area([screen(p) for p in corners[list(face)]], fill, c.muted, 0.015)

    def axes(self, attitude: FloatArray, starts: Sequence[float], length: float, hidden: Sequence[bool]) -> None:
        """Draw the axes of the unit, the columns of `attitude`, as labelled arrows.

        Parameters
        ----------
        attitude
            Matrix from the body frame to the level frame, shape (3, 3).
        starts, length
            Distances of the start points and of the end points of the arrows from the centre.
        hidden
            Whether each arrow is dotted.
        """
        letters = apart(1.22 * length * attitude.T @ _SCREEN, _LETTER)
        for i in sorted(range(3), key=lambda i: -depth(attitude[:, i])):
            name, direction = "xyz"[i], attitude[:, i]
            colour, tip = theme.AXIS_COLOURS[name], screen(length * direction)
            self.line(screen(starts[i] * direction), tip, colour, 0.045, dotted=hidden[i])
            self._arrow_head(tip, colour)
            self.letter(name, QPointF(*letters[i].tolist()), theme.axis_text(name))

    def letter(self, name: str, at: QPointF, colour: str) -> None:
        """Draw an outlined text centred at a point; the font size does not depend on the scale of the drawing."""
        painter, ratio = self._painter, self.devicePixelRatioF()
        point = painter.transform().map(at)
        painter.save()
        painter.resetTransform()
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

    def _arrow_head(self, tip: QPointF, colour: str) -> None:
        length = float(np.hypot(tip.x(), tip.y()))
        if length < 0.1:  # the arrow points at the viewer
            self.disc(tip, 0.05, colour, 0.0, colour)
            return
        along = tip / length
        across = QPointF(-along.y(), along.x())
        back = tip - along * 0.13
        self.area([tip + along * 0.03, back + across * 0.06, back - across * 0.06], colour)


def _pen(colour: str, width: float, *, dotted: bool = False) -> QPen:
    style = Qt.PenStyle.DotLine if dotted else Qt.PenStyle.SolidLine
    return QPen(QColor(colour), width, style, Qt.PenCapStyle.RoundCap, Qt.PenJoinStyle.RoundJoin)
