"""Live gyro and accelerometer output: three lines each, which can be held and zoomed during the run."""

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QTimer
from PySide6.QtGui import QColor
from PySide6.QtWidgets import (
    QButtonGroup,
    QFrame,
    QGridLayout,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from calstation.gui.text import bind, on_language_change
from calstation.gui.widgets import LineLabel, LineLabels, ThemedPlot, label, row, theme
from calstation.physics import FloatArray
from calstation.sequencer import Trace


class RingBuffer:
    """Keeps the newest `capacity` rows of `columns` numbers; reading returns them in order."""

    def __init__(self, capacity: int, columns: int) -> None:
        self._capacity = capacity
        self._rows = np.zeros((2 * capacity, columns))
        self._end = 0
        self.written = 0

    def append(self, rows: FloatArray) -> None:
        """Append rows, shape (n, columns)."""
        rows = rows[-self._capacity :]
        count = len(rows)
        if self._end + count > len(self._rows):
            kept = min(self._end, self._capacity)
            self._rows[:kept] = self._rows[self._end - kept : self._end]
            self._end = kept
        self._rows[self._end : self._end + count] = rows
        self._end += count
        self.written += count

    def latest(self) -> FloatArray:
        """The rows, oldest first, shape (n, columns); a view, valid until the next `append`."""
        return self._rows[max(0, self._end - self._capacity) : self._end]

    def clear(self) -> None:
        """Remove all rows."""
        self._end = 0
        self.written += 1


#: Ticks kept, a quarter of an hour of device time.
_KEPT = 16_384

#: Interval between two drawings, ms.
_EVERY = 33

#: Spans that can be chosen, s.
WINDOWS = (10.0, 60.0, 600.0)

_FIRST_WINDOW = 1
_PER_DEGREE = 180.0 / np.pi


class _Plot(QWidget):
    """The three lines of a sensor with their names at the ends."""

    def __init__(self, first: int, factor: float) -> None:
        super().__init__()
        self._columns = slice(first, first + 3)
        self._factor = factor
        self.plot = ThemedPlot()
        self.plot.getAxis("left").setWidth(7 * theme.GRID)
        self.plot.getViewBox().setMouseEnabled(x=True, y=False)
        self.plot.getViewBox().setDefaultPadding(0.02)
        self.plot.getPlotItem().setContentsMargins(0, theme.GRID, 0, 0)
        self.curves = []
        for colour in theme.AXIS_COLOURS.values():
            curve = pg.PlotCurveItem(pen=pg.mkPen(colour, width=1), skipFiniteCheck=True)
            self.plot.addItem(curve)
            self.curves.append(curve)
        self._labels = LineLabels(5 * theme.GRID)
        row((self.plot, 1), self._labels, on=self, spacing=0)

    def show_rows(self, rows: np.ndarray, span: float) -> None:
        """Draw rows, shape (n, 7): time, s, and six outputs; the newest `span` s fill the width."""
        times = rows[:, 0] - (rows[-1, 0] if len(rows) else 0.0)
        values = rows[:, 1:][:, self._columns] * self._factor
        step = max(1, len(rows) // 2000)
        for curve, column in zip(self.curves, values.T, strict=True):
            curve.setData(times[::step], column[::step])
        if len(rows):
            low, high = float(values.min()), float(values.max())
            room = max(0.05 * (high - low), 1e-3)
            self.plot.setYRange(low - room, high + room, padding=0.0)
        self.plot.setXRange(-span, 0.0, padding=0.0)
        self.name_lines(values[-1] if len(rows) else None)

    def name_lines(self, ends: np.ndarray | None) -> None:
        """Label the lines at the height of their ends, shape (3,)."""
        if ends is None:
            self._labels.show_labels([])
            return
        box = self.plot.getViewBox()
        self._labels.show_labels(
            [
                LineLabel(box.mapViewToScene(pg.Point(0.0, float(value))).y(), name, QColor(colour), bold=True)
                for (name, colour), value in zip(theme.AXIS_COLOURS.items(), ends, strict=True)
            ]
        )


class Traces(QFrame):
    """Both plots with the buttons for their span and for holding them."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("kind", "panel")
        self._ring = RingBuffer(_KEPT, 7)
        self._drawn = -1
        self._gyro, self._accel = _Plot(0, _PER_DEGREE), _Plot(3, 1.0)
        self._accel.plot.setXLink(self._gyro.plot)
        self._gyro.plot.getAxis("bottom").setStyle(showValues=False)
        titles = (
            label(lambda: self.tr("Gyro, °/s"), "muted"),
            label(lambda: self.tr("Accelerometer, m/s²"), "muted"),
        )
        self._spans = QButtonGroup(self)
        self.hold_button = QPushButton()
        bind(self.hold_button, lambda: self.tr("Hold"))
        bind(self.hold_button.setToolTip, lambda: self.tr("Holds the plot; the run and its recording go on."))
        self.hold_button.setCheckable(True)
        self.hold_button.toggled.connect(self._hold)
        buttons = QVBoxLayout()
        buttons.setSpacing(theme.GRID)
        names = (lambda: self.tr("10 s"), lambda: self.tr("1 min"), lambda: self.tr("10 min"))
        for number, name in enumerate(names):
            button = QPushButton()
            bind(button, name)
            button.setCheckable(True)
            button.setChecked(number == _FIRST_WINDOW)
            self._spans.addButton(button, number)
            buttons.addWidget(button)
        self._spans.idClicked.connect(self._choose_span)
        buttons.addStretch(1)
        buttons.addWidget(self.hold_button)
        grid = QGridLayout()
        grid.setSpacing(0)
        for at, (title, plot) in enumerate(zip(titles, (self._gyro, self._accel), strict=True)):
            grid.addWidget(title, 2 * at, 0)
            grid.addWidget(plot, 2 * at + 1, 0)
            grid.setRowStretch(2 * at + 1, 1)
            plot.plot.getViewBox().sigRangeChangedManually.connect(self._zoomed)
        row((grid, 1), buttons, on=self, margins=(theme.GRID,) * 4)
        self._timer = QTimer(self)
        self._timer.setInterval(_EVERY)
        self._timer.timeout.connect(self._draw)
        on_language_change(self, lambda: self._accel.plot.setLabel("bottom", self.tr("device time before now, s")))
        self._show()

    @property
    def span(self) -> float:
        """Span shown while the plots follow, s."""
        return WINDOWS[self._spans.checkedId()]

    def take(self, trace: Trace) -> None:
        """Store a trace; the timer draws it."""
        times = np.array(trace.time)
        self._ring.append(np.column_stack((times, np.array(trace.output).reshape(len(times), 6))))

    def start(self) -> None:
        """Start with a new run."""
        self._ring.clear()
        self.hold_button.setChecked(False)
        self._timer.start()

    def stop(self) -> None:
        """Stop with the end of the run; the lines stay."""
        self._draw()
        self._timer.stop()

    def _zoomed(self) -> None:
        """Hold the plot when the user zooms or drags it."""
        self.hold_button.setChecked(True)

    def _choose_span(self, number: int) -> None:
        self.hold_button.setChecked(False)
        self._drawn = -1
        self._draw()

    def _hold(self, held: bool) -> None:
        if not held:
            self._drawn = -1
            self._draw()

    def _draw(self) -> None:
        if self._ring.written == self._drawn or self.hold_button.isChecked() or not self.isVisible():
            return
        self._drawn = self._ring.written
        self._show()

    def _show(self) -> None:
        rows = self._ring.latest()
        if len(rows):
            rows = rows[np.searchsorted(rows[:, 0], rows[-1, 0] - self.span) :]
        for plot in (self._gyro, self._accel):
            plot.show_rows(rows, self.span)
