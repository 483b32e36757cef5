"""Parameters of the stages' schedules: their fields, ranges and values in a product, and how they are saved."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from calstation.config import library, versions
from calstation.config.editing import edit_toml, read_text
from calstation.config.forms import FieldSpec, field_spec
from calstation.config.product import in_file, schedule_values, unknown_targets
from calstation.config.request import Confirmation, RunRequest
from calstation.config.run_configuration import RunConfiguration, load_configuration, targets_at_limits
from calstation.config.versions import Version
from calstation.estimation.common import SolveContext
from calstation.jobs import ProgressCallback
from calstation.messages import Text
from calstation.parsing import parse_toml
from calstation.physics import INDEX, TableGeometry, group_of
from calstation.schema import EntryError, Problem, problems_of
from procedures import DEFAULT_STAGES, method


@dataclass(frozen=True)
class ScheduleOptions:
    """The stages and schedules available for a product on a station."""

    product: Path
    name: str  #: Name of the product.
    station: str  #: Name of the station.
    virtual: bool  #: Whether the station is a virtual bench.
    by_hand: bool  #: Whether the table is turned manually.
    stages: tuple[str, ...]  #: Stages of the product, in order.
    offered: tuple[str, ...]  #: Stages of the product, followed by the other standard stages.
    #: Complete values of every offered stage, without the targets that follow from the product's limits.
    schedules: Mapping[str, Mapping[str, Any]]
    estimates: Mapping[str, tuple[str, ...]]  #: Parameters that each offered stage estimates.
    rate: float  #: Maximum rate of both joints, °/s.
    acceleration: float  #: Maximum acceleration of both joints, °/s².
    serial_pattern: str  #: Regular expression for the whole serial number.
    serial_example: str  #: A matching serial number.
    serial: str  #: Serial number of the unit on a virtual bench; empty on hardware.
    geometry: TableGeometry  #: Axes of the table, or of the gimbal.
    slots: tuple[str, ...] = ()  #: Names of the slots at a station with several units.
    slot_products: Mapping[str, str] = field(default_factory=dict)  #: Names of the slots' own products, by slot.
    over_temperature: bool = False  #: Whether the product is calibrated over temperature.
    #: Smallest sigma limit of each parameter group, SI, by the last stage of the product that estimates it.
    sigma_limits: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    stop_limits: Mapping[str, float] = field(default_factory=dict)  #: Sigma limits of the product's parameters, SI.
    gravity_sigma: float = 0.0  #: Relative standard deviation of gravity at the station.
    writes: bool = False  #: Whether a run writes the registers of a unit that passes.
    unjudged: tuple[str, ...] = ()  #: Entries of the product's limits that none of its stages can judge.
    checksums: tuple[str, ...] = ()  #: SHA-256 of the files of the station and the product.


def schedule_options(station: Path | None, product: Path | None) -> ScheduleOptions:
    """Return the options for a product on a station; None selects the default file. Raises ConfigurationError."""
    setup = load_configuration(RunRequest("offer", station, product))
    known = tuple(dict.fromkeys((*setup.product.stages, *DEFAULT_STAGES)))
    if setup.table.gimbal is not None:
        offered = tuple(s for s in known if method(s).on_gimbal)
    else:
        offered = tuple(s for s in known if not setup.table.by_hand or "manual" in method(s).schedule.model_fields)
    load_configuration(RunRequest("offer", station, product, offered))  # which checks the schedules of all stages
    geometry = setup.table.geometry()
    context = setup.solve_context()
    estimates = {stage: method(stage).estimates(context) for stage in offered}
    return ScheduleOptions(
        product=setup.sources["product"].path,
        name=setup.product.name,
        station=setup.station.name,
        virtual=setup.station.bench is not None,
        by_hand=setup.table.by_hand,
        stages=setup.stages,
        offered=offered,
        schedules={stage: _complete_values(setup, stage) for stage in offered},
        estimates=estimates,
        sigma_limits=_group_limits(setup, context),
        stop_limits=setup.sigma_limits(context),
        gravity_sigma=context.site.relative_gravity_sigma,
        rate=float(np.rad2deg(min(geometry.limits.rate))),
        acceleration=float(np.rad2deg(min(geometry.limits.acceleration))),
        serial_pattern=setup.product.serial_pattern,
        serial_example=setup.product.example,
        serial=setup.station.virtual_serial,
        slot_products=setup.slot_products(),
        geometry=geometry,
        slots=setup.station.slot_names,
        over_temperature=setup.product.temperature is not None,
        writes=any(any(register.names) for register in setup.imu.registers),
        unjudged=setup.unjudged_limits,
        checksums=tuple(source.section.sha256 for source in setup.sources.values()),
    )


def _complete_values(setup: RunConfiguration, stage: str) -> dict[str, Any]:
    schedule: BaseModel = method(stage).schedule.model_validate(schedule_values(setup.product, stage, {}))
    return schedule.model_dump(mode="json")


def _group_limits(setup: RunConfiguration, context: SolveContext) -> dict[str, dict[str, float]]:
    """Return the smallest sigma limit of each parameter group, SI, by the last stage that estimates it."""
    last = {name: stage for stage in setup.stages for name in method(stage).estimates(context)}
    limits: dict[str, dict[str, float]] = {}
    for name, sigma in setup.sigma_limits(context).items():
        groups, group = limits.setdefault(last[name], {}), group_of(name)
        groups[group] = min(sigma, groups.get(group, sigma))
    return limits


def schedule_fields(stage: str) -> tuple[FieldSpec, ...]:
    """Return the fields of a stage's schedule, in the order of its method."""
    specs = (field_spec(name, info) for name, info in method(stage).schedule.model_fields.items())
    return tuple(replace(spec, kind="targets") if spec.name == "targets" else spec for spec in specs)


