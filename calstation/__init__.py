"""calstation: calibrates inertial measurement units on a two-axis rate table."""

import logging
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calstation.api import (
        Design,
        ExportCheck,
        Log,
        Result,
        TemperatureDesign,
        apply,
        design,
        export,
        open,
        resolve,
        run,
        simulate,
    )
    from calstation.errors import CalstationError

__version__: str
__all__ = [
    *("CalstationError", "Design", "ExportCheck", "Log", "Result", "TemperatureDesign", "__version__"),
    *("apply", "design", "export", "open", "resolve", "run", "simulate"),
]


def __getattr__(name: str) -> Any:
    """Import a name of the Python interface, or read the version, when it is first used.

    Importing the interface takes 2 s, and importlib.metadata a quarter of the time of `calstation --help`.
    """
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name != "__version__":
        from importlib import import_module

        value = getattr(import_module("calstation.errors" if name == "CalstationError" else "calstation.api"), name)
        globals()[name] = value
        return value
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("calstation")
    except PackageNotFoundError:  # run from a source tree that was never installed
        return "0+source"


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


#: Module whose `BENCH` replaces the devices of a station with a section `[bench]`; it is imported only for such a
#: station, see `calstation.config.load_bench`.
BENCH_MODULE = "calstation.simulation.station_bench"

# Programs that use the package without configuring its application log get no log output.
logging.getLogger(__name__).addHandler(logging.NullHandler())
