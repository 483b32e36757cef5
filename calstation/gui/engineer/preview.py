"""The preview: motion, time, limits and expected sigmas of the chosen stages, before anything moves."""

from functools import partial

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QCoreApplication, Qt, Signal
from PySide6.QtWidgets import QSplitter, QStackedWidget, QWidget

from calstation.errors import CalstationError
from calstation.gui.engineer.stacked_plots import StackedPlots, dashed, name_axis
from calstation.gui.text import duration_text, error_text, on_language_change, show, step_sentence, term
from calstation.gui.widgets import (
    Column,
    EmptyState,
    JobRow,
    JobWatch,
    ParameterModel,
    ParameterTable,
    StateBadge,
    button,
    column,
    enable,
    label,
    row,
    theme,
)
from calstation.physics import INDEX, NAMES, display
from calstation.results import Preview, Violation

#: Height of a row of the table, px.
_ROW = 26


class PreviewView(QWidget):
    """The preview and the button that asks for it with `wanted`."""

    wanted = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.preview: Preview | None = None
        self._outdated = False
        self._error: CalstationError | None = None
        self.watch = JobWatch(self)
        self.watch.done.connect(self._done)
        self.watch.failed.connect(self._failed)
        self.watch.cancelled.connect(self._ended)
        self._job = JobRow(self.watch)
        self._job.hide()
        self._button = button("preview_button", lambda: self.tr("Preview"), self.wanted)
        self._badge = StateBadge()
        self._summary = label(name="preview_summary")
        self._problems = label(kind="error", name="preview_violations", wrap=True)
        self._problems.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._plot = MotionPlot()
        self._plot.setMinimumHeight(22 * theme.GRID)
        self._model = ParameterModel(())
        self._table = ParameterTable(self._model)
        self._table.setObjectName("preview_table")
        self._table.verticalHeader().setDefaultSectionSize(_ROW)
        self._empty = EmptyState()
        split = QSplitter(Qt.Orientation.Vertical)
        split.setChildrenCollapsible(False)
        for stretch, widget in ((2, self._plot), (3, self._table)):
            split.addWidget(widget)
            split.setStretchFactor(split.count() - 1, stretch)
        split.setSizes([26 * theme.GRID, 36 * theme.GRID])
        self._stack = QStackedWidget()
        self._stack.addWidget(self._empty)
        self._stack.addWidget(split)
        column(
            row(self._badge, (self._summary, 1), (self._job, 1), self._button, spacing=2 * theme.GRID),
            self._problems,
            (self._stack, 1),
            on=self,
            margins=(0, theme.GRID, 0, 0),
        )
        on_language_change(self, self._show_texts)

    def mark_outdated(self) -> None:
        """Show that the choice has changed since this preview."""
        self._outdated = self.preview is not None
        self._refresh()

    def begin(self) -> None:
        """Show that a preview is being computed."""
        self._error = None
        self._job.show()
        self._refresh()

    def set_why_not(self, why: str) -> None:
        """Enable the button, or disable it with the reason."""
        enable(self._button, why)

    def _show_texts(self) -> None:
        self._empty.say(
            self.tr("A preview moves nothing"),
            self.tr(
                "Choose what to calibrate on the left and press Preview: it shows both axes' angles against time, "
                "the total time, whether the table can do it, and the expected sigma of every parameter."
            ),
        )
        self._model.refresh()
        self._refresh()

    def _done(self, preview: Preview) -> None:
        self.preview, self._outdated = preview, False
        self._plot.show_preview(preview)
        self._model.set_names(())
        self._model.set_columns(_Columns(preview).all)
        self._model.set_names(_names(preview))
        self._table.setVisible(not preview.violations)
        self._stack.setCurrentIndex(1)
        self._ended()

    def _failed(self, error: CalstationError) -> None:
        self._error = error
        self._ended()

    def _ended(self) -> None:
        self._job.hide()
        self._refresh()

    def _refresh(self) -> None:
        preview, busy = self.preview, self.watch.busy
        self._button.setVisible(not busy)
        self._summary.setVisible(not busy)
        self._badge.setVisible(not busy and preview is not None and not self._error)
        problems = [error_text(self._error).sentences] if self._error else []
        summary = ""
        if preview is not None:
            moves = sum(stage.moves for stage in preview.stages)
            summary = self.tr("{0} in all, {1} moves").format(duration_text(preview.duration), moves)
            if self._outdated:
                summary = self.tr("{0}; the choice has changed since, preview again").format(summary)
            else:
                problems += self._problems_of(preview)
            self._badge.show_state(*self._verdict(preview))
        self._summary.setText(summary)
        self._problems.setText("\n".join(problems))
        self._problems.setVisible(bool(problems) and not busy)

    def _verdict(self, preview: Preview) -> tuple[str, str]:
        if self._outdated:
            return "waiting", self.tr("out of date")
        if preview.violations:
            return "bad", self.tr("beyond the table's limits")
        if any(stage.sigma is None for stage in preview.stages):
            return "bad", self.tr("cannot be solved")
        missed = sum(_reached(preview, name) is False for name in _names(preview))
        if missed:
            return "caution", self.tr("within the table's limits, {0} sigma limits missed").format(missed)
        return "good", self.tr("within the table's limits, every sigma limit reached")

    def _problems_of(self, preview: Preview) -> list[str]:
        problems = [self._violation_text(violation) for violation in preview.violations]
        for stage in preview.stages:
            name = term("stage", stage.stage)
            if stage.error:
                problems.append(f"{name}: {show(stage.error)}")
            if stage.reason == "" and not preview.violations:
                sentence = self.tr("{0}: {1} rounds do not reach its targets; set rounds or a duration.")
                problems.append(sentence.format(name, stage.rounds))
        return problems

    def _violation_text(self, violation: Violation) -> str:
        """A violated limit with its step and the remedy."""
        stage = term("stage", violation.stage)
        if violation.kind == "plan":
            return f"{stage}: {show(violation.text)}"
        move = step_sentence("move", violation.label)
        where = self.tr("{0}, move {1} ({2})").format(stage, violation.step, move)
        if violation.more:
            where = self.tr("{0} and {1} more").format(where, violation.more)
        value, low, high = (float(v) for v in np.rad2deg([violation.value, violation.low, violation.high]))
        if violation.kind == "rate":
            text = self.tr("rate {0:g} °/s, the table reaches {1:g} °/s; lower the rate")
            return f"{where}: {text.format(value, round(high, 6))}"
        if violation.kind == "acceleration":
            text = self.tr("acceleration {0:g} °/s², the table reaches {1:g} °/s²; lower the acceleration")
            return f"{where}: {text.format(value, round(high, 6))}"
        joint = self.tr("outer axis") if violation.joint == "outer" else self.tr("inner axis")
        text = self.tr("{0} to {1:.1f}°, its travel is {2:.0f}° to {3:.0f}°; choose fewer turns or rounds")
        return f"{where}: {text.format(joint, value, low, high)}"


