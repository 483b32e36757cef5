"""Executes one run: prepares it, opens the devices, drives and solves the stages, finalizes it, writes its result."""

import logging
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
    """Execute a run to its end and emit the verdict; a result JSON is written next to the log for every outcome.

    Raises ConfigurationError or InputError, before any device is opened, if the run is not possible as requested.
    """
    prepared = prepare(request, emit, control, hooks())
    setup = prepared.setup
    hand_over = HandOver(prepared.folder, setup.sources["station"].path, setup.station, prepared.emit)
    hand_over.start()
    try:
        with one_blas_thread():
            _run(prepared)
    finally:
        hand_over.finish()


def _run(prepared: PreparedRun) -> None:
    """Open the devices and run; without devices or after an early stop, the log has a result but no samples."""
    run: OpenRun | None = None
    setup, check_cancelled = prepared.setup, prepared.control.check_cancelled
    try:
        with connected((setup,), check_cancelled) as devices, prepared.cycle.on(devices.clock):
            prepared.hooks.connected(devices)
            unverified = recover_interrupted(devices, setup, prepared.folder, prepared.emit, check_cancelled)
            run = prepared.open(_registers(devices.imu, setup), unverified)
            with applog.run(run.log.path.stem):
                _sequence(run, devices)
    except (DeviceFaultError, StopRequested) as error:
        if run is not None:
            raise
        run = prepared.open(None)
        with applog.run(run.log.path.stem):
            close_run(run, _ended(run, error))


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


def _sequence(run: OpenRun, devices: Devices) -> None:
    """Drive and solve the remaining stages, and close the run, even after a programming error."""
    evaluation = Finalization(run, devices.imu)
    try:
        _drive(run, devices, evaluation)
    except Exception as mistake:
        if evaluation.closed:  # the result itself could not be written
            raise
        logger.exception("the run ended by a mistake of the program")
        error = CalstationError("program.internal", detail=f"{type(mistake).__name__}: {mistake}")
        with suppress(OSError, RuntimeError, CalstationError):  # the log itself may have failed
            close_run(run, Ended(State.FAULT, tuple(run.chain.solutions), error))
        raise


def _drive(run: OpenRun, devices: Devices, evaluation: Finalization) -> None:
    try:
        after = _resume(run)
        solved = tuple(run.chain.solutions)
        if solved:
            devices.imu.read()  # discards samples received while they were solved
        task, unit = run.setup.task(), run.setup.unit_task(run.meta)
        slot = Slot(devices.imu, unit, run.log, run.chain, after, evaluation=evaluation, solved=solved)
        context = RunContext(
            replace(task, stages=task.stages[len(solved) :]),
            devices.table,
            (slot,),
            devices.clock,
            run.prepared.emit,
            run.prepared.control,
        )
        sequencer = Sequencer(context)
    except (StopRequested, CalstationError) as error:
        evaluation.ended(_ended(run, error))
        return
    sequencer.run()


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
