"""Status of the run, accumulated from the events of the engine."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from PySide6.QtCore import QObject, QTimer, Signal

from calstation.config import RunSummary, run_summary
from calstation.errors import CalstationError
from calstation.gui.shell.engine_link import EngineLink
from calstation.results import Result
from calstation.sequencer import (
    Command,
    Event,
    Fault,
    Message,
    Settled,
    StageEnded,
    StageProgress,
    StageSolved,
    StageStarted,
    StateChanged,
    StepStarted,
    Verdict,
)

#: States of a run in progress.
_GOING = ("starting", "preparing", "running", "pausing", "paused", "stopping")

#: States of the sequencer after a run or a register operation.
_ENDED = ("stopped", "fault", "passed", "failed", "done")

#: Outcomes of a run.
_OUTCOMES = ("passed", "failed", "stopped", "incomplete")

#: Messages that are shown again with the verdict.
_REMARKS = (
    "step_repeated",
    "look_repeated",
    "safe_stop_incomplete",
    "azimuth_from_data",
    "table_quiet",
    "not_settled",
    "turns_assumed_whole",
    "transfer_finished",
    "transfer_unproved",
    "old_unproved",
    "stopped_because",
    "stopped_early",
    "latitude_untold",
    "handover_waiting",
    "certificate_waits",
)

#: Name of the last row, in which the registers are written and verified.
_TRANSFER = "transfer"
#: Messages that mark the start and the end of the transfer.
_TRANSFER_STARTS = ("reference", "registers_transfer", "registers_writing")
_TRANSFER_ENDS = ("registers_written", "registers_proved", "registers_read_back")
#: Host time after which the pace is accurate enough, s.
_PACE_FROM = 2.0
#: Part of the transfer completed by one move of the verification, which has 17 moves that may be repeated.
_VERIFICATION_STEP = 1.0 / 18.0


@dataclass
class StageState:
    """Display state of a stage, or of the register transfer that follows the stages."""

    name: str
    duration: float  #: Planned duration, s of device time.
    #: waiting, active, solving, good, bad, outside (a value of it fails), stopped, fault; kept if nothing is written.
    state: str = "waiting"
    fraction: float = 0.0
    remaining: float = 0.0  #: Remaining device time, s.
    took: float | None = None  #: Host time from start to solution, s; None until solved or if solved in an earlier run.
    repeated: bool = False  #: Whether it can be ended early; known once it has started.
    begun: float | None = field(default=None, repr=False)  #: Host time at its start, s; None in an earlier run.

    def start(self, now: float) -> None:
        """Mark the stage as started at host time `now`, s."""
        self.state, self.begun = "active", now
        self.fraction, self.remaining = 0.0, self.duration

    def solve(self, state: str) -> None:
        """Mark the stage as solved now."""
        self.state, self.fraction, self.remaining = state, 1.0, 0.0
        self.took = None if self.begun is None else time.monotonic() - self.begun


class RunStatus(QObject):
    """Status of the run after the events received so far."""

    changed = Signal()  #: Emitted shortly after a change, once for several events.
    stop_pressed = Signal()  #: Emitted in every state.

    def __init__(self, link: EngineLink, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._link = link
        #: State of the sequencer, or ``starting`` before its first event.
        self.state = "idle"
        self.run_summary: RunSummary | None = None
        self.register_operation = False
        #: Whether station and product can be used for the next run.
        self.runnable = True
        #: Whether the sequencer has begun to command the table; False while devices are opened and identified.
        self.commanded = False
        self.serial = ""
        #: Stages in order, followed by the transfer if the unit has registers.
        self.stages: list[StageState] = []
        #: Latest message ("message", id, values) or step ("step", kind, label); a dwell has the label of its move.
        self.latest: tuple[str, str, Any] | None = None
        #: Messages shown again with the verdict, each (id, values).
        self.remarks: list[tuple[str, Mapping[str, Any]]] = []
        #: Values of a register transfer interrupted before this run that requires a decision, or None.
        self.transfer: Mapping[str, Any] | None = None
        #: Name of the stage that the operator has ended, until the next run.
        self.stage_ending = ""
        self.verdict: Verdict | None = None
        #: Fault of the last run until `acknowledge` is called.
        self.fault: Fault | None = None
        self._begun = self._done_before = 0.0
        self._changed_timer = QTimer(self, singleShot=True, interval=0)
        self._changed_timer.timeout.connect(self.changed)
        link.running_changed.connect(self._running_changed)
        link.event.connect(self._handle_event)

    @property
    def going(self) -> bool:
        """Whether a run is in progress."""
        return self.state in _GOING

    @property
    def by_hand(self) -> bool:
        """Whether the run is on a manual rig."""
        return self.run_summary is not None and self.run_summary.by_hand

    @property
    def on_gimbal(self) -> bool:
        """Whether the run is on a gimbal."""
        return self.run_summary is not None and bool(self.run_summary.joint_order)

    @property
    def shown(self) -> str:
        """State to display: `state`, or one of these.

        ``partial`` if a partial run passed, ``writing`` during a register operation, ``not_ready`` if no run can start.
        """
        if self.state == "passed" and self.partial:
            return "partial"
        if self.state == "idle" and not self.runnable:
            return "not_ready"
        return "writing" if self.register_operation and self.state == "running" else self.state

    @property
    def partial(self) -> bool:
        """Whether the run omits stages of its product."""
        summary = self.run_summary
        return summary is not None and bool(summary.omitted) and not self.register_operation

    @property
    def ended(self) -> bool:
        """Whether a run has ended without a fault."""
        return self.state in _OUTCOMES

    @property
    def stage(self) -> StageState | None:
        """The current stage."""
        return next((s for s in self.stages if s.state in ("active", "solving")), None)

    @property
    def done(self) -> float:
        """Completed part of the planned device time, s."""
        return sum(s.duration - self.left(s) for s in self.stages)

    @property
    def fraction(self) -> float:
        """Completed fraction of the planned time, 0 to 1."""
        total = sum(s.duration for s in self.stages)
        return self.done / total if total > 0.0 else 0.0

    @property
    def pace(self) -> float | None:
        """Ratio of device time to host time: 1 on hardware, measured on a virtual bench; None until known."""
        if self.run_summary is not None and not self.run_summary.virtual:
            return 1.0
        elapsed, done = time.monotonic() - self._begun, self.done - self._done_before
        return done / elapsed if self._begun and elapsed > _PACE_FROM and done > 0.0 else None

    @property
    def remaining(self) -> float | None:
        """Remaining host time, s; None until it can be estimated."""
        pace = self.pace
        if pace is None or not self.going:
            return None
        return sum(self.left(s) for s in self.stages) / pace

    def left(self, stage: StageState) -> float:
        """Return the remaining device time of a stage, s."""
        if stage.state == "waiting":
            return stage.duration
        return stage.remaining if stage.state == "active" else 0.0

    def set_runnable(self, runnable: bool) -> None:
        """Set whether station and product can be used for the next run."""
        self.runnable = runnable
        self.changed.emit()

    def stop(self) -> None:
        """Stop a run in progress safely; the state changes to ``stopping`` before the engine confirms it."""
        self._link.send(Command.STOP)
        self.stop_pressed.emit()
        if self.going and self.state != "stopping":
            self.state = "stopping"
            self.changed.emit()

    def end_stage(self) -> None:
        """End the current stage after the current move; the run solves it and goes on."""
        if self.stage is not None:
            self.stage_ending = self.stage.name
            self._link.send(Command.END_STAGE)
            self.changed.emit()

    @property
    def why_not_end_stage(self) -> str:
        """Why the current stage cannot be ended early: term of the family ``end_stage``; "" if it can."""
        stage = self.stage
        if stage is None or self.state != "running":
            return "no_stage"
        if stage.state != "active" or not stage.repeated:
            return "not_repeated"
        return "ending" if stage.name == self.stage_ending else ""

    def acknowledge(self) -> None:
        """Clear the fault so that a run can start; disconnect from the engine if it has not ended."""
        if self.fault is not None:
            self._link.give_up()
            self.fault = None
        self.state = "idle"
        self.changed.emit()

    def _running_changed(self, running: bool) -> None:
        if running:
            assert self._link.request is not None
            self.state, self.commanded = "starting", False
            self.register_operation = self._link.operation is not None
            self.serial = self._link.request.serial
            self.verdict = self.fault = self.latest = self.transfer = None
            self.remarks = []
            self.stage_ending = ""
            self._begun = self._done_before = 0.0
            try:
                self.run_summary = run_summary(self._link.request)
                rows = planned(self.run_summary)
                self.stages = [row for row in rows if row.name == _TRANSFER or not self.register_operation]
            except CalstationError:  # the engine encounters the same error and reports it as a fault
                self.run_summary, self.stages = None, []
        elif self.going:
            self.state = "idle" if self.register_operation else "incomplete"
        self.changed.emit()

    def _handle_event(self, event: Event) -> None:
        match event:
            case StateChanged():
                self._change_state(event.state)
            case StageStarted():
                self._start_stage(event)
            case StageProgress():
                row = self._row(event.stage)
                if row.state == "active":
                    row.fraction, row.remaining = event.fraction, event.remaining
            case StepStarted():
                self._start_step(event)
            case StageEnded():
                self._row(event.stage).state = "solving"
            case StageSolved():
                self._row(event.stage).solve("bad" if event.consistency["passed"] is False else "good")
            case Message():
                self._handle_message(event.id, event.values)
            case Settled():
                self.state = "idle"
                self._end_stage("stopped")
            case Fault():
                self.fault, self.state = event, "fault"
                self._end_stage("fault")
            case Verdict():
                self.verdict = event
                self._mark_failed(Result.from_json(event.result))
                if event.outcome in _OUTCOMES:
                    self.state = event.outcome
            case _:
                return
        self._changed_timer.start()

    def _change_state(self, state: str) -> None:
        self.commanded = self.commanded or state not in _ENDED
        if self.state == "stopping" and state not in _ENDED:
            return  # the event was sent before the stop
        if state in _ENDED and self.register_operation:
            return  # the result of the operation follows
        self.state = state
        if state in ("stopped", "fault"):
            self._end_stage(state)

    def _start_stage(self, event: StageStarted) -> None:
        now = time.monotonic()
        if not self._begun:  # stages completed before a resume are excluded from the pace
            self._begun, self._done_before = now, self.done
        row = self._row(event.stage)
        if row not in self.stages:
            self.stages.insert(len(self.stages) - (self._row(_TRANSFER) in self.stages), row)
        row.duration, row.repeated = event.duration, event.repeated
        row.start(now)

    def _start_step(self, event: StepStarted) -> None:
        after_move = event.kind == "dwell" and self.latest is not None and self.latest[0] == "step"
        self.latest = ("step", event.kind, self.latest[2] if after_move and self.latest else event.label)
        row = self._row(_TRANSFER)
        if event.label[:1] == ("verify",) and row.state == "active":
            row.fraction = min(1.0, row.fraction + _VERIFICATION_STEP)
            row.remaining = row.duration * (1.0 - row.fraction)

    def _handle_message(self, message: str, values: Mapping[str, Any]) -> None:
        self.latest = ("message", message, values)
        if message in _REMARKS:
            self.remarks.append((message, values))
        row = self._row(_TRANSFER)
        if message == "transfer_open":
            self.transfer = values
        elif message == "stopped_early":
            self._row(str(values.get("stage"))).state = "bad"
        elif message in _TRANSFER_STARTS and row.state != "active":
            row.start(time.monotonic())
        elif message in _TRANSFER_ENDS:
            row.solve("good")
        elif message == "registers_kept":
            row.state = "kept"

    def _mark_failed(self, result: Result) -> None:
        """Mark the stages that produced failing values, unless later stages would have improved them."""
        if not result.judged:
            return
        for stage in self.stages:
            if stage.state == "good" and stage.name in result.failed_stages:
                stage.state = "outside"

    def _end_stage(self, state: str) -> None:
        """End the current stage without a solution."""
        for stage in self.stages:
            if stage.state in ("active", "solving"):
                stage.state = state

    def _row(self, name: str) -> StageState:
        """Return the row of a stage, or a new row that is not yet in `stages`."""
        return next((s for s in self.stages if s.name == name), StageState(name, 0.0))


def planned(run_summary: RunSummary) -> list[StageState]:
    """Return the rows of a run before it starts."""
    rows = [StageState(s.name, s.duration) for s in run_summary.stages]
    if run_summary.transfer is not None:
        rows.append(StageState(_TRANSFER, run_summary.transfer))
    return rows
