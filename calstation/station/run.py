"""One run from request to verdict: log, sequencer, limits, registers, result."""

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from calstation.devices.registers import RegisterMap
from calstation.devices.transfer import transfer
from calstation.errors import CalstationError, ConfigurationError, DeviceFaultError
from calstation.estimation.method import Solution
from calstation.physics.parameters import NAMES
from calstation.records.limits import estimated_stage
from calstation.records.meta import LogMeta
from calstation.records.raw_log import RawLogWriter
from calstation.sequencer.control import Control
from calstation.sequencer.events import Event, Fault, Message, Verdict, to_json
from calstation.sequencer.ports import Emit
from calstation.sequencer.sequencer import Sequencer
from calstation.sequencer.states import State
from calstation.sequencer.task import Ended
from calstation.station.compose import compose
from calstation.station.incomplete import settle_incomplete
from calstation.station.request import RunRequest
from calstation.station.result import Ending, build_result, judge, write_json
from calstation.station.setup import Setup, prepare
from calstation.station.solve import StageChain, one_blas_thread
from calstation.station.wiring import Devices, connected

_OUTCOMES = {
    State.PASSED: "passed",
    State.FAILED: "failed",
    State.STOPPED: "stopped",
    State.FAULT: "fault",
}


@dataclass
class _Run:
    """What a run gathers on its way."""

    setup: Setup
    meta: LogMeta
    log: RawLogWriter
    chain: StageChain
    devices: Devices
    emit: Emit
    registers: dict[str, Any] = field(default_factory=dict)

    def verify(self, solution: Solution) -> bool:
        """Go on after a stage? Not where the product ends early and a limit is missed."""
        if not self.setup.product.end_on_failure:
            return True
        if judge(self.meta, self.chain.prior, tuple(self.chain.solutions)).passed:
            return True
        self.tell(Message("stopped_early", {"stage": solution.stage}))
        return False

    def conclude(self, solutions: tuple[Solution, ...]) -> bool:
        """Check the limits; write the registers of a unit inside them. Raises DeviceFaultError."""
        if not judge(self.meta, self.chain.prior, solutions).passed:
            self.tell(Message("registers_kept"))
            return False
        belief = solutions[-1].belief
        found = dict(zip(NAMES, belief.mean.tolist(), strict=True))
        if self.setup.after_registers:
            written = compose(self.meta.registers, found)
        else:
            written = {name: found[name] for name in estimated_stage(solutions)}
        done = transfer(self.devices.imu, RegisterMap(tuple(self.setup.imu.registers)), written, self._old)
        self.registers = {"old": done.old, "new": done.new, "verified": done.verified}
        self.tell(Message("registers_written", {"count": len(done.new)}))
        return True

    def _old(self, old: Mapping[str, float]) -> None:
        """The unit's registers as they were go to the log before anything is written."""
        self.registers = {"old": dict(old), "new": None, "verified": False}
        self.log.event({"event": "OldRegisters", "registers": dict(old)})
        self.log.flush()

    def tell(self, event: Event) -> None:
        """To the listener and the log."""
        self.log.event(to_json(event))
        self.emit(event)


def execute(request: RunRequest, emit: Emit, control: Control) -> None:
    """Run to the end and emit the verdict; a result JSON stands beside the log for every outcome.

    Raises ConfigurationError before anything is opened where the request cannot be run.
    """
    setup = prepare(request)
    folder = _folder(request.out)
    for dead in settle_incomplete(folder):
        emit(Message("incomplete_run", {"log": str(dead)}))
    started = datetime.now(UTC)
    attempt = 1 + len(list(folder.glob(f"{_stem(request.serial)}_*.h5")))
    path = folder / f"{_stem(request.serial)}_{started:%Y%m%dT%H%M%S%f}.h5"
    with one_blas_thread():
        try:
            with connected(setup) as devices:
                meta = setup.meta(started, attempt, devices.imu.read_registers())
                log = RawLogWriter(path, meta)
                run = _Run(setup, meta, log, StageChain(meta), devices, emit)
                _run(run, control)
        except DeviceFaultError as error:
            if path.exists():
                raise
            _not_connected(setup.meta(started, attempt, {}), path, emit, error)


def _run(run: _Run, control: Control) -> None:
    begin = run.devices.clock.now()
    sequencer = Sequencer(
        run.setup.task(run.meta),
        run.devices.table,
        run.devices.imu,
        run.devices.clock,
        run.log,
        run.chain,
        run.emit,
        verify=run.verify,
        conclude=run.conclude,
        control=control,
    )
    try:
        ended = sequencer.run()
    except Exception as mistake:
        error = CalstationError(f"{type(mistake).__name__}: {mistake}")
        with suppress(OSError, RuntimeError, CalstationError):  # what failed may be the log itself
            _end(run, Ended(State.FAULT, tuple(run.chain.solutions), error), begin)
        if isinstance(mistake, OSError):
            raise ConfigurationError(
                f"{run.log.path}: cannot be written any more ({mistake}); make room on its disk"
            ) from mistake
        raise
    _end(run, ended, begin)


def _end(run: _Run, ended: Ended, begin: float) -> None:
    registers = run.registers or None
    _close(run.log, run.chain, run.meta, ended, _elapsed(run.devices, begin), registers, run.emit)


def _elapsed(devices: Devices, begin: float) -> float:
    """Station time since `begin`, s; 0 where its clock has died."""
    try:
        return devices.clock.now() - begin
    except CalstationError:
        return 0.0


def _close(
    log: RawLogWriter,
    chain: StageChain,
    meta: LogMeta,
    ended: Ended,
    duration: float,
    registers: dict[str, Any] | None,
    emit: Emit,
) -> None:
    """Write the result into the log and beside it; emit the verdict."""
    outcome = _OUTCOMES[ended.state]
    error = None if ended.error is None else str(ended.error)
    judgement = judge(meta, chain.prior, ended.solutions)
    ending = Ending(outcome, str(log.path), log.facts(), duration, registers=registers, error=error)
    result = build_result(meta, chain.prior, ended.solutions, judgement, ending)
    result["passed"] = ended.state is State.PASSED
    log.add_result(result)
    log.close(outcome)
    beside = log.path.with_suffix(".json")
    write_json(beside, result)
    emit(Verdict(outcome, str(log.path), str(beside), result))


def _not_connected(meta: LogMeta, path: Path, emit: Emit, error: DeviceFaultError) -> None:
    """A run that found no devices: its log is empty, its result a fault."""
    log = RawLogWriter(path, meta)
    fault = Fault(type(error).__name__, str(error), error.exit_code)
    log.event(to_json(fault))
    emit(fault)
    _close(log, StageChain(meta), meta, Ended(State.FAULT, (), error), 0.0, None, emit)


def _folder(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".calstation"
        probe.touch()
        probe.unlink()
    except OSError as exc:
        raise ConfigurationError(
            f"--out {folder}: cannot be written ({exc.strerror or exc}); choose another folder"
        ) from exc
    return folder


def _stem(serial: str) -> str:
    return re.sub(r"[^A-Za-z0-9.-]", "-", serial)
