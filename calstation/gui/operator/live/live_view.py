"""View of a run in progress: preparation, table, traces and convergence, or positions of a manual rig."""

from math import ceil

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFrame, QSizePolicy, QWidget

from calstation.gui.logs.methods import GimbalView
from calstation.gui.operator.live.convergence import Convergence
from calstation.gui.operator.live.position_panel import PositionPanel
from calstation.gui.operator.live.table_panel import TablePanel
from calstation.gui.operator.live.temperature_panel import TemperaturePanel
from calstation.gui.operator.live.traces import Traces
from calstation.gui.operator.units import COLUMNS, UnitTiles
from calstation.gui.state import AppContext, RunStatus, largest_sigmas
from calstation.gui.text import on_language_change, rendered
from calstation.gui.widgets import PANEL, PlainLabel, StateIcon, column, grid, label, row, set_subject, stack, theme
from calstation.messages import Text
from calstation.physics import ALIGNED
from calstation.results.plots import gimbal_plot_data
from calstation.sequencer import (
    ChamberChanged,
    Command,
    Event,
    GimbalTurned,
    JointsMoved,
    PositionGuided,
    StageEnded,
    StageProgress,
    StageSolved,
    TableMoved,
    Trace,
)

#: Minimum window height for the convergence plot below the tiles, and additional height per row of tiles, px.
_MIN_HEIGHT, _TILE_HEIGHT = 620, 54

#: Minimum window height at which the preparation steps fit below the table and traces, and a notice above them, px.
_MIN_BELOW = 800

#: Index of the lowest row.
_BELOW = 3

_PREFERRED = QSizePolicy.Policy.Preferred

#: Preparation steps, named by the messages that start them; the first one starts with START.
_STEPS = ("starting", "waiting_ready", "homing", "warming_up", "checking_mounting", "preparing_solver")
_GIMBAL_STEPS = ("starting", "waiting_ready", "homing", "warming_up", "checking_gravity", "preparing_solver")
_MANUAL_STEPS = ("starting", "waiting_ready", "warming_up", "checking_gravity", "preparing_solver")


class Preparation(QFrame):
    """Checklist of the steps from START to the first stage; a skipped step is ticked when the next one starts."""

    def __init__(self, run: RunStatus) -> None:
        super().__init__()
        self.setProperty("kind", "panel")
        self._run = run
        self._current = 0
        self._rows = [(StateIcon(20), PlainLabel(), label(kind="muted", wrap=True)) for _ in _STEPS]
        steps = grid(across=2 * theme.GRID, down=theme.GRID, stretch=2)
        for number, widgets in enumerate(self._rows):
            widgets[1].setFont(theme.font(theme.SECTION))  # before it is first polished, or Qt would reset the font
            for at, widget in enumerate(widgets):
                steps.addWidget(widget, number, at, Qt.AlignmentFlag.AlignVCenter)
        column(label("operator.preparing", "section"), steps, None, on=self, spacing=2 * theme.GRID, margins=PANEL)
        run.changed.connect(self._refresh)
        on_language_change(self, self._refresh)

    def _refresh(self) -> None:
        steps: tuple[str, ...] = (
            _MANUAL_STEPS if self._run.by_hand else _GIMBAL_STEPS if self._run.joint_order else _STEPS
        )
        if self._run.register_operation:
            steps = steps[:-1]  # nothing is solved
        message = self._run.latest[1] if self._run.latest is not None else ""
        if self._run.state == "starting":
            self._current = 0
        elif message in steps:
            self._current = steps.index(message)
        elif message == "registers_writing":  # the preparation of a register operation has ended
            self._current = len(steps)
        for number, widgets in enumerate(self._rows):
            for widget in widgets:
                widget.setVisible(number < len(steps))
        for number, (step, (icon, name, text)) in enumerate(zip(steps, self._rows, strict=False)):
            manual = self._run.by_hand and step == "starting"  # no table is identified
            texts = rendered(Text(f"preparation.{step}{'_manual' if manual else ''}"))
            icon.set_kind("good" if number < self._current else "active" if number == self._current else "none")
            name.setFont(theme.font(theme.SECTION, bold=number == self._current))
            name.setText(texts.text)
            text.setText(texts.remedy)


