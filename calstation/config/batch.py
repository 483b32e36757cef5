"""Batches: the requests and configurations of several units on one table."""

from dataclasses import replace
from datetime import UTC, datetime
from secrets import token_hex

from calstation.config.request import RunRequest
from calstation.config.run_configuration import Adjustment, RunConfiguration, prepare_run
from calstation.config.station import load_station
from calstation.errors import ConfigurationError


def new_batch_id() -> str:
    """Return an identifier of a batch: its start in UTC, and four digits that differ between stations."""
    return f"B{datetime.now(UTC):%Y%m%dT%H%M%S}-{token_hex(2).upper()}"


def unit_requests(request: RunRequest) -> tuple[RunRequest, ...]:
    """Return one request per unit of a batch, in slot order; for a single unit only the request itself.

    Raises ConfigurationError if there are more serial numbers than slots, duplicates, or none.
    """
    if not request.serials:
        return (request,)
    path, station = load_station(request.station)
    names = station.slot_names
    if not names:
        raise ConfigurationError("batch.one_unit", station=path)
    if len(request.serials) > len(names):
        raise ConfigurationError("batch.more_than_slots", station=path, units=len(request.serials), slots=len(names))
    placed = [(name, serial) for name, serial in zip(names, request.serials, strict=False) if serial not in ("", "-")]
    serials = [serial for _, serial in placed]
    if not serials:
        raise ConfigurationError("batch.no_unit", station=path)
    for number, serial in enumerate(serials):
        if serial in serials[:number]:
            raise ConfigurationError("batch.serial_twice", serial=serial)
    if request.resume is not None and len(serials) > 1:
        raise ConfigurationError("batch.resume")
    batch = request.batch or new_batch_id()
    slots = tuple(name for name, _ in placed)
    common = replace(request, serials=(), batch=batch, batch_units=tuple(serials), batch_slots=slots)
    return tuple(replace(common, serial=serial, slot=name) for name, serial in placed)


def prepare_batch(request: RunRequest, adjust: Adjustment = lambda resolved: resolved) -> tuple[RunConfiguration, ...]:
    """Return the checked configuration of each unit of a run, like `prepare_run`.

    Raises ConfigurationError also if the units cannot be on one table or do not share the plan.
    """
    setups = tuple(prepare_run(unit, adjust) for unit in unit_requests(request))
    first = setups[0]
    for setup in setups[1:]:
        # the order of the stages matters, too
        if list(setup.schedules.items()) != list(first.schedules.items()):
            slot, product = setup.request.slot or "", setup.product.name
            raise ConfigurationError("batch.other_plan", slot=slot, product=product, first=first.product.name)
    return setups