class MotionPlot(StackedPlots):
    """The angles of both joints against time, with the stages and the travel."""

    def __init__(self) -> None:
        super().__init__(2, 9 * theme.GRID)
        self._preview: Preview | None = None
        for plot in self.plots:
            plot.getPlotItem().getViewBox().setDefaultPadding(0.1)
            plot.setMinimumHeight(8 * theme.GRID)
        column(*((plot, 1) for plot in self.plots), on=self, spacing=0)

    def show_preview(self, preview: Preview) -> None:
        """Draw the motion of a preview."""
        self._preview = preview
        self.refresh()

    def draw(self) -> None:
        """Draw angles, bands and travel."""
        preview = self._preview
        if preview is None:
            return
        c = theme.colours()
        self.add_bands([(term("stage", s.stage), s.begin / 60.0, s.end / 60.0) for s in preview.stages])
        angles = (preview.outer, preview.inner)
        titles = (self.tr("outer, °"), self.tr("inner, °"))
        for plot, title, angle, travel in zip(self.plots, titles, angles, preview.travel, strict=True):
            name_axis(plot, "left", title)
            pen = pg.mkPen(c.accent, width=1)
            self.add(plot, pg.PlotDataItem(preview.time / 60.0, np.rad2deg(angle), pen=pen))
            for end in travel:
                if np.isfinite(end):
                    line = pg.InfiniteLine(np.rad2deg(end), 0, pen=dashed(c.bad))
                    self.add(plot, line, scaled=False)
            plot.enableAutoRange()
        name_axis(self.plots[1], "bottom", self.tr("time, min"))
        self.plots[0].setXRange(0.0, max(preview.duration / 60.0, 1e-3), padding=0.01)


