"""Status of one unit of a run, accumulated from the engine's events about this unit."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from calstation.physics import GROUPS, INDEX, PARAMETERS
from calstation.records import Verdict
from calstation.results import Result
from calstation.sequencer import (
    Event,
    Fault,
    Finalized,
    Message,
    Settled,
    StageEnded,
    StageProgress,
    StageSolved,
    StageStarted,
    StateChanged,
    StepStarted,
)

#: Messages that are shown again with the verdict.
_REMARKS = (
    "step_repeated",
    "look_repeated",
    "safe_stop_incomplete",
    "azimuth_from_data",
    "table_quiet",
    "not_converged",
    "turns_assumed_whole",
    "transfer_finished",
    "transfer_unproved",
    "old_unproved",
    "stopped_because",
    "stopped_early",
    "latitude_untold",
    "handover_waiting",
    "certificate_waits",
    "certificate_not_made",
    "table_moved",
)

#: Name of the last row, in which the registers are written and verified.
TRANSFER = "transfer"
#: Messages that mark the start and the end of the transfer.
_TRANSFER_STARTS = ("registers_reading", "registers_transfer", "registers_writing")
_TRANSFER_ENDS = ("registers_written", "registers_proved", "registers_read_back")
#: Part of the transfer completed by one move of the verification, which has 17 moves that may be repeated.
_VERIFICATION_STEP = 1.0 / 18.0


@dataclass
class StageState:
    """Display state of a stage, or of the register transfer that follows the stages."""

    name: str
    duration: float  #: Planned duration, s of device time.
    #: waiting, active, solving, good, bad, outside (one of its values fails), stopped, fault; kept without a write.
    state: str = "waiting"
    fraction: float = 0.0
    remaining: float = 0.0  #: Remaining device time, s.
    elapsed: float | None = (
        None  #: Host time from start to solution, s; None until solved or if solved in an earlier run.
    )
    repeated: bool = False  #: Whether it can be ended early; known once it has started.
    started_at: float | None = field(default=None, repr=False)  #: Host time at its start, s; None in an earlier run.

    def start(self, now: float) -> None:
        """Mark the stage as started at host time `now`, s."""
        self.state, self.started_at = "active", now
        self.fraction, self.remaining = 0.0, self.duration

    def solve(self, state: str) -> None:
        """Mark the stage as solved now."""
        self.state, self.fraction, self.remaining = state, 1.0, 0.0
        self.elapsed = None if self.started_at is None else time.monotonic() - self.started_at


def largest_sigmas(event: StageSolved) -> dict[str, float]:
    """Return the largest sigma of each parameter group, SI."""
    largest: dict[str, float] = {}
    for name, solved in event.parameters.items():
        group = PARAMETERS[INDEX[name]].group if name in INDEX else ""
        if group in GROUPS:
            largest[group] = max(solved["sigma"], largest.get(group, 0.0))
    return largest


@dataclass
class UnitStatus:
    """Status of a unit after the events received so far; `slot` is its slot name, "" for a single unit."""

    serial: str
    slot: str = ""
    #: Stages in order, followed by the transfer if the unit has registers.
    stages: list[StageState] = field(default_factory=list)
    sigma: dict[str, float] = field(default_factory=dict)  #: Latest largest sigma by parameter group, SI.
    #: Messages shown again with the verdict, each (id, values).
    remarks: list[tuple[str, Mapping[str, Any]]] = field(default_factory=list)
    #: Values of a register transfer interrupted before this run that requires a decision, or None.
    transfer: Mapping[str, Any] | None = None
    fault: Fault | None = None  #: Fault that ended one of several units, its own or the table's.
    finalized: Finalized | None = None
    result: Result | None = None  #: Result with the verdict.

    @property
    def verdict(self) -> Verdict | None:
        """Verdict about the unit; None while it takes part in the run."""
        if self.fault is not None:
            return Verdict.FAULT
        return None if self.finalized is None else self.finalized.verdict

    @property
    def unfinished(self) -> bool:
        """Whether a stop or fault of the whole run ended it before it passed, failed, or left by its own fault."""
        left = self.fault is not None and bool(self.fault.slot)
        return not left and (self.verdict is None or not self.verdict.judged)

    @property
    def stage(self) -> StageState | None:
        """The current stage."""
        return next((s for s in self.stages if s.state in ("active", "solving")), None)

    @property
    def keeps_registers(self) -> bool:
        """Whether the unit keeps its registers."""
        return self._row(TRANSFER).state == "kept"

    def take(self, event: Event) -> None:
        """Process an event of this unit or of the whole run."""
        match event:
            case StateChanged():
                if event.state in ("stopped", "fault"):
                    self._end_stage(event.state)
            case StageStarted():
                self._start_stage(event)
            case StageProgress():
                row = self._row(event.stage)
                if row.state == "active":
                    row.fraction, row.remaining = event.fraction, event.remaining
                self.sigma |= event.sigma
            case StepStarted():
                row = self._row(TRANSFER)
                if event.label[:1] == ("verify",) and row.state == "active":
                    row.fraction = min(1.0, row.fraction + _VERIFICATION_STEP)
                    row.remaining = row.duration * (1.0 - row.fraction)
            case StageEnded():
                self._row(event.stage).state = "solving"
            case StageSolved():
                self._row(event.stage).solve("bad" if event.consistency["passed"] is False else "good")
                self.sigma |= largest_sigmas(event)
            case Message():
                self._take_message(event.id, event.values)
            case Settled():
                self._end_stage("stopped")
            case Fault():
                self.fault = event if self.slot else None
                self._end_stage("fault")
            case Finalized():
                self.finalized, self.result = event, Result.from_json(event.result)
                if event.verdict in (Verdict.STOPPED, Verdict.FAULT):
                    self._end_stage(event.verdict)
                if self.slot and (self.fault is None or not self.fault.slot):
                    # it may have passed before a fault of the table, or have a fault since its run was closed
                    self.fault = None if self.result.fault is None else Fault.of(self.result.fault)
                self._mark_failed(self.result)

    def _start_stage(self, event: StageStarted) -> None:
        row = self._row(event.stage)
        if row not in self.stages:
            self.stages.insert(len(self.stages) - (self._row(TRANSFER) in self.stages), row)
        row.duration, row.repeated = event.duration, event.repeated
        row.start(time.monotonic())

    def _take_message(self, message: str, values: Mapping[str, Any]) -> None:
        if message in _REMARKS:
            self.remarks.append((message, values))
        row = self._row(TRANSFER)
        if message == "transfer_open":
            self.transfer = values
        elif message == "stopped_early":
            self._row(str(values.get("stage"))).state = "bad"
        elif self._transfer_starts(message) and row.state != "active":
            row.start(time.monotonic())
        elif message in _TRANSFER_ENDS:
            row.solve("good")
        elif message == "registers_kept":
            row.state = "kept"

    def _transfer_starts(self, message: str) -> bool:
        """Return whether a message starts this unit's transfer; a reference capture may belong to other units."""
        return message in _TRANSFER_STARTS or (message == "reference" and not self.slot)

    def _mark_failed(self, result: Result) -> None:
        """Mark the stages that produced failing values, unless later stages would have improved them."""
        if not result.verdict.judged:
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
