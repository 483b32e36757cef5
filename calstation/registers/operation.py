"""Registers written, finished or restored outside a run: the same guards, the same turns, the same safe stop.

Where a table is driven it is made ready before the first register is written, and turns the restarted unit behind it.
Rails that hands turn, and a table that is to be left alone, prove at rest. Who wanted what stands in the unit's journal
(`register_journal`), with the old values, on disk before the first register is written.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from calstation.config.request import OR_AT_REST, RegisterOperation
from calstation.config.resolved import ResolvedConfiguration, resolve_configuration
from calstation.connection.devices import Devices, connected
from calstation.connection.imu_session import capture_rest, open_imu_session
from calstation.devices.imu.transfer import (
    Closing,
    Holds,
    Step,
    Transferred,
    check_serial,
    finish,
    put_back,
    recognise,
    transfer,
)
from calstation.devices.interfaces import Imu, ImuIdentity
from calstation.errors import CalstationError, ConfigurationError, DeviceFaultError, InputError
from calstation.registers import journal as register_journal
from calstation.registers.interrupted import check_no_interrupted, register_map
from calstation.registers.journal import Transfer, UnitType, journal_folder
from calstation.registers.preconditions import check_flash, check_register_map, check_unit_model
from calstation.registers.unit_registers import held
from calstation.registers.verification import (
    finish_verification,
    judge_restored,
    run_inline,
    verification_step,
)
from calstation.sequencer.capture import VerificationData
from calstation.sequencer.context import Emit, RunContext, Slot
from calstation.sequencer.control import Control, State, StopRequested
from calstation.sequencer.driving import Driving, RunInBackground
from calstation.sequencer.events import Message, Settled, StateChanged
from calstation.sequencer.task import Output

#: Beginnings of what is told of a table, and of moves that it cannot make.
_OF_TABLES = ("table:", "schedule:")
_TABLE_FAMILIES = ("table", "motion")

#: Takes the operator's commands; raises StopRequested.
CheckCancelled = Callable[[], None]


def moves_table(errand: RegisterOperation) -> bool:
    """Whether a table is going to move for it. Raises InputError where there is nothing to do, ConfigurationError."""
    setup = resolve_configuration(errand.request)
    _Work.of(errand, setup, lambda event: None)
    return not (errand.at_rest or setup.by_hand)


def run_operation(errand: RegisterOperation, emit: Emit, control: Control) -> None:
    """Do an errand to its end: its last event is `Settled`, or the `Fault` that ended it.

    New registers that turn out wrong are taken back. A stop, or a fault of the table, behind the write leaves them
    written and their transfer open: the next start offers to finish or to restore it.

    Raises
    ------
    InputError
        where there is nothing to finish, or the journal knows no such set.
    ConfigurationError
        where the journal cannot be written; nothing was written to the unit then.
    DeviceFaultError
        where another unit answers, an earlier transfer is open, a value does not fit, or the link fails.
    """

    def check_cancelled() -> None:
        control.take()
        if control.stopping:
            raise StopRequested

    setup = resolve_configuration(errand.request)
    work = _Work.of(errand, setup, emit)
    try:
        if errand.at_rest or setup.by_hand:
            settled: Settled | None = _at_rest(work, check_cancelled)
        else:
            settled = _with_turns(work, control, check_cancelled)
    except StopRequested:
        settled = work.stopped
    if settled is not None:
        emit(settled)


@dataclass
class _Work:
    """An errand in hand.

    Attributes
    ----------
    entry : the interrupted transfer that is to be settled; None where a new one is to begin
    values, source : of the new one, SI by parameter, and where they come from
    earlier : the transfer before which the unit held these values, None for those of a result
    identity : of the unit, as it answered
    """

    errand: RegisterOperation
    setup: ResolvedConfiguration
    emit: Emit
    entry: Transfer | None
    values: Mapping[str, float]
    source: str
    earlier: Transfer | None = None
    identity: ImuIdentity = field(init=False)

    @classmethod
    def of(cls, errand: RegisterOperation, setup: ResolvedConfiguration, emit: Emit) -> "_Work":
        """Raises InputError where there is nothing to finish or restore, or what there is belongs to another sort of
        unit; ConfigurationError for a worn out flash."""
        runs, serial, site = errand.request.out, errand.request.serial, journal_folder(setup.station)
        entry = register_journal.interrupted(runs, serial, site)
        if entry is not None:
            check_register_map(entry, setup)
        if errand.what == "write":
            check_flash(setup, runs, emit)
            return cls(errand, setup, emit, None, errand.values, errand.source)
        if entry is not None and errand.transfer is None:
            return cls(errand, setup, emit, entry, {}, "")
        if errand.what == "finish":
            raise InputError(
                f"{site or runs}: no transfer to unit '{serial}' is open; there is nothing to finish"
            )
        wanted = _earlier(runs, serial, errand.transfer, site)
        check_register_map(wanted, setup)
        check_flash(setup, runs, emit)
        return cls(errand, setup, emit, None, wanted.old, f"before {wanted.id}", wanted)

    @property
    def back(self) -> bool:
        """Whether the old registers of an interrupted transfer are put back."""
        return self.entry is not None and self.errand.what == "restore"

    @property
    def stopped(self) -> Settled:
        """The answer where it was stopped."""
        return Settled(self.errand.request.serial, "stopped", "")

    def untouched(self, imu: Imu) -> Settled | None:
        """The answer for a unit that has the old registers already; None where something is to be done.

        Raises DeviceFaultError for another unit, or one with another transfer open.
        """
        request = self.errand.request
        check_serial(imu, request.serial)
        self.identity = imu.identify()
        for entry in filter(None, (self.entry, self.earlier)):
            check_unit_model(entry, self.identity.model)
        if self.entry is None:
            check_no_interrupted(imu, self.setup, request.out, request.serial)
        elif self.back and recognise(imu, self.entry, register_map(self.setup)) is Holds.OLD:
            self.entry.close(Closing.KEPT)
            return self._settled(self.entry.old, Closing.KEPT, "")
        return None

    def write(self, imu: Imu) -> Transferred:
        """Write, read back, commit, restart, read again. Raises DeviceFaultError, ConfigurationError."""
        entries = register_map(self.setup)
        if self.entry is not None:
            return (put_back if self.back else finish)(imu, entries, self.entry)
        return transfer(imu, entries, self.errand.request.serial, self.values, self._begin)

    @contextmanager
    def looking(self, check_cancelled: CheckCancelled) -> Iterator[None]:
        """While the restarted unit is looked at; whatever ends that early, it is told how the unit is left."""
        try:
            try:
                check_cancelled()
            except StopRequested:
                self.emit(Message("transfer_finished"))
                raise
            self.emit(Message("verifying"))
            yield
        except (StopRequested, CalstationError):
            self.emit(Message("old_unproved" if self.back else "transfer_unproved"))
            raise

    def finish_verification(
        self, imu: Imu, done: Transferred, fresh: VerificationData, run_in_background: RunInBackground
    ) -> Settled:
        """Close the journal's entry by the fresh data. Raises DeviceFaultError where they are wrong."""
        if self.back:
            judge_restored(self.setup, done, fresh)
        else:
            finish_verification(self.setup, imu, done, fresh, run_in_background)
        proof = {Step.TURNED: "turn", Step.AT_REST: "rest"}.get(verification_step(fresh), "read_back")
        told = "registers_read_back" if proof == "read_back" else "registers_proved"
        self.emit(Message(told, {"count": len(done.found), "proof": proof}))
        return self._settled(done.found, Closing.RESTORED if self.back else Closing.DONE, proof)

    def _settled(self, found: Mapping[str, float], closing: Closing, proof: str) -> Settled:
        request = self.errand.request
        unit = held(self.setup, self.identity, found, request.out)
        return Settled(request.serial, str(closing), proof, unit.to_json())

    def _begin(self, old: Mapping[str, float], new: Mapping[str, float]) -> Transfer:
        request = self.errand.request
        why = "hand" if self.errand.what == "write" else "restore"
        return register_journal.begin(
            request.out,
            request.serial,
            old,
            new,
            by=request.operator,
            why=why,
            source=self.source,
            site=journal_folder(self.setup.station),
            sort=UnitType.of(self.setup, self.identity.model),
        )