def implied_targets(values: Mapping[str, Any], options: ScheduleOptions) -> dict[str, float]:
    """Return the smallest target, SI, of each parameter group for which none is set.

    Such targets follow from targets of single parameters, and from the limits at which a stage ends.
    """
    given, margin = values.get("targets") or {}, values.get("margin")
    targets = {name: sigma for name, sigma in given.items() if isinstance(sigma, int | float)}
    if values.get("stop_at_limits") and isinstance(margin, int | float):
        targets = targets_at_limits(targets, options.stop_limits, margin, options.gravity_sigma)
    implied: dict[str, float] = {}
    for name, sigma in targets.items():
        if name in INDEX and (group := group_of(name)) not in given:
            implied[group] = min(sigma, implied.get(group, sigma))
    return implied


def schedule_problems(stage: str, values: Mapping[str, Any], options: ScheduleOptions) -> list[Problem]:
    """Return the problems of a schedule's values; [] if they are valid and the table can execute them."""
    problems = problems_of(method(stage).schedule, dict(values))
    targets = values.get("targets")
    if isinstance(targets, Mapping):
        problems += map(Problem.of, unknown_targets(map(str, targets), "targets"))
    invalid = {problem.key_path[0] for problem in problems}
    for name, limit in (("rate_dps", options.rate), ("acceleration_dps2", options.acceleration)):
        value = values.get(name)
        if name not in invalid and isinstance(value, int | float) and value > limit * (1.0 + 1e-9):
            unit = f" {field_spec(name, None).unit}"
            problems.append(Problem((name,), "table", Text.of("schedule.wrong_table", bound=limit, unit=unit)))
    return problems


def save_schedule(
    report: ProgressCallback, product: Path, changes: Mapping[str, Mapping[str, Any]], author: str | Confirmation
) -> tuple[Path, Version]:
    """Job: save schedule parameters in a product file; return the site's file and its new version.

    Raises ConfigurationError, and leaves the file unchanged, if the product would be invalid, a value cannot be stored,
    or the file cannot be written.

    Parameters
    ----------
    report : callback for the progress
    product : product file; for a shipped one, the site's copy is changed
    changes : values by stage and field; None removes a value, so that the method's default applies
    author : author of the new version, as in `versions.save`
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
    """Check that the text contains the values, or omits those that equal the methods' defaults. Raises EntryError."""
    stored = parse_toml(text).get("schedule", {})
    for stage, values in changes.items():
        model = method(stage).schedule
        for name, value in values.items():
            default = model.model_fields[name].get_default(call_default_factory=True)
            if stored.get(stage, {}).get(name, default) != value:
                raise EntryError("product.empty_in_file", "schedule", stage, name, default=str(default))
