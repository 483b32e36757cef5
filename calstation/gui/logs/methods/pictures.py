"""Schematic pictures of the three methods: rails, gimbal, two IMUs on one body."""

from collections.abc import Mapping, Sequence

import numpy as np
from PySide6.QtCore import QCoreApplication, QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QFontMetricsF, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QSizePolicy, QWidget

from calstation.gui.logs.methods.kinds import CROSS_CALIBRATION, GIMBAL, MULTI_POSITION
from calstation.gui.widgets import theme
from calstation.gui.widgets.plot import spread
from calstation.physics.arrays import BoolArray, FloatArray
from calstation.physics.rotation import axis_rotation

_AZIMUTH, _ELEVATION = np.deg2rad(24.0), np.deg2rad(18.0)
_TO_EYE = np.array(
    [
        np.cos(_ELEVATION) * np.sin(_AZIMUTH),
        -np.cos(_ELEVATION) * np.cos(_AZIMUTH),
        np.sin(_ELEVATION),
    ]
)
_RIGHT = np.array([np.cos(_AZIMUTH), np.sin(_AZIMUTH), 0.0])
_UP = np.cross(_TO_EYE, _RIGHT)
#: Half of what must fit into a picture, in radii of its outermost ring.
_EXTENT = 1.3
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 97)
_BOX = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
_FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
#: Share of a labelled picture's width that is kept for names on either side.
_NAMES_ROOM = 0.3


class MethodPicture(QWidget):
    """A method's picture, with the names of its parts where there is room for them."""

    def __init__(self, stage: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._stage = stage
        self.setMinimumSize(260, 200)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)

    def sizeHint(self) -> QSize:
        """A little wider than high, for the names."""
        return QSize(380, 280)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw it with its names."""
        painter = QPainter(self)
        paint_method(painter, self._stage, QRectF(self.rect()), named=True)


def paint_method(painter: QPainter, stage: str, box: QRectF, *, named: bool = False) -> None:
    """Draw a method's picture into a box."""
    width = box.width() * (1.0 - _NAMES_ROOM) if named else box.width()
    scene = _Scene(painter, box.center(), min(width, box.height()) / (2.0 * _EXTENT))
    painter.save()
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    {MULTI_POSITION: _rails, GIMBAL: _gimbal, CROSS_CALIBRATION: _pair}[stage](scene)
    if named:
        scene.write(_names(stage), box)
    painter.restore()


def _names(stage: str) -> Mapping[str, str]:
    """The parts' names by the key under which they were drawn."""
    return {
        MULTI_POSITION: {
            "outer": QCoreApplication.translate("method_parts", "outer rail"),
            "inner": QCoreApplication.translate("method_parts", "inner rail"),
            "unit": QCoreApplication.translate("method_parts", "unit"),
        },
        GIMBAL: {
            "z": QCoreApplication.translate("method_parts", "joint z"),
            "x": QCoreApplication.translate("method_parts", "joint x"),
            "y": QCoreApplication.translate("method_parts", "joint y"),
            "unit": QCoreApplication.translate("method_parts", "unit"),
        },
        CROSS_CALIBRATION: {
            "primary": QCoreApplication.translate("method_parts", "primary"),
            "secondary": QCoreApplication.translate("method_parts", "secondary"),
            "lever": QCoreApplication.translate("method_parts", "lever arm"),
        },
    }[stage]


