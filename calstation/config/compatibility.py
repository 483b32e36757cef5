"""Which products a station can calibrate as their files stand: for the operator, who chooses products and no stages."""

from pathlib import Path

from calstation.config import library
from calstation.config.request import RunRequest
from calstation.config.resolved import ResolvedConfiguration, check_station, resolve_configuration
from calstation.errors import ConfigurationError


def compatible_products(station: Path | None, instead_of: Path | None) -> list[tuple[str, Path]]:
    """Name and file of every product that fits the station, those for the units of `instead_of` first.

    A product that cannot be read fits no station.
    """
    wanted = _read(RunRequest("-", station, instead_of))
    found = []
    for name in library.names("products"):
        path = library.find("products", name)
        setup = _read(RunRequest("-", station, path))
        if setup is None:
            continue
        try:
            check_station(setup)
        except ConfigurationError:
            continue
        other = wanted is None or setup.product.imu != wanted.product.imu
        found.append((other, name, path))
    return [(name, path) for _, name, path in sorted(found)]


def _read(request: RunRequest) -> ResolvedConfiguration | None:
    try:
        return resolve_configuration(request)
    except ConfigurationError:
        return None
