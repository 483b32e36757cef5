"""Plots of the gyro, accelerometer, table and temperature data of a log over time, with zoom to single samples."""

from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPointF, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QContextMenuEvent, QKeyEvent
from PySide6.QtWidgets import QWidget

from calstation.gui.logs.plot_items import (
    PLOTS,
    Backdrop,
    LogColumns,
    LogMarks,
    RangeItem,
    SampleRequest,
    StageStrip,
    TimeAxis,
    split_at_gaps,
)
from calstation.gui.text import say, term, with_minus
from calstation.gui.widgets import NumberAxis, PlotMenu, PlotNote, TimeBox, column, fit_below_note, theme
from calstation.results.plots import CHANNELS, Columns, LogIndex

#: Height of the row of stage names, px.
_STRIP_HEIGHT = 34
#: Margin at the ends of the log, as a fraction of its length, in which an edge of the range can be dragged.
_MARGIN = 0.015
#: Ratio of the width of the view after zooming in to the width before.
_ZOOM_FACTOR = 0.5


class _Graph(pg.GraphicsLayoutWidget):  # type: ignore[misc]
    """The plots, with a menu to copy and save them."""

    def __init__(self, write_csv: Callable[[Path], object]) -> None:
        super().__init__()
        self.menu = PlotMenu(self, write_csv)

    def contextMenuEvent(self, event: QContextMenuEvent) -> None:
        """Offer to copy or save the plots."""
        self.menu.open(event)


