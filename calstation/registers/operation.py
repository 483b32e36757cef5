"""Register operations outside a run (write, finish or restore) with the same guards and safe stop as a run.

A driven table is made ready before the first register is written, and turns the unit after the unit has restarted. On a
manual rig, or if the table must not move, the output is verified at rest. Before the first register is written, the
requester, the purpose and the old values are stored in the unit's journal on disk.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from calstation.config import (
    Confirmation,
    RegisterOperation,
    RunConfiguration,
    confirmation_required,
    load_configuration,
    site_folder,
)
from calstation.connection import Devices, capture_rest, open_devices, open_imu_session
from calstation.devices import Imu, ImuIdentity
from calstation.devices.imu import (
    FlashContent,
    TransferOutcome,
    TransferResult,
    TransferStep,
    check_serial,
    finish,
    read_flash_content,
    rewrite_old,
    transfer,
)
from calstation.errors import CalstationError, ConfigurationError, DeviceFaultError, InputError
from calstation.messages import entry as catalogue_entry
from calstation.records import append_audit
from calstation.registers import journal
from calstation.registers.journal import Purpose, Transfer, journal_folder
from calstation.registers.preconditions import (
    check_flash,
    check_no_interrupted,
    check_product,
    check_register_map,
    check_unit_model,
)
from calstation.registers.unit_registers import unit_registers
from calstation.registers.verification import finish_restored, finish_verification, verification_step
from calstation.sequencer import (
    Control,
    Emit,
    Message,
    Output,
    RunContext,
    RunDriver,
    RunInBackground,
    Settled,
    Slot,
    State,
    StateChanged,
    StopRequested,
    VerificationData,
    corrected_output,
    table_task,
    unit_task,
)

#: Function that processes commands of the operator and raises StopRequested after a stop command.
CheckCancelled = Callable[[], None]

_VERIFIED_BY = {TransferStep.VERIFIED_ROTATING: "turn", TransferStep.VERIFIED_AT_REST: "rest"}


def moves_table(operation: RegisterOperation) -> bool:
    """Return whether an operation moves a table. Raises ConfigurationError, or InputError if there is nothing to do."""
    setup = load_configuration(operation.request)
    _ActiveOperation.of(operation, setup, lambda event: None)
    return not (operation.at_rest or setup.table.by_hand)


def run_operation(operation: RegisterOperation, emit: Emit, control: Control) -> None:
    """Execute a register operation; its last event is `Settled`, or the `Fault` that ended it.

    If the output with the new registers is wrong, the old ones are restored. After a stop or a table fault that occurs
    after the write, the unit keeps the new registers and the transfer stays open; the next start offers to finish it or
    to restore the old registers.

    Parameters
    ----------
    operation : operation to execute
    emit : function that receives events
    control : commands of the operator

    Raises
    ------
    InputError : if there is nothing to finish, or the journal does not contain the transfer
    ConfigurationError : if the journal or the audit trail cannot be written, after which the unit is unchanged, or if a
        second engineer required by the product has not confirmed the operation
    DeviceFaultError : if another unit is connected, an earlier transfer is open, a value is out of range, or the link
        fails
    """
    active = _ActiveOperation.of(operation, load_configuration(operation.request), emit)
    _audit(operation, active.setup)
    try:
        if operation.at_rest or active.setup.table.by_hand:
            settled: Settled | None = _run_at_rest(active, control.check_cancelled)
        else:
            settled = _run_with_turns(active, control, control.check_cancelled)
    except StopRequested:
        settled = Settled(operation.request.serial, "stopped", "")
    if settled is not None:
        emit(settled)


def _audit(operation: RegisterOperation, setup: RunConfiguration) -> None:
    """Append the operation to the audit trail before it begins. Raises ConfigurationError if it is not confirmed."""
    people = operation.people or Confirmation(setup.station.person(operation.request.operator or ""))
    if confirmation_required("registers", setup.product, setup.station).second and people.confirmed_by is None:
        raise ConfigurationError("confirmation.registers_required", product=setup.product.name)
    append_audit(
        site_folder(),
        "registers",
        people.by,
        confirmed_by=people.confirmed_by,
        pin=people.pin,
        serial=operation.request.serial,
        what=operation.what,
        source=operation.source or operation.transfer or "",
        station=setup.station.name,
    )


@dataclass
class _ActiveOperation:
    """An operation in progress.

    entry : the interrupted transfer to complete; None for a new one
    values, source : values of a new transfer, SI by parameter, and their origin
    earlier : the earlier transfer that replaced these values; None for values of a result
    """

    operation: RegisterOperation
    setup: RunConfiguration
    emit: Emit
    entry: Transfer | None
    values: Mapping[str, float]
    source: str
    earlier: Transfer | None = None
    identity: ImuIdentity = field(init=False)

    @classmethod
    def of(cls, operation: RegisterOperation, setup: RunConfiguration, emit: Emit) -> "_ActiveOperation":
        """Determine what an operation does. Raises InputError, or ConfigurationError if the flash is worn out."""
        runs, serial = operation.request.out, operation.request.serial
        folder = journal_folder(setup.station, runs)
        entry = journal.interrupted(folder, serial)
        if entry is not None:
            check_register_map(entry, setup)
        if operation.what == "write":
            check_flash(setup, runs, emit)
            return cls(operation, setup, emit, None, operation.values, operation.source)
        if entry is not None and operation.transfer is None:
            check_product(entry, setup)
            return cls(operation, setup, emit, entry, {}, "")
        if operation.what == "finish":
            raise InputError("transfer.nothing_to_finish", folder=str(folder), serial=serial)
        earlier = _find_earlier(folder, serial, operation.transfer, hardware=setup.station.bench is None)
        check_register_map(earlier, setup)
        check_product(earlier, setup)
        check_flash(setup, runs, emit)
        return cls(operation, setup, emit, None, earlier.old, f"before {earlier.id}", earlier)

    @property
    def restoring(self) -> bool:
        """Whether the operation restores the old registers of an interrupted transfer."""
        return self.entry is not None and self.operation.what == "restore"

    def close_unchanged(self, imu: Imu) -> Settled | None:
        """Return the last event for a unit that still has its old registers; None if registers must be written.

        Raises DeviceFaultError if another unit is connected, or if the unit has another open transfer.
        """
        request = self.operation.request
        check_serial(imu, request.serial)
        self.identity = imu.identify()
        for entry in filter(None, (self.entry, self.earlier)):
            check_unit_model(entry, self.identity.model)
        if self.entry is None:
            check_no_interrupted(imu, self.setup, request.out)
        elif self.restoring and read_flash_content(imu, self.entry, self.setup.register_map) is FlashContent.OLD:
            self.entry.close(TransferOutcome.KEPT)
            return self._settled(self.entry.old, TransferOutcome.KEPT, "")
        return None

    def write(self, imu: Imu) -> TransferResult:
        """Write the registers, read them back, commit them, restart the unit, and read them again.

        Raises DeviceFaultError or ConfigurationError.
        """
        entries = self.setup.register_map
        if self.entry is not None:
            return (rewrite_old if self.restoring else finish)(imu, entries, self.entry)
        return transfer(imu, entries, self.operation.request.serial, self.values, self._begin)

    @contextmanager
    def verifying(self, check_cancelled: CheckCancelled) -> Iterator[None]:
        """Report the state of the unit if its verification after the restart ends early."""
        try:
            try:
                check_cancelled()
            except StopRequested:
                self.emit(Message("transfer_finished"))
                raise
            self.emit(Message("verifying"))
            yield
        except (StopRequested, CalstationError):
            self.emit(Message("old_unproved" if self.restoring else "transfer_unproved"))
            raise

    def verify(
        self,
        imu: Imu,
        transferred: TransferResult,
        data: VerificationData,
        run_in_background: RunInBackground | None = None,
    ) -> Settled:
        """Verify the output and close the transfer. Raises DeviceFaultError if the output is wrong."""
        if self.restoring:
            finish_restored(self.setup, transferred, data)
        else:
            finish_verification(self.setup, imu, transferred, data, run_in_background)
        proof = _VERIFIED_BY.get(verification_step(data), "read_back")
        message = "registers_read_back" if proof == "read_back" else "registers_proved"
        self.emit(Message(message, {"count": len(transferred.registers_read), "proof": proof}))
        return self._settled(
            transferred.registers_read, TransferOutcome.RESTORED if self.restoring else TransferOutcome.DONE, proof
        )

    def _settled(self, values: Mapping[str, float], outcome: TransferOutcome, proof: str) -> Settled:
        request = self.operation.request
        unit = unit_registers(self.setup, self.identity, values, request.out)
        return Settled(request.serial, str(outcome), proof, unit.to_json())

    def _begin(self, old: Mapping[str, float], new: Mapping[str, float]) -> Transfer:
        request, why = self.operation.request, "hand" if self.operation.what == "write" else "restore"
        purpose = Purpose.of(self.setup, self.identity.model, why, self.source)
        folder = journal_folder(self.setup.station, request.out)
        return journal.begin(folder, request.serial, old, new, purpose)


def _run_at_rest(active: _ActiveOperation, check_cancelled: CheckCancelled) -> Settled:
    with open_imu_session(lambda fraction, remaining_s=None, note="": None, active.setup, check_cancelled) as unit:
        active.emit(StateChanged(State.PREPARING, State.IDLE))
        unchanged = active.close_unchanged(unit.imu)
        if unchanged is not None:
            return unchanged
        check_cancelled()
        active.emit(StateChanged(State.RUNNING, State.PREPARING))
        active.emit(Message("registers_writing"))
        transferred = active.write(unit.imu)
        with active.verifying(check_cancelled):
            data = capture_rest(unit, active.setup, check_cancelled)
        return active.verify(unit.imu, transferred, data)


def _run_with_turns(active: _ActiveOperation, control: Control, check_cancelled: CheckCancelled) -> Settled | None:
    """Prepare the table, write, turn the unit, move to the load position; return None if a fault was emitted."""
    settled: Settled | None = None
    with ExitStack() as stack:
        with _suggest_at_rest():
            devices = stack.enter_context(open_devices((active.setup,), check_cancelled))
        imu = devices.imu
        unchanged = active.close_unchanged(imu)
        if unchanged is not None:
            return unchanged
        imu.start()
        imu.read()  # discards earlier samples
        drive = RunDriver(_context(active, devices, control))

        def write_and_turn() -> State:
            nonlocal settled
            drive.go(State.PREPARING)
            with _suggest_at_rest():
                drive.begin()
                drive.preflight()
                drive.check_turns()
            drive.go(State.RUNNING)
            if active.entry is None or corrected_output(active.setup) is Output.ON_COMMAND:
                active.emit(Message("reference"))
                with _suggest_at_rest():
                    drive.reference(drive.units, tuple(drive.units))
            drive.control_loop.check_cancelled()
            active.emit(Message("registers_writing"))
            transferred = drive.run_in_background(lambda: active.write(imu))
            with active.verifying(drive.control_loop.check_cancelled):
                (data,) = drive.verification_data(drive.units).values()
            settled = active.verify(imu, transferred, data, drive.run_in_background)
            drive.finish()
            return State.DONE

        if drive.run(write_and_turn) is not None:
            return None
    return settled or Settled(active.operation.request.serial, "stopped", "")


def _context(active: _ActiveOperation, devices: Devices, control: Control) -> RunContext:
    """Return the context of a run without stages, log and solvers, whose preflight does not check corrected output."""
    setup = active.setup
    unit = unit_task(setup)
    preflight = replace(unit.preflight, warm_up=0.0, warm_up_slope=None, output=not setup.after_registers)
    slot = Slot(devices.imu, replace(unit, preflight=preflight))
    return RunContext(
        replace(table_task(setup), stages=()), devices.table, (slot,), devices.clock, active.emit, control
    )


def _find_earlier(folder: Path, serial: str, ident: str | None, *, hardware: bool) -> Transfer:
    """Return the transfer that replaced the registers to restore. Raises InputError."""
    transfers = journal.history(folder, serial)
    if not transfers:
        code = "transfer.none_known" if hardware else "transfer.none_known_here"
        raise InputError(code, folder=str(folder), serial=serial)
    matches = [each for each in transfers if ident in (None, each.id)]
    if not matches:
        raise InputError("transfer.unknown_id", folder=str(folder), serial=serial, id=ident)
    return matches[-1]


@contextmanager
def _suggest_at_rest() -> Iterator[None]:
    """Add to errors of the table that the operation is also possible at rest."""
    try:
        yield
    except CalstationError as error:
        if catalogue_entry(error.code).source == "imu":
            raise
        kind = DeviceFaultError if isinstance(error, DeviceFaultError) else ConfigurationError
        code = "transfer.at_rest_possible_after_reset" if error.resettable else "transfer.at_rest_possible"
        raise kind(code, cause=error.as_text) from error
