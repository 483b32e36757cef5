"""A whole log drawn at once: gyro, accelerometer and table angles over time, zoomable down to the sample."""

from functools import partial
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPointF, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QKeyEvent, QPen
from PySide6.QtWidgets import QVBoxLayout, QWidget

from calstation.gui.logs.log_columns import LogColumns, Wanted, parted
from calstation.gui.logs.marks import Backdrop, Marked, Strip
from calstation.gui.logs.range_item import RangeItem
from calstation.gui.logs.time_axis import TimeAxis
from calstation.gui.text import term
from calstation.gui.widgets import theme
from calstation.results.plots import CHANNELS, Columns, LogIndex

#: Channels of each plot: gyro, accelerometer, angles.
_PLOTS = ((0, 3), (3, 6), (6, 8))
#: Width of the axes at the left, px.
_AXIS = 9 * theme.GRID
_STRIP = 34
#: What the view shows beyond the log's ends, of its length: an edge there can still be taken hold of.
_MARGIN = 0.015
#: Samples in the closest view.
_CLOSEST = 10
#: Room for the note at the top of a plot, px.
_NOTE = 28
_ZOOM = 0.5
#: Of the view, what an arrow key moves it.
_STEP = 0.2


class LogPlot(QWidget):
    """Draws what a `Picture` holds, about two points per pixel, and lets a range be dragged.

    `range_moved(first, last)`: sequence numbers while dragged. `samples_wanted(Wanted)`: the view is so close that
    single samples are worth drawing; answer with `show_samples`.
    `pointed(seq)`: the sequence number under the mouse, None where there is none.
    """

    range_moved = Signal(object, object)
    samples_wanted = Signal(object)
    pointed = Signal(object)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self._graph = pg.GraphicsLayoutWidget()
        self._graph.setObjectName("log_graph")
        self._graph.setFocusProxy(self)
        self._graph.setAcceptDrops(False)  # a file dropped here belongs to the page
        box = QVBoxLayout(self)
        box.setContentsMargins(0, 0, 0, 0)
        box.addWidget(self._graph)
        self._log_index: LogIndex | None = None
        self._columns: LogColumns | None = None
        self._length = 1.0
        self._layers: list[Backdrop | Strip] = []
        self._ranges: list[RangeItem] = []
        self._curves: list[Any] = []
        self._notes: list[Any] = []
        self._plots: list[Any] = []
        self._graph.ci.setContentsMargins(0, 0, theme.GRID, 0)
        self._graph.ci.setSpacing(2)
        self._strip = self._new_plot(0)
        self._strip.setMaximumHeight(_STRIP)
        self._strip.setMinimumHeight(_STRIP)
        self._strip.setYRange(0, 1, padding=0)
        self._strip.getAxis("left").setStyle(tickLength=0, showValues=False)
        self._add_layer(self._strip, Strip(partial(term, "stage")))
        for row, channels in enumerate(_PLOTS):
            self._plots.append(self._new_curves(row + 1, *channels))
        for plot in self._all:
            if plot is not self._plots[0]:
                plot.setXLink(self._plots[0])
        self._redraw = QTimer(self)
        self._redraw.setSingleShot(True)
        self._redraw.timeout.connect(self.draw)
        self._plots[0].getViewBox().sigXRangeChanged.connect(self._changed)
        self._plots[0].getViewBox().sigResized.connect(self._changed)
        self._graph.scene().sigMouseMoved.connect(self._point)
        self.retranslate()
        self._dress()

    # What it shows

    def show_log(self, log_index: LogIndex) -> None:
        """Draw a log, all of it."""
        self._log_index = log_index
        self._columns = LogColumns(log_index)
        facts = log_index.facts
        self._length = (facts.last_seq + 1 - facts.first_seq) / log_index.rate
        pad = _MARGIN * self._length
        closest = min(_CLOSEST / log_index.rate, self._length)
        for plot in self._all:
            plot.setLimits(xMin=-pad, xMax=self._length + pad, minXRange=closest, maxXRange=self._length + 2 * pad)
        marked = Marked(log_index)
        for layer in self._layers:
            layer.marked = marked
        for item in self._ranges:
            item.setBounds((0.0, self._length))
            item.setVisible(True)
        self.set_range(facts.first_seq, facts.last_seq)
        self.whole()
        self.draw()

    def close_log(self) -> None:
        """Draw nothing."""
        self._log_index = self._columns = None
        for curve in self._curves:
            curve.clear()
        for layer in self._layers:
            layer.marked = Marked()
        for item in self._ranges:
            item.setVisible(False)

    def set_range(self, first_seq: int, last_seq: int) -> None:
        """Show the chosen range."""
        region = (self._seconds(first_seq), self._seconds(last_seq + 1))
        for item in self._ranges:
            item.blockSignals(True)
            item.setRegion(region)
            item.blockSignals(False)

    def show_samples(self, wanted: Wanted, columns: Columns) -> None:
        """Single samples that were asked for."""
        if self._columns is not None:
            self._columns.keep(wanted, columns)
            self._changed()

    @property
    def view(self) -> tuple[float, float]:
        """What is in view, s from the start of the log."""
        left, right = self._plots[0].getViewBox().viewRange()[0]
        return left, right

    @property
    def range_seconds(self) -> tuple[float, float]:
        """The range shown, s from the start of the log."""
        start, stop = self._ranges[0].getRegion()
        return start, stop

    @property
    def view_box(self) -> Any:
        """What the gyro's curves are drawn into."""
        return self._plots[0].getViewBox()

    @property
    def points(self) -> int:
        """Points that all curves together draw."""
        return sum(0 if curve.xData is None else len(curve.xData) for curve in self._curves)

    @property
    def samples_per_column(self) -> int:
        """Samples that a drawn column joins; 1 where single samples are drawn."""
        return self._drawn

    _drawn = 0

    # Moving about

    def whole(self) -> None:
        """Bring the whole log into view."""
        pad = _MARGIN * self._length
        self._plots[0].setXRange(-pad, self._length + pad, padding=0)

    def show_part(self, first_seq: int, last_seq: int) -> None:
        """Bring a range into view, with a little on either side."""
        start, stop = self._seconds(first_seq), self._seconds(last_seq + 1)
        pad = 0.05 * (stop - start)
        self._plots[0].setXRange(start - pad, stop + pad, padding=0)

    def zoom(self, closer: bool) -> None:
        """Half the view, or twice."""
        left, right = self.view
        half = (right - left) / 2 * (_ZOOM if closer else 1 / _ZOOM)
        centre = (left + right) / 2
        self._plots[0].setXRange(centre - half, centre + half, padding=0)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Plus and minus zoom, arrows move, Home shows all."""
        left, right = self.view
        key = event.key()
        if key in (Qt.Key.Key_Plus, Qt.Key.Key_Equal):
            self.zoom(True)
        elif key == Qt.Key.Key_Minus:
            self.zoom(False)
        elif key in (Qt.Key.Key_Left, Qt.Key.Key_Right):
            shift = (right - left) * (_STEP if key == Qt.Key.Key_Right else -_STEP)
            self._plots[0].setXRange(left + shift, right + shift, padding=0)
        elif key == Qt.Key.Key_Home:
            self.whole()
        else:
            super().keyPressEvent(event)

    # Words and looks

    def retranslate(self) -> None:
        """Say the axes' names in the language in force."""
        x, y, z = (_coloured(axis, theme.AXIS_COLOURS[axis]) for axis in "xyz")
        c = theme.colours()
        outer, inner = _coloured(self.tr("outer"), c.accent), _coloured(self.tr("inner"), c.caution)
        for note, (name, lines) in zip(
            self._notes,
            (
                (self.tr("Gyro, °/s"), (x, y, z)),
                (self.tr("Accelerometer, m/s²"), (x, y, z)),
                (self.tr("Table, °"), (outer, inner)),
            ),
            strict=True,
        ):
            note.setHtml(f'<span style="color:{c.text}">{name}&nbsp;&nbsp;{" ".join(lines)}</span>')
        self.setAccessibleName(self.tr("The log's curves"))
        self._graph.viewport().update()

    def changeEvent(self, event: QEvent) -> None:
        """Follow language and theme."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        elif event.type() == QEvent.Type.PaletteChange:
            self._dress()
        super().changeEvent(event)

    # Inside

    @property
    def _all(self) -> list[Any]:
        return [self._strip, *self._plots]

    def _new_plot(self, row: int) -> Any:
        plot = self._graph.addPlot(row=row, col=0, axisItems={"bottom": TimeAxis()})
        plot.setMenuEnabled(False)
        plot.hideButtons()
        plot.setMouseEnabled(x=True, y=False)
        plot.getViewBox().setDefaultPadding(0.0)
        left = plot.getAxis("left")
        left.setWidth(_AXIS)
        left.enableAutoSIPrefix(False)
        left.setStyle(hideOverlappingLabels=True)
        for side in ("left", "bottom"):
            plot.getAxis(side).setStyle(tickFont=theme.font())
        if row < len(_PLOTS):
            plot.hideAxis("bottom")
        return plot

    def _new_curves(self, row: int, start: int, stop: int) -> Any:
        plot = self._new_plot(row)
        self._add_layer(plot, Backdrop())
        for _ in range(start, stop):
            curve = pg.PlotCurveItem(connect="finite")
            self._curves.append(curve)
            plot.addItem(curve, ignoreBounds=True)
        item = RangeItem()
        item.setVisible(False)
        item.sigRegionChanged.connect(self._dragged)
        self._ranges.append(item)
        plot.addItem(item, ignoreBounds=True)
        note = pg.TextItem(anchor=(0, 0))
        note.setFont(theme.font())
        note.setParentItem(plot.getViewBox())
        note.setPos(4, 0)
        self._notes.append(note)
        return plot

    def _add_layer(self, plot: Any, layer: Backdrop | Strip) -> None:
        plot.addItem(layer, ignoreBounds=True)
        self._layers.append(layer)

    def _dress(self) -> None:
        c = theme.colours()
        self._graph.setBackground(QColor(c.panel))
        for plot in self._all:
            for side in ("left", "bottom"):
                plot.getAxis(side).setPen(QColor(c.line))
                plot.getAxis(side).setTextPen(QColor(c.text))
        self._strip.getAxis("left").setPen(QColor(c.panel))
        colours = [*theme.AXIS_COLOURS.values(), *theme.AXIS_COLOURS.values(), c.accent, c.caution]
        for curve, colour in zip(self._curves, colours, strict=True):
            curve.setPen(QPen(QColor(colour), 0))
        for item in self._ranges:
            item.dress()
        self.retranslate()

    def _seconds(self, seq: int) -> float:
        assert self._log_index is not None
        return (seq - self._log_index.facts.first_seq) / self._log_index.rate

    def _seq(self, seconds: float) -> int:
        assert self._log_index is not None
        facts = self._log_index.facts
        return min(max(facts.first_seq + round(seconds * self._log_index.rate), facts.first_seq), facts.last_seq)

    def _changed(self) -> None:
        if self._log_index is not None and not self._redraw.isActive():
            self._redraw.start(0)

    def _dragged(self, item: RangeItem) -> None:
        start, stop = item.getRegion()
        first, last = self._seq(start), max(self._seq(start), self._seq(stop) - (stop < self._length))
        self.set_range(first, last)
        self.range_moved.emit(first, last)

    def _point(self, place: QPointF) -> None:
        if self._log_index is None:
            return
        box = self._plots[0].getViewBox()
        seconds = box.mapSceneToView(place).x()
        inside = box.sceneBoundingRect().left() <= place.x() <= box.sceneBoundingRect().right()
        self.pointed.emit(self._seq(seconds) if inside and 0 <= seconds <= self._length else None)

    def draw(self) -> None:
        """Draw what is in view."""
        if self._log_index is None or self._columns is None:
            return
        left, right = self.view
        count = max(64, round(self._plots[0].getViewBox().width()))
        columns, wanted = self._columns.view(self._seq(left), self._seq(right), count)
        if wanted is not None:
            self.samples_wanted.emit(wanted)
        self._drawn = columns.samples
        wide = (right - left) * self._log_index.rate / count
        seq, low, high = parted(columns, wide)
        x = np.repeat((seq - self._log_index.facts.first_seq) / self._log_index.rate, 2)
        for plot, (start, stop) in zip(self._plots, _PLOTS, strict=True):
            for channel in range(start, stop):
                y = np.column_stack([low[:, channel], high[:, channel]]).ravel()
                self._curves[channel].setData(x, y)
            _fit(plot, columns, start, stop)


def _fit(plot: Any, columns: Columns, start: int, stop: int) -> None:
    """The vertical range that holds what is drawn."""
    low = columns.low[:, start:stop]
    if len(columns) == 0 or np.isnan(low).all():
        return
    bottom, top = float(np.nanmin(low)), float(np.nanmax(columns.high[:, start:stop]))
    span = (top - bottom) or max(abs(top), 1e-9)
    height = max(plot.getViewBox().height(), 3.0 * _NOTE)
    plot.setYRange(bottom - 0.06 * span, top + span * _NOTE / (height - _NOTE), padding=0)


def _coloured(word: str, colour: str) -> str:
    return f'<b style="color:{colour}">{word}</b>'


assert len(CHANNELS) == _PLOTS[-1][1]
