"""A run as it goes on: table, traces and what is found; or what the carrier of a unit must see from afar."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QHBoxLayout, QStackedWidget, QVBoxLayout, QWidget

from calstation.gui.operator.convergence import Convergence
from calstation.gui.operator.position_panel import PositionPanel
from calstation.gui.operator.preparation import Preparation
from calstation.gui.operator.table_panel import TablePanel
from calstation.gui.operator.traces import Traces
from calstation.gui.shell.run_status import RunStatus
from calstation.gui.widgets import theme
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
        begun = any(stage.state != "waiting" for stage in run.stages) and not run.errand
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
