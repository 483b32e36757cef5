"""The model of a product file, which describes a type of unit, its calibration and its limits."""

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, JsonValue, field_validator, model_validator

from calstation.config import library
from calstation.devices.codecs import ELEMENTS, parameter_of, permitted_range
from calstation.devices.profiles import ImuProfile, RegisterEntry
from calstation.errors import ConfigurationError
from calstation.estimation.common import ImuModel, Site, SolveContext, TableModel
from calstation.physics import (
    CHANGING_GROUPS,
    EFFECT_PARAMETERS,
    EFFECTS,
    GROUP_BY_NAME,
    INDEX,
    NAMES,
    PAIR_PARAMETERS,
    PARAMETERS,
    further_parameter,
    parameter_indices,
)
from calstation.records import ChecksSection, ConformitySection, Day, Limit, TemperatureSection, check_limit_names
from calstation.schema import EntryError, Pattern, Problem, StrictModel, check_names, load_once, near_miss
from procedures import DEFAULT_STAGES, method

#: Recommended action for a unit outside its limits: remount it, repeat the run without changes, or set it aside.
Advice = Literal["reseat", "repeat", "set_aside"]

#: Effects outside the model that a schedule can be required to detect.
_CAUSES = (*(effect.cause for effect in EFFECTS), *(f"{group}_drift" for group in CHANGING_GROUPS))

DEFAULT_PRODUCT = "nav_a"

#: Shipped product that is calibrated manually.
MANUAL_PRODUCT = "mems_hand"

#: Context for the parameters that stages estimate, which depend only on whether the table fixes the lever arm.
_ANY_STATION = SolveContext(Site(0.0, 0.0, 0.0), ImuModel("", 1.0, "rate", 1.0, 1.0, 1.0, 1.0), TableModel())

#: Standard deviation of rounding to a step size of 1.
_ROUNDING_SIGMA = 12.0**-0.5


class WarmUpSection(StrictModel):
    """`[warm_up]`: minimum warm-up time, and largest temperature slope at the end of the warm-up."""

    time_s: float = Field(default=0.0, ge=0, le=86_400)
    slope_c_per_min: float | None = Field(default=None, gt=0)
    timeout_s: float = Field(default=3600.0, gt=0, le=86_400)


class LoadAngleSection(StrictModel):
    """`[load_angle]`: angles of the table while units are mounted, degrees."""

    outer_deg: float = 0.0
    inner_deg: float = 0.0


class ConfirmationSection(StrictModel):
    """`[confirmation]` of a product: actions that a second engineer must confirm."""

    #: Override of a failed unit, register writes outside a run, and the issue of a certificate.
    required_for: list[Literal["override", "registers", "certificate"]] = Field(default_factory=list)


class DetectionSection(StrictModel):
    """`[diagnosis.CAUSE]`: when a designed schedule must detect an effect outside the model."""

    #: Error of a parameter in multiples of its `sigma_below`; an effect that causes a larger error must be detected.
    error_over_limit: float = Field(gt=0)


class ReferenceSection(StrictModel):
    """`[check_standards.reference.NAME]`: reference value of a parameter and the standard deviation, SI."""

    value: float
    sigma: float = Field(ge=0)


class CheckStandardSection(StrictModel):
    """`[[check_standards]]` of a product: a unit with which the station is checked regularly (golden unit)."""

    serial: str = Field(min_length=1)
    interval_days: float = Field(gt=0)  #: Longest time between two passed runs of the unit.
    #: Date of the reference values; without a date, the unit is assumed to change only at a power-up.
    date: Day | None = None
    #: Reference value by parameter; the outer lever depends on the mounting and is not compared.
    reference: dict[str, ReferenceSection] = Field(min_length=1)

    @field_validator("reference")
    @classmethod
    def _check_reference(cls, reference: dict[str, ReferenceSection]) -> dict[str, ReferenceSection]:
        check_names(reference, NAMES)
        return reference


