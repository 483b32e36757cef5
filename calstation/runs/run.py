"""Execution of a run: preparation, opening of the devices, stages, finalization and result."""

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace

from calstation import applog
from calstation.config import RunConfiguration, RunRequest
from calstation.connection import Devices, PortLockError, open_devices
from calstation.devices import Imu
from calstation.devices.imu import restart_and_read_registers
from calstation.errors import CalstationError, DeviceFaultError
from calstation.estimation import Solution
from calstation.judgement import require_latitude
from calstation.registers import recover_interrupted
from calstation.results import HandOver, one_blas_thread
from calstation.runs.closing import close_run, start_reports
from calstation.runs.finalize import Finalization
from calstation.runs.hooks import RunHooks
from calstation.runs.preparation import OpenRun, PreparedRun, prepare
from calstation.sequencer import (
    Control,
    Emit,
    Fault,
    LastSample,
    Message,
    RunContext,
    RunEnd,
    Sequencer,
    Slot,
    State,
    StopRequested,
    chamber_limits,
    solution_events,
    table_task,
    unit_task,
)

logger = logging.getLogger(__name__)


def execute(request: RunRequest, emit: Emit, control: Control, hooks: type[RunHooks] | None = None) -> None:
    """Execute a run, write a result JSON next to each log, and emit the verdict on every unit.

    Raises ConfigurationError or InputError if the run is not possible as requested, and PortLockError if another
    program uses a port; then no device has been opened, and the run has no log and does not count as an attempt.

    Parameters
    ----------
    request : run to execute
    emit : called with every event
    control : commands to the run
    hooks : replaces the hooks of the station, see `station_hooks`
    """
    units = prepare(request, emit, control, hooks)
    first = units[0]
    hand_over = HandOver(first.folder, first.setup.sources["station"].path, first.setup.station, first.listener)
    hand_over.start()
    try:
        with one_blas_thread():
            _run(units)
    finally:
        hand_over.finish()


def _run(units: tuple[PreparedRun, ...]) -> None:
    """Open the devices and execute the run; if this fails before the logs are opened, they contain only results."""
    runs: list[OpenRun] = []
    first = units[0]
    try:
        with (
            open_devices(tuple(unit.setup for unit in units), first.control.check_cancelled) as devices,
            first.cycle.using(devices.clock),
        ):
            first.hooks.connected(devices)
            with _closing_on_error(runs):
                evaluations = _open(units, devices, runs)
            with applog.run(_name(runs)), _closing_on_error(runs):
                _drive(evaluations, devices)
    except PortLockError:
        raise
    except (DeviceFaultError, StopRequested) as error:
        unopened = units[len(runs) :]
        if not unopened:
            raise
        with _closing_on_error(runs):
            for unit in unopened:
                runs.append(unit.open(None))
            with applog.run(_name(runs)):
                for run in runs:
                    if not run.closed:
                        close_run(run, _ended_by(run, error))
    finally:
        start_reports(run.report for run in runs if run.setup.request.batch)


def _name(runs: Sequence[OpenRun]) -> str:
    """Return the name of the run in the application log, which is the name of its batch or of its log."""
    return runs[0].setup.request.batch or runs[0].log.path.stem


@contextmanager
def _closing_on_error(runs: Sequence[OpenRun]) -> Iterator[None]:
    """Close the open runs with a fault if the context ends with an exception, including programming errors."""
    try:
        yield
    except StopRequested:
        raise
    except Exception as mistake:
        open_runs = [run for run in runs if not run.closed]
        if not open_runs:  # the result could not be written
            raise
        if isinstance(mistake, CalstationError):
            error = mistake
        else:
            logger.exception("the run ended with a programming error")
            error = CalstationError("program.internal", detail=f"{type(mistake).__name__}: {mistake}")
        for run in open_runs:
            with suppress(OSError, RuntimeError, CalstationError):  # the log may be the cause of the error
                close_run(run, RunEnd(State.FAULT, tuple(run.chain.solutions), error))
        raise


def _open(units: Sequence[PreparedRun], devices: Devices, runs: list[OpenRun]) -> list[Finalization]:
    """Recover interrupted transfers, read the registers of the units, and append the opened runs to `runs`.

    Returns the evaluations of the units that can continue; units with an error have left the batch. Raises
    StopRequested, ConfigurationError if a log cannot be created, and any CalstationError of the only unit.
    """
    evaluations = []
    for index, (unit, imu) in enumerate(zip(units, devices.imus, strict=True)):
        check_cancelled = unit.control.check_cancelled
        try:
            if runs:
                check_cancelled()
            if imu is None:
                raise devices.failed[index]
            unit_devices = replace(devices, imus=(imu,))
            unverified = recover_interrupted(unit_devices, unit.setup, unit.folder, unit.emit, check_cancelled)
            run = unit.open(_registers(imu, unit.setup), unverified)
        except CalstationError as error:
            if len(units) == 1:
                raise
            run = unit.open(None)
            runs.append(run)
            run.emit(Message("unit_left", {"serial": run.serial, "reason": error.as_text}))
            close_run(run, _ended_by(run, error))
        else:
            runs.append(run)
            evaluations.append(Finalization(run, imu))
    return evaluations


