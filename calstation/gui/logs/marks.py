"""What lies over a log's curves: stages as bands, moves as faint lines, gaps and spoilt samples as marks."""

from collections.abc import Callable

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QBrush, QColor, QFontMetricsF, QPainter, QPen, QPolygonF
from PySide6.QtWidgets import QStyleOptionGraphicsItem, QWidget

from calstation.gui.widgets import theme
from calstation.physics import FloatArray
from calstation.results.plots import LogIndex

#: Moves nearer to each other than this on the average, px, are not drawn.
_STEPS_APART = 5
#: Width of a gap or spoilt stretch too short to be seen, px.
_LEAST = 3.0
#: Size of a mark's sign, px.
_SIGN = 9.0


class Marked:
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
            self.steps = (log_index.steps.places[:, 0] - first) / rate
            self.gaps = (log_index.gaps.places - first) / rate
            self.spoilt = (log_index.spoilt.places - [first, first - 1]) / rate


class _Layer(pg.GraphicsObject):  # type: ignore[misc]
    """Paints in pixels over the whole of a view; `column(seconds)` is a place's pixel."""

    def __init__(self) -> None:
        super().__init__()
        self.marked = Marked()

    def boundingRect(self) -> QRectF:
        """The view's rectangle."""
        return QRectF(self.viewRect())

    def viewRangeChanged(self) -> None:
        """Another part of the log is in view."""
        self.prepareGeometryChange()
        self.update()

    def paint(self, painter: QPainter, _: QStyleOptionGraphicsItem, __: QWidget | None = None) -> None:
        """Draw in pixels."""
        box = painter.transform().mapRect(self.boundingRect())
        scale, shift = painter.transform().m11(), painter.transform().dx()
        painter.save()
        painter.resetTransform()
        painter.setClipRect(box)
        self.draw(painter, box, lambda seconds: seconds * scale + shift)
        painter.restore()

    def draw(self, painter: QPainter, box: QRectF, column: Callable[..., FloatArray]) -> None:
        """Draw into `box`."""
        raise NotImplementedError


class Backdrop(_Layer):
    """Bands, moves, gaps and spoilt samples behind curves."""

    def __init__(self) -> None:
        super().__init__()
        self.setZValue(-100)

    def draw(self, painter: QPainter, box: QRectF, column: Callable[..., FloatArray]) -> None:
        """Bands of every other stage, then what lies on them."""
        c = theme.colours()
        band = QColor(c.muted)
        band.setAlpha(22)
        for k, (_, start, stop) in enumerate(self.marked.stages):
            left, right = column(np.array([start, stop]))
            if k % 2 == 0:
                painter.fillRect(QRectF(QPointF(left, box.top()), QPointF(right, box.bottom())), band)
        steps = column(self.marked.steps)
        steps = np.unique(np.rint(steps[(steps >= box.left()) & (steps <= box.right())]))
        if 0 < len(steps) <= box.width() / _STEPS_APART:
            faint = QColor(c.muted)
            faint.setAlpha(70)
            painter.setPen(QPen(faint, 1, Qt.PenStyle.DotLine))
            for x in steps.tolist():
                painter.drawLine(QPointF(x, box.top()), QPointF(x, box.bottom()))
        for places, colour, style in (
            (self.marked.gaps, c.caution, Qt.BrushStyle.BDiagPattern),
            (self.marked.spoilt, c.bad, Qt.BrushStyle.DiagCrossPattern),
        ):
            brush = QBrush(QColor(colour), style)
            for left, right in stretches(column(places), box).tolist():
                painter.fillRect(QRectF(QPointF(left, box.top()), QPointF(right, box.bottom())), brush)


class Strip(_Layer):
    """The stages' names in a row of their own, with the signs of gaps and spoilt samples."""

    def __init__(self, word: Callable[[str], str]) -> None:
        super().__init__()
        self._word = word

    def draw(self, painter: QPainter, box: QRectF, column: Callable[..., FloatArray]) -> None:
        """Each name in the visible part of its band."""
        c = theme.colours()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        font = theme.font()
        painter.setFont(font)
        metrics = QFontMetricsF(font)
        names = QRectF(box.left(), box.top(), box.width(), box.height() - _SIGN - 2)
        for stage, start, stop in self.marked.stages:
            left, right = np.clip(column(np.array([start, stop])), box.left(), box.right())
            if right - left < 2:
                continue
            cell = QRectF(QPointF(left + 1, names.top()), QPointF(right - 1, names.bottom()))
            fill = QColor(c.accent)
            fill.setAlpha(36)
            painter.fillRect(cell, fill)
            word = metrics.elidedText(self._word(stage), Qt.TextElideMode.ElideRight, cell.width() - 8)
            if len(word) > 1:
                painter.setPen(QColor(c.text))
                painter.drawText(cell, Qt.AlignmentFlag.AlignCenter, word)
        row = QRectF(box.left(), box.bottom() - _SIGN, box.width(), _SIGN)
        for kind, places in (("gap", self.marked.gaps), ("spoilt", self.marked.spoilt)):
            centres = np.mean(stretches(column(places), box), axis=1)
            if len(centres):
                centres = centres[np.diff(centres, prepend=-np.inf) >= _SIGN]
            for x in centres.tolist():
                draw_sign(painter, kind, QRectF(x - _SIGN / 2, row.top(), _SIGN, _SIGN))


def draw_sign(painter: QPainter, kind: str, box: QRectF) -> None:
    """A gap's sign, a triangle, or that of spoilt samples and damaged rows, a square."""
    c = theme.colours()
    painter.setPen(Qt.PenStyle.NoPen)
    if kind == "gap":
        painter.setBrush(QColor(c.caution))
        painter.drawPolygon(QPolygonF([box.topLeft(), box.topRight(), QPointF(box.center().x(), box.bottom())]))
    else:
        painter.setBrush(QColor(c.bad))
        painter.drawRect(box.adjusted(1, 1, -1, -1))


def stretches(places: FloatArray, box: QRectF) -> FloatArray:
    """Stretches (left, right) in pixels within a box, widened where too narrow to be seen, those that meet joined."""
    inside = places[(places[:, 1] >= box.left()) & (places[:, 0] <= box.right())]
    if len(inside) == 0:
        return inside
    widen = np.maximum(0.0, _LEAST - (inside[:, 1] - inside[:, 0])) / 2
    left, right = inside[:, 0] - widen, inside[:, 1] + widen
    apart = np.concatenate([[True], left[1:] > right[:-1] + 1])
    starts = np.flatnonzero(apart)
    stops = np.append(starts[1:], len(inside)) - 1
    joined: FloatArray = np.column_stack([left[starts], right[stops]])
    np.clip(joined, box.left() - 1, box.right() + 1, out=joined)
    return joined
