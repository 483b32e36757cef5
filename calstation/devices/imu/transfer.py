"""Puts values into a unit's registers so that a power cut at any moment leaves them recognisably old or new.

Verify the serial number, restart the unit so that it shows its flash, save what that holds, put the intention down,
write, read back bit for bit, commit, restart, read again. The entry of the journal stays open until somebody has proved
the corrected output on fresh data and closes it; an entry left open says what the unit held before and what it was to
hold, so the next start can tell which of the two it holds now.
"""

import struct
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from calstation.devices.imu.registers import RegisterMap
from calstation.devices.interfaces import Imu
from calstation.errors import CalstationError, DeviceFaultError


class Step(StrEnum):
    """How far a transfer has come, as its journal notes it: each on disk before the next begins.

    `TURNED` and `AT_REST` say what proved the output behind it: turns as well, or a rest alone; `READ_BACK` that the
    unit shows no output with its registers, so that they were only read back.
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
    """How an entry ends: the new values in flash and proved, the old ones still there, or there again."""

    DONE = "done"
    KEPT = "kept"
    RESTORED = "restored"


class Holds(StrEnum):
    """Which values a restarted unit holds."""

    OLD = "old"
    NEW = "new"
    NEITHER = "neither"


class Entry(Protocol):
    """A transfer in the journal. Both calls return when it is on disk; they raise a CalstationError where it cannot."""

    @property
    def serial(self) -> str:
        """The unit's serial number."""

    @property
    def old(self) -> Mapping[str, float]:
        """What the unit held, by parameter, SI."""

    @property
    def new(self) -> Mapping[str, float]:
        """What it is to hold, by parameter, SI."""

    def note(self, step: Step) -> None:
        """Put down how far it has come."""

    def close(self, closing: Closing) -> None:
        """Put down how it ended."""


#: Puts an intention down: old and new registers by parameter, SI; on disk when it returns.
Begin = Callable[[Mapping[str, float], Mapping[str, float]], Entry]


@dataclass(frozen=True)
class Transferred:
    """A transfer that is in the unit's flash and read back from it; its entry is open until it is proved."""

    entry: Entry
    found: Mapping[str, float]


def flash_registers(imu: Imu) -> dict[str, float]:
    """Restart the unit and read what its flash holds, SI: what somebody wrote and never committed is gone.

    Raises DeviceFaultError.
    """
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

    Parameters
    ----------
    serial : of the unit that is meant
    values : new values by contract name, SI; names without a register are left aside
    begin : puts the intention down before anything is written
    old : its `flash_registers`, where they were just read; read here where None

    Raises
    ------
    DeviceFaultError
        where another unit answers, a value does not fit, the link fails, or a register does not read back.
    """
    check_serial(imu, serial)
    old = flash_registers(imu) if old is None else dict(old)
    new = registers.rounded({**old, **{name: value for name, value in values.items() if name in old}})
    entry = begin(old, new)
    return _put(imu, registers, entry, entry.new)


def finish(imu: Imu, registers: RegisterMap, entry: Entry) -> Transferred:
    """Go on with an open entry: nothing is written again where the unit's flash holds the new values already.

    Raises DeviceFaultError as `transfer`.
    """
    if recognise(imu, entry, registers) is Holds.NEW:
        entry.note(Step.RESTARTED)
        return Transferred(entry, dict(entry.new))
    return _put(imu, registers, entry, entry.new)


def restore(imu: Imu, registers: RegisterMap, entry: Entry) -> Mapping[str, float]:
    """Put the old values of an open entry back and close it; returns what the unit holds then.

    Raises DeviceFaultError as `transfer`.
    """
    if recognise(imu, entry, registers) is Holds.OLD:
        entry.close(Closing.KEPT)
        return dict(entry.old)
    found = put_back(imu, registers, entry).found
    entry.close(Closing.RESTORED)
    return found


def put_back(imu: Imu, registers: RegisterMap, entry: Entry) -> Transferred:
    """Write the old values of an open entry, and leave it open. Raises DeviceFaultError as `transfer`."""
    entry.note(Step.RESTORING)
    return _put(imu, registers, entry, entry.old)


def recognise(imu: Imu, entry: Entry, registers: RegisterMap | None = None) -> Holds:
    """Restart the unit, so that it shows its flash, and say which values of an entry that holds.

    `registers` : the unit's map, for those that it gives back with a tolerance only. Raises DeviceFaultError where
    another unit answers or the link fails.
    """
    check_serial(imu, entry.serial)
    found = flash_registers(imu)
    differ = differing if registers is None else registers.differing
    if not differ(entry.new, found):
        return Holds.NEW
    return Holds.NEITHER if differ(entry.old, found) else Holds.OLD


def check_serial(imu: Imu, serial: str) -> None:
    """Raises DeviceFaultError where the unit on the link is another than the one meant."""
    found = imu.identify().serial
    if found != serial:
        raise DeviceFaultError(
            f"IMU: unit '{found}' is in the fixture, the values are for '{serial}'; nothing was written;"
            " change the unit or open its own result"
        )


def differing(wanted: Mapping[str, float], found: Mapping[str, float]) -> list[str]:
    """Parameters of which not every bit is the same: an erased NaN equals itself, −0 is not 0."""
    return [name for name, value in wanted.items() if name not in found or _bits(found[name]) != _bits(value)]


def _bits(value: float) -> bytes:
    return struct.pack("<d", value)


def _put(imu: Imu, registers: RegisterMap, entry: Entry, wanted: Mapping[str, float]) -> Transferred:
    try:
        imu.write_registers(wanted)
        _compare(registers, wanted, imu.read_registers(), "before the commit")
        entry.note(Step.WRITTEN)
        entry.note(Step.COMMITTING)
        imu.commit()
        entry.note(Step.COMMITTED)
        imu.reset()
        found = imu.read_registers()
        _compare(registers, wanted, found, "after the restart")
        entry.note(Step.RESTARTED)
    except CalstationError as error:
        raise _explained(imu, registers, entry, error) from error
    return Transferred(entry, found)


def _explained(imu: Imu, registers: RegisterMap, entry: Entry, error: CalstationError) -> CalstationError:
    """The error with what the unit holds now. Back at its old values the entry is closed, else it stays open."""
    try:
        holds = recognise(imu, entry, registers)
    except CalstationError:
        return type(error)(f"{error}; what the unit's flash holds will be seen at the next start")
    if holds is Holds.OLD:
        with suppress(CalstationError):  # told by the error in hand: the journal's disk is the same
            entry.close(Closing.KEPT)
        return type(error)(f"{error}; the unit was restarted and holds its old registers")
    which = "new registers, not yet proved" if holds is Holds.NEW else "neither old nor new registers"
    return type(error)(
        f"{error}; the unit holds {which}: calstation registers finish (or restore) {entry.serial}"
    )


def _compare(
    registers: RegisterMap, wanted: Mapping[str, float], found: Mapping[str, float], when: str
) -> None:
    for name in registers.differing(wanted, found):
        raise DeviceFaultError(
            f"IMU: register {registers.address(name)} ({name}) reads back {found.get(name, float('nan')):.9g}"
            f" instead of {wanted[name]:.9g} {when}; look at the unit's supply and write protection, then check type,"
            " orders and tolerance of this register in the IMU profile"
        )
