"""One run from request to verdict: log, sequencer, limits, registers, result."""

import re
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from calstation.config.request import RunRequest, computer_user
from calstation.config.resolved import ResolvedConfiguration, prepare_run
from calstation.config.site_check import check_seen_latitude, there
from calstation.config.station import load_station
from calstation.connection.devices import Devices, connected
from calstation.devices.imu.transfer import flash_registers
from calstation.devices.interfaces import Imu
from calstation.errors import CalstationError, ConfigurationError, DeviceFaultError
from calstation.estimation.method import Solution
from calstation.physics.parameters import INDEX
from calstation.records.meta import LogMeta
from calstation.records.raw_log import RESERVE, RawLogWriter, free_space
from calstation.registers.interrupted import UnverifiedTransfer, check_interrupted, recover_interrupted
from calstation.registers.preconditions import check_flash
from calstation.results.handover import HandOver, register_pending
from calstation.results.history import History
from calstation.results.judge import Ending, build_result, judge
from calstation.results.result import write_json
from calstation.results.solver_chain import StageChain, one_blas_thread
from calstation.runs.advice import advice, check_attempts
from calstation.runs.finalize import Finalization
from calstation.runs.hooks import RunHooks
from calstation.runs.incomplete import finish_incomplete
from calstation.runs.resume import Continuation
from calstation.sequencer.acquisition import LastSample
from calstation.sequencer.control import Control, StopRequested
from calstation.sequencer.events import Event, Fault, Message, Verdict, to_json
from calstation.sequencer.ports import Emit
from calstation.sequencer.sequencer import Sequencer
from calstation.sequencer.solved import told
from calstation.sequencer.states import State
from calstation.sequencer.task import Ended

_OUTCOMES = {
    State.PASSED: "passed",
    State.FAILED: "failed",
    State.STOPPED: "stopped",
    State.FAULT: "fault",
}


@dataclass(frozen=True)
class _Place:
    """What a run knows before its devices: configuration, folder, history, who listens, what it carries on."""

    setup: ResolvedConfiguration
    folder: Path
    history: History
    emit: Emit
    control: Control
    before: Continuation | None
    started: datetime
    hooks: RunHooks

    def meta(self, registers: dict[str, float] | None) -> LogMeta:
        """The log's configuration. `registers` : of the unit, None where it could not be asked."""
        if self.before is not None:
            return self.before.meta(self.setup, self.started, registers)
        serial = self.setup.request.serial
        meta = self.setup.log_meta(self.started, 1 + self.history.attempts(serial), registers)
        checks = self.setup.product.checks
        if checks is None or checks.previous is None:
            return meta
        known = {name: value for name, value in self.history.previous(serial).items() if name in INDEX}
        return meta.model_copy(update={"previous": known})

    def check_cancelled(self) -> None:
        """Take the operator's commands where no tick does. Raises StopRequested."""
        self.control.take()
        if self.control.stopping:
            raise StopRequested

    def log(self, meta: LogMeta) -> RawLogWriter:
        """The run's log; from now on its result is expected by the hand-over."""
        stem = re.sub(r"[^A-Za-z0-9.-]", "-", self.setup.request.serial)
        log = RawLogWriter(self.folder / f"{stem}_{self.started:%Y%m%dT%H%M%S%f}.h5", meta)
        with suppress(OSError):  # then the result itself has no room either, which is told
            register_pending(self.folder, log.path.stem)
        self.hooks.log_opened(log)
        return log


@dataclass
class _Run:
    """What a run gathers on its way."""

    place: _Place
    meta: LogMeta
    log: RawLogWriter
    chain: StageChain
    unproved: UnverifiedTransfer | None = None
    registers: dict[str, Any] = field(default_factory=dict)

    def verify(self, solution: Solution) -> bool:
        """Go on after a stage? Not where the product ends early and a limit is missed.

        Raises ConfigurationError where the station cannot be where its file says.
        """
        check_seen_latitude(self.meta, tuple(self.chain.solutions))
        if not self.place.setup.product.end_on_failure:
            return True
        if judge(self.meta, self.chain.prior, tuple(self.chain.solutions)).passed:
            return True
        self.tell(Message("stopped_early", {"stage": solution.stage}))
        return False

    def tell(self, event: Event) -> None:
        """To the listener and the log."""
        self.log.event(to_json(event))
        self.place.emit(event)

    def carry_on(self) -> LastSample | None:
        """Begin with what was finished before; None for a fresh run. Raises StopRequested, InputError and
        ConfigurationError as `verify`."""
        before = self.place.before
        if before is None:
            return None
        self.tell(Message("resumed", {"log": before.log.path.name, "stages": list(before.finished)}))

        def tell(solution: Solution) -> None:
            for event in told(solution):
                self.tell(event)
            self.log.sync()

        after = before.copy(self.log, self.chain, self.place.check_cancelled, tell)
        check_seen_latitude(self.meta, tuple(self.chain.solutions))
        return after


def execute(request: RunRequest, emit: Emit, control: Control, hooks: type[RunHooks] = RunHooks) -> None:
    """Run to the end and emit the verdict; a result JSON stands beside the log for every outcome.

    `hooks` : what accompanies the run

    Raises ConfigurationError or InputError before anything is opened where the request cannot be run.
    """
    before = None
    if request.resume is not None:
        before = Continuation.of(request, request.resume)
        request = before.request
    request = replace(request, operator=request.operator or computer_user())
    accompanying = hooks()
    setup = prepare_run(request, accompanying.adjust)
    folder = _folder(request.out)
    for dead in finish_incomplete(folder):
        emit(Message("incomplete_run", {"log": str(dead)}))
    history = History(folder)
    history.refresh()
    failures = history.failures(request.serial)
    check_attempts(setup.product, request.serial, failures, request.beyond_attempts)
    check_flash(setup, folder, emit)
    check_interrupted(setup, folder)
    emit = accompanying.listener(setup, folder, emit)
    place = _Place(setup, folder, history, emit, control, before, datetime.now(UTC), accompanying)
    place.meta(None)
    hand_over = HandOver(folder, load_station(request.station)[0], setup.station, emit)
    hand_over.start()
    try:
        with one_blas_thread():
            _connect(place)
    finally:
        hand_over.finish()