class ProductConfig(StrictModel):
    """A product file, which describes a type of unit, its calibration and its limits."""

    name: str
    imu: str  #: Name of the IMU profile.
    bench_grade: Literal["nav", "tactical", "mems"] = "nav"  #: Grade of a virtual unit.
    serial_pattern: Pattern  #: Regular expression for the whole serial number.
    serial_example: str = "SN-000123"  #: A matching serial number, shown when another serial number is refused.
    #: Drawing of the unit in its fixture, and template of the label of a passed unit, next to the product file.
    picture: str | None = Field(default=None, pattern=r"^[^/\\]+\.(svg|png|jpe?g)$")
    label: str | None = Field(default=None, pattern=r"^[^/\\]+\.(zpl|typ)$")
    stages: list[str] = Field(default_factory=lambda: list(DEFAULT_STAGES), min_length=1)
    schedule: dict[str, dict[str, JsonValue]] = Field(default_factory=dict)  #: Parameters of the methods, by stage.
    targets: dict[str, float] = Field(default_factory=dict)  #: Sigmas at which a repeated stage may end, SI.
    limits: dict[str, Limit] = Field(default_factory=dict)
    checks: ChecksSection | None = None
    conformity: ConformitySection | None = None  #: Decision rule; None for simple acceptance.
    temperature: TemperatureSection | None = None  #: Parameters over temperature, for the stage `temperature`.
    confirmation: ConfirmationSection | None = None
    #: Effects outside the model that a designed schedule must detect, by cause: the error that they may cause, or
    #: their size, SI.
    diagnosis: dict[str, DetectionSection | Annotated[float, Field(gt=0)]] = Field(default_factory=dict)
    load_angle: LoadAngleSection = LoadAngleSection()
    warm_up: WarmUpSection = WarmUpSection()
    operator_ends_stages: bool = False  #: Whether the operator page offers to end a repeated stage early.
    end_on_failure: bool = False  #: Whether to skip the remaining stages after a limit is exceeded.
    #: Recommended action after the first, second, ... consecutive failure; the last entry applies to all later ones.
    advice: list[Advice] = Field(default=["reseat", "repeat", "set_aside"], min_length=1)
    #: Consecutive failures as this product after which a unit is not calibrated again.
    attempts_allowed: int | None = Field(default=None, ge=1)
    check_standards: list[CheckStandardSection] = Field(default_factory=list)

    @field_validator("stages")
    @classmethod
    def _check_stages(cls, stages: list[str]) -> list[str]:
        if len(set(stages)) != len(stages):
            raise EntryError("product.stage_twice")
        return stages

    @field_validator("diagnosis")
    @classmethod
    def _check_diagnosis(cls, required: dict[str, DetectionSection | float]) -> dict[str, DetectionSection | float]:
        for cause in required:
            if cause not in _CAUSES:
                remedy = near_miss(cause, _CAUSES)
                raise EntryError("entry.unknown_name", cause, name=cause, remedy=remedy)
        return required

    @field_validator("check_standards")
    @classmethod
    def _check_standards(cls, standards: list[CheckStandardSection]) -> list[CheckStandardSection]:
        serials = [standard.serial for standard in standards]
        for number, serial in enumerate(serials):
            if serial in serials[:number]:
                raise EntryError("product.standard_twice", number, "serial", serial=serial)
        return standards

    @field_validator("limits")
    @classmethod
    def _check_limits(cls, limits: dict[str, Limit]) -> dict[str, Limit]:
        check_limit_names(limits)
        return limits

    @model_validator(mode="after")
    def _check_example(self) -> "ProductConfig":
        has_example = "serial_example" in self.model_fields_set
        if has_example and not re.fullmatch(self.serial_pattern, self.serial_example):
            values = {"example": self.serial_example, "pattern": self.serial_pattern}
            raise EntryError("product.example_unlike", "serial_example", **values)
        return self

    def standard(self, serial: str) -> CheckStandardSection | None:
        """Return the check standard with a serial number; None if the unit is not a check standard."""
        return next((standard for standard in self.check_standards if standard.serial == serial), None)

    @property
    def example(self) -> str:
        """A matching serial number, or the pattern if the product file gives no example."""
        return self.serial_example if re.fullmatch(self.serial_pattern, self.serial_example) else self.serial_pattern

    @model_validator(mode="after")
    def _check_temperature(self) -> "ProductConfig":
        if "temperature" in self.stages and self.temperature is None:
            raise EntryError("temperature.no_section", "temperature")
        return self

    @model_validator(mode="after")
    def _check_stages_of_checks(self) -> "ProductConfig":
        for rule in ("improvement_at_rest", "level", "motion_angle"):
            stage = getattr(getattr(self.checks, rule, None), "stage", None)
            if stage is not None and stage not in self.stages:
                keys = ("checks", rule, "stage")
                raise EntryError("entry.unknown_name", *keys, name=stage, remedy=near_miss(stage, self.stages))
        return self


@contextmanager
def in_file(path: Path) -> Iterator[None]:
    """Convert an EntryError into a ConfigurationError that names the file and the entry."""
    try:
        yield
    except EntryError as exc:
        raise ConfigurationError("entry.in_file", file=path, what=Problem.of(exc).as_text) from exc


def load_product(path: Path | None) -> tuple[Path, ProductConfig]:
    """Load a product file, by default `DEFAULT_PRODUCT`. Raises ConfigurationError, also for an unknown stage."""
    path = path or library.find("products", DEFAULT_PRODUCT)
    product = load_once(ProductConfig, path)
    for stage in (*product.stages, *product.schedule):
        method(stage)
    with in_file(path):
        for error in missing_files(product, path):
            raise error
    return path, product


