"""The few icons of the top bar, drawn in the theme's text colour."""

from collections.abc import Callable

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QIcon, QPainter, QPen, QPixmap

from calstation.gui.widgets import theme

_SIZE = 24
_RATIO = 2


def padlock(*, closed: bool) -> QIcon:
    """A padlock: closed for the operator, open for the engineer."""

    def draw(painter: QPainter) -> None:
        painter.setBrush(QColor(theme.colours().text))
        painter.drawRoundedRect(QRectF(5, 11, 14, 10), 2, 2)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        if closed:
            painter.drawArc(QRectF(8, 3, 8, 12), 0, 180 * 16)
            painter.drawLine(QPointF(8, 9), QPointF(8, 11))
            painter.drawLine(QPointF(16, 9), QPointF(16, 11))
        else:
            painter.drawArc(QRectF(12, 2, 8, 12), 0, 180 * 16)
            painter.drawLine(QPointF(12, 8), QPointF(12, 11))

    return _icon(draw)


def half_disc() -> QIcon:
    """A disc half light, half dark: the other theme."""

    def draw(painter: QPainter) -> None:
        painter.drawEllipse(QRectF(4, 4, 16, 16))
        painter.setBrush(QColor(theme.colours().text))
        painter.drawChord(QRectF(4, 4, 16, 16), 90 * 16, 180 * 16)

    return _icon(draw)


def _icon(draw: Callable[[QPainter], None]) -> QIcon:
    picture = QPixmap(_SIZE * _RATIO, _SIZE * _RATIO)
    picture.setDevicePixelRatio(_RATIO)
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setPen(QPen(QColor(theme.colours().text), 1.8))
    draw(painter)
    painter.end()
    return QIcon(picture)
