"""The configuration of a run or a batch, which is read and checked completely before a device is opened."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from secrets import token_hex
from typing import Any

import numpy as np
from pydantic import BaseModel, JsonValue

from calstation import __version__
from calstation.config import library, versions
from calstation.config.configuration_checks import check_baud_rates, check_station, product_errors
from calstation.config.product import (
    CheckStandardSection,
    ProductConfig,
    in_file,
    load_product,
    schedule_values,
    unjudged_limits,
)
from calstation.config.request import RunRequest, computer_user
from calstation.config.slots import PLATFORM_AXES, SlotSection
from calstation.config.station import BenchSettings, StationConfig, at_slot, load_bench, load_station
from calstation.devices.imu import RegisterMap
from calstation.devices.profiles import (
    ChamberProfile,
    ImuProfile,
    TableProfile,
    load_chamber_profile,
    load_imu_profile,
    load_table_profile,
)
from calstation.errors import ConfigurationError
from calstation.escaping import surrogates
from calstation.estimation.common import SolveContext, without_gravity
from calstation.parsing import MAX_TOML, read_limited
from calstation.physics import INDEX, NAMES, PARAMETERS, Step, entry_of, group_indices, parameter_indices
from calstation.records import (
    FileSection,
    ImuSection,
    LogMeta,
    ModelSection,
    PriorSection,
    ProductSection,
    RunSection,
    TableSection,
    context_from_meta,
)
from calstation.schema import EntryError, Model, validate
from procedures import method

#: Largest value of a register in prior sigmas; a larger value cannot be a calibration of the unit.
_MAX_PLAUSIBLE_SIGMAS = 3.0


@dataclass(frozen=True)
class SourceFile:
    """The path and text of a configuration file, with its name and version for the log."""

    path: Path
    text: str
    section: FileSection

    @classmethod
    def read(cls, kind: str, path: Path) -> "SourceFile":
        """Read a file of the given kind (``station``, ``product``, ``table``, ``chamber`` or ``imu``)."""
        text = read_limited(path, MAX_TOML).decode()
        version = versions.version_number(f"{kind}s", path.stem, text)
        return cls(path, text, FileSection(name=path.stem, version=version, sha256=versions.sha256(text)))


@dataclass(frozen=True)
class RunConfiguration:
    """The complete, checked configuration of a run."""

    request: RunRequest
    station: StationConfig
    product: ProductConfig
    table: TableProfile
    imu: ImuProfile
    schedules: dict[str, BaseModel]  #: Parameters of each stage's method, in the order of the run.
    #: Files by kind; empty for an unsaved draft.
    sources: Mapping[str, SourceFile] = field(default_factory=dict)
    #: Settings of the virtual bench that override all others.
    bench_overrides: Mapping[str, JsonValue] = field(default_factory=dict)
    chamber: ChamberProfile | None = None  #: Profile of the station's chamber; None without one.

    @property
    def stages(self) -> tuple[str, ...]:
        """Names of the stages, in the order of the run."""
        return tuple(self.schedules)

    @property
    def changed_schedules(self) -> list[str]:
        """Stages whose schedule in the request differs from that of the product, in the order of the run."""
        changes = self.request.schedule or {}
        return [s for s in self.stages if s in changes and self._schedule(s, changes[s]) != self._schedule(s, {})]

    @property
    def after_registers(self) -> bool:
        """Whether the unit's stream is already corrected by its registers."""
        return self.imu.stream.order == "after_registers"

    @property
    def repeatability(self) -> float:
        """Standard deviation of the angle over repeated moves of the table to the same position, rad."""
        accuracy = self.table.accuracy
        return float(np.deg2rad(accuracy.repeatability_deg or accuracy.encoder_sigma_deg))

    @property
    def check_standard(self) -> CheckStandardSection | None:
        """The unit as a check standard of the product; None for a production unit."""
        return self.product.standard(self.request.serial)

    @property
    def slot(self) -> SlotSection | None:
        """The slot of the unit, with its link; None at a station with one unit."""
        link = self.station.imu
        return link if isinstance(link, SlotSection) else None

    @property
    def number(self) -> int:
        """Number of the unit's slot in a batch; 1 for a single unit."""
        slot = self.slot
        return 1 if slot is None or self.request.batch is None else self.station.slot_names.index(slot.name) + 1

    def _schedule(self, stage: str, changes: Mapping[str, Any]) -> BaseModel:
        values = schedule_values(self.product, stage, changes)
        return _with_limits(self, method(stage).schedule.model_validate(values))

    @property
    def unjudged_limits(self) -> tuple[str, ...]:
        """Entries of the product's limits that no stage of the product can judge."""
        return tuple(unjudged_limits(self.product, self.imu))

    @property
    def register_map(self) -> RegisterMap:
        """Registers of the unit by parameter."""
        return RegisterMap(tuple(self.imu.registers))

    def log_meta(
        self, started: datetime | None = None, attempt: int = 1, registers: Mapping[str, float] | None = None
    ) -> LogMeta:
        """Return the configuration stored in the log, which contains everything needed for solving.

        Plausible registers that are not applied to the stream are the mean of the prior. Registers that are applied are
        stored, to be combined with the solution, and the prior mean is zero.

        Parameters
        ----------
        started : start of the run, by default now
        attempt : number of the run among the unit's runs, from 1
        registers : registers of the unit by parameter, SI
        """
        current, levers, slot = dict(registers or {}), self._levers(), self.slot
        orientation = {} if slot is None or slot.orientation == PLATFORM_AXES else {"orientation": slot.orientation}
        sigmas = {name: PARAMETERS[INDEX[name]].prior_sigma for name in levers} | self.imu.prior_sigmas()
        started = (started or datetime.now(UTC)).astimezone(UTC)
        bench: BenchSettings | None = None if self.station.bench is None else load_bench()
        return LogMeta(
            site=self.station.site.location,
            imu=_section(ImuSection, self.imu.quantised_stream, self.imu.noise, serial=self.request.serial),
            table=_section(TableSection, self.table, self.table.accuracy, **orientation),
            model=ModelSection(states=self.imu.states) if self.imu.states else None,
            prior={
                name: PriorSection(value=levers.get(name, self._prior_mean(current.get(name, 0.0), sigma)), sigma=sigma)
                for name, sigma in sigmas.items()
            },
            product=self._product_section(levers),
            temperature=self.product.temperature if "temperature" in self.stages else None,
            run=RunSection(
                stages=list(self.stages),
                station=self.station.name,
                operator=self.request.operator,
                seed=None if bench is None else bench.seed(self),
                attempt=attempt,
                batch=self.request.batch,
                slot=self.request.slot,
                batch_units=list(self.request.batch_units) or None,
                software=__version__,
                started_utc=started.isoformat(timespec="seconds"),
                clock_error_ppm=self.station.clock_error_ppm,
                standard_override=self.request.override_standard,
                standard_override_by=list(self.request.overridden_by.people) if self.request.overridden_by else None,
                standard_overridden=list(self.request.overridden) or None,
                files={kind: source.section for kind, source in self.sources.items()} or None,
            ),
            laboratory=self.station.laboratory,
            instruments=self.station.instruments,
            schedule={stage: s.model_dump(mode="json") for stage, s in self.schedules.items()},
            profiles={kind: source.text for kind, source in self.sources.items()},
            registers=current if self.after_registers else {},
        )

    def _levers(self) -> dict[str, float]:
        """Return the nominal lever arm of the unit in its slot by parameter, m; {} at the centre of rotation."""
        if self.slot is None or not any(self.slot.lever_m):
            return {}
        return dict(zip([NAMES[i] for i in group_indices("outer_lever")], self.slot.lever_m, strict=True))

    def _product_section(self, levers: Mapping[str, float]) -> ProductSection:
        """Return the product's section of the log, with lever arm limits relative to the slot's lever arm."""
        section = _section(ProductSection, self.product)
        limits = {name: section.limits.get(name, section.limits.get("outer_lever")) for name in levers}
        shifted = {name: limit.shifted_by(levers[name]) for name, limit in limits.items() if limit is not None}
        return section.model_copy(update={"limits": {**section.limits, **shifted}}) if shifted else section

    def _prior_mean(self, register: float, sigma: float) -> float:
        plausible = not self.after_registers and abs(register) <= _MAX_PLAUSIBLE_SIGMAS * sigma
        return register if plausible else 0.0

    def solve_context(self) -> SolveContext:
        """Return the site, IMU and table for the solvers, SI."""
        return context_from_meta(self.log_meta())

    def slot_products(self) -> dict[str, str]:
        """Return the names of the products of the slots that have their own. Raises ConfigurationError."""
        own = {slot.name: slot.product for slot in self.station.slots if slot.product is not None}
        return {name: load_product(library.find("products", product))[1].name for name, product in own.items()}

    def sigma_limits(self, context: SolveContext | None = None) -> dict[str, float]:
        """Return the maximum sigma of each estimated parameter, SI, after the last stage that estimates it.

        `context` is the result of `solve_context`, if it is already available.
        """
        context, limits = context or self.solve_context(), self.product.limits
        last = {name: stage for stage in self.stages for name in method(stage).estimates(context) if name in INDEX}
        sigmas_by_name = {}
        for name, stage in last.items():
            limit = entry_of(limits, name)
            sigma = limit.sigma_limit(stage) if limit is not None else None
            if sigma is not None:
                sigmas_by_name[name] = sigma
        return sigmas_by_name

    def plan(self, stage: str) -> Iterator[Step]:
        """Return the steps of a stage."""
        return method(stage).plan(self.table.geometry(), self.schedules[stage])


