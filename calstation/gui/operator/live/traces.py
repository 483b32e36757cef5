"""Live plots of the gyro and accelerometer output, which can be frozen and zoomed during a run."""

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QTimer
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QButtonGroup, QFrame, QWidget

from calstation.gui.text import on_language_change, say
from calstation.gui.widgets import LineLabel, LineLabels, ThemedPlot, button, column, label, row, theme
from calstation.physics import DEGREE, FloatArray
from calstation.sequencer import Trace

#: Selectable time spans, s.
_SPANS = (10.0, 60.0, 600.0)
#: Approximate number of points per line, and maximum number of stored rows (about a quarter of an hour).
_POINTS, _MAX_ROWS = 2000, 16_384
#: Time without new data after which the display states this, ms.
CURRENT_MS = 2000


class _Plot(QWidget):
    """Plot of the output of the three axes of a sensor, with the names of the axes at the ends of the lines."""

    def __init__(self, first: int, factor: float) -> None:
        super().__init__()
        self._columns = slice(first, first + 3)
        self._factor = factor
        self._numbered = True
        self.plot = ThemedPlot()
        self.plot.getAxis("left").setWidth(7 * theme.GRID)
        self.plot.getViewBox().setDefaultPadding(0.02)
        self._curves = [
            pg.PlotCurveItem(pen=theme.pen(colour, 1), skipFiniteCheck=True, name=name)
            for name, colour in theme.AXIS_COLOURS.items()
        ]
        for curve in self._curves:
            self.plot.addItem(curve)
        self._labels = LineLabels(5 * theme.GRID)
        row((self.plot, 1), self._labels, on=self, spacing=0)

    def show_rows(self, rows: FloatArray, span: float) -> None:
        """Draw rows of time, s, and six outputs, shape (n, 7), on an axis that covers the latest `span` s."""
        if bool(len(rows)) is not self._numbered:  # without data, the numbers of the axis would mean nothing
            self._numbered = bool(len(rows))
            self.plot.getAxis("left").setStyle(showValues=self._numbered)
        self.plot.setXRange(-span, 0.0, padding=0.0)
        values = rows[:, 1:][:, self._columns] * self._factor
        times = rows[:, 0] - rows[-1:, 0]
        step = max(1, len(rows) // _POINTS)
        for curve, line in zip(self._curves, values.T, strict=True):
            curve.setData(times[::step], line[::step])
        labels = []
        if len(rows):
            low, high = float(values.min()), float(values.max())
            margin = max(0.05 * (high - low), 1e-3)
            self.plot.setYRange(low - margin, high + margin, padding=0.0)
            box = self.plot.getViewBox()
            for name, value in zip(theme.AXIS_COLOURS, values[-1], strict=True):
                height = box.mapViewToScene(pg.Point(0.0, float(value))).y()
                labels.append(LineLabel(height, name, QColor(theme.axis_text(name)), bold=True))
        self._labels.show_labels(labels)


class Traces(QFrame):
    """Both plots, with buttons that select the time span and freeze the display."""

    def __init__(self) -> None:
        super().__init__()
        self.setProperty("kind", "panel")
        #: Latest rows of time, s, and six outputs, shape (n, 7).
        self.rows: FloatArray = np.empty((0, 7))
        self._new_rows = False
        self._gyro, self._accel = _Plot(0, 1.0 / DEGREE), _Plot(3, 1.0)
        self._accel.plot.setXLink(self._gyro.plot)
        self._gyro.plot.getAxis("bottom").setStyle(showValues=False)
        self.hold_button = button("", "operator.hold", tip="operator.hold_tip")
        self.hold_button.setCheckable(True)
        self.hold_button.toggled.connect(lambda checked: None if checked else self._draw_again())
        for plot in (self._gyro, self._accel):
            box = plot.plot.getViewBox()
            box.sigRangeChangedManually.connect(lambda *_: self.hold_button.setChecked(True))
            box.sig_reset.connect(lambda: self.hold_button.setChecked(False))
        self._spans = QButtonGroup(self)
        for number, words in enumerate(("operator.seconds_10", "operator.minute_1", "operator.minutes_10")):
            span_button = button("", words)
            span_button.setCheckable(True)
            span_button.setChecked(number == 1)
            self._spans.addButton(span_button, number)
        self._spans.idClicked.connect(self._choose_span)
        plots = column(
            label("common.gyro_dps", "muted"),
            (self._gyro, 1),
            label("common.accel_mps2", "muted"),
            (self._accel, 1),
            spacing=0,
        )
        buttons = column(*self._spans.buttons(), None, self.hold_button)
        row((plots, 1), buttons, on=self, margins=(theme.GRID,) * 4)
        self._timer = QTimer(self, interval=33)
        self._timer.timeout.connect(self._draw)
        #: Timer that is active while the last rows are current.
        self._current = QTimer(self, singleShot=True, interval=CURRENT_MS)
        self._current.timeout.connect(self._show_axis)
        on_language_change(self, self._show_axis)
        self._show_rows()

    def add(self, trace: Trace) -> None:
        """Store a trace, which the next timer event draws."""
        times = np.array(trace.time)
        rows = np.column_stack((times, np.array(trace.output).reshape(len(times), 6)))
        self.rows = np.concatenate((self.rows, rows))[-_MAX_ROWS:]
        self._new_rows = True
        was_current = self._current.isActive()
        self._current.start()
        if not was_current:
            self._show_axis()

    def start(self) -> None:
        """Clear the plots and start drawing for a new run."""
        self.clear()
        self.hold_button.setChecked(False)
        self._timer.start()

    def clear(self) -> None:
        """Clear the plots for another unit."""
        self.rows = np.empty((0, 7))
        self._new_rows = True
        self._show_axis()

    def stop(self) -> None:
        """Stop drawing at the end of a run; the lines remain visible."""
        self._draw()
        self._timer.stop()
        self._show_axis()

    def _show_axis(self) -> None:
        """Label the time axis, which ends at the last sample if no new samples arrive."""
        old = self._timer.isActive() and len(self.rows) and not self._current.isActive()
        axis = self._accel.plot.getAxis("bottom")
        axis.setLabel(say("operator.axis_no_data" if old else "operator.axis_before_now"))
        axis.resizeEvent()  # centres the label

    def _choose_span(self) -> None:
        self.hold_button.setChecked(False)
        self._draw_again()

    def _draw_again(self) -> None:
        for plot in (self._gyro, self._accel):
            plot.plot.getViewBox().reset()
        self._new_rows = True
        self._draw()

    def _draw(self) -> None:
        """Draw new rows, unless the display is frozen."""
        if self._new_rows and not self.hold_button.isChecked() and self.isVisible():
            self._new_rows = False
            self._show_rows()

    def _show_rows(self) -> None:
        rows, span = self.rows, _SPANS[self._spans.checkedId()]
        if len(rows):
            rows = rows[np.searchsorted(rows[:, 0], rows[-1, 0] - span) :]
        for plot in (self._gyro, self._accel):
            plot.show_rows(rows, span)
