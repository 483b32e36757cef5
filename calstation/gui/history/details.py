"""Details of one run: how it ended and why, its figures, what was outside its limits, and what may be done."""

from collections.abc import Sequence
from dataclasses import dataclass

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QGridLayout, QLabel, QScrollArea, QWidget

from calstation.gui.history.run_table import local_time, stages_text
from calstation.gui.history.trend import Trend
from calstation.gui.operator import advice
from calstation.gui.text import (
    KINDS,
    duration_text,
    error_text,
    event_sentence,
    free_text,
    on_language_change,
    term,
)
from calstation.gui.widgets import ElidedLabel, StateBadge, button, column, enable, label, row, theme
from calstation.physics import aligned
from calstation.records import IndexedRun, RunRecord
from calstation.results import Result

_MOST_FAILED = 8


@dataclass(frozen=True)
class Actions:
    """What may be done with a run: `running` and `closing` a run hold everything up, `resumable` is of this run."""

    running: bool = False
    closing: bool = False
    resumable: bool = False


class RunDetails(QFrame):
    """Shows a run; its buttons emit what is wanted of it."""

    result_wanted = Signal()
    log_wanted = Signal()
    folder_wanted = Signal()
    resume_wanted = Signal()
    close_wanted = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.setProperty("kind", "panel")
        self._run: RunRecord | None = None
        self._result: Result | None = None
        self._actions = Actions()
        self._serial = label()
        self._serial.setFont(theme.font(theme.SECTION, bold=True))
        self.badge = StateBadge(theme.SECTION)
        self.reason_label = label(name="history_reason_label", wrap=True)
        self.failed_label = label(name="history_failed_label", wrap=True)
        self._facts, self._figures = QGridLayout(), QGridLayout()
        for grid in (self._facts, self._figures):
            grid.setHorizontalSpacing(2 * theme.GRID)
            grid.setVerticalSpacing(theme.GRID // 2)
        self.trend = Trend()
        self.trend.setMinimumHeight(22 * theme.GRID)
        self._result_button = button("history_result_button", lambda: self.tr("Result"), self.result_wanted)
        self._log_button = button("history_log_button", lambda: self.tr("Log"), self.log_wanted)
        self._folder_button = button("history_folder_button", lambda: self.tr("Folder"), self.folder_wanted)
        self._resume_button = button("history_resume_button", lambda: self.tr("Resume"), self.resume_wanted)
        self._close_button = button("history_close_button", pressed=self.close_wanted)
        self._lay_out()
        on_language_change(self, self._show)

    @property
    def has_parameters(self) -> bool:
        """Whether the run has solved parameters."""
        return self._result is not None and bool(self._result.parameters)

    def show_run(
        self, run: RunRecord, result: Result | None, unit_runs: Sequence[IndexedRun], actions: Actions
    ) -> None:
        """Show a run.

        Parameters
        ----------
        run : as indexed
        result : its result, None if it has none
        unit_runs : solved runs of the same unit, oldest first
        actions : what may be done with it
        """
        self._run, self._result, self._actions = run, result, actions
        checks = result.checks if result is not None else []
        limits = {c.subject: c.limit for c in checks if c.kind == "within" and isinstance(c.limit, tuple)}
        self.trend.show_runs(unit_runs, run.log.stem, limits)
        self._show()

    def allow(self, actions: Actions) -> None:
        """Change what may be done with the run."""
        if actions != self._actions:
            self._actions = actions
            self._show()

    def _lay_out(self) -> None:
        content = QWidget()
        column(
            self.reason_label,
            self.failed_label,
            self._figures,
            self._facts,
            None,
            on=content,
            spacing=2 * theme.GRID,
            margins=(0, 0, theme.GRID, 0),
        )
        scroll = QScrollArea()
        scroll.setWidget(content)
        scroll.setWidgetResizable(True)
        scroll.setFrameShape(QFrame.Shape.NoFrame)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        for widget in (content, scroll.viewport()):
            widget.setAutoFillBackground(False)
        wide = 2 * theme.GRID
        column(
            row((self._serial, 1), self.badge),
            (scroll, 5),
            (self.trend, 3),
            row((self._resume_button, 1), (self._close_button, 1)),
            row((self._result_button, 1), (self._log_button, 1), (self._folder_button, 1)),
            on=self,
            margins=(wide, wide, wide, wide),
        )

    def _show(self) -> None:
        run, result = self._run, self._result
        if run is None:
            return
        self._serial.setText(run.serial)
        self.badge.show_state(KINDS.get(run.outcome, "none"), term("badge", run.outcome))
        self.reason_label.setText(self._reason(run))
        lines = []
        if result is not None:
            failed = result.failed_checks
            lines = [f"✕  {advice.failed_check_text(check, result)}" for check in failed[:_MOST_FAILED]]
            if len(failed) > _MOST_FAILED:
                lines.append(self.tr("and {0} more").format(len(failed) - _MOST_FAILED))
        self.failed_label.setText("\n".join(lines))
        self.failed_label.setVisible(bool(lines))
        self._fill_facts(run)
        self._fill_figures()
        self._update_buttons(run)

    def _reason(self, run: RunRecord) -> str:
        """Why the run ended as it did, and whether it can be resumed."""
        result = self._result
        if run.outcome == "fault" and run.error:
            fault = None if result is None else result.fault
            text = free_text(run.error) if fault is None else error_text(fault)
            return "\n".join(part for part in (text.reason, text.remedy) if part)
        if run.outcome in ("passed", "failed") and result is not None:
            if result.failed_checks:
                return self.tr("Outside its limits:")
            return advice.reason(result.outcome, result)
        reason = ""
        if run.outcome == "stopped":
            by_operator = run.error in (None, "", "operator")
            reason = (
                self.tr("The run was stopped by the operator.")
                if by_operator
                else event_sentence("stopped_because", {"reason": run.error})
            )
        elif run.outcome == "incomplete":
            reason = self.tr("The run did not reach its end.")
        if self._actions.resumable:
            reason += "\n" + self.tr("It can be resumed after its last completed stage, or closed.")
        elif run.closed:
            reason += "\n" + self.tr("It was closed and cannot be resumed.")
        return reason

    def _fill_facts(self, run: RunRecord) -> None:
        _clear(self._facts)
        software = self._result.software if self._result is not None else None
        facts = (
            (self.tr("Started"), local_time(run.started_utc)),
            (self.tr("Duration"), duration_text(run.duration)),
            (self.tr("Product"), run.product),
            (self.tr("Attempt"), str(run.attempt)),
            (self.tr("Station"), run.station),
            (self.tr("Operator"), run.operator),
            (self.tr("Software"), software.version if software is not None else ""),
        )
        for k, (name, text) in enumerate((name, text) for name, text in facts if text):
            line, half = divmod(k, 2)
            self._facts.addWidget(_muted(name), line, 2 * half)
            self._facts.addWidget(QLabel(text), line, 2 * half + 1)
        self._facts.setColumnStretch(1, 1)
        self._facts.setColumnStretch(3, 1)
        resumed, stages = ElidedLabel(), label(wrap=True)
        resumed.setText(run.resumed_from or "")
        stages.setText(stages_text(run))
        long = ((self.tr("Resumed from"), resumed), (self.tr("Stages"), stages))
        for line, (name, value) in enumerate(long, start=9):
            if value.text():
                self._facts.addWidget(_muted(name), line, 0, Qt.AlignmentFlag.AlignTop)
                self._facts.addWidget(value, line, 1, 1, 3)

    def _fill_figures(self) -> None:
        """Show the value of each group that is nearest to its limit."""
        _clear(self._figures)
        rows = [] if self._result is None else advice.figures(self._result)
        if not rows:
            return
        for number, text in enumerate(("", self.tr("value"), "±σ", self.tr("limit"), self.tr("unit"))):
            self._figures.addWidget(_muted(text, number in (1, 2, 3)), 0, number)
        values, sigmas = aligned([r.value for r in rows]), aligned([r.sigma for r in rows])
        for line, (figure, value, sigma) in enumerate(zip(rows, values, sigmas, strict=True), start=1):
            name = figure.name if figure.passed else f"✕ {figure.name}"
            for number, text in enumerate((name, value, sigma, figure.limit, figure.unit)):
                cell = QLabel(text)
                if number in (1, 2, 3):
                    cell.setAlignment(Qt.AlignmentFlag.AlignRight)
                self._figures.addWidget(cell, line, number)
        self._figures.setColumnStretch(0, 1)

    def _update_buttons(self, run: RunRecord) -> None:
        actions = self._actions
        incomplete = run.outcome == "incomplete"
        self._close_button.setText(self.tr("Close as incomplete") if incomplete else self.tr("Do not resume"))
        self._resume_button.setVisible(actions.resumable)
        self._close_button.setVisible(actions.resumable or (incomplete and not run.closed))
        enable(
            self._result_button,
            "" if self.has_parameters else self.tr("No parameter was solved in this run"),
            self.tr("Show every parameter of this run"),
        )
        enable(
            self._log_button,
            "" if run.log.exists() else self.tr("The log is no longer there"),
            self.tr("Draw the log and solve it again"),
        )
        self._folder_button.setToolTip(str(run.log.parent))
        busy = self.tr("A run is going on; wait for its end") if actions.running else ""
        enable(self._resume_button, busy, self.tr("Resume after the last completed stage"))
        enable(
            self._close_button,
            busy or (self.tr("It is being closed") if actions.closing else ""),
            self.tr("The run keeps its outcome and can then no longer be resumed"),
        )


def _muted(text: str, right: bool = False) -> QLabel:
    made = label(kind="muted")
    made.setText(text)
    if right:
        made.setAlignment(Qt.AlignmentFlag.AlignRight)
    return made


def _clear(grid: QGridLayout) -> None:
    while (item := grid.takeAt(0)) is not None:
        widget = item.widget()
        if widget is not None:
            widget.setParent(None)
            widget.deleteLater()
