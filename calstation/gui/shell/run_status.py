"""Where the run stands, folded from the engine's events for everything that shows it."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from PySide6.QtCore import QObject, QTimer, Signal

from calstation.config.summary import RunSummary, run_summary
from calstation.errors import CalstationError
from calstation.gui.shell.engine_link import EngineLink
from calstation.sequencer.control import Command
from calstation.sequencer.events import (
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

#: States in which a run is going on.
MOVING_STATES = ("starting", "preparing", "running", "pausing", "paused", "stopping")

#: States in which a run or an errand is over.
ENDED = ("stopped", "fault", "passed", "failed", "done")

#: Messages that still matter when the run is over.
_REMARKS = (
    "step_repeated",
    "look_repeated",
    "safe_stop_incomplete",
    "azimuth_from_data",
    "not_settled",
    "turns_assumed_whole",
    "transfer_finished",
    "transfer_unproved",
    "old_unproved",
    "stopped_because",
    "stopped_early",
    "latitude_untold",
    "handover_waiting",
)

#: The last row: registers written and verified.
TRANSFER = "transfer"

#: Moves before and after the unit's restart, which tell how far its verification is.
_TURNS = 17

#: Host time after which a virtual bench's pace is known well enough to tell the time left, s.
_TRUST_AFTER = 2.0


@dataclass
class StageState:
    """One stage as it is shown, or the transfer behind them.

    state : waiting, active, solving, good, bad, stopped, fault; kept, where no register is to be written
    fraction : 0..1; duration : of its plan, s of device time; remaining : of it
    begun : host time of its start; None for a stage that an earlier run has gone through
    took : host seconds from start to solution, once solved; None where that was not here
    """

    name: str
    duration: float
    state: str = "waiting"
    fraction: float = 0.0
    remaining: float = 0.0
    took: float | None = None
    begun: float | None = field(default=None, repr=False)

    def ended(self) -> None:
        """It has its answer."""
        self.fraction, self.remaining = 1.0, 0.0
        self.took = None if self.begun is None else time.monotonic() - self.begun


class RunStatus(QObject):
    """What the events so far amount to; `changed` soon after events that change it, once for many;
    `stop_pressed` whenever the operator presses STOP, whatever the state.

    Attributes
    ----------
    state : the sequencer's, or ``starting`` before its first word
    outline : what the run is; None before the first one
    errand : it is no run but an errand at the unit's registers
    serial : of its unit, "" before the first one
    stages : in order, and the transfer where the unit has registers
    said : latest message or step as ("message", id, values) or ("step", kind, label), to be worded when shown;
        a dwell has the label of the move before it
    remarks : messages that still matter when the run is over, each (id, values)
    transfer : of registers, found interrupted before this run and waiting for a decision; None for none
    verdict : of the last run; fault : latched until `acknowledge`
    """

    changed = Signal()
    stop_pressed = Signal()

    def __init__(self, link: EngineLink, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._link = link
        self.state = "idle"
        self.run_summary: RunSummary | None = None
        self.errand = False
        self.serial = ""
        self.stages: list[StageState] = []
        self.said: tuple[str, str, Any] | None = None
        self.remarks: list[tuple[str, Mapping[str, Any]]] = []
        self.transfer: Mapping[str, Any] | None = None
        self.verdict: Verdict | None = None
        self.fault: Fault | None = None
        self._begun = self._behind = 0.0
        self._telling = QTimer(self, singleShot=True, interval=0)
        self._telling.timeout.connect(self.changed)
        link.running_changed.connect(self._running_changed)
        link.event.connect(self._take)

    @property
    def going(self) -> bool:
        """Whether a run is going on."""
        return self.state in MOVING_STATES

    @property
    def shown(self) -> str:
        """`state` as it is to be worded and drawn: what is no calibration is not running as one."""
        return "writing" if self.errand and self.state == "running" else self.state

    @property
    def ended(self) -> bool:
        """Whether a run has ended with nothing to be acknowledged."""
        return self.state in ("passed", "failed", "stopped", "incomplete")

    @property
    def stage(self) -> StageState | None:
        """The stage in hand."""
        return next((s for s in self.stages if s.state in ("active", "solving")), None)

    @property
    def done(self) -> float:
        """Device seconds of the plans that are behind."""
        return sum(s.duration - self.left(s) for s in self.stages)

    @property
    def fraction(self) -> float:
        """How much of the run is done, 0..1, by the plans' time."""
        total = sum(s.duration for s in self.stages)
        return self.done / total if total > 0.0 else 0.0

    @property
    def pace(self) -> float | None:
        """Device seconds per host second: 1 on hardware, measured on a virtual bench, None until known."""
        if self.run_summary is not None and not self.run_summary.virtual:
            return 1.0
        elapsed, done = time.monotonic() - self._begun, self.done - self._behind
        return done / elapsed if self._begun and elapsed > _TRUST_AFTER and done > 0.0 else None

    @property
    def remaining(self) -> float | None:
        """Host seconds left, None where nobody can tell yet."""
        pace = self.pace
        if pace is None or not self.going:
            return None
        return sum(self.left(s) for s in self.stages) / pace

    def left(self, stage: StageState) -> float:
        """Device seconds that a stage still takes."""
        if stage.state == "waiting":
            return stage.duration
        return stage.remaining if stage.state == "active" else 0.0

    def stop(self) -> None:
        """Stop safely: shown at once, before the engine has heard it. Harmless where nothing runs."""
        self._link.send(Command.STOP)
        self.stop_pressed.emit()
        if self.going and self.state != "stopping":
            self.state = "stopping"
            self.changed.emit()

    def acknowledge(self) -> None:
        """Unlatch the fault: a run may start again. An engine that hangs is given up."""
        if self.fault is not None:
            self._link.give_up()
            self.fault = None
        self.state = "idle"
        self.changed.emit()

    def _running_changed(self, running: bool) -> None:
        if running:
            assert self._link.request is not None
            self.state = "starting"
            self.errand = self._link.errand is not None
            self.serial = self._link.request.serial
            self.verdict = self.fault = self.said = None
            self.remarks = []
            self.transfer = None
            self._begun = self._behind = 0.0
            try:
                self.run_summary = run_summary(self._link.request)
                rows = planned(self.run_summary)
                self.stages = [row for row in rows if row.name == TRANSFER or not self.errand]
            except CalstationError:  # the engine meets it as well and tells it as a fault
                self.stages = []
        elif self.going:
            self.state = "idle" if self.errand else "incomplete"
        self.changed.emit()

    def _take(self, event: Event) -> None:
        if isinstance(event, StateChanged):
            self._change_state(event.state)
        elif isinstance(event, StageStarted):
            self._start_stage(event)
        elif isinstance(event, StageProgress):
            stage = self._find(event.stage)
            if stage is not None and stage.state == "active":
                stage.fraction, stage.remaining = event.fraction, event.remaining
        elif isinstance(event, StepStarted):
            resting = event.kind == "dwell" and self.said is not None and self.said[0] == "step"
            self.said = ("step", event.kind, self.said[2] if resting and self.said else event.label)
            if event.label[:1] == ("verify",):
                self._transfer_goes_on()
        elif isinstance(event, StageEnded):
            self._mark(event.stage, "solving")
        elif isinstance(event, StageSolved):
            self._solve_stage(event)
        elif isinstance(event, Message):
            self._hear(event.id, event.values)
        elif isinstance(event, Settled):
            self.state = "idle"
            self._leave("stopped")
        elif isinstance(event, Fault):
            self.fault = event
            self.state = "fault"
            self._leave("fault")
        elif isinstance(event, Verdict):
            self.verdict = event
            if event.outcome in ("passed", "failed", "stopped", "incomplete"):
                self.state = event.outcome
        else:
            return
        self._telling.start()

    def _change_state(self, state: str) -> None:
        if self.state == "stopping" and state not in ENDED:
            return  # the stop was pressed after this was said
        if state in ENDED and self.errand:
            return  # its last word follows
        self.state = state
        if state == "stopped":
            self._leave("stopped")
        elif state == "fault":
            self._leave("fault")

    def _start_stage(self, event: StageStarted) -> None:
        now = time.monotonic()
        if not self._begun:  # what a run that is carried on has brought along tells nothing of the pace
            self._begun, self._behind = now, self.done
        stage = self._find(event.stage)
        if stage is None:
            stage = StageState(event.stage, event.duration)
            last = self.stages[-1:] and self.stages[-1].name == TRANSFER
            self.stages.insert(len(self.stages) - bool(last), stage)
        stage.state, stage.begun = "active", now
        stage.fraction, stage.duration, stage.remaining = 0.0, event.duration, event.duration

    def _solve_stage(self, event: StageSolved) -> None:
        stage = self._mark(event.stage, "good" if event.consistency["passed"] else "bad")
        if stage is not None:
            stage.ended()

    def _hear(self, key: str, values: Mapping[str, Any]) -> None:
        self.said = ("message", key, values)
        if key in _REMARKS:
            self.remarks.append((key, values))
        self._hear_of_transfer(key)
        if key == "transfer_open":
            self.transfer = values
        if key == "stopped_early":
            self._mark(str(values.get("stage")), "bad")

    def _hear_of_transfer(self, key: str) -> None:
        row = self._find(TRANSFER)
        if row is None:
            return
        if key in ("reference", "registers_transfer", "registers_writing"):
            if row.state != "active":
                row.state, row.begun, row.remaining = "active", time.monotonic(), row.duration
        elif key in ("registers_written", "registers_proved", "registers_read_back"):
            row.state = "good"
            row.ended()
        elif key == "registers_kept":
            row.state = "kept"

    def _transfer_goes_on(self) -> None:
        row = self._find(TRANSFER)
        if row is not None and row.state == "active":
            row.fraction = min(1.0, row.fraction + 1.0 / (_TURNS + 1))  # turns may be made again
            row.remaining = row.duration * (1.0 - row.fraction)

    def _leave(self, state: str) -> None:
        """The stage in hand ends without an answer."""
        for stage in self.stages:
            if stage.state in ("active", "solving"):
                stage.state = state

    def _mark(self, name: str, state: str) -> StageState | None:
        stage = self._find(name)
        if stage is not None:
            stage.state = state
        return stage

    def _find(self, name: str) -> StageState | None:
        return next((s for s in self.stages if s.name == name), None)


def planned(run_summary: RunSummary) -> list[StageState]:
    """The rows of a run to come."""
    rows = [StageState(s.name, s.duration) for s in run_summary.stages]
    if run_summary.transfer is not None:
        rows.append(StageState(TRANSFER, run_summary.transfer))
    return rows