def known_products() -> Iterator[tuple[str, ProductConfig]]:
    """Yield the name and configuration of each product file of the site and of the program."""
    for name in library.names("products"):
        with suppress(ConfigurationError):
            _, product = load_product(library.find("products", name))
            yield product.name, product


def missing_files(product: ProductConfig, path: Path | None = None) -> Iterator[EntryError]:
    """Yield errors for files that the product at `path` names but that do not exist."""
    for entry in ("picture", "label"):
        name = getattr(product, entry)
        if name is not None and library.find_beside(path, name) is None:
            yield EntryError("product.no_file", entry, name=name, folder=library.site_folder() / "products")


def schedule_values(product: ProductConfig, stage: str, overrides: Mapping[str, Any]) -> dict[str, JsonValue]:
    """Return the values of a stage's schedule; `overrides` replace those of the product."""
    values: dict[str, JsonValue] = {**product.schedule.get(stage, {}), **overrides}
    fields = method(stage).schedule.model_fields
    if values.get("ramp_c_per_min") and not values.get("points_c") and product.temperature is not None:
        low, high = product.temperature.range_c
        values["points_c"] = [low, high, low]
    if "targets" in fields and "stop_at_limits" not in fields and product.targets and "targets" not in values:
        values["targets"] = dict(product.targets)
    return values


def unknown_targets(targets: Iterable[str], *keys: str) -> Iterator[EntryError]:
    """Yield errors for targets that are neither parameters nor groups; `keys` lead to the targets in the file."""
    return (
        EntryError("product.target_unknown", *keys, name, name=name) for name in targets if not parameter_indices(name)
    )


def unjudged_limits(product: ProductConfig, imu: ImuProfile) -> list[str]:
    """Return the entries of `limits` with a parameter that no stage of the product determines, in their order.

    A lever arm that a stage estimates on most tables counts as determined; it is known on a table that fixes it.
    """
    determined = {name for stage in product.stages for name in method(stage).estimates(_ANY_STATION)}
    determined |= {p.name for p in EFFECT_PARAMETERS if p.group in imu.states}
    if "cross_calibration" in product.stages:
        determined |= {p.name for p in PAIR_PARAMETERS}
    undetermined = {name: group for name, group in GROUP_BY_NAME.items() if name not in determined}
    by_group = {group for name, group in undetermined.items() if name not in product.limits}
    return [name for name in product.limits if name in (undetermined if name in GROUP_BY_NAME else by_group)]


def register_conflicts(product: ProductConfig, imu: ImuProfile) -> Iterator[EntryError]:
    """Yield one error for each limit that exceeds the range or resolution of the unit's registers."""
    reported = set()
    for register in imu.registers:
        for name in filter(None, register.names):
            parameter = parameter_of(name)
            limit_name = _limit_of(product, parameter) if parameter else None
            if limit_name is None:
                continue
            for error in _conflicts(register, name, limit_name, product.limits[limit_name], imu.name):
                if error.key_path not in reported:
                    reported.add(error.key_path)
                    yield error


def _limit_of(product: ProductConfig, parameter: str) -> str | None:
    """Return the parameter or group under which the limit of a parameter is given; None if there is no limit."""
    known = PARAMETERS[INDEX[parameter]] if parameter in INDEX else further_parameter(parameter)
    group = "" if known is None else known.group
    return next((name for name in (parameter, group) if name in product.limits), None)


def _conflicts(register: RegisterEntry, name: str, limit_name: str, limit: Limit, profile: str) -> Iterator[EntryError]:
    where = {"parameter": name, "register": register.address, "profile": profile}
    if limit.interval is not None:
        min_value, max_value = _register_range(register, name, limit.interval)
        low, high = register.range
        if min_value < low or max_value > high:
            values = {"least": min_value, "most": max_value, "low": low, "high": high}
            yield EntryError("product.beyond_register", "limits", limit_name, "within", **where, **values)
    sigma = limit.sigma_below
    if sigma is not None and register.step * _ROUNDING_SIGMA > sigma:
        values = {"sigma": sigma, "step": register.step}
        yield EntryError("product.finer_than_step", "limits", limit_name, "sigma_below", **where, **values)
    elif sigma is not None and register.tolerance > sigma:
        values = {"sigma": sigma, "tolerance": register.tolerance}
        yield EntryError("product.finer_than_tolerance", "limits", limit_name, "sigma_below", **where, **values)


def _register_range(register: RegisterEntry, name: str, interval: tuple[float, float]) -> tuple[float, float]:
    """Return the range of a register's value over an interval of its parameter."""
    parameter = parameter_of(name) if name in ELEMENTS else None
    if parameter is None:
        return interval
    return permitted_range(name, {parameter: max(map(abs, interval))}, register.effective_convention) or interval


def manual_product() -> Path | None:
    """Return the shipped product that is calibrated manually, or None if it was removed."""
    return library.find("products", MANUAL_PRODUCT) if MANUAL_PRODUCT in library.names("products") else None