def _section(model: type[Model], *sources: BaseModel, **entries: Any) -> Model:
    """Create a section of a log's configuration from the entries of the same names in the sources."""
    names = model.model_fields
    return model(**{n: getattr(s, n) for s in sources for n in names if n in type(s).model_fields}, **entries)


def _with_limits(setup: RunConfiguration, schedule: BaseModel) -> BaseModel:
    """Return a schedule that ends at the product's limits, which become the targets of parameters without a target."""
    if not getattr(schedule, "stop_at_limits", False):
        return schedule
    any_unit = replace(setup, request=replace(setup.request, serial=setup.product.example))
    targets, margin = getattr(schedule, "targets", {}), getattr(schedule, "margin", 1.0)
    gravity_sigma = any_unit.solve_context().site.relative_gravity_sigma
    targets = targets_at_limits(targets, any_unit.sigma_limits(), margin, gravity_sigma)
    return schedule.model_copy(update={"targets": targets})


def targets_at_limits(
    targets: Mapping[str, float], limits: Mapping[str, float], margin: float, gravity_sigma: float
) -> dict[str, float]:
    """Return the targets, and the limits less the gravity error for the parameters without a target.

    Parameters
    ----------
    targets : target sigmas of parameters and groups, SI
    limits : sigma limits of parameters, SI
    margin : fraction of its limit that every sigma must reach
    gravity_sigma : relative standard deviation of gravity
    """
    named = {i for name in targets for i in parameter_indices(name)}
    reachable = without_gravity(np.array([margin * limits.get(name, np.inf) for name in NAMES]), gravity_sigma)
    others = {NAMES[i]: float(s) for i, s in enumerate(reachable) if np.isfinite(s) and i not in named}
    return {**targets, **others}


