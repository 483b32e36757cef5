"""Writes values to a unit's registers so that a power cut at any moment leaves them recognisably old or new.

Verify the serial number, restart the unit so that its registers are those of its flash, save them, record the
intention, write, read back bit for bit, commit, restart, read again. The entry of the journal stays open until the
corrected output is verified on new data; an open entry holds the old and the new values, so that the next start can
tell which of them the unit holds.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from calstation.devices import Imu
from calstation.devices.imu.registers import RegisterMap
from calstation.errors import CalstationError, DeviceFaultError


class Step(StrEnum):
    """Progress of a transfer in its journal: each step is on disk before the next begins.

    `TURNED` and `AT_REST` state how the output was verified: with turns, or at rest only; `READ_BACK` that the unit
    shows no output with its registers, so that they were only read back.
    A commit costs the unit a flash cycle from `COMMITTING` on, whether its answer comes or not.
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
    """How an entry ends: new values in flash and verified, old values kept, or old values restored."""

    DONE = "done"
    KEPT = "kept"
    RESTORED = "restored"


class Holds(StrEnum):
    """Which values a restarted unit holds."""

    OLD = "old"
    NEW = "new"
    NEITHER = "neither"


class Entry(Protocol):
    """A transfer in the journal: what the unit held and is to hold, by parameter, SI.

    Both calls return when it is on disk, or raise a CalstationError.
    """

    serial: str
    old: Mapping[str, float]
    new: Mapping[str, float]

    def note(self, step: Step) -> None:
        """Record a step."""

    def close(self, closing: Closing) -> None:
        """Record how it ended."""


#: Records an intention: old and new registers by parameter, SI; on disk when it returns.
Begin = Callable[[Mapping[str, float], Mapping[str, float]], Entry]


@dataclass(frozen=True)
class Transferred:
    """A transfer that is in the unit's flash and read back from it; its entry is open until it is verified."""

    entry: Entry
    found: Mapping[str, float]


def flash_registers(imu: Imu) -> dict[str, float]:
    """Restart the unit and read the registers of its flash, SI; uncommitted values are lost."""
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
    begin : records the intention before anything is written
    old : the unit's `flash_registers` if just read; None to read them here

    Raises DeviceFaultError: another unit answers, a value does not fit, the link fails, or a register reads back
    differently.
    """
    check_serial(imu, serial)
    old = flash_registers(imu) if old is None else dict(old)
    new = registers.rounded({**old, **{name: value for name, value in values.items() if name in old}})
    entry = begin(old, new)
    return _put(imu, registers, entry, entry.new)


def finish(imu: Imu, registers: RegisterMap, entry: Entry) -> Transferred:
    """Continue an open entry; writes nothing if the flash holds the new values already. Raises as `transfer`."""
    if recognise(imu, entry, registers) is Holds.NEW:
        entry.note(Step.RESTARTED)
        return Transferred(entry, dict(entry.new))
    return _put(imu, registers, entry, entry.new)


def restore(imu: Imu, registers: RegisterMap, entry: Entry) -> Mapping[str, float]:
    """Restore the old values of an open entry and close it; returns what the unit then holds. Raises as `transfer`."""
    if recognise(imu, entry, registers) is Holds.OLD:
        entry.close(Closing.KEPT)
        return dict(entry.old)
    found = put_back(imu, registers, entry).found
    entry.close(Closing.RESTORED)
    return found


def put_back(imu: Imu, registers: RegisterMap, entry: Entry) -> Transferred:
    """Write the old values of an open entry and leave it open. Raises as `transfer`."""
    entry.note(Step.RESTORING)
    return _put(imu, registers, entry, entry.old)


def recognise(imu: Imu, entry: Entry, registers: RegisterMap) -> Holds:
    """Restart the unit and determine which values its flash holds; raises DeviceFaultError for another unit."""
    check_serial(imu, entry.serial)
    found = flash_registers(imu)
    if not registers.differing(entry.new, found):
        return Holds.NEW
    return Holds.NEITHER if registers.differing(entry.old, found) else Holds.OLD


def check_serial(imu: Imu, serial: str) -> None:
    found = imu.identify().serial
    if found != serial:
        raise DeviceFaultError("imu.other_unit", found=found, serial=serial)


def _put(imu: Imu, registers: RegisterMap, entry: Entry, wanted: Mapping[str, float]) -> Transferred:
    try:
        imu.write_registers(wanted)
        _compare(registers, wanted, imu.read_registers(), restarted=False)
        entry.note(Step.WRITTEN)
        entry.note(Step.COMMITTING)
        imu.commit()
        entry.note(Step.COMMITTED)
        imu.reset()
        found = imu.read_registers()
        _compare(registers, wanted, found, restarted=True)
        entry.note(Step.RESTARTED)
    except CalstationError as error:
        raise _explained(imu, registers, entry, error) from error
    return Transferred(entry, found)


def _explained(imu: Imu, registers: RegisterMap, entry: Entry, error: CalstationError) -> CalstationError:
    """The error with what the unit holds now. The entry is closed if these are the old values, else it stays open."""
    kind, values = type(error), {**error.values, "serial": entry.serial, "cause": error.as_text}
    try:
        holds = recognise(imu, entry, registers)
    except CalstationError:
        return kind("imu.holds_unknown", **values)
    if holds is Holds.OLD:
        with suppress(CalstationError):  # the given error reports the same disk
            entry.close(Closing.KEPT)
        return kind("imu.holds_old", **values)
    return kind("imu.holds_new" if holds is Holds.NEW else "imu.holds_neither", **values)


def _compare(
    registers: RegisterMap, wanted: Mapping[str, float], found: Mapping[str, float], *, restarted: bool
) -> None:
    for name in registers.differing(wanted, found):
        values = {"name": name, "found": found.get(name, float("nan")), "wanted": wanted[name]}
        code = "imu.restarted_differently" if restarted else "imu.reads_back_differently"
        raise DeviceFaultError(code, address=registers.address(name), **values)
