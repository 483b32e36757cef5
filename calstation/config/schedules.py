"""What may be set of a stage's schedule, from its method's own model: fields, ranges, a product's values, faults."""

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
from calstation.config.request import RunRequest
from calstation.config.resolved import resolve_configuration
from calstation.config.versions import Version
from calstation.errors import ConfigurationError
from calstation.jobs.queue import ProgressCallback
from calstation.sequencer.stop_rule import named
from procedures import DEFAULT_STAGES, method

#: What a virtual unit is called where its bench does not say.
_VIRTUAL = "SN-000001"

#: A float, a whole number, true or false, one of several words, sigmas by parameter or group, anything else.
Kind = Literal["number", "count", "flag", "choice", "targets", "other"]

_KINDS: dict[Any, Kind] = {bool: "flag", int: "count", float: "number"}

#: Units by the ends of fields' names.
UNITS = {"_s": "s", "_dps": "°/s", "_dps2": "°/s²", "_deg": "°"}


@dataclass(frozen=True)
class ScheduleField:
    """One value of a schedule.

    Attributes
    ----------
    unit : "" where it has none
    low, high : bounds, None where there is none; above : `low` itself is too small
    optional : may be left out
    choices : the words of a choice
    description : the method's own words
    """

    name: str
    kind: Kind
    unit: str
    low: float | None
    above: bool
    high: float | None
    optional: bool
    choices: tuple[str, ...]
    description: str


@dataclass(frozen=True)
class ScheduleProblem:
    """What is wrong with a value: no ``number``, not ``whole``, ``missing``, too ``low``, too ``high``, beyond the
    ``table``, not the ``name`` of a parameter or group. `bound` : the limit that it breaks, `subject` : the name.
    """

    kind: Literal["number", "whole", "missing", "low", "high", "table", "name"]
    bound: float = 0.0
    subject: str = ""


@dataclass(frozen=True)
class ScheduleOptions:
    """What a product on a station lets choose.

    Attributes
    ----------
    product : its file; name : its name
    stages : of the product, in its order; offered : those and the other standard ones
    schedules : complete values of every stage offered, by name
    estimates : parameters of each stage offered
    rate, acceleration : most that both joints do, °/s and °/s²
    virtual : the station is a virtual bench; station : its name; by_hand : its rails are turned by hand
    serial_pattern : regular expression for a whole serial number; serial : of the virtual bench's unit, else ""
    """

    product: Path
    name: str
    station: str
    virtual: bool
    by_hand: bool
    stages: tuple[str, ...]
    offered: tuple[str, ...]
    schedules: Mapping[str, Mapping[str, Any]]
    estimates: Mapping[str, tuple[str, ...]]
    rate: float
    acceleration: float
    serial_pattern: str
    serial: str


def schedule_options(station: Path | None, product: Path | None) -> ScheduleOptions:
    """Read a product and a station, defaults where None. Raises ConfigurationError with file, field and mend."""
    setup = resolve_configuration(RunRequest("offer", station, product))
    known = tuple(dict.fromkeys((*setup.product.stages, *DEFAULT_STAGES)))
    offered = tuple(s for s in known if not setup.by_hand or "manual" in method(s).schedule.model_fields)
    whole = resolve_configuration(RunRequest("offer", station, product, offered))
    limits = setup.table.geometry().limits
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
        rate=float(np.rad2deg(min(limits.rate))),
        acceleration=float(np.rad2deg(min(limits.acceleration))),
        serial_pattern=setup.product.serial_pattern,
        serial="" if setup.station.bench is None else str(setup.station.bench.get("serial", _VIRTUAL)),
    )


def schedule_fields(stage: str) -> tuple[ScheduleField, ...]:
    """The fields of a stage's schedule, in its method's order."""
    return tuple(_field(name, info) for name, info in method(stage).schedule.model_fields.items())


