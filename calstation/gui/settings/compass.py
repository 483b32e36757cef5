"""Draws where body +y points at home: the azimuth, clockwise from true north."""

import math

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QSizePolicy, QWidget

from calstation.gui.widgets import theme

_SIZE = 26 * theme.GRID


class Compass(QWidget):
    """North up; an arrow for body +y, or a question mark where the azimuth is found from the data."""

    def __init__(self) -> None:
        super().__init__()
        self._azimuth: float | None = None
        self.setFixedSize(QSize(_SIZE, _SIZE))
        self.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Fixed)

    def show_azimuth(self, azimuth: float | None) -> None:
        """Show an azimuth in degrees, None where there is none."""
        self._azimuth = azimuth
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw rose and arrow."""
        c = theme.colours()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.translate(self.width() / 2, self.height() / 2)
        radius = self.width() / 2 - 3 * theme.GRID
        painter.setPen(QPen(QColor(c.line), 2))
        painter.drawEllipse(QPointF(0, 0), radius, radius)
        for step in range(36):
            angle = math.radians(10 * step)
            length = 10 if step % 9 == 0 else 5
            outer = QPointF(radius * math.sin(angle), -radius * math.cos(angle))
            inner = QPointF((radius - length) * math.sin(angle), -(radius - length) * math.cos(angle))
            painter.drawLine(inner, outer)
        painter.setFont(theme.font(bold=True))
        painter.setPen(QColor(c.muted))
        for angle_deg, letter in ((0, "N"), (90, "E"), (180, "S"), (270, "W")):
            angle = math.radians(angle_deg)
            at = QPointF((radius + 12) * math.sin(angle), -(radius + 12) * math.cos(angle))
            painter.drawText(QRectF(at.x() - 12, at.y() - 12, 24, 24), Qt.AlignmentFlag.AlignCenter, letter)
        if self._azimuth is None:
            painter.setFont(theme.font(theme.SECTION, bold=True))
            painter.drawText(QRectF(-20, -20, 40, 40), Qt.AlignmentFlag.AlignCenter, "?")
            return
        colour = QColor(theme.AXIS_COLOURS["y"])
        painter.rotate(self._azimuth)
        painter.setPen(QPen(colour, 3))
        tip = -(radius - 16)
        painter.drawLine(QPointF(0, 0), QPointF(0, tip + 8))
        painter.setBrush(colour)
        painter.drawPolygon(QPolygonF([QPointF(0, tip), QPointF(-7, tip + 14), QPointF(7, tip + 14)]))
        painter.drawEllipse(QPointF(0, 0), 4, 4)
        painter.translate(16, tip + 18)
        painter.rotate(-self._azimuth)
        painter.setPen(QColor(c.text))
        painter.drawText(QRectF(-14, -12, 28, 24), Qt.AlignmentFlag.AlignCenter, "+y")