def unit_files(station: StationConfig, product: Path | None) -> tuple[Path, ProductConfig, Path]:
    """Return the path and content of the product file of a station's unit, and the path of its IMU profile.

    A product or profile named by the unit's slot replaces `product` or the profile of the product. Raises
    ConfigurationError.
    """
    slot = station.imu if isinstance(station.imu, SlotSection) else None
    if slot is not None and slot.product is not None:
        product = library.find("products", slot.product)
    path, content = load_product(product)
    return path, content, library.find("imus", content.imu if slot is None or slot.imu is None else slot.imu)


#: Function that changes a configuration before it is checked, for example for fault injection.
Adjustment = Callable[[RunConfiguration], RunConfiguration]


def load_configuration(request: RunRequest, adjust: Adjustment = lambda setup: setup) -> RunConfiguration:
    """Read the files of a request, apply `adjust`, and check the result regardless of the serial number.

    Raises ConfigurationError, which names the file, the entry and the remedy.
    """
    return _check_configuration(_read_configuration(request), adjust)


def _read_configuration(request: RunRequest) -> RunConfiguration:
    """Read the files of a request. Raises ConfigurationError."""
    if surrogates(folder := str(request.out.absolute())):
        raise ConfigurationError("run.folder_not_utf8", folder=folder)
    station_path, station = load_station(request.station)
    with in_file(station_path):
        station = at_slot(station, request.slot)
    product_path, product, imu_path = unit_files(station, request.product)
    if not product.limits:
        with in_file(product_path):
            raise EntryError("product.no_limits", "limits")
    table_path = library.find("tables", station.table.profile)
    paths = {"station": station_path, "product": product_path, "table": table_path, "imu": imu_path}
    chamber_path = None if station.chamber is None else library.find("chambers", station.chamber.profile)
    if chamber_path is not None:
        paths["chamber"] = chamber_path
    schedules: dict[str, BaseModel] = {}
    for stage in request.stages or product.stages:
        changes = (request.schedule or {}).get(stage, {})
        source = f"schedule.{stage}" if changes else f"{product_path}: schedule.{stage}"
        schedules[stage] = validate(method(stage).schedule, schedule_values(product, stage, changes), source)
    setup = RunConfiguration(
        request=request,
        station=station,
        product=product,
        table=load_table_profile(table_path),
        imu=load_imu_profile(imu_path),
        chamber=None if chamber_path is None else load_chamber_profile(chamber_path),
        schedules=schedules,
        sources={kind: SourceFile.read(kind, path) for kind, path in paths.items()},
    )
    return replace(setup, schedules={s: _with_limits(setup, p) for s, p in setup.schedules.items()})


