"""The end of a run: limits, transfer of the registers with its journal, proof on the restarted unit's data."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from calstation.config.resolved import ResolvedConfiguration
from calstation.config.site_check import latitude_untold
from calstation.devices.imu.registers import RegisterMap
from calstation.devices.imu.transfer import Entry, Transferred, flash_registers, transfer
from calstation.devices.interfaces import Imu
from calstation.estimation.method import Solution
from calstation.physics.arrays import FloatArray
from calstation.physics.parameters import NAMES
from calstation.records.limits import estimated_stage
from calstation.records.meta import LogMeta, context_from_meta
from calstation.records.raw_log import RawLogWriter
from calstation.registers import journal as register_journal
from calstation.registers.journal import UnitType, journal_folder
from calstation.registers.unit_registers import compose
from calstation.registers.verification import (
    AppliedRegisters,
    close_verified,
    output_error,
    restore_refuted,
    verified_on,
    verify_output,
    without_register,
)
from calstation.results.judge import is_partial, judge
from calstation.results.merge_previous import (
    PreviousValue,
    VerifiedRegister,
    better_previous_values,
    condition_on,
)
from calstation.results.solver_chain import StageChain
from calstation.sequencer.capture import VerificationData
from calstation.sequencer.control import StopRequested
from calstation.sequencer.driving import RunInBackground
from calstation.sequencer.events import Event, Message
from calstation.sequencer.sequencer import Look
from calstation.sequencer.task import Finalized


@dataclass
class Finalization:
    """What a run does with its answer.

    Attributes
    ----------
    tell : takes messages for listener and log
    registers : filled with what the result says of them, {} where nothing was written
    hear : takes the operator's commands, raises StopRequested
    in_force : registers of the unit as earlier runs wrote and proved them
    """

    setup: ResolvedConfiguration
    meta: LogMeta
    log: RawLogWriter
    chain: StageChain
    imu: Imu
    tell: Callable[[Event], None]
    registers: dict[str, Any]
    check_cancelled: Callable[[], None]
    in_force: Mapping[str, VerifiedRegister] = field(default_factory=dict)
    _done: Transferred | None = None
    _covariance: FloatArray | None = None

    def finalize(
        self, solutions: tuple[Solution, ...], run_in_background: RunInBackground, look: Look
    ) -> Finalized:
        """Check the limits; write the registers of a unit inside them, after a look at it as it is.

        A stop before the first register is a stop at once; one that comes later waits until the transfer is done.
        Raises DeviceFaultError, StopRequested.
        """
        if not judge(self.meta, self.chain.prior, solutions).passed:
            self.tell(Message("registers_kept"))
            untold = latitude_untold(self.meta, solutions)
            if untold is not None:
                self.tell(Message("latitude_untold", untold))
            return Finalized(passed=False, written=False)
        entries = RegisterMap(tuple(self.setup.imu.registers))
        if not entries.parameters:
            return Finalized(passed=True, written=False)
        # The log belongs to this thread, so what the unit holds is read and kept before the transfer begins.
        old = run_in_background(lambda: flash_registers(self.imu))
        self._keep(old, run_in_background)
        wanted = self._wanted(solutions, old)
        self.tell(Message("reference"))
        look()
        self.check_cancelled()
        self.tell(Message("registers_transfer"))
        serial = self.meta.imu.serial
        self._done = run_in_background(lambda: transfer(self.imu, entries, serial, wanted, self._begin, old))
        self.registers["new"] = dict(self._done.found)
        try:
            self.check_cancelled()
        except StopRequested:
            self.tell(Message("transfer_finished"))
            self.tell(Message("transfer_unproved"))
            raise
        return Finalized(passed=True, written=True)

    def verify_output(self, fresh: VerificationData, run_in_background: RunInBackground) -> None:
        """Judge the restarted unit's data; one whose corrected output is wrong gets its old registers back.

        Raises DeviceFaultError.
        """
        assert self._done is not None
        assert self._covariance is not None
        entry, entries = self._done.entry, RegisterMap(tuple(self.setup.imu.registers))
        before = entry.old if self.setup.after_registers else None
        checks = verify_output(
            fresh,
            AppliedRegisters(entry.new, before),
            self._covariance,
            context_from_meta(self.meta),
            self.setup.repeatability,
        )
        self.registers["proof"] = [check.to_json() for check in checks]
        wrong = [check for check in checks if not check.passed]
        if wrong:
            self.registers["new"] = run_in_background(lambda: restore_refuted(self.imu, entries, entry))
            raise output_error(wrong[0], "its old registers were put back")
        run_in_background(lambda: close_verified(entry, fresh))
        seen = verified_on(fresh)
        written = datetime.now(UTC).isoformat(timespec="seconds")
        self.registers |= {"verified": True, "proved_on": seen, "written_utc": written}
        told = "registers_written" if fresh.corrected else "registers_read_back"
        self.tell(Message(told, {"count": len(self._done.found)}))

    def _wanted(self, solutions: tuple[Solution, ...], old: Mapping[str, float]) -> dict[str, float]:
        """What the registers are to hold; part of a calibration leaves better ones alone."""
        belief, estimated = solutions[-1].belief, estimated_stage(solutions)
        behind = self.setup.after_registers
        better: tuple[PreviousValue, ...] = ()
        if is_partial(self.meta):
            better = better_previous_values(old, belief, estimated, self.in_force, after_registers=behind)
        kept = [parameter for parameter in better if not parameter.contradicted]
        for parameter in better:
            self.tell(
                Message("better_changed" if parameter.contradicted else "better_kept", parameter.values())
            )
        if kept:
            self.registers["kept"] = {parameter.name: parameter.to_json() for parameter in kept}
        belief = condition_on(belief, kept, old, after_registers=behind)
        self._covariance = without_register(belief, old)
        found = dict(zip(NAMES, belief.mean.tolist(), strict=True))
        wanted = compose(self.meta.registers, found) if behind else {name: found[name] for name in estimated}
        return wanted | {parameter.name: old[parameter.name] for parameter in kept}

    def _begin(self, old: Mapping[str, float], new: Mapping[str, float]) -> Entry:
        log, serial = self.log.path, self.meta.imu.serial
        by, site = self.setup.request.operator, journal_folder(self.setup.station)
        sort = UnitType.of(self.setup, self.imu.identify().model)
        return register_journal.begin(
            log.parent, serial, old, new, by=by, why="run", source=log.name, site=site, sort=sort
        )

    def _keep(self, old: Mapping[str, float], run_in_background: RunInBackground) -> None:
        """The unit's registers as they were go to the log before anything is written."""
        self.registers |= {"old": dict(old), "new": None, "verified": False}
        self.log.event({"event": "OldRegisters", "registers": dict(old)})
        run_in_background(self.log.begin_sync().result)
        self.log.service()
