"""Transfer of registers to a unit; after a power cut, the next start can tell whether flash holds old or new values.

A transfer checks the serial number, restarts the unit so that its registers have the values in flash, reads these
values, and records the intended change. Then it writes the new values, compares them bit by bit, commits them, restarts
the unit and compares them again. The journal entry, which contains the old and the new values, remains open until the
corrected output is verified with new data; with an open entry, the next start determines which values are in flash.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from calstation.devices.imu.registers import RegisterMap
from calstation.devices.interfaces import Imu
from calstation.errors import CalstationError, DeviceFaultError


class TransferStep(StrEnum):
    """Steps of a transfer as recorded in its journal; each step is on disk before the next one begins.

    After `VERIFIED_ROTATING`, the output was verified with rotations, after `VERIFIED_AT_REST` only at rest. After
    `READ_BACK`, the registers were only read back, because the unit does not apply them to any output. `COMMITTING`
    counts as a flash cycle even if no reply arrives.
    """

    WRITTEN = "written"
    COMMITTING = "committing"
    COMMITTED = "committed"
    RESTARTED = "restarted"
    RESTORING = "restoring"
    VERIFICATION_FAILED = "refuted"
    VERIFIED_ROTATING = "turned"
    VERIFIED_AT_REST = "at_rest"
    READ_BACK = "read_back"


class TransferOutcome(StrEnum):
    """Outcome of a transfer: the new values were verified, the old values were kept, or they were restored."""

    DONE = "done"
    KEPT = "kept"
    RESTORED = "restored"


class FlashContent(StrEnum):
    """The values that the flash of a restarted unit contains."""

    OLD = "old"
    NEW = "new"
    NEITHER = "neither"


class JournalEntry(Protocol):
    """A transfer in the journal, with the unit's old values and the values to write, by parameter, SI.

    Both methods return once the record is on disk, or raise CalstationError.
    """

    serial: str
    old: Mapping[str, float]
    new: Mapping[str, float]

    def note(self, step: TransferStep) -> None:
        """Record a step."""

    def close(self, outcome: TransferOutcome) -> None:
        """Record the outcome."""


#: Function that records an intended change from old to new values, by parameter, SI, and returns once it is on disk.
Begin = Callable[[Mapping[str, float], Mapping[str, float]], JournalEntry]


@dataclass(frozen=True)
class TransferResult:
    """A transfer whose values were read back from flash; its entry is open until the values are verified."""

    entry: JournalEntry
    registers_read: Mapping[str, float]


def restart_and_read_registers(imu: Imu) -> dict[str, float]:
    """Restart the unit and return the registers in its flash, SI; uncommitted values are lost."""
    imu.reset()
    return imu.read_registers()


def transfer(
    imu: Imu,
    registers: RegisterMap,
    serial: str,
    values: Mapping[str, float],
    begin: Begin,
    old: Mapping[str, float] | None = None,
) -> TransferResult:
    """Write the parameters that have registers; all other registers keep their values.

    Raises DeviceFaultError if another unit replies, a value is outside the range of its register, the link fails, or a
    register reads back differently.

    Parameters
    ----------
    imu, registers, serial : the unit, its register map and its serial number
    values : new values by parameter name, SI; names without a register are ignored
    begin : function that records the intended change before anything is written
    old : result of `restart_and_read_registers`; None if it was not called immediately before
    """
    check_serial(imu, serial)
    old = restart_and_read_registers(imu) if old is None else dict(old)
    new = registers.rounded({**old, **{name: value for name, value in values.items() if name in old}})
    entry = begin(old, new)
    return _write_and_compare(imu, registers, entry, entry.new)


def finish(imu: Imu, registers: RegisterMap, entry: JournalEntry) -> TransferResult:
    """Complete an open entry; write only if the new values are not in flash. Raises the errors of `transfer`."""
    if read_flash_content(imu, entry, registers) is FlashContent.NEW:
        entry.note(TransferStep.RESTARTED)
        return TransferResult(entry, dict(entry.new))
    return _write_and_compare(imu, registers, entry, entry.new)


def restore(imu: Imu, registers: RegisterMap, entry: JournalEntry) -> Mapping[str, float]:
    """Restore the old values, close the entry and return the unit's values. Raises the errors of `transfer`."""
    if read_flash_content(imu, entry, registers) is FlashContent.OLD:
        entry.close(TransferOutcome.KEPT)
        return dict(entry.old)
    registers_read = rewrite_old(imu, registers, entry).registers_read
    entry.close(TransferOutcome.RESTORED)
    return registers_read


def rewrite_old(imu: Imu, registers: RegisterMap, entry: JournalEntry) -> TransferResult:
    """Write the old values of an entry, which remains open. Raises the errors of `transfer`."""
    entry.note(TransferStep.RESTORING)
    return _write_and_compare(imu, registers, entry, entry.old)


def read_flash_content(imu: Imu, entry: JournalEntry, registers: RegisterMap) -> FlashContent:
    """Restart the unit and determine which values are in its flash.

    Raises DeviceFaultError if another unit replies or the link fails.
    """
    check_serial(imu, entry.serial)
    registers_read = restart_and_read_registers(imu)
    if not registers.differing_parameters(entry.new, registers_read):
        return FlashContent.NEW
    return FlashContent.NEITHER if registers.differing_parameters(entry.old, registers_read) else FlashContent.OLD


def check_serial(imu: Imu, serial: str) -> None:
    """Check that the unit on the link has this serial number. Raises DeviceFaultError."""
    reported = imu.identify().serial
    if reported != serial:
        raise DeviceFaultError("imu.other_unit", found=reported, serial=serial)


def _write_and_compare(
    imu: Imu, registers: RegisterMap, entry: JournalEntry, required: Mapping[str, float]
) -> TransferResult:
    try:
        imu.write_registers(required)
        _compare(registers, required, imu.read_registers(), restarted=False)
        entry.note(TransferStep.WRITTEN)
        entry.note(TransferStep.COMMITTING)
        imu.commit()
        entry.note(TransferStep.COMMITTED)
        imu.reset()
        registers_read = imu.read_registers()
        _compare(registers, required, registers_read, restarted=True)
        entry.note(TransferStep.RESTARTED)
    except CalstationError as error:
        raise _with_flash_content(imu, registers, entry, error) from error
    return TransferResult(entry, registers_read)


def _with_flash_content(
    imu: Imu, registers: RegisterMap, entry: JournalEntry, error: CalstationError
) -> CalstationError:
    """Return an error that also states which values are in flash; close the entry if they are the old ones."""
    kind, values = type(error), {**error.values, "serial": entry.serial, "cause": error.as_text}
    try:
        content = read_flash_content(imu, entry, registers)
    except CalstationError:
        return kind("imu.holds_unknown", **values)
    if content is FlashContent.OLD:
        with suppress(CalstationError):  # `error` itself reports a failure of the disk
            entry.close(TransferOutcome.KEPT)
        return kind("imu.holds_old", **values)
    return kind("imu.holds_new" if content is FlashContent.NEW else "imu.holds_neither", **values)


def _compare(
    registers: RegisterMap, required: Mapping[str, float], registers_read: Mapping[str, float], *, restarted: bool
) -> None:
    for name in registers.differing_parameters(required, registers_read):
        values = {"name": name, "found": registers_read.get(name, float("nan")), "wanted": required[name]}
        code = "imu.restarted_differently" if restarted else "imu.reads_back_differently"
        raise DeviceFaultError(code, address=registers.address(name), **values)
