"""Writing of a unit's registers so that, after a power cut at any time, they can be identified as old or new.

The transfer verifies the serial number, restarts the unit so that its registers have the values of its flash, saves
them, records the intended change, writes, reads back bit by bit, commits, restarts, and reads again. The journal entry
stays open until the corrected output is verified on new data; an open entry contains the old and the new values, so
that the next start can determine which of them the unit holds.
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
    """Steps of a transfer as recorded in its journal; each step is on disk before the next begins.

    `TURNED` and `AT_REST` state that the output was verified with rotations, or at rest only; `READ_BACK` that the unit
    has no output with its registers applied, so that they were only read back.
    From `COMMITTING` on, the commit counts as a flash cycle of the unit, whether its reply arrives or not.
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
    """Outcome of a transfer: new values in flash and verified, old values kept, or old values restored."""

    DONE = "done"
    KEPT = "kept"
    RESTORED = "restored"


class Holds(StrEnum):
    """Values that the flash of a restarted unit contains."""

    OLD = "old"
    NEW = "new"
    NEITHER = "neither"


class Entry(Protocol):
    """A transfer in the journal, with the unit's old values and the new ones to write, by parameter, SI.

    Both methods return when the record is on disk, or raise a CalstationError.
    """

    serial: str
    old: Mapping[str, float]
    new: Mapping[str, float]

    def note(self, step: Step) -> None:
        """Record a step."""

    def close(self, closing: Closing) -> None:
        """Record the outcome."""


#: Function that records an intended change of the registers from old to new, by parameter, SI; on disk when it returns.
Begin = Callable[[Mapping[str, float], Mapping[str, float]], Entry]


@dataclass(frozen=True)
class Transferred:
    """A transfer whose values are in the unit's flash and were read back; its entry is open until they are verified."""

    entry: Entry
    registers_read: Mapping[str, float]


def flash_registers(imu: Imu) -> dict[str, float]:
    """Restart the unit and read its registers as stored in flash, SI; uncommitted values are lost."""
    imu.reset()
    return imu.read_registers()


def transfer(
    imu: Imu,
    registers: RegisterMap,
    serial: str,
    values: Mapping[str, float],
    begin: Begin,
    old: Mapping[str, float] | None = None,
) -> Transferred:
    """Write the parameters that have registers; registers of other parameters keep their values.

    values : new values by contract name, SI; names without a register are ignored
    begin : function that records the intended change before anything is written
    old : the unit's `flash_registers` if they were just read; None to read them here

    Raises DeviceFaultError if another unit replies, a value does not fit, the link fails, or a register reads back
    differently.
    """
    check_serial(imu, serial)
    old = flash_registers(imu) if old is None else dict(old)
    new = registers.rounded({**old, **{name: value for name, value in values.items() if name in old}})
    entry = begin(old, new)
    return _put(imu, registers, entry, entry.new)


def finish(imu: Imu, registers: RegisterMap, entry: Entry) -> Transferred:
    """Complete an open entry; writes nothing if the flash already has the new values. Raises like `transfer`."""
    if recognise(imu, entry, registers) is Holds.NEW:
        entry.note(Step.RESTARTED)
        return Transferred(entry, dict(entry.new))
    return _put(imu, registers, entry, entry.new)


def restore(imu: Imu, registers: RegisterMap, entry: Entry) -> Mapping[str, float]:
    """Restore the old values of an open entry and close it; returns the unit's values. Raises like `transfer`."""
    if recognise(imu, entry, registers) is Holds.OLD:
        entry.close(Closing.KEPT)
        return dict(entry.old)
    registers_read = put_back(imu, registers, entry).registers_read
    entry.close(Closing.RESTORED)
    return registers_read


def put_back(imu: Imu, registers: RegisterMap, entry: Entry) -> Transferred:
    """Write the old values of an open entry and leave it open. Raises like `transfer`."""
    entry.note(Step.RESTORING)
    return _put(imu, registers, entry, entry.old)


def recognise(imu: Imu, entry: Entry, registers: RegisterMap) -> Holds:
    """Restart the unit and determine which values its flash contains.

    Raises DeviceFaultError if another unit replies or the link fails.
    """
    check_serial(imu, entry.serial)
    registers_read = flash_registers(imu)
    if not registers.differing(entry.new, registers_read):
        return Holds.NEW
    return Holds.NEITHER if registers.differing(entry.old, registers_read) else Holds.OLD


def check_serial(imu: Imu, serial: str) -> None:
    """Raise DeviceFaultError if another unit is on the link."""
    answered = imu.identify().serial
    if answered != serial:
        raise DeviceFaultError("imu.other_unit", found=answered, serial=serial)


def _put(imu: Imu, registers: RegisterMap, entry: Entry, required: Mapping[str, float]) -> Transferred:
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
    return Transferred(entry, registers_read)


def _explained(imu: Imu, registers: RegisterMap, entry: Entry, error: CalstationError) -> CalstationError:
    """Return the error with the values that the unit has now; close the entry if these are the old values."""
    kind, values = type(error), {**error.values, "serial": entry.serial, "cause": error.as_text}
    try:
        holds = recognise(imu, entry, registers)
    except CalstationError:
        return kind("imu.holds_unknown", **values)
    if holds is Holds.OLD:
        with suppress(CalstationError):  # the original error already reports a failing disk
            entry.close(Closing.KEPT)
        return kind("imu.holds_old", **values)
    return kind("imu.holds_new" if holds is Holds.NEW else "imu.holds_neither", **values)


def _compare(
    registers: RegisterMap, required: Mapping[str, float], registers_read: Mapping[str, float], *, restarted: bool
) -> None:
    for name in registers.differing(required, registers_read):
        values = {"name": name, "found": registers_read.get(name, float("nan")), "wanted": required[name]}
        code = "imu.restarted_differently" if restarted else "imu.reads_back_differently"
        raise DeviceFaultError(code, address=registers.address(name), **values)
