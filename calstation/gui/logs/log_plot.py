"""Plots of a whole log: gyro, accelerometer and table angles over time, zoomable down to single samples."""

from functools import partial
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QPointF, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QKeyEvent, QPen
from PySide6.QtWidgets import QWidget

from calstation.gui.logs.log_columns import LogColumns, Wanted, split_at_gaps
from calstation.gui.logs.marks import Backdrop, LogMarks, Strip
from calstation.gui.logs.time_axis import TimeAxis
from calstation.gui.text import term
from calstation.gui.widgets import NumberAxis, PlotNote, column, fit_below_note, theme
from calstation.results.plots import Columns, LogIndex

#: Channels of each plot: gyro, accelerometer, angles.
_PLOTS = ((0, 3), (3, 6), (6, 8))
#: Height of the row of stage names, px.
_STRIP = 34
#: Margin beyond the ends of the log as a fraction of its length, so that a range edge there can be dragged.
_MARGIN = 0.015
#: Ratio of the width of the view after zooming in to the width before.
_ZOOM = 0.5


class RangeItem(pg.LinearRegionItem):  # type: ignore[misc]
    """A draggable region in seconds; if it covers the whole view, a drag pans the view instead."""

    def __init__(self) -> None:
        super().__init__(swapMode="block")
        self.setZValue(50)

    def apply_theme(self) -> None:
        """Apply the colours of the current theme."""
        accent = theme.colours().accent
        self.setBrush(theme.faint(accent, 18))
        self.setHoverBrush(theme.faint(accent, 30))
        for line in self.lines:
            line.setPen(QPen(QColor(accent), 2))
            line.setHoverPen(QPen(theme.faint(accent, 160), 20))  # an edge can be dragged within this width
            line.pen.setCosmetic(True)
            line.hoverPen.setCosmetic(True)

    def mouseDragEvent(self, event: Any) -> None:
        """Move the range, unless it covers the view."""
        if self._covers_view():
            event.ignore()
        else:
            super().mouseDragEvent(event)

    def hoverEvent(self, event: Any) -> None:
        """Highlight the region if it can be dragged."""
        if not self._covers_view():
            super().hoverEvent(event)

    def _covers_view(self) -> bool:
        left, right = self.getViewBox().viewRange()[0]
        start, stop = self.getRegion()
        margin = 0.03 * (right - left)
        return bool(start <= left + margin and stop >= right - margin)


