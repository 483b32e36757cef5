"""Is a unit's output right behind a transfer that no run has made? By what any unit of its type may be off."""

from collections.abc import Callable, Mapping
from typing import Any

from calstation.config.resolved import ResolvedConfiguration
from calstation.devices.imu.registers import RegisterMap
from calstation.devices.imu.transfer import Closing, Entry, Step, Transferred, restore
from calstation.devices.interfaces import Imu
from calstation.errors import DeviceFaultError
from calstation.records.meta import context_from_meta, prior_from_meta
from calstation.registers.comparison import Registers
from calstation.registers.verification import prove, refuted
from calstation.registers.verification_check import VerificationCheck
from calstation.sequencer.capture import VerificationData
from calstation.sequencer.driving import RunInBackground


def at_once(work: Callable[[], Any]) -> Any:
    """Does a work where no table needs to be looked after meanwhile."""
    return work()


def judge(
    setup: ResolvedConfiguration,
    imu: Imu,
    done: Transferred,
    fresh: VerificationData,
    run_in_background: RunInBackground = at_once,
) -> None:
    """Close the journal's entry of new registers; where the output is wrong with them, the old ones are put back.

    Raises DeviceFaultError.
    """
    entry = done.entry
    wrong = _wrong(setup, done, fresh, back=False)
    if wrong:
        run_in_background(lambda: give_back(imu, RegisterMap(tuple(setup.imu.registers)), entry))
        raise refuted(wrong[0], "its old registers were put back")
    run_in_background(lambda: close_proved(entry, fresh))


def give_back(imu: Imu, entries: RegisterMap, entry: Entry) -> Mapping[str, float]:
    """Give a unit whose output was refuted its old registers back; what it holds then."""
    entry.note(Step.REFUTED)
    return restore(imu, entries, entry)


def close_proved(entry: Entry, fresh: VerificationData) -> None:
    """Close the journal's entry of registers whose output is right."""
    entry.note(proved_by(fresh))
    entry.close(Closing.DONE)


def judge_old(setup: ResolvedConfiguration, done: Transferred, fresh: VerificationData) -> None:
    """Close the entry of registers that were put back: the unit is as it was, whatever its output is worth.

    Raises DeviceFaultError where that is wrong.
    """
    entry = done.entry
    wrong = _wrong(setup, done, fresh, back=True)
    entry.note(Step.REFUTED if wrong else proved_by(fresh))
    entry.close(Closing.RESTORED)
    if wrong:
        check = wrong[0]
        raise DeviceFaultError(
            f"IMU: its old registers are back, but with them {check.name} measures {check.value:.6g} {check.unit},"
            f" expected {check.expected:.6g} within {check.tolerance:.2g}; calibrate the unit before it is used"
        )


def _wrong(
    setup: ResolvedConfiguration, done: Transferred, fresh: VerificationData, *, back: bool
) -> list[VerificationCheck]:
    meta = setup.log_meta()
    entry = done.entry
    registers = Registers(entry.old if back else entry.new, entry.old if setup.after_registers else None)
    prior = prior_from_meta(meta).covariance
    checks = prove(fresh, registers, prior, context_from_meta(meta), setup.repeatability)
    return [check for check in checks if not check.passed]


def proved_by(fresh: VerificationData) -> Step:
    """What the journal says of a proof."""
    if not fresh.corrected:
        return Step.READ_BACK
    return Step.TURNED if fresh.turns or len(fresh.carried) else Step.AT_REST