def _at_rest(work: _Work, check_cancelled: CheckCancelled) -> Settled:
    """Leave the table alone."""
    with open_imu_session(_untold, work.setup, check_cancelled) as unit:
        work.emit(StateChanged(State.PREPARING, State.IDLE))
        untouched = work.untouched(unit.imu)
        if untouched is not None:
            return untouched
        check_cancelled()
        work.emit(StateChanged(State.RUNNING, State.PREPARING))
        work.emit(Message("registers_writing"))
        done = work.write(unit.imu)
        with work.looking(check_cancelled):
            fresh = capture_rest(unit, work.setup, check_cancelled)
        return work.finish_verification(unit.imu, done, fresh, run_inline)


def _with_turns(work: _Work, control: Control, check_cancelled: CheckCancelled) -> Settled | None:
    """Make the table ready, write, turn the unit, and bring it to the load angle; None where a fault was told."""
    settled: Settled | None = None
    with ExitStack() as stack:
        with _or_at_rest():
            devices = stack.enter_context(connected(work.setup, check_cancelled))
        imu = devices.imu
        untouched = work.untouched(imu)
        if untouched is not None:
            return untouched
        imu.start()
        imu.read()  # what came before belongs to nothing
        drive = Driving(_context(work, devices, control))

        def write_and_turn() -> State:
            nonlocal settled
            drive.go(State.PREPARING)
            with _or_at_rest():
                drive.begin()
                drive.preflight()
                drive.check_turns()
            drive.go(State.RUNNING)
            if work.entry is None or work.setup.corrected is Output.ASKED:
                work.emit(Message("reference"))
                with _or_at_rest():
                    drive.reference()
            drive.control_loop.check_cancelled()
            work.emit(Message("registers_writing"))
            done = drive.run_in_background(lambda: work.write(imu))
            with work.looking(drive.control_loop.check_cancelled):
                fresh = drive.verification_data()
            settled = work.finish_verification(imu, done, fresh, drive.run_in_background)
            drive.finish()
            return State.DONE

        if drive.run(write_and_turn) is not None:
            return None
    return settled or work.stopped


