"""A multi-position answer drawn: the sphere of positions, what is left at every rest, and of every motion's angle."""

import numpy as np
from PySide6.QtCore import QEvent, QPointF, QSize, Qt
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QSizePolicy, QVBoxLayout, QWidget

from calstation.gui.logs.methods.figures import Figure
from calstation.gui.logs.methods.plots import MethodPlot
from calstation.gui.widgets import theme
from calstation.physics import ARCSECOND, MICRO_G, BoolArray, FloatArray
from calstation.results.plots import PositionPlotData


class PositionsView(QWidget):
    """Hollow dots are before, filled ones after; a product's limit is dashed."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._picture: PositionPlotData | None = None
        self.sphere = PositionSphere()
        self._caption = QLabel()
        self._caption.setProperty("kind", "muted")
        self._caption.setWordWrap(True)
        self.force_figure, self.angle_figure = Figure(), Figure()
        self.force_plot, self.angle_plot = MethodPlot(log=True), MethodPlot(log=True)
        globe = QFrame()
        globe.setProperty("kind", "panel")
        left = QVBoxLayout(globe)
        left.setContentsMargins(theme.GRID, theme.GRID, theme.GRID, theme.GRID)
        left.addWidget(self.sphere, 1)
        left.addWidget(self._caption)
        figures = QHBoxLayout()
        figures.setSpacing(4 * theme.GRID)
        figures.addWidget(self.force_figure)
        figures.addWidget(self.angle_figure)
        figures.addStretch(1)
        right = QVBoxLayout()
        right.setSpacing(theme.GRID)
        right.addLayout(figures)
        right.addWidget(self.force_plot, 1)
        right.addWidget(self.angle_plot, 1)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, theme.GRID, 0, 0)
        row.setSpacing(2 * theme.GRID)
        row.addWidget(globe, 4)
        row.addLayout(right, 9)
        self.retranslate()

    def show_picture(self, picture: PositionPlotData) -> None:
        """Draw it."""
        self._picture = picture
        self.sphere.show_positions(picture.up)
        self._draw()

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self.sphere.setAccessibleName(self.tr("Directions of gravity in the unit's axes"))
        self._draw()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language or theme."""
        if event.type() in (QEvent.Type.LanguageChange, QEvent.Type.PaletteChange):
            self.retranslate()
        super().changeEvent(event)

    def _draw(self) -> None:
        p = self._picture
        if p is None:
            return
        self._caption.setText(self.tr("Where gravity lay in the unit at {0} rests. Drag to turn.").format(len(p.up)))
        self.force_figure.show_change(
            self.tr("| f | − g at rest, rms"),
            _rms(p.force_before) / MICRO_G,
            _rms(p.force_after) / MICRO_G,
            "µg",
        )
        for widget in (self.angle_figure, self.angle_plot):
            widget.setVisible(len(p.angle_after) > 0)
        self.angle_figure.show_change(
            self.tr("angle of motions, rms"),
            _rms(p.angle_before) / ARCSECOND,
            _rms(p.angle_after) / ARCSECOND,
            "″",
        )
        self._fill(
            self.force_plot,
            self.tr("| f | − g at each rest, µg"),
            p.force_before,
            p.force_after,
            p.force_limit,
            MICRO_G,
        )
        self._fill(
            self.angle_plot,
            self.tr("Error of each motion's angle, ″"),
            p.angle_before,
            p.angle_after,
            p.angle_limit,
            ARCSECOND,
        )

    def _fill(
        self,
        plot: MethodPlot,
        title: str,
        before: FloatArray,
        after: FloatArray,
        limit: float | None,
        size: float,
    ) -> None:
        c = theme.colours()
        plot.empty()
        number = np.arange(1.0, len(before) + 1.0)
        plot.dots(number, np.abs(before) / size, c.caution, hollow=True)
        plot.dots(number, np.abs(after) / size, c.accent)
        parts = [(title, c.text), ("○ " + self.tr("before"), c.caution), ("● " + self.tr("after"), c.accent)]
        if limit is not None:
            plot.limit(limit / size, c.bad)
            parts.append(("- - " + self.tr("limit"), c.bad))
        plot.say(parts)
        plot.fit()


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0