def _registers(imu: Imu, setup: RunConfiguration) -> dict[str, float]:
    """Return the unit's registers by parameter, SI.

    A unit that applies them to its samples is restarted first. Otherwise a restart during the run would discard
    uncommitted values, so that later samples would be corrected by other registers. A unit on a gimbal is also
    restarted, because it may still contain the correction of a killed run.
    """
    uncommitted = setup.after_registers or setup.table.gimbal is not None
    if uncommitted and imu.identify().serial == setup.request.serial:
        return restart_and_read_registers(imu)
    return imu.read_registers()


def _drive(evaluations: Sequence[Finalization], devices: Devices) -> None:
    slots = _slots(evaluations)
    if not slots:
        return
    prepared = evaluations[0].run.prepared
    task = table_task(prepared.setup)
    stages = task.stages[len(slots[0].solved) :]
    if prepared.continuation is not None and stages:
        stages = (stages[0].after(prepared.continuation.completed.points), *stages[1:])
    is_over_temperature = "temperature" in prepared.setup.stages
    limits = chamber_limits(*(evaluation.run.setup for evaluation in evaluations)) if is_over_temperature else None
    task = replace(task, stages=stages, chamber=limits)
    context = RunContext(task, devices.table, tuple(slots), devices.clock, prepared.listener, prepared.control)
    Sequencer(replace(context, chamber=devices.chamber)).run()


def _slots(evaluations: Sequence[Finalization]) -> list[Slot]:
    """Copy the completed parts of resumed runs; return the units that can continue, and close the other runs."""
    pending, slots = list(evaluations), list[Slot]()
    try:
        for evaluation in evaluations:
            run = evaluation.run
            try:
                last_sample = _resume(run)
            except CalstationError as error:  # this is an error of the unit
                if len(evaluations) > 1:
                    run.emit(Message("unit_left", {"serial": run.serial, "reason": error.as_text}))
                pending.remove(evaluation)
                evaluation.ended(_ended_by(run, error))
                continue
            unit, solved = unit_task(run.setup, run.meta), tuple(run.chain.solutions)
            slots.append(
                Slot(evaluation.imu, unit, run.log, run.chain, last_sample, run.prepared.slot, evaluation, solved)
            )
    except StopRequested as stop:
        for evaluation in pending:
            evaluation.ended(_ended_by(evaluation.run, stop))
        return []
    if any(slot.after is not None for slot in slots):
        for slot in slots:  # discard samples received while the stages were solved
            with suppress(DeviceFaultError):  # the sequencer reads it again, and reports the error
                slot.imu.read()
    return slots


def _resume(run: OpenRun) -> LastSample | None:
    """Copy the completed parts of a resumed run; return the last sample copied, or None for a new run.

    Raises StopRequested, InputError, ConfigurationError.
    """
    continuation = run.prepared.continuation
    if continuation is None:
        return None
    name, points = continuation.log.path.name, continuation.points
    if continuation.finished:
        run.emit(Message("resumed", {"log": name, "stages": list(continuation.finished)}))
    if points:
        run.emit(Message("resumed_point", {"log": name, "count": len(points)}))

    stage_ends = {e["stage"]: e for e in continuation.log.events if e.get("event") == "StageEnded"}

    def on_solved(solution: Solution) -> None:
        if solution.stage in stage_ends:
            run.record(stage_ends[solution.stage])
        for event in solution_events(solution):
            run.emit(event)
        run.log.sync()

    last_sample = continuation.copy(run.log, run.chain, run.prepared.control.check_cancelled, on_solved)
    require_latitude(run.meta, tuple(run.chain.solutions))
    for point in points:
        run.emit(point)
    return last_sample


def _ended_by(run: OpenRun, error: CalstationError | StopRequested) -> RunEnd:
    solutions = tuple(run.chain.solutions)
    if isinstance(error, StopRequested):
        return RunEnd(State.STOPPED, solutions)
    logger.error("fault %s: %s", error.code, error)
    run.emit(Fault.of(error))
    return RunEnd(State.FAULT, solutions, error)