class LiveView(QWidget):
    """Shows the events of a run, and details of the selected unit.

    `prefix` is the beginning of the object names.
    """

    def __init__(self, app: AppContext, prefix: str = "") -> None:
        super().__init__()
        run, link = app.run, app.engine_link
        self._run = run
        self.table, self._traces, self._convergence = TablePanel(), Traces(), Convergence()
        self.position, self._upper = PositionPanel(prefix), QWidget()
        self.gimbal = GimbalView()
        self.temperature = TemperaturePanel(run, prefix)
        self._turns: list[GimbalTurned] = []
        self._preparation = Preparation(run)
        self._lower = stack(self._preparation, self._convergence, self.gimbal)
        self.position.finish_requested.connect(lambda: link.send(Command.END_STAGE))
        self.table.setMinimumWidth(37 * theme.GRID)
        #: Traces next to the table; instead, the preparation steps for several units or on a small screen.
        self._beside = stack(self._traces, Preparation(run))
        self._units = UnitTiles(app, prefix)
        row((self.table, 1), (self._beside, 3), on=self._upper)
        below = row((self.temperature, 1), (self._lower, 1))
        self._column = column((self.position, 9), (self._upper, 5), self._units, (below, 4), on=self)
        run.unit_changed.connect(self._show_unit)
        run.changed.connect(self._refresh)
        link.running_changed.connect(lambda running: self._start() if running else self._end())
        link.event.connect(self._show_event)
        self._refresh()

    @property
    def started(self) -> bool:
        """Whether a stage of the run has started; before it, only the preparation is displayed."""
        return any(stage.state != "waiting" for stage in self._run.stages) and not self._run.register_operation

    def _start(self) -> None:
        """Prepare for a new run."""
        run_summary = self._run.run_summary
        set_subject(self, self._run.unit.serial)
        self.table.set_order(self._run.joint_order)
        self.table.clear()
        self._turns = []
        self._traces.start()
        self.temperature.start()
        targets, own = ({}, frozenset()) if run_summary is None else (run_summary.targets, run_summary.own_targets)
        self._convergence.start(targets, [unit.slot for unit in self._run.units], own)
        self._units.start()
        if run_summary is not None:
            self.table.picture.set_axes(run_summary.outer_axis, run_summary.inner_axis)
            self._orient()
            self.position.set_run(run_summary)

    def _end(self) -> None:
        """Stop the traces, and clear the readings of the table, which another program may move from now on."""
        self._traces.stop()
        self.table.clear()

    def _show_event(self, event: Event) -> None:
        """Show an event."""
        match event:
            case TableMoved() | JointsMoved():
                self.table.show_motion(event)
            case GimbalTurned():
                self._turns.append(event)
                self.gimbal.show_data(gimbal_plot_data(self._turns, self._run.joint_order))
                self._refresh()
            case ChamberChanged():
                self.temperature.add()
            case PositionGuided():
                self.position.show_position(event)
            case StageEnded():
                self.position.finish_stage()
            case Trace():
                if event.slot in ("", self._run.unit.slot):
                    self._traces.add(event)
            case StageProgress():
                self._convergence.add(self._run.elapsed, event.sigma, event.slot)
            case StageSolved():
                self._convergence.add(self._run.elapsed, largest_sigmas(event), event.slot)

    def _show_unit(self) -> None:
        """Show the axes, traces and convergence of the selected unit."""
        self._orient()
        self._traces.clear()
        self._convergence.show_unit(self._run.unit.slot)
        self.temperature.refresh()

    def _orient(self) -> None:
        """Draw the axes of the unit in the orientation of its slot."""
        summary = self._run.run_summary
        by_slot = {} if summary is None else dict(zip(summary.slots, summary.orientations, strict=False))
        self.table.picture.set_orientation(by_slot.get(self._run.unit.slot, ALIGNED))

    def _refresh(self) -> None:
        """Show the widgets that are relevant in the current state of the run."""
        run, started = self._run, self.started
        guiding = run.by_hand and started
        self._lower.setCurrentIndex((2 if self._turns else 1) if started else 0)
        # the other views need less height, and a notice needs space above them
        self._preparation.setSizePolicy(_PREFERRED, QSizePolicy.Policy.Ignored if started else _PREFERRED)
        self.table.setVisible(not run.by_hand)
        self.position.setVisible(guiding)
        self.position.show_state(run.state)
        self._upper.setVisible(not guiding)
        several = run.in_slots and not run.register_operation
        height = self.window().height()
        beside = (several or height < _MIN_BELOW) and not started
        self._beside.setCurrentIndex(beside)
        self._units.setVisible(several)
        room = height >= _MIN_HEIGHT + _TILE_HEIGHT * ceil(len(run.slots) / COLUMNS)
        self._lower.setVisible(not (guiding or beside) and (room or not several))
        below = self._lower.isVisibleTo(self) or self.temperature.isVisibleTo(self)
        self._column.setStretch(_BELOW, 4 * below)  # the stretch of a hidden row would remain empty
