"""Transfer of registers to a unit, after which they can be identified as old or new even if the power was cut.

A transfer checks the serial number, restarts the unit so that its registers have the values of its flash, reads these
values, and records the intended change. Then it writes the new values, compares them bit by bit, commits them, restarts
the unit and compares them again. The journal entry, which contains the old and the new values, remains open until the
corrected output is verified with new data; an open entry allows the next start to determine which values are in flash.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from calstation.devices.imu.registers import RegisterMap
from calstation.devices.interfaces import Imu
from calstation.errors import CalstationError, DeviceFaultError


class Step(StrEnum):
    """Steps of a transfer as recorded in its journal; each step is on disk before the next one begins.

    `TURNED` means that the output was verified with rotations, `AT_REST` that it was verified at rest only, and
    `READ_BACK` that the registers were only read back, because they are not applied to any output. `COMMITTING` counts
    as a flash cycle even if no reply arrives.
    """

    WRITTEN = "written"
    COMMITTING = "committing"
    COMMITTED = "committed"
    RESTARTED = "restarted"
    RESTORING = "restoring"
    REFUTED = "refuted"
    TURNED = "turned"
    AT_REST = "at_rest"
    READ_BACK = "read_back"


class Closing(StrEnum):
    """Outcome of a transfer: the new values were verified, the old values were kept, or they were restored."""

    DONE = "done"
    KEPT = "kept"
    RESTORED = "restored"


class FlashContent(StrEnum):
    """The values that the flash of a restarted unit contains."""

    OLD = "old"
    NEW = "new"
    NEITHER = "neither"


class Entry(Protocol):
    """A transfer in the journal, with the unit's old values and the new values to write, by parameter, SI.

    Both methods return once the record is on disk, or raise CalstationError.
    """

    serial: str
    old: Mapping[str, float]
    new: Mapping[str, float]

    def note(self, step: Step) -> None:
        """Record a step."""

    def close(self, closing: Closing) -> None:
        """Record the outcome."""


#: Function that records an intended change from old to new values, by parameter, SI, and returns once it is on disk.
Begin = Callable[[Mapping[str, float], Mapping[str, float]], Entry]


@dataclass(frozen=True)
class TransferResult:
    """A transfer whose values were read back from flash; its entry is open until the values are verified."""

    entry: Entry
    registers_read: Mapping[str, float]


def flash_registers(imu: Imu) -> dict[str, float]:
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
    old : the unit's `flash_registers` if they have just been read
    """
    check_serial(imu, serial)
    old = flash_registers(imu) if old is None else dict(old)
    new = registers.rounded({**old, **{name: value for name, value in values.items() if name in old}})
    entry = begin(old, new)
    return _write_and_compare(imu, registers, entry, entry.new)


def finish(imu: Imu, registers: RegisterMap, entry: Entry) -> TransferResult:
    """Complete an open entry; write only if the flash lacks the new values. Raises the errors of `transfer`."""
    if read_flash_content(imu, entry, registers) is FlashContent.NEW:
        entry.note(Step.RESTARTED)
        return TransferResult(entry, dict(entry.new))
    return _write_and_compare(imu, registers, entry, entry.new)


def restore(imu: Imu, registers: RegisterMap, entry: Entry) -> Mapping[str, float]:
    """Restore the old values, close the entry and return the unit's values. Raises the errors of `transfer`."""
    if read_flash_content(imu, entry, registers) is FlashContent.OLD:
        entry.close(Closing.KEPT)
        return dict(entry.old)
    registers_read = rewrite_old(imu, registers, entry).registers_read
    entry.close(Closing.RESTORED)
    return registers_read


def rewrite_old(imu: Imu, registers: RegisterMap, entry: Entry) -> TransferResult:
    """Write the old values of an entry, which remains open. Raises the errors of `transfer`."""
    entry.note(Step.RESTORING)
    return _write_and_compare(imu, registers, entry, entry.old)


def read_flash_content(imu: Imu, entry: Entry, registers: RegisterMap) -> FlashContent:
    """Restart the unit and determine which values are in its flash.

    Raises DeviceFaultError if another unit replies or the link fails.
    """
    check_serial(imu, entry.serial)
    registers_read = flash_registers(imu)
    if not registers.differing(entry.new, registers_read):
        return FlashContent.NEW
    return FlashContent.NEITHER if registers.differing(entry.old, registers_read) else FlashContent.OLD


def check_serial(imu: Imu, serial: str) -> None:
    """Check that the unit on the link has this serial number. Raises DeviceFaultError."""
    reported = imu.identify().serial
    if reported != serial:
        raise DeviceFaultError("imu.other_unit", found=reported, serial=serial)


def _write_and_compare(imu: Imu, registers: RegisterMap, entry: Entry, required: Mapping[str, float]) -> TransferResult:
    try:
        imu.write_registers(required)
        _compare(registers, required, imu.read_registers(), restarted=False)
        entry.note(Step.WRITTEN)
        entry.note(Step.COMMITTING)
        imu.commit()
        entry.note(Step.COMMITTED)
        imu.reset()
        registers_read = imu.read_registers()
        _compare(registers, required, registers_read, restarted=True)
        entry.note(Step.RESTARTED)
    except CalstationError as error:
        raise _explained(imu, registers, entry, error) from error
    return TransferResult(entry, registers_read)


def _explained(imu: Imu, registers: RegisterMap, entry: Entry, error: CalstationError) -> CalstationError:
    """Add the current values of the unit to an error and return it; close the entry if they are the old values."""
    kind, values = type(error), {**error.values, "serial": entry.serial, "cause": error.as_text}
    try:
        holds = read_flash_content(imu, entry, registers)
    except CalstationError:
        return kind("imu.holds_unknown", **values)
    if holds is FlashContent.OLD:
        with suppress(CalstationError):  # `error` itself reports a failure of the disk
            entry.close(Closing.KEPT)
        return kind("imu.holds_old", **values)
    return kind("imu.holds_new" if holds is FlashContent.NEW else "imu.holds_neither", **values)


def _compare(
    registers: RegisterMap, required: Mapping[str, float], registers_read: Mapping[str, float], *, restarted: bool
) -> None:
    for name in registers.differing(required, registers_read):
        values = {"name": name, "found": registers_read.get(name, float("nan")), "wanted": required[name]}
        code = "imu.restarted_differently" if restarted else "imu.reads_back_differently"
        raise DeviceFaultError(code, address=registers.address(name), **values)
