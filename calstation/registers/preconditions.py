"""Preconditions for writing registers: remaining flash cycles, the correct unit type and no interrupted transfer.

Flash wear never prevents restoring old registers or finishing an interrupted transfer, because a unit must not be left
partially written.
"""

from pathlib import Path

from calstation.config import RunConfiguration
from calstation.devices import Imu
from calstation.devices.imu import FlashContent, TransferOutcome, read_flash_content
from calstation.errors import ConfigurationError, DeviceFaultError, InputError
from calstation.registers import journal
from calstation.registers.journal import Transfer, journal_folder, map_digest
from calstation.sequencer import Emit, Message

#: Fraction of the flash cycles above which a warning is emitted.
_WARNING_FRACTION = 0.9


def check_flash(setup: RunConfiguration, runs: Path, emit: Emit) -> None:
    """Check, before any device is opened, that the unit's flash may be written again; warn near the limit.

    Raises ConfigurationError if the profile's `flash_cycles_max` is reached or the journal is damaged.
    """
    serial = setup.request.serial
    folder = journal_folder(setup.station, runs)
    used, truncated = journal.cycles(folder, serial), journal.truncated(folder, serial)
    if truncated is not None:
        emit(Message("journal_torn", {"serial": serial, "file": str(truncated)}))
    limit = setup.imu.flash_cycles_max
    if limit is None or not setup.imu.registers:
        return
    if used >= limit:
        raise ConfigurationError("transfer.flash_worn", serial=serial, used=used, most=limit, profile=setup.imu.name)
    if used >= _WARNING_FRACTION * limit:
        emit(Message("flash_near", {"serial": serial, "used": used, "most": limit}))


def check_register_map(entry: Transfer, setup: RunConfiguration) -> None:
    """Raise InputError if a transfer does not match the product's registers; called before any device is opened.

    If no unit type was recorded, only the parameters are compared.
    """
    recorded, profile = entry.unit_type, setup.imu
    about = {"id": entry.id, "serial": entry.serial, "profile": profile.name}
    if recorded.profile and recorded.profile != profile.name:
        raise InputError("transfer.other_profile", **about, recorded=recorded.profile, product=recorded.product)
    if recorded.map and recorded.map != map_digest(profile.registers):
        raise InputError("transfer.other_meaning", **about)
    if not recorded.map and entry.old and set(entry.old) != set(setup.register_map.parameters):
        raise InputError("transfer.other_parameters", **about)


def check_product(entry: Transfer, setup: RunConfiguration) -> None:
    """Raise InputError if a transfer was made with another product, because a product defines who confirms writes."""
    recorded, product = entry.unit_type.product, setup.product.name
    if recorded and recorded != product:
        raise InputError("transfer.other_product", id=entry.id, serial=entry.serial, recorded=recorded, product=product)


def check_unit_model(entry: Transfer, model: str) -> None:
    """Raise DeviceFaultError if a transfer was made to a different model than the connected unit."""
    recorded = entry.unit_type.model
    if recorded and recorded != model:
        raise DeviceFaultError("transfer.other_model", id=entry.id, serial=entry.serial, recorded=recorded, model=model)


def check_interrupted(setup: RunConfiguration, runs: Path) -> None:
    """Raise InputError if an interrupted transfer does not match the product; called before any device is opened."""
    entry = journal.interrupted(journal_folder(setup.station, runs), setup.request.serial)
    if entry is not None:
        check_register_map(entry, setup)


def check_no_interrupted(imu: Imu, setup: RunConfiguration, runs: Path) -> None:
    """Raise DeviceFaultError if a transfer to the unit awaits a decision; close a transfer that changed nothing."""
    entry = journal.interrupted(journal_folder(setup.station, runs), setup.request.serial)
    if entry is not None:
        check_unit_model(entry, imu.identify().model)
        content = read_flash_content(imu, entry, setup.register_map)
        if content is not FlashContent.OLD:
            raise undecided(entry, content)
        entry.close(TransferOutcome.KEPT)


def undecided(entry: Transfer, content: FlashContent) -> DeviceFaultError:
    """Return the fault of a unit whose interrupted transfer awaits a decision."""
    return DeviceFaultError("transfer.interrupted", serial=entry.serial, utc=entry.utc, holds=str(content))
