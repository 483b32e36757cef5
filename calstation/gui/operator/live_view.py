"""A run in progress: preparation steps, table, traces and convergence, or the guide of a manual rig."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QGridLayout, QLabel, QStackedWidget, QWidget

from calstation.gui.operator.convergence import Convergence
from calstation.gui.operator.position_panel import PositionPanel
from calstation.gui.operator.table_panel import TablePanel
from calstation.gui.operator.traces import Traces
from calstation.gui.shell import RunStatus
from calstation.gui.text import on_language_change
from calstation.gui.widgets import StateIcon, column, label, row, theme
from calstation.physics import GROUPS, INDEX, PARAMETERS
from calstation.sequencer import (
    Event,
    PositionGuided,
    StageEnded,
    StageProgress,
    StageSolved,
    TableMoved,
    Trace,
)

#: Steps, by the message that starts each; the first starts with START.
_STEPS = ("starting", "waiting_ready", "homing", "warming_up", "checking_mounting")

#: Message that ends the preparation of a register operation; the first stage ends that of a run.
_DONE = "registers_writing"

_HOMING = _STEPS.index("homing")
#: Messages that start a step on a manual rig, with the message of the step.
_SAME = {"checking_gravity": "checking_mounting"}


class Preparation(QFrame):
    """The steps from START to the first stage, ticked off one by one; skipped steps are ticked with the next one."""

    def __init__(self, run: RunStatus, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("kind", "panel")
        self._run = run
        self._at = 0
        self._icons = [StateIcon(20) for _ in _STEPS]
        self._names = [QLabel() for _ in _STEPS]
        self._texts = [label(kind="muted", wrap=True) for _ in _STEPS]
        grid = QGridLayout()
        grid.setHorizontalSpacing(2 * theme.GRID)
        grid.setVerticalSpacing(2 * theme.GRID)
        for step, (icon, name, text) in enumerate(zip(self._icons, self._names, self._texts, strict=True)):
            grid.addWidget(icon, step, 0)
            grid.addWidget(name, step, 1)
            grid.addWidget(text, step, 2, Qt.AlignmentFlag.AlignVCenter)
        grid.setColumnStretch(2, 1)
        column(
            label(lambda: self.tr("Preparing"), "section"),
            grid,
            None,
            on=self,
            spacing=2 * theme.GRID,
            margins=(2 * theme.GRID, theme.GRID, 2 * theme.GRID, theme.GRID),
        )
        run.changed.connect(self._refresh)
        on_language_change(self, self._refresh)

    def _refresh(self) -> None:
        if self._run.state == "starting":
            self._at = 0
        elif self._run.latest is not None:
            message = _SAME.get(self._run.latest[1], self._run.latest[1])
            if message in _STEPS:
                self._at = _STEPS.index(message)
            elif message == _DONE:
                self._at = len(_STEPS)
        by_hand = self._run.run_summary is not None and self._run.run_summary.by_hand
        for step, (name_words, text_words) in enumerate(self._steps(by_hand)):
            icon, name, text = self._icons[step], self._names[step], self._texts[step]
            icon.set_kind("good" if step < self._at else "active" if step == self._at else "none")
            name.setFont(theme.font(theme.SECTION, bold=step == self._at))
            name.setText(name_words)
            text.setText(text_words)
            for widget in (icon, name, text):
                widget.setVisible(not (by_hand and step == _HOMING))

    def _steps(self, by_hand: bool) -> tuple[tuple[str, str], ...]:
        """Name and text of each step."""
        identify = self.tr("The table and the unit are identified.")
        mounting = self.tr("Gravity and two small turns show whether the unit is mounted correctly.")
        if by_hand:
            identify = self.tr("The unit is identified.")
            mounting = self.tr("The magnitude of gravity shows whether the unit measures correctly. Leave it alone.")
        return (
            (self.tr("Connecting"), identify),
            (self.tr("Unit ready"), self.tr("The unit starts and tests itself.")),
            (
                self.tr("Homing"),
                self.tr("The table searches its reference slowly. Keep hands clear."),
            ),
            (self.tr("Warm-up"), self.tr("The unit reaches its operating temperature. Nothing to do.")),
            (self.tr("Gravity") if by_hand else self.tr("Mounting"), mounting),
        )


class LiveView(QWidget):
    """Shows the events of a run; `finish_wanted()` : the operator ends the stage early."""

    finish_wanted = Signal()

    def __init__(self, run: RunStatus) -> None:
        super().__init__()
        self._run = run
        self.table, self._traces, self._convergence = TablePanel(), Traces(), Convergence()
        self.position, self._upper, self._lower = PositionPanel(), QWidget(), QStackedWidget()
        self.position.finish_wanted.connect(self.finish_wanted)
        self._lower.addWidget(Preparation(run))
        self._lower.addWidget(self._convergence)
        self.table.setMinimumWidth(37 * theme.GRID)
        row((self.table, 1), (self._traces, 3), on=self._upper)
        column((self.position, 9), (self._upper, 5), (self._lower, 4), on=self)

    def start(self) -> None:
        """Prepare for a new run."""
        run_summary = self._run.run_summary
        self.table.forget()
        self._traces.start()
        self._convergence.start(run_summary.targets if run_summary is not None else {})
        if run_summary is not None:
            self.table.set_axes(run_summary.outer_axis, run_summary.inner_axis)
            self.position.plan(run_summary)

    def stop(self) -> None:
        """Stop with the end of the run."""
        self._traces.stop()

    def take(self, event: Event) -> None:
        """Show an event."""
        if isinstance(event, TableMoved):
            self.table.take(event)
        elif isinstance(event, PositionGuided):
            self.position.take(event)
        elif isinstance(event, StageEnded):
            self.position.finish_stage()
        elif isinstance(event, Trace):
            self._traces.take(event)
        elif isinstance(event, StageProgress):
            self._convergence.take(self._run.done, event.sigma)
        elif isinstance(event, StageSolved):
            self._convergence.take(self._run.done, _largest(event))

    def refresh(self) -> None:
        """Show the widgets that belong to the state of the run."""
        run = self._run
        by_hand = run.run_summary is not None and run.run_summary.by_hand
        begun = any(stage.state != "waiting" for stage in run.stages) and not run.register_operation
        self._lower.setCurrentIndex(1 if begun else 0)
        self.table.setVisible(not by_hand)
        self.position.setVisible(by_hand and begun)
        for widget in (self._upper, self._lower):
            widget.setVisible(not (by_hand and begun))


def _largest(event: StageSolved) -> dict[str, float]:
    """The largest sigma of every group."""
    found: dict[str, list[float]] = {}
    for name, solved in event.parameters.items():
        found.setdefault(PARAMETERS[INDEX[name]].group, []).append(solved["sigma"])
    return {group: max(sigmas) for group, sigmas in found.items() if group in GROUPS}
