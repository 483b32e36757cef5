"""Evaluation of a unit, which checks its limits after each stage and at the end, and transfers its registers."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial

import numpy as np

from calstation.devices import Imu
from calstation.devices.imu import JournalEntry, TransferResult, restart_and_read_registers, transfer
from calstation.errors import CalstationError
from calstation.estimation import Solution
from calstation.estimation.common import Posterior
from calstation.estimation.temperature import TemperatureFit
from calstation.judgement import (
    StandardComparison,
    estimated_stage,
    final_checks,
    judge,
    judge_standard,
    require_latitude,
    unobservable,
)
from calstation.messages import Text
from calstation.physics import EFFECT_PARAMETERS, NAMES, compose, is_over_temperature
from calstation.records import context_from_meta
from calstation.registers import (
    AppliedRegisters,
    Purpose,
    close_checked,
    journal_folder,
    verified_on,
    verify_output,
    without_register,
)
from calstation.registers import journal as register_journal
from calstation.results import TemperatureResult, estimate_of
from calstation.runs.closing import close_run
from calstation.runs.preparation import OpenRun
from calstation.sequencer import Message, RunEnd, RunInBackground, State, StopRequested, UnitDecision, VerificationData

#: Codes of the failures of a log, which do not change the verdict on a unit that is complete.
_LOG_FAILURES = ("log.not_written", "log.disk_nearly_full")

logger = logging.getLogger(__name__)


class Finalization:
    """Evaluates a unit; see `calstation.sequencer.Evaluation`."""

    def __init__(self, run: OpenRun, imu: Imu) -> None:
        self.run = run
        self._setup = run.setup
        self.imu = imu
        self._entries = run.setup.register_map
        self._old: Mapping[str, float] = {}
        self._target: Mapping[str, float] = {}
        self._transferred: TransferResult | None = None
        self._posterior: Posterior | None = None
        #: Whether a check has failed that no later stage changes.
        self.will_fail = False
        #: Sizes of the effects in the unit's model, SI, by parameter.
        self._effects: dict[str, float] = {}
        self._fit: TemperatureFit | None = None

    def verify_earlier(self) -> Callable[[VerificationData, RunInBackground], None] | None:
        """Return a function that verifies a transfer completed before the run, or None if there is none."""
        unverified = self.run.unverified
        return None if unverified is None else unverified.verify_output

    def continues(self, solution: Solution) -> bool:
        """Return whether to continue after a stage, which is False if a limit is exceeded and the product ends early.

        Raises ConfigurationError if the measured latitude contradicts the station file.
        """
        run, solutions = self.run, tuple(self.run.chain.solutions)
        require_latitude(run.meta, solutions)
        if not self._setup.product.end_on_failure or judge(run.meta, run.chain.prior, solutions).passed:
            self._note_failure(solution, len(solutions))
            return True
        run.emit(Message("stopped_early", {"stage": solution.stage}))
        return False

    def _note_failure(self, solution: Solution, solved: int) -> None:
        """Report that the unit will fail, if a check that no later stage changes has failed and stages remain."""
        section = self.run.meta.run
        if self.will_fail or section is None or solved >= len(section.stages):
            return
        failed = next((check for check in final_checks(solution) if not check.passed), None)
        if failed is not None:
            self.will_fail = True
            values = {"stage": failed.subject, "value": failed.value, "limit": failed.limit}
            why = failed.cause_text or Text.of("event.inconsistent", **values)
            self.run.emit(Message("will_fail", {"why": why}))

    def judge(self, solutions: tuple[Solution, ...]) -> UnitDecision:
        """Judge the unit and, if it passes, determine the registers to write."""
        run = self.run
        judgement = judge(run.meta, run.chain.prior, solutions, standard=self._compare_standard(solutions))
        differs_only = judgement.standard is not None and all(check.passed for check in judgement.checks)
        if not judgement.passed and not differs_only:
            run.emit(Message("registers_kept"))
            if judgement.latitude is not None:
                run.emit(Message("latitude_untold", judgement.latitude))
        # a check standard is never adjusted
        to_write = judgement.passed is True and judgement.standard is None and bool(self._entries.parameters)
        over = _over_temperature(solutions)
        if to_write and over is not None and (self._setup.after_registers or not over.fits(self._entries.parameters)):
            run.emit(Message("registers_without_temperature"))
            to_write = False
        if to_write:
            self._target = self._registers_to_write(solutions)
        return UnitDecision(judgement, to_write)

    def read_registers(self, run_in_background: RunInBackground) -> None:
        """Read and log the registers of the unit, and write the log to disk before anything is written to the unit.

        Raises DeviceFaultError, or ConfigurationError if the log cannot be written.
        """
        run = self.run
        # Only this thread may write the log, so the registers are read and logged before the transfer begins.
        run.emit(Message("registers_reading"))
        self._old = old = run_in_background(lambda: restart_and_read_registers(self.imu))
        run.set_registers(old)
        run.log.event({"event": "OldRegisters", "registers": dict(old)})
        run_in_background(run.log.begin_sync().result)
        run.log.service()
        unregistered = [name for name in self._effects if name not in self._entries.parameters]
        if unregistered:
            run.emit(Message("states_without_register", {"states": ", ".join(unregistered)}))

    def transfer(self, run_in_background: RunInBackground) -> None:
        """Write the registers to the unit.

        A stop requested before the first register is written takes effect immediately, a later one after the transfer.
        Raises DeviceFaultError or StopRequested.
        """
        run, check_cancelled = self.run, self.run.prepared.control.check_cancelled
        check_cancelled()
        run.emit(Message("registers_transfer"))
        logger.info("transfer of %d registers begins", len(self._target))
        self._transferred = transferred = run_in_background(
            lambda: transfer(self.imu, self._entries, run.serial, self._target, self._begin, self._old)
        )
        run.registers["new"] = dict(transferred.registers_read)
        try:
            check_cancelled()
        except StopRequested:
            run.emit(Message("transfer_finished"))
            run.emit(Message("transfer_unproved"))
            raise

    def _compare_standard(self, solutions: tuple[Solution, ...]) -> StandardComparison | None:
        """Compare a check standard with its reference values; return None for a production unit."""
        run, standard = self.run, self._setup.check_standard
        if standard is None:
            return None
        determined = estimated_stage(solutions).keys() - set(unobservable(run.chain.prior, solutions))
        started = run.prepared.started
        comparison = judge_standard(standard, self._setup.imu, started, solutions[-1].posterior, determined)
        worst = max(comparison.e_n, key=lambda name: abs(comparison.e_n[name]), default="")
        values = {
            "serial": run.serial,
            "parameter": worst,
            "e_n": abs(comparison.e_n.get(worst, 0.0)),
            "e_n_limit": comparison.e_n_limit,
            "t_squared": comparison.t_squared,
            "t_squared_limit": comparison.t_squared_limit,
        }
        run.emit(Message("standard_agrees" if comparison.passed else "standard_differs", values))
        return comparison

    def verify(self, data: VerificationData, run_in_background: RunInBackground) -> None:
        """Verify the output of the restarted unit.

        If it is wrong, restores the old registers and raises DeviceFaultError.
        """
        if self._transferred is None or self._posterior is None:
            raise RuntimeError("nothing was transferred")
        run, entry = self.run, self._transferred.entry
        checks = verify_output(
            data,
            AppliedRegisters(entry.new, entry.old if self._setup.after_registers else None),
            without_register(self._posterior_at(data.temperature), entry.old),
            context_from_meta(run.meta),
            self._setup.repeatability,
            run.chain.solutions[-1].details["least_squares"] if data.drifts else None,
            {name: size for name, size in self._effects.items() if name not in entry.new},
        )
        run.registers["proof"] = [check.to_json() for check in checks]
        restored = partial(run.registers.__setitem__, "new")
        run_in_background(lambda: close_checked(self.imu, self._entries, entry, checks, data, restored))
        written = datetime.now(UTC).isoformat(timespec="seconds")
        estimate = estimate_of(self._posterior, run.meta.registers).model_dump()
        run.registers |= {"verified": True, "proved_on": verified_on(data), "written_utc": written}
        run.registers["estimate"] = estimate
        message = "registers_written" if data.corrected else "registers_read_back"
        run.emit(Message(message, {"count": len(self._transferred.registers_read)}))

    def _posterior_at(self, temperature: float | None) -> Posterior:
        """Return the posterior of the parameters at a temperature of the unit, °C, limited to the range of the fit."""
        if self._posterior is None:
            raise RuntimeError("nothing was transferred")
        if self._fit is None or temperature is None:
            return self._posterior
        return self._fit.at(float(np.clip(temperature, *self._fit.model.range)))

    def ended(self, ended: RunEnd) -> None:
        """Write the result of the unit and emit its verdict, which an incomplete unloading does not change."""
        run = self.run
        if run.unverified is not None and run.unverified.open:
            run.emit(Message("transfer_unproved"))
        if self._is_complete and ended.judgement is not None and ended.state is not State.DONE:
            run.emit(self._incomplete_end(ended.error))
            ended = replace(ended, state=State.DONE, error=None)
        close_run(run, ended)

    def _incomplete_end(self, error: CalstationError | None) -> Message:
        """Return the message that the run of a complete unit was stopped, or that an error ended it."""
        values = {"serial": self.run.serial}
        if error is None:
            return Message("unloading_stopped", values)
        code = "not_stored" if error.code in _LOG_FAILURES else "unloading_failed"
        return Message(code, {**values, "reason": error.as_text})

    @property
    def _is_complete(self) -> bool:
        """Whether nothing is left to do after the judgement: the registers are kept, or were written and verified."""
        return not self._target or bool(self.run.registers.get("verified"))

    def _registers_to_write(self, solutions: tuple[Solution, ...]) -> dict[str, float]:
        """Return the registers of the parameters that a stage has estimated."""
        self._posterior = posterior = solutions[-1].posterior
        values = dict(zip(NAMES, posterior.mean.tolist(), strict=True))
        effects = {p.name for p in EFFECT_PARAMETERS}
        self._effects = {n: e.value for s in solutions for n, e in s.estimates.items() if n in effects}
        estimates = {name: values[name] for name in estimated_stage(solutions)} | self._effects
        if self._setup.after_registers:
            return compose(self.run.meta.registers, estimates)
        # A calibration at one temperature replaces the coefficients, too, which would be applied on top of it.
        zeros = dict.fromkeys(filter(is_over_temperature, self._entries.parameters), 0.0)
        over, self._fit = _over_temperature(solutions), solutions[-1].temperature
        return estimates | zeros | (over.registers if over is not None else {})

    def _begin(self, old: Mapping[str, float], new: Mapping[str, float]) -> JournalEntry:
        log = self.run.log.path
        folder = journal_folder(self._setup.station, log.parent)
        purpose = Purpose.of(self._setup, self.imu.identify().model, "run", log.name)
        return register_journal.begin(folder, self.run.serial, old, new, purpose)


def _over_temperature(solutions: tuple[Solution, ...]) -> TemperatureResult | None:
    """Return the parameters as functions of the temperature; None if they are constant."""
    for s in solutions:
        if s.temperature is not None:
            return TemperatureResult.of(s.temperature, s.estimated, s.posterior.covariance)
    return None
