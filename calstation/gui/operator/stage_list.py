"""The stages of a run as a list: number, name, state, progress and time left."""

from typing import cast

from PySide6.QtCore import QSize, Qt
from PySide6.QtWidgets import QAbstractItemView, QFrame, QLabel, QListWidget, QListWidgetItem, QWidget

from calstation.gui.state import EndStageButton, RunStatus, StageState, stage_rows
from calstation.gui.text import duration_text, on_language_change, say, term
from calstation.gui.widgets import PANEL, STEPS, StateIcon, column, label, progress_bar, row, show_text, theme
from calstation.runs import RunSummary

_KINDS = {
    "waiting": "none",
    "kept": "none",
    "active": "active",
    "solving": "active",
    "good": "done",
    "bad": "bad",
    "outside": "bad",
    "stopped": "stopped",
    "fault": "caution",
}


class _Row(QFrame):
    """Row of a stage: icon and name on the left, state and time on the right, a progress bar below while it runs."""

    def __init__(self) -> None:
        super().__init__()
        self.setProperty("kind", "")
        self._icon, self._bar = StateIcon(18), progress_bar(3)
        self._name, self._state, self._time = QLabel(), QLabel(), label(kind="muted")
        right = Qt.AlignmentFlag.AlignRight
        times = column(None, (self._state, 0, right), (self._time, 0, right), None, spacing=0)
        line = row(self._icon, (self._name, 1), times, spacing=theme.GRID, margins=(2 * theme.GRID, 0, theme.GRID, 0))
        column((line, 1), self._bar, on=self, spacing=0)

    def show_stage(self, kind: str, name: str, state: str, time: str, fraction: float) -> None:
        """Show the kind of a stage's state, its name, the texts of its state and time, and the fraction done."""
        active = kind == "active"
        if self.property("kind") != ("current" if active else ""):
            theme.set_kind(self, "current" if active else "")
        self._icon.set_kind(kind)
        for widget, text in ((self._name, name), (self._state, state), (self._time, time)):
            show_text(widget, text)
        self._name.setFont(theme.font(theme.SECTION, bold=active))
        self._state.setFont(theme.font(bold=active))
        self._bar.setVisible(active)
        self._bar.setValue(round(STEPS * fraction))


class StageList(QFrame):
    """The list of stages, with the total time left below it."""

    def __init__(self, run: RunStatus, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("kind", "panel")
        self._run = run
        self._next_run: RunSummary | None = None
        title = label("common.stages", "section")
        title.setContentsMargins(*PANEL)
        self.list = QListWidget()
        self.list.setObjectName("stage_list")
        self.list.setFrameShape(QFrame.Shape.NoFrame)
        self.list.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.list.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        self.list.setVerticalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self._left = QLabel()
        self._left.setFont(theme.font(theme.SECTION))
        self._left.setContentsMargins(2 * theme.GRID, theme.GRID, 2 * theme.GRID, 0)
        self._partial = label(kind="partial", name="partial_label", wrap=True)
        self._partial.setContentsMargins(2 * theme.GRID, 0, 2 * theme.GRID, 0)
        self._note = label(kind="muted", wrap=True)
        self._note.setContentsMargins(2 * theme.GRID, 0, 2 * theme.GRID, 0)
        end_stage = EndStageButton(run, "end_stage_button", self._operator_ends_stages)
        column(
            title,
            (self.list, 1),
            row(None, end_stage, None),
            self._left,
            self._partial,
            self._note,
            on=self,
            spacing=0,
            margins=(1, 1, 1, theme.GRID),
        )
        run.changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def _operator_ends_stages(self) -> bool:
        summary = self._run.run_summary
        return summary is not None and summary.operator_ends_stages

    def plan(self, run_summary: RunSummary | None) -> None:
        """Set the next run, which is shown while no run is in progress."""
        self._next_run = run_summary
        self.refresh()

    def refresh(self) -> None:
        """Show the current run, or the next one if no run is in progress."""
        planning = self._run.state == "idle"
        stages = self._run.stages
        if planning:
            stages = [] if self._next_run is None else stage_rows(self._next_run)
        while self.list.count() > len(stages):
            self.list.takeItem(self.list.count() - 1)
        while self.list.count() < len(stages):
            item = QListWidgetItem(self.list)
            item.setFlags(Qt.ItemFlag.ItemIsEnabled)
            item.setSizeHint(QSize(24 * theme.GRID, 7 * theme.GRID))
            self.list.setItemWidget(item, _Row())
        for number, stage in enumerate(stages):
            self._fill(self.list.item(number), f"{number + 1}  {term('stage', stage.name)}", stage, planning)
        self._show_left(stages, planning)

    def _fill(self, item: QListWidgetItem, name: str, stage: StageState, planning: bool) -> None:
        kind = _KINDS[stage.state]
        if kind == "active" and self._run.state in ("pausing", "paused"):
            kind = "paused"
        state, left = _state_text(stage), self._time_text(stage, planning)
        cast("_Row", self.list.itemWidget(item)).show_stage(kind, name, state, left, stage.fraction)
        spoken = ", ".join(part for part in (name, state, left) if part)
        item.setData(Qt.ItemDataRole.AccessibleTextRole, spoken)
        item.setToolTip(spoken)

    def _time_text(self, stage: StageState, planning: bool) -> str:
        if stage.elapsed is not None:
            return duration_text(stage.elapsed)
        if stage.state not in ("waiting", "active"):
            return ""
        if not planning and not self._run.in_progress:
            return say("operator.not_run")
        pace = 1.0 if planning else self._run.pace
        return "" if pace is None else duration_text(self._run.stage_remaining(stage) / pace)

    def _show_left(self, stages: list[StageState], planning: bool) -> None:
        left = note = ""
        if planning and stages:
            total = duration_text(sum(stage.duration for stage in stages))
            left = say("operator.time_in_all", time=total)
            if self._next_run is not None and self._next_run.virtual:
                note = say("operator.table_times")
        elif (remaining := self._run.remaining) is not None:
            left = say("common.time_left", time=duration_text(remaining))
        summary = self._next_run if planning else self._run.run_summary
        omitted = () if summary is None else summary.omitted
        partial = say("operator.partial_without", stages=omitted) if omitted else ""
        for shown, text in ((self._left, left), (self._partial, partial), (self._note, note)):
            show_text(shown, text)


def _state_text(stage: StageState) -> str:
    if stage.state == "active":
        return f"{100.0 * stage.fraction:.0f} %"
    return "" if stage.state == "waiting" else term("stage_state", stage.state)