def _context(work: _Work, devices: Devices, control: Control) -> RunContext:
    """A run without stages, log and solvers; the output of registers that may be wrong is not checked before."""
    setup = work.setup
    unit = setup.unit_task()
    preflight = replace(unit.preflight, warm_up=0.0, warm_up_slope=None, output=not setup.after_registers)
    slot = Slot(devices.imu, replace(unit, preflight=preflight))
    return RunContext(
        replace(setup.task(), stages=()), devices.table, (slot,), devices.clock, work.emit, control
    )


def _earlier(runs: Path, serial: str, ident: str | None, site: Path | None) -> Transfer:
    """The transfer before which the unit held what is to be restored. Raises InputError."""
    known = register_journal.history(runs, serial, site)
    if not known:
        mend = "check the number" if site else "give the folder of its runs with --out"
        raise InputError(f"{site or runs}: no transfer to unit '{serial}' is known; {mend}")
    found = [transfer_ for transfer_ in known if ident in (None, transfer_.id)]
    if not found:
        raise InputError(
            f"{site or runs}: unit '{serial}' has no transfer '{ident}'; see calstation registers list {serial}"
        )
    return found[-1]


@contextmanager
def _or_at_rest() -> Iterator[None]:
    """Nothing is written yet: what keeps the table from moving is told with the way around it."""
    try:
        yield
    except CalstationError as error:
        if error.family not in _TABLE_FAMILIES and not str(error).startswith(_OF_TABLES):
            raise
        kind = DeviceFaultError if isinstance(error, DeviceFaultError) else ConfigurationError
        raise kind(f"{error}{OR_AT_REST}") from error


def _untold(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
    """Events tell how it gets on."""
