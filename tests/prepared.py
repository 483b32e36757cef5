"""Configurations of runs, as the program prepares them before it opens a device."""

from collections.abc import Callable

from calstation.config import RunConfiguration, RunRequest, prepare_units, unit_requests

Adjustment = Callable[[RunConfiguration], RunConfiguration]


def prepare_batch(request: RunRequest, adjust: Adjustment = lambda setup: setup) -> tuple[RunConfiguration, ...]:
    """Return the configuration of each unit of a request."""
    return prepare_units(unit_requests(request), adjust)


def prepare_run(request: RunRequest, adjust: Adjustment = lambda setup: setup) -> RunConfiguration:
    """Return the configuration of the only unit of a request."""
    (setup,) = prepare_units((request,), adjust)
    return setup