class LogPlot(QWidget):
    """Plots of a log with about two points per pixel, and a range whose edges can be dragged.

    Signals: `range_moved(first, last)` with sequence numbers while an edge is dragged; `samples_requested(request)` if
    the view is narrow enough for single samples, which the receiver passes to `show_samples`; `pointed(seq)` with the
    sequence number under the mouse, or None outside the log. The top of each plot shows the values under the mouse.
    """

    range_moved = Signal(object, object)
    samples_requested = Signal(object)
    pointed = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self._graph = _Graph(self.write_csv)
        self._graph.setObjectName("log_graph")
        self._graph.setFocusProxy(self)
        self._graph.setAcceptDrops(False)  # the page handles dropped files
        self._graph.ci.setContentsMargins(0, 0, theme.GRID, 0)
        self._graph.ci.setSpacing(2)
        column(self._graph, on=self)
        self._columns: LogColumns | None = None
        #: First and last sequence number, sample rate, Hz, and length, s, of the log.
        self._first, self._last, self._rate, self._length = 0, 0, 1.0, 1.0
        #: Number of samples merged into a drawn column; 1 if single samples are drawn.
        self.samples_per_column = 0
        self._drawn: Columns | None = None
        self._pointed: int | None = None
        self._channels: Collection[str] = CHANNELS
        self._layers: list[Backdrop | StageStrip] = [StageStrip(partial(term, "stage"))]
        self._ranges: list[RangeItem] = []
        self._cursors: list[pg.InfiniteLine] = []
        self._curves: dict[str, pg.PlotCurveItem] = {}
        self._notes: list[PlotNote] = []
        self._strip = self._add_strip()
        self._plots = [self._add_curves(k + 1, channels) for k, (channels, _, _) in enumerate(PLOTS)]
        self._redraw = QTimer(self, singleShot=True)
        self._redraw.timeout.connect(self._draw)
        self._strip.getViewBox().sigXRangeChanged.connect(self._schedule_draw)
        self._strip.getViewBox().sigResized.connect(self._schedule_draw)
        self._graph.scene().sigMouseMoved.connect(self._point)
        theme.on_appearance_change(self, self._refresh)

    def show_log(self, log_index: LogIndex) -> None:
        """Plot a whole log."""
        self._columns = LogColumns(log_index)
        self._first, self._last, self._rate = log_index.facts.first_seq, log_index.facts.last_seq, log_index.rate
        self._length = self._seconds(self._last + 1)
        pad = _MARGIN * self._length
        closest = min(10 / self._rate, self._length)
        for plot in (self._strip, *self._plots):
            plot.setLimits(xMin=-pad, xMax=self._length + pad, minXRange=closest, maxXRange=self._length + 2 * pad)
        self._show_marks(LogMarks(log_index))
        for item in self._ranges:
            item.blockSignals(True)  # the new bounds may change the range of the previous log
            item.setBounds((0.0, self._length))
            item.blockSignals(False)
            item.setVisible(True)
        self.set_range(self._first, self._last)
        self._point_to(None)
        self.show_all()
        self._draw()

    def close_log(self) -> None:
        """Clear the plots."""
        self._columns = self._drawn = None
        self._point_to(None)
        self._show_marks(LogMarks())
        for curve in self._curves.values():
            curve.clear()
        for item in self._ranges:
            item.setVisible(False)

    def show_channels(self, channels: Collection[str]) -> None:
        """Show these members of `CHANNELS`, and hide plots that contain none of them."""
        self._channels = channels
        for name, curve in self._curves.items():
            curve.setVisible(name in channels)
        visible = [
            plot for plot, (names, _, _) in zip(self._plots, PLOTS, strict=True) if not set(names).isdisjoint(channels)
        ]
        for plot in filter(self._graph.ci.items.__contains__, self._plots):
            self._graph.removeItem(plot)
        for row, plot in enumerate(visible, 1):
            self._graph.addItem(plot, row=row, col=0)
            plot.showAxis("bottom", plot is visible[-1])
        self._refresh()
        self._schedule_draw()

    def set_range(self, first_seq: int, last_seq: int) -> None:
        """Show the selected range."""
        region = (self._seconds(first_seq), self._seconds(last_seq + 1))
        for item in self._ranges:
            item.blockSignals(True)
            item.setRegion(region)
            item.blockSignals(False)

    def show_samples(self, request: SampleRequest, columns: Columns) -> None:
        """Draw the samples of a request that `samples_requested` emitted."""
        if self._columns is not None:
            self._columns.store_samples(request, columns)
            self._schedule_draw()

    def write_csv(self, target: Path) -> None:
        """Write the visible channels as drawn, with two rows, the minima and the maxima, for merged samples."""
        columns = self._drawn
        if columns is None:
            return
        channels = [(k, name) for k, name in enumerate(CHANNELS) if name in self._channels]
        units = {name: unit for names, unit, _ in PLOTS for name in names}
        values = np.stack([columns.low, columns.high], axis=1)[:, : 1 if columns.samples == 1 else 2]
        seq = np.repeat(columns.seq, values.shape[1])
        rows = values.reshape(len(seq), -1)[:, [k for k, _ in channels]]
        heading = ["seq", "time_s", *(f"{name} [{units[name]}]" for _, name in channels)]
        time = (seq - self._first) / self._rate
        style = ["%d", "%.9g", *["%.9g"] * len(channels)]
        table = np.column_stack([seq, time, rows])
        np.savetxt(target, table, style, ",", header=",".join(heading), comments="", encoding="utf-8")

    @property
    def view(self) -> tuple[float, float]:
        """Time range in view, s from the start of the log."""
        left, right = self._strip.getViewBox().viewRange()[0]
        return left, right

    def show_all(self) -> None:
        """Show all samples and values."""
        for plot in self._plots:
            plot.getViewBox().reset()
        self._set_view(0.0, self._length, _MARGIN)
        self._schedule_draw()

    def show_part(self, first_seq: int, last_seq: int) -> None:
        """Show a range with a margin of 5 % on either side."""
        self._set_view(self._seconds(first_seq), self._seconds(last_seq + 1), 0.05)

    def zoom(self, closer: bool) -> None:
        """Halve or double the width of the view."""
        left, right = self.view
        self._set_view(left, right, (_ZOOM_FACTOR - 1.0) / 2 if closer else (1 / _ZOOM_FACTOR - 1.0) / 2)

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
                self.show_all()
            case _:
                super().keyPressEvent(event)

    def _set_view(self, left: float, right: float, margin: float = 0.0) -> None:
        """Show a time range, s, with a margin on either side as a fraction of its width."""
        pad = margin * (right - left)
        self._strip.setXRange(left - pad, right + pad, padding=0)

    def _show_marks(self, marks: LogMarks) -> None:
        for layer in self._layers:
            layer.show_marks(marks)

    def _add_strip(self) -> Any:
        plot = self._add_plot(0)
        plot.setMaximumHeight(_STRIP_HEIGHT)
        plot.setMinimumHeight(_STRIP_HEIGHT)
        plot.setYRange(0, 1, padding=0)
        plot.setLimits(yMin=0, yMax=1, minYRange=1)
        plot.getAxis("left").setStyle(tickLength=0, showValues=False)
        plot.addItem(self._layers[0], ignoreBounds=True)
        return plot

    def _add_plot(self, row: int) -> Any:
        axes = {"left": NumberAxis("left"), "bottom": TimeAxis()}
        plot = self._graph.addPlot(row=row, col=0, axisItems=axes, viewBox=TimeBox())
        plot.setMenuEnabled(False)
        plot.hideButtons()
        plot.getViewBox().setDefaultPadding(0.0)
        plot.getViewBox().sig_reset.connect(self.show_all)
        plot.getAxis("left").setWidth(9 * theme.GRID)
        plot.getAxis("left").enableAutoSIPrefix(False)
        plot.getAxis("left").setStyle(hideOverlappingLabels=True)
        for side in ("left", "bottom"):
            plot.getAxis(side).setStyle(tickFont=theme.font())
        plot.showAxis("bottom", row == len(PLOTS))
        return plot

    def _add_curves(self, row: int, channels: tuple[str, ...]) -> Any:
        plot = self._add_plot(row)
        plot.setXLink(self._strip)
        backdrop, item, cursor = Backdrop(), RangeItem(), pg.InfiniteLine(angle=90)
        curves = {name: pg.PlotCurveItem(connect="finite") for name in channels}
        item.sigRegionChanged.connect(self._dragged)
        for each in (item, cursor):
            each.setVisible(False)
        for each in (backdrop, *curves.values(), item, cursor):
            plot.addItem(each, ignoreBounds=True)
        self._layers.append(backdrop)
        self._curves |= curves
        self._ranges.append(item)
        self._cursors.append(cursor)
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
        for name, curve in self._curves.items():
            curve.setPen(theme.pen(_colour(name)))
        for item in self._ranges:
            item.apply_theme()
        for cursor in self._cursors:
            cursor.setPen(theme.pen(c.text))
        self._write_notes()
        self.setAccessibleName(say("logs.curves"))
        self._graph.viewport().update()

    def _write_notes(self) -> None:
        """Show the names of the channels and, while the mouse is over the log, their values."""
        c = theme.colours()
        titles = "common.gyro_dps", "common.accel_mps2", "logs.table_degrees", "logs.temperature_celsius"
        letters = {"outer": say("joint.outer"), "inner": say("joint.inner"), "temperature": ""}
        for note, title, (channels, _, decimals) in zip(self._notes, titles, PLOTS, strict=True):
            parts = [(say(title), c.text)]
            for name in filter(self._channels.__contains__, channels):
                letter = letters.get(name, name[-1])
                colour = theme.axis_text(letter) if letter in theme.AXIS_COLOURS else _colour(name)
                parts.append((f"<b>{letter}</b> {self._value_text(name, decimals)}", colour))
            note.say(parts)

    def _value_text(self, name: str, decimals: int) -> str:
        """Return the value of a channel under the mouse, or the minimum and maximum of the merged samples."""
        columns = self._drawn
        if self._pointed is None or columns is None or not len(columns):
            return ""
        k = max(int(columns.seq.searchsorted(self._pointed, side="right")) - 1, 0)
        digits = decimals if columns.samples == 1 else decimals - 2
        low, high = (f"{values[k, CHANNELS.index(name)]:.{digits}f}" for values in (columns.low, columns.high))
        return with_minus(low if low == high else f"{low}…{high}").replace("nan", "–")

    def _seconds(self, seq: int) -> float:
        return (seq - self._first) / self._rate

    def _seq(self, seconds: float) -> int:
        return min(max(self._first + round(seconds * self._rate), self._first), self._last)

    def _dragged(self, item: RangeItem) -> None:
        start, stop = item.getRegion()
        first, last = self._seq(start), max(self._seq(start), self._seq(stop) - (stop < self._length))
        self.set_range(first, last)
        self.range_moved.emit(first, last)

    def _point(self, position: QPointF) -> None:
        if self._columns is None:
            return
        strip = self._strip.getViewBox()
        seconds, box = strip.mapSceneToView(position).x(), strip.sceneBoundingRect()
        inside = box.left() <= position.x() <= box.right() and 0 <= seconds <= self._length
        self._point_to(self._seq(seconds) if inside else None)

    def _point_to(self, seq: int | None) -> None:
        self._pointed = seq
        for cursor in self._cursors:
            cursor.setVisible(seq is not None)
            if seq is not None:
                cursor.setValue(self._seconds(seq))
        self._write_notes()
        self.pointed.emit(seq)

    def leaveEvent(self, event: QEvent) -> None:
        """Remove the values when the mouse leaves the log."""
        self._point_to(None)
        super().leaveEvent(event)

    def _schedule_draw(self) -> None:
        if self._columns is not None and not self._redraw.isActive():
            self._redraw.start(0)

    def _draw(self) -> None:
        if self._columns is None:
            return
        left, right = self.view
        count = max(64, round(self._strip.getViewBox().width()))
        columns, request = self._columns.view(self._seq(left), self._seq(right), count)
        if request is not None:
            self.samples_requested.emit(request)
        self.samples_per_column, self._drawn = columns.samples, columns
        seq, low, high = split_at_gaps(columns, (right - left) * self._rate / count)
        x = np.repeat((seq - self._first) / self._rate, 2)
        for name, channel_low, channel_high in zip(CHANNELS, low.T, high.T, strict=True):
            if name in self._channels:
                self._curves[name].setData(x, np.column_stack([channel_low, channel_high]).ravel())
        for plot, (channels, _, _) in zip(self._plots, PLOTS, strict=True):
            visible = [CHANNELS.index(name) for name in channels if name in self._channels]
            lowest = columns.low[:, visible]
            if not np.isnan(lowest).all():
                bottom, top = float(np.nanmin(lowest)), float(np.nanmax(columns.high[:, visible]))
                fit_below_note(plot, bottom, top, 0.0 if top > bottom else max(0.1 * abs(top), 1e-9))
        self._write_notes()


def _colour(channel: str) -> str:
    """Return the colour of a channel's curve."""
    c = theme.colours()
    others = {"outer": c.accent, "inner": c.caution, "temperature": c.text}
    return others.get(channel) or theme.AXIS_COLOURS[channel[-1]]
