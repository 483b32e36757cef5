"""Preview of the selected stages: motion, duration, violated limits and expected sigmas, computed before the run."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QWidget

from calstation.config import RunRequest
from calstation.errors import CalstationError
from calstation.gui.engineer.registers_view import UNNAMED
from calstation.gui.state import AppContext
from calstation.gui.text import duration_text, on_language_change, say, step_sentence, term
from calstation.gui.widgets import (
    Band,
    Cell,
    CellTable,
    EmptyState,
    JobRow,
    StackedPlots,
    StateBadge,
    button,
    column,
    dashed,
    label,
    row,
    show_text,
    split,
    stack,
    theme,
    time_unit,
)
from calstation.messages import Text, rounds_text
from calstation.physics import INDEX, NAMES, compared_number, display, limit_number, unit_of_parameter
from calstation.results import Preview, Violation, compute_preview


class PreviewView(QWidget):
    """A view of the preview of the run that `request` returns, and a button that computes it."""

    def __init__(self, app: AppContext, request: Callable[[], RunRequest]) -> None:
        super().__init__()
        self._request = request
        self.preview: Preview | None = None
        #: Whether the selection has changed since the displayed preview was started, and since the latest start.
        self._outdated = self._next_outdated = False
        self._error: CalstationError | None = None
        self._unit_named = False  #: Whether the latest preview was started with a serial number.
        self.watch = app.job(self, compute_preview, self._done, failed=self._show_error, cancelled=self._refresh)
        self._job = JobRow(self.watch)
        self.button = button("preview_button", "engineer.preview", self._start)
        self._badge = StateBadge()
        self._summary = label(name="preview_summary", wrap=True)
        self._problems = label(kind="error", name="preview_violations", wrap=True)
        self._problems.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._ends = label(kind="muted", name="preview_ends", wrap=True)
        self._plot = MotionPlot()
        self._plot.setMinimumHeight(22 * theme.GRID)
        self._table = CellTable("preview_table", grouped=True)
        self._empty = EmptyState(title="engineer.preview_empty", text="engineer.preview_about")
        self._stack = stack(self._empty, split((self._plot, 2), (self._table, 3), along=Qt.Orientation.Vertical))
        column(
            row(self._badge, (self._summary, 1), (self._job, 1), self.button, spacing=2 * theme.GRID),
            self._problems,
            self._ends,
            (self._stack, 1),
            on=self,
            margins=(0, theme.GRID, 0, 0),
        )
        on_language_change(self, self._show_texts)

    def mark_outdated(self) -> None:
        """Mark the preview as outdated after the selection has changed."""
        self._outdated = self._next_outdated = True
        self._refresh()

    def _start(self) -> None:
        self._next_outdated = False
        request = self._request()
        self._unit_named = request.serial != UNNAMED
        self.watch.start(request)
        self._show_error(None)

    def _done(self, preview: Preview) -> None:
        self.preview, self._outdated = preview, self._next_outdated
        self._plot.show_data(preview)
        self._plot.setVisible(bool(preview.outer.any() or preview.inner.any()))  # unknown for a gimbal
        self._table.setVisible(not preview.violations)
        self._stack.setCurrentIndex(1)
        self._show_texts()

    def _show_texts(self) -> None:
        preview = self.preview
        if preview is not None:
            cells = {name: _cells(preview, name) for name in _names(preview)}
            self._table.show_cells(cells, columns=_columns(preview))
        self._refresh()

    def _show_error(self, error: CalstationError | None) -> None:
        self._error = error
        self._refresh()

    def _refresh(self) -> None:
        preview, busy = self.preview, self.watch.busy
        self._job.setVisible(busy)
        self.button.setVisible(not busy)
        self._summary.setVisible(not busy)
        self._badge.setVisible(not busy and preview is not None and not self._error)
        problems = [say(self._error.as_text)] if self._error else []
        summary = ends = ""
        if preview is not None:
            moves = sum(stage.moves for stage in preview.stages)
            summary = say("engineer.path_length", duration=duration_text(preview.duration), moves=moves)
            if self._outdated:
                summary = say("engineer.choice_changed", length=summary)
                self._badge.show_state("waiting", say("engineer.preview_outdated"))
            else:
                problems += _problem_texts(preview)
                ends = "   ".join(_end_texts(preview, unit_named=self._unit_named))
                self._badge.show_state(*_verdict(preview))
        self._summary.setText(summary)
        self._problems.setText("\n".join(problems))
        self._problems.setVisible(bool(problems) and not busy)
        show_text(self._ends, "" if busy else ends)


class MotionPlot(StackedPlots[Preview]):
    """Plots of the angles of both joints over time, with the stages and the travel limits."""

    def __init__(self) -> None:
        super().__init__(2, 9 * theme.GRID)
        for plot in self.plots:
            plot.getPlotItem().getViewBox().setDefaultPadding(0.1)
            plot.setMinimumHeight(8 * theme.GRID)
        column(*((plot, 1) for plot in self.plots), on=self, spacing=0)

    def bands(self, preview: Preview) -> list[Band]:
        """Return the name, start and end of each stage, in the unit of the time axis."""
        size = time_unit(preview.duration)
        return [(term("stage", s.stage), s.begin / size, s.end / size) for s in preview.stages]

    def draw(self, preview: Preview) -> None:
        """Draw the angles, bands and travel limits."""
        c, size = theme.colours(), time_unit(preview.duration)
        self.add_bands(self.bands(preview))
        angles = (preview.outer, preview.inner)
        titles = (say("engineer.outer_degrees"), say("engineer.inner_degrees"))
        for plot, title, angle, travel in zip(self.plots, titles, angles, preview.travel, strict=True):
            plot.setLabel("left", title)
            pen = theme.pen(c.accent, 1)
            self.add(plot, pg.PlotDataItem(preview.time / size, np.rad2deg(angle), pen=pen))
            for end in travel:
                if np.isfinite(end):
                    line = pg.InfiniteLine(np.rad2deg(end), 0, pen=dashed(c.bad))
                    self.add(plot, line, scaled=False)
            plot.enableAutoRange()
        self.plots[1].setLabel("bottom", say("engineer.axis_time_s" if size == 1.0 else "engineer.axis_time_min"))
        self.plots[0].setXRange(0.0, max(preview.duration / size, 1e-3), padding=0.01)


def _columns(preview: Preview) -> list[Cell]:
    """Return the columns for unit, sigma before the run and after each stage, limit, target and verdict."""
    stages = [
        Cell(partial(term, "stage", stage.stage), f"after_{number}", hint=f"gain_{number}")
        for number, stage in enumerate(preview.stages)
    ]
    return [
        Cell("common.unit", "unit", number=False),
        Cell("engineer.sigma_before", "before"),
        *stages,
        Cell("engineer.sigma_limit", "limit"),
        *([Cell("engineer.sigma_target", "target")] if preview.targets else []),
        Cell("engineer.expected", "verdict", number=False, state="state"),
    ]


def _verdict(preview: Preview) -> tuple[str, str]:
    """Return the shape and the text of the badge."""
    if preview.violations:
        return "bad", say("engineer.preview_violations")
    if any(stage.error is not None and stage.predictable for stage in preview.stages):
        return "bad", say("engineer.preview_unsolved")
    if any(stage.sigma is None for stage in preview.stages):
        return "none", say("engineer.preview_unpredictable")
    if preview.undetermined:
        return "bad", say("engineer.preview_undetermined")
    missed = sum(_reached(preview, name) is False for name in _names(preview))
    if missed:
        return "caution", say("engineer.preview_missed", missed=missed)
    if not any(name in preview.limits for name in _names(preview)):
        return "none", say("engineer.preview_no_limits")
    return "good", say("engineer.preview_partial" if preview.partial else "engineer.preview_good")


def _problem_texts(preview: Preview) -> list[str]:
    """Return the violated limits, the errors of stages, and the stages that have too few rounds."""
    problems = [_violation_text(violation) for violation in preview.violations]
    if preview.undetermined:
        problems.append(say("engineer.undetermined", names=preview.undetermined))
    for stage in preview.stages:
        if stage.error and stage.predictable:
            problems.append(_error_text(stage.stage, stage.error))
        if stage.reason == "" and not preview.violations:
            problems.append(
                say("engineer.too_few_rounds", stage=stage.stage, rounds=rounds_text(stage.stage, stage.rounds))
            )
    return problems


def _end_texts(preview: Preview, *, unit_named: bool) -> list[str]:
    """Return what ends each repeated stage, which stages miss their targets, and why sigmas cannot be predicted."""
    repeated = [stage for stage in preview.stages if stage.reason not in ("", "plan")]
    ends = [
        say(f"engineer.ends_{stage.reason}", stage=stage.stage, rounds=rounds_text(stage.stage, stage.rounds))
        for stage in repeated
    ]
    ends += [say("engineer.ends_before_targets", stage=stage.stage) for stage in repeated if stage.missed]
    if preview.partial and not preview.calibrated:
        ends.append(say("engineer.preview_uncalibrated" if unit_named else "engineer.preview_without_unit"))
    return ends + [_error_text(s.stage, s.error) for s in preview.stages if s.error and not s.predictable]


def _error_text(stage: str, error: Text) -> str:
    return say("common.named", name=term("stage", stage), text=say(error))


def _violation_text(violation: Violation) -> str:
    """Return a description of a violated limit that names its step and the remedy."""
    if violation.kind == "plan":
        return say("common.named", name=term("stage", violation.stage), text=say(violation.text))
    values = {"stage": violation.stage, "step": violation.step, "more": violation.more}
    code = "engineer.move_and_more" if violation.more else "engineer.move"
    value, low, high = (float(v) for v in np.rad2deg([violation.value, violation.low, violation.high]))
    if violation.kind != "travel":
        high = round(high, 6)
    return say(
        f"engineer.violated_{violation.kind}",
        move=say(code, move=step_sentence("move", violation.label), **values),
        joint=violation.joint,
        value=value,
        low=low,
        high=high,
    )


def _cells(preview: Preview, name: str) -> dict[str, str]:
    """Return the texts of a parameter's row."""
    reached = _reached(preview, name)
    verdict = "unknown" if name in preview.limits else "no_limit"
    if reached is not None:
        verdict = "reached" if reached else "missed"
    state = {None: "", True: "good", False: "bad"}[reached]
    if name in preview.undetermined:
        verdict, state = "undetermined", "bad"
    elif name in preview.not_improved:
        verdict, state = "not_improved", ""
    elif reached is not False and any(name in stage.missed for stage in preview.stages):
        verdict, state = "target_missed", "caution"
    expected, limit, (unit, size) = _expected(preview, name), preview.limits.get(name), unit_of_parameter(name)
    cells = {
        "unit": unit,
        "before": _sigma_text(name, float(preview.before[INDEX[name]])),
        "limit": "" if limit is None else limit_number(limit, size, math.nan if expected is None else expected),
        "target": _sigma_text(name, preview.targets.get(name)),
        "verdict": say(f"engineer.expected_{verdict}"),
        "state": state,
    }
    for number, stage in enumerate(preview.stages):
        sigma = "—" if stage.sigma is None else _sigma_text(name, float(stage.sigma[INDEX[name]]))
        if number == len(preview.stages) - 1 and expected is not None:
            sigma = compared_number(sigma, size, expected, limit)
        cells |= {f"after_{number}": sigma, f"gain_{number}": _gain_text(preview, number, name)}
    return cells


