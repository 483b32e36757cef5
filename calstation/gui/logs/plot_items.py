"""Data and items of the plots of a log: columns, marks of stages and gaps, the selected range and the time axis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QBrush, QColor, QFontMetricsF, QPainter, QPen, QPolygonF
from PySide6.QtWidgets import QStyleOptionGraphicsItem, QWidget

from calstation.gui.widgets import theme
from calstation.physics import FloatArray
from calstation.results.plots import (
    BINS,
    CHANNELS,
    Columns,
    LogIndex,
    MinMaxPyramid,
    Values,
    bins_per_column,
    merge_columns,
)

#: Channels of each plot, and the unit and number of decimals of their values.
PLOTS = (
    (CHANNELS[:3], "°/s", 5),
    (CHANNELS[3:6], "m/s²", 5),
    (CHANNELS[6:8], "°", 4),
    (CHANNELS[8:], "°C", 3),
)

#: Minimum width of a gap or invalid range in the plot, px.
_MIN_WIDTH = 3.0
#: Size of a symbol, px.
_SYMBOL_SIZE = 9.0


class LogMarks:
    """The marks of a log as times from its first sample, s; empty without a log."""

    def __init__(self, log_index: LogIndex | None = None) -> None:
        self.stages: list[tuple[str, float, float]] = []
        self.steps = np.empty(0)
        self.gaps = self.invalid = self.paused = np.empty((0, 2))
        if log_index is not None:
            first, rate = log_index.facts.first_seq, log_index.rate
            self.stages = [
                (s.stage, (s.first_seq - first) / rate, (s.last_seq + 1 - first) / rate) for s in log_index.spans
            ]
            self.steps = (log_index.steps.ranges[:, 0] - first) / rate
            self.gaps = (log_index.gaps.ranges - first) / rate
            self.invalid = (log_index.invalid.ranges - [first, first - 1]) / rate
            self.paused = (log_index.paused.ranges - [first, first - 1]) / rate


class _Layer(pg.GraphicsObject):  # type: ignore[misc]
    """A layer that draws marks in pixels over a whole view; `to_pixels` converts times, s, to positions, px."""

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
        """Set up pixel coordinates and draw the marks."""
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
    """The layer behind the curves: bands for every other stage, gaps, pauses and invalid samples; lines at moves."""

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
        if len(steps) <= box.width() / 5:  # draw no lines if their mean spacing is below 5 px
            painter.setPen(QPen(QColor(c.line), 1, Qt.PenStyle.DotLine))
            for x in steps.tolist():
                painter.drawLine(QPointF(x, box.top()), QPointF(x, box.bottom()))
        for times, colour, style in (
            (self._marks.gaps, c.caution, Qt.BrushStyle.BDiagPattern),
            (self._marks.paused, c.muted, Qt.BrushStyle.FDiagPattern),
            (self._marks.invalid, c.bad, Qt.BrushStyle.DiagCrossPattern),
        ):
            for left, right in _visible_ranges(to_pixels(times), box).tolist():
                fill(left, right, QBrush(QColor(colour), style))


class StageStrip(_Layer):
    """A row of the names of the stages above symbols for gaps, pauses and invalid samples."""

    def __init__(self, stage_name: Callable[[str], str]) -> None:
        super().__init__()
        self._stage_name = stage_name

    def _draw(self, painter: QPainter, box: QRectF, to_pixels: Callable[[FloatArray], FloatArray]) -> None:
        c = theme.colours()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setFont(theme.font())
        metrics = QFontMetricsF(theme.font())
        bottom = box.bottom() - _SYMBOL_SIZE
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
        marks = self._marks
        for kind, times in (("gap", marks.gaps), ("paused", marks.paused), ("invalid", marks.invalid)):
            centres = np.mean(_visible_ranges(to_pixels(times), box), axis=1)
            for x in centres[np.diff(centres, prepend=-np.inf) >= _SYMBOL_SIZE].tolist():
                draw_symbol(painter, kind, QRectF(x - _SYMBOL_SIZE / 2, bottom, _SYMBOL_SIZE, _SYMBOL_SIZE))


def draw_symbol(painter: QPainter, kind: str, box: QRectF) -> None:
    """Draw a triangle for a gap, two bars for a pause, or a square for invalid samples and damaged rows."""
    c = theme.colours()
    painter.setPen(Qt.PenStyle.NoPen)
    if kind == "gap":
        painter.setBrush(QColor(c.caution))
        painter.drawPolygon(QPolygonF([box.topLeft(), box.topRight(), QPointF(box.center().x(), box.bottom())]))
    elif kind == "paused":
        painter.setBrush(QColor(c.muted))
        bar = box.adjusted(1, 1, -1, -1)
        for x in (bar.left(), bar.right() - bar.width() / 3):
            painter.drawRect(QRectF(x, bar.top(), bar.width() / 3, bar.height()))
    else:
        painter.setBrush(QColor(c.bad))
        painter.drawRect(box.adjusted(1, 1, -1, -1))


def _visible_ranges(ranges: FloatArray, box: QRectF) -> FloatArray:
    """Return the ranges within a box, px, shape (n, 2), widened to a minimum width and merged if adjacent."""
    inside = ranges[(ranges[:, 1] >= box.left()) & (ranges[:, 0] <= box.right())]
    if len(inside) == 0:
        return inside
    widen = np.maximum(0.0, _MIN_WIDTH - (inside[:, 1] - inside[:, 0])) / 2
    left, right = inside[:, 0] - widen, inside[:, 1] + widen
    starts = np.flatnonzero(np.concatenate([[True], left[1:] > right[:-1] + 1]))
    stops = np.append(starts[1:], len(inside)) - 1
    merged: FloatArray = np.column_stack([left[starts], right[stops]])
    return np.clip(merged, box.left() - 1, box.right() + 1)


class RangeItem(pg.LinearRegionItem):  # type: ignore[misc]
    """The selected range in seconds, with edges that can be dragged."""

    def __init__(self) -> None:
        super().__init__(swapMode="block")
        self.setZValue(50)

    def apply_theme(self) -> None:
        """Apply the colours of the current theme."""
        accent = theme.colours().accent
        self.setBrush(theme.faint(accent, 18))
        for line in self.lines:
            line.setPen(theme.pen(accent, 2))
            line.setHoverPen(QPen(theme.faint(accent, 160), 20))  # an edge can be dragged within this width
            line.hoverPen.setCosmetic(True)

    def mouseDragEvent(self, event: Any) -> None:
        """Ignore the drag, so that the plot handles it."""
        event.ignore()

    def hoverEvent(self, event: Any) -> None:
        """Ignore the mouse, so that the plot handles it."""


#: Allowed tick spacings, s.
_SPACINGS = (
    *(base * 10.0**power for power in range(-5, 0) for base in (1, 2, 5)),
    *(1.0, 2.0, 5.0, 10.0, 15.0, 30.0),
    *(60.0 * minutes for minutes in (1, 2, 5, 10, 15, 30)),
    *(3600.0 * hours for hours in (1, 2, 3, 6, 12, 24, 48, 96, 240, 480, 960)),
)


class TimeAxis(pg.AxisItem):  # type: ignore[misc]
    """A time axis with ticks at round numbers of seconds, minutes or hours."""

    def __init__(self) -> None:
        super().__init__("bottom")

    def tickSpacing(self, low: float, high: float, size: float) -> list[tuple[float, float]]:
        """Return the smallest tick spacing at which labels do not overlap."""
        minimum = (high - low) * 110 / max(size, 1.0)  # 110 px between ticks
        return [(next((s for s in _SPACINGS if s >= minimum), _SPACINGS[-1]), 0.0)]

    def tickStrings(self, values: Sequence[float], _: float, spacing: float) -> list[str]:
        """Return labels of the form h:mm:ss with the decimals that the spacing requires."""
        return [time_text(value, spacing) for value in values]


def time_text(seconds: float, resolution: float = 1.0) -> str:
    """Format seconds as h:mm:ss, with decimals if `resolution` is finer than a second."""
    decimals = next((d for d in range(5) if resolution >= 0.99 * 10.0**-d), 5)
    units = 10**decimals
    ticks = round(abs(seconds) * units)
    minutes, rest = divmod(ticks, 60 * units)
    hours, minutes = divmod(minutes, 60)
    sign = "−" if seconds < 0 and ticks else ""
    width = 3 + decimals if decimals else 2
    return f"{sign}{hours}:{minutes:02d}:{rest / units:0{width}.{decimals}f}"


@dataclass(frozen=True)
class SampleRequest:
    """A request for the samples `first` to `last`, rows `start` to `stop` of the log, in at most `count` columns."""

    first: int
    last: int
    start: int
    stop: int
    count: int


class LogColumns:
    """The columns of a log from its min-max pyramid or from the samples of the last request."""

    def __init__(self, log_index: LogIndex) -> None:
        self._facts = log_index.facts
        self._pyramid = MinMaxPyramid(log_index.folder)
        self._samples: tuple[SampleRequest, Columns] | None = None

    def store_samples(self, request: SampleRequest, columns: Columns) -> None:
        """Store the samples of a request."""
        self._samples = (request, columns)

    def view(self, first: int, last: int, count: int) -> tuple[Columns, SampleRequest | None]:
        """Return the columns for a range of the log, and a request if samples are needed.

        Parameters
        ----------
        first, last
            Sequence numbers.
        count
            Maximum number of columns.
        """
        columns = self._pyramid.columns(first, last, count)
        if columns.samples > BINS[0] or len(columns) >= count // 2:
            return columns, None
        if self._samples is not None:
            request, fine = self._samples
            inside = request.first <= first and last <= request.last
            if inside and fine.samples <= max(1, (last - first) // count):
                return _between(fine, first, last, count), None
        width = last - first
        wider = max(self._facts.first_seq, first - width), min(self._facts.last_seq, last + width)
        return columns, SampleRequest(*wider, *self._pyramid.rows(*wider), 8 * count)


def split_at_gaps(columns: Columns, max_gap: float) -> tuple[NDArray[np.float64], Values, Values]:
    """Return sequence numbers, minima and maxima, with NaN where more than `max_gap` samples are missing.

    NaN interrupts the line. A merged column with such a gap is omitted, because it may contain samples from both sides
    of the gap.
    """
    gaps = np.flatnonzero(np.diff(columns.seq) - columns.samples > max_gap)
    seq, low, high = columns.seq.astype(np.float64), columns.low, columns.high
    if len(gaps) and columns.samples == 1:
        seq = np.insert(seq, gaps + 1, np.nan)
        low, high = (np.insert(values, gaps + 1, np.nan, axis=0) for values in (low, high))
    else:
        seq[gaps] = np.nan
    return seq, low, high


def _between(columns: Columns, first: int, last: int, count: int) -> Columns:
    """Return the columns that cover a range, merged into at most `count`."""
    start = max(0, int(columns.seq.searchsorted(first, side="right")) - 1)
    stop = int(columns.seq.searchsorted(last, side="right")) + 1
    k = slice(start, stop)
    group = bins_per_column(len(columns.seq[k]), count)
    return merge_columns(columns.seq[k], columns.low[k], columns.high[k], group, columns.samples)
