"""Rules of a product file that its model alone cannot check: limits against the unit's registers, names of targets."""

from collections.abc import Iterable, Iterator

from calstation.config.station import ProductConfig
from calstation.devices.codecs import SLOTS, Convention, legal_range, parameter_of
from calstation.devices.profiles import ImuProfile, RegisterEntry
from calstation.physics import NAMES, PARAMETERS
from calstation.records import Limit
from calstation.schema import EntryError
from calstation.sequencer import named

#: Standard deviation of rounding to a step of 1.
_ROUNDING = 12.0**-0.5


def unknown_targets(targets: Iterable[str], *keys: str) -> Iterator[EntryError]:
    """Targets at `keys` that name no parameter or group: the stop rule would take them as reached at once."""
    return (EntryError("product.target_unknown", *keys, name, name=name) for name in targets if not named(name))


def register_conflicts(product: ProductConfig, imu: ImuProfile) -> Iterator[EntryError]:
    """Limits that admit values which the unit's registers cannot hold, or not finely enough; one per entry."""
    seen = set()
    for register in imu.registers:
        for name in filter(None, register.names):
            parameter = parameter_of(name) if name in SLOTS else name
            limit_name = _limit_of(product, parameter) if parameter else None
            if limit_name is None:
                continue
            for error in _conflicts(register, name, limit_name, product.limits[limit_name], imu.name):
                if error.place not in seen:
                    seen.add(error.place)
                    yield error


def _limit_of(product: ProductConfig, parameter: str) -> str | None:
    """Name of a parameter's limit: its own, or its group's."""
    group = PARAMETERS[NAMES.index(parameter)].group
    return next((name for name in (parameter, group) if name in product.limits), None)


def _conflicts(register: RegisterEntry, name: str, limit_name: str, limit: Limit, profile: str) -> Iterator[EntryError]:
    where = {"parameter": name, "register": str(register), "profile": profile}
    if limit.interval is not None:
        least, most = _needed(register, name, limit.interval)
        low, high = register.range
        if least < low or most > high:
            values = {"least": least, "most": most, "low": low, "high": high}
            yield EntryError("product.beyond_register", "limits", limit_name, "within", **where, **values)
    sigma = limit.sigma_below
    if sigma is not None and register.step * _ROUNDING > sigma:
        values = {"sigma": sigma, "step": register.step}
        yield EntryError("product.finer_than_step", "limits", limit_name, "sigma_below", **where, **values)
    elif sigma is not None and register.tolerance > sigma:
        values = {"sigma": sigma, "tolerance": register.tolerance}
        yield EntryError("product.finer_than_tolerance", "limits", limit_name, "sigma_below", **where, **values)


def _needed(register: RegisterEntry, name: str, interval: tuple[float, float]) -> tuple[float, float]:
    """Values of a register over an interval of its parameter."""
    parameter = parameter_of(name) if name in SLOTS else None
    if parameter is None:
        return interval
    reach = legal_range(name, {parameter: max(map(abs, interval))}, register.convention or Convention())
    assert reach is not None
    return reach
