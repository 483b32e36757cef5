"""List of the stages of a run with their states, progress and times."""

from typing import cast

from PySide6.QtCore import QSize, Qt
from PySide6.QtWidgets import QAbstractItemView, QFrame, QListWidget, QListWidgetItem

from calstation.gui.state import AppContext, EndStageButton, StageState, stage_rows
from calstation.gui.text import about, duration_text, on_language_change, say, term
from calstation.gui.widgets import (
    PANEL,
    STEPS,
    PlainLabel,
    StateIcon,
    column,
    label,
    lay_out,
    plain_tip,
    progress_bar,
    row,
    show_text,
    theme,
)
from calstation.runs import RunSummary

_KINDS = {
    "waiting": "none",
    "kept": "none",
    "active": "active",
    "solving": "active",
    "good": "done",
    "bad": "bad",
    "failed": "bad",
    "stopped": "stopped",
    "fault": "caution",
}


class _Row(QFrame):
    """Row of a stage with icon, name, state and time, and a progress bar while the stage is in progress."""

    def __init__(self) -> None:
        super().__init__()
        self.setProperty("kind", "row")
        self._icon, self._bar = StateIcon(18), progress_bar(3)
        self._name, self._state, self._time = PlainLabel(), PlainLabel(), label(kind="muted")
        self._name.setFont(theme.font(theme.SECTION))  # before it is first polished, or Qt would reset the font
        right = Qt.AlignmentFlag.AlignRight
        times = column(None, (self._state, 0, right), (self._time, 0, right), None, spacing=0)
        line = row(self._icon, (self._name, 1), times, spacing=theme.GRID, margins=(2 * theme.GRID, 0, theme.GRID, 0))
        column((line, 1), self._bar, on=self, spacing=0)

    def show_stage(self, kind: str, name: str, state: str, time: str, fraction: float) -> None:
        """Show the badge shape, name, state, time and completed fraction of a stage."""
        active = kind == "active"
        kind_of_row = "current" if active else "row"
        if self.property("kind") != kind_of_row:
            theme.set_kind(self, kind_of_row)
        self._icon.set_kind(kind)
        for widget, text in ((self._name, name), (self._state, state), (self._time, time)):
            show_text(widget, text)
        self._name.setFont(theme.font(theme.SECTION, bold=active))
        self._state.setFont(theme.font(bold=active))
        self._bar.setVisible(active)
        self._bar.setValue(round(STEPS * fraction))
        lay_out(self)


class StageList(QFrame):
    """The list of stages, with the remaining time below it."""

    def __init__(self, app: AppContext) -> None:
        super().__init__()
        self.setProperty("kind", "panel")
        self._app, self._run = app, app.run
        run = app.run
        self.setFixedWidth(38 * theme.GRID)
        self._next_run: RunSummary | None = None
        title = label("common.stages", "section")
        title.setContentsMargins(*PANEL)
        self.list = QListWidget()
        self.list.setObjectName("stage_list")
        self.list.setFrameShape(QFrame.Shape.NoFrame)
        self.list.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.list.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        self.list.setVerticalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self._remaining, self._note = PlainLabel(), label(kind="muted", wrap=True)
        self._remaining.setFont(theme.font(theme.SECTION))
        self._remaining.setContentsMargins(2 * theme.GRID, theme.GRID, 2 * theme.GRID, 0)
        self._partial = label(kind="partial", name="partial_label", wrap=True)
        for note in (self._partial, self._note):
            note.setContentsMargins(2 * theme.GRID, 0, 2 * theme.GRID, 0)
        end_stage = EndStageButton(
            run,
            "end_stage_button",
            self,
            lambda: run.run_summary is not None and run.run_summary.operator_ends_stages,
        )
        column(
            title,
            (self.list, 1),
            row(None, end_stage, None),
            *(self._remaining, self._partial, self._note),
            on=self,
            spacing=0,
            margins=(1, 1, 1, theme.GRID),
        )
        run.changed.connect(self.refresh)
        on_language_change(self, self.refresh)

    def set_next_run(self, run_summary: RunSummary | None) -> None:
        """Set the next run, whose stages are shown while no run is in progress."""
        self._next_run = run_summary
        self.refresh()

    def refresh(self) -> None:
        """Show the stages of the current run or, if there is none, of the next run."""
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
        self._show_totals(stages, planning)

    def _fill(self, item: QListWidgetItem, name: str, stage: StageState, planning: bool) -> None:
        kind = _KINDS[stage.state]
        if kind == "active" and self._run.state in ("pausing", "paused"):
            kind = "paused"
        state, time = _state_text(stage), self._time_text(stage, planning)
        if kind == "active" and self._run.state == "stopping":
            kind, state, time = "stopped", term("badge", "stopping"), ""
        cast("_Row", self.list.itemWidget(item)).show_stage(kind, name, state, time, stage.fraction)
        text = ", ".join(filter(None, (name, state, time)))
        item.setData(Qt.ItemDataRole.AccessibleTextRole, text)
        item.setToolTip(plain_tip("\n".join(filter(None, (text, about("stage", stage.name))))))

    def _time_text(self, stage: StageState, planning: bool) -> str:
        """Return the time from the start of a stage to its solution, or its remaining time."""
        if stage.elapsed is not None:
            return duration_text(stage.elapsed)
        if stage.state not in ("waiting", "active"):
            return ""
        if not planning and not self._run.in_progress:
            return say("operator.not_run")
        pace = 1.0 if planning else self._run.pace
        return "" if pace is None else duration_text(self._run.stage_remaining(stage) / pace)

    def _show_totals(self, stages: list[StageState], planning: bool) -> None:
        """Show the total or remaining time, the stages that a partial run omits, and those with a changed schedule."""
        time = note = ""
        if planning and stages:
            total = duration_text(sum(stage.duration for stage in stages))
            time = say("operator.time_in_all", time=total)
            if self._next_run is not None and self._next_run.faster:
                note = say("operator.table_times")
        elif (remaining := self._run.remaining) is not None:
            time = say("common.time_left", time=duration_text(remaining))
        summary = self._next_run if planning else self._run.run_summary
        omitted = () if summary is None else summary.omitted
        chosen = [say("operator.partial_without", stages=omitted)] if omitted else []
        request = self._app if planning else self._app.engine_link.request
        if request is not None and request.schedule:
            chosen.append(say("operator.schedule_changed", stages=tuple(request.schedule)))
        for widget, text in ((self._remaining, time), (self._partial, "\n".join(chosen)), (self._note, note)):
            show_text(widget, text)


def _state_text(stage: StageState) -> str:
    if stage.state == "active":
        return f"{100.0 * stage.fraction:.0f} %"
    return "" if stage.state == "waiting" else term("stage_state", stage.state)
