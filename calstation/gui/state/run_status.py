"""The status of the run, which is derived from the events of the engine."""

import time
from typing import Any

from PySide6.QtCore import QObject, QTimer, Signal

from calstation.errors import CalstationError
from calstation.gui.state.chamber_status import ChamberStatus
from calstation.gui.state.engine_link import EngineLink
from calstation.gui.state.table_status import TableStatus
from calstation.gui.state.unit_status import StageState, UnitStatus, units_of
from calstation.gui.text import rendered, say
from calstation.messages import Text
from calstation.records import END_FAILING, Verdict
from calstation.runs import RunSummary, resumable_after, run_summary
from calstation.sequencer import (
    ChamberChanged,
    Command,
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

#: States of a run in progress.
_IN_PROGRESS = ("starting", "preparing", "running", "pausing", "paused", "stopping")
#: States of the sequencer after a run or a register operation.
_ENDED = ("stopped", "fault", "done")
#: Verdicts of a run without a fault; the run's verdict is the first in this list that any unit has.
_VERDICTS = (Verdict.STOPPED, Verdict.INCOMPLETE, Verdict.FAILED, Verdict.PARTIAL, Verdict.PASSED)
#: Events that change the status of the run.
_STATUS_EVENTS = (
    *(StateChanged, StageStarted, StageProgress, StepStarted, StageEnded, StageSolved),
    *(Message, Settled, Fault, Finalized),
)
#: Code of the fault of an engine that does not respond, after which it may respond again.
_SILENT = "run.engine_silent"
#: Message about one unit that is displayed for all units.
_UNIT_LEFT = "unit_left"
#: State of the registers after a message; the other messages do not change it.
_REGISTERS = {
    **dict.fromkeys(("registers_transfer", "registers_writing"), "writing"),
    "verifying": "verifying",
    **dict.fromkeys(("registers_written", "registers_proved", "registers_read_back"), "written"),
}
#: Minimum host time after which the pace is estimated, s.
_MIN_ELAPSED = 2.0


class RunStatus(QObject):
    """Status of the run and of its units."""

    changed = Signal()  #: Emitted shortly after a change, once for several events.
    stop_pressed = Signal()  #: Emitted whenever STOP is pressed, in any state.
    unit_changed = Signal()  #: Emitted when another unit is selected.
    stop_incomplete_changed = Signal(bool)  #: Emitted with the new value of `stop_incomplete`.
    chamber_acknowledged = Signal()  #: Emitted when the notice about the chamber after a run has been closed.

    def __init__(self, link: EngineLink, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._link = link
        #: State of the sequencer, or ``starting`` before its first event, or the verdict after the run.
        self.state = "idle"
        self.run_summary: RunSummary | None = None
        self.register_operation = False
        #: Why the station and the product are not usable for the next run; None if they are usable.
        self.problem: Text | None = None
        #: What an operator must do before the next run; whether a question to the operator is open.
        self.missing, self.asking = "", False
        #: Symbol and text of the state of the IMUs that are monitored live, outside a run; None without monitoring.
        self.monitoring: tuple[str, Text] | None = None
        #: ``writing`` while registers are written, ``verifying`` until they are verified, then ``written``; "" before.
        self.registers = ""
        #: Whether a pause was requested that has not begun yet.
        self.pause_requested = False
        #: Whether calibration is complete and the table is moving to its load position.
        self.unloading = False
        #: Whether the sequencer may have moved the table; False while devices are opened and identified.
        self.commanded = False
        #: Serial numbers and state of the run in the first window of the station; None in that window.
        self.elsewhere: tuple[tuple[str, ...], str] | None = None
        #: Text about another program that uses the devices of the station, and the effect of STOP on it; None for none.
        self.program: Text | None = None
        #: Units of the run in the order of their slots.
        self.units: tuple[UnitStatus, ...] = (UnitStatus(""),)
        #: Unit that is displayed in detail.
        self.unit = self.units[0]
        #: Latest message ("message", id, values) or step ("step", kind, label), or the stage that is being solved
        #: ("solving", stage, None); a dwell has the label of its move.
        self.latest: tuple[str, str, Any] | None = None
        #: Whether the run, if it ended now, could be resumed after a completed stage or temperature.
        self.resumable = False
        #: Whether a command of the safe stop failed, so that the table may still be moving; False after a reset.
        self.stop_incomplete = False
        #: Latched fault of the table that was acknowledged but not reset, until it is reset or a run starts.
        self.unreset: Fault | None = None
        self.table, self.chamber = TableStatus(), ChamberStatus()
        #: Station time at the start of the soak before the verification of registers, s; None outside this soak.
        self._soaks_from: float | None = None
        #: Name of the stage that the operator has ended early; kept until the next run.
        self.stage_ending = ""
        #: Fault of the last run until `acknowledge` is called.
        self.fault: Fault | None = None
        #: Whether the search for interrupted runs after startup is in progress; no run can start until it ends.
        self.reading_runs = False
        #: State before the fault, to which the run returns if its engine responds again.
        self._before_fault = ""
        #: Host time at the start of the first stage, s, and completed device time at that time, s.
        self._started_at = self._done_before = 0.0
        #: Host time of all completed pauses, s, and host time at the start of the current pause, s, or 0.
        self._paused = self._paused_at = 0.0
        self._changed_timer = QTimer(self, singleShot=True, interval=0)
        self._changed_timer.timeout.connect(self.changed)
        link.running_changed.connect(self._running_changed)
        link.event.connect(self._handle_event)

    @property
    def in_progress(self) -> bool:
        """Whether a run is in progress."""
        return self.state in _IN_PROGRESS

    @property
    def serials(self) -> tuple[str, ...]:
        """Serial numbers of the units of the run; empty while no run or verdict is displayed."""
        return () if self.state == "idle" else tuple(unit.serial for unit in self.units)

    @property
    def by_hand(self) -> bool:
        """Whether the run is on a manual rig."""
        return self.run_summary is not None and self.run_summary.by_hand

    @property
    def table_stopped(self) -> bool:
        """Whether a driven table, which has been commanded, is at rest with its axes off after a stop or a fault."""
        return self.table.stopped and self.commanded and not (self.by_hand or self.stop_incomplete)

    @property
    def joint_order(self) -> str:
        """Order of the joints of a gimbal, letters from base to body; "" for a table."""
        return "" if self.run_summary is None else self.run_summary.joint_order

    @property
    def slots(self) -> tuple[str, ...]:
        """Names of all slots of the table in order, including empty slots; () at a station for a single unit."""
        return self.run_summary.slots if self.in_slots and self.run_summary is not None else ()

    @property
    def in_slots(self) -> bool:
        """Whether the run is at a station with several slots."""
        return bool(self.unit.slot)

    @property
    def finalized(self) -> bool:
        """Whether the run of every unit has ended."""
        return all(unit.finalized is not None for unit in self.units)

    @property
    def display_state(self) -> str:
        """`state`, ``writing`` registers, ``monitoring``, ``in_use`` by another program, or ``not_ready`` for a run."""
        if self.state == "idle":
            causes = {"in_use": self.other_program, "monitoring": self.monitoring, "not_ready": self.problem}
            return next((name for name, cause in causes.items() if cause is not None), self.state)
        return "writing" if self.register_operation and self.state == "running" else self.state

    def display_state_of(self, unit: UnitStatus) -> str:
        """Return the verdict on a unit, or the state of the run while the unit takes part in it."""
        return unit.verdict if unit.verdict and unit.slot else self.display_state

    def final_state_of(self, unit: UnitStatus) -> str:
        """Return the verdict on a unit after the run, or ``released`` for a failed unit that has been released."""
        state = self.display_state_of(unit)
        return "released" if state == "failed" and unit.result is not None and unit.result.released else state

    @property
    def partial(self) -> bool:
        """Whether the run omits stages of the product."""
        summary = self.run_summary
        return summary is not None and bool(summary.omitted) and not self.register_operation

    @property
    def ended(self) -> bool:
        """Whether a run has ended without a fault."""
        return self.state in _VERDICTS

    @property
    def stages(self) -> list[StageState]:
        """Stages of the first unit in progress or, after the run, of the displayed unit.

        Units that keep their registers come last, because they skip the remaining stages.
        """
        units = [unit for unit in self.units if unit.verdict is None]
        return min(units, key=lambda unit: unit.keeps_registers, default=self.unit).stages

    @property
    def stage(self) -> StageState | None:
        """The current stage."""
        return next((s for s in self.stages if s.state in ("active", "solving")), None)

    @property
    def done(self) -> float:
        """Completed part of the planned device time, s."""
        by_unit = [self.stages] if self.in_progress else [unit.stages for unit in self.units]
        return max(sum(s.duration - self.stage_remaining(s) for s in stages) for stages in by_unit)

    @property
    def elapsed(self) -> float:
        """Device time of the stages so far, s, with all rounds of open-ended stages."""
        return self.done + sum(stage.earlier for stage in self.stages)

    @property
    def fraction(self) -> float:
        """Completed fraction of the planned time, 0 to 1."""
        total = sum(s.duration for s in self.stages)
        return self.done / total if total > 0.0 else 0.0

    @property
    def pace(self) -> float | None:
        """Ratio of device time to host time, which is 1 on hardware; None while it is unknown."""
        if self.run_summary is not None and not self.run_summary.virtual:
            return 1.0
        paused = self._paused + (time.monotonic() - self._paused_at if self._paused_at else 0.0)
        elapsed, done = time.monotonic() - self._started_at - paused, self.elapsed - self._done_before
        return done / elapsed if self._started_at and elapsed > _MIN_ELAPSED and done > 0.0 else None

    @property
    def remaining(self) -> float | None:
        """Remaining host time, s; None while it cannot be estimated."""
        pace = self.pace
        if pace is None or not self.in_progress or self.state == "stopping":
            return None
        return sum(self.stage_remaining(s) for s in self.stages) / pace

    def stage_remaining(self, stage: StageState) -> float:
        """Return the remaining device time of a stage, s."""
        if stage.state == "waiting":
            return stage.duration
        return stage.remaining if stage.state in ("active", "stopped", "fault") else 0.0

    def select_unit(self, unit: UnitStatus) -> None:
        """Display another unit in detail."""
        if unit is not self.unit:
            self.unit = unit
            self.unit_changed.emit()
            self.changed.emit()

    def set_problem(self, problem: Text | None) -> None:
        """Set why the station and the product are not usable for the next run, or None if they are."""
        self._set("problem", problem)

    def set_missing(self, missing: str, *, asking: bool) -> None:
        """Set what an operator must do before the next run ("" for nothing), and whether a question is open."""
        self._set("asking", asking)
        self._set("missing", missing)

    def set_elsewhere(self, elsewhere: tuple[tuple[str, ...], str] | None) -> None:
        """Set the serial numbers and the state of the run in the first window of the station."""
        self._set("elsewhere", elsewhere)

    def set_program(self, program: Text | None) -> None:
        """Set the text about another program that uses the devices of the station, or None."""
        self._set("program", program)

    def set_monitoring(self, monitoring: tuple[str, Text] | None) -> None:
        """Set the symbol and the text of the state of the IMUs that are monitored live; None without monitoring."""
        self._set("monitoring", monitoring)

    def stop(self) -> None:
        """Stop a run in progress safely; the state is ``stopping`` even before the engine confirms the stop."""
        self._link.send(Command.STOP)
        self.stop_pressed.emit()
        if self.in_progress and self.state != "stopping":
            self.state = "stopping"
            self.changed.emit()

    def pause_or_resume(self) -> None:
        """Pause a run after its current step, or resume it."""
        self.pause_requested = self.state not in ("pausing", "paused")
        self._link.send(Command.PAUSE if self.pause_requested else Command.RESUME)
        self.changed.emit()

    def end_stage(self) -> None:
        """End the current stage after its current move; the run then solves it and continues."""
        if self.stage is not None:
            self.stage_ending = self.stage.name
            self._link.send(Command.END_STAGE)
            self.changed.emit()

    @property
    def failing(self) -> bool:
        """Whether every unit in progress will fail."""
        units = [unit for unit in self.units if unit.verdict is None] if self.in_progress else []
        return bool(units) and all(unit.failing for unit in units)

    def end_failing(self) -> None:
        """End the run after the current step if all units will fail; they are judged by their solved stages."""
        self._link.send(Command.END_FAILING)

    def acknowledge(self) -> None:
        """Clear the fault and disconnect from the engine, so that a run can start.

        An engine that brings the chamber to ambient remains connected, because the chamber must stay closed until then.
        If units had a verdict or their own fault before a fault of the table, the verdict of the run is set.
        """
        state = "idle"
        if self.fault is not None:
            if self.chamber.access != "closed" or self.fault.code == _SILENT:
                self._link.stop_listening()
            self.fault = None
            if self.in_slots and not all(unit.unfinished for unit in self.units):
                state = self._verdict
        self.state = state
        self.changed.emit()

    def set_stop_incomplete(self, incomplete: bool) -> None:
        """Set whether the table may still be moving after a safe stop; resetting the fault clears this."""
        if incomplete != self.stop_incomplete:
            self.stop_incomplete = incomplete
            self.stop_incomplete_changed.emit(incomplete)
            self.changed.emit()

    def set_unreset(self, fault: Fault | None) -> None:
        """Set the latched fault of the table that remains to be reset, or None."""
        self._set("unreset", fault)

    def set_chamber_left(self, left: bool | None) -> None:
        """Set whether an earlier run left the chamber at an unknown temperature; None if this is not known yet."""
        self.chamber.set_left(left)
        self.changed.emit()

    def set_reading_runs(self, reading: bool) -> None:
        """Set whether the search for interrupted runs after startup is in progress."""
        self._set("reading_runs", reading)

    def _set(self, name: str, value: object) -> None:
        """Set an attribute, and emit `changed` if its value is new."""
        if value != getattr(self, name):
            setattr(self, name, value)
            self.changed.emit()

    def acknowledge_chamber(self) -> None:
        """Remove the notice about the chamber after a run."""
        self.chamber.acknowledge()
        self.changed.emit()
        self.chamber_acknowledged.emit()

    @property
    def why_busy(self) -> str:
        """Code of the reason why no run can start while the engine is running."""
        if self.chamber.must_stay_closed and not self.in_progress:
            return "window.busy_chamber"
        if self.ended:
            return "window.busy_closing"
        return "window.busy_registers" if self.register_operation else "window.busy_run"

    @property
    def other_program(self) -> Text | None:
        """`program`, or None if this program is the first window of the station, which `elsewhere` describes."""
        return self.program if self.elsewhere is None else None

    @property
    def occupied(self) -> Text | None:
        """Text about another window or program on this computer that uses the station, so that no run can start."""
        return self.other_program if self.elsewhere is None else Text("question.other_window")

    @property
    def why_not_start(self) -> str | Text:
        """Reason why neither a run nor a write of registers may start, or ""."""
        if self._link.running:
            return self.why_busy
        if self.occupied is not None:
            return self.occupied
        reasons = {
            "operator.fault_open": self.fault is not None,
            "operator.table_unconfirmed": self.stop_incomplete,
            "operator.chamber_unchecked": self.chamber.unchecked,
            "operator.chamber_unconfirmed": self.chamber.must_stay_closed,
            "operator.reading_runs": self.reading_runs,
        }
        return next((code for code, holds in reasons.items() if holds), "")

    def why_no_run(self, *, engineer: bool) -> str:
        """Return what to do before a run can start, worded for an engineer or an operator; "" if it can start."""
        if self.problem is not None:
            return rendered(self.problem, engineer=engineer).remedy
        return say(self.why_not_start)

    @property
    def _verdict(self) -> Verdict:
        """Verdict of the run after all units have one; a unit with a fault has failed."""
        verdicts = {Verdict.FAILED if unit.verdict is Verdict.FAULT else unit.verdict for unit in self.units}
        return next(verdict for verdict in _VERDICTS if verdict in verdicts)

    def _running_changed(self, running: bool) -> None:
        request = self._link.request
        if running and request is not None:
            self.state, self.commanded = "starting", False
            self.register_operation = self._link.operation is not None
            self.fault = self.unreset = self.latest = self._soaks_from = None
            self.resumable = request.resume is not None
            self.chamber, self.table = ChamberStatus(), TableStatus()
            self.registers = self.stage_ending = ""
            self.unloading = self.pause_requested = False
            self._started_at = self._done_before = 0.0
            try:
                self.run_summary = run_summary(request)
            except CalstationError:  # the engine reports the same error as a fault
                self.run_summary = None
            self.units = units_of(request, self.run_summary, register_operation=self.register_operation)
            self.select_unit(self.units[0])
        else:
            self.chamber.end()
        if not running and self.in_progress:
            self.state = "idle" if self.register_operation else "incomplete"
        self.changed.emit()

    def _handle_event(self, event: Event) -> None:
        if self.fault is not None and self.fault.code == _SILENT and not isinstance(event, Fault):
            self.fault, self.state = None, self._before_fault  # the engine responds again
            for unit in self.units:
                unit.recover()
            self.chamber.resume()
            self._changed_timer.start()
        self.chamber.handle_event(event)
        self.table.handle_event(event)
        self.resumable = resumable_after(event, self.resumable)
        if isinstance(event, Message) and event.id == "safe_stop_incomplete" and event.values.get("table"):
            self.set_stop_incomplete(True)
        if isinstance(event, ChamberChanged):
            self._show_soak_to_verify(event)
            if self.chamber.must_stay_closed:
                self._changed_timer.start()
        if not isinstance(event, _STATUS_EVENTS):
            return
        if isinstance(event, StageStarted) and not self._started_at:
            # the pace does not include stages completed before a resume
            self._started_at, self._done_before = time.monotonic(), self.done
            self._paused = self._paused_at = 0.0
        if not isinstance(event, StateChanged) or self._change_state(event.state):
            for unit in self.units:
                if unit.slot == event.slot if event.slot else unit.verdict is None:
                    unit.handle_event(event)
        self.unloading = self.unloading or (isinstance(event, Message) and event.id == "finishing")
        if isinstance(event, StageStarted | Message):
            self.registers = _REGISTERS.get(event.id, self.registers) if isinstance(event, Message) else ""
        match event:
            case StepStarted():
                after_move = event.kind == "dwell" and self.latest is not None and self.latest[0] == "step"
                self.latest = ("step", event.kind, self.latest[2] if after_move and self.latest else event.label)
            case StageEnded() if event.reason != END_FAILING:
                self.latest = ("solving", event.stage, None)
            case Message() if not event.slot or event.id == _UNIT_LEFT:
                self.latest = ("message", event.id, event.values)
            case Settled():
                self.state = "idle"
            case Fault() if not event.slot:
                if self.fault is None:
                    self._before_fault = self.state
                self.fault, self.state = event, "fault"
            case Finalized() if self.finalized and self.fault is None and self.state != "idle":
                self.state = self._verdict
        self._changed_timer.start()

    def _show_soak_to_verify(self, event: ChamberChanged) -> None:
        """Show the progress of the soak before the verification of registers; the soak belongs to no stage."""
        if self.latest is None or self.latest[:2] != ("step", "soak_to_verify"):
            self._soaks_from = None
            return
        self._soaks_from = event.time if self._soaks_from is None else self._soaks_from
        for unit in self.units:
            unit.soak_to_verify(event.time - self._soaks_from, event.remaining)
        self._changed_timer.start()

    def _change_state(self, state: str) -> bool:
        """Adopt a state of the sequencer, and return whether the units must also adopt it."""
        self.commanded = self.commanded or state not in _ENDED
        if self.state == "stopping" and state not in _ENDED:
            return False  # the event was sent before STOP was pressed
        if state in _ENDED and self.register_operation:
            return False  # the result of the operation follows
        if state == "done" or (state == "stopped" and self.in_slots):
            return False  # the verdicts follow
        self.state, self.pause_requested = state, False
        self._measure_pause()
        return True

    def _measure_pause(self) -> None:
        """Measure the host time of pauses, which `pace` excludes."""
        now, paused = time.monotonic(), self.state in ("pausing", "paused")
        if paused and not self._paused_at:
            self._paused_at = now
        elif not paused and self._paused_at:
            self._paused, self._paused_at = self._paused + now - self._paused_at, 0.0
