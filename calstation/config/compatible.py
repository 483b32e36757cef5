"""The products that a station can calibrate, and the product with which it starts."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from calstation.config import library
from calstation.config.configuration_checks import ManualRigError, check_station
from calstation.config.request import RunRequest
from calstation.config.run_configuration import load_configuration
from calstation.config.station import load_station
from calstation.errors import ConfigurationError


def product_error(station: Path | None, product: Path) -> ConfigurationError | None:
    """Return why a station cannot calibrate a product, or None if it can."""
    try:
        check_station(load_configuration(RunRequest("-", station, product)))
    except ConfigurationError as error:
        return error
    return None


def compatible_products(station: Path | None, instead_of: Path | None) -> list[tuple[str, Path]]:
    """Return the name and file of each product that the station can calibrate, products with the same IMU first."""
    try:
        imu = load_configuration(RunRequest("-", station, instead_of)).product.imu
    except ConfigurationError:
        imu = None
    products = []
    for name in library.names("products"):
        path = library.find("products", name)
        with suppress(ConfigurationError):
            setup = load_configuration(RunRequest("-", station, path))
            check_station(setup)
            products.append((imu not in (None, setup.product.imu), name, path))
    return [(name, path) for _, name, path in sorted(products)]


def with_product(request: RunRequest) -> RunRequest:
    """Add the station file's product, or the first that the station can calibrate, to a request without a product.

    The first product that the station can calibrate is used only if `DEFAULT_PRODUCT`, the product of a request without
    one, needs another kind of station: an error in the files of the station must not start a run of another product. A
    request that resumes a run has the product of the log. Raises ConfigurationError if the station file cannot be used.
    """
    if request.product is not None or request.resume is not None:
        return request
    name = load_station(request.station)[1].product
    if name is not None:
        return replace(request, product=library.find("products", name))
    try:
        check_station(load_configuration(replace(request, serial="-", stages=None)))
    except ManualRigError:
        paths = [path for _, path in compatible_products(request.station, None)]
        return replace(request, product=next(iter(paths), None))
    except ConfigurationError:  # the start of the run reports it
        pass
    return request
