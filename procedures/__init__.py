"""Calibration methods: each file contains an object `METHOD`; docs/how-to/extend.md explains how to add one."""

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from calstation.errors import ConfigurationError
from calstation.estimation import Method

DEFAULT_STAGES = ("rate", "six_position", "excitation", "azimuth_flip")


@cache
def names() -> list[str]:
    """Return the names of all methods, starting with the default stages."""
    return sorted((m.name for m in iter_modules(__path__)), key=lambda n: (n not in DEFAULT_STAGES, n))


@cache
def method(name: str) -> Method:
    """Return the method with a name. Raises ConfigurationError with the known methods if there is none."""
    if name not in names():
        raise ConfigurationError("plan.no_such_stage", stage=name, known=names())
    registered: Method = import_module(f"{__name__}.{name}").METHOD
    return registered