def schedule_problems(
    stage: str, values: Mapping[str, Any], table: ScheduleOptions
) -> dict[str, ScheduleProblem]:
    """What is wrong with a schedule's values, by field; {} where they can be run on the offer's table."""
    found: dict[str, ScheduleProblem] = {}
    try:
        method(stage).schedule.model_validate(dict(values))
    except ValidationError as error:
        for detail in error.errors(include_url=False, include_context=True):
            name = str(detail["loc"][0])
            subject = str(detail["loc"][1]) if len(detail["loc"]) > 1 else ""
            found.setdefault(name, _problem(detail["type"], detail.get("ctx", {}), subject))
    targets = values.get("targets")
    for name in targets if isinstance(targets, Mapping) else ():
        if not named(str(name)):
            found.setdefault("targets", ScheduleProblem("name", subject=str(name)))
    for name, most in (("rate_dps", table.rate), ("acceleration_dps2", table.acceleration)):
        value = values.get(name)
        if name not in found and isinstance(value, int | float) and value > most * (1.0 + 1e-9):
            found[name] = ScheduleProblem("table", most)
    return found


def _problem(kind: str, context: Mapping[str, Any], subject: str) -> ScheduleProblem:
    bound = float(next((context[key] for key in ("ge", "gt", "le", "lt") if key in context), 0.0))
    if kind in ("greater_than", "greater_than_equal"):
        return ScheduleProblem("low", bound, subject)
    if kind in ("less_than", "less_than_equal"):
        return ScheduleProblem("high", bound, subject)
    if kind.startswith("int_"):
        return ScheduleProblem("whole", bound, subject)
    return ScheduleProblem("missing" if kind == "missing" else "number", bound, subject)


def _field(name: str, info: FieldInfo) -> ScheduleField:
    choices = get_args(info.annotation) if get_origin(info.annotation) is Literal else ()
    kinds = [kind for kind in get_args(info.annotation) or (info.annotation,) if kind is not NoneType]
    kind: Kind = "choice" if choices else next((k for of, k in _KINDS.items() if of in kinds), "other")
    if name == "targets":
        kind = "targets"
    low, above = _bound(info, "ge"), _bound(info, "gt")
    high, below = _bound(info, "le"), _bound(info, "lt")
    unit = next((unit for end, unit in UNITS.items() if name.endswith(end)), "")
    return ScheduleField(
        name,
        kind,
        unit,
        above if low is None else low,
        low is None and above is not None,
        below if high is None else high,
        NoneType in get_args(info.annotation),
        tuple(str(choice) for choice in choices),
        info.description or "",
    )


def _bound(info: FieldInfo, name: str) -> float | None:
    """A bound of a field by its annotation's name: ge, gt, le or lt."""
    return next((float(value) for m in info.metadata if (value := getattr(m, name, None)) is not None), None)


def save_schedule(
    tell: ProgressCallback, product: Path, changes: Mapping[str, Mapping[str, Any]], author: str
) -> tuple[Path, Version]:
    """Work for the workshop: write values of stages' schedules into a product, the site's copy of a shipped one.

    Parameters
    ----------
    product : its file
    changes : values by stage and field; None takes a value out, so that the method's own counts
    author : who says so

    Returns
    -------
    The site's file and its new version.

    Raises
    ------
    ConfigurationError
        where the product would be wrong, cannot hold a value, or cannot be written; it is then as it was.
    """
    text = edit_toml(
        read_text(product),
        {
            ("schedule", stage, name): None if value == {} else value
            for stage, values in changes.items()
            for name, value in values.items()
        },
    )
    _check(product, text, changes)
    tell(0.5)
    version = versions.save("products", product.stem, text, author)
    return library.find("products", product.stem), version


def _check(product: Path, text: str, changes: Mapping[str, Mapping[str, Any]]) -> None:
    """A value left out of the file counts as the method's own, which may be another one than meant."""
    stored = tomllib.loads(text).get("schedule", {})
    for stage, values in changes.items():
        model = method(stage).schedule
        for name, value in values.items():
            default = model.model_fields[name].get_default(call_default_factory=True)
            found = stored.get(stage, {}).get(name, default)
            if found != value:
                raise ConfigurationError(
                    f"{product}: schedule.{stage}.{name} cannot be empty in a product, where it means {default};"
                    " give it a value, or leave it empty for this run only"
                )
