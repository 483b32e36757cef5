"""The products that a station can calibrate, and the one with which it starts."""

from dataclasses import replace
from pathlib import Path

from calstation.config import library
from calstation.config.product import DEFAULT_PRODUCT
from calstation.config.request import RunRequest
from calstation.config.run_configuration import RunConfiguration, check_station, load_configuration
from calstation.config.station import load_station
from calstation.errors import ConfigurationError


def compatible_products(station: Path | None, instead_of: Path | None) -> list[tuple[str, Path]]:
    """Return the name and file of each product that the station can calibrate, products with the same IMU first."""
    try:
        imu = load_configuration(RunRequest("-", station, instead_of)).product.imu
    except ConfigurationError:
        imu = None
    products = []
    for name in library.names("products"):
        path = library.find("products", name)
        setup = _setup(station, path)
        if setup is not None:
            products.append((imu not in (None, setup.product.imu), name, path))
    return [(name, path) for _, name, path in sorted(products)]


def with_product(request: RunRequest) -> RunRequest:
    """Return a request without a product with that of the station file or the first that the station can calibrate.

    A request remains without a product, which means `DEFAULT_PRODUCT`, if the station can calibrate that product or
    none at all. A request that resumes a run has the product of the log. Raises ConfigurationError if the station file
    cannot be used.
    """
    if request.product is not None or request.resume is not None:
        return request
    name = load_station(request.station)[1].product
    if name is not None:
        return replace(request, product=library.find("products", name))
    default = library.find("products", DEFAULT_PRODUCT)
    if _setup(request.station, default) is not None:
        return request
    paths = [path for _, path in compatible_products(request.station, default)]
    return replace(request, product=next(iter(paths), None))


def _setup(station: Path | None, product: Path) -> RunConfiguration | None:
    """Return the configuration of a product at a station, or None if the station cannot calibrate the product."""
    try:
        setup = load_configuration(RunRequest("-", station, product))
        check_station(setup)
    except ConfigurationError:
        return None
    return setup
