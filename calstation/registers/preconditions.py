"""What must hold before registers are written: flash cycles left, the right type of unit, no interrupted transfer.

Restoring old registers and finishing an interrupted transfer is never refused for flash wear: a unit must not be left
half written.
"""

from pathlib import Path

from calstation.config import ResolvedConfiguration
from calstation.devices import Imu
from calstation.devices.imu import Closing, Holds, RegisterMap, recognise
from calstation.errors import ConfigurationError, DeviceFaultError, InputError
from calstation.registers import journal
from calstation.registers.journal import Transfer, journal_folder, map_digest
from calstation.sequencer import Emit, Message

#: Share of the flash cycles from which a warning is given.
_NEAR = 0.9


def register_map(setup: ResolvedConfiguration) -> RegisterMap:
    return RegisterMap(tuple(setup.imu.registers))


def check_flash(setup: ResolvedConfiguration, runs: Path, emit: Emit) -> None:
    """Check, before anything is opened, that the unit's flash may be written once more; warns when that is near."""
    serial = setup.request.serial
    site = journal_folder(setup.station)
    used = journal.cycles(runs, serial, site)
    truncated = journal.truncated(runs, serial, site)
    if truncated is not None:
        emit(Message("journal_torn", {"serial": serial, "file": str(truncated)}))
    most = setup.imu.flash_cycles_max
    if most is None or not setup.imu.registers:
        return
    if used >= most:
        raise ConfigurationError("transfer.flash_worn", serial=serial, used=used, most=most, profile=setup.imu.name)
    if used >= _NEAR * most:
        emit(Message("flash_near", {"serial": serial, "used": used, "most": most}))


def check_register_map(entry: Transfer, setup: ResolvedConfiguration) -> None:
    """Check, before anything is opened, that a transfer's values fit the product's registers; raises InputError.

    Without a recorded type only the parameters are compared.
    """
    recorded, profile = entry.unit_type, setup.imu
    about = {"id": entry.id, "serial": entry.serial, "profile": profile.name}
    if recorded.profile and recorded.profile != profile.name:
        raise InputError("transfer.other_profile", **about, recorded=recorded.profile, product=recorded.product)
    if recorded.map and recorded.map != map_digest(profile.registers):
        raise InputError("transfer.other_meaning", **about)
    if not recorded.map and entry.old and set(entry.old) != set(register_map(setup).parameters):
        raise InputError("transfer.other_parameters", **about)


def check_unit_model(entry: Transfer, model: str) -> None:
    """Raise DeviceFaultError if a transfer was to another model of unit than the one that answers."""
    recorded = entry.unit_type.model
    if recorded and recorded != model:
        raise DeviceFaultError("transfer.other_model", id=entry.id, serial=entry.serial, recorded=recorded, model=model)


def check_interrupted(setup: ResolvedConfiguration, runs: Path) -> None:
    """Check, before anything is opened, the type of unit of the interrupted transfer; raises InputError."""
    entry = journal.interrupted(runs, setup.request.serial, journal_folder(setup.station))
    if entry is not None:
        check_register_map(entry, setup)


def check_no_interrupted(imu: Imu, setup: ResolvedConfiguration, runs: Path) -> None:
    """Raise DeviceFaultError if a transfer to the unit awaits a decision; one that changed nothing is closed."""
    entry = journal.interrupted(runs, setup.request.serial, journal_folder(setup.station))
    if entry is not None:
        check_unit_model(entry, imu.identify().model)
        holds = recognise(imu, entry, register_map(setup))
        if holds is not Holds.OLD:
            raise undecided(entry, holds)
        entry.close(Closing.KEPT)


def undecided(entry: Transfer, holds: Holds) -> DeviceFaultError:
    """The fault of a unit whose interrupted transfer awaits a decision."""
    return DeviceFaultError("transfer.interrupted", serial=entry.serial, utc=entry.utc, holds=str(holds))
