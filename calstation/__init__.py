"""calstation: calibrates inertial measurement units on a two-axis rate table."""

import logging

__version__: str


def __getattr__(name: str) -> str:
    """Read the version when it is asked for: importlib.metadata takes a quarter of the time of `calstation --help`."""
    if name != "__version__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("calstation")
    except PackageNotFoundError:  # run from a source tree that was never installed
        return "0+source"


#: Module whose `BENCH` takes the place of the devices of a station with a section `[bench]`, and of nothing else: it is
#: imported for such a station only, see `calstation.config.load_bench`.
BENCH_MODULE = "calstation.simulation.station_bench"

# Programs that use the package without configuring its application log get no log output.
logging.getLogger(__name__).addHandler(logging.NullHandler())
