"""The view of a multi-position solution: a sphere of positions, and residuals of the force and of motion angles."""

import numpy as np
from PySide6.QtCore import QLineF, QPointF, QSize, Qt
from PySide6.QtGui import QColor, QMouseEvent, QPaintEvent, QPen
from PySide6.QtWidgets import QSizePolicy, QWidget

from calstation.gui.logs.methods.plots import Figure, MethodPlot
from calstation.gui.text import bind, say
from calstation.gui.widgets import DataView, column, label, panel, row, theme
from calstation.physics import ARCSECOND, MICRO_G, FloatArray
from calstation.results.plots import PositionPlotData


class PositionsView(QWidget, DataView[PositionPlotData]):
    """Plots of the residuals before (hollow dots) and after (filled dots), with the limit as a dashed line."""

    def __init__(self) -> None:
        super().__init__()
        self.sphere, self._caption = PositionSphere(), label(kind="muted", wrap=True)
        bind(self.sphere.setAccessibleName, "logs.gravity_directions")
        self.force_figure, self.angle_figure = Figure(), Figure()
        self.force_plot, self.angle_plot = MethodPlot(log=True), MethodPlot(log=True)
        figures = row(self.force_figure, self.angle_figure, None, spacing=4 * theme.GRID)
        right = column(figures, (self.force_plot, 1), (self.angle_plot, 1))
        parts = (panel((self.sphere, 1), self._caption), 4), (right, 9)
        row(*parts, on=self, spacing=2 * theme.GRID, margins=(0, theme.GRID, 0, 0))
        theme.on_appearance_change(self, self.refresh)

    def draw(self, data: PositionPlotData) -> None:
        """Draw a solution."""
        self.sphere.show_positions(data.up)
        self._caption.setText(say("logs.gravity_at_rests", count=len(data.up)))
        force, angle = (data.force_before, data.force_after), (data.angle_before, data.angle_after)
        self._show_change(self.force_figure, say("logs.force_at_rest"), force, MICRO_G, "µg")
        self._show_change(self.angle_figure, say("logs.motion_angle"), angle, ARCSECOND, "″")
        self._fill(self.force_plot, say("logs.force_at_each_rest"), force, data.force_limit, MICRO_G)
        title = say("logs.motion_angle_error")
        self._fill(self.angle_plot, title, angle, data.angle_limit, ARCSECOND)
        for widget in (self.angle_figure, self.angle_plot):
            widget.setVisible(len(data.angle_after) > 0)

    @staticmethod
    def _show_change(
        figure: Figure, caption: str, values: tuple[FloatArray, FloatArray], size: float, unit: str
    ) -> None:
        before, after = (float(np.sqrt(np.mean(np.square(v)))) / size if len(v) else 0.0 for v in values)
        figure.show_change(caption, before, after, unit)

    def _fill(
        self, plot: MethodPlot, title: str, values: tuple[FloatArray, FloatArray], limit: float | None, size: float
    ) -> None:
        c = theme.colours()
        before, after = values
        number = np.arange(1.0, len(before) + 1.0)
        plot.empty()
        plot.dots(number, np.abs(before) / size, c.caution, hollow=True)
        plot.dots(number, np.abs(after) / size, c.accent)
        note = [(title, c.text), ("○ " + say("logs.before"), c.caution), ("● " + say("logs.after"), c.accent)]
        if limit is not None:
            plot.limit(limit / size, c.bad)
            note.append(("- - " + say("common.limit_column"), c.bad))
        plot.finish(note)


_EXTENT = 1.3
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 73)
#: Rotation of the sphere per pixel of mouse movement, rad.
_ROTATION_PER_PIXEL = 0.008


class PositionSphere(QWidget):
    """A rotatable sphere with a dot for each position, filled on the near side and hollow on the far side."""

    def __init__(self) -> None:
        super().__init__()
        self._up = np.empty((0, 3))
        self._azimuth, self._elevation = float(np.deg2rad(-55.0)), float(np.deg2rad(22.0))
        self._drag: QPointF | None = None
        self.setMinimumSize(200, 200)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setCursor(Qt.CursorShape.OpenHandCursor)

    def sizeHint(self) -> QSize:
        """Return a square size."""
        return QSize(280, 280)

    def show_positions(self, up: FloatArray) -> None:
        """Show the upward directions in the body frame at the rests, unit vectors, shape (n, 3)."""
        self._up = up
        self.update()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Start a rotation."""
        self._drag = event.position()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Rotate the sphere."""
        if self._drag is None:
            return
        moved = event.position() - self._drag
        self._drag = event.position()
        self._azimuth -= _ROTATION_PER_PIXEL * moved.x()
        self._elevation = float(np.clip(self._elevation + _ROTATION_PER_PIXEL * moved.y(), -1.5, 1.5))
        self.update()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """End the rotation."""
        self._drag = None

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the far side, then the near side."""
        azimuth, elevation = self._azimuth, self._elevation
        eye = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        scale = min(self.width(), self.height()) / (2.0 * _EXTENT)
        centre = QPointF(self.width() / 2.0, self.height() / 2.0)
        flat = scale * np.stack([right, -np.cross(eye, right)])

        def project(points: FloatArray) -> list[QPointF]:
            return [centre + QPointF(x, y) for x, y in (points @ flat.T).tolist()]

        c = theme.colours()
        painter = theme.painter(self)
        painter.setFont(theme.font(theme.SECTION, bold=True))
        metrics = painter.fontMetrics()
        painter.setPen(QPen(QColor(c.line), 1))
        painter.setBrush(QColor(c.panel))
        painter.drawEllipse(centre, scale, scale)
        for near in (False, True):
            painter.setPen(QPen(QColor(c.line), 1.4 if near else 0.7))
            for normal in np.eye(3):
                u, v = np.roll(normal, 1), np.roll(normal, 2)
                circle = np.outer(np.cos(_CIRCLE), u) + np.outer(np.sin(_CIRCLE), v)
                points, visible = project(circle), (circle @ eye >= 0.0) == near
                lines = zip(points[:-1], points[1:], visible[:-1], strict=True)
                painter.drawLines([QLineF(a, b) for a, b, draw in lines if draw])
        for near in (False, True):
            for (name, colour), axis in zip(theme.AXIS_COLOURS.items(), np.eye(3), strict=True):
                if (float(axis @ eye) >= 0.0) is near:
                    begin, end, at_name = project(np.outer([1.0, 1.12, 1.2], axis))
                    painter.setPen(QPen(QColor(colour), 2.0))
                    painter.drawLine(begin, end)
                    offset = QPointF(-metrics.horizontalAdvance(name) / 2, 0.35 * metrics.ascent())
                    painter.setPen(QColor(theme.axis_text(name)))
                    painter.drawText(at_name + offset, name)
            painter.setPen(QPen(QColor(c.accent), 1.5))
            painter.setBrush(QColor(c.accent) if near else QColor(c.panel))
            for dot in project(self._up[(self._up @ eye >= 0.0) == near]):
                painter.drawEllipse(dot, 5.0 if near else 4.0, 5.0 if near else 4.0)
