"""The gain of one axis on a bar: the range in which turns converge, the fastest gain, and the one in use."""

from PySide6.QtCore import QEvent, QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QSizePolicy, QWidget

from calstation.gui.logs.methods.figures import three_digits
from calstation.gui.widgets import theme
from calstation.results.plots import GimbalAxis

_HEIGHT = 62
_BAR_TOP, _BAR = 24.0, 14.0
#: The bar reaches to so many times the largest stable gain, or the gain in use.
_ROOM = 1.35


class GainBar(QWidget):
    """Filled: stable. A tick below: fastest. A triangle above: in use."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._axis: GimbalAxis | None = None
        self.setFixedHeight(_HEIGHT)
        self.setMinimumWidth(30 * theme.GRID)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    def show_axis(self, axis: GimbalAxis) -> None:
        """Show an axis' gain."""
        self._axis = axis
        self.setAccessibleName(
            self.tr("Gain {0}, stable below {1}, fastest at {2}").format(
                *(three_digits(v) for v in (axis.gain, axis.largest, axis.best))
            )
        )
        self.update()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange and self._axis is not None:
            self.show_axis(self._axis)
        super().changeEvent(event)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw it."""
        axis = self._axis
        if axis is None:
            return
        c = theme.colours()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setFont(theme.font())
        most = _ROOM * max(axis.largest, axis.gain / 1.1, 1e-9)
        width = self.width() - 2.0

        def at(gain: float) -> float:
            return 1.0 + width * gain / most

        bar = QRectF(1, _BAR_TOP, width, _BAR)
        painter.setPen(QPen(QColor(c.line), 1))
        painter.setBrush(QColor(c.window))
        painter.drawRect(bar)
        stable = QColor(c.good)
        stable.setAlpha(110)
        painter.fillRect(QRectF(1, _BAR_TOP, at(axis.largest) - 1, _BAR), stable)
        painter.setPen(QPen(QColor(c.text), 2))
        for gain in (axis.largest, axis.best):
            painter.drawLine(QPointF(at(gain), _BAR_TOP - 2), QPointF(at(gain), _BAR_TOP + _BAR + 4))
        self._below(painter, at(axis.best), at(axis.largest), axis)
        inside = axis.gain < axis.largest
        x = at(axis.gain)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(c.accent if inside else c.bad))
        painter.drawPolygon(
            QPolygonF([QPointF(x, _BAR_TOP + 4), QPointF(x - 7, _BAR_TOP - 6), QPointF(x + 7, _BAR_TOP - 6)])
        )
        painter.setPen(QColor(c.accent if inside else c.bad))
        self._text(painter, x, 0.0, self.tr("α = {0}").format(three_digits(axis.gain)))

    def _below(self, painter: QPainter, best: float, largest: float, axis: GimbalAxis) -> None:
        """What the two ticks are; side by side where they are close together."""
        painter.setPen(QColor(theme.colours().text))
        top = _BAR_TOP + _BAR + 5.0
        fastest = self.tr("fastest {0}").format(three_digits(axis.best))
        stable = self.tr("stable below {0}").format(three_digits(axis.largest))
        metrics = painter.fontMetrics()
        left = best - metrics.horizontalAdvance(fastest) - 4.0
        if left < 0.0 or largest + metrics.horizontalAdvance(stable) / 2 < self.width():
            gap = metrics.horizontalAdvance(stable) / 2 + metrics.horizontalAdvance(fastest) / 2 + 12
            if largest - best >= gap:
                self._text(painter, best, top, fastest)
                self._text(painter, largest, top, stable)
                return
        height = metrics.height()
        painter.drawText(QRectF(0, top, best + 2.0, height), Qt.AlignmentFlag.AlignRight, fastest)
        right = QRectF(self.width() - metrics.horizontalAdvance(stable) - 1.0, top, self.width(), height)
        right.moveLeft(min(max(largest - 10.0, best + 10.0), right.left()))
        painter.drawText(right, Qt.AlignmentFlag.AlignLeft, stable)

    def _text(self, painter: QPainter, x: float, top: float, text: str) -> None:
        metrics = painter.fontMetrics()
        width = metrics.horizontalAdvance(text) + 2
        left = min(max(x - width / 2, 0.0), self.width() - width)
        painter.drawText(QRectF(left, top, width, metrics.height()), Qt.AlignmentFlag.AlignCenter, text)