class LogPlot(QWidget):
    """Plots a log with about two points per pixel, and a range that can be dragged.

    Signals: `range_moved(first, last)` with sequence numbers during a drag; `samples_wanted(Wanted)` when the view is
    narrow enough for single samples, which the receiver passes to `show_samples`; `pointed(seq)` with the sequence
    number under the mouse, None outside the log.
    """

    range_moved = Signal(object, object)
    samples_wanted = Signal(object)
    pointed = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self._graph = pg.GraphicsLayoutWidget()
        self._graph.setObjectName("log_graph")
        self._graph.setFocusProxy(self)
        self._graph.setAcceptDrops(False)  # the page handles dropped files
        self._graph.ci.setContentsMargins(0, 0, theme.GRID, 0)
        self._graph.ci.setSpacing(2)
        column(self._graph, on=self)
        self._log_index: LogIndex | None = None
        self._columns: LogColumns | None = None
        self._length = 1.0
        #: Number of samples merged into a drawn column; 1 if single samples are drawn.
        self.samples_per_column = 0
        self._layers: list[Backdrop | Strip] = [Strip(partial(term, "stage"))]
        self._ranges: list[RangeItem] = []
        self._curves: list[Any] = []
        self._notes: list[PlotNote] = []
        self._strip = self._add_strip()
        self._plots = [self._add_curves(k + 1, stop - start) for k, (start, stop) in enumerate(_PLOTS)]
        for plot in (self._strip, *self._plots[1:]):
            plot.setXLink(self._plots[0])
        self._redraw = QTimer(self, singleShot=True)
        self._redraw.timeout.connect(self._draw)
        self.view_box.sigXRangeChanged.connect(self._schedule_draw)
        self.view_box.sigResized.connect(self._schedule_draw)
        self._graph.scene().sigMouseMoved.connect(self._point)
        theme.on_appearance_change(self, self._refresh)

    def show_log(self, log_index: LogIndex) -> None:
        """Plot the whole of a log."""
        self._log_index, self._columns = log_index, LogColumns(log_index)
        facts = log_index.facts
        self._length = (facts.last_seq + 1 - facts.first_seq) / log_index.rate
        pad = _MARGIN * self._length
        closest = min(10 / log_index.rate, self._length)
        for plot in (self._strip, *self._plots):
            plot.setLimits(xMin=-pad, xMax=self._length + pad, minXRange=closest, maxXRange=self._length + 2 * pad)
        self._show_marks(LogMarks(log_index))
        for item in self._ranges:
            item.setBounds((0.0, self._length))
            item.setVisible(True)
        self.set_range(facts.first_seq, facts.last_seq)
        self.whole()
        self._draw()

    def close_log(self) -> None:
        """Clear the plots."""
        self._log_index = self._columns = None
        self._show_marks(LogMarks())
        for curve in self._curves:
            curve.clear()
        for item in self._ranges:
            item.setVisible(False)

    def set_range(self, first_seq: int, last_seq: int) -> None:
        """Show the selected range."""
        region = (self._seconds(first_seq), self._seconds(last_seq + 1))
        for item in self._ranges:
            item.blockSignals(True)
            item.setRegion(region)
            item.blockSignals(False)

    def show_samples(self, wanted: Wanted, columns: Columns) -> None:
        """Draw the single samples requested by `samples_wanted`."""
        if self._columns is not None:
            self._columns.keep(wanted, columns)
            self._schedule_draw()

    @property
    def view(self) -> tuple[float, float]:
        """Time range in view, s from the start of the log."""
        left, right = self.view_box.viewRange()[0]
        return left, right

    @property
    def view_box(self) -> Any:
        """The view box of the gyro plot."""
        return self._plots[0].getViewBox()

    def whole(self) -> None:
        """Bring the whole log into view."""
        self._set_view(0.0, self._length, _MARGIN)

    def show_part(self, first_seq: int, last_seq: int) -> None:
        """Bring a range into view, with a margin of 5 % of its width on either side."""
        self._set_view(self._seconds(first_seq), self._seconds(last_seq + 1), 0.05)

    def zoom(self, closer: bool) -> None:
        """Halve or double the width of the view."""
        left, right = self.view
        self._set_view(left, right, (_ZOOM - 1.0) / 2 if closer else (1 / _ZOOM - 1.0) / 2)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Zoom with plus and minus, pan with the arrow keys, and show the whole log with Home."""
        left, right = self.view
        shift = 0.2 * (right - left)
        match event.key():
            case Qt.Key.Key_Plus | Qt.Key.Key_Equal:
                self.zoom(True)
            case Qt.Key.Key_Minus:
                self.zoom(False)
            case Qt.Key.Key_Left:
                self._set_view(left - shift, right - shift)
            case Qt.Key.Key_Right:
                self._set_view(left + shift, right + shift)
            case Qt.Key.Key_Home:
                self.whole()
            case _:
                super().keyPressEvent(event)

    def _set_view(self, left: float, right: float, margin: float = 0.0) -> None:
        """Show a time range, s, with `margin` on either side as a fraction of its width."""
        pad = margin * (right - left)
        self._plots[0].setXRange(left - pad, right + pad, padding=0)

    def _show_marks(self, marks: LogMarks) -> None:
        for layer in self._layers:
            layer.show_marks(marks)

    def _add_strip(self) -> Any:
        plot = self._add_plot(0)
        plot.setMaximumHeight(_STRIP)
        plot.setMinimumHeight(_STRIP)
        plot.setYRange(0, 1, padding=0)
        plot.getAxis("left").setStyle(tickLength=0, showValues=False)
        plot.addItem(self._layers[0], ignoreBounds=True)
        return plot

    def _add_plot(self, row: int) -> Any:
        plot = self._graph.addPlot(row=row, col=0, axisItems={"left": NumberAxis("left"), "bottom": TimeAxis()})
        plot.setMenuEnabled(False)
        plot.hideButtons()
        plot.setMouseEnabled(x=True, y=False)
        plot.getViewBox().setDefaultPadding(0.0)
        plot.getAxis("left").setWidth(9 * theme.GRID)
        plot.getAxis("left").enableAutoSIPrefix(False)
        plot.getAxis("left").setStyle(hideOverlappingLabels=True)
        for side in ("left", "bottom"):
            plot.getAxis(side).setStyle(tickFont=theme.font())
        if row < len(_PLOTS):
            plot.hideAxis("bottom")
        return plot

    def _add_curves(self, row: int, count: int) -> Any:
        plot = self._add_plot(row)
        backdrop, item = Backdrop(), RangeItem()
        curves = [pg.PlotCurveItem(connect="finite") for _ in range(count)]
        item.setVisible(False)
        item.sigRegionChanged.connect(self._dragged)
        for each in (backdrop, *curves, item):
            plot.addItem(each, ignoreBounds=True)
        self._layers.append(backdrop)
        self._curves += curves
        self._ranges.append(item)
        self._notes.append(PlotNote(plot.getViewBox()))
        return plot

    def _refresh(self) -> None:
        c = theme.colours()
        self._graph.setBackground(QColor(c.panel))
        for plot in (self._strip, *self._plots):
            for side in ("left", "bottom"):
                plot.getAxis(side).setPen(QColor(c.line))
                plot.getAxis(side).setTextPen(QColor(c.text))
        self._strip.getAxis("left").setPen(QColor(c.panel))
        table = (self.tr("outer"), c.accent), (self.tr("inner"), c.caution)
        axes = tuple(theme.AXIS_COLOURS.items())
        for curve, (_, colour) in zip(self._curves, (*axes, *axes, *table), strict=True):
            curve.setPen(QPen(QColor(colour), 0))
        for item in self._ranges:
            item.apply_theme()
        titles = self.tr("Gyro, °/s"), self.tr("Accelerometer, m/s²"), self.tr("Table, °")
        letters = tuple((name, theme.axis_text(name)) for name, _ in axes)
        for note, title, lines in zip(self._notes, titles, (letters, letters, table), strict=True):
            note.say([(title, c.text), *((f"<b>{name}</b>", colour) for name, colour in lines)])
        self.setAccessibleName(self.tr("The log's curves"))
        self._graph.viewport().update()

    def _seconds(self, seq: int) -> float:
        assert self._log_index is not None
        return (seq - self._log_index.facts.first_seq) / self._log_index.rate

    def _seq(self, seconds: float) -> int:
        assert self._log_index is not None
        facts = self._log_index.facts
        return min(max(facts.first_seq + round(seconds * self._log_index.rate), facts.first_seq), facts.last_seq)

    def _dragged(self, item: RangeItem) -> None:
        start, stop = item.getRegion()
        first, last = self._seq(start), max(self._seq(start), self._seq(stop) - (stop < self._length))
        self.set_range(first, last)
        self.range_moved.emit(first, last)

    def _point(self, position: QPointF) -> None:
        if self._log_index is None:
            return
        seconds = self.view_box.mapSceneToView(position).x()
        box = self.view_box.sceneBoundingRect()
        inside = box.left() <= position.x() <= box.right() and 0 <= seconds <= self._length
        self.pointed.emit(self._seq(seconds) if inside else None)

    def _schedule_draw(self) -> None:
        if self._log_index is not None and not self._redraw.isActive():
            self._redraw.start(0)

    def _draw(self) -> None:
        if self._log_index is None or self._columns is None:
            return
        left, right = self.view
        count = max(64, round(self.view_box.width()))
        columns, wanted = self._columns.view(self._seq(left), self._seq(right), count)
        if wanted is not None:
            self.samples_wanted.emit(wanted)
        self.samples_per_column = columns.samples
        seq, low, high = split_at_gaps(columns, (right - left) * self._log_index.rate / count)
        x = np.repeat((seq - self._log_index.facts.first_seq) / self._log_index.rate, 2)
        for curve, channel_low, channel_high in zip(self._curves, low.T, high.T, strict=True):
            curve.setData(x, np.column_stack([channel_low, channel_high]).ravel())
        for plot, (start, stop) in zip(self._plots, _PLOTS, strict=True):
            lowest = columns.low[:, start:stop]
            if not np.isnan(lowest).all():
                bottom, top = float(np.nanmin(lowest)), float(np.nanmax(columns.high[:, start:stop]))
                fit_below_note(plot, bottom, top, 0.0 if top > bottom else max(abs(top), 1e-9))
