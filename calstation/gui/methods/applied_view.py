"""An answer applied to a recording: what the force and the rate say before and after, over its whole time."""

from pathlib import Path

import numpy as np
from PySide6.QtCore import QEvent, Signal
from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QStackedWidget, QVBoxLayout, QWidget

from calstation.gui import theme
from calstation.gui.methods.figures import Figure
from calstation.gui.methods.plots import MethodPlot
from calstation.gui.widgets.elided import ElidedLabel
from calstation.gui.widgets.empty_state import EmptyState
from calstation.gui.widgets.job_row import JobRow
from calstation.gui.widgets.job_watch import JobWatch
from calstation.physics.units import DEGREE_PER_HOUR, MICRO_G
from calstation.station.applied_picture import Applied


class AppliedView(QWidget):
    """`wanted()`: another recording is to be chosen. `watch` follows the work that computes what is shown."""

    wanted = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.applied: Applied | None = None
        self._serial = ""
        self.watch = JobWatch(self)
        self.force_figure, self.rate_figure = Figure(), Figure()
        self.choose_button = QPushButton()
        self.choose_button.setObjectName("apply_button")
        self.choose_button.clicked.connect(self.wanted)
        self.name_label, self.unit_label = ElidedLabel(), QLabel()
        self.name_label.setProperty("kind", "muted")
        self.unit_label.setProperty("kind", "caution")
        self.unit_label.setWordWrap(True)
        self.force_plot, self.rate_plot = MethodPlot(), MethodPlot(log=True)
        self.rate_plot.setXLink(self.force_plot)
        top = QHBoxLayout()
        top.setSpacing(4 * theme.GRID)
        top.addWidget(self.force_figure)
        top.addWidget(self.rate_figure)
        top.addStretch(1)
        top.addWidget(self.choose_button)
        shown = QWidget()
        column = QVBoxLayout(shown)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(theme.GRID)
        column.addWidget(self.force_plot, 1)
        column.addWidget(self.rate_plot, 1)
        self._working = EmptyState()
        row = JobRow(self.watch)
        row.cancel_button.setObjectName("apply_cancel_button")
        row.setFixedWidth(60 * theme.GRID)
        self._working.add(row)
        self._nothing = EmptyState()
        self._stack = QStackedWidget()
        for widget in (self._nothing, self._working, shown):
            self._stack.addWidget(widget)
        box = QVBoxLayout(self)
        box.setContentsMargins(0, theme.GRID, 0, 0)
        box.setSpacing(theme.GRID)
        box.addLayout(top)
        box.addWidget(self.name_label)
        box.addWidget(self.unit_label)
        box.addWidget(self._stack, 1)
        self.watch.progress.connect(lambda *_: self._stack.setCurrentIndex(1))
        self.watch.cancelled.connect(self._show)
        self.watch.failed.connect(lambda _: self._show())
        self.watch.done.connect(self._done)
        self.retranslate()
        self._show()

    def clear(self, serial: str) -> None:
        """Another answer, of the unit `serial`, is to be applied."""
        self.applied, self._serial = None, serial
        self._show()

    def _done(self, applied: Applied) -> None:
        self.applied = applied
        self._show()

    def _show(self) -> None:
        self._stack.setCurrentIndex(0 if self.applied is None else 2)
        for widget in (self.force_figure, self.rate_figure):
            widget.setVisible(self.applied is not None)
        self._draw()

    def show_source(self, path: Path) -> None:
        """The recording that the answer is applied to."""
        self.name_label.setText(str(path))

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self.choose_button.setText(self.tr("Apply to a recording…"))
        self._working.say(self.tr("Applying the answer"), "")
        self._nothing.say(
            self.tr("Before and after, over a recording's time"),
            self.tr("Choose any recording of the unit: what it says at rest is shown before and after."),
        )
        self._draw()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language or theme."""
        if event.type() in (QEvent.Type.LanguageChange, QEvent.Type.PaletteChange):
            self.retranslate()
        super().changeEvent(event)

    def _draw(self) -> None:
        a = self.applied
        other = a is not None and a.serial != self._serial
        self.unit_label.setVisible(other)
        if a is None:
            return
        if other:
            self.unit_label.setText(
                self.tr("This recording is of {0}; the answer was found for {1}.").format(
                    a.serial, self._serial
                )
            )
        before, after = (value / MICRO_G for value in a.length_rms)
        self.force_figure.show_change(self.tr("| f | − g at rest, rms"), before, after, "µg")
        before, after = (value / DEGREE_PER_HOUR for value in a.rate_rms)
        self.rate_figure.show_change(self.tr("rate at rest, rms"), before, after, "°/h")
        c = theme.colours()
        self._fill(
            self.force_plot,
            a,
            (_at_rest(a, a.length_before) / MICRO_G, _at_rest(a, a.length_after) / MICRO_G),
            a.rest_length / MICRO_G,
            self.tr("| f | − g, µg"),
        )
        self._fill(
            self.rate_plot,
            a,
            (_at_rest(a, a.rate_before) / DEGREE_PER_HOUR, _at_rest(a, a.rate_after) / DEGREE_PER_HOUR),
            a.rest_rate / DEGREE_PER_HOUR,
            self.tr("Rate, °/h"),
            (self.tr("- - the earth's {0:.1f}").format(a.earth / DEGREE_PER_HOUR), c.muted),
        )
        self.rate_plot.limit(a.earth / DEGREE_PER_HOUR, c.muted)
        self.rate_plot.fit()

    def _fill(
        self,
        plot: MethodPlot,
        applied: Applied,
        values: tuple[np.ndarray, np.ndarray],
        means: np.ndarray,
        title: str,
        *more: tuple[str, str],
    ) -> None:
        c = theme.colours()
        plot.empty()
        for begin, end in applied.rests:
            plot.shade(float(begin), float(end))
        for shown, colour in zip(values, (c.caution, c.accent), strict=True):
            plot.line(applied.time, shown, colour, pale=True)
        for k, colour in enumerate((c.caution, c.accent)):
            plot.line(*_steps(applied.rests, means[:, k]), colour, bold=True)
        plot.say(
            [
                (title, c.text),
                (self.tr("before"), c.caution),
                (self.tr("after"), c.accent),
                (self.tr("shaded: rests, bold: their means; s from the start"), c.muted),
                *more,
            ]
        )
        plot.fit()


def _steps(rests: np.ndarray, means: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A level stroke over each rest, interrupted between."""
    time = np.column_stack([rests, rests[:, 1]]).ravel()
    return time, np.column_stack([means, means, np.full(len(means), np.nan)]).ravel()


def _at_rest(applied: Applied, values: np.ndarray) -> np.ndarray:
    """Values at rest, NaN between: in motion neither force nor rate is known otherwise."""
    kept = np.full(len(values), np.nan)
    for begin, end in applied.rests:
        inside = (applied.time >= begin) & (applied.time <= end)
        kept[inside] = values[inside]
    return kept
