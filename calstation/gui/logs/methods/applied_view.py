"""The view of a solution that is applied to a recording or to live data: force and rate over time before and after."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PySide6.QtCore import Qt, QTime
from PySide6.QtWidgets import QWidget

from calstation.connection import SECONDS, OtherUnit, apply_to_unit
from calstation.gui.logs.methods.plots import Figure, MethodPlot, three_digits
from calstation.gui.logs.source_bar import ask_log
from calstation.gui.state import JobView
from calstation.gui.text import say
from calstation.gui.widgets import (
    ElidedLabel,
    EmptyState,
    JobRow,
    box,
    button,
    column,
    enable,
    label,
    row,
    show_text,
    stack,
    theme,
)
from calstation.physics import DEGREE_PER_HOUR, MICRO_G, FloatArray
from calstation.results.plots import Applied, MethodSolution, apply_to_recording, before_and_after


class AppliedView(QWidget):
    """A view that applies a solution to its own recording, to a selected recording or to the connected unit."""

    def __init__(self, panel: JobView) -> None:
        super().__init__()
        self._panel, self._app = panel, panel.app
        #: The current solution, and the solution that the running job applies.
        self._solution: MethodSolution | None = None
        self._applying: MethodSolution | None = None
        self.applied: Applied | None = None
        self._other_unit: OtherUnit | None = None
        self._received = ""
        self.watch = panel.job(None, self._done, failure="logs.answer_not_applied")
        self.force_figure, self.rate_figure = Figure(), Figure()
        self.choose_button = button("apply_button", "logs.apply_to_recording_button", self._choose)
        self.unit_button = button("apply_unit_button", "logs.apply_to_unit", self._apply_to_unit)
        self.name_label = ElidedLabel("muted")
        self.unit_label = label(kind="caution", name="applied_unit_label", wrap=True)
        self.force_plot, self.rate_plot = MethodPlot(), MethodPlot(log=True)
        self.rate_plot.setXLink(self.force_plot)
        plots = box((self.force_plot, 1), (self.rate_plot, 1))
        progress = JobRow(self.watch, "apply_cancel_button")
        progress.setFixedWidth(60 * theme.GRID)
        self._nothing = EmptyState(title="logs.before_after_time", text="logs.about_applied")
        self._working = EmptyState(progress)
        self._stack = stack(self._nothing, self._working, plots)
        top = Qt.AlignmentFlag.AlignTop
        buttons = row((self.unit_button, 0, top), (self.choose_button, 0, top), spacing=4 * theme.GRID)
        figures = row(self.force_figure, self.rate_figure, None, buttons, spacing=4 * theme.GRID)
        parts = figures, self.name_label, self.unit_label, (self._stack, 1)
        column(*parts, on=self, margins=(0, theme.GRID, 0, 0))
        self.watch.busy_changed.connect(self._update)
        self._app.engine_link.running_changed.connect(self._update)
        theme.on_appearance_change(self, self._refresh)

    def show_solution(self, solution: MethodSolution) -> None:
        """Show a solution applied to its own recording."""
        self._solution = solution
        self.applied = self._other_unit = None
        self._refresh()
        self.apply(solution.recording.path)

    def apply(self, path: Path) -> None:
        """Apply the solution to a recording, and show the data before and after."""
        if self._solution is not None and not self._reading_unit:
            files = path, self._solution.recording.registers
            self._begin(apply_to_recording, *files, *self._vectors(self._solution))

    def _apply_to_unit(self) -> None:
        """Apply the solution to a few seconds of the unit's live data, and show the data before and after."""
        if self._solution is None or self._reading_unit or self._app.engine_link.running:
            return
        files = self._solution.recording.path, self._app.station_path, self._app.product_path
        self._begin(apply_to_unit, *files, *self._vectors(self._solution), cancellable=False)

    def _begin(self, work: Callable[..., object], *args: object, cancellable: bool = True) -> None:
        self._applying = self._solution
        self._panel.notice.dismiss()
        self.watch.start(work, *args, cancellable=cancellable)

    @property
    def _reading_unit(self) -> bool:
        """Whether the running job reads the unit, so that it cannot be cancelled or replaced."""
        job = self.watch.job
        return job is not None and not job.cancellable

    @staticmethod
    def _vectors(solution: MethodSolution) -> tuple[FloatArray, FloatArray]:
        """Return all parameters before and after; parameters that the method does not estimate are equal."""
        return before_and_after({name: value for name, (value, _) in solution.before.items()}, solution.parameters)

    def _choose(self) -> None:
        if self._solution is not None:
            ask_log(self, say("logs.apply_to_recording"), self._solution.recording.path.parent, self.apply)

    def _done(self, result: Applied | OtherUnit) -> None:
        if self._solution is not None and self._applying is not self._solution:
            self.apply(self._solution.recording.path)
            return
        self.applied, self._other_unit = (None, result) if isinstance(result, OtherUnit) else (result, None)
        self._received = QTime.currentTime().toString("HH:mm:ss")
        self._refresh()

    def _refresh(self) -> None:
        show_text(self.unit_label, self._unit_warning())
        for widget in (self.force_figure, self.rate_figure, self.name_label):
            widget.setVisible(self.applied is not None)
        if self.applied is not None:
            self._draw(self.applied)
        self._update()

    def _update(self) -> None:
        self._stack.setCurrentIndex(1 if self.watch.busy else 0 if self.applied is None else 2)
        self._working.say("logs.receiving" if self._reading_unit else "logs.applying")
        busy = say("logs.receiving_busy") if self._reading_unit else ""
        why_not = say("window.busy_run") if self._app.engine_link.running else busy
        enable(self.unit_button, why_not, say("logs.receive_tip", seconds=SECONDS))
        enable(self.choose_button, busy)

    def _unit_warning(self) -> str:
        """Return a warning about the unit that produced the samples, or ""."""
        a, serial = self.applied, self._solution.recording.serial if self._solution is not None else ""
        if self._other_unit is not None:
            return say("applied.other_unit", connected=self._other_unit.serial, serial=serial)
        if a is None:
            return ""
        if a.serial != serial:
            return say("applied.other_recording", recorded=a.serial, serial=serial)
        corrected = say("applied.corrected") if a.corrected else ""
        unnamed = "" if a.named else say("applied.unnamed", serial=serial)
        return f"{corrected} {unnamed}".strip()

    def _draw(self, a: Applied) -> None:
        received = say("logs.received", serial=a.serial, seconds=float(a.time[-1]), time=self._received)
        self.name_label.setText(received if a.path is None else str(a.path))
        force, rate = say("logs.force_at_rest"), say("logs.rate_at_rest")
        for figure, caption, rms, size, unit in (
            (self.force_figure, force, a.length_rms, MICRO_G, "µg"),
            (self.rate_figure, rate, a.rate_rms, DEGREE_PER_HOUR, "°/h"),
        ):
            if a.corrected:
                figure.show_text(caption, f"{three_digits(rms[1] / size)} {unit}")
            else:
                figure.show_change(caption, rms[0] / size, rms[1] / size, unit)
        c = theme.colours()
        curves = np.column_stack([a.length_before, a.length_after]) / MICRO_G
        note = self._fill(self.force_plot, a, curves, a.rest_length / MICRO_G)
        self.force_plot.finish([(say("logs.force_error"), c.text), *note])
        curves = np.column_stack([a.rate_before, a.rate_after]) / DEGREE_PER_HOUR
        note = self._fill(self.rate_plot, a, curves, a.rest_rate / DEGREE_PER_HOUR)
        earth = a.earth / DEGREE_PER_HOUR
        self.rate_plot.limit(earth, c.muted)
        earth_note = (say("logs.earth_rate", rate=earth), c.muted)
        self.rate_plot.finish([(say("logs.rate_dph"), c.text), *note, earth_note])

    def _fill(self, plot: MethodPlot, a: Applied, curves: FloatArray, means: FloatArray) -> list[tuple[str, str]]:
        """Draw the curves and the means at rest, whose columns are before and after, and return their legend."""
        c = theme.colours()
        plot.empty()
        at_rest = np.zeros(len(a.time), bool)
        for begin, end in a.rests:
            plot.shade(float(begin), float(end))
            at_rest |= (a.time >= begin) & (a.time <= end)
        before, after = (0, c.caution, say("logs.before")), (1, c.accent, say("logs.after"))
        lines = [(1, c.accent, say("logs.as_received"))] if a.corrected else [before, after]
        for k, colour, _ in lines:
            plot.line(a.time, np.where(at_rest, curves[:, k], np.nan), colour, faint=True)
        time = np.column_stack([a.rests, a.rests[:, 1]]).ravel()
        for k, colour, _ in lines:
            steps = np.column_stack([means[:, k], means[:, k], np.full(len(means), np.nan)]).ravel()
            plot.line(time, steps, colour, bold=True)
        shaded = say("logs.shaded_rests"), c.muted
        return [*((name, colour) for _, colour, name in lines), shaded]
