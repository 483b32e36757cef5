"""A line next to STOP with state, stage, progress and remaining time, for pages without their own header."""

from collections import Counter

from PySide6.QtWidgets import QWidget

from calstation.gui.state.run_status import RunStatus
from calstation.gui.text import KINDS, duration_text, on_language_change, say, term
from calstation.gui.widgets import STEPS, StateBadge, column, label, progress_bar, row, theme

#: Outcomes of units, in the order in which they are counted.
_COUNTED = ("passed", "partial", "failed", "fault", "stopped", "incomplete")


class RunStrip(QWidget):
    """Shows the status of the current run."""

    def __init__(self, run: RunStatus, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._run = run
        self._badge, self._text, self._bar = StateBadge(theme.SECTION), label(), progress_bar(theme.GRID)
        line = row(self._badge, (self._text, 1), spacing=2 * theme.GRID)
        column(line, self._bar, on=self, margins=(0, 0, theme.GRID, 0))
        run.changed.connect(self._refresh)
        on_language_change(self, self._refresh)

    def _refresh(self) -> None:
        run = self._run
        kind, state = run_badge(run)
        if (run.ended or run.fault is not None) and not run.in_slots:  # not shown elsewhere on the page
            state = f"{run.unit.serial}  ·  {state}"
        self._badge.show_state(kind, state)
        parts = []
        if run.stage is not None:
            parts = [term("stage", run.stage.name), f"{100.0 * run.stage.fraction:.0f} %"]
        if run.remaining is not None:
            parts.append(say("common.time_left", time=duration_text(run.remaining)))
        self._text.setText("  ·  ".join(parts))
        self._bar.setVisible(run.going)
        self._bar.setValue(round(STEPS * run.fraction))


def run_badge(run: RunStatus) -> tuple[str, str]:
    """Return the badge of a run, its shape and its text, which states if a run in progress is partial.

    The badge of several units counts their outcomes.
    """
    if run.in_slots and run.ended:
        counts = Counter(run.shown_of(unit) for unit in run.units)
        texts = [term("unit_count", outcome, count=counts[outcome]) for outcome in _COUNTED if counts[outcome]]
        return KINDS.get(run.shown, "none"), term("unit_count", "comma").join(texts)
    state = term("badge", run.shown)
    if run.going and run.partial:
        state = f"{term('badge', 'partial')}  ·  {state}"
    return KINDS.get(run.shown, "none"), state
