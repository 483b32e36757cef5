"""What a unit's flash has left: said in time, and no new registers for one that is worn out.

Putting old registers back, and finishing what was begun, is never refused: a unit must not be left half written.
"""

from pathlib import Path

from calstation.config.resolved import ResolvedConfiguration
from calstation.devices.imu.registers import RegisterMap
from calstation.errors import ConfigurationError, DeviceFaultError, InputError
from calstation.registers import journal as register_journal
from calstation.registers.journal import Transfer, journal_folder, map_digest
from calstation.sequencer.context import Emit
from calstation.sequencer.events import Message

#: Share of the cycles from which on it is told.
_NEAR = 0.9


def check_flash(setup: ResolvedConfiguration, runs: Path, emit: Emit) -> None:
    """Before new registers, and before anything is opened: may the unit's flash be written once more?

    Raises ConfigurationError where its profile's `flash_cycles_max` is reached, or its journal is damaged.
    """
    serial = setup.request.serial
    site = journal_folder(setup.station)
    used = register_journal.cycles(runs, serial, site)
    torn = register_journal.torn(runs, serial, site)
    if torn is not None:
        emit(Message("journal_torn", {"serial": serial, "file": str(torn)}))
    most = setup.imu.flash_cycles_max
    if most is None or not setup.imu.registers:
        return
    if used >= most:
        raise ConfigurationError(
            f"IMU: unit '{serial}' has had its flash written {used} times of the {most} that IMU profile"
            f" '{setup.imu.name}' allows (flash_cycles_max); take it out of service, or correct the profile where its"
            " data sheet allows more"
        )
    if used >= _NEAR * most:
        emit(Message("flash_near", {"serial": serial, "used": used, "most": most}))


def check_register_map(entry: Transfer, setup: ResolvedConfiguration) -> None:
    """Before anything is opened: are a transfer's values for registers as the product's IMU profile has them?

    Of one that was noted without its sort only the parameters tell. Raises InputError with the mend.
    """
    sort, profile = entry.sort, setup.imu
    about = f"transfer {entry.id} to unit '{entry.serial}'"
    if sort.profile and sort.profile != profile.name:
        raise InputError(
            f"{about} was by IMU profile '{sort.profile}' (product '{sort.product}'), this product's is"
            f" '{profile.name}'; choose a product with that profile (--product)"
        )
    if sort.map and sort.map != map_digest(profile.registers):
        raise InputError(
            f"{about}: the registers of IMU profile '{profile.name}' mean something else now than then; bring the"
            " profile's earlier version back (page Station)"
        )
    named = set(RegisterMap(tuple(profile.registers)).parameters)
    if not sort.map and entry.old and set(entry.old) != named:
        raise InputError(
            f"{about} has other parameters than the registers of IMU profile '{profile.name}'; choose the product of"
            " its unit (--product)"
        )


def check_unit_model(entry: Transfer, model: str) -> None:
    """Raises DeviceFaultError where a transfer was to another model of unit than the one that answers."""
    if entry.sort.model and entry.sort.model != model:
        raise DeviceFaultError(
            f"IMU: transfer {entry.id} was to a '{entry.sort.model}' of serial number '{entry.serial}', but a"
            f" '{model}' answers; put that unit into the fixture"
        )
