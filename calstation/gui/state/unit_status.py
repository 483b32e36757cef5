"""The status of a unit in a run, which is derived from the events of the engine."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from calstation.config import RunRequest
from calstation.physics import GROUPS, INDEX, PARAMETERS
from calstation.records import Verdict
from calstation.results import History, Result
from calstation.runs import RunSummary
from calstation.sequencer import (
    DURATION,
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
    "unloading_stopped",
    "unloading_failed",
    "latitude_untold",
    "handover_waiting",
    "certificate_waits",
    "certificate_not_made",
    "table_moved",
)

#: Name of the row after the stages, in which the registers are written and verified.
TRANSFER = "transfer"
#: Messages that start and end the transfer.
_TRANSFER_STARTS = ("registers_reading", "registers_transfer", "registers_writing")
_TRANSFER_ENDS = ("registers_written", "registers_proved", "registers_read_back")
#: Minimum remaining fraction from which the planned duration of a stage is calculated, because of rounding.
_MIN_REMAINING = 1e-6
#: Tolerance for the durations of stages, s.
_TOLERANCE = 0.1
#: Time per move of the verification, s; there are 17 moves, and more if some are repeated.
_VERIFICATION_STEP = DURATION / 18.0


@dataclass
class StageState:
    """The displayed state of a stage, or of the register transfer after the stages."""

    name: str
    duration: float  #: Planned duration or, after the motion, actual duration, s of device time.
    #: waiting, active, solving, good, bad, failed (a value exceeds its limit), stopped, fault, or kept (not written).
    state: str = "waiting"
    fraction: float = 0.0
    remaining: float = 0.0  #: Remaining device time, s.
    elapsed: float | None = None  #: Host time from start to solution, s; None while unknown.
    earlier: float = 0.0  #: Device time of completed rounds of an open-ended stage, s.
    repeated: bool = False  #: Whether the started stage can be ended early.
    started_at: float | None = field(default=None, repr=False)  #: Host time at the start, s; None if not in this run.

    def start(self) -> None:
        """Mark the stage as started at the current time."""
        self.state, self.started_at = "active", time.monotonic()
        self.fraction, self.remaining, self.earlier = 0.0, self.duration, 0.0

    def progress(self, fraction: float, remaining: float) -> None:
        """Adopt the progress within the currently planned duration.

        The duration changes with the expected time of soaks, is extended if the targets have not been reached, and
        starts again with every round of an open-ended stage.
        """
        before = self.fraction * self.duration
        if 1.0 - fraction > _MIN_REMAINING:
            self.duration = remaining / (1.0 - fraction)
        if fraction * self.duration < before - _TOLERANCE:
            self.earlier += before
        self.fraction, self.remaining = fraction, remaining

    def end(self, state: str) -> None:
        """Adopt a new state and the actual duration at the end of the motion, even if it ended early."""
        self.state, self.duration, self.remaining = state, self.duration - self.remaining, 0.0

    def solve(self, state: str) -> None:
        """Mark the stage as solved at the current time, with its new state."""
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
    """The status of a unit; `slot` is the name of its slot, or "" at a station for a single unit."""

    serial: str
    slot: str = ""
    product: str = ""  #: Name of the slot's own product; "" for that of the run.
    #: The stages in order and, if the unit has registers, the transfer.
    stages: list[StageState] = field(default_factory=list)
    sigma: dict[str, float] = field(default_factory=dict)  #: Largest sigma of each parameter group, SI units.
    #: Ids and values of the messages that are shown again with the verdict.
    remarks: list[tuple[str, Mapping[str, Any]]] = field(default_factory=list)
    failing: bool = False  #: Whether the unit will fail, regardless of the remaining stages.
    fault: Fault | None = None  #: Fault of the unit or of the table, at a station with several slots.
    finalized: Finalized | None = None
    result: Result | None = None  #: Result with the verdict.

    @property
    def verdict(self) -> Verdict | None:
        """Verdict on the unit; None while it takes part in the run."""
        if self.fault is not None:
            return Verdict.FAULT
        return None if self.finalized is None else self.finalized.verdict

    @property
    def unfinished(self) -> bool:
        """Whether the run stopped before the unit passed, failed or had its own fault."""
        own_fault = self.fault is not None and bool(self.fault.slot)
        return not own_fault and (self.verdict is None or not self.verdict.judged)

    @property
    def resumable(self) -> bool:
        """Whether the run of the unit can be resumed according to its result, also after its own fault."""
        return self.result is not None and self.result.advice == "resume" and self.result.closed_utc is None

    @property
    def unverified(self) -> bool:
        """Whether registers were written to the unit but not verified, on which the operator has to decide."""
        return any(message == "transfer_unproved" for message, _ in self.remarks)

    @property
    def failed(self) -> bool:
        """Whether the unit failed or had its own fault, so that it may be calibrated again in its slot."""
        return self.verdict is Verdict.FAILED or (self.fault is not None and bool(self.fault.slot))

    @property
    def stage(self) -> StageState | None:
        """The current stage."""
        return next((s for s in self.stages if s.state in ("active", "solving")), None)

    @property
    def keeps_registers(self) -> bool:
        """Whether the unit keeps its registers."""
        return self._row(TRANSFER).state == "kept"

    def recover(self) -> None:
        """Continue after a fault of an engine that responds again."""
        if self.fault is not None and not self.fault.slot:
            self.fault = None
        for stage in self.stages:
            if stage.state == "fault":
                stage.state = "active"

    def handle_event(self, event: Event) -> None:
        """Process an event of this unit or of the whole run."""
        match event:
            case StateChanged():
                if event.state in ("stopped", "fault"):
                    self._end_stage(event.state)
            case StageStarted():
                row = self._row(event.stage)
                if row not in self.stages:
                    self.stages.insert(len(self.stages) - (self._row(TRANSFER) in self.stages), row)
                row.duration, row.repeated = event.duration, event.repeated
                row.start()
            case StageProgress():
                row = self._row(event.stage)
                if row.state == "active":
                    row.progress(event.fraction, event.remaining)
                self.sigma |= event.sigma
            case StepStarted():
                row = self._row(TRANSFER)
                if event.label[:1] in (("reference",), ("verify",)) and row.state == "active":
                    left = max(row.remaining - _VERIFICATION_STEP, 0.0)
                    row.progress(1.0 - left / row.duration, left)
            case StageEnded():
                self._row(event.stage).end("stopped" if event.reason == "failing" else "solving")
            case StageSolved():
                self._row(event.stage).solve("bad" if event.consistency["passed"] is False else "good")
                self.sigma |= largest_sigmas(event)
            case Message():
                self._handle_message(event.id, event.values)
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
                    # the unit may have passed before a fault of the table; its own fault may be only in the result
                    self.fault = None if self.result.fault is None else Fault.of(self.result.fault)
                if self.result.verdict.judged:  # otherwise later stages might have improved the values
                    for row in self.stages:
                        if row.state == "good" and row.name in self.result.failed_stages:
                            row.state = "failed"

    def soak_to_verify(self, elapsed: float, remaining: float) -> None:
        """Adopt the elapsed and remaining time, s, of the soak with which the transfer begins."""
        row, left = self._row(TRANSFER), remaining + DURATION
        if row.state == "active":
            row.progress(elapsed / (elapsed + left), left)

    def _handle_message(self, message: str, values: Mapping[str, Any]) -> None:
        if message in _REMARKS:
            self.remarks.append((message, values))
        row = self._row(TRANSFER)
        # with several units, the reference capture may be for another unit
        starts = _TRANSFER_STARTS if self.slot else (*_TRANSFER_STARTS, "reference")
        if message == "will_fail":
            self.failing = True
        elif message == "stopped_early":
            self._row(str(values.get("stage"))).state = "bad"
        elif message in starts and row.state != "active":
            row.start()
        elif message == "soaked":
            self.soak_to_verify(row.fraction * row.duration, 0.0)
        elif message in _TRANSFER_ENDS:
            row.solve("good")
        elif message == "registers_kept":
            row.state = "kept"

    def _end_stage(self, state: str) -> None:
        """End the current stage without a solution."""
        for stage in self.stages:
            if stage.state in ("active", "solving"):
                stage.state = state

    def _row(self, name: str) -> StageState:
        """Return the row of a stage, or a new row if the stage is not in `stages`."""
        return next((s for s in self.stages if s.name == name), StageState(name, 0.0))


def stage_rows(run_summary: RunSummary) -> list[StageState]:
    """Return the initial states of the stages of a run and, if the unit has registers, of the transfer."""
    rows = [StageState(s.name, s.duration) for s in run_summary.stages]
    if run_summary.transfer is not None:
        rows.append(StageState(TRANSFER, run_summary.transfer))
    return rows


def completed_stages(request: RunRequest, units: Sequence[UnitStatus]) -> tuple[str, ...]:
    """Return the stages that the resumed runs of all units have completed, according to the index."""
    history = History(request.out)
    logs = {log.name for log in (*request.resumes, request.resume) if log is not None}
    records = [record for unit in units for record in history.of(unit.serial) if record.log.name in logs]
    return min((record.stages for record in records), key=len, default=())


def units_of(request: RunRequest, summary: RunSummary | None, *, register_operation: bool) -> tuple[UnitStatus, ...]:
    """Return the units of a request; a register operation has no stages."""
    if summary is None:
        return (UnitStatus(request.serial),)
    slots = zip(summary.slots, request.serials, strict=False) if request.serials else (("", request.serial),)
    occupied = [(serial, slot) for slot, serial in slots if serial]
    own = summary.slot_products
    units = tuple(UnitStatus(serial, slot, own.get(slot, ""), stage_rows(summary)) for serial, slot in occupied)
    if register_operation:
        for unit in units:
            unit.stages = [StageState(TRANSFER, DURATION) for row in unit.stages if row.name == TRANSFER]
    elif request.resume is not None:
        completed = completed_stages(request, units)
        for row in (row for unit in units for row in unit.stages if row.name in completed):
            row.solve("good")
    return units
