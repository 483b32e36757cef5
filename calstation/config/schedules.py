"""Parameters of stage schedules: fields and ranges from the methods' models, values of a product, and saving."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args, get_origin

import numpy as np
from pydantic import ValidationError
from pydantic.fields import FieldInfo

from calstation.config import library, versions
from calstation.config.editing import edit_toml, read_text
from calstation.config.product import in_file
from calstation.config.request import RunRequest
from calstation.config.run_configuration import load_configuration
from calstation.config.versions import Version
from calstation.jobs import ProgressCallback
from calstation.physics import TableGeometry, named
from calstation.schema import EntryError
from procedures import DEFAULT_STAGES, method

#: A float, an integer, a boolean, one of several strings, sigmas by parameter or group, or anything else.
Kind = Literal["number", "count", "flag", "choice", "targets", "other"]

#: Not a number, not an integer, missing, too low, too high, beyond the table's limits, or not a parameter or group.
ProblemKind = Literal["number", "whole", "missing", "low", "high", "table", "name"]

#: Problem kinds by pydantic error type; all others are ``number``.
_SHORT: dict[str, ProblemKind] = {
    "greater_than": "low",
    "greater_than_equal": "low",
    "less_than": "high",
    "less_than_equal": "high",
    "missing": "missing",
}

_KINDS: dict[Any, Kind] = {bool: "flag", int: "count", float: "number"}

#: Units by the suffix of a field's name.
UNITS = {"_s": "s", "_dps": "°/s", "_dps2": "°/s²", "_deg": "°", "_arcsec": "″"}


@dataclass(frozen=True)
class ScheduleField:
    """One parameter of a schedule."""

    name: str
    kind: Kind
    unit: str  #: Empty if it has no unit.
    low: float | None
    above: bool  #: Whether the value must be greater than `low`, not equal to it.
    high: float | None
    optional: bool  #: Whether the parameter may be omitted.
    choices: tuple[str, ...]
    description: str  #: Description from the method.


@dataclass(frozen=True)
class ScheduleProblem:
    """A problem with a value of a schedule."""

    kind: ProblemKind
    bound: float = 0.0  #: The bound that the value violates, in the unit of the field.
    subject: str = ""  #: Invalid name in the schedule.


@dataclass(frozen=True)
class ScheduleOptions:
    """Options for a product on a station."""

    product: Path
    name: str  #: Name of the product.
    station: str  #: Name of the station.
    virtual: bool  #: Whether the station is a virtual bench.
    by_hand: bool  #: Whether the table is turned manually.
    stages: tuple[str, ...]  #: Stages of the product, in order.
    offered: tuple[str, ...]  #: Stages of the product and the other standard ones.
    schedules: Mapping[str, Mapping[str, Any]]  #: Complete values of every offered stage.
    estimates: Mapping[str, tuple[str, ...]]  #: Parameters estimated by every offered stage.
    rate: float  #: Maximum rate of both joints, °/s.
    acceleration: float  #: Maximum acceleration of both joints, °/s².
    serial_pattern: str  #: Regular expression for the whole serial number.
    serial_example: str  #: A serial number that matches.
    serial: str  #: Serial number of the unit on a virtual bench; empty on hardware.
    geometry: TableGeometry  #: Axes of the table, or of the gimbal.
    slots: tuple[str, ...] = ()  #: Names of the slots at a station with several units.


def schedule_options(station: Path | None, product: Path | None) -> ScheduleOptions:
    """Read the options for a product on a station; None for the defaults. Raises ConfigurationError."""
    setup = load_configuration(RunRequest("offer", station, product))
    known = tuple(dict.fromkeys((*setup.product.stages, *DEFAULT_STAGES)))
    if setup.table.gimbal is not None:
        offered = tuple(s for s in known if method(s).on_gimbal)
    else:
        offered = tuple(s for s in known if not setup.by_hand or "manual" in method(s).schedule.model_fields)
    whole = load_configuration(RunRequest("offer", station, product, offered))
    geometry = setup.table.geometry()
    context = setup.solve_context()
    return ScheduleOptions(
        product=setup.sources["product"].path,
        name=setup.product.name,
        station=setup.station.name,
        virtual=setup.station.bench is not None,
        by_hand=setup.by_hand,
        stages=setup.stages,
        offered=offered,
        schedules={stage: s.model_dump(mode="json") for stage, s in whole.schedules.items()},
        estimates={stage: method(stage).estimates(context) for stage in offered},
        rate=float(np.rad2deg(min(geometry.limits.rate))),
        acceleration=float(np.rad2deg(min(geometry.limits.acceleration))),
        serial_pattern=setup.product.serial_pattern,
        serial_example=setup.product.example,
        serial=setup.station.virtual_serial,
        geometry=geometry,
        slots=setup.station.slot_names,
    )


def schedule_fields(stage: str) -> tuple[ScheduleField, ...]:
    """Return the fields of a stage's schedule, in the order of its method."""
    return tuple(_field(name, info) for name, info in method(stage).schedule.model_fields.items())


