"""Marks of a log over its curves: stages as bands, moves as faint lines, gaps and invalid samples."""

from collections.abc import Callable

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QBrush, QColor, QFontMetricsF, QPainter, QPen, QPolygonF
from PySide6.QtWidgets import QStyleOptionGraphicsItem, QWidget

from calstation.gui.widgets import theme
from calstation.physics import FloatArray
from calstation.results.plots import LogIndex

#: Least width of a gap or invalid stretch, px.
_LEAST = 3.0
#: Size of a sign, px.
_SIGN = 9.0


class LogMarks:
    """A log's marks in seconds from its first sample; empty without a log."""

    def __init__(self, log_index: LogIndex | None = None) -> None:
        self.stages: list[tuple[str, float, float]] = []
        self.steps = np.empty(0)
        self.gaps = self.spoilt = np.empty((0, 2))
        if log_index is not None:
            first, rate = log_index.facts.first_seq, log_index.rate
            self.stages = [
                (s.stage, (s.first_seq - first) / rate, (s.last_seq + 1 - first) / rate) for s in log_index.spans
            ]
            self.steps = (log_index.steps.ranges[:, 0] - first) / rate
            self.gaps = (log_index.gaps.ranges - first) / rate
            self.spoilt = (log_index.spoilt.ranges - [first, first - 1]) / rate


class _Layer(pg.GraphicsObject):  # type: ignore[misc]
    """Paints in pixels over the whole of a view; `to_pixels` converts times to horizontal positions."""

    def __init__(self) -> None:
        super().__init__()
        self._marks = LogMarks()

    def show_marks(self, marks: LogMarks) -> None:
        """Draw these marks."""
        self._marks = marks
        self.update()

    def boundingRect(self) -> QRectF:
        """The view's rectangle."""
        return QRectF(self.viewRect())

    def viewRangeChanged(self) -> None:
        """Draw another part of the log."""
        self.prepareGeometryChange()
        self.update()

    def paint(self, painter: QPainter, _: QStyleOptionGraphicsItem, __: QWidget | None = None) -> None:
        """Draw in pixels."""
        box = painter.transform().mapRect(self.boundingRect())
        scale, shift = painter.transform().m11(), painter.transform().dx()
        painter.save()
        painter.resetTransform()
        painter.setClipRect(box)
        self._draw(painter, box, lambda seconds: seconds * scale + shift)
        painter.restore()

    def _draw(self, painter: QPainter, box: QRectF, to_pixels: Callable[[FloatArray], FloatArray]) -> None:
        raise NotImplementedError


class Backdrop(_Layer):
    """Bands of every other stage, moves, gaps and invalid samples under the curves."""

    def __init__(self) -> None:
        super().__init__()
        self.setZValue(-100)

    def _draw(self, painter: QPainter, box: QRectF, to_pixels: Callable[[FloatArray], FloatArray]) -> None:
        c = theme.colours()

        def fill(left: float, right: float, brush: QBrush) -> None:
            painter.fillRect(QRectF(QPointF(left, box.top()), QPointF(right, box.bottom())), brush)

        for _, start, stop in self._marks.stages[::2]:
            left, right = to_pixels(np.array([start, stop]))
            fill(left, right, QBrush(theme.faint(c.muted, 22)))
        steps = to_pixels(self._marks.steps)
        steps = np.unique(np.rint(steps[(steps >= box.left()) & (steps <= box.right())]))
        if len(steps) <= box.width() / 5:  # not if they are closer together on average, px
            painter.setPen(QPen(theme.faint(c.muted, 70), 1, Qt.PenStyle.DotLine))
            for x in steps.tolist():
                painter.drawLine(QPointF(x, box.top()), QPointF(x, box.bottom()))
        for times, colour, style in (
            (self._marks.gaps, c.caution, Qt.BrushStyle.BDiagPattern),
            (self._marks.spoilt, c.bad, Qt.BrushStyle.DiagCrossPattern),
        ):
            for left, right in _stretches(to_pixels(times), box).tolist():
                fill(left, right, QBrush(QColor(colour), style))


class Strip(_Layer):
    """The stages' names in a row of their own, with the signs of gaps and invalid samples."""

    def __init__(self, stage_name: Callable[[str], str]) -> None:
        super().__init__()
        self._stage_name = stage_name

    def _draw(self, painter: QPainter, box: QRectF, to_pixels: Callable[[FloatArray], FloatArray]) -> None:
        c = theme.colours()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setFont(theme.font())
        metrics = QFontMetricsF(theme.font())
        bottom = box.bottom() - _SIGN
        for stage, start, stop in self._marks.stages:
            left, right = np.clip(to_pixels(np.array([start, stop])), box.left(), box.right())
            if right - left < 2:
                continue
            cell = QRectF(QPointF(left + 1, box.top()), QPointF(right - 1, bottom - 2))
            painter.fillRect(cell, theme.faint(c.accent, 36))
            name = metrics.elidedText(self._stage_name(stage), Qt.TextElideMode.ElideRight, cell.width() - 8)
            if len(name) > 1:
                painter.setPen(QColor(c.text))
                painter.drawText(cell, Qt.AlignmentFlag.AlignCenter, name)
        for kind, times in (("gap", self._marks.gaps), ("spoilt", self._marks.spoilt)):
            centres = np.mean(_stretches(to_pixels(times), box), axis=1)
            for x in centres[np.diff(centres, prepend=-np.inf) >= _SIGN].tolist():
                draw_sign(painter, kind, QRectF(x - _SIGN / 2, bottom, _SIGN, _SIGN))


def draw_sign(painter: QPainter, kind: str, box: QRectF) -> None:
    """Draw a triangle for a gap, or a square for invalid samples and damaged rows."""
    c = theme.colours()
    painter.setPen(Qt.PenStyle.NoPen)
    if kind == "gap":
        painter.setBrush(QColor(c.caution))
        painter.drawPolygon(QPolygonF([box.topLeft(), box.topRight(), QPointF(box.center().x(), box.bottom())]))
    else:
        painter.setBrush(QColor(c.bad))
        painter.drawRect(box.adjusted(1, 1, -1, -1))


def _stretches(stretches: FloatArray, box: QRectF) -> FloatArray:
    """Stretches (left, right) in pixels within a box, widened to the least width, adjacent ones joined."""
    inside = stretches[(stretches[:, 1] >= box.left()) & (stretches[:, 0] <= box.right())]
    if len(inside) == 0:
        return inside
    widen = np.maximum(0.0, _LEAST - (inside[:, 1] - inside[:, 0])) / 2
    left, right = inside[:, 0] - widen, inside[:, 1] + widen
    starts = np.flatnonzero(np.concatenate([[True], left[1:] > right[:-1] + 1]))
    stops = np.append(starts[1:], len(inside)) - 1
    joined: FloatArray = np.column_stack([left[starts], right[stops]])
    return np.clip(joined, box.left() - 1, box.right() + 1)