def _gain_text(preview: Preview, number: int, name: str) -> str:
    """Return a sentence that states by which factor a stage improves a parameter."""
    stage = preview.stages[number]
    if stage.sigma is None:
        return "" if stage.error is None else say(stage.error)
    before = preview.before if number == 0 else preview.stages[number - 1].sigma
    if name not in stage.estimated or before is None:
        return say("engineer.not_estimated")
    after = float(stage.sigma[INDEX[name]])
    return say("engineer.gain", gain=float(before[INDEX[name]]) / after if after > 0.0 else 1.0)


def _names(preview: Preview) -> tuple[str, ...]:
    """Return the parameters that at least one stage estimates, in the order of the parameter table."""
    estimated = {name for stage in preview.stages for name in stage.estimated}
    return tuple(name for name in NAMES if name in estimated)


def _reached(preview: Preview, name: str) -> bool | None:
    """Return whether the expected sigma of a parameter meets its limit, or None if that is unknown or not judged."""
    if name in preview.not_improved:
        return None
    expected, limit = _expected(preview, name), preview.limits.get(name)
    return None if expected is None or limit is None else expected <= limit


def _expected(preview: Preview, name: str) -> float | None:
    """Return the sigma of a parameter after the last stage, SI, or None if it is unknown."""
    sigma = preview.stages[-1].sigma if preview.stages else None
    return None if sigma is None else float(sigma[INDEX[name]])


def _sigma_text(name: str, sigma: float | None) -> str:
    """Format a sigma in its display unit, normally with three significant digits; "" for None."""
    if sigma is None:
        return ""
    value = abs(display(name, sigma)[0])
    if value >= 1000.0:
        return f"{value:.0f}"
    return f"{value:#.3g}".rstrip(".") if value >= 1e-4 else f"{value:.2g}"
