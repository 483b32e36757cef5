"""Registers of one sort of unit never reach a unit of another, whatever serial number both have."""

from calstation.config.resolved import ResolvedConfiguration
from calstation.devices.imu.registers import RegisterMap
from calstation.errors import DeviceFaultError, InputError
from calstation.registers.journal import Transfer
from calstation.registers.unit_type import map_digest


def refuse_other_map(entry: Transfer, setup: ResolvedConfiguration) -> None:
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


def refuse_other_model(entry: Transfer, model: str) -> None:
    """Raises DeviceFaultError where a transfer was to another model of unit than the one that answers."""
    if entry.sort.model and entry.sort.model != model:
        raise DeviceFaultError(
            f"IMU: transfer {entry.id} was to a '{entry.sort.model}' of serial number '{entry.serial}', but a"
            f" '{model}' answers; put that unit into the fixture"
        )
