"""Marks on the plots of a log: stages as bands, moves as faint lines, gaps and invalid samples as hatched areas."""

from collections.abc import Callable

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QBrush, QColor, QFontMetricsF, QPainter, QPen, QPolygonF
from PySide6.QtWidgets import QStyleOptionGraphicsItem, QWidget

from calstation.gui.widgets import theme
from calstation.physics import FloatArray
from calstation.results.plots import LogIndex

#: Minimum drawn width of a gap or invalid range, px.
_MIN_WIDTH = 3.0
#: Size of a symbol, px.
_SIGN = 9.0


class LogMarks:
    """The marks of a log, in seconds from its first sample; empty without a log."""

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
    """Paints in pixel coordinates over a whole view; `to_pixels` converts times, s, to horizontal positions, px."""

    def __init__(self) -> None:
        super().__init__()
        self._marks = LogMarks()

    def show_marks(self, marks: LogMarks) -> None:
        """Draw these marks."""
        self._marks = marks
        self.update()

    def boundingRect(self) -> QRectF:
        """Return the rectangle of the view."""
        return QRectF(self.viewRect())

    def viewRangeChanged(self) -> None:
        """Redraw after a change of the view range."""
        self.prepareGeometryChange()
        self.update()

    def paint(self, painter: QPainter, _: QStyleOptionGraphicsItem, __: QWidget | None = None) -> None:
        """Draw the marks in pixel coordinates."""
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
    """Draws bands for every other stage, and the moves, gaps and invalid samples, in the layer behind the curves."""

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
        if len(steps) <= box.width() / 5:  # no lines if their mean spacing is below 5 px
            painter.setPen(QPen(QColor(c.line), 1, Qt.PenStyle.DotLine))
            for x in steps.tolist():
                painter.drawLine(QPointF(x, box.top()), QPointF(x, box.bottom()))
        for times, colour, style in (
            (self._marks.gaps, c.caution, Qt.BrushStyle.BDiagPattern),
            (self._marks.spoilt, c.bad, Qt.BrushStyle.DiagCrossPattern),
        ):
            for left, right in _visible_ranges(to_pixels(times), box).tolist():
                fill(left, right, QBrush(QColor(colour), style))


class Strip(_Layer):
    """Draws the stage names in a separate row, with symbols for gaps and invalid samples below them."""

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
            centres = np.mean(_visible_ranges(to_pixels(times), box), axis=1)
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


def _visible_ranges(ranges: FloatArray, box: QRectF) -> FloatArray:
    """Return the ranges (left, right) within a box, px, widened to the minimum width and merged if adjacent."""
    inside = ranges[(ranges[:, 1] >= box.left()) & (ranges[:, 0] <= box.right())]
    if len(inside) == 0:
        return inside
    widen = np.maximum(0.0, _MIN_WIDTH - (inside[:, 1] - inside[:, 0])) / 2
    left, right = inside[:, 0] - widen, inside[:, 1] + widen
    starts = np.flatnonzero(np.concatenate([[True], left[1:] > right[:-1] + 1]))
    stops = np.append(starts[1:], len(inside)) - 1
    joined: FloatArray = np.column_stack([left[starts], right[stops]])
    return np.clip(joined, box.left() - 1, box.right() + 1)
