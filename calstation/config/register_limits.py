"""Do a product's limits and its unit's registers fit together: what may pass can be written, and finely enough."""

from collections.abc import Iterator

from calstation.config.station import ProductConfig
from calstation.devices.codecs.conventions import SLOTS, Convention, legal_range, parameter_of
from calstation.devices.profiles.imu import ImuProfile
from calstation.devices.profiles.registers import RegisterEntry
from calstation.physics.parameters import NAMES, PARAMETERS
from calstation.records.limits import Limit

#: Standard deviation of rounding to a step of 1.
_ROUNDING = 12.0**-0.5


def check_register_limits(
    product: ProductConfig, profile: ImuProfile
) -> Iterator[tuple[tuple[str, str, str], str]]:
    """Where a unit inside its limits would not fit into its registers, or not within what the limits ask.

    Yields
    ------
    Place of the product's entry, and the rest of the sentence, which names the register and the mend.
    """
    told: set[tuple[str, str, str]] = set()
    for entry in profile.registers:
        for name in filter(None, entry.names):
            parameter = parameter_of(name) if name in SLOTS else name
            limited = _limit(product, parameter) if parameter else None
            if limited is None:
                continue
            limit_name, limit = limited
            where = f"{entry} of IMU profile '{profile.name}'"
            for field, words in _complaints(entry, name, limit, where):
                place = ("limits", limit_name, field)
                if place not in told:
                    told.add(place)
                    yield place, words


def _limit(product: ProductConfig, parameter: str) -> tuple[str, Limit] | None:
    """A parameter's limit and the entry that has it: its own, or its group's."""
    for name in (parameter, PARAMETERS[NAMES.index(parameter)].group):
        if name in product.limits:
            return name, product.limits[name]
    return None


def _complaints(entry: RegisterEntry, name: str, limit: Limit, where: str) -> Iterator[tuple[str, str]]:
    if limit.interval is not None:
        least, most = _needed(entry, name, limit.interval)
        low, high = entry.range
        if least < low or most > high:
            yield (
                "within",
                f"lets {name} be {least:.6g} to {most:.6g}, but {where} has range {low:g} to {high:g}; narrow the limit"
                " or widen the register's range",
            )
    sigma = limit.sigma_below
    if sigma is not None and entry.step * _ROUNDING > sigma:
        yield (
            "sigma_below",
            f"= {sigma:g} is finer than {where} can hold, whose step is {entry.step:g}; correct the limit, or the"
            " register's scale or type",
        )
    elif sigma is not None and entry.tolerance > sigma:
        yield (
            "sigma_below",
            f"= {sigma:g} is finer than the tolerance = {entry.tolerance:g} of {where}; correct one of them",
        )


def _needed(entry: RegisterEntry, name: str, interval: tuple[float, float]) -> tuple[float, float]:
    """Values of a register over an interval of its parameter."""
    parameter = parameter_of(name) if name in SLOTS else None
    if parameter is None:
        return interval
    reach = legal_range(name, {parameter: max(map(abs, interval))}, entry.convention or Convention())
    assert reach is not None
    return reach
