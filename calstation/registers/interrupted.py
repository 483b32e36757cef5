"""Transfers that were interrupted: found at the next start, settled on a person's word before or outside a run."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from calstation.config.resolved import ResolvedConfiguration
from calstation.connection.imu_session import ImuSession, capture_rest
from calstation.devices.imu.registers import RegisterMap
from calstation.devices.imu.transfer import Closing, Holds, Transferred, finish, recognise, restore
from calstation.devices.interfaces import Imu, Table
from calstation.errors import DeviceFaultError
from calstation.registers import journal as register_journal
from calstation.registers.journal import Transfer, journal_folder
from calstation.registers.preconditions import check_register_map, check_unit_model
from calstation.registers.verification import finish_verification
from calstation.sequencer.capture import VerificationData
from calstation.sequencer.context import Clock, Emit
from calstation.sequencer.driving import RunInBackground
from calstation.sequencer.events import Message
from calstation.sequencer.guard import check_power

Decision = Literal["finish", "restore"]

#: What may be done about an interrupted transfer: go on to the new registers and prove them, or take them back.
DECISIONS: tuple[Decision, ...] = ("finish", "restore")


@dataclass
class UnverifiedTransfer:
    """A transfer that was finished before a run, whose own table is to prove it before its first stage."""

    setup: ResolvedConfiguration
    imu: Imu
    done: Transferred
    tell: Callable[[], None]
    open: bool = True

    def verify_output(self, fresh: VerificationData, run_in_background: RunInBackground) -> None:
        """Judge it. Raises DeviceFaultError where the output is wrong; the unit has its old registers then."""
        self.open = False
        finish_verification(self.setup, self.imu, self.done, fresh, run_in_background)
        self.tell()


def recover_interrupted(
    imu: Imu,
    table: Table,
    clock: Clock,
    setup: ResolvedConfiguration,
    runs: Path,
    emit: Emit,
    check_cancelled: Callable[[], None],
) -> UnverifiedTransfer | None:
    """Before a run: see whether an earlier transfer to its unit was interrupted.

    A unit that still holds its old registers is as it was, and is told so. Of any other the request's
    `unfinished` decides; without a decision the run is refused and the offers are told. New registers are left
    for the run's own table to prove, once that is ready; where hands turn the rails they are proved here, at rest.
    Raises DeviceFaultError, StopRequested.
    """
    request = setup.request
    entry = register_journal.interrupted(runs, request.serial, journal_folder(setup.station))
    if entry is None:
        return None
    check_unit_model(entry, imu.identify().model)
    holds = recognise(imu, entry, register_map(setup))
    about = {"serial": entry.serial, "holds": holds, "utc": entry.utc, "by": entry.by, "why": entry.why}
    if holds is Holds.OLD:
        entry.close(Closing.KEPT)
        imu.start()
        emit(Message("transfer_kept", about))
        return None
    if request.unfinished is None:
        emit(Message("transfer_open", {**about, "offers": list(DECISIONS)}))
        raise _undecided(entry, holds)

    def tell() -> None:
        emit(Message("transfer_settled", {**about, "closing": str(entry.closing)}))

    unproved = None
    if request.unfinished == "restore":
        restore(imu, register_map(setup), entry)
        tell()
    elif setup.by_hand:
        done = finish(imu, register_map(setup), entry)
        finish_verification(
            setup, imu, done, capture_rest(ImuSession(imu, imu.identify(), clock), setup, check_cancelled)
        )
        tell()
    else:
        table.identify()
        check_power(
            table.status()
        )  # a table that may not move proves nothing: then nothing is written either
        unproved = UnverifiedTransfer(setup, imu, finish(imu, register_map(setup), entry), tell)
    imu.start()
    return unproved


def check_interrupted(setup: ResolvedConfiguration, runs: Path) -> None:
    """Before anything is opened: a unit's interrupted transfer belongs to a unit of the same sort.

    Raises InputError with the mend.
    """
    entry = register_journal.interrupted(runs, setup.request.serial, journal_folder(setup.station))
    if entry is not None:
        check_register_map(entry, setup)


def check_no_interrupted(imu: Imu, setup: ResolvedConfiguration, runs: Path, serial: str) -> None:
    """Raises DeviceFaultError where a transfer to the unit waits for a decision; one that left no trace is closed."""
    entry = register_journal.interrupted(runs, serial, journal_folder(setup.station))
    if entry is not None:
        check_unit_model(entry, imu.identify().model)
        holds = recognise(imu, entry, register_map(setup))
        if holds is not Holds.OLD:
            raise _undecided(entry, holds)
        entry.close(Closing.KEPT)


def register_map(setup: ResolvedConfiguration) -> RegisterMap:
    """Of the unit's profile."""
    return RegisterMap(tuple(setup.imu.registers))


def _undecided(entry: Transfer, holds: Holds) -> DeviceFaultError:
    which = (
        "its new registers, which were never proved"
        if holds is Holds.NEW
        else "neither its old nor its new registers"
    )
    return DeviceFaultError(
        f"IMU: a transfer to unit '{entry.serial}' was interrupted ({entry.utc}) and it holds {which}; finish or"
        f" restore it: calstation registers finish {entry.serial}, or restore {entry.serial}"
    )
