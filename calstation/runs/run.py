"""Executes one run: prepares it, opens the devices, drives and solves the stages, finalizes it, writes its result."""

import logging
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

from calstation import applog
from calstation.config import ResolvedConfiguration, RunRequest, check_seen_latitude
from calstation.connection import Devices, connected
from calstation.devices import Imu
from calstation.devices.imu import flash_registers
from calstation.errors import CalstationError, DeviceFaultError
from calstation.estimation import Solution
from calstation.registers import recover_interrupted
from calstation.results import HandOver, one_blas_thread
from calstation.runs.finalize import Finalization
from calstation.runs.hooks import RunHooks
from calstation.runs.prepare import OpenRun, PreparedRun, prepare
from calstation.runs.verdict import close_run
from calstation.sequencer import (
    Control,
    Emit,
    Ended,
    Fault,
    LastSample,
    Message,
    RunContext,
    Sequencer,
    Slot,
    State,
    StopRequested,
    solution_events,
)

logger = logging.getLogger(__name__)


def execute(request: RunRequest, emit: Emit, control: Control, hooks: type[RunHooks] = RunHooks) -> None:
    """Execute a run to its end and emit the verdict of every unit; a result JSON is written next to each log.

    Raises ConfigurationError or InputError, before any device is opened, if the run is not possible as requested.
    """
    units = prepare(request, emit, control, hooks())
    first = units[0]
    hand_over = HandOver(first.folder, first.setup.sources["station"].path, first.setup.station, first.listener)
    hand_over.start()
    try:
        with one_blas_thread():
            _run(units)
    finally:
        hand_over.finish()


def _run(units: tuple[PreparedRun, ...]) -> None:
    """Open the devices and run; without devices or after an early stop, the logs have results but no samples."""
    runs: list[OpenRun] = []
    first = units[0]
    try:
        with (
            connected(tuple(unit.setup for unit in units), first.control.check_cancelled) as devices,
            first.cycle.on(devices.clock),
        ):
            first.hooks.connected(devices)
            for number, unit in enumerate(units):
                runs.append(_open(unit, devices, number, alone=len(units) == 1))
            with applog.run(_name(runs)):
                _sequence(runs, devices)
    except (DeviceFaultError, StopRequested) as error:
        if runs:
            raise
        runs = [unit.open(None) for unit in units]
        with applog.run(_name(runs)):
            for run in runs:
                close_run(run, _ended(run, error))


def _name(runs: Sequence[OpenRun]) -> str:
    """Return the name of the run in the application log: that of its log, or of its batch."""
    return runs[0].setup.request.batch or runs[0].log.path.stem


def _open(unit: PreparedRun, devices: Devices, number: int, *, alone: bool) -> OpenRun:
    """Recover an interrupted transfer to the unit, read its registers and open its log.

    A unit that is not `alone` and has a fault leaves the batch. Raises DeviceFaultError, ConfigurationError,
    StopRequested.
    """
    try:
        if number in devices.failed:
            raise devices.failed[number]
        imu, cancelled = devices.imus[number], unit.control.check_cancelled
        own = replace(devices, imus=(imu,), failed={})
        unverified = recover_interrupted(own, unit.setup, unit.folder, unit.emit, cancelled)
        return unit.open(_registers(imu, unit.setup), unverified)
    except DeviceFaultError as error:
        if alone:
            raise
        run = unit.open(None)
        close_run(run, _ended(run, error))
        return run


def _registers(imu: Imu, setup: ResolvedConfiguration) -> dict[str, float]:
    """Return the unit's registers by parameter, SI.

    A unit that applies them to its samples is restarted first: otherwise a restart during the run would discard
    uncommitted values, and later samples would be corrected by other registers. So is a unit on a gimbal, which may
    still hold the correction of a run that was killed.
    """
    uncommitted = setup.after_registers or setup.table.gimbal is not None
    if uncommitted and imu.identify().serial == setup.request.serial:
        return flash_registers(imu)
    return imu.read_registers()


def _sequence(runs: Sequence[OpenRun], devices: Devices) -> None:
    """Drive and solve the remaining stages, and close the runs, even after a programming error."""
    try:
        _drive([(run, imu) for run, imu in zip(runs, devices.imus, strict=True) if not run.closed], devices)
    except Exception as mistake:
        logger.exception("the run ended by a mistake of the program")
        error = CalstationError("program.internal", detail=f"{type(mistake).__name__}: {mistake}")
        for run in runs:
            if not run.closed:
                with suppress(OSError, RuntimeError, CalstationError):  # the log itself may have failed
                    close_run(run, Ended(State.FAULT, tuple(run.chain.solutions), error))
        raise


def _drive(units: Sequence[tuple[OpenRun, Imu]], devices: Devices) -> None:
    slots = []
    for run, imu in units:
        try:
            after = _resume(run)
        except (StopRequested, CalstationError) as error:
            close_run(run, _ended(run, error))
            continue
        solved = tuple(run.chain.solutions)
        if solved:
            imu.read()  # discards samples received while they were solved
        unit = run.setup.unit_task(run.meta)
        slots.append(Slot(imu, unit, run.log, run.chain, after, run.prepared.slot, Finalization(run, imu), solved))
    if not slots:
        return
    first = units[0][0].prepared
    task = first.setup.task()
    stages = task.stages[len(slots[0].solved) :]
    context = RunContext(
        replace(task, stages=stages), devices.table, tuple(slots), devices.clock, first.listener, first.control
    )
    Sequencer(context).run()


def _resume(run: OpenRun) -> LastSample | None:
    """Copy the finished stages of a resumed run; return their last sample, or None for a new run.

    Raises StopRequested, InputError, ConfigurationError.
    """
    before = run.prepared.continuation
    if before is None:
        return None
    run.emit(Message("resumed", {"log": before.log.path.name, "stages": list(before.finished)}))

    def on_solved(solution: Solution) -> None:
        for event in solution_events(solution):
            run.emit(event)
        run.log.sync()

    after = before.copy(run.log, run.chain, run.prepared.control.check_cancelled, on_solved)
    check_seen_latitude(run.meta, tuple(run.chain.solutions))
    return after


def _ended(run: OpenRun, error: CalstationError | StopRequested) -> Ended:
    solutions = tuple(run.chain.solutions)
    if isinstance(error, StopRequested):
        return Ended(State.STOPPED, solutions)
    logger.error("fault %s: %s", error.code, error)
    run.emit(Fault.of(error))
    return Ended(State.FAULT, solutions, error)
