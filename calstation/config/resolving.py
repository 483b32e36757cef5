"""All of a run's configuration, read and checked before anything is opened or moves."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from calstation.config import library, version_store
from calstation.config.register_limits import check_register_limits
from calstation.config.request import RunRequest
from calstation.config.resolved import ResolvedConfiguration
from calstation.config.site_check import check_confirmed, check_place
from calstation.config.station import (
    ProductConfig,
    load_product,
    load_station,
    schedule_values,
)
from calstation.devices.links.opening import SOCKETS
from calstation.devices.profiles.imu import load_imu_profile
from calstation.devices.profiles.imu_checks import check_baud
from calstation.devices.profiles.table import load_table_profile
from calstation.errors import ConfigurationError
from calstation.records.meta import (
    FileSection,
)
from calstation.schema import validate
from calstation.sequencer.stop_rule import named
from calstation.simulation.fault_plan import FaultPlan, load_fault_plan
from procedures import method


class ManualRigError(ConfigurationError):
    """Rails that hands turn and stages that are carried do not come together.

    by_hand : the station's rig is turned by hand and a stage needs one that is driven; or the other way round
    """

    def __init__(self, text: str, *, by_hand: bool = False) -> None:
        super().__init__(text)
        self.by_hand = by_hand


def prepare(request: RunRequest) -> ResolvedConfiguration:
    """Read and check everything that a run needs. Raises ConfigurationError with file, field and mend."""
    setup, product_path = configured(request)
    _check_serial(setup, product_path)
    check_station(setup, product_path)
    for stage in setup.stages:
        chosen = method(stage)
        if chosen.needs_no_table:  # some of these no table can drive at all
            next(chosen.plan(setup.table.geometry(), setup.schedules[stage]), None)
    return setup


def configured(request: RunRequest) -> tuple[ResolvedConfiguration, Path]:
    """A run's configuration, checked, and the product's file; no unit needs to be named yet.

    Raises ConfigurationError with file, field and mend.
    """
    station_path, station = load_station(request.station)
    product_path, product = load_product(request.product)
    if not product.limits:
        raise ConfigurationError(
            f"{product_path}: has no limits; add [limits.NAME] before a unit is judged by it"
        )
    table_path = library.find("tables", station.table.profile)
    imu_path = library.find("imus", product.imu)
    stages = request.stages or tuple(product.stages)
    chosen = request.schedule or {}
    paths = {"station": station_path, "product": product_path, "table": table_path, "imu": imu_path}
    texts = {kind: path.read_bytes().decode() for kind, path in paths.items()}
    setup = ResolvedConfiguration(
        request=request,
        station=station,
        product=product,
        table=load_table_profile(table_path),
        imu=load_imu_profile(imu_path),
        stages=stages,
        schedules={stage: _schedule(product, stage, chosen.get(stage, {}), product_path) for stage in stages},
        texts=texts,
        files={kind: _file(kind, path, texts[kind]) for kind, path in paths.items()},
    )
    faults = _faults(setup, station_path)
    setup = replace(setup, faults=faults, station=faults.station(station))
    _check_bench(setup, station_path)
    for place, words in check_register_limits(product, setup.imu):
        raise ConfigurationError(f"{product_path}: {'.'.join(place)} {words}")
    _check_line(setup, station_path)
    _check_targets("targets", product.targets, product_path)
    for stage, schedule in setup.schedules.items():
        _check_targets(f"schedule.{stage}.targets", getattr(schedule, "targets", {}), product_path)
    return setup, product_path


def check_station(setup: ResolvedConfiguration, product_path: Path) -> None:
    """Whether the product can be calibrated at this station: its rig, and how well its place is known.

    Raises ConfigurationError with field and mend, HandsError where it is the rig.
    """
    check_manual_rig(setup, product_path)
    meta, path = setup.meta(datetime.now(UTC), 1, {}), load_station(setup.request.station)[0]
    check_place(meta, path)
    if setup.station.bench is None:
        check_confirmed(setup.station.site, meta, path)


def check_manual_rig(setup: ResolvedConfiguration, product_path: Path) -> None:
    """Rails that hands turn need stages that are carried, and carried stages need such rails.

    Raises HandsError with the stage and the mend.
    """
    rig = setup.table.name
    for stage, schedule in setup.schedules.items():
        manual = getattr(schedule, "manual", None)
        if setup.by_hand and manual is None:
            raise ManualRigError(
                f"stages: '{stage}' needs a table that is driven, but '{rig}' of station '{setup.station.name}' is"
                " turned by hand; choose multi_position, or another station",
                by_hand=setup.by_hand,
            )
        if setup.by_hand and not manual:
            raise ManualRigError(
                f"{product_path}: schedule.{stage}.manual must be true, because '{rig}' of station"
                f" '{setup.station.name}' is turned by hand; set it, or choose another product or station",
                by_hand=setup.by_hand,
            )
        if manual and not setup.by_hand:
            raise ManualRigError(
                f"{product_path}: schedule.{stage}.manual is true, but the table '{rig}' of station"
                f" '{setup.station.name}' is driven; choose a station with rails turned by hand, or another product",
                by_hand=setup.by_hand,
            )


def _file(kind: str, path: Path, text: str) -> FileSection:
    """Which file it is, and which of its saved versions."""
    version = version_store.number_of(f"{kind}s", path.stem, text)
    return FileSection(name=path.stem, version=version, sha256=version_store.sha256(text))


def _check_line(setup: ResolvedConfiguration, station_path: Path) -> None:
    """A place's own baud carries the unit's stream; of a socket nobody knows."""
    own, port = setup.station.imu.serial, setup.station.imu.port or ""
    if own is None or "baud" not in own.model_fields_set or port.startswith(SOCKETS):
        return
    try:
        for frame in setup.imu.frames:
            check_baud(own, frame, setup.imu.stream.sample_rate_hz)
    except ValueError as exc:
        raise ConfigurationError(
            f"{station_path}: imu.serial: {str(exc).replace('link.baud', 'baud')}"
        ) from None


def _check_targets(field: str, targets: Iterable[str], product_path: Path) -> None:
    """A target of no parameter would count as reached at once."""
    for name in targets:
        if not named(name):
            raise ConfigurationError(f"{product_path}: {field}.{name} is no parameter or group; remove it")


def _check_serial(setup: ResolvedConfiguration, product_path: Path) -> None:
    pattern = setup.product.serial_pattern
    if not re.fullmatch(pattern, setup.request.serial):
        raise ConfigurationError(
            f"--serial '{setup.request.serial}' does not fit the pattern '{pattern}' of {product_path}; "
            "correct the number or choose another --product"
        )


def _faults(setup: ResolvedConfiguration, station_path: Path) -> FaultPlan:
    """The plan of the request, or that named beside the station file's bench."""
    path = setup.request.faults
    if setup.station.bench is None:
        if path is not None:
            raise ConfigurationError(
                f"--faults belongs to the virtual bench; {station_path} is hardware, leave it out"
            )
        return FaultPlan()
    named = setup.station.bench.get("faults")
    if path is None and named is not None:
        path = station_path.parent / str(named)
    return FaultPlan() if path is None else load_fault_plan(path)


def _check_bench(setup: ResolvedConfiguration, station_path: Path) -> None:
    config = setup.bench_words()
    if config is None:
        for option, value in (("--speed", setup.request.speed), ("--seed", setup.request.seed)):
            if value is not None:
                raise ConfigurationError(
                    f"{option} belongs to the virtual bench; {station_path} is hardware, leave it out"
                )
        return
    from calstation.bench.config import BenchConfig

    validate(BenchConfig, setup.faults.bench(config), f"{station_path} [bench]")


def _schedule(product: ProductConfig, stage: str, instead: Mapping[str, Any], path: Path) -> BaseModel:
    """A stage's schedule, checked. Raises ConfigurationError naming file, field and mend."""
    given = schedule_values(product, stage, instead)
    return validate(method(stage).schedule, given, f"{path}: schedule.{stage}")