class _Columns:
    """Columns of the table: unit, sigma before, after each stage, limit, target, verdict."""

    def __init__(self, preview: Preview) -> None:
        self._preview = preview
        stages = [
            Column(
                partial(term, "stage", stage.stage),
                partial(self._sigma_after, number),
                hint=partial(self._gain, number),
            )
            for number, stage in enumerate(preview.stages)
        ]
        self.all = [
            Column(lambda: self.tr("Unit"), lambda name: display(name, 0.0)[1], number=False),
            Column(lambda: self.tr("σ before"), lambda name: _shown(name, float(preview.before[INDEX[name]]))),
            *stages,
            Column(lambda: self.tr("σ limit"), lambda name: _bound(name, preview.limits.get(name))),
        ]
        if preview.targets:
            self.all.append(Column(lambda: self.tr("σ target"), lambda name: _bound(name, preview.targets.get(name))))
        self.all.append(Column(lambda: self.tr("Expected"), self._verdict, number=False, state=self._state))

    def tr(self, text: str) -> str:
        """The text in the current language."""
        return QCoreApplication.translate("_Columns", text)

    def _sigma_after(self, number: int, name: str) -> str:
        sigma = self._preview.stages[number].sigma
        return "—" if sigma is None else _shown(name, float(sigma[INDEX[name]]))

    def _gain(self, number: int, name: str) -> str:
        """By how much a stage improves a parameter."""
        stage = self._preview.stages[number]
        if stage.sigma is None:
            return "" if stage.error is None else show(stage.error)
        before = self._preview.before if number == 0 else self._preview.stages[number - 1].sigma
        if name not in stage.estimated or before is None:
            return self.tr("This stage does not estimate it.")
        after = float(stage.sigma[INDEX[name]])
        gain = float(before[INDEX[name]]) / after if after > 0.0 else 1.0
        return self.tr("{0:.3g} times better known than before this stage").format(gain)

    def _verdict(self, name: str) -> str:
        reached = _reached(self._preview, name)
        if reached is None:
            return "—" if name in self._preview.limits else self.tr("no limit")
        return self.tr("reached") if reached else self.tr("missed")

    def _state(self, name: str) -> str | None:
        reached = _reached(self._preview, name)
        return None if reached is None else "good" if reached else "bad"


def _names(preview: Preview) -> tuple[str, ...]:
    """Parameters that some stage estimates, in the order of the parameter table."""
    estimated = {name for stage in preview.stages for name in stage.estimated}
    return tuple(name for name in NAMES if name in estimated)


def _reached(preview: Preview, name: str) -> bool | None:
    """Whether a parameter will meet its sigma limit, None if unknown or without a limit."""
    sigma = preview.stages[-1].sigma if preview.stages else None
    limit = preview.limits.get(name)
    return None if sigma is None or limit is None else float(sigma[INDEX[name]]) <= limit


def _shown(name: str, sigma: float) -> str:
    """A sigma in the unit shown, with three digits."""
    value = abs(display(name, sigma)[0])
    if value >= 1000.0:
        return f"{value:.0f}"
    return f"{value:#.3g}".rstrip(".") if value >= 1e-4 else f"{value:.2g}"


def _bound(name: str, bound: float | None) -> str:
    return "" if bound is None else _shown(name, bound)