def schedule_problems(stage: str, values: Mapping[str, Any], options: ScheduleOptions) -> dict[str, ScheduleProblem]:
    """Return the problems with a schedule's values, by field; {} if the table of the options can execute it."""
    found: dict[str, ScheduleProblem] = {}
    try:
        method(stage).schedule.model_validate(dict(values))
    except ValidationError as error:
        for detail in error.errors(include_url=False, include_context=True):
            name = str(detail["loc"][0])
            subject = str(detail["loc"][1]) if len(detail["loc"]) > 1 else ""
            kind = "whole" if detail["type"].startswith("int_") else _SHORT.get(detail["type"], "number")
            bounds = [value for key, value in detail.get("ctx", {}).items() if key in ("ge", "gt", "le", "lt")]
            found.setdefault(name, ScheduleProblem(kind, float(bounds[0]) if bounds else 0.0, subject))
    targets = values.get("targets")
    for name in targets if isinstance(targets, Mapping) else ():
        if not named(str(name)):
            found.setdefault("targets", ScheduleProblem("name", subject=str(name)))
    for name, most in (("rate_dps", options.rate), ("acceleration_dps2", options.acceleration)):
        value = values.get(name)
        if name not in found and isinstance(value, int | float) and value > most * (1.0 + 1e-9):
            found[name] = ScheduleProblem("table", most)
    return found


def _field(name: str, info: FieldInfo) -> ScheduleField:
    arguments = get_args(info.annotation)
    choices = arguments if get_origin(info.annotation) is Literal else ()
    kind: Kind = (
        "choice" if choices else next((_KINDS[t] for t in _KINDS if t in (info.annotation, *arguments)), "other")
    )
    bounds = {key: float(getattr(m, key)) for m in info.metadata for key in ("ge", "gt", "le", "lt") if hasattr(m, key)}
    return ScheduleField(
        name=name,
        kind="targets" if name == "targets" else kind,
        unit=next((unit for end, unit in UNITS.items() if name.endswith(end)), ""),
        low=bounds.get("ge", bounds.get("gt")),
        above="ge" not in bounds and "gt" in bounds,
        high=bounds.get("le", bounds.get("lt")),
        optional=NoneType in arguments,
        choices=tuple(str(choice) for choice in choices),
        description=info.description or "",
    )


def save_schedule(
    report: ProgressCallback, product: Path, changes: Mapping[str, Mapping[str, Any]], author: str
) -> tuple[Path, Version]:
    """Job: save parameters of schedules in a product file, or in the site's copy of a shipped one.

    `changes` contains values by stage and field; None removes a value, so that the method's default applies. Returns
    the site's file and its new version. Raises ConfigurationError if the product would be invalid, a value cannot be
    stored, or the file cannot be written; the file is then unchanged.
    """
    text = edit_toml(
        read_text(product),
        {
            ("schedule", stage, name): None if value == {} else value
            for stage, values in changes.items()
            for name, value in values.items()
        },
    )
    with in_file(product):
        _check_stored(text, changes)
    report(0.5)
    version = versions.save("products", product.stem, text, author)
    return library.find("products", product.stem), version


def _check_stored(text: str, changes: Mapping[str, Mapping[str, Any]]) -> None:
    """Check that the file contains the values; an omitted value means the method's default. Raises EntryError."""
    stored = tomllib.loads(text).get("schedule", {})
    for stage, values in changes.items():
        model = method(stage).schedule
        for name, value in values.items():
            default = model.model_fields[name].get_default(call_default_factory=True)
            if stored.get(stage, {}).get(name, default) != value:
                raise EntryError("product.empty_in_file", "schedule", stage, name, default=str(default))
