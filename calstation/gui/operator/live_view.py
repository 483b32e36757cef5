"""A run in progress: preparation steps, table, traces and convergence, or the guide of a manual rig."""

from PySide6.QtCore import QEvent, Qt, Signal
from PySide6.QtWidgets import QFrame, QGridLayout, QHBoxLayout, QLabel, QStackedWidget, QVBoxLayout, QWidget

from calstation.gui.operator.convergence import Convergence
from calstation.gui.operator.position_panel import PositionPanel
from calstation.gui.operator.table_panel import TablePanel
from calstation.gui.operator.traces import Traces
from calstation.gui.shell.run_status import RunStatus
from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import StateIcon
from calstation.physics.parameters import GROUPS, INDEX, PARAMETERS
from calstation.sequencer.events import (
    Event,
    PositionGuided,
    StageEnded,
    StageProgress,
    StageSolved,
    TableMoved,
    Trace,
)

#: By the message that opens each; the first opens with START.
_STEPS = ("starting", "waiting_ready", "homing", "warming_up", "checking_mounting")

#: Says that an errand's preparation is over; a run's stages take this list's place.
_DONE = "registers_writing"

_HOMING = _STEPS.index("homing")
#: Messages that open a step in place of its own, where the unit is carried by hand.
_SAME = {"checking_gravity": "checking_mounting"}


class Preparation(QFrame):
    """A list that ticks itself off; skipped steps are ticked with the next one."""

    def __init__(self, run: RunStatus, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("kind", "panel")
        self._run = run
        self._at = 0
        self._shown_carried = False
        self._title = QLabel()
        self._title.setProperty("kind", "section")
        self._icons = [StateIcon(20) for _ in _STEPS]
        self._names = [QLabel() for _ in _STEPS]
        self._texts = [QLabel() for _ in _STEPS]
        grid = QGridLayout()
        grid.setHorizontalSpacing(2 * theme.GRID)
        grid.setVerticalSpacing(2 * theme.GRID)
        for row, (icon, name, text) in enumerate(zip(self._icons, self._names, self._texts, strict=True)):
            text.setWordWrap(True)
            text.setProperty("kind", "muted")
            grid.addWidget(icon, row, 0)
            grid.addWidget(name, row, 1)
            grid.addWidget(text, row, 2, Qt.AlignmentFlag.AlignVCenter)
        grid.setColumnStretch(2, 1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(2 * theme.GRID, theme.GRID, 2 * theme.GRID, theme.GRID)
        layout.setSpacing(2 * theme.GRID)
        layout.addWidget(self._title)
        layout.addLayout(grid)
        layout.addStretch(1)
        run.changed.connect(self.refresh)
        self.retranslate()

    @property
    def _carried(self) -> bool:
        """Whether the unit is carried by hand: then nothing is homed."""
        return self._run.run_summary is not None and self._run.run_summary.by_hand

    def refresh(self) -> None:
        """Follow the run."""
        if self._run.state == "starting":
            self._at = 0
        elif self._run.latest is not None:
            said = _SAME.get(self._run.latest[1], self._run.latest[1])
            self._at = _STEPS.index(said) if said in _STEPS else len(_STEPS) if said == _DONE else self._at
        if self._carried != self._shown_carried:
            self.retranslate()
            return
        for row, (icon, name) in enumerate(zip(self._icons, self._names, strict=True)):
            kind = "good" if row < self._at else "active" if row == self._at else "none"
            icon.set_kind(kind)
            name.setFont(theme.font(theme.SECTION, bold=row == self._at))

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        carried = self._shown_carried = self._carried
        self._title.setText(self.tr("Preparing"))
        for widget in (self._icons[_HOMING], self._names[_HOMING], self._texts[_HOMING]):
            widget.setVisible(not carried)
        names = (
            self.tr("Connecting"),
            self.tr("Unit ready"),
            self.tr("Homing"),
            self.tr("Warm-up"),
            self.tr("Gravity") if carried else self.tr("Mounting"),
        )
        texts = (
            self.tr("The unit is asked who it is.")
            if carried
            else self.tr("Table and unit are asked who they are."),
            self.tr("The unit starts and tests itself."),
            self.tr("The table looks for its reference, slowly. Keep hands clear."),
            self.tr("The unit comes to its temperature. Nothing to do."),
            self.tr("Gravity's length shows whether the unit measures right. Leave it alone.")
            if carried
            else self.tr("Gravity and two small turns show whether the unit sits right."),
        )
        for name, word in zip(self._names, names, strict=True):
            name.setText(word)
        for text, word in zip(self._texts, texts, strict=True):
            text.setText(word)
        self.refresh()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)


class LiveView(QWidget):
    """Shows the events of a run; `finish_wanted()` : the operator has done enough positions."""

    finish_wanted = Signal()

    def __init__(self, run: RunStatus) -> None:
        super().__init__()
        self._run = run
        self.table, self._traces, self._convergence = TablePanel(), Traces(), Convergence()
        self.position, self._upper, self._lower = PositionPanel(), QWidget(), QStackedWidget()
        self.position.finish_wanted.connect(self.finish_wanted)
        self._lower.addWidget(Preparation(run))
        self._lower.addWidget(self._convergence)
        upper = QHBoxLayout(self._upper)
        upper.setContentsMargins(0, 0, 0, 0)
        upper.setSpacing(theme.GRID)
        self.table.setMinimumWidth(37 * theme.GRID)
        upper.addWidget(self.table, 1)
        upper.addWidget(self._traces, 3)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(theme.GRID)
        column.addWidget(self.position, 9)
        column.addWidget(self._upper, 5)
        column.addWidget(self._lower, 4)

    def start(self) -> None:
        """A run begins."""
        run_summary = self._run.run_summary
        self.table.forget()
        self._traces.start()
        self._convergence.start(run_summary.targets if run_summary is not None else {})
        if run_summary is not None:
            self.table.set_axes(run_summary.outer_axis, run_summary.inner_axis)
            self.position.plan(run_summary)

    def stop(self) -> None:
        """The run has ended."""
        self._traces.stop()

    def take(self, event: Event) -> None:
        """Show what has happened."""
        if isinstance(event, TableMoved):
            self.table.take(event)
        elif isinstance(event, PositionGuided):
            self.position.take(event)
        elif isinstance(event, StageEnded):
            self.position.rest()
        elif isinstance(event, Trace):
            self._traces.take(event)
        elif isinstance(event, StageProgress):
            self._convergence.take(self._run.done, event.sigma)
        elif isinstance(event, StageSolved):
            self._convergence.take(self._run.done, _largest(event))

    def refresh(self) -> None:
        """What belongs to where the run stands."""
        run = self._run
        carried = run.run_summary is not None and run.run_summary.by_hand
        begun = any(stage.state != "waiting" for stage in run.stages) and not run.register_operation
        self._lower.setCurrentIndex(1 if begun else 0)
        self.table.setVisible(not carried)
        self.position.setVisible(carried and begun)
        for widget in (self._upper, self._lower):
            widget.setVisible(not (carried and begun))


def _largest(event: StageSolved) -> dict[str, float]:
    """The largest sigma of every group that a stage solved as a whole."""
    found: dict[str, list[float]] = {}
    for name, row in event.parameters.items():
        found.setdefault(PARAMETERS[INDEX[name]].group, []).append(row["sigma"])
    return {group: max(sigmas) for group, sigmas in found.items() if group in GROUPS}