class _Scene:
    """Points in space drawn flat; remembers where the parts with names are."""

    def __init__(self, painter: QPainter, centre: QPointF, scale: float) -> None:
        self.painter, self.scale = painter, scale
        self._centre = centre
        self._parts: dict[str, QPointF] = {}

    def flat(self, point: FloatArray) -> QPointF:
        """Where a point is seen."""
        return QPointF(
            self._centre.x() + self.scale * float(point @ _RIGHT),
            self._centre.y() - self.scale * float(point @ _UP),
        )

    def name(self, key: str, point: FloatArray) -> None:
        """A part's name belongs here."""
        self._parts[key] = self.flat(point)

    def pen(self, colour: str, width: float, style: Qt.PenStyle = Qt.PenStyle.SolidLine) -> None:
        """Draw with a line of so many parts of the picture's radius."""
        pen = QPen(QColor(colour), max(1.0, width * self.scale), style)
        pen.setCapStyle(Qt.PenCapStyle.RoundCap)
        self.painter.setPen(pen)

    def line(self, start: FloatArray, end: FloatArray) -> None:
        """A straight line."""
        self.painter.drawLine(self.flat(start), self.flat(end))

    def curve(self, points: FloatArray) -> None:
        """A line through points, shape (n, 3)."""
        self.painter.drawPolyline(QPolygonF([self.flat(p) for p in points]))

    def ring(self, axis: Sequence[float], radius: float, colour: str, *, behind: bool) -> None:
        """The half of a ring about an axis that lies behind, or before, its centre."""
        points = radius * _circle(axis)
        away = points @ _TO_EYE < 0.0
        self.pen(colour, 0.055)
        for first, last in runs(away if behind else ~away):
            self.curve(points[first : last + 1])

    def box(self, centre: FloatArray, turn: FloatArray, half: Sequence[float]) -> None:
        """A box, its faces from back to front."""
        c = theme.colours()
        corners = centre + (_BOX * np.asarray(half)) @ turn.T
        faces = sorted(_FACES, key=lambda face: float(corners[list(face)].mean(axis=0) @ _TO_EYE))
        self.pen(c.text, 0.02)
        self.painter.setBrush(QColor(c.field if theme.current() == "light" else c.line))
        for face in faces[3:]:
            self.painter.drawPolygon(QPolygonF([self.flat(corners[k]) for k in face]))
        self.painter.setBrush(Qt.BrushStyle.NoBrush)

    def axes(self, centre: FloatArray, turn: FloatArray, length: float) -> None:
        """The body's axes in their colours."""
        for k, colour in enumerate(theme.AXIS_COLOURS.values()):
            self.arrow(centre, centre + length * turn[:, k], colour)

    def arrow(self, start: FloatArray, end: FloatArray, colour: str) -> None:
        """A line with a head."""
        self.pen(colour, 0.035)
        self.line(start, end)
        self.head(self.flat(start), self.flat(end), colour)

    def head(self, start: QPointF, end: QPointF, colour: str) -> None:
        """An arrow's head at `end`."""
        way = end - start
        length = max(float(np.hypot(way.x(), way.y())), 1e-6)
        along = way * (max(5.0, 0.11 * self.scale) / length)
        across = QPointF(-along.y(), along.x()) * 0.5
        self.painter.setPen(Qt.PenStyle.NoPen)
        self.painter.setBrush(QColor(colour))
        self.painter.drawPolygon(
            QPolygonF([end + along * 0.5, end - along * 0.6 + across, end - along * 0.6 - across])
        )
        self.painter.setBrush(Qt.BrushStyle.NoBrush)

    def turning(
        self,
        axis: Sequence[float],
        radius: float,
        begin: float,
        end: float,
        centre: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        """A curved arrow about an axis through a centre, rad."""
        angles = np.linspace(begin, end, 24)
        u, v = _across(axis)
        points = np.asarray(centre) + radius * (np.outer(np.cos(angles), u) + np.outer(np.sin(angles), v))
        accent = theme.colours().accent
        self.pen(accent, 0.035)
        self.curve(points)
        self.head(self.flat(points[-3]), self.flat(points[-1]), accent)

    def write(self, names: Mapping[str, str], box: QRectF) -> None:
        """The names at the picture's sides, with thin lines to their parts."""
        painter = self.painter
        painter.setFont(theme.font())
        metrics = QFontMetricsF(painter.font())
        c = theme.colours()
        for right in (False, True):
            keys = [key for key in names if (self._parts[key].x() >= self._centre.x()) is right]
            keys.sort(key=lambda key: self._parts[key].y())
            heights = spread([self._parts[k].y() for k in keys], metrics.height(), box.top(), box.bottom())
            for key, y in zip(keys, heights, strict=True):
                text = names[key]
                width = metrics.horizontalAdvance(text)
                edge = self._centre.x() + (1.0 if right else -1.0) * _EXTENT * self.scale
                edge = min(edge, box.right() - width - 6) if right else max(edge, box.left() + width + 6)
                painter.setPen(QPen(QColor(c.muted), 1))
                painter.drawLine(self._parts[key], QPointF(edge, y))
                left = edge + 4 if right else edge - 4 - width
                painter.setPen(QColor(c.text))
                painter.drawText(QPointF(left, y + 0.35 * metrics.ascent()), text)


def _rails(scene: _Scene) -> None:
    c = theme.colours()
    inner = axis_rotation((1.0, 0.0, 0.0), np.deg2rad(24.0))
    unit = inner @ axis_rotation((0.0, 1.0, 0.0), np.deg2rad(-18.0))
    across = inner @ np.array([0.0, 1.0, 0.0])
    scene.pen(c.line, 0.09)
    for side in (-1.0, 1.0):
        scene.line(np.array([1.08 * side, 0.0, -0.95]), np.array([1.08 * side, 0.0, 0.0]))
    scene.line(np.array([-1.08, 0.0, -0.95]), np.array([1.08, 0.0, -0.95]))
    for behind in (True, False):
        if not behind:
            scene.box(np.zeros(3), unit, (0.30, 0.22, 0.14))
            scene.axes(np.zeros(3), unit, 0.56)
        scene.ring(inner[:, 2].tolist(), 1.0, c.muted, behind=behind)
        scene.ring(across.tolist(), 0.78, c.text, behind=behind)
    scene.pen(c.muted, 0.07)
    for side in (-1.0, 1.0):
        scene.line(np.array([side, 0.0, 0.0]), np.array([1.08 * side, 0.0, 0.0]))
    scene.turning((1.0, 0.0, 0.0), 0.32, np.deg2rad(-150.0), np.deg2rad(100.0), (1.2, 0.0, 0.0))
    scene.turning(across.tolist(), 0.92, np.deg2rad(200.0), np.deg2rad(250.0))
    scene.name("outer", np.array([-1.0, 0.0, 0.0]) @ inner.T)
    scene.name("inner", 0.78 * (inner @ np.array([np.cos(2.2), 0.0, np.sin(2.2)])))
    scene.name("unit", unit @ np.array([0.30, -0.22, -0.1]))


def _gimbal(scene: _Scene) -> None:
    c = theme.colours()
    frame = axis_rotation((0.0, 0.0, 1.0), np.deg2rad(12.0))
    middle = frame @ axis_rotation((1.0, 0.0, 0.0), np.deg2rad(10.0))
    unit = middle @ axis_rotation((0.0, 1.0, 0.0), np.deg2rad(-14.0))
    x, y, z = theme.AXIS_COLOURS.values()
    rings = ((frame[:, 1], 1.0, z), (middle[:, 2], 0.82, x), (unit[:, 0], 0.64, y))
    for behind in (True, False):
        if not behind:
            scene.box(np.zeros(3), unit, (0.24, 0.24, 0.16))
        for axis, radius, colour in rings:
            scene.ring(axis.tolist(), radius, colour, behind=behind)
    scene.pen(c.muted, 0.06)
    for side in (-1.0, 1.0):
        scene.line(side * 1.0 * frame[:, 2], side * 1.2 * frame[:, 2])
        scene.line(side * 0.82 * frame[:, 0], side * 1.0 * frame[:, 0])
        scene.line(side * 0.64 * middle[:, 1], side * 0.82 * middle[:, 1])
    scene.turning((0.0, 0.0, 1.0), 1.14, np.deg2rad(-100.0), np.deg2rad(-40.0))
    scene.name("z", frame @ np.array([np.cos(2.35), 0.0, np.sin(2.35)]))
    scene.name("x", 0.82 * middle[:, 0])
    scene.name("y", 0.64 * (unit @ np.array([0.0, np.cos(2.2), np.sin(2.2)])))
    scene.name("unit", unit @ np.array([-0.24, -0.24, -0.1]))


def _pair(scene: _Scene) -> None:
    c = theme.colours()
    body = axis_rotation((0.0, 0.0, 1.0), np.deg2rad(14.0)) @ axis_rotation((0.0, 1.0, 0.0), np.deg2rad(-8.0))
    askew = body @ axis_rotation((0.4, 0.3, 0.866), np.deg2rad(22.0))
    scene.box(body @ np.array([0.0, 0.0, -0.28]), body, (1.05, 0.62, 0.05))
    first, second = body @ np.array([-0.5, 0.08, 0.0]), body @ np.array([0.58, -0.12, -0.08])
    scene.box(first, body, (0.30, 0.30, 0.20))
    scene.box(second, askew, (0.20, 0.20, 0.13))
    scene.pen(c.accent, 0.025, Qt.PenStyle.DashLine)
    scene.line(first, second)
    scene.axes(first, body, 0.62)
    scene.axes(second, askew, 0.46)
    scene.turning((0.0, 0.0, 1.0), 1.12, np.deg2rad(105.0), np.deg2rad(165.0))
    scene.name("primary", first + body @ np.array([-0.30, -0.2, -0.1]))
    scene.name("secondary", second + askew @ np.array([0.18, -0.1, -0.1]))
    scene.name("lever", 0.45 * first + 0.55 * second)


def _across(axis: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors square to an axis and to each other."""
    along = np.asarray(axis, dtype=np.float64)
    helper = np.eye(3)[int(np.argmin(np.abs(along)))]
    u = np.cross(along, helper)
    u /= np.linalg.norm(u)
    return u, np.cross(along, u) / np.linalg.norm(along)


def _circle(axis: Sequence[float]) -> FloatArray:
    u, v = _across(axis)
    return np.asarray(np.outer(np.cos(_CIRCLE), u) + np.outer(np.sin(_CIRCLE), v))


def runs(chosen: BoolArray) -> list[tuple[int, int]]:
    """Stretches of a curve's points that are chosen, first and one behind the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
