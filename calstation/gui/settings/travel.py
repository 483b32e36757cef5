"""Draws how far each axis of a table may turn."""

import math
from dataclasses import dataclass

from PySide6.QtCore import QEvent, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QSizePolicy, QWidget

from calstation.gui.widgets import theme

_ROW = 11 * theme.GRID
_NAME = 9 * theme.GRID
_BAR = 2 * theme.GRID
#: Distances that the scale's marks may have, degrees.
_TICKS = (30, 90, 180, 360, 720, 1800, 3600)
_MOST_TICKS = 8


@dataclass(frozen=True)
class Travel:
    """One axis: its name and travel, degrees; None where the numbers make none."""

    name: str
    low: float | None
    high: float | None

    @property
    def sound(self) -> bool:
        """Whether there is something to draw."""
        return self.low is not None and self.high is not None and self.low < self.high


class TravelPicture(QWidget):
    """Both axes on one scale: where they may stand, with home at 0 and marks at whole parts of a turn."""

    def __init__(self) -> None:
        super().__init__()
        self._axes: list[Travel] = []
        self.setMinimumHeight(2 * _ROW)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    def show_travel(self, *axes: Travel) -> None:
        """Show the travel of these axes."""
        self._axes = list(axes)
        self.setMinimumHeight(_ROW * len(axes))
        self._name()
        self.update()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self._name()
        super().changeEvent(event)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw scale, bars and ends."""
        c = theme.colours()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        ends = [abs(value) for axis in self._axes if axis.sound for value in (axis.low, axis.high) if value]
        reach = max(ends, default=180.0) * 1.08
        left, right = _NAME + 2 * theme.GRID, self.width() - 3 * theme.GRID
        step = next((t for t in _TICKS if 2 * reach / t <= _MOST_TICKS), _TICKS[-1])

        def at(angle: float) -> float:
            return left + (right - left) * (angle + reach) / (2 * reach)

        for row, axis in enumerate(self._axes):
            top = row * _ROW
            middle = top + 4 * theme.GRID
            painter.setFont(theme.font(bold=True))
            painter.setPen(QColor(c.text))
            painter.drawText(
                QRectF(0, middle - 14, _NAME, 28),
                Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft,
                axis.name,
            )
            painter.setFont(theme.font())
            painter.setPen(QPen(QColor(c.line), 1))
            painter.drawLine(left, int(middle), right, int(middle))
            for k in range(-math.floor(reach / step), math.floor(reach / step) + 1):
                x = at(k * step)
                painter.setPen(QPen(QColor(c.text if k == 0 else c.line), 2 if k == 0 else 1))
                painter.drawLine(int(x), int(middle) - 14, int(x), int(middle) + 14)
            if axis.sound:
                assert axis.low is not None
                assert axis.high is not None
                bar = QRectF(at(axis.low), middle - _BAR / 2, at(axis.high) - at(axis.low), _BAR)
                painter.fillRect(bar, QColor(c.accent))
                painter.setPen(QPen(QColor(c.on_accent if axis.low < 0 < axis.high else c.text), 2))
                painter.drawLine(int(at(0)), int(middle) - 6, int(at(0)), int(middle) + 6)
                painter.setPen(QColor(c.text))
                for value in (axis.low, axis.high):
                    self._label(painter, at(value), middle + 14, f"{value:g}°".replace("-", "−"))
            painter.setPen(QColor(c.muted))
            painter.drawText(
                QRectF(left, top, right - left, 2 * theme.GRID + 4),
                Qt.AlignmentFlag.AlignCenter,
                self._summary(axis),
            )

    def _label(self, painter: QPainter, x: float, y: float, text: str) -> None:
        box = QRectF(x - 40, y, 80, 22)
        box.moveLeft(min(max(box.left(), _NAME), self.width() - box.width()))
        painter.drawText(box, Qt.AlignmentFlag.AlignCenter, text)

    def _summary(self, axis: Travel) -> str:
        """How much it may turn altogether."""
        if not axis.sound:
            return self.tr("no travel: the lowest angle must lie below the highest")
        assert axis.low is not None
        assert axis.high is not None
        span = axis.high - axis.low
        turns = self.tr("{0:g} turns in all").format(round(span / 360.0, 2))
        return turns if span >= 720.0 else self.tr("{0:g}° in all").format(round(span, 3))

    def _name(self) -> None:
        self.setAccessibleName("; ".join(f"{axis.name}: {self._summary(axis)}" for axis in self._axes))