_EXTENT = 1.3
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 73)
#: Turn of the sphere per pixel dragged, rad.
_PER_PIXEL = 0.008


class PositionSphere(QWidget):
    """Dots are the positions, filled on the near side, hollow on the far one."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._up = np.empty((0, 3))
        self._view = [np.deg2rad(-55.0), np.deg2rad(22.0)]
        self._drag: QPointF | None = None
        self.setMinimumSize(200, 200)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setCursor(Qt.CursorShape.OpenHandCursor)

    def sizeHint(self) -> QSize:
        """Square."""
        return QSize(280, 280)

    def show_positions(self, up: FloatArray) -> None:
        """Directions against gravity in b, unit vectors, shape (n, 3)."""
        self._up = up
        self.update()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Take hold."""
        self._drag = event.position()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Turn it."""
        if self._drag is None:
            return
        moved = event.position() - self._drag
        self._drag = event.position()
        self._view[0] -= _PER_PIXEL * moved.x()
        self._view[1] = float(np.clip(self._view[1] + _PER_PIXEL * moved.y(), -1.5, 1.5))
        self.update()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """Let go."""
        self._drag = None

    def paintEvent(self, event: QPaintEvent) -> None:
        """Far side, axes, near side."""
        c = theme.colours()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        scale = min(self.width(), self.height()) / (2.0 * _EXTENT)
        centre = QPointF(self.width() / 2.0, self.height() / 2.0)
        azimuth, elevation = self._view
        eye = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        upward = np.cross(eye, right)

        def flat(point: FloatArray) -> QPointF:
            return centre + QPointF(scale * float(point @ right), -scale * float(point @ upward))

        painter.setPen(QPen(QColor(c.line), 1))
        painter.setBrush(QColor(c.panel))
        painter.drawEllipse(centre, scale, scale)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for normal in np.eye(3):
            u, v = np.roll(normal, 1), np.roll(normal, 2)
            points = np.outer(np.cos(_CIRCLE), u) + np.outer(np.sin(_CIRCLE), v)
            for near in (False, True):
                painter.setPen(QPen(QColor(c.line), 1.4 if near else 0.7))
                shown = points @ eye >= 0.0 if near else points @ eye < 0.0
                for a, b in _runs(shown):
                    painter.drawPolyline(QPolygonF([flat(p) for p in points[a : b + 1]]))
        order = np.argsort(self._up @ eye) if len(self._up) else np.empty(0, np.int64)
        self._axes(painter, flat, eye, near=False)
        for k in order:
            self._dot(painter, flat(self._up[k]), near=bool(self._up[k] @ eye >= 0.0))
        self._axes(painter, flat, eye, near=True)

    def _axes(self, painter: QPainter, flat: object, eye: FloatArray, *, near: bool) -> None:
        painter.setFont(theme.font(theme.SECTION, bold=True))
        metrics = painter.fontMetrics()
        assert callable(flat)
        for k, (name, colour) in enumerate(theme.AXIS_COLOURS.items()):
            if (float(eye[k]) >= 0.0) is not near:
                continue
            axis = np.eye(3)[k]
            painter.setPen(QPen(QColor(colour), 2.0))
            painter.drawLine(flat(axis), flat(1.12 * axis))
            at = flat(1.2 * axis)
            painter.drawText(
                QPointF(at.x() - metrics.horizontalAdvance(name) / 2, at.y() + 0.35 * metrics.ascent()), name
            )

    def _dot(self, painter: QPainter, at: QPointF, *, near: bool) -> None:
        c = theme.colours()
        painter.setPen(QPen(QColor(c.accent), 1.5))
        painter.setBrush(QColor(c.accent) if near else QColor(c.panel))
        radius = 5.0 if near else 4.0
        painter.drawEllipse(at, radius, radius)
        painter.setBrush(Qt.BrushStyle.NoBrush)


def _runs(chosen: BoolArray) -> list[tuple[int, int]]:
    """First and one past the last index of each stretch of chosen points."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
