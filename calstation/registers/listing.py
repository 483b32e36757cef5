"""What was written into units, for a person to read: by unit and kind of station, and what each transfer changed."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from calstation.config import library
from calstation.config.library import site_folder
from calstation.devices.profiles.imu import load_imu_profile
from calstation.errors import ConfigurationError
from calstation.physics.parameters import PARAMETERS
from calstation.registers import journal as register_journal
from calstation.registers.journal import Kind, Transfer


@dataclass(frozen=True)
class UnitTransfers:
    """Transfers to the units of one serial number at one kind of station, oldest first."""

    serial: str
    kind: Kind
    transfers: tuple[Transfer, ...]

    @property
    def cycles(self) -> int:
        """Flash cycles that they cost."""
        return sum(transfer.cycles for transfer in self.transfers)


def transfers(runs: Path, serial: str | None) -> list[UnitTransfers]:
    """Of one unit, or of every unit that the site or the folder of runs knows.

    A virtual bench's unit and one on hardware of the same serial number stand apart. Raises ConfigurationError where
    a journal is damaged.
    """
    known = [*register_journal.serials(runs), *register_journal.serials(site_folder())]
    return [unit for name in sorted(set(known)) if serial in (None, name) for unit in _of(runs, name)]


def _of(runs: Path, serial: str) -> Iterator[UnitTransfers]:
    for kind, found in register_journal.apart(runs, serial, site_folder()).items():
        if found:
            yield UnitTransfers(serial, kind, tuple(found))


def largest_change(transfer: Transfer) -> str | None:
    """The parameter that changes most, by the prior sigma of the unit's profile; None where nothing changes."""
    sigmas = {p.name: p.prior_sigma for p in PARAMETERS} | _sigmas(transfer.sort.profile)
    changes = {
        name: abs(value - transfer.old.get(name, 0.0)) / sigmas[name]
        for name, value in transfer.new.items()
        if sigmas.get(name)
    }
    return max(changes, key=lambda name: changes[name]) if any(changes.values()) else None


@cache
def _sigmas(profile: str) -> dict[str, float]:
    """Prior sigmas of the IMU profile of a name, {} where there is none any more."""
    for name in library.names("imus"):
        try:
            found = load_imu_profile(library.find("imus", name))
        except ConfigurationError:
            continue
        if found.name == profile:
            return found.prior_sigmas()
    return {}