def _connect(place: _Place) -> None:
    """Open the devices and run; one that finds none, or is stopped before, has an empty log and a result."""
    run: _Run | None = None
    try:
        with connected(place.setup, place.check_cancelled) as devices:
            place.hooks.connected(devices)
            unproved = recover_interrupted(
                devices.imu,
                devices.table,
                devices.clock,
                place.setup,
                place.folder,
                place.emit,
                place.check_cancelled,
            )
            meta = place.meta(_in_force(devices.imu, place.setup))
            run = _Run(place, meta, place.log(meta), StageChain(meta), unproved)
            _run(run, devices)
    except (DeviceFaultError, StopRequested) as error:
        if run is not None:
            raise
        meta = place.meta(None)
        run = _Run(place, meta, place.log(meta), StageChain(meta))
        if isinstance(error, StopRequested):
            _close(run, Ended(State.STOPPED, ()))
            return
        run.tell(Fault.of(error))
        _close(run, Ended(State.FAULT, (), error))


def _in_force(imu: Imu, setup: ResolvedConfiguration) -> dict[str, float]:
    """What the unit's registers hold, SI.

    Where its samples have gone through them it is restarted first: values that nobody committed would be gone after
    a restart in mid-run, and the samples behind it be of other registers.
    """
    if setup.after_registers and imu.identify().serial == setup.request.serial:
        return flash_registers(imu)
    return imu.read_registers()


def _run(run: _Run, devices: Devices) -> None:
    try:
        ended = _sequence(run, devices)
    except Exception as mistake:
        error = CalstationError(f"{type(mistake).__name__}: {mistake}")
        with suppress(OSError, RuntimeError, CalstationError):  # what failed may be the log itself
            ended = Ended(State.FAULT, tuple(run.chain.solutions), error)
            _close(run, ended)
        raise
    _close(run, ended)


def _sequence(run: _Run, devices: Devices) -> Ended:
    """Carry on what was begun before, then drive and solve what is left; say what was written and never proved."""
    ended = _drive(run, devices)
    if run.unproved is not None and run.unproved.open:
        run.tell(Message("transfer_unproved"))
    return ended


def _drive(run: _Run, devices: Devices) -> Ended:
    control = run.place.control
    try:
        after = run.carry_on()
    except StopRequested:
        return Ended(State.STOPPED, tuple(run.chain.solutions))
    except CalstationError as error:
        run.tell(Fault.of(error))
        return Ended(State.FAULT, tuple(run.chain.solutions), error)
    solved = tuple(run.chain.solutions)
    if solved:
        devices.imu.read()  # what came while they were solved belongs to nothing
    setup = run.place.setup
    task = setup.task(run.meta)
    finalization = Finalization(
        setup,
        run.meta,
        run.log,
        run.chain,
        devices.imu,
        run.tell,
        run.registers,
        run.place.check_cancelled,
        run.place.history.verified_registers(run.meta.imu.serial),
    )
    sequencer = Sequencer(
        replace(task, stages=task.stages[len(solved) :]),
        devices.table,
        devices.imu,
        devices.clock,
        run.log,
        run.chain,
        run.place.emit,
        verify=run.verify,
        finalize=finalization.finalize,
        prove=finalization.verify_output,
        prove_first=None if run.unproved is None else run.unproved.verify_output,
        control=control,
        solved=solved,
        after=after,
    )
    return sequencer.run()


def _close(run: _Run, ended: Ended) -> None:
    """Write the result into the log and beside it; emit the verdict."""
    place, log, serial = run.place, run.log, run.meta.imu.serial
    outcome = _OUTCOMES[ended.state]
    failures = place.history.failures(serial) + (outcome == "failed")
    judgement = judge(run.meta, run.chain.prior, ended.solutions)
    finished = bool(ended.solutions) and not run.registers.get("new") and there(judgement.checks)
    ending = Ending(
        outcome,
        str(log.path),
        log.facts(),
        registers=run.registers or None,
        error=ended.error,
        stop_reason=place.control.stop_reason if outcome == "stopped" else None,
        advice=advice(place.setup.product, outcome, failures, finished),
    )
    judgement = replace(judgement, passed=ended.state is State.PASSED)
    result = build_result(run.meta, run.chain.prior, ended.solutions, judgement, ending).to_json()
    log.add_result(result)
    log.close(outcome)
    beside = log.path.with_suffix(".json")
    with suppress(
        *(() if ended.error is None else (ConfigurationError,))
    ):  # the fault in hand says what to do
        write_json(beside, result)
    with suppress(OSError):  # the index only: the next run makes it up
        place.history.refresh()
    place.emit(Verdict(outcome, str(log.path), str(beside), result))


def _folder(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".calstation"
        probe.touch()
        probe.unlink()
        if free_space(probe) < RESERVE:
            raise OSError(f"less than {RESERVE // 1_000_000} MB are left on its disk")
    except OSError as exc:
        raise ConfigurationError(
            f"--out {folder}: cannot be written ({exc.strerror or exc}); make room, or choose another folder"
        ) from exc
    return folder