def _check_configuration(setup: RunConfiguration, adjust: Adjustment) -> RunConfiguration:
    """Apply `adjust` to a configuration, and check the result. Raises ConfigurationError."""
    request, station = setup.request, setup.station
    station_path, product_path = setup.sources["station"].path, setup.sources["product"].path
    options = {"--faults": request.faults, "--speed": request.speed, "--seed": request.seed}
    for option, value in options.items() if station.bench is None else ():
        if value is not None:
            raise ConfigurationError("configuration.bench_only", option=option, station=station_path)
    setup = adjust(setup)
    if station.bench is not None:
        bench: BenchSettings = load_bench()
        bench.check(setup, f"{station_path} [bench]")
    with in_file(product_path):
        for error in product_errors(setup):
            raise error
    with in_file(station_path):
        check_baud_rates(setup)
    return setup


def _prepare(setup: RunConfiguration, adjust: Adjustment) -> RunConfiguration:
    """Check a configuration, its operator and its serial number. Raises ConfigurationError."""
    setup = _check_configuration(setup, adjust)
    request, sign_in = setup.request, setup.station.sign_in
    if sign_in is not None:
        operator: str | None = sign_in.operator(request.operator)
    else:  # the window passes "" if nobody has entered a name
        operator = computer_user() if request.operator is None else request.operator or None
    setup = replace(setup, request=replace(setup.request, operator=operator))
    pattern, path = setup.product.serial_pattern, setup.sources["product"].path
    if not re.fullmatch(pattern, request.serial):
        raise ConfigurationError("product.serial_mismatch", serial=request.serial, pattern=pattern, product=path)
    return setup


def _check_plans(setup: RunConfiguration) -> None:
    """Check that the plans of stages that need no table can be executed. Raises InputError."""
    for stage, schedule in setup.schedules.items():
        stage_method = method(stage)
        if stage_method.needs_no_table:
            next(stage_method.plan(setup.table.geometry(), schedule), None)


def new_batch_id() -> str:
    """Return a new identifier of a batch, which consists of its start in UTC and four random digits."""
    return f"B{datetime.now(UTC):%Y%m%dT%H%M%S}-{token_hex(2).upper()}"


def unit_requests(request: RunRequest) -> tuple[RunRequest, ...]:
    """Return a request for each unit of a batch in the order of the slots, or the request itself for a single unit.

    Raises ConfigurationError if there is no serial number, one occurs twice, or there are more of them than slots.
    """
    if not request.serials:
        return (request,)
    path, station = load_station(request.station)
    names = station.slot_names
    if not names:
        raise ConfigurationError("batch.one_unit", station=path)
    if len(request.serials) > len(names):
        raise ConfigurationError("batch.more_than_slots", station=path, units=len(request.serials), slots=len(names))
    occupied = [(name, serial) for name, serial in zip(names, request.serials, strict=False) if serial]
    serials = [serial for _, serial in occupied]
    if not serials:
        raise ConfigurationError("batch.no_unit", station=path)
    for number, serial in enumerate(serials):
        if serial in serials[:number]:
            raise ConfigurationError("batch.serial_twice", serial=serial)
    batch = request.batch or new_batch_id()
    slots = tuple(name for name, _ in occupied)
    common = replace(request, serials=(), batch=batch, batch_units=tuple(serials), batch_slots=slots)
    return tuple(replace(common, serial=serial, slot=name) for name, serial in occupied)


def prepare_units(requests: Sequence[RunRequest], adjust: Adjustment) -> tuple[RunConfiguration, ...]:
    """Return the configuration for the request of each unit on the table, with the operator.

    The operator, the serial numbers and the site are checked, too. Files, station and plans are read and checked once
    for all units whose slots differ only in name and port. Raises ConfigurationError, also if the units cannot be on
    one table or have different plans.
    """
    path, station = load_station(requests[0].station)
    by_slot: dict[str, RunConfiguration] = {}
    setups = []
    for unit in requests:
        with in_file(path):
            unit_station = at_slot(station, unit.slot)
        settings = unit_station.imu.model_dump_json(exclude={"name", "port"})
        checked = by_slot.get(settings)
        setup = _read_configuration(unit) if checked is None else replace(checked, request=unit, station=unit_station)
        by_slot.setdefault(settings, setup)
        setup = _prepare(setup, adjust)
        if checked is None:
            check_station(setup)
            _check_plans(setup)
        setups.append(setup)
    first = setups[0]
    for setup in setups[1:]:
        # the order of the stages matters, too
        if list(setup.schedules.items()) != list(first.schedules.items()):
            slot, product = setup.request.slot or "", setup.product.name
            raise ConfigurationError("batch.other_plan", slot=slot, product=product, first=first.product.name)
    return tuple(setups)
