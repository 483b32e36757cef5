"""Recovery of interrupted transfers, which are finished or reverted at the next start, as the operator has decided."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from calstation.config import RunConfiguration
from calstation.connection import Devices, ImuSession, capture_rest
from calstation.devices import Imu
from calstation.devices.imu import FlashContent, TransferOutcome, TransferResult, finish, read_flash_content, restore
from calstation.registers import journal
from calstation.registers.journal import Transfer, journal_folder
from calstation.registers.preconditions import check_unit_model, undecided
from calstation.registers.verification import finish_verification
from calstation.sequencer import Emit, Message, RunInBackground, VerificationData, check_power

#: Options for an interrupted transfer: complete and verify the new registers, or restore the old ones.
DECISIONS: tuple[Literal["finish", "restore"], ...] = ("finish", "restore")


@dataclass
class UnverifiedTransfer:
    """A transfer that was finished before a run, to be verified with the run's table before its first stage."""

    setup: RunConfiguration
    imu: Imu
    transferred: TransferResult
    on_verified: Callable[[], None]
    open: bool = True

    def verify_output(self, data: VerificationData, run_in_background: RunInBackground) -> None:
        """Verify the output; if it is wrong, restore the old registers and raise DeviceFaultError."""
        self.open = False
        finish_verification(self.setup, self.imu, self.transferred, data, run_in_background)
        self.on_verified()


def open_transfer(folder: Path, serial: str) -> Transfer | None:
    """Return the transfer to a unit that has written registers but has not ended, according to the journal, or None.

    `folder` is returned by `journal_folder`. Raises ConfigurationError if the journal is damaged.
    """
    entry = journal.interrupted(folder, serial)
    return entry if entry is not None and entry.steps else None


def registers_changed(folder: Path, serial: str, since: str) -> bool:
    """Return whether a transfer that began since a time has written registers to a unit, according to its journal.

    A transfer after which the unit still had its old registers does not count, but an open transfer does. Raises
    ConfigurationError if the journal is damaged.

    Parameters
    ----------
    folder : folder returned by `journal_folder`
    serial : serial number of the unit
    since : time, ISO 8601 in UTC with seconds
    """
    transfers = journal.history(folder, serial)
    return any(each.steps and each.closing != TransferOutcome.KEPT and each.utc >= since for each in transfers)


def recover_interrupted(
    devices: Devices, setup: RunConfiguration, runs: Path, emit: Emit, check_cancelled: Callable[[], None]
) -> UnverifiedTransfer | None:
    """Recover an interrupted transfer to the unit before a run.

    A unit that still has its old registers is reported and left unchanged. Otherwise `unfinished` in the request
    specifies whether to finish or to restore; without it, the options are reported and the run is refused. New
    registers are verified when the run's table is ready, or immediately and at rest on a manual rig.

    Raises DeviceFaultError if no decision was made, the output is wrong, or the link failed.
    """
    request, imu, table = setup.request, devices.imu, devices.table
    entry = journal.interrupted(journal_folder(setup.station, runs), request.serial)
    if entry is None:
        return None
    identity = imu.identify()
    check_unit_model(entry, identity.model)
    registers = setup.register_map
    content = read_flash_content(imu, entry, registers)
    values = {"serial": entry.serial, "holds": content, "utc": entry.utc, "by": entry.by, "why": entry.why}
    if content is FlashContent.OLD:
        entry.close(TransferOutcome.KEPT)
        imu.start()
        emit(Message("transfer_kept", values))
        return None
    if request.unfinished is None:
        emit(Message("transfer_open", {**values, "offers": list(DECISIONS)}))
        raise undecided(entry, content)

    def report() -> None:
        emit(Message("transfer_settled", {**values, "closing": str(entry.closing)}))

    unverified = None
    if request.unfinished == "restore":
        restore(imu, registers, entry)
        report()
    elif setup.table.by_hand:
        transferred = finish(imu, registers, entry)
        session = ImuSession(imu, imu.identify(), devices.clock)
        finish_verification(setup, imu, transferred, capture_rest(session, setup, check_cancelled))
        report()
    else:
        table.identify()
        check_power(table.status())  # nothing is written that could not be verified on the table
        unverified = UnverifiedTransfer(setup, imu, finish(imu, registers, entry), report)
    imu.start()
    return unverified
