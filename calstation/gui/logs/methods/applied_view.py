"""An answer applied to a recording or to the unit's stream: what force and rate say before and after, over time."""

import numpy as np
from PySide6.QtCore import QEvent, Qt, QTime, Signal
from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QStackedWidget, QVBoxLayout, QWidget

from calstation.connection import SECONDS, OtherUnit
from calstation.gui.logs.methods.figures import Figure, three_digits
from calstation.gui.logs.methods.plots import MethodPlot
from calstation.gui.widgets import ElidedLabel, EmptyState, JobRow, JobWatch, theme
from calstation.physics import DEGREE_PER_HOUR, MICRO_G
from calstation.results.plots import Applied


class AppliedView(QWidget):
    """`wanted()`: another recording is to be chosen; `unit_wanted()`: the unit is to be listened to.

    `watch` follows the work that computes what is shown.
    """

    wanted = Signal()
    unit_wanted = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.applied: Applied | None = None
        self.other: OtherUnit | None = None
        self._serial, self._taken = "", ""
        self._at_device = self._running = False
        self.watch = JobWatch(self)
        self.force_figure, self.rate_figure = Figure(), Figure()
        self.choose_button = QPushButton()
        self.choose_button.setObjectName("apply_button")
        self.choose_button.clicked.connect(self.wanted)
        self.unit_button = QPushButton()
        self.unit_button.setObjectName("apply_unit_button")
        self.unit_button.clicked.connect(self.unit_wanted)
        self.name_label, self.unit_label = ElidedLabel(), QLabel()
        self.name_label.setProperty("kind", "muted")
        self.unit_label.setProperty("kind", "caution")
        self.unit_label.setWordWrap(True)
        self.unit_label.setObjectName("applied_unit_label")
        self.force_plot, self.rate_plot = MethodPlot(), MethodPlot(log=True)
        self.rate_plot.setXLink(self.force_plot)
        top = QHBoxLayout()
        top.setSpacing(4 * theme.GRID)
        top.addWidget(self.force_figure)
        top.addWidget(self.rate_figure)
        top.addStretch(1)
        for button in (self.unit_button, self.choose_button):
            top.addWidget(button, 0, Qt.AlignmentFlag.AlignTop)
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
        self.applied, self.other, self._serial = None, None, serial
        self._show()

    def set_at_work(self, *, at_device: bool, running: bool) -> None:
        """Whether the unit is being listened to, and whether a calibration is going on."""
        self._at_device, self._running = at_device, running
        self._allow()

    def _done(self, result: Applied | OtherUnit) -> None:
        self.applied, self.other = (None, result) if isinstance(result, OtherUnit) else (result, None)
        self._taken = QTime.currentTime().toString("HH:mm:ss")
        self._show()

    def _show(self) -> None:
        self._stack.setCurrentIndex(0 if self.applied is None else 2)
        for widget in (self.force_figure, self.rate_figure, self.name_label):
            widget.setVisible(self.applied is not None)
        self._draw()

    def _allow(self) -> None:
        self._working.say(self.tr("Listening to the unit") if self._at_device else self.tr("Applying the answer"), "")
        if self._running:
            why_not = self.tr("A calibration is going on; press STOP first.")
        elif self._at_device:
            why_not = self.tr("The unit is being listened to.")
        else:
            why_not = ""
        self.unit_button.setEnabled(not why_not)
        self.unit_button.setToolTip(
            why_not
            or self.tr(
                "Takes {0} s of the unit's stream and shows them before and after; nothing moves, nothing is written"
            ).format(f"{SECONDS:g}")
        )
        self.choose_button.setEnabled(not self._at_device)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self.choose_button.setText(self.tr("Apply to a recording…"))
        self.unit_button.setText(self.tr("From the unit now"))
        self._nothing.say(
            self.tr("Before and after, over time"),
            self.tr(
                "Listen to the unit, or choose any recording of it: what it says at rest is shown before and after."
            ),
        )
        self._allow()
        self._draw()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language or theme."""
        if event.type() in (QEvent.Type.LanguageChange, QEvent.Type.PaletteChange):
            self.retranslate()
        super().changeEvent(event)

    def _draw(self) -> None:
        a = self.applied
        caution = self._caution()
        self.unit_label.setText(caution)
        self.unit_label.setVisible(bool(caution))
        if a is None:
            return
        self.name_label.setText(str(a.path) if a.path is not None else self._word_stream(a))
        force, rate = self.tr("| f | − g at rest, rms"), self.tr("rate at rest, rms")
        for figure, caption, rms, size, unit in (
            (self.force_figure, force, a.length_rms, MICRO_G, "µg"),
            (self.rate_figure, rate, a.rate_rms, DEGREE_PER_HOUR, "°/h"),
        ):
            if a.corrected:
                figure.show_text(caption, f"{three_digits(rms[1] / size)} {unit}")
            else:
                figure.show_change(caption, rms[0] / size, rms[1] / size, unit)
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

    def _caution(self) -> str:
        """What must be known about whose samples these are."""
        a = self.applied
        if self.other is not None:
            return self.tr(
                "The unit that answers is {0}, the answer was found for {1}: put that unit into the fixture, or solve "
                "a recording of this one."
            ).format(self.other.serial, self._serial)
        if a is None:
            return ""
        if a.serial != self._serial:
            return self.tr("This recording is of {0}; the answer was found for {1}.").format(a.serial, self._serial)
        said = []
        if a.corrected:
            said.append(
                self.tr(
                    "The unit's registers have corrected its stream already: it is shown as it comes, and the answer "
                    "is not applied a second time."
                )
            )
        if not a.named:
            said.append(
                self.tr("This unit cannot say its serial number; the answer was found for {0}.").format(self._serial)
            )
        return " ".join(said)

    def _word_stream(self, applied: Applied) -> str:
        return self.tr("Unit {0}, {1:.0f} s of its stream, taken at {2}").format(
            applied.serial, float(applied.time[-1]), self._taken
        )

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
        before, after = (0, c.caution, self.tr("before")), (1, c.accent, self.tr("after"))
        lines = ((1, c.accent, self.tr("as it comes")),) if applied.corrected else (before, after)
        for k, colour, _ in lines:
            plot.line(applied.time, values[k], colour, pale=True)
        for k, colour, _ in lines:
            plot.line(*_steps(applied.rests, means[:, k]), colour, bold=True)
        plot.say(
            [
                (title, c.text),
                *((name, colour) for _, colour, name in lines),
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
